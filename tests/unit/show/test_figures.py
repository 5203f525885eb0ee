"""Figures: the sketch of a machine, colours that are seen apart, the solved air and what knowing it took."""

import csv
import itertools
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from support import CASES, field_of, shipped
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.answer.shares import BudgetPart, BudgetRow, BudgetTotal
from wakeflow.core.record import from_json
from wakeflow.flight.stages.solved_case import ForceHistory, PlaneCells
from wakeflow.laws.material import materials
from wakeflow.scene import Scene, units_written
from wakeflow.show.air_pictures import _levels_of_bodies, suction_nodes
from wakeflow.show.canvas import COLOURS, KNOWN, fraction_colours, new_figure, pdf_too, save
from wakeflow.show.figures import budget_figures as budget
from wakeflow.show.figures import solver_figures as solver
from wakeflow.show.figures.budget_figures import draw_cost
from wakeflow.show.figures.flights import times_in_zone
from wakeflow.show.figures.solver_figures import draw_forces, draw_mesh
from wakeflow.show.many_figures import _looks
from wakeflow.show.sketch import draw_sketch

FILES = [*CASES.glob("*.toml"), *CASES.glob("paper/*.toml")]
MACHINES = sorted(path for path in FILES if path.stem.partition("-")[0] not in ("sweep", "search"))


def _texts(figure: Figure) -> list[Annotation]:
    return [one for one in figure.axes[0].texts if isinstance(one, Annotation) and one.get_text()]


def _extents(figure: Figure) -> list[tuple[str, Bbox]]:
    """What is written on the paper, and where (pixels), without the arrows that lead from it."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()
    return [(one.get_text(), super(Annotation, one).get_window_extent(canvas.get_renderer())) for one in _texts(figure)]


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_all_is_written_on_the_paper_and_nothing_on_another(path: Path) -> None:
    scene = Scene.load(path)
    figure = draw_sketch(scene)
    written = _extents(figure)
    names = " ".join(text for text, _ in written)
    assert not [name for name in (*scene.body, *scene.bin, *scene.channel.inlet) if name not in names]
    paper = figure.bbox
    assert not [text for text, box in written if not (paper.contains(*box.min) and paper.contains(*box.max))]
    assert not [(one, other) for (one, a), (other, b) in combinations(written, 2) if a.overlaps(b)]


def test_measures_are_the_scenes() -> None:
    written = {one.get_text() for one in _texts(draw_sketch(shipped("rhombus")))}
    assert {"400 mm", "-135", "135", "-200", "air 5 m/s down", "inner-left"} <= written
    assert "feed: 40 mm wide, falls 100 mm\n500 kg/h over a depth of 300 mm" in written
    assert "rhombus: 50 mm x 50 mm, 45 deg\nvibrates at 30 Hz, ± 0.552 mm (2 g)" in written


def test_measures_are_said_in_the_users_units(tmp_path: Path) -> None:
    machine = tmp_path / "machine.toml"
    text = (CASES / "aspirator.toml").read_text().replace("100 mm", "10 cm").replace("200 mm", "20 cm")
    machine.write_text(text.replace("400 mm", "40 cm").replace('"6 m/s"', '"21.6 km/h"'))
    spoken = units_written(machine)
    assert spoken["m"] == "cm"
    written = {one.get_text() for one in _texts(draw_sketch(Scene.load(machine), spoken))}
    assert {"20 cm", "100 cm", "-10", "10"} <= written


def test_a_resting_feed_and_a_side_bin_are_told() -> None:
    tables = shipped("vacuum").tables()
    tables["feed"] = {"start": "resting", "width": 0.02, "count": 32}
    tables["bin"]["wall"] = {"on": "left", "from": -0.1, "to": 0.0}
    written = " ".join(one.get_text() for one in _texts(draw_sketch(Scene.parse(tables))))
    assert "at rest on the body" in written
    assert "bin wall: y -100 mm to 0 mm" in written


VISIONS = ("normal", "protanomaly", "deuteranomaly", "tritanomaly")
SHIPPED = ("rhombus", "prism", "labyrinth", "aspirator")
APART, SHIPPED_APART = 9.0, 14.0  # CAM02-UCS (Luo, Cui & Li 2006): 1 is just seen; side by side 10 are another colour


def _difference(one: str, other: str, vision: str) -> float:
    """Of two colours as they are seen with a lack of one kind of cone (Machado, Oliveira & Fernandes 2009)."""
    from colorspacious import cspace_convert, deltaE

    seen = [np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255 for colour in (one, other)]
    if vision != "normal":
        space = {"name": "sRGB1+CVD", "cvd_type": vision, "severity": 100}
        seen = [np.clip(cspace_convert(colour, space, "sRGB1"), 0.0, 1.0) for colour in seen]
    return float(deltaE(*seen, input_space="sRGB1"))


@pytest.mark.parametrize("vision", VISIONS)
def test_any_two_colours_are_seen_apart(vision: str) -> None:
    assert min(_difference(one, other, vision) for one, other in itertools.combinations(COLOURS, 2)) > APART


@pytest.mark.parametrize("name", SHIPPED)
def test_the_fractions_of_shipped_scenes_are_far_apart(name: str, cases: Path) -> None:
    colours = fraction_colours(list(Scene.load(cases / f"{name}.toml").fraction)).values()
    pairs = itertools.combinations(colours, 2)
    assert min(_difference(one, other, vision) for one, other in pairs for vision in VISIONS) > SHIPPED_APART


def test_a_fraction_keeps_its_colour_whatever_is_fed_with_it() -> None:
    for name in materials:
        alone = fraction_colours([name])[name]
        assert fraction_colours(["weed", name, "grit"])[name] == alone or name not in KNOWN
    assert fraction_colours(["weed"])["weed"] == fraction_colours(["wheat", "weed"])["weed"]


def test_up_to_nine_fractions_have_nine_colours() -> None:
    names = [f"sieve-{i}" for i in range(len(COLOURS) - 1)]
    found = fraction_colours(["wheat", *names])
    assert list(found) == ["wheat", *names]  # in the order asked for
    assert len(set(found.values())) == len(COLOURS)
    assert set(fraction_colours([f"f{i}" for i in range(20)]).values()) == set(COLOURS)


def test_figures_of_many_runs_colour_quantities_by_their_fraction() -> None:
    recoveries = ["recovery.straw", "recovery.wheat", "recovery.own"]
    colours = fraction_colours(["straw", "wheat", "own"]).values()
    assert [look.colour for look in _looks(recoveries).values()] == list(colours)
    assert _looks(["purity.left.chaff"])["purity.left.chaff"].colour == KNOWN["chaff"]
    left, right, chaff = _looks(["share.wheat.left", "share.wheat.right", "share.chaff.left"]).values()
    assert left.colour == right.colour != chaff.colour
    assert left.marker != right.marker


SPEED = 2.0  # m/s of the tracks below


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures as they are about to be saved, each with its data."""
    kept: list[Any] = []
    for module in (budget, solver):
        monkeypatch.setattr(module, "save", lambda figure, path, data=None: kept.append((figure, data)))
    return kept


def test_the_time_in_the_zone_is_that_between_its_borders() -> None:
    """Cp = y: the zone is y < -0.5, which tracks at constant speed cross down to y = -0.9; one stays above."""
    mean = field_of(lambda points: np.zeros((len(points), 2)), n=12)
    cp = mean.points[:, 1]
    time = np.linspace(3.0, 3.0 + 1.8 / SPEED, 2001)
    down = np.stack([np.full_like(time, 0.1), 0.9 - SPEED * (time - 3.0)], axis=1)
    above = np.abs(down)
    own = {"diameter": np.array(1e-3)}
    tracks = []
    for position in (down, above):
        pace = np.gradient(position, time, axis=0)
        tracks.append({"time": time, "position": position, "velocity": pace, "arriving": pace, **own})
    found = times_in_zone(mean, cp, cp < -0.5, tracks, 1e-3)
    assert found == pytest.approx([0.4 / SPEED, 0.0], abs=2e-3)
    assert times_in_zone(mean, cp, np.zeros(len(cp), dtype=bool), tracks, 1e-3) == pytest.approx([0.0, 0.0])


def test_the_suction_zone_begins_at_the_bodys_widest_place_and_touches_it(rhombus: Scene) -> None:
    from wakeflow.air.field import FlowField

    outline = next(iter(rhombus.body.values())).outline()
    x, y = np.linspace(-0.2, 0.2, 81), np.linspace(-0.2, 0.2, 81)  # m, with nodes on the corners
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    corner = (np.arange(80)[:, None] * 81 + np.arange(80)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, 1, 82], corner[:, None] + [0, 82, 81]])
    field = FlowField.from_arrays(points, triangles, np.zeros_like(points))
    near = np.hypot(points[:, 0], points[:, 1]) < 0.06  # round the body, ahead of it too
    apart = np.hypot(points[:, 0], points[:, 1] + 0.16) < 0.02
    found = suction_nodes(field, np.where(near | apart, -1.0, 0.0), rhombus)
    widest = outline[np.argmax(outline[:, 0]), 1]
    assert found[near & (points[:, 1] < widest - 1e-3)].all()
    assert not found[points[:, 1] > widest + 1e-3].any()
    assert not found[apart].any()


def test_each_body_has_its_own_line_of_the_stream_function() -> None:
    psi = np.array([0.201, 0.0, 0.2, 0.001, 0.002, 0.199])  # m2/s: two bodies, constant on each but for rounding
    assert _levels_of_bodies(psi, step=0.05) == pytest.approx([0.001, 0.2])
    assert _levels_of_bodies(psi, step=1.0) == pytest.approx([0.1005])


def test_forces_tell_what_was_dropped_and_kept(drawn: list[Any]) -> None:
    time = np.linspace(0.0, 4.0, 401)
    lift, drag = np.sin(2 * np.pi * time), np.where(time < 1.0, 9.0, 2.0)
    draw_forces(Path("unused"), ForceHistory(time, drag, lift, True, 1.0, (2.0, 3.0)))
    (figure, data) = drawn[0]
    told = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert told == ["dropped: start-up", "kept as a loop", "mean of what is averaged"]
    means = [axes.lines[1].get_ydata()[0] for axes in figure.axes]
    assert means == pytest.approx([0.0, 2.0], abs=1e-9)
    assert figure.axes[1].get_ylim()[1] < 9.0  # what was dropped does not squeeze the rest
    assert data["drag coefficient"] is drag
    draw_forces(Path("unused"), ForceHistory(np.arange(300.0), np.full(300, 1.5), np.zeros(300), False, None, None))
    steady = drawn[1][0]
    assert steady.axes[0].get_legend() is None
    assert steady.axes[1].get_xlabel() == "iteration"


def test_forces_that_settled_look_settled(drawn: list[Any]) -> None:
    steps = np.arange(300.0)
    draw_forces(Path("unused"), ForceHistory(steps, 1.5 + 1e-4 * (-1.0) ** steps, 0.0 * steps, False, None, None))
    lift, drag = (np.ptp(axes.get_ylim()) for axes in drawn[0][0].axes)
    assert lift == pytest.approx(0.01)
    assert drag == pytest.approx(0.03)  # 2 % of 1.5: what oscillates by 2e-4 is a line
    draw_forces(Path("unused"), ForceHistory(steps, 1.5 + np.sin(steps), np.sin(steps), False, None, None))
    assert all(2.4 < np.ptp(axes.get_ylim()) < 2.6 for axes in drawn[1][0].axes)


def test_the_mesh_shows_the_cells_in_its_windows(rhombus: Scene, drawn: list[Any]) -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    places = [(0.026, 0.0), (0.1, 0.05), (0.19, -0.9)]  # m: at the body, in the window, below the channel
    points = np.concatenate([np.array(place) + 0.004 * square for place in places])
    cells = PlaneCells(points, [np.arange(4 * i, 4 * i + 4) for i in range(3)])
    draw_mesh(Path("unused"), cells, rhombus, from_json(Airflow, {"rung": "draft"}))
    figure, data = drawn[0]
    assert [len(axes.collections[0].get_paths()) for axes in figure.axes] == [2, 1]
    assert "3 cells" in figure.axes[0].get_title(loc="left")
    assert np.split(data["cell corners"], data["cell ends"][:-1])[1].tolist() == [4, 5, 6, 7]


def _row(quantity: str, unit: str | None, **errors: float) -> BudgetRow:
    seconds = {"sampling": 12.0, "mesh": 90.0}
    parts = tuple(BudgetPart(name, error, seconds.get(name, 0.0), "measured") for name, error in errors.items())
    return BudgetRow(quantity, unit, parts, BudgetTotal(None, 0.0))


def test_costs_stand_beside_errors(drawn: list[Any]) -> None:
    rows = [
        _row("share.dust.near", None, sampling=0.01, mesh=0.03, brownian=0.0),
        _row("share.dust.far", None, sampling=0.02, mesh=0.01, brownian=0.0),
        _row("landing.dust", "body widths", sampling=7.0, mesh=8.0),
    ]
    draw_cost(Path("unused"), rows)
    data = drawn[0][1]
    assert data["source"] == ["mesh", "sampling"]
    assert data["largest error of a share (points)"] == pytest.approx([3.0, 2.0])
    assert data["median error of a share (points)"] == pytest.approx([2.0, 1.5])
    assert data["run time (s)"] == [90.0, 12.0]


def test_a_figure_is_a_pdf_where_one_is_asked_for(tmp_path: Path) -> None:
    from pypdf import PdfReader

    figure = new_figure(3.0, 2.0)
    figure.add_subplot(xlabel="time (ms)").plot([0.0, 1.0], [0.0, 1.0])
    save(figure, tmp_path / "plain.png", {"time (s)": np.array([0.0, 1e-3])})
    with pdf_too():
        save(figure, tmp_path / "printed.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "plain.csv", "plain.png", "plain.svg", "printed.pdf", "printed.png", "printed.svg",
    ]  # fmt: skip
    assert "time (ms)" in PdfReader(tmp_path / "printed.pdf").pages[0].extract_text()
    with (tmp_path / "plain.csv").open() as stream:
        assert next(csv.reader(stream)) == ["time (s)"]
