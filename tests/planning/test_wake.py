"""The wake that a scene is flown in and its airflow: which shape, which rung, and what the plan says."""

from pathlib import Path
from typing import Any

import pytest

from wakeflow.budget.inputs import DRAWN
from wakeflow.budget.source import budget_sources
from wakeflow.core.errors import SceneError
from wakeflow.laws.best_estimate import best_estimate
from wakeflow.planning.airflow import FLAT_BELOW, LAMINAR_BELOW, SHEDDING_ABOVE, choose_airflow
from wakeflow.planning.cost import EACH_STAGE, airflow_cost, flown_again
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import COMPARED, DRAWS, REPLICATES
from wakeflow.planning.stages import Workload
from wakeflow.planning.wake import Wake, family_of, wake_of, wakes_beside
from wakeflow.scene import Scene

OFF = {"basset-history": False}
PRISM = {"shape": "prism", "width": 0.05, "slope_angle": "60 deg"}


def with_body(scene: Scene, **body: Any) -> Scene:
    tables = scene.tables()
    return Scene.parse({**tables, "body": {"one": body}})


def box(width: float, height: float) -> dict[str, Any]:
    x, y = width / 2, height / 2
    return {"shape": "polygon", "points": [[-x, -y], [x, -y], [x, y], [-x, y]]}


@pytest.mark.parametrize(
    ("body", "direction", "family"),
    [
        ({"shape": "rhombus", "width": 0.05, "slope_angle": "45 deg"}, "down", "rhombus"),
        ({**PRISM, "apex": "up"}, "down", "triangle-up"),
        ({**PRISM, "apex": "up"}, "up", "triangle-down"),
        ({**PRISM, "apex": "down"}, "down", "triangle-down"),
        ({**PRISM, "apex": "down"}, "up", "triangle-up"),
        (box(0.05, 0.05), "down", "square"),
        (box(0.05, 0.005), "down", "plate"),
        (box(0.05, 0.1), "down", None),
        ({"shape": "circle", "width": 0.05}, "down", None),
        ({**PRISM, "rounding": 0.004}, "down", None),
    ],
)
def test_the_shape_that_meets_the_air(rhombus: Scene, body: dict[str, Any], direction: str, family: str | None) -> None:
    scene = with_body(rhombus, **body).replace({"air.direction": direction})
    assert family_of(scene).name == family


def test_slopes_are_from_the_horizontal(rhombus: Scene) -> None:
    assert family_of(rhombus).slope == pytest.approx(45.0)
    assert family_of(with_body(rhombus, **PRISM)).slope == pytest.approx(60.0)
    flat = with_body(rhombus, shape="rhombus", width=0.05, slope_angle="20 deg")
    assert "no measurement of the shape (rhombus)" in wake_of(flat, 1.6e4).why


def test_several_bodies_have_the_widest_range(cases: Path, rhombus: Scene) -> None:
    scene = Scene.load(cases / "labyrinth.toml")
    assert family_of(scene).name is None
    found, alone = wake_of(scene, 2e4), wake_of(rhombus, 2e4)
    assert "several bodies" in found.why
    assert found.theta.high - found.theta.low > alone.theta.high - alone.theta.low


def at(scene: Scene, reynolds: float) -> Scene:
    assert scene.reynolds is not None
    return scene.replace({"air.speed": scene.air.speed * reynolds / scene.reynolds})


def test_the_plan_carries_it_and_says_it_in_a_line(rhombus: Scene) -> None:
    plan = make_plan(rhombus, force=OFF)
    assert plan.airflow.wake == best_estimate("rhombus", 0.125, rhombus.reynolds or 0.0, slope=45.0)
    assert plan.airflow.kind == "best-estimate"
    theta = plan.airflow.wake.theta
    (line,) = [line for line in plan.used if line.startswith("wake: ")]
    assert f"theta {theta.low:.2f} to {theta.high:.2f}" in line
    assert "measurements of the shape (rhombus)" in line
    (warning,) = [line for line in plan.warnings if line.startswith("standard airflow: ")]
    assert "best estimate between two wakes" in warning
    assert plan.summary()["airflow"]["wake"]["theta"] == {"value": theta.value, "low": theta.low, "high": theta.high}
    computed = plan.as_computed()
    assert (computed.airflow.kind, computed.airflow.wake, computed.airflow.brackets) == ("time-resolved", None, True)


@pytest.mark.parametrize(
    ("reynolds", "rung", "kind", "beside"),
    [
        (0.9 * FLAT_BELOW, "auto", "time-resolved", 0),
        (1.1 * FLAT_BELOW, "auto", "time-resolved", 3),  # laminar: nothing of the estimate is used
        (0.9 * LAMINAR_BELOW, "standard", "time-resolved", 3),
        (1.1 * LAMINAR_BELOW, "standard", "best-estimate", 2),
        (16_500.0, "reference", "best-estimate", 2),
        (16_500.0, "draft", "steady", 0),
    ],
)
def test_only_a_turbulent_wake_in_time_is_estimated(
    rhombus: Scene, reynolds: float, rung: str, kind: str, beside: int
) -> None:
    found = choose_airflow(at(rhombus, reynolds), rung, 0.01)
    assert found.kind == kind
    assert (found.wake is not None) == (kind == "best-estimate")
    assert len(found.wakes_beside) == beside
    work = Workload(rhombus, found, None, 1, 1.0)
    again = {name: list(budget_sources[name].costs(work)) for name in budget_sources}
    assert [cost.key.name for cost in again["inputs"]] == ["draws"]
    assert len(again["airflow-model"]) == beside
    assert [cost.key.label.grid for cost in again["mesh"]] == list(found.scales[1:])
    once = flown_again(work, "once", 1.0).seconds - EACH_STAGE
    (draws,) = again["inputs"]  # as many granules as the answer
    assert draws.seconds == pytest.approx(EACH_STAGE + DRAWS * DRAWN + once * REPLICATES / COMPARED)


def test_the_other_wakes_are_the_ends() -> None:
    estimate = best_estimate("rhombus", 0.125, 1.65e4)
    assert wakes_beside(True, estimate) == {Wake.STEADY: (0.0, 0.0), Wake.TIME_RESOLVED: (1.0, 1.0)}
    assert list(wakes_beside(True, None)) == [Wake.STEADY, Wake.MEAN, Wake.HALF]
    assert wakes_beside(False, None) == {}


@pytest.mark.parametrize(
    ("reynolds", "target", "rung", "stepping", "turbulence", "brackets"),
    [
        (0.9 * SHEDDING_ABOVE, 0.01, "draft", "steady", "laminar", False),
        (0.9 * SHEDDING_ABOVE, 0.002, "reference", "steady", "laminar", False),
        (0.9 * FLAT_BELOW, 0.01, "standard", "time-resolved", "laminar", False),
        (0.9 * FLAT_BELOW, 0.002, "reference", "time-resolved", "laminar", False),
        (1.1 * FLAT_BELOW, 0.01, "standard", "time-resolved", "laminar", True),
        (1.1 * LAMINAR_BELOW, 0.01, "standard", "time-resolved", "kOmegaSST", True),
        (16_500.0, 0.002, "standard", "time-resolved", "kOmegaSST", True),
    ],
)
def test_auto_goes_by_reynolds_number_and_accuracy(
    rhombus: Scene, reynolds: float, target: float, rung: str, stepping: str, turbulence: str, brackets: bool
) -> None:
    found = choose_airflow(at(rhombus, reynolds), "auto", target)
    assert (found.rung, found.stepping, found.turbulence, found.brackets) == (rung, stepping, turbulence, brackets)
    assert found.half == (stepping == "steady")
    assert len(found.scales) == (3 if rung == "reference" else 2)
    assert f"Re {reynolds:.3g}" in found.why


def test_half_of_the_channel_only_where_it_is_its_own_mirror_image(rhombus: Scene) -> None:
    aside = rhombus.replace({"body.rhombus.at": [0.01, 0.0]})
    for scene, symmetric in ((rhombus, True), (aside, False)):
        assert choose_airflow(scene, "draft", 0.01).half == symmetric
        assert not choose_airflow(scene, "standard", 0.01).half


def test_the_plan_says_why_and_what_it_computes_beside(rhombus: Scene) -> None:
    lines = "\n".join(make_plan(rhombus, force=OFF).used)
    assert "rung standard, time-resolved, kOmegaSST" in lines
    assert "between the steady and the time-resolved wake" in lines
    assert f"1 in {REPLICATES // COMPARED} granules" in lines
    lines = "\n".join(make_plan(at(rhombus, 100.0), rung="reference", force=OFF).used)
    assert "cell edges of 0.67, 1, 1.5 times the usual" in lines
    assert "1 in 4 granules" not in lines


def test_a_finer_rung_is_expected_to_cost_more(rhombus: Scene) -> None:
    spent = [
        airflow_cost(rhombus, choose_airflow(rhombus, rung, 0.01)).seconds
        for rung in ("draft", "standard", "reference")
    ]
    assert spent[0] < spent[1] < spent[2]


@pytest.mark.parametrize(
    ("name", "rung", "words"),
    [("vacuum", "draft", "needs an"), ("aspirator", "none", "body"), ("rhombus", "drft", "draft")],
)
def test_a_rung_that_cannot_be_is_refused(cases: Path, name: str, rung: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        choose_airflow(Scene.load(cases / f"{name}.toml"), rung, 0.01)
