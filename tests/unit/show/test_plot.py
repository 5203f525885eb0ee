"""A finished run in Python: its pictures on axes of one's own, its tables, and what a notebook shows of it."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes

import wakeflow as wf
from support import Here, Page, field_of, shipped
from wakeflow.core import tables
from wakeflow.show.views import cells_left, outcome_of

pytestmark = pytest.mark.usefixtures("no_screen")


def _lines(axes: Axes) -> dict[str, np.ndarray]:
    """The data (m, 2) of each labelled line."""
    return {
        str(line.get_label()): np.asarray(line.get_xydata())
        for line in axes.lines
        if not str(line.get_label()).startswith("_")
    }


def test_tracks_on_given_axes_are_those_of_the_report(small_run: wf.Result) -> None:
    figure, panels = pyplot.subplots(1, 2)
    drawn = wf.Result.load(small_run.folder).plot.tracks(panels[0])
    assert drawn is panels[0]
    assert figure.axes == list(panels)  # nothing else is changed
    file = small_run.folder / "figures" / "tracks.csv"
    rows = np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding=None)
    for label, points in _lines(drawn).items():
        own = rows[rows["fraction"] == label.split(",")[0]]
        told = points[np.isfinite(points[:, 0])]
        assert told == pytest.approx(1e3 * np.stack([own["x_m"], own["y_m"]], axis=1), rel=1e-5, abs=1e-4)
    assert len(_lines(drawn)) == len(small_run.scene["fraction"])


def test_a_picture_of_several_panels_takes_the_place_of_the_axes(small_run: wf.Result) -> None:
    figure, panels = pyplot.subplots(1, 2)
    left = panels[0].get_position()
    drawn = small_run.plot.landing(panels[0])
    assert panels[0] not in figure.axes
    assert drawn.shape == (len(small_run.scene["fraction"]), 1)
    for axes in drawn.flat:
        assert axes.figure.figure is figure
        middle = axes.get_window_extent().x0 / figure.bbox.width
        assert middle < left.x1 + 0.1  # in the left half still
    alone = figure.add_axes((0.0, 0.0, 0.1, 0.1))
    with pytest.raises(wf.SceneError, match="no grid"):
        small_run.plot.landing(alone)


def test_without_axes_a_figure_of_pyplot_of_its_own_size(small_run: wf.Result) -> None:
    axes = small_run.plot.sketch()
    assert axes.figure is pyplot.gcf()
    assert tuple(axes.figure.get_size_inches()) != tuple(pyplot.rcParams["figure.figsize"])


def test_what_a_run_has_not_is_said(small_run: wf.Result, tmp_path: Path) -> None:
    assert "tracks" in dir(small_run.plot)
    assert "pressure" not in dir(small_run.plot)
    assert "landing" in repr(small_run.plot)
    with pytest.raises(wf.SceneError, match="nothing to draw as pressure; it has sketch, tracks"):
        small_run.plot.pressure()
    with pytest.raises(AttributeError, match="did you mean 'landing'"):
        _ = small_run.plot.landings
    for name in ("bracket", "history"):  # no nearest one, still all that there are
        with pytest.raises(AttributeError, match=rf"no picture '{name}'.* \(known: sketch, tracks, landing"):
            getattr(small_run.plot, name)
    assert not hasattr(small_run.plot, "_repr_png_")
    moved = replace(small_run, folder=tmp_path)
    with pytest.raises(AttributeError, match="known: sketch, pressure"):
        _ = moved.plot.bracket
    with pytest.raises(wf.SceneError, match="holds no report to draw from"):
        moved.plot.tracks()


def test_a_picture_is_drawn_on_one_axes_or_a_figure_and_nothing_else(small_run: wf.Result) -> None:
    figure, panels = pyplot.subplots(1, 2)
    for given, message in (
        ((3,), r"in the place of one matplotlib axes, or in a figure, plot.landing\(axes\), not on int"),
        (("landing.png",), "not on str"),
        ((panels,), "in the place of one matplotlib axes, .* not on ndarray"),
        ((panels[0], panels[1]), "not on Axes"),
    ):
        with pytest.raises(wf.SceneError, match=message):
            small_run.plot.landing(*given)
    with pytest.raises(wf.SceneError, match=r"plot\.tracks draws in the place of one .* not on list"):
        small_run.plot.tracks(list(panels))
    with pytest.raises(wf.SceneError, match=r"plot.tracks\(axes\), not on ax="):
        small_run.plot.tracks(ax=panels[0])
    assert figure.axes == list(panels)  # all refused before anything was drawn or taken away
    assert small_run.plot.landing(pyplot.figure()).shape == (2, 1)


def test_what_a_run_does_not_keep_is_found_in_its_file(small_run: wf.Result, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(small_run.folder, folder)
    (folder / "figures" / "forces.png").write_bytes(b"of a solved airflow")
    with pytest.raises(wf.SceneError, match=f"see {folder}/figures/forces.png; wakeflow report"):
        wf.Result.load(folder).plot.forces()


def test_the_mesh_is_drawn_of_what_its_picture_left(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3], [0.0, 1e-3], [2e-3, 0.0]])
    ends = {"cell ends": [4, 7], "cell corners": [0, 1, 2, 3, 1, 4, 2]}
    np.savez_compressed(tmp_path / "mesh.npz", **{"x (m)": corners[:, 0], "y (m)": corners[:, 1], **ends})
    cells = cells_left(tmp_path / "mesh.npz")
    assert np.array_equal(cells.points, corners)
    assert [cell.tolist() for cell in cells.cells] == [[0, 1, 2, 3], [1, 4, 2]]
    assert cells_left(tmp_path / "none.npz") is None
    (tmp_path / "mesh.npz").write_bytes(b"PK no more")
    with pytest.raises(wf.SceneError, match="damaged; wakeflow report"):
        cells_left(tmp_path / "mesh.npz")


def test_the_air_of_a_finished_run_is_read_back(tmp_path: Path) -> None:
    from wakeflow.show import vtk

    field = field_of(lambda points: np.stack([points[:, 1], -points[:, 0]], axis=1), 4)
    vtk.write_field(tmp_path, field, shipped("rhombus"), None)
    found = wf.FlowField.load(tmp_path / "field.npz")
    assert np.array_equal(found.velocity, field.velocity)
    assert np.array_equal(found.triangles, field.triangles)


def test_landings_read_back_are_those_of_the_kept_granules(small_run: wf.Result) -> None:
    landings = outcome_of(small_run).landings
    assert list(landings) == list(small_run.scene["fraction"])
    for name, landed in landings.items():
        assert landed.weight.sum() == pytest.approx(1.0)
        for index, place in enumerate(small_run.scene["bin"]):
            share = landed.weight[landed.bin == index].sum()
            assert share == pytest.approx(small_run.share(name, place)[0], abs=1e-9)  # all granules are kept here


def test_frames_are_plain_arrays_without_pandas(small_run: wf.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "find_spec", lambda name: None)
    table: dict[str, Any] = small_run.frame()
    assert list(table) == ["fraction", "bin", "share", "low", "high", "target"]
    for name, place, share, low, high in zip(*(table[head] for head in list(table)[:5]), strict=True):
        assert [share, low, high] == [*small_run.share(name, place)]
    assert {(n, p) for n, p, t in zip(table["fraction"], table["bin"], table["target"], strict=True) if t} == {
        (name, place) for name in small_run.scene["fraction"] for place in small_run.targets(name)
    }
    granules = small_run.granules()
    assert {len(column) for column in granules.values()} == {256 * len(small_run.scene["fraction"])}
    assert set(granules["bin"]) <= {*small_run.scene["bin"], "elsewhere"}
    shares = small_run.scene["fraction"]
    for name in shares:
        own = granules["fraction"] == name
        assert granules["weight"][own].sum() == pytest.approx(shares[name].get("mass_share", 1.0 / len(shares)))


def test_frames_are_pandas_where_it_is_installed(small_run: wf.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    class Pandas:
        @staticmethod
        def DataFrame(columns: dict[str, Any]) -> tuple[str, list[str]]:
            return "frame", list(columns)

    monkeypatch.setattr(tables, "find_spec", lambda name: name)
    monkeypatch.setattr(tables, "import_module", lambda name: {"pandas": Pandas}[name])
    assert small_run.frame() == ("frame", ["fraction", "bin", "share", "low", "high", "target"])


def test_what_does_not_exist_is_said_with_the_nearest_name(small_run: wf.Result) -> None:
    first = next(iter(small_run.scene["fraction"]))
    with pytest.raises(wf.SceneError, match=f"no fraction '{first}x'; did you mean '{first}'"):
        small_run.share(f"{first}x", "near")
    with pytest.raises(wf.SceneError, match="no bin 'neer'; did you mean 'near'"):
        small_run.share(first, "neer")
    with pytest.raises(wf.SceneError, match=f"no fraction '{first}x'; did you mean '{first}'"):
        small_run.recovery(f"{first}x")
    with pytest.raises(wf.SceneError, match="no bin 'neer'; did you mean 'near'"):
        small_run.purity("neer", first)
    with pytest.raises(wf.SceneError, match=f"no fraction '{first}x'"):
        small_run.purity("near", f"{first}x")
    with pytest.raises(wf.SceneError, match="nothing lands in elsewhere"):
        small_run.purity("elsewhere", first)


def test_recovery_and_purity_are_those_of_the_table(small_run: wf.Result) -> None:
    table, first = small_run.separation, next(iter(small_run.scene["fraction"]))
    for found, row in (
        (small_run.recovery(first), table["recovery"][first]),
        (small_run.purity("near", first), table["purity"]["near"][first]),
    ):
        assert [*found] == [row["value"], row["low"], row["high"]]
    tables = shipped("vacuum", {"feed.count": 32}).tables()
    del tables["fraction"][first]["target"]
    chained = wf.chain(wf.Scene.parse(tables))
    with pytest.raises(wf.SceneError, match=f"{first} has no target .* give fraction.{first}.target"):
        chained.recovery(first)
    assert chained.purity("near", first)[0] == chained.separation["purity"]["near"][first]["value"]


def test_a_notebook_shows_the_answer_and_a_line_says_it(small_run: wf.Result) -> None:
    assert len(repr(small_run)) < 300
    assert str(small_run.folder) in repr(small_run)
    page = Page(small_run._repr_html_())
    assert not page.open
    bins, fractions = small_run.separation["bins"], list(small_run.scene["fraction"])
    (rows,) = page.tables.values()
    assert rows[0][: len(fractions) + 1] == ["% of its mass", *fractions]
    assert [row[0] for row in rows] == ["% of its mass", *bins, "recovery", "loss", "loss, kg/h"]
    value = 100 * small_run.share(fractions[0], bins[0])[0]
    assert float(rows[1][1].split()[0]) == pytest.approx(value, abs=0.06)


def test_a_plan_is_a_line_and_a_page() -> None:
    plan = wf.plan(shipped("rhombus"))
    assert len(repr(plan)) < 300
    assert "wheat" in repr(plan)
    page = Page(plan._repr_html_())
    assert not page.open
    assert "left out" in plan._repr_html_()


def test_tables_of_many_runs_are_short_too(tmp_path: Path) -> None:
    found = wf.sweep(
        wf.variants(shipped("vacuum", {"feed.count": 32}), {"feed.height": ["50 mm", "60 mm"]}),
        tmp_path / "sweep", scheduler=Here(), figures=False,
    )  # fmt: skip
    assert repr(found) == f"<Sweep {tmp_path / 'sweep'}: 2 of 2 scenes done over feed.height>"
    page = Page(found._repr_html_())
    assert not page.open
    assert {"50", "60"} <= {cell for rows in page.tables.values() for row in rows for cell in row}
