"""The airflow beside published values: the table of values, the arithmetic of the comparison, one study run through."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

from proofs import commands
from proofs.airflow import airflow, measured
from proofs.airflow.measured import DustyWake, SolvedAirflow, core_seconds, estimate_without, quantities
from proofs.airflow.published import Case, Published, cases, read_cases, verification_scenes
from proofs.report import Row, Table
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.cli import main
from wakeflow.core.errors import FoamError, SceneError
from wakeflow.core.record import from_json
from wakeflow.laws.best_estimate import best_estimate
from wakeflow.laws.best_estimate import wakes as wakes_data
from wakeflow.laws.momentum import momentum_pressure
from wakeflow.laws.shape import shapes
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

VALUE = {"quantity": "cd", "value": 2.0, "source": "somebody 1999", "status": "quoted", "reported": "as an example"}


# -- published values and their scenes ---------------------------------------------------------------------------------


def test_every_case_has_its_scene_and_every_scene_its_case() -> None:
    assert set(cases()) == set(verification_scenes())


@pytest.mark.parametrize("name", cases())
def test_scenes_are_what_their_titles_say(name: str) -> None:
    case, scene = cases()[name], Scene.load(verification_scenes()[name])
    said = float(case.title.rsplit("Re ", 1)[1].replace(" ", ""))
    assert scene.reynolds == pytest.approx(said, rel=0.01)
    assert make_plan(scene).rung in (("3d",) if case.alone else ("draft", "standard"))
    if case.beside is not None:
        assert make_plan(scene, rung=case.beside).rung != make_plan(scene).rung


@pytest.mark.parametrize("name", cases())
def test_every_value_has_a_gate_or_the_reason_why_not_and_unread_numbers_are_no_gate(name: str) -> None:
    for value in cases()[name].values:
        assert (value.within is None) == bool(value.reported), value
        assert value.within is None or value.status != "unchecked", value


def test_channels_are_blocked_as_much_as_said() -> None:
    blocked = {name: scene.width / scene.channel.width for name, scene in _scenes().items()}
    assert blocked["dfg-2d1"] == blocked["dfg-2d2"] == pytest.approx(0.1 / 0.41)
    assert blocked["volvo"] == pytest.approx(1 / 3)
    assert [blocked[f"square-channel-{re}"] for re in (20, 40, 100)] == pytest.approx([1 / 8] * 3)
    assert blocked["square-100"] == blocked["triangle-100"] == blocked["plate"] == pytest.approx(0.05)
    off_axis = _scenes()["dfg-2d1"].body["cylinder"].at[0] / _scenes()["dfg-2d1"].width
    assert abs(off_axis) == pytest.approx(0.005 / 0.1)


def _scenes() -> dict[str, Scene]:
    return {name: Scene.load(path) for name, path in verification_scenes().items()}


def test_drags_without_walls_are_brought_to_the_blockage_of_the_scene() -> None:
    """Maskell: Cd = Cd_c / (1 - Cd_c B / -Cp_base). A square on its edge, 1.6 and -1.45 to -1.2, 5 % blocked."""
    known = read_cases({"some": {"title": "T", "value": [{**VALUE, "value": 1.6, "base": [-1.45, -1.2]}, VALUE]}})[
        "some"
    ]
    drag, other = known.between_walls(0.05).values
    assert (drag.low, drag.high) == pytest.approx((1.6 / (1 - 0.08 / 1.45), 1.6 / (1 - 0.08 / 1.2)))
    assert "1.6 without walls, here at 5 % blockage by Maskell's rule" in drag.source
    assert drag.between_walls(0.05) == drag
    assert (other.low, other.high, other.source) == (2.0, 2.0, "somebody 1999")
    free = [(n, v) for n, case in cases().items() for v in case.values if v.base is not None]
    assert {name for name, _ in free} == {"triangle-up-high", "triangle-down-high", "diamond-high", "plate"}


@pytest.mark.parametrize("half", [False, True])
def test_lines_of_the_wake_are_read_where_they_say(half: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Downward air u / U = 1 + s/10 - x^2 in widths, s behind the rear at y = -1 m; the body is 2 m wide, U 3 m/s."""
    x, y = np.meshgrid(np.linspace(0 if half else -3, 3, 61), np.linspace(2, -22, 121))
    points = np.column_stack([x.ravel(), y.ravel()])
    s, beside = (-1 - points[:, 1]) / 2, points[:, 0] / 2
    velocity = np.column_stack([np.zeros(len(points)), -3 * (1 + s / 10 - beside**2)])
    field = FlowField.from_arrays(points, Delaunay(points).simplices, velocity, density=1.2, viscosity=1.8e-5)
    given = {"basePoint": "(0 -1 0.1)", "flowDirection": "(0 -1 0)", "inletSpeed": "3", "bodyWidth": "2"}
    monkeypatch.setattr(measured, "read_parameters", lambda _: given)
    monkeypatch.setattr(FlowField, "from_openfoam", lambda *_: field)
    solved = SolvedAirflow(None, tmp_path, 2.0)  # type: ignore[arg-type]

    def value(name: str) -> float:
        number = quantities[name].of(solved)
        assert number is not None
        return number.value

    assert value("axis_0.95") == pytest.approx(1.095)
    assert value("axis_9.4") == pytest.approx(1.94)
    assert value("beside_3.75") == pytest.approx(1.375, abs=0.02)  # on the axis: it is the largest there
    assert measured.mean_axial(tmp_path, np.array([2.0, 2.0]), np.array([0.5, -0.5])) == pytest.approx(0.95, abs=0.02)
    assert (value("axis_least"), value("axis_least_at")) == pytest.approx((1.001, 0.01))
    assert np.isnan(measured.mean_axial(tmp_path, np.array([40.0]), np.zeros(1))).all()


def test_the_rms_of_a_wake_is_what_moves_and_what_is_modelled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Air of 3 m/s that swings by 0.6 along and 2.1 (1 - s/10) across, k 0.06 m2/s2, s widths behind a body 2 m wide at
    y = -1 m; steady, the k alone.
    """
    x, y = np.meshgrid(np.linspace(-3, 3, 7), np.linspace(2, -22, 25))
    points, phase = np.column_stack([x.ravel(), y.ravel()]), 2 * np.pi * np.arange(16)[:, None] / 16
    moving = np.stack(
        np.broadcast_arrays(2.1 * (1 - (-1 - points[:, 1]) / 20) * np.sin(phase), 0.6 * np.cos(phase)), -1
    )
    k = np.full(len(points), 0.06)
    arrays = points, Delaunay(points).simplices
    still = FlowField.from_arrays(*arrays, np.tile([0.0, -3.0], (len(points), 1)), k=k, dissipation=k)
    swings = FlowField.from_arrays(
        *arrays, moving + np.array([0.0, -3.0]), k=np.tile(k, (16, 1)), dissipation=np.tile(k, (16, 1)),
        times=np.arange(16) / 16, period=1.0,
    )  # fmt: skip
    given = {"basePoint": "(0 -1 0.1)", "flowDirection": "(0 -1 0)", "inletSpeed": "3", "bodyWidth": "2"}
    monkeypatch.setattr(measured, "read_parameters", lambda _: given)
    monkeypatch.setattr(FlowField, "from_openfoam", lambda *_: still)
    body = np.array([(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)])

    def value(field: FlowField, name: str) -> float:
        air = DustyWake(lambda: Realisations(field), body, "down", 3.0)
        number = quantities[name].of(SolvedAirflow(None, tmp_path, 2.0, wake=air))  # type: ignore[arg-type]
        assert number is not None
        return number.value

    for at in (0.375, 9.4):
        across = 0.7 * (1 - at / 10) / np.sqrt(2)
        assert value(swings, f"rms_v_axis_{at}") == pytest.approx(np.hypot(across, 0.2 / 3), rel=0.02)
        assert value(swings, f"rms_u_{at}") == pytest.approx(np.sqrt(0.02 + 0.04 / 9), rel=1e-3)
        assert value(still, f"rms_v_{at}") == value(still, f"rms_u_axis_{at}") == pytest.approx(0.2 / 3)
    assert value(swings, "rms_v_most") == pytest.approx(np.hypot(0.4945, 0.2 / 3), abs=1e-3)
    assert value(swings, "rms_v_most_at") == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("value", "deviation"), [(1.8, -0.1), (2.0, 0.0), (2.1, 0.0), (2.2, 0.0), (2.31, 0.05)]
)  # fmt: skip
def test_deviation_is_from_the_nearer_end(value: float, deviation: float) -> None:
    assert Published("cd", 2.0, 2.2, "", "read").deviation(value) == pytest.approx(deviation)


def test_deviation_of_negative_numbers_has_the_sign_of_the_difference() -> None:
    assert Published("cp_base", -0.5, -0.5, "", "read").deviation(-0.6) == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"value": [{**VALUE, "status": "sure"}]}, "one of read"),
        ({"value": [{**VALUE, "quantity": "cdd"}]}, "unknown quantity"),
        ({"value": [{**VALUE, "source": ""}]}, "needs a source"),
        ({"value": [{**VALUE, "error": 0.1}]}, "unknown keys"),
        ({"value": [{k: v for k, v in VALUE.items() if k != "value"}]}, "low and high"),
        ({"quik": True}, "quik"),
        ({"title": "T", "order": {"drag": 1.5}}, "unknown quantity"),
        ({"title": "T", "closer": "cd"}, "beside"),
        ({"title": "T", "between": "cd"}, "beside"),
        ({"title": "T", "blend": "plate"}, "beside"),
        ({"title": "T", "beside": "draft", "blend": "platter"}, "one of rhombus"),
        ({"value": [{**VALUE, "reported": ""}]}, "either within or reported"),
        ({"value": [{**VALUE, "within": 0.1}]}, "either within or reported"),
        ({"value": [{**VALUE, "base": [-1.0]}]}, "two base pressure coefficients"),
        ({"value": [{**VALUE, "quantity": "strouhal", "base": [-1.2, -1.0]}]}, "of a drag"),
    ],
)
def test_mistakes_in_the_table_are_named(table: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        read_cases({"some": table})


# -- the momentum model ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [10.0, 45.0, 60.0, 80.0])
@pytest.mark.parametrize("direction", ["down", "up"])
def test_slopes_get_twice_cosine_squared(slope: float, direction: Any) -> None:
    outline = shapes["rhombus"](width=0.05, slope_angle=np.radians(slope))
    found = momentum_pressure(outline, direction)
    expected = 2 * np.cos(np.radians(slope)) ** 2
    assert found.front == pytest.approx(expected)
    assert sorted(found.cp) == pytest.approx([0, 0, expected, expected])
    outward = np.roll(outline, -1, axis=0) + outline
    assert all((outward[found.cp > 0, 1] > 0) == (direction == "down"))
    assert found.drag(-1.35) == pytest.approx(expected + 1.35)


def test_a_face_across_the_air_gets_two_and_a_circle_four_thirds() -> None:
    prism = shapes["prism"](width=0.05, slope_angle=np.radians(60))
    assert momentum_pressure(prism, "up").front == pytest.approx(2.0)
    assert momentum_pressure(prism, "down").front == pytest.approx(0.5)
    assert momentum_pressure(shapes["circle"](width=0.05, corners=400)).front == pytest.approx(4 / 3, rel=1e-4)


def test_faces_in_the_shadow_get_nothing() -> None:
    """A roof of 45 degrees whose wing sticks out flat below: the roof hides the part of the wing beneath it."""
    outline = np.array([(-2, -1), (2, -1), (2, -0.5), (0.5, -0.5), (0.5, 0), (1, 0), (0, 1), (-1, 0), (-2, 0)], float)
    found = momentum_pressure(outline, "down")
    wing = 2  # from x = 2 to 0.5: half a unit lies under the roof's eaves
    assert found.lit[wing] == pytest.approx(1.0 / 1.5)
    assert found.cp[3:5].tolist() == [0, 0]
    assert found.front == pytest.approx((2 * 1.0 + 1 * 2.0 + 2 * 1.0) / 4)


# -- costs, numbers ----------------------------------------------------------------------------------------------------


def test_core_seconds_count_every_attempt_restart_and_rank(tmp_path: Path) -> None:
    step = "Time = {}\nExecutionTime = {} s  ClockTime = 99 s\n\n"
    one = "nProcs : 1\n" + step.format(1, 2.5) + step.format(2, 4.5)
    two = "nProcs : 2\n" + step.format(3, 0.5) + step.format(4, 10)
    (tmp_path / "log.pimpleFoam").write_text(one + two)
    (tmp_path / "log.simpleFoam").write_text(one)
    (tmp_path / "log.checkMesh").write_text(one)
    (tmp_path / "failed-1.log").write_text("nProcs : 1\n" + step.format(1, 3.0))
    assert core_seconds(tmp_path) == pytest.approx(4.5 + 20 + 4.5 + 3.0)


def _reversed_over(length: float) -> dict[str, float]:
    """A suction zone with air that runs backwards over a ``length`` (m)."""
    zone = {"threshold": -0.5, "cp_min": -1.0, "length": 0.1, "width": 0.05, "area": 0.005}
    return {**zone, "reversal_length": length}


def _airflow(case: Path, **changes: Any) -> SolvedAirflow:
    table = {
        "cd": {"value": 2.0, "low": 1.9, "high": 2.1}, "cl_rms": {"value": 0.5, "low": 0.5, "high": 0.5},
        "strouhal": None, "cp_base": {"value": -1.0, "low": -1.1, "high": -0.9}, "cp_front": 1.0,
        "suction": _reversed_over(0.1), "period": None, "cells": 1000,
    }  # fmt: skip
    return SolvedAirflow(from_json(Airflow, {**table, **changes}), case, 0.05)


def test_quantities_take_numbers_with_and_without_intervals(tmp_path: Path) -> None:
    asked = ("cd", "reversal", "dp", "strouhal", "cd_max", "residence_time")
    found = {name: quantities[name].of(_airflow(tmp_path)) for name in asked}
    assert found["cd"] is not None
    assert found["cd"].half == pytest.approx(0.1)
    assert found["reversal"] is not None
    assert found["reversal"].value == pytest.approx(2.0)
    assert found["dp"] is not None
    assert (found["dp"].low, found["dp"].value, found["dp"].high) == pytest.approx((1.9, 2.0, 2.1))
    assert found["strouhal"] is None
    assert found["cd_max"] is None
    assert found["residence_time"] is None


def test_extremes_are_of_the_last_period(tmp_path: Path) -> None:
    time = np.linspace(0, 4, 401)
    rows = [f"{t} {3 + 0.1 * np.sin(4 * np.pi * t) + (t < 3) * 9} 0 {np.sin(2 * np.pi * t)}" for t in time]
    folder = tmp_path / "postProcessing" / "forceCoefficients" / "0"
    folder.mkdir(parents=True)
    (folder / "coefficient.dat").write_text("# Time Cd Cs Cl\n" + "\n".join(rows) + "\n")
    airflow = _airflow(tmp_path, period=0.99)
    found = {name: quantities[name].of(airflow) for name in ("cd_max", "cd_min", "cl_swing")}
    assert [number.value for number in found.values() if number] == pytest.approx([3.1, 2.9, 2.0], abs=1e-2)


# -- a study run through -----------------------------------------------------------------------------------------------

PRISM = """
[body.prism]
shape = "prism"
width = "10 mm"
slope_angle = "60 deg"
[channel]
width = "60 mm"
top = "30 mm"
bottom = "-80 mm"
[air]
speed = 0.0303
[feed]
speed = "1 m/s"
width = "2 mm"
[fraction.wheat]
material = "wheat"
[bin.floor]
from = "-30 mm"
to = "30 mm"
[numerics]
rung = "draft"
mesh_scale = 1.7
"""


@pytest.mark.openfoam
def test_a_scene_of_ones_own_gets_a_grid_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "own.toml"
    path.write_text(PRISM)
    whole = airflow.run_scene(path, tmp_path).write(tmp_path)
    report = whole.data()
    drag = next(row for row in report["rows"] if row["quantity"] == "mean Cd")
    assert drag["error"] != "one grid"
    assert drag["low"] <= drag["ours"] <= drag["high"]
    assert 1.5 < drag["ours"] < 3.5  # Re 20, a sixth of the channel blocked
    assert drag["core_seconds"] > 0
    assert drag["met"] is None
    assert {row["quantity"] for row in report["rows"]} >= {"mean Cd", "base Cp", "reversal length / D"}
    model = report["momentum"][0]
    assert model["cp_model"] == pytest.approx(0.5)
    assert model["cd_model"] == pytest.approx(0.5 - model["cp_base"])
    assert json.loads((tmp_path / "scene-own.json").read_text())["rows"] == report["rows"]
    assert "| own | draft | mean Cd |" in (tmp_path / "scene-own.md").read_text()
    again = airflow.run_scene(path, tmp_path)
    assert again.data()["rows"] == report["rows"]  # from the cache, cost and date of the computation included
    commands.show({"scene-own": whole})
    assert "momentum model" in capsys.readouterr().out


def test_a_case_that_fails_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []

    def compare(case: Case, scene: Scene, tell: Any) -> tuple[list[Row], Row]:
        ran.append(case.name)
        if case.name == "dfg-2d1":
            raise FoamError("the airflow diverged")
        return [], {"case": case.name, "title": case.title, "cp_model": 1.0, "cp_computed": 1.0, "cp_base": -1.0,
                    "cd_model": 2.0, "cd_computed": 2.0}  # fmt: skip

    monkeypatch.setattr(airflow, "compare_case", compare)
    with pytest.raises(FoamError, match=r"failed: dfg-2d1; the airflow diverged"):
        airflow.run_airflow(tmp_path)
    quick = [case.name for case in cases().values() if case.quick]
    assert ran == quick
    report = json.loads((tmp_path / "airflow.json").read_text())
    assert len(report["momentum"]) == len(quick) - 1
    *notes, apart, failed = report["notes"]
    assert notes == [f"{case.title}: {case.note}" for case in cases().values() if case.quick and case.note]
    assert "2.7 core-hours" in apart
    assert "not computed here" in apart
    assert "wakeflow verify cases/verify/square-3d.toml" in apart
    assert "failed: dfg-2d1" in failed
    assert failed in (tmp_path / "airflow.md").read_text()


def test_another_scene_of_a_known_name_is_not_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Case] = []
    nothing: tuple[list[Row], Row] = ([], {})

    def compare(case: Case, scene: Scene, tell: Any) -> tuple[list[Row], Row]:
        asked.append(case)
        return nothing

    monkeypatch.setattr(airflow, "compare_case", compare)
    shipped = verification_scenes()["volvo"]
    finer = tmp_path / "volvo.toml"
    finer.write_text(shipped.read_text() + "mesh_scale = 0.5\n")  # the file ends in [numerics]
    airflow.run_scene(finer, tmp_path)
    finer.write_text(PRISM)
    airflow.run_scene(finer, tmp_path)
    assert [case.values != () for case in asked] == [True, False]
    assert len(asked[1].scales) == 3


def test_scenes_without_air_are_refused(cases: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no airflow to verify"):
        airflow.run_scene(cases / "vacuum.toml", tmp_path)


def test_the_command_names_a_missing_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "nothing-there.toml"]) == 2
    assert "no scene file" in capsys.readouterr().err


def test_rows_say_how_far_and_whether_it_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rungs of one case: the own is judged, the other beside it is not; then the gates that ask for both."""
    (tmp_path / "airflow.json").write_text("{}")
    answers = {None: ("standard", 0.11), "draft": ("draft", 0.2)}

    def solve(scene: Scene, scale: float, rung: str | None, tell: Any) -> tuple[str, SolvedAirflow]:
        name, length = answers[rung]
        return name, _airflow(tmp_path, suction=_reversed_over(length))

    monkeypatch.setattr(airflow, "solve", solve)
    judged = {"quantity": "reversal", "value": 2.0, "within": 0.05, "source": "somebody 1999", "status": "quoted"}
    table = {"title": "T", "beside": "draft", "closer": "reversal", "between": "reversal"}
    case = read_cases({"some": {**table, "value": [judged, {**VALUE, "value": 2.5}]}})["some"]
    scene = Scene.parse(tomllib.loads(PRISM))
    length, drag, length_beside, drag_beside, closer, between = airflow.compare_case(case, scene)[0]
    assert (length["ours"], length["deviation"], length["met"]) == (pytest.approx(2.2), pytest.approx(0.1), False)
    assert (drag["deviation"], drag["met"], drag["why"]) == (pytest.approx(-0.2), None, "as an example")
    assert (length_beside["rung"], length_beside["met"], drag_beside["met"]) == ("draft", None, None)
    assert [row["gate"] for row in (length, drag, length_beside)] == ["5 %", "reported", "reported"]
    assert (closer["gate"], closer["met"]) == ("closer than draft", True)
    assert (between["gate"], between["met"]) == ("between draft and standard", False)  # 2.2 and 4, published 2
    answers["draft"] = ("draft", 0.099)
    closer, between = airflow.compare_case(case, scene)[0][-2:]
    assert (closer["met"], between["met"]) == (False, True)  # 2.2 and 1.98
    printed = Table("", airflow.COLUMNS, airflow.compare_case(case, scene)[0]).markdown()
    assert "| reported | – |" in printed
    assert "somebody 1999; reported: as an example" in printed


# -- dust in the near wake ---------------------------------------------------------------------------------------------


def _thinning(rate: float) -> DustyWake:
    """Air behind a plate in which dust thins out as exp(-rate t); the plate is 1 m wide, the air 1 m/s fast."""
    corners = np.array([(-4, -4), (4, -4), (4, 4), (-4, 4)], float)
    field = FlowField.from_arrays(corners, [[0, 1, 2], [0, 2, 3]], rate * corners * (-1, 1))
    plate = np.array([(-0.5, 0), (0.5, 0), (0.5, 0.01), (-0.5, 0.01)])
    return DustyWake(lambda: Realisations(field), plate, "down", 1.0)


def _same(field: FlowField | None) -> FlowField:
    assert field is not None
    return field


def _swinging(rate: float) -> DustyWake:
    """The same in time: four sheddings in which the rate swings by a tenth."""
    still, times = _thinning(rate), np.arange(8) / 8
    field = still.air().field
    assert field is not None
    speed = (1 + 0.1 * (-1.0) ** np.arange(8))[:, None, None] * field.velocity
    moving = replace(field, velocity=speed, times=times, period=1.0)
    return replace(still, air=lambda: Realisations(moving, cycles=4))


def test_a_residence_time_is_a_quantity_with_its_interval(tmp_path: Path) -> None:
    found = quantities["residence_time"].of(replace(_airflow(tmp_path), wake=_thinning(0.25)))
    assert found is not None
    assert found.low < 4.0 < found.high
    assert found.value == pytest.approx(4.0, rel=0.1)
    layers = (_thinning(rate).air().field for rate in (0.2, 0.25, 0.3))
    several = Realisations(_thinning(0.25).air().field, tuple(partial(_same, layer) for layer in layers))
    spread = quantities["residence_time"].of(
        replace(_airflow(tmp_path), wake=replace(_thinning(0.25), air=lambda: several))
    )
    assert spread is not None
    assert spread.half > found.half  # realisations differ
    still = replace(_airflow(tmp_path), wake=_thinning(0.0))
    assert quantities["residence_time"].of(still) is None  # never thins out


def test_the_blend_is_judged_by_what_knows_nothing_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ends of 8 and 2: the estimate without any residence time lies between, and its range is wider than the dust's."""
    (tmp_path / "airflow.json").write_text("{}")
    wakes = {None: ("standard", _swinging(0.5)), "draft": ("draft", _thinning(0.125))}

    def solve(scene: Scene, scale: float, rung: str | None, tell: Any) -> tuple[str, SolvedAirflow]:
        name, wake = wakes[rung]
        return name, replace(_airflow(tmp_path), wake=wake)

    monkeypatch.setattr(airflow, "solve", solve)
    published = {"quantity": "residence_time", "low": 2.5, "high": 7.0, "within": 0.0, "source": "s", "status": "read"}
    table = {"title": "T", "beside": "draft", "between": "residence_time", "blend": "plate", "value": [published]}
    scene = Scene.parse(tomllib.loads(PRISM))
    rows = airflow.compare_case(read_cases({"some": table})["some"], scene)[0]
    own, beside, _, blend = rows
    assert [row["met"] for row in rows] == [None, None, True, True]
    assert "an end of the blend" in own["why"]
    assert blend["rung"].startswith("blend 0.")
    assert blend["gate"] == "in the range"
    assert own["ours"] < blend["ours"] < beside["ours"]
    assert (blend["low"], blend["high"]) != (blend["ours"], blend["ours"])
    others = [entry for entry in wakes_data() if entry.quantity != "residence_time"]
    assert estimate_without("residence_time", "plate", 1 / 6, scene.reynolds or 0.0) == best_estimate(
        "plate", 1 / 6, scene.reynolds or 0.0, others
    )


@pytest.mark.slow
@pytest.mark.openfoam
def test_dust_stays_longer_behind_a_plate_in_the_steady_wake_than_in_the_one_that_sheds() -> None:
    """Coarse: the row of `wakeflow verify airflow --slow` on a mesh of some 800 cells."""
    scene = _scenes()["plate"].replace({"numerics.averaging": 0.2})
    ends = [airflow.solve(scene, 3.0, rung, lambda _: None)[1] for rung in ("draft", "standard")]
    steady, resolved = (quantities["residence_time"].of(end) for end in ends)
    assert steady is not None
    assert resolved is not None
    assert 1.0 < resolved.value < steady.value


# What misses today, with the cause in docs/validation.md: a miss that goes away fails the test as well
MISSES: dict[str, set[str]] = {
    "dfg-2d1": {"order of mean Cd, at least 1.5"},
    "dfg-2d2": {"largest Cd", "Cl peak to peak"},
    "square-100": {"base Cp"},
    "plate": {"residence time U / D of dust"},  # in the blend; the two ends do hold it between them
}


def judged(case: Case) -> bool:
    return any(value.within is not None for value in case.values)


@pytest.mark.openfoam
@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize(
    "name",
    [name for name, case in cases().items() if not case.alone and (case.order or case.beside or judged(case))],
)
def test_published_values_are_met(name: str, tmp_path: Path) -> None:
    rows = airflow.run_scene(verification_scenes()[name], tmp_path).data()["rows"]
    missed = {row["quantity"] for row in rows if row["met"] is False}
    assert missed == MISSES.get(name, set()), [row for row in rows if row["met"] is not None]
