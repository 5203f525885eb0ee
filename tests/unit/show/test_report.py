"""The report says what it was handed: pictures, VTK files, tables, HTML."""

import base64
import io
import itertools
import math
import sys
from collections.abc import Iterator
from csv import DictReader
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from PIL import Image

from support import Page, shipped
from wakeflow.air.field import EMPTY, FlowField
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.answer.result import SCHEMA, Result
from wakeflow.answer.shares import PartitionCurve, Separation
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import along, contains
from wakeflow.core.number import UNKNOWN_ERROR, Number
from wakeflow.core.record import from_json, to_json
from wakeflow.extras.motion import live
from wakeflow.extras.motion.live import live_data
from wakeflow.flight.feed.impact_loads import impact_loads
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.pictures import STANDARD_FIGURES
from wakeflow.show import Landed, Outcome, clear_report, draw_ahead, html, is_whole, vtk, write_report
from wakeflow.show import words as tables
from wakeflow.show.air_pictures import window_round_body
from wakeflow.show.canvas import FOREMOST, foremost, inside_window, new_axes, save
from wakeflow.show.figures import Figure, figures, flights, share_figures
from wakeflow.show.figures import air_figures as air
from wakeflow.show.figures.air_figures import draw_pressure, draw_surface, draw_vorticity
from wakeflow.show.figures.flights import draw_residence, draw_tracks
from wakeflow.show.figures.share_figures import draw_landing, draw_partition
from wakeflow.show.html.pages import FRONT
from wakeflow.show.terminal import budget_table, separation_table
from wakeflow.show.words import in_three_dimensions, part_words, percent

INLET, RHO = 3.0, 1.2  # Pa, kg/m3: pressure is not measured from zero
AIRFLOW = {
    "rung": "draft", "verdict": "steady", "cells": 4321, "reynolds": 16493.0,
    "cd": {"value": 1.2345, "low": 1.21, "high": 1.26}, "strouhal": None,
    "cl_rms": {"value": 0.0, "low": 0.0, "high": 0.001}, "cp_base": {"value": -0.62, "low": -0.63, "high": -0.61},
    "pressure_drop": 3.14, "flow_rate": 1.5, "p_inlet": INLET,
    "suction": {
        "threshold": -0.5, "cp_min": -1.93, "length": 0.083, "width": 0.061, "area": 0.0041, "reversal_length": 0.131,
    },
}  # fmt: skip


FOUND = from_json(Airflow, AIRFLOW)
CD = "cd: drag coefficient of all bodies on the first one's width"
LENGTH = "suction zone, length: along the air, from the body's rear-most point"
PLAN: dict[str, Any] = {
    "airflow": {"rung": "draft", "why": "", "stepping": "steady", "turbulence": None, "symmetric": True, "half": True},
    "target_error": 0.01, "force": {}, "fractions": {}, "estimate": {"seconds": 1.0, "memory": 1.0, "disk": 1.0},
}  # fmt: skip


def _field(scene: Scene, step: float = 0.01) -> FlowField:
    """Uniform air round the body; Cp = 0.9 in a spot ahead of it, -1.5 in one behind it."""
    channel, sign = scene.channel, 1.0 if scene.air.direction == "down" else -1.0
    x = np.linspace(-channel.width / 2, channel.width / 2, round(channel.width / step) + 1)
    y = np.linspace(channel.bottom, channel.top, round((channel.top - channel.bottom) / step) + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    corner = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
    quads = np.stack([corner, corner + 1, corner + 1 + len(x), corner + len(x)], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    outline = next(iter(scene.body.values())).outline()
    triangles = triangles[~contains(outline, points[triangles].mean(axis=1))]
    ahead, behind = sign * 0.05, -sign * 0.07
    spots = [np.exp(-((points[:, 0] / 0.03) ** 2) - ((points[:, 1] - at) / 0.03) ** 2) for at in (ahead, behind)]
    dynamic = 0.5 * RHO * scene.air.speed**2
    velocity = np.tile([0.0, -sign * scene.air.speed], (len(points), 1))
    used = np.unique(triangles)  # nodes inside the body go
    new = np.full(len(points), -1)
    new[used] = np.arange(len(used))
    pressure = INLET + dynamic * (0.9 * spots[0] - 1.5 * spots[1])
    return FlowField.from_arrays(points[used], new[triangles], velocity[used], pressure[used], density=RHO)


def _tracks(scene: Scene) -> dict[str, list[dict[str, np.ndarray]]]:
    tracks: dict[str, list[dict[str, np.ndarray]]] = {}
    for i, name in enumerate(scene.fraction):
        tracks[name] = []
        for side in (-1, 1):
            time = np.linspace(0.0, 0.2, 11 + i)
            velocity = np.stack([np.full_like(time, side * (0.1 + 0.1 * i)), -9.81 * time], axis=1)
            position = np.stack([side * 0.03 + velocity[0, 0] * time, -4.905 * time**2], axis=1)
            ends = {"diameter": np.array(1e-3), "bin": np.array(0), "fate": np.array(0)}
            moments = {"time": time, "position": position, "velocity": velocity, "arriving": velocity}
            tracks[name].append({**moments, **ends})
    return tracks


def _landings(scene: Scene, seed: int = 7) -> dict[str, Landed]:
    """Some in every bin, some elsewhere, unequal weights; the last fraction lands nowhere."""
    rng, found = np.random.default_rng(seed), {}
    for i, name in enumerate(scene.fraction):
        bins = rng.integers(-1, len(scene.bin), 500) if i < len(scene.fraction) - 1 else np.full(500, -1)
        x, y = np.full(500, 0.0), np.full(500, scene.channel.top)
        for j, bin_ in enumerate(scene.bin.values()):
            here, line = bins == j, bin_.line(scene)
            part = rng.uniform(0.05, 0.95, int(here.sum()))[:, None]
            x[here], y[here] = (line[0] + part * (line[-1] - line[0])).T
        found[name] = Landed(x, y, rng.uniform(0.5, 1.5, 500), bins)
    return found


def _result(scene: Scene, airflow: dict[str, Any] | None) -> dict[str, Any]:
    """A result whose numbers all differ, so that none can stand in for another; the last fraction lands nowhere."""
    bins, count = [*scene.bin, "elsewhere"], len(scene.fraction)
    fractions: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(scene.fraction):
        raw = np.arange(1.0, len(bins) + 1) + 0.137 * i
        shares = raw / raw.sum() if i < count - 1 else np.eye(len(bins))[-1]
        half = 0.004 + 0.001 * i
        fractions[name] = {
            b: {"value": float(s), "low": max(0.0, float(s) - half), "high": min(1.0, float(s) + half)}
            for b, s in zip(bins, shares, strict=True)
        }
    purity: dict[str, Any] = {
        b: {
            name: {"value": (i + 1.5 + 0.01 * j) / 10, "low": (i + 1.2) / 10, "high": (i + 1.8) / 10}
            for i, name in enumerate(scene.fraction)
        }
        for j, b in enumerate(bins)
    }
    purity[bins[0]] = None  # an empty bin has no purity
    recovery = {
        name: {"value": 0.31 + 0.2 * i, "low": 0.3 + 0.2 * i, "high": 0.32 + 0.2 * i} if f.targets else None
        for i, (name, f) in enumerate(scene.fraction.items())
    }
    parts = [
        {"source": "sampling", "error": 0.0043, "seconds": 1.5, "how": "measured"},
        {"source": "airflow-model", "error": None, "seconds": 0.0, "how": "unknown"},
    ]
    total = {"error": None, "seconds": 1.5}
    return {
        "schema": SCHEMA,
        "scene": scene.tables(),
        "options": {"until": None, "rung": None, "force": {}, "target_error": None},
        "funnel": None,
        "plan": {
            **PLAN,
            "used": ["steady airflow"],
            "left_out": [
                {"name": "basset-history", "bound": 3.1e-4, "why": "small", "fraction": None},
                {"name": "brownian", "bound": None, "why": "all < large", "fraction": None},
            ],
        },
        "airflow": airflow,
        "separation": {
            "bins": bins,
            "fractions": fractions,
            "purity": purity,
            "recovery": recovery,
            "throughput": {b: 11.5 + i for i, b in enumerate(bins)},
            "cut": [],
        },
        "met_by_law": {},
        "impact": None,
        "bracket": None,
        "key": "k",
        "fates": {name: {"binned": 480 + i, "escaped": 20 - i} for i, name in enumerate(scene.fraction)},
        "budget": [
            {"quantity": f"share.{name}.{bins[0]}", "unit": None, "parts": parts, "total": total}
            for name in scene.fraction
        ],
        "seconds": {"mesh": {"seconds": 1.25, "cached": True}, "tracks": {"seconds": 200.0, "cached": False}},
        "warnings": ["the curtain is dense"],
        "grades": ["less sure"],
        "versions": {"wakeflow": "0.1.0"},
        "provenance": {
            "date": "2026-11-28T05:00:00+00:00", "command": "wakeflow run", "folder": "/home", "host": "here",
            "system": "Linux", "cores": 2, "seed": 0, "openfoam": None, "commit": None,
        },
    }  # fmt: skip


def _read(table: dict[str, Any]) -> Result:
    return Result.from_json("run", table)


def _separation(result: Result) -> Separation:
    return result.landings.separation


def _outcome(scene: Scene) -> Outcome:
    result = _read(_result(scene, None if scene.air is None else AIRFLOW))
    return Outcome(
        scene=scene, field=None if scene.air is None else _field(scene), airflow=result.airflow,
        tracks=_tracks(scene), cells=None, history=None, landings=_landings(scene), result=result, shown={},
        granules=_granules(),
    )  # fmt: skip


def _granules() -> dict[str, np.ndarray]:
    """The columns of granules.npz of one granule."""
    names = ("fraction", "bin", "weight", "fate", "diameter", "time", "impacts")
    return {"position": np.zeros((1, 2)), **{name: np.zeros(1) for name in names}}


@pytest.fixture(scope="module", params=["rhombus", "prism", "vacuum"])
def scene(request: pytest.FixtureRequest) -> Scene:
    return shipped(request.param)


@pytest.fixture(scope="module")
def page(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of each scene, alone in its folder."""
    return write_report(tmp_path_factory.mktemp("report"), _outcome(scene))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures as they are about to be saved."""
    kept: list[Any] = []
    for module in (air, flights, share_figures):
        monkeypatch.setattr(module, "save", lambda figure, path, data=None: kept.append(figure))
    return kept


def _annotations(figure: Any) -> dict[str, Any]:
    return {a.get_text(): a for axes in figure.axes for a in axes.texts if a.get_text()}


def test_everything_is_written_whole(scene: Scene, page: Path) -> None:
    folder = page.parent
    names = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    blocks = {name for name in names if name.startswith("machine/")}
    assert len(blocks) >= len(scene.body) + len(scene.bin)
    names -= blocks
    always = {"figures/tracks.csv", "figures/landing.csv", "tracks.vtp", "machine.vtm", "landings.vtp"}
    always |= {"separation.csv", "budget.csv", "report.html"}
    pictures = ["sketch", "tracks", "landing", *(["pressure", "vorticity", "residence"] if scene.air else [])]
    drawn = {f"figures/{name}{suffix}" for name in pictures for suffix in (".png", ".svg")}
    data = {f"figures/{name}" for name in ("pressure.npz", "vorticity.npz", "residence.csv")}
    assert names == always | drawn | ({"field.npz", "field.vtu", *data} if scene.air else set())
    assert page.name == "report.html"
    heads = {(folder / name).read_bytes()[:8] for name in names if name.endswith(".png")}
    assert heads == {b"\x89PNG\r\n\x1a\n"}


def test_nothing_of_an_earlier_scene_stays(cases: Path, tmp_path: Path) -> None:
    write_report(tmp_path, _outcome(Scene.load(cases / "rhombus.toml")))
    (tmp_path / "result.json").write_text("{}")
    page = write_report(tmp_path, _outcome(Scene.load(cases / "vacuum.toml")))
    assert not (tmp_path / "field.vtu").exists()
    assert not (tmp_path / "figures" / "pressure.png").exists()
    assert (tmp_path / "result.json").exists()
    assert "computed without air" in page.read_text()


def test_what_is_drawn_ahead_is_shown_by_every_run(rhombus: Scene, tmp_path: Path) -> None:
    outcome, (air, seen) = _outcome(rhombus), (tmp_path / name for name in ("air", "seen"))
    write_report(tmp_path / "whole", outcome)
    vtk.write_field(air, outcome.field, rhombus, outcome.airflow)
    draw_ahead(seen, outcome)
    write_report(tmp_path / "run", outcome, [air, seen])
    whole, run = (_contents(tmp_path / name) for name in ("whole", "run"))
    assert whole.keys() == run.keys()
    assert [name for name in whole if whole[name] != run[name]] == []
    assert (tmp_path / "run" / "field.npz").samefile(air / "field.npz")
    assert not (tmp_path / "run" / "figures" / "tracks.svg").samefile(seen / "figures" / "tracks.svg")


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_field_without_pressure_still_gives_tracks(rhombus: Scene, tmp_path: Path) -> None:
    outcome = _outcome(rhombus)
    assert outcome.field is not None
    outcome = replace(outcome, field=replace(outcome.field, pressure=EMPTY))
    assert outcome.field is not None
    write_report(tmp_path, outcome)
    assert (tmp_path / "figures" / "tracks.png").exists()
    assert not (tmp_path / "figures" / "pressure.png").exists()
    with pytest.raises(ValueError, match="pressure"):
        draw_pressure(tmp_path / "p.png", outcome.field, rhombus, FOUND)


def _draw_sizes(paper: "Canvas | str | Path", outcome: Outcome) -> Any:
    axes = new_axes(4.0, 3.0, paper)
    axes.bar(list(outcome.landings), [len(found.bin) for found in outcome.landings.values()])
    save(axes.figure, paper)
    return axes


@pytest.fixture
def sizes() -> Iterator[str]:
    """A figure that is added from outside, as docs/extending.md shows it, and taken out again."""
    name = "sizes"
    figures.add(name, Figure("How many granules of each fraction were flown.", _draw_sizes, lambda outcome: (outcome,)))
    yield name
    del figures._entries[name]


def test_a_new_figure_is_drawn_shown_and_cleared(sizes: str, cases: Path, tmp_path: Path) -> None:
    page = write_report(tmp_path, _outcome(Scene.load(cases / "vacuum.toml")))
    assert (tmp_path / "figures" / f"{sizes}.png").stat().st_size > 500
    assert "How many granules of each fraction were flown." in page.read_text()
    clear_report(tmp_path)
    assert not (tmp_path / "figures" / f"{sizes}.png").exists()


def test_a_figure_is_drawn_where_the_run_has_what_it_shows(cases: Path, tmp_path: Path) -> None:
    figures.add("never", Figure("Nothing.", _draw_sizes, lambda outcome: (), always=True))
    try:
        write_report(tmp_path, _outcome(Scene.load(cases / "vacuum.toml")))
        assert not (tmp_path / "figures" / "never.png").exists()
        assert not is_whole(tmp_path)  # a figure that every report has is missing
    finally:
        del figures._entries["never"]
    assert is_whole(tmp_path)


def test_no_picture_of_a_scene_takes_the_name_of_a_figure(cases: Path) -> None:
    assert tuple(figures) == STANDARD_FIGURES
    for name in figures:
        with pytest.raises(SceneError, match=f"picture.{name}: every run draws one of this name"):
            Scene.load(cases / "rhombus.toml", {f"picture.{name}.kind": "density"})


SECOND = {"shape": "rhombus", "width": "30 mm", "slope_angle": "50 deg"}


def _with_a_second(cases: Path) -> Scene:
    """The prism in upward air with a deflector ahead of it, further off than the picture of one body reaches."""
    deflector = {**SECOND, "at": ["60 mm", "-120 mm"]}
    changes = {f"body.deflector.{key}": value for key, value in deflector.items()}
    return Scene.load(cases / "prism.toml", changes)


def test_the_window_of_the_air_holds_every_body(cases: Path) -> None:
    alone, scene = Scene.load(cases / "prism.toml"), _with_a_second(cases)
    outline = scene.body["deflector"].outline()
    assert not inside_window(outline, window_round_body(alone, FOUND)).all()
    assert inside_window(outline, window_round_body(scene, FOUND)).all()


def test_the_body_whose_surface_is_drawn_is_named_among_several(cases: Path) -> None:
    alone, scene = Scene.load(cases / "prism.toml"), _with_a_second(cases)
    titles = [draw_surface(Canvas(), _field(one), one, FOUND).get_title(loc="left") for one in (alone, scene)]
    assert titles == ["", "prism, the first of 2 bodies"]


@pytest.mark.parametrize(("width", "told"), [(0.061, ""), (0.399, "the zone spans the channel")])
def test_times_in_a_zone_from_wall_to_wall_are_told_as_such(width: float, told: str, cases: Path) -> None:
    scene = Scene.load(cases / "rhombus.toml", {"channel.width": "400 mm"})
    assert FOUND.suction is not None
    airflow = replace(FOUND, suction=replace(FOUND.suction, width=width))
    legend = draw_residence(Canvas(), _field(scene), scene, airflow, _tracks(scene)).get_legend()
    assert legend.get_title().get_text().startswith(told)
    assert bool(legend.get_title().get_text()) == bool(told)


def test_the_vorticity_of_steady_air_is_one_panel_that_its_caption_fits(rhombus: Scene) -> None:
    panels = draw_vorticity(Canvas(), _field(rhombus), rhombus, FOUND)
    assert [axes.get_title(loc="left") for axes in panels] == ["mean"]
    assert figures["vorticity"].caption.startswith("Mean vorticity")


@pytest.mark.parametrize("name", ["rhombus", "prism"])
def test_zones_are_named_where_they_are(name: str, cases: Path, drawn: list[Any]) -> None:
    scene = Scene.load(cases / f"{name}.toml")
    draw_pressure("unused", _field(scene), scene, FOUND)
    told = _annotations(drawn[0])
    down = 1.0 if scene.air.direction == "down" else -1.0
    pressing, suction = told["pressing zone"].xy, told["suction zone"].xy
    assert pressing == pytest.approx((0.0, down * 50.0), abs=12.0)
    assert suction[0] == pytest.approx(0.0, abs=12.0)
    assert -110.0 < down * suction[1] < -30.0  # mm
    title = drawn[0].axes[0].get_title(loc="left")
    assert all(text in title for text in ("draft", "16493", "1.234 (1.210 to 1.260)"))


def test_pressure_is_drawn_as_a_coefficient_from_the_inlet(
    rhombus: Scene, drawn: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.axes import Axes

    seen, draw = [], Axes.tricontour

    def tricontour(self: Axes, mesh: Any, values: Any, **how: Any) -> Any:
        if how["linestyles"] == "--":
            seen.append((values, how["levels"]))
        return draw(self, mesh, values, **how)

    monkeypatch.setattr(Axes, "tricontour", tricontour)
    draw_pressure("unused", _field(rhombus), rhombus, FOUND)
    values, levels = seen[0]
    assert levels == [-0.5]
    assert np.max(values) == pytest.approx(0.9, abs=0.02)
    assert np.min(values) == pytest.approx(-1.5, abs=0.03)
    without = replace(FOUND, p_inlet=math.nan)
    draw_pressure("unused", _field(rhombus), rhombus, without)  # from the field's own inlet then
    assert np.allclose(seen[1][0], values, atol=1e-3)
    scale = drawn[0].axes[0].collections[0].norm
    assert scale.vmin == -scale.vmax  # white is no pressure difference


def test_the_mean_of_a_field_in_time_is_drawn(rhombus: Scene, drawn: list[Any]) -> None:
    steady = _field(rhombus)
    swing = np.array([-1.0, 1.0, -1.0])[:, None]  # its trapezoidal mean is 0
    moving = replace(
        steady,
        velocity=np.stack([steady.velocity] * 3),
        pressure=steady.pressure + swing * 5.0,
        times=np.array([0.0, 0.1, 0.2]),
    )
    draw_pressure("unused", steady, rhombus, FOUND)
    draw_pressure("unused", moving, rhombus, FOUND)
    one, other = (figure.axes[0].collections[0] for figure in drawn)
    assert np.allclose(one.levels, other.levels)
    assert drawn[1].axes[0].get_title(loc="left").startswith("Mean")


def test_names_in_pictures_do_not_overlap(scene: Scene, drawn: list[Any]) -> None:
    outcome = _outcome(scene)
    positions = {name: [t["position"] for t in part] for name, part in outcome.tracks.items()}
    draw_tracks("unused", outcome.field, scene, positions)
    draw_landing("unused", scene, outcome.landings, _separation(outcome.result))
    if scene.air is not None:
        draw_pressure("unused", outcome.field, scene, FOUND)
    for figure in drawn:
        figure.canvas.draw()
        boxes = [
            (t.get_text(), t.get_window_extent()) for axes in figure.axes for t in axes.texts if t.get_text().strip()
        ]
        assert {*scene.bin} <= {text for text, _ in boxes} or "suction zone" in dict(boxes)
        for (one, box), (other, against) in itertools.combinations(boxes, 2):
            assert not box.overlaps(against), f"{one!r} overlaps {other!r}"


def test_every_track_and_fraction_is_drawn_in_mm(rhombus: Scene, drawn: list[Any]) -> None:
    tracks = {name: [t["position"] for t in part] for name, part in _tracks(rhombus).items()}
    draw_tracks("unused", None, rhombus, {**tracks, "wheat": []})
    lines = {str(line.get_label()).partition(",")[0]: line for line in drawn[0].axes[0].lines}
    xy = lines["chaff"].get_xydata()
    both = np.concatenate([1000 * track for track in tracks["chaff"]])
    assert np.allclose(xy[~np.isnan(xy[:, 0])], both)
    assert np.isnan(xy[len(tracks["chaff"][0])]).all()  # a gap between two tracks
    assert {t.get_text() for t in drawn[0].axes[0].get_legend().get_texts()} == {
        "dust, 2 %", "chaff, 8 %", "wheat, 90 %",
    }  # fmt: skip
    assert len({lines[name].get_color() for name in tracks}) == 3


def test_figures_of_very_many_fractions_show_those_with_most_mass(tmp_path: Path) -> None:
    """A row a fraction made a picture of 300 too tall to be written, and their legend left the map no room."""
    tables = shipped("vacuum").tables()
    one, count = tables["fraction"]["hard"], 300
    tables["fraction"] = {f"f{i}": {**one, "mass_share": 2.0 if i in (7, 200) else 1.0} for i in range(count)}
    whole = sum(row["mass_share"] for row in tables["fraction"].values())
    for row in tables["fraction"].values():
        row["mass_share"] /= whole
    scene = Scene.parse(tables)
    shown = foremost(scene, list(scene.fraction))
    assert {"f7", "f200", "f0", "f299"} <= set(shown)
    assert len(shown) == FOREMOST
    made = _result(scene, None)  # whose numbers are made for few
    made["separation"] |= {
        "purity": dict.fromkeys([*scene.bin, "elsewhere"]),
        "recovery": dict.fromkeys(scene.fraction),
    }
    landed = draw_landing(tmp_path / "landing.png", scene, _landings(scene), _separation(_read(made)))
    assert len(landed) == FOREMOST
    positions = {name: [track["position"] for track in part] for name, part in _tracks(scene).items()}
    axes = draw_tracks(tmp_path / "tracks.png", None, scene, positions)
    assert axes.get_legend().get_title().get_text() == f"of the feed ({FOREMOST} of {count} fractions)"
    assert axes.get_position().width > 0.2
    for name in ("landing", "tracks"):
        with Image.open(tmp_path / f"{name}.png") as picture:
            assert picture.size[1] < 6000
    assert foremost(scene, shown[:3]) == shown[:3]


def test_a_page_holds_so_many_tracks_of_all_fractions(rhombus: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = _outcome(rhombus)
    for most, each in ((1024, 2), (3, 1)):
        monkeypatch.setattr(live, "TRACKS", most)
        assert [len(row["tracks"]) for row in live.live_data(outcome)["fractions"]] == [each] * 3


def test_ink_is_in_proportion_to_mass(rhombus: Scene, drawn: list[Any]) -> None:
    path = np.array([[0.0, 0.1], [0.0, -0.1]])
    draw_tracks("unused", None, rhombus, {name: [path] * 48 for name in rhombus.fraction})
    lines = {str(line.get_label()).partition(",")[0]: line for line in drawn[0].axes[0].lines}
    ink = {name: lines[name].get_linewidth() * np.isnan(lines[name].get_xdata()).sum() for name in rhombus.fraction}
    shares = rhombus.mass_shares()
    assert {name: value / ink["wheat"] for name, value in ink.items()} == pytest.approx(
        {name: share / shares["wheat"] for name, share in shares.items()}
    )


def test_the_few_tracks_of_a_small_fraction_lie_as_all_of_them_do(rhombus: Scene, drawn: list[Any]) -> None:
    ends = np.tile([-0.1, 0.1], 24) * np.linspace(1.0, 1.2, 48)  # m: every second one on the left
    paths = [np.array([[0.0, 0.1], [x, -0.1]]) for x in ends]
    draw_tracks("unused", None, rhombus, {"wheat": paths, "dust": paths[1::2] + paths[::2]})
    lines = {str(line.get_label()).partition(",")[0]: line.get_xydata() for line in drawn[0].axes[0].lines}
    last = {name: np.sort(xy[xy[:, 1] == -100.0][:, 0]) for name, xy in lines.items() if name in rhombus.fraction}
    assert len(last["wheat"]) == 48
    assert last["dust"] == pytest.approx([-115.0, -105.0, 105.0, 115.0], abs=2.0)


def test_the_cut_of_a_partition_curve_has_its_unit(rhombus: Scene) -> None:
    curves = [
        PartitionCurve(("middle",), by, unit, (at, 3 * at), (0.5, 0.5), (1.0, 0.0), (0.9, 0.0), (1.0, 0.1),
                       Number(2 * at, at, 3 * at), 0.5 * at, 0.25)
        for by, unit, at in (("size", "m", 1e-3), ("terminal velocity", "m/s", 1.0))
    ]  # fmt: skip
    panels = draw_partition(Canvas(), rhombus, curves)
    told = [axes.get_legend().get_texts()[0].get_text() for axes in panels]
    assert told == ["middle: cut 2 mm, Ep 0.5 mm, I 0.25", "middle: cut 2 m/s, Ep 0.5 m/s, I 0.25"]


def test_histograms_hold_the_mass_of_their_bins(scene: Scene, drawn: list[Any]) -> None:
    from matplotlib.patches import StepPatch

    landings = _landings(scene)
    draw_landing("unused", scene, landings, _separation(_read(_result(scene, None))))
    panels = np.array(drawn[0].axes).reshape(len(landings), -1)
    for row, found in zip(panels, landings.values(), strict=True):
        steps = [patch for axes in row for patch in axes.patches if isinstance(patch, StepPatch)]
        mass = 0.0
        for patch in steps:
            height, edges, _ = patch.get_data()  # % per cm, mm
            mass += float(np.sum(height * np.diff(edges) / 10.0))
        binned = found.bin >= 0
        assert mass == pytest.approx(100.0 * found.weight[binned].sum() / found.weight.sum(), abs=1e-9)


def test_shares_in_the_landing_picture_are_the_results(rhombus: Scene, drawn: list[Any]) -> None:
    result = _result(rhombus, None)
    draw_landing("unused", rhombus, _landings(rhombus), _separation(_read(result)))
    panels = drawn[0].axes
    for axes, shares in zip(panels, result["separation"]["fractions"].values(), strict=True):
        told = {t.get_text() for t in axes.texts}
        for place, row in shares.items():
            value = percent(Number(row["value"], row["low"], row["high"])).partition(" ")[0]
            text = value if value == UNKNOWN_ERROR else f"{value} %"
            assert (f"elsewhere\n{text}" if place == "elsewhere" else text) in told


def test_a_bin_on_a_line_has_its_own_panel(rhombus: Scene, drawn: list[Any]) -> None:
    shelf = [[-0.1, -0.1], [0.0, -0.15], [0.1, -0.15]]
    scene = rhombus.replace({"bin.shelf.points": shelf})
    corner = np.array([[0.0, -0.15]])
    assert along(np.array(shelf), corner)[0][0] == pytest.approx(np.hypot(0.1, 0.05))
    assert along(np.array(shelf), corner + np.array([0.04, 0.0]))[0][0] == pytest.approx(np.hypot(0.1, 0.05) + 0.04)
    draw_landing("unused", scene, _landings(scene), _separation(_read(_result(scene, None))))
    assert {a.get_xlabel() for a in drawn[0].axes} == {"", "x on the floor (mm)", "along shelf (mm)"}
    draw_tracks("unused", None, scene, {})
    assert "shelf" in _annotations(drawn[1])


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (Number(0.621, 0.613, 0.629), "62.1 (61.3 to 62.9)"),
        (Number(0.62144, 0.62104, 0.62184), "62.14 (62.10 to 62.18)"),
        (Number(1.0, 0.99998, 1.0), "100 (99.9980 to 100)"),
        (Number(0.982, 0.951, 0.991), "98.2 (95.1 to 99.1)"),
        (Number(0.0, 0.0, 0.004), "0 (0 to 0.4)"),
        (Number(0.756, 0.637, 0.875), "76 (64 to 88)"),
        (Number(0.25, 0.25, 0.25), "25.0 (25.0 to 25.0)"),
        (Number(0.4406, 0.24, 0.73), "44 (24 to 73)"),
        (Number(0.5), "50.0"),
        (Number(math.inf), "–"),
        (None, "–"),
    ],
)
def test_digits_follow_the_interval(number: Number | None, text: str) -> None:
    assert percent(number) == text


def test_a_percentage_of_which_nothing_is_known_says_so() -> None:
    assert percent(Number(0.21, 0.0, 0.5)) == "unknown (0 to 50)"
    assert percent(Number(0.74, 0.0, 1.0)) == "unknown (0 to 100)"
    assert percent(Number(0.21, 0.1, 0.5)) == "21 (10 to 50)"
    assert percent(Number(0.21, 0.0, 0.5), void=True) == "void"
    assert part_words(Number(0.21, 0.0, 0.5)) == "an unknown part (0 to 50 %)"
    assert part_words(Number(0.21, 0.1, 0.5)) == "21 (10 to 50) %"


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(DictReader(stream))


def test_csv_columns_carry_units_and_the_numbers(scene: Scene, tmp_path: Path) -> None:
    result = _result(scene, None)
    tables.write_tables(tmp_path, _read(result))
    rows = _rows(tmp_path / "separation.csv")
    separation = result["separation"]
    assert len(rows) == len(scene.fraction) * len(separation["bins"])
    for row in rows:
        name, place = row["fraction"], row["bin"]
        share = separation["fractions"][name][place]
        assert float(row["share (%)"]) == pytest.approx(100 * share["value"])
        assert float(row["share low (%)"]) == pytest.approx(100 * share["low"])
        assert float(row["share high (%)"]) == pytest.approx(100 * share["high"])
        assert float(row["bin throughput (kg/h)"]) == separation["throughput"][place]
        assert row["target"] == ("yes" if place in scene.fraction[name].targets else "no")
        if place == separation["bins"][0]:
            assert row["purity (%)"] == ""
        else:
            assert float(row["purity (%)"]) == pytest.approx(100 * separation["purity"][place][name]["value"])


def test_the_budget_leaves_unknown_errors_empty(rhombus: Scene, tmp_path: Path) -> None:
    tables.write_tables(tmp_path, _read(_result(rhombus, None)))
    rows = _rows(tmp_path / "budget.csv")
    assert [r["source"] for r in rows[:3]] == ["sampling", "airflow-model", "total"]
    assert [r["error"] for r in rows[:3]] == ["0.0043", "", ""]
    assert [r["run time (s)"] for r in rows[:3]] == ["1.5", "0", "1.5"]
    assert "error" in rows[0]
    assert "unit of error" in rows[0]


def _printed(table: Any, width: int = 200) -> str:
    from rich.console import Console

    console = Console(width=width, record=True, file=io.StringIO())
    console.print(table)
    return console.export_text()


def test_terminal_tables_hold_the_numbers(scene: Scene) -> None:
    result = _read(_result(scene, None))
    text = _printed(separation_table(result, _separation(result)))
    for places in _separation(result).fractions.values():
        for share in places.values():
            value, interval = percent(share).split(" ", 1)  # of many fractions the one below the other
            assert value in text
            assert interval in text
    assert "11.5" in text
    budget = _printed(budget_table(result.budget))
    assert "0.43" in budget  # percentage points
    assert "unknown" in budget


def test_an_empty_budget_prints() -> None:
    assert "budget" in _printed(budget_table(()))


def test_the_page_says_what_the_result_says(scene: Scene, page: Path) -> None:
    told_page = Page(page.read_text())
    tables, separation = told_page.tables, _separation(_outcome(scene).result)
    head, *rows = tables["separation"]
    bins = head[1:-1]
    middles = {name: bin_.line(scene)[:, 0].mean() for name, bin_ in scene.bin.items()}
    assert bins == [*sorted(scene.bin, key=lambda name: middles[name]), "elsewhere"]  # from left to right
    for row, (name, places) in zip(rows, separation.fractions.items(), strict=False):
        assert row == [name, *(percent(places[b]) for b in bins), percent(separation.recovery[name])]
    assert rows[-1][1:-1] == [f"{separation.throughput[b]:.4g}" for b in bins]
    assert rows[-2][1 + bins.index(separation.bins[0])] == "–"
    told = {row[0]: row[1:3] for row in tables["recovery"][1:]}
    for name, fraction in scene.fraction.items():
        found = separation.recovery[name]
        assert told[name] == [" or ".join(fraction.targets), percent(found)]
    if scene.air is not None:
        air = {row[0]: row[1:] for row in tables["airflow"]}
        assert air[CD][0] == "1.234 (1.21 to 1.26)"
        assert air[LENGTH] == ["83", "mm"]
        assert air["suction zone, area: of both sides together"] == ["41", "cm²"]
        assert not any(name.startswith("strouhal") for name in air)
    assert tables["budget"][1][:4] == [
        f"share.{next(iter(scene.fraction))}.{separation.bins[0]}", "unknown", "–",
        "sampling 0.43, airflow-model unknown",
    ]  # fmt: skip
    assert tables["sources"][1:] == [
        ["sampling", "from this run", "1.5 s"],
        ["airflow-model", "not known", "0.0 s"],
    ]
    assert tables["left-out"][1:] == [["basset-history", "0.00031", "small"], ["brownian", "–", "all < large"]]
    assert tables["fates"][1] == [next(iter(scene.fraction)), "480", "20", "500"]
    assert [row[:2] for row in tables["seconds"][1:]] == [["mesh", "1.2 s"], ["tracks", "3.3 min"]]
    assert "the curtain is dense" in told_page.text
    assert "nan" not in told_page.text.lower().split()


def test_grids_bracket_and_momentum_model_are_shown(rhombus: Scene) -> None:
    result = _result(rhombus, {**AIRFLOW, "momentum": {"cp_front": 1.0, "cd": 1.62}})
    row = {"quantity": "cd", "cells": [4321, 1920], "values": [1.23, 1.3], "value": 1.23, "low": 1.2, "high": 1.26,
           "order": None, "kind": "two-grid", "why": "two grids", "extrapolated": None, "gci_fine": None,
           "gci_coarse": None, "asymptotic": None}  # fmt: skip
    result["airflow"]["grids"] = [row]
    result["bracket"] = {"wheat": {"middle": {"steady": 0.25, "answer": 0.125}, "elsewhere": {"steady": 0.0,
                         "answer": 0.0}}}  # fmt: skip
    found = Page(html.render(_read(result), {})).tables
    assert found["grids"][1] == ["cd", "1.23", "1.3", "1.2 to 1.26", "–", "two grids"]
    assert found["bracket"] == [["fraction", "bin", "steady", "answer"], ["wheat", "middle", "25.0", "12.5"]]
    rows = {row[0]: row[1] for row in found["airflow"]}
    assert rows["the paper's momentum model, cd: drag coefficient, with the computed base pressure"] == "1.62"


def test_a_share_in_three_dimensions_stands_beside_the_answer(rhombus: Scene) -> None:
    result = _result(rhombus, AIRFLOW)
    without = html.render(_read(result), {})
    result["three_dimensions"] = {"dust": {"middle": {"value": 0.95, "low": 0.945, "high": 0.955}}}
    said = "Three dimensions: dust in middle 95.0 (94.5 to 95.5) % (this body at this Stokes number"
    assert said in html.render(_read(result), {})
    assert said not in without
    assert said in in_three_dimensions(_read(result))


def test_a_best_estimate_stands_between_its_ends(rhombus: Scene) -> None:
    def end(cd: float, length: float) -> dict[str, Any]:
        zone = {**AIRFLOW["suction"], "length": length}
        alike = {name: AIRFLOW[name] for name in ("cl_rms", "cp_base")}
        return {"cd": {"value": cd, "low": cd - 0.01, "high": cd + 0.01}, "suction": zone, **alike}

    share = {"value": 0.5, "low": 0.35, "high": 0.7}
    strength = {"value": 0.6, "low": 0.4, "high": 0.9}
    wake = {"theta": share, "strength": strength, "why": "two measurements", "lift": strength}
    ends = {"steady": end(1.0, 0.1), "time_resolved": end(2.0, 0.3)}
    result = _result(rhombus, {**AIRFLOW, **end(1.5, 0.2), "wake": wake, "ends": ends})
    page = Page(html.render(_read(result), {}))
    assert "0.50 (0.35 to 0.70)" in page.text
    assert "two measurements" in page.text
    rows = page.tables["ends"]
    assert rows[0] == ["quantity", "steady", "best estimate", "time-resolved", "unit"]
    assert rows[1] == [CD, "1 (0.99 to 1.01)", "1.5 (1.49 to 1.51)", "2 (1.99 to 2.01)", ""]
    assert [LENGTH, "100", "200", "300", "mm"] in rows
    assert any("lift" in row[0] for row in rows)
    plain = Page(html.render(_read(_result(rhombus, AIRFLOW)), {}))
    assert "ends" not in plain.tables


def test_impacts_are_shown_and_saved(rhombus: Scene, tmp_path: Path) -> None:
    result = _result(rhombus, None)
    result["impact"] = to_json(impact_loads(rhombus, make_plan(rhombus)))
    shown = Page(html.render(_read(result), {})).tables["impact"]
    assert [row[:2] for row in shown[1:]] == [
        [name, slope] for name in (*rhombus.fraction, "all") for slope in ("left", "right")
    ]
    tables.write_tables(tmp_path, _read(result))
    rows = _rows(tmp_path / "impact.csv")
    wheat, last = result["impact"]["fractions"]["wheat"]["slopes"]["right"], rows[-1]
    assert float(rows[5]["normal force (N)"]) == pytest.approx(wheat["normal"])
    assert float(rows[5]["mass flow (kg/h)"]) == pytest.approx(3600 * wheat["mass_flow"])
    assert float(last["power (W)"]) == pytest.approx(result["impact"]["slopes"]["right"]["power"])
    assert last["fall speed (m/s)"] == ""  # each fraction has its own


def test_impaction_and_the_limits_of_the_feed_are_shown(rhombus: Scene) -> None:
    plan = make_plan(rhombus).summary()
    found = Page(html.render(_read({**_result(rhombus, None), "plan": plan}), {})).tables
    assert [row[:2] for row in found["impaction"][1:]] == [
        [name, row["mode"]] for name, row in plan["fractions"].items()
    ]
    wheat = plan["fractions"]["wheat"]["impaction"]
    assert found["impaction"][-1][4:] == [f"{wheat[key]:.3g}" for key in ("efficiency", "missed", "shift")]
    loading = {row[0]: row for row in found["validity"]}
    assert set(loading) == {"number", *(row["name"] for row in plan["validity"])}
    [mass] = [row for row in plan["validity"] if row["name"] == "mass-loading"]
    assert loading["mass-loading"][1:4] == [f"{mass['value']:.2g}", "0.1", f"{mass['feed_rate']:.3g}"]


def test_the_page_needs_no_other_file(scene: Scene, page: Path) -> None:
    text = page.read_text()
    made = Page(text).every("img", "link", "script")
    inlined = list(filter(None, (given.get("src") or given.get("href") for given in made)))
    names = ["sketch", "landing", "pressure", "vorticity", "tracks", "residence"]  # the first two beside the answer
    shown = names if scene.air else [name for name in names if name in ("sketch", "tracks", "landing")]
    for source, name in zip(inlined, shown, strict=True):
        prefix, data = source.split(",")
        kind, suffix = ("svg+xml", "svg") if name in FRONT else ("png", "png")
        assert prefix == f"data:image/{kind};base64"
        assert base64.b64decode(data) == (page.parent / "figures" / f"{name}.{suffix}").read_bytes()
    assert "http" not in text


def test_words_cannot_break_the_page(rhombus: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = _outcome(rhombus)
    result = replace(outcome.result, warnings=("<script>x",), grades=("less sure",))
    hurtful = {**live_data(outcome), "extra": "</script>"}
    monkeypatch.setattr(live, "live_data", lambda _: hurtful)
    text = html.render(result, {}, parts=[live.watch_part(Path(), outcome)])
    assert "<script>x" not in text
    assert "&lt;script&gt;x" in text
    assert "\\u003c/script>" in text
    assert text.count("</script>") == 2  # the page's own


def test_a_missing_key_is_an_error_and_not_a_blank(rhombus: Scene) -> None:
    from jinja2 import UndefinedError

    table = _result(rhombus, None)
    result = _read(table)
    object.__delattr__(result, "seconds")
    with pytest.raises(UndefinedError, match="seconds"):
        html.render(result, {})
    del table["warnings"]
    with pytest.raises(SceneError, match=r"run/result\.json: warnings: is missing"):
        _read(table)


UNTIL_AIRFLOW = ("separation", "bracket", "budget", "fates", "met_by_law", "impact")  # not there yet


def test_a_run_without_separation_still_has_a_page(rhombus: Scene) -> None:
    result = {k: v for k, v in _result(rhombus, AIRFLOW).items() if k not in UNTIL_AIRFLOW}
    page = Page(html.render(_read(result), {}))
    assert set(page.tables) == {
        "airflow", "left-out", "machine-table", "materials", "origin", "proofs", "seconds",
    }  # fmt: skip


def test_the_report_loads_nothing_heavy() -> None:
    from wakeflow.core.process import capture

    code = "import sys, wakeflow.show, wakeflow.show.words, wakeflow.show.figures, wakeflow.show.vtk;" + (
        "print(sorted({'pyvista', 'vtk', 'matplotlib', 'jinja2', 'scipy'} & set(sys.modules)))"
    )
    assert capture([sys.executable, "-c", code]) == (0, "[]\n")
