"""Figures of the solved air and of what it does: the mesh, recorded forces, residence times, what knowing them took."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import field_of
from wakeflow.answer.shares import BudgetPart, BudgetRow, BudgetTotal
from wakeflow.core.record import from_json
from wakeflow.pipeline.airflow import Airflow
from wakeflow.report.air import _levels_of_bodies, suction_nodes
from wakeflow.report.canvas import new_figure, pdf_too, save
from wakeflow.report.figures import budget, solver
from wakeflow.report.figures.budget import draw_cost
from wakeflow.report.figures.flights import times_in_zone
from wakeflow.report.figures.solver import draw_forces, draw_mesh
from wakeflow.report.solved_case import ForceHistory, PlaneCells
from wakeflow.scene import Scene

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
    tracks = [{"time": time, "position": position} for position in (down, above)]
    found = times_in_zone(mean, cp, cp < -0.5, tracks)
    assert found == pytest.approx([0.4 / SPEED, 0.0], abs=2e-3)
    assert times_in_zone(mean, cp, np.zeros(len(cp), dtype=bool), tracks) == pytest.approx([0.0, 0.0])


def test_the_suction_zone_begins_at_the_bodys_widest_place_and_touches_it(rhombus: Scene) -> None:
    from wakeflow.field import FlowField

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
