"""What a plan knows of a wake from published measurements, and of granules that reach a body."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import ALONE, as_computed, shipped
from wakeflow.answer.budget.source import budget_sources
from wakeflow.core.errors import SceneError
from wakeflow.flight import Body, Fate, track
from wakeflow.flight.feed.feedstock import feedstock, granules_of
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.flight.stages.pipeline import SAMPLE_SECONDS, Pipeline
from wakeflow.laws.best_estimate import NO_ESTIMATE, best_estimate
from wakeflow.laws.impaction import Cylinder, Front, Impaction, Wedge, approach, fronts
from wakeflow.laws.material import default_margins, materials
from wakeflow.planning.airflow_choice import FLAT_BELOW, LAMINAR_BELOW, SHEDDING_ABOVE, choose_airflow
from wakeflow.planning.cost import EACH_STAGE, airflow_cost, flown_again
from wakeflow.planning.make import TURNING
from wakeflow.planning.plan import COMPARED, INPUT_SAMPLES, REPLICATES
from wakeflow.planning.stages import Workload
from wakeflow.planning.uniform_fall import Deflection, deflection
from wakeflow.planning.unknowns import SIGMAS, Unknown, unknown_kinds, unknowns, variation_at
from wakeflow.planning.wake import Wake, family_of, wake_of, wakes_beside
from wakeflow.runs.planned import make_plan
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
        (box(0.05, 0.1), "down", ""),
        ({"shape": "circle", "width": 0.05}, "down", ""),
        ({**PRISM, "rounding": 0.004}, "down", ""),
    ],
)
def test_the_shape_that_meets_the_air(rhombus: Scene, body: dict[str, Any], direction: str, family: str) -> None:
    scene = with_body(rhombus, **body).replace({"air.direction": direction})
    assert family_of(scene).name == family


def test_slopes_are_from_the_horizontal(rhombus: Scene) -> None:
    assert family_of(rhombus).slope == pytest.approx(45.0)
    assert family_of(with_body(rhombus, **PRISM)).slope == pytest.approx(60.0)
    flat = with_body(rhombus, shape="rhombus", width=0.05, slope_angle="20 deg")
    assert "no measurement of the shape (rhombus)" in wake_of(flat, 1.6e4).why


def test_several_bodies_have_the_widest_range(cases: Path, rhombus: Scene) -> None:
    scene = Scene.load(cases / "labyrinth.toml")
    assert not family_of(scene).name
    found, alone = wake_of(scene, 2e4), wake_of(rhombus, 2e4)
    assert "several bodies" in found.why
    assert found.theta.high - found.theta.low > alone.theta.high - alone.theta.low


def at(scene: Scene, reynolds: float) -> Scene:
    return scene.replace({"air.speed": scene.air.speed * reynolds / scene.reynolds})


def test_the_plan_carries_it_and_says_it_in_a_line(rhombus: Scene) -> None:
    plan = make_plan(rhombus, force=OFF)
    assert plan.airflow.wake == best_estimate("rhombus", 0.125, rhombus.reynolds or 0.0, slope=45.0)
    assert plan.airflow.kind == "best-estimate"
    theta = plan.airflow.wake.theta
    (line,) = [line for line in plan.used if line.startswith("wake: ")]
    assert f"theta {theta.low:.2f} to {theta.high:.2f}" in line
    assert "2 sources of the shape (rhombus)" in line
    (warning,) = [line for line in plan.warnings if line.startswith("standard airflow: ")]
    assert "best estimate between two wakes" in warning
    assert plan.summary()["airflow"]["wake"]["theta"] == {"value": theta.value, "low": theta.low, "high": theta.high}
    computed = as_computed(plan)
    assert (computed.airflow.kind, computed.airflow.wake, computed.airflow.brackets) == (
        "time-resolved",
        NO_ESTIMATE,
        True,
    )


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
    assert bool(found.wake) == (kind == "best-estimate")
    assert len(found.wakes_beside) == beside
    work = Workload(rhombus, found, None, 1, 1.0)
    again = {name: list(budget_sources[name].costs(work)) for name in budget_sources}
    assert [cost.key.name for cost in again["inputs"]] == ["draws"]
    assert len(again["airflow-model"]) == beside
    assert [cost.key.label.grid for cost in again["mesh"]] == list(found.scales[1:])
    once = next(flown_again(work, "once", 1.0)).seconds - EACH_STAGE
    (draws,) = again["inputs"]  # as many granules as the answer
    drawn = INPUT_SAMPLES * SAMPLE_SECONDS
    assert draws.seconds == pytest.approx(EACH_STAGE + drawn + once * REPLICATES / COMPARED)


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


def test_laminar_air_may_enter_without_turbulence_and_turbulent_air_may_not(rhombus: Scene) -> None:
    calm = rhombus.replace({"air.turbulence": 0.0})
    assert choose_airflow(at(calm, 0.9 * SHEDDING_ABOVE), "auto", 0.01).turbulence == "laminar"
    assert choose_airflow(calm, "none", 0.01).turbulence == ""
    with pytest.raises(SceneError, match=r"air.turbulence = 0: .* 0 is for laminar air"):
        choose_airflow(at(calm, 1.1 * LAMINAR_BELOW), "auto", 0.01)


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


# K: efficiency of points on a cylinder in ideal flow, trajectories by LSODA with 1e-10 from 50 radii upstream
EXACT = {0.196: 0.01215, 0.256: 0.04269, 0.4: 0.12999, 0.9: 0.35172, 3.6: 0.71295, 19.6: 0.92896}
SHAPES = {"circle": {"depth": 0.025}, "wedge": {"depth": 0.03}}


def points(front: Front, tau: list[float], speed: float, above: float = 2.0) -> Impaction:
    """Points without weight and with Stokes drag, of relaxation times ``tau``."""
    lag = np.array(tau)[:, None]
    return approach(
        front, above=above, speed=speed, radius=np.full(len(tau), 1e-9), relax=lambda slip: lag + 0 * slip, pull=0.0
    )


def test_efficiencies_of_a_cylinder_are_those_of_accurate_trajectories() -> None:
    found = points(Cylinder(1.0, 1.0), list(EXACT), 1.0, above=50.0)
    np.testing.assert_allclose(found.efficiency, list(EXACT.values()), atol=1.5e-3)


def test_below_the_critical_stokes_number_a_cylinder_is_missed_and_a_sharp_edge_is_not() -> None:
    assert points(Cylinder(1.0, 1.0), [0.12], 1.0, above=50.0).efficiency[0] < 1e-3
    assert points(Wedge(1.0, 1.0, 20.0, 1.0), [0.12], 1.0, above=50.0).efficiency[0] > 0.01


@pytest.mark.parametrize("name", list(fronts))
def test_of_fast_heavy_granules_those_carried_round_go_as_air_speed_over_speed_and_k(name: str) -> None:
    def missed(speed: float, tau: float, air: float) -> float:
        front = fronts[name](half=0.025, channel=0.2, speed=air, **SHAPES[name])
        return 1.0 - float(points(front, [tau], speed, above=0.15).efficiency[0])

    base = missed(2.0, 0.25, 2.0)  # K = 20
    assert 0.01 < base < 0.1
    assert missed(2.0, 0.5, 2.0) == pytest.approx(base / 2, rel=0.1)
    assert missed(4.0, 0.125, 4.0) == pytest.approx(base, rel=0.01)  # the same K, all speeds doubled
    assert missed(4.0, 0.25, 2.0) == pytest.approx(base / 4, rel=0.2)  # twice as fast through the same air


@pytest.mark.parametrize("depth", [0.0, 0.01, 0.025, 0.1])
def test_the_flow_round_the_wedge_has_no_sources_and_no_spin_and_keeps_to_its_walls(depth: float) -> None:
    front = Wedge(0.025, depth, 0.2, 5.0)

    def velocity(z: np.ndarray) -> np.ndarray:
        return front.air(front.label(z))[0].conj()  # u - i v, analytic

    z = np.array([-0.05 + 0.01j, -0.02 + 0.03j, -0.01 + 0.1j, -0.1 + 0.19j])
    step = 2e-3
    along = (velocity(z + step) - velocity(z - step)) / (2 * step)
    across = (velocity(z + 1j * step) - velocity(z - 1j * step)) / (2j * step)
    np.testing.assert_allclose(along, across, atol=0.02 * np.abs(along).max())
    y = (np.arange(200) + 0.5) / 200 * 0.2
    for x in (-0.4, -0.03):
        assert velocity(x + 1j * y).real.mean() == pytest.approx(5.0, rel=2e-3)  # what comes in goes through
    assert np.abs(velocity(np.array([-0.05 + 0.2j, -0.05 + 0j])).imag).max() < 0.02  # along wall and axis
    face = complex(depth, 0.025) * np.array([0.3, 0.5, 0.7])
    outward = complex(-0.025, depth) / abs(complex(depth, 0.025))
    past = velocity(face + 1e-4 * outward).conj()
    assert np.all(np.abs((past * outward.conjugate()).real) < 0.05 * np.abs(past))


def test_the_front_knows_where_its_face_is() -> None:
    front = Wedge(0.03, 0.04, 0.2, 5.0)
    z = np.array([0.01 + 0.02j, 0.02 + 0.005j, -0.01 + 0j, 0.05 + 0.01j])
    assert front.inside(z).tolist() == [False, True, False, True]
    np.testing.assert_allclose(np.abs(front.away(z)), [0.01, 0.008, 0.01, 0.022], rtol=1e-9)


UNIFORM = {"air-loading": False}  # air before the body that no granules slow: injection needs it


@cache
def rhombus() -> Scene:
    return shipped(
        "rhombus",
        {"numerics.rung": "draft", "numerics.mesh_scale": 2.0, "feed.count": 512, "fraction.*.impact": "paper"},
    )


def of(scene: Scene, name: str) -> Deflection:
    found = make_plan(scene).fractions[name].impaction
    assert found is not None
    return found


def test_finer_and_slower_granules_and_faster_air_are_turned_more() -> None:
    reach = of(rhombus(), "dust").reach
    assert np.all(np.diff(reach) > 0)
    fast, slow = (of(rhombus().replace({"air.speed": u}), "wheat") for u in (10.0, 1.0))
    assert fast.efficiency < of(rhombus(), "wheat").efficiency < slow.efficiency
    assert fast.shift > of(rhombus(), "wheat").shift > slow.shift


def test_the_plan_injects_what_the_accuracy_lets_it() -> None:
    modes = {target: make_plan(rhombus(), target_error=target, force=UNIFORM).fractions for target in (0.01, 0.05)}
    assert {name: how.mode for name, how in modes[0.01].items()} == dict.fromkeys(modes[0.01], "resolved")
    assert {name for name, how in modes[0.05].items() if how.mode == "injected"} == {"wheat"}
    plan = make_plan(rhombus(), target_error=0.05, force=UNIFORM)
    [row] = [row for row in plan.left_out if row.name == TURNING]
    assert (row.fraction, row.bound) == ("wheat", plan.fractions["wheat"].impaction.shift)  # type: ignore[union-attr]
    calm = make_plan(rhombus().replace({"air.speed": 1.0}), force=UNIFORM)
    assert calm.fractions["wheat"].mode == "injected"
    upward = make_plan(shipped("prism"))
    assert {(how.mode, how.impaction) for how in upward.fractions.values()} == {("resolved", None)}


def test_forced_injection_leaves_those_that_the_air_carries_round_to_the_tracker() -> None:
    scene = rhombus().replace({"feed.mode": "injected", "feed.width": 0.06, "feed.count": 4096})
    plan = make_plan(scene)
    for name in ("dust", "chaff"):
        turned = of(scene, name)
        feed = feedstock(scene, plan, name, 0.0)
        start = scene.feed.places(np.linspace(0.0, 1.0, 20001))
        radius = 0.5 * scene.fraction[name].properties.diameter
        would = np.mean(np.abs(start) < 0.025 + radius)
        assert turned.missed == pytest.approx(would - feed.injected.mean(), abs=0.02)
        top = 0.1 + 0.025  # above it those that are tracked from the start begin
        np.testing.assert_allclose(feed.granules.position[~feed.injected, 1], top, rtol=1e-9)
        assert np.abs(feed.granules.position[feed.injected, 0]).max() <= max(turned.reach)
        assert any(line.startswith(f"{name}: injected, though") for line in plan.warnings)


def test_tracks_depend_on_the_reach_only_where_it_is_used() -> None:
    plan = make_plan(rhombus(), force=UNIFORM)
    assert "reach" not in plan.fractions["wheat"].tracked
    assert "reach" in make_plan(rhombus(), target_error=0.05, force=UNIFORM).fractions["wheat"].tracked


def test_a_scene_of_any_shape_has_a_front() -> None:
    polygon = {"shape": "polygon", "points": [[-0.03, 0.0], [0.01, 0.0], [0.02, 0.01], [-0.01, 0.03]]}
    for body in (polygon, {"shape": "prism", "width": 0.05, "slope_angle": 1.0, "apex": "down"}):
        tables = {**rhombus().tables(), "body": {"it": body}}
        turned = deflection(Scene.parse(tables), "wheat", "brown-lawler", 2.0)
        assert 0.5 < turned.efficiency < 1.0
    with pytest.raises(SceneError, match="unknown front"):
        fronts["sphere"]


@pytest.mark.openfoam
@pytest.mark.parametrize(("name", "within"), [("dust", 0.08), ("chaff", 0.05), ("wheat", 0.03)])
def test_efficiencies_are_near_those_in_the_solved_airflow(name: str, within: float) -> None:
    scene = rhombus()
    plan = make_plan(scene, force=UNIFORM)
    flow = Pipeline(scene, plan).field[1]
    how, size, count = plan.fractions[name], scene.fraction[name].properties.diameter, 200
    full = 0.5 * (scene.width + size)
    x = full * (np.arange(count) + 0.5) / count
    grains = granules_of(scene, name, how, np.full(count, size))
    grains = grains.replace(position=np.stack([x, np.full(count, 0.125)], axis=1))
    body = Body(next(iter(scene.body.values())).outline(), capture=True)
    tracks = track(
        flow, grains, until=5.0, tolerance=1e-4, length=scene.width, drag=how.drag, bodies=(body,),
        forces=("drag", "gravity", "buoyancy"), lines=(np.array([(-1.0, -full), (1.0, -full)]),),
    )  # fmt: skip
    met = np.mean((tracks.fate == Fate.CAPTURED) & (tracks.position[:, 1] > -0.5 * size))
    alone = deflection(scene.replace({f"fraction.{name}.size": size}), name, how.drag, how.drag_scale)
    assert alone.efficiency == pytest.approx(met, abs=within)
    assert alone.efficiency > met - 0.01  # the real wake is wider than the body: the ideal flow turns them less


@pytest.mark.openfoam
def test_the_shift_of_injected_wheat_is_what_the_plan_says() -> None:
    """Wheat injected and resolved in the same air, body at rest, without random forces: 95 % land within the shift of
    each other, and not within a quarter of it.
    """
    tables = {key: value for key, value in rhombus().tables().items() if key != "vibration"}
    landings = []
    for mode in ("injected", "resolved"):
        scene = Scene.parse(tables).replace({"feed.mode": mode})
        plan = make_plan(scene, force=UNIFORM).with_forces(("drag", "gravity"))
        feed = feedstock(scene, plan, "wheat", 0.0)
        tracks = Flight(scene, plan, Pipeline(scene, plan).air.realisations, 1e-5).fly("wheat", feed.granules)
        landings.append(tracks.position[:, 0])
    moved = np.percentile(np.abs(landings[0] - landings[1]) / scene.width, 95)
    bound = of(rhombus(), "wheat").shift
    assert 0.25 * bound < moved < 1.5 * bound


@cache
def _shipped() -> dict[str, Unknown]:
    return _unknowns(shipped("rhombus"))


def _unknowns(scene: wf.Scene, rung: str | None = None) -> dict[str, Unknown]:
    return {one.key: one for one in unknowns(scene, make_plan(scene, rung=rung, force=ALONE))}


def test_every_input_of_the_shipped_rhombus_that_can_be_off_is_drawn() -> None:
    found = _shipped()
    shared = {
        "feed.width", "feed.position", "feed.height", "air.speed", "air.turbulence", "dispersion", "wake.theta",
        "wake.strength", "spin_lift",
    }  # fmt: skip
    assert shared <= set(found)
    wheat = {key.rpartition(".")[2] for key in found if key.startswith("fraction.wheat.")}
    assert wheat == {
        "restitution", "friction", "rebound_scatter", "terminal_velocity", "size", "inverse_inertia", "density",
        "moisture",
    }  # fmt: skip
    assert {found[key].kind for key in found} == set(unknown_kinds) - {"entrainment"}  # of air at rest
    assert "fraction.dust.rebound_scatter" not in found  # dust has none: nothing to be off


def test_a_vacuum_has_no_unknown_air(cases: Path) -> None:
    found = _unknowns(wf.Scene.load(cases / "vacuum.toml"))
    assert not any(key.startswith(("air", "wake", "dispersion")) or "terminal" in key for key in found)


def test_the_steady_wake_has_no_theta() -> None:
    assert not any(key.startswith("wake.") for key in _unknowns(shipped("rhombus"), "draft"))


@pytest.mark.parametrize(
    ("said", "half"),
    [({"value": 0.5, "uncertainty": 0.02}, 0.02), ({"value": 0.5, "uncertainty": "10 %"}, 0.05), (0.5, 0.1)],
)
def test_the_scene_says_how_well_a_number_is_known(said: object, half: float) -> None:
    scene = shipped("rhombus", {"fraction.wheat.restitution": said})
    found = _unknowns(scene)["fraction.wheat.restitution"]
    assert (found.low, found.high, found.value) == (pytest.approx(half), pytest.approx(half), 0.5)
    assert scene.fraction["wheat"].restitution == 0.5


def test_an_interval_ends_where_the_number_cannot_go_on() -> None:
    found = _shipped()
    dust, position = found["fraction.dust.restitution"], found["feed.position"]
    assert dust.low > dust.value
    assert dust.ends == (0.0, pytest.approx(dust.value + dust.high))
    assert position.ends == (pytest.approx(-position.low), pytest.approx(position.high))
    assert found["wake.theta"].ends[1] <= 1.0
    for one in found.values():
        assert one.ends[0] <= one.value <= one.ends[1]


def test_nothing_is_drawn_of_what_is_exact() -> None:
    scene = shipped("rhombus", {"uncertainty.fraction.wheat.restitution": 0, "uncertainty.wake.theta": 0})
    found = _unknowns(scene)
    assert "fraction.wheat.restitution" not in found
    assert "wake.theta" not in found


def test_defaults_go_by_the_confidence_of_the_materials_number() -> None:
    found = _shipped()
    margin = default_margins()["restitution"]
    for name in ("wheat", "chaff"):
        confidence = materials[name].evidence["restitution"].confidence
        assert found[f"fraction.{name}.restitution"].high == margin.absolute[confidence]
    assert found["fraction.chaff.restitution"].high > found["fraction.wheat.restitution"].high


@pytest.mark.parametrize("name", list(default_margins()))
def test_a_default_has_a_source_and_grows_as_confidence_falls(name: str) -> None:
    margin = default_margins()[name]
    assert margin.source
    assert margin.status in ("read", "derived", "chosen")
    halves = [margin.half(1.0, confidence, 1.0) for confidence in ("measured", "typical", "low")]
    assert 0.0 < halves[0] <= halves[1] <= halves[2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"uncertainty.feed.widht": 0.1}, "did you mean 'feed.width'"),
        ({"uncertainty.air.speed": "-3 %"}, "needs a number in m/s"),
        ({"uncertainty.fraction.wheat.restitution": -0.1}, "not negative"),
        ({"uncertainty.fraction.wheet.restitution": 0.1}, "did you mean"),
    ],
)
def test_a_wrong_uncertainty_is_one_line(changes: dict[str, object], words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        shipped("rhombus", changes)
    assert "\n" not in str(caught.value)


def test_an_uncertainty_survives_saving(tmp_path: Path) -> None:
    scene = shipped(
        "rhombus", {"air.speed": {"value": 5.0, "uncertainty": "0.1 m/s"}, "uncertainty.feed.width": "2 mm"}
    )
    scene.save(tmp_path / "scene.toml")
    again = wf.Scene.load(tmp_path / "scene.toml")
    assert again == scene
    assert again.uncertainty == {"air.speed": pytest.approx(0.1), "feed.width": pytest.approx(0.002)}


def test_what_water_moves_goes_together() -> None:
    """Wheat of 20 % water: friction and terminal velocity as measured at the wetter end, over those at the middle."""
    scene = shipped("rhombus", {"fraction.chaff.material": "wheat", "fraction.chaff.friction": 0.3})
    plan = make_plan(scene, force=ALONE)
    known = unknowns(scene, plan)
    z = np.array([SIGMAS if one.kind == "moisture" else 0.0 for one in known])
    made = variation_at(scene, plan, known, z)
    assert made.of("wheat").friction == pytest.approx(0.335 / 0.292)
    assert made.of("wheat").drag == pytest.approx((7.72 / 8.63) ** 2, rel=0.03)  # drag goes as the speed's square
    assert made.of("chaff").friction == 1.0  # the scene's own number
    assert made.of("chaff").drag < 0.9
    assert made.of("dust").drag == pytest.approx(1.0)
    scene = shipped("rhombus").replace(
        {"fraction.wheat.material": "soybean", "fraction.wheat.size": None, "fraction.chaff.material": "oats"}
    )
    plan = make_plan(scene, force=ALONE)
    known = unknowns(scene, plan)
    made = variation_at(scene, plan, known, np.array([SIGMAS if one.kind == "moisture" else 0.0 for one in known]))
    beans, oats = made.of("wheat"), made.of("chaff")
    assert (beans.size, beans.density) == (pytest.approx(7.14 / 6.855), pytest.approx(906 / 944.5))
    assert beans.drag == 1.0  # a sphere's, which falls as it then does
    assert (oats.size, oats.friction) == (1.0, 1.0)
    assert oats.drag == pytest.approx(oats.density, rel=1e-3)  # it falls as fast as before
    assert oats.density == pytest.approx(1322 / 1331.5)


def test_a_heavier_granule_of_measured_terminal_velocity_falls_as_fast() -> None:
    scene = shipped("rhombus")
    plan = make_plan(scene, force=ALONE)
    known = unknowns(scene, plan)
    made = variation_at(scene, plan, known, np.array([SIGMAS if one.kind == "density" else 0.0 for one in known]))
    wheat, dust = made.of("wheat"), made.of("dust")
    assert wheat.drag == pytest.approx(wheat.density) == pytest.approx(1.08)
    assert (dust.drag, dust.density) == (pytest.approx(1.0), pytest.approx(1.08))


def test_a_feed_that_falls_farther_arrives_faster() -> None:
    """As a height, and as the speed that is given instead."""
    for change in ({}, {"feed.height": None, "feed.speed": 1.4}):
        scene = shipped("rhombus").replace(change)
        plan = make_plan(scene, force=ALONE)
        known = unknowns(scene, plan)
        made = variation_at(scene, plan, known, np.array([SIGMAS if one.kind == "feed_fall" else 0.0 for one in known]))
        fed = made.fed(scene)
        assert fed.feed.fall_speed == pytest.approx((1.05 if change else 1.05**0.5) * scene.feed.fall_speed)


def test_the_middle_draw_is_the_scene_itself() -> None:
    scene = shipped("rhombus")
    plan = make_plan(scene, force=ALONE)
    known = unknowns(scene, plan)
    made = variation_at(scene, plan, known, np.zeros(len(known)))
    assert made.fed(scene) == scene
    assert made.air.theta == pytest.approx(plan.airflow.wake.theta.value)
    assert (made.air.speed, made.air.energy, made.air.lifetime) == (1.0, 1.0, 1.0)
    for name in scene.fraction:
        own = made.of(name)
        assert (own.restitution, own.friction, own.size) == (0.0, 1.0, 1.0)
        assert own.drag == pytest.approx(1.0)


def test_each_unknown_moves_its_own_number() -> None:
    """One standard deviation up: every kind varies one thing, by what it says; density and water what follows them."""
    scene, several = shipped("rhombus"), {"density": {"density", "drag"}, "moisture": {"friction", "drag"}}
    plan = make_plan(scene, force=ALONE)
    known = unknowns(scene, plan)
    still = variation_at(scene, plan, known, np.zeros(len(known)))
    for i, one in enumerate(known):
        z = np.zeros(len(known))
        z[i] = 1.0
        made = variation_at(scene, plan, known, z)
        changed = [
            name for name in ("feed_width", "feed_shift", "feed_fall") if getattr(made, name) != getattr(still, name)
        ]
        changed += [name for name in vars(made.air) if getattr(made.air, name) != getattr(still.air, name)]
        for name in scene.fraction:
            changed += [
                key for key in vars(made.of(name)) if getattr(made.of(name), key) != getattr(still.of(name), key)
            ]
        assert len(set(changed)) == 1 or set(changed) == several[one.kind], one.key
    wheat = next(one for one in known if one.key == "fraction.wheat.terminal_velocity")
    assert wheat.at(1.0) - wheat.value == pytest.approx(wheat.high / SIGMAS)


def test_a_faster_fall_is_less_drag() -> None:
    scene = shipped("rhombus")
    plan = make_plan(scene, force=ALONE)
    known = [one for one in unknowns(scene, plan) if one.key == "fraction.wheat.terminal_velocity"]
    made = variation_at(scene, plan, known, np.array([1.0]))
    ratio = known[0].at(1.0) / known[0].value
    assert made.of("wheat").drag == pytest.approx(ratio**-2, rel=0.05)  # a grain's drag goes with the square
