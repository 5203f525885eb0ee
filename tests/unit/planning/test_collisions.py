"""Whether granules meet: the estimate of their meetings, what the plan decides by it, and the slab that it asks for."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from proofs.report import Row
from proofs.studies import collisions
from support import G, shipped
from wakeflow.core.errors import SceneError
from wakeflow.planning.collision_rates import encounters
from wakeflow.planning.collisions import MANY_IN_FLIGHT, MASS_LEVELS, MAX_IN_FLIGHT, number_rates, plan_collisions
from wakeflow.planning.coupling import INDEPENDENT
from wakeflow.planning.terms import COLLISIONS
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene


@pytest.fixture
def vacuum() -> Scene:
    return shipped("vacuum")


OFF = {"basset-history": False}


def laws(scene: Scene) -> dict[str, tuple[str, float]]:
    plan = make_plan(scene, force=OFF)
    return {name: (how.drag, how.drag_scale) for name, how in plan.fractions.items()}


def test_meetings_grow_with_the_rate_and_shrink_with_the_depth(draft: Scene) -> None:
    known = laws(draft)
    one = encounters(draft, known)
    for change in ({"feed.rate": 2 * draft.feed.mass_flow}, {"feed.depth": 0.5 * draft.feed.depth}):
        two = encounters(draft.replace(change), known)
        for name, found in one.items():
            assert two[name].heavier == pytest.approx(2.0 * found.heavier)
            assert two[name].number == pytest.approx(2.0 * found.number)
            assert two[name].knock == pytest.approx(found.knock)


def test_meetings_of_one_fraction_are_by_hand(vacuum: Scene) -> None:
    """All alike, none overtakes: a granule meets those that leave as it falls, and those that fall as it leaves."""
    tables = vacuum.tables()
    tables["fraction"] = {"hard": tables["fraction"]["hard"]}
    tables["feed"]["rate"] = 0.01
    scene = Scene.parse(tables)
    found = encounters(scene, {"hard": ("brown-lawler", 1.0)})["hard"]
    speed, d = math.sqrt(2 * G * 0.1), 2e-3
    flux = 0.01 / (1300 * math.pi / 6 * d**3) / (0.02 * 1.0)
    thrown = 1.5 * math.sqrt(0.5) * math.sqrt(0.5) * 0.7 * speed
    pull, half = 0.5 * G, 0.01
    crossing = (math.sqrt(thrown**2 + 2 * pull * half) - thrown) / pull
    meets = flux / speed * math.pi * d**2 * math.hypot(thrown, speed) * crossing
    beside, closing = _beside(thrown, pull=0.5 * G * 0.7)
    shaken = 2e-3 * 2 * math.pi * 20 / math.sqrt(2) * thrown / speed
    closing = np.sqrt(closing**2 + 2 * shaken**2 + speed**2 / 12)
    thick = (0.5 * speed) ** 2 / 2 / (2 * G * math.sqrt(0.5))  # of the layer: as high as they hop
    layer = flux * math.pi * d**2 / thick * float((beside * closing).sum())
    assert found.heavier == pytest.approx(2 * meets + layer, rel=0.02)
    assert found.number == pytest.approx(found.heavier)
    kicks = 2 * meets * math.hypot(thrown, speed) + flux * math.pi * d**2 / thick * float((beside * closing**2).sum())
    assert found.knock == pytest.approx(1.5 * 0.5 * kicks / (2 * meets + layer), rel=0.02)


def _beside(start: float, pull: float, within: float = 0.02, ends: float = 0.0225) -> tuple[Any, Any]:
    """By random places instead of sums: weights (s2) of pairs of granules that slide past a place, and how much faster
    one does (m/s).
    """
    rng, n = np.random.default_rng(1), 400_000
    mine, theirs, place = within * rng.random(n), within * rng.random(n), ends * rng.random(n)
    one, two = (np.sqrt(start**2 + 2 * pull * np.maximum(place - came, 0.0)) for came in (mine, theirs))
    both = (place > mine) & (place > theirs)
    return np.where(both, ends * within / (one * two), 0.0) / n, one - two


def test_what_is_lighter_turns_nobody_out_of_its_way(draft: Scene) -> None:
    found = encounters(draft, laws(draft))
    assert found["wheat"].number > 100 * found["wheat"].heavier  # dust, by the thousand
    shares = {"dust": 1e-6, "chaff": 0.08 / 0.98, "wheat": 0.9 / 0.98 - 1e-6}  # the same flow of chaff and wheat
    kept = {f"fraction.{name}.mass_share": share for name, share in shares.items()}
    alone = encounters(draft.replace({**kept, "feed.rate": 0.98 * draft.feed.mass_flow}), laws(draft))
    assert alone["wheat"].heavier == pytest.approx(found["wheat"].heavier, abs=0.03)  # of a meeting
    assert found["chaff"].heavier > found["wheat"].heavier


BALL = {"impact": "disc", "dimensions": [1e-3, 1e-3, 1e-3]}
BALLS = {  # with which the slabs of prism and labyrinth were flown
    "chaff": {"size": "1.3 mm", "density": 200.0, "terminal_velocity": "1.75 m/s", **BALL},
    "straw": {"restitution": 0.2, "friction": 0.4, **BALL},
}


@pytest.mark.parametrize(
    ("name", "rate", "flown"),
    [  # kg/h, and meetings counted in slabs: docs/validation.md
        ("rhombus", 500.0, {"chaff": 1.44, "wheat": 1.69}),
        ("rhombus", 1000.0, {"chaff": 2.7, "wheat": 3.3}),
        ("prism", 100.0, {"chaff": 0.42, "wheat": 1.75}),
        ("labyrinth", 100.0, {"chaff": 0.47, "straw": 5.9, "wheat": 2.85}),
        ("labyrinth", 500.0, {"chaff": 3.2, "straw": 26.0, "wheat": 15.3}),
    ],
)
def test_meetings_estimated_are_those_flown_within_a_factor(name: str, rate: float, flown: dict[str, float]) -> None:
    scene = shipped(name).replace({"feed.rate": rate / 3600.0})
    balls = {} if name == "rhombus" else {one: keys for one, keys in BALLS.items() if one in scene.fraction}
    scene = scene.replace(
        {f"fraction.{one}.{key}": value for one, keys in balls.items() for key, value in keys.items()}
    )
    found = encounters(scene, laws(scene))
    for fraction, counted in flown.items():
        estimated = sum(found[fraction].by[other] for other in flown)
        assert 0.75 < estimated / counted < 1.7, fraction


def test_the_wake_above_a_body_shelters_what_falls_in_upward_air() -> None:
    scene = shipped("prism")
    known = laws(scene)
    found = encounters(scene, known)
    assert found["wheat"].by["chaff"] > found["wheat"].by["wheat"] > 0.0
    assert found["dust"].number == 0.0  # the wake's air carries it off
    for change in ({"feed.height": 0.15}, {"feed.width": 0.06}):  # from beyond the wake's end, and beside it
        bare = encounters(scene.replace(change), known)
        assert bare["wheat"].by["chaff"] == bare["chaff"].number == 0.0


@pytest.mark.parametrize("name", ["rhombus", "prism", "labyrinth", "aspirator"])
def test_at_their_own_rate_the_shipped_scenes_need_the_slab_and_at_a_trickle_none(name: str) -> None:
    scene = shipped(name)
    plan = make_plan(scene)
    assert plan.collisions is not None
    assert not [line for line in plan.warnings if INDEPENDENT in line]
    assert any(line.startswith("collisions: a slab") for line in plan.used)
    assert COLLISIONS not in {row.name for row in plan.left_out}
    trickle = make_plan(scene.replace({"feed.rate": 1e-6}))
    assert trickle.collisions is None
    rows = {row.fraction: row for row in trickle.left_out if row.name == COLLISIONS}
    assert set(rows) == set(scene.fraction)
    assert all("below the" in row.why for row in rows.values())
    slabs = [[stage.seconds for stage in one.stages if stage.name == "slab"] for one in (plan, trickle)]
    assert len(slabs[0]) == 1
    assert slabs[0][0] > 1.0
    assert slabs[1] == []


def test_the_slab_flies_from_the_rate_on_at_which_a_bound_reaches_the_limit(draft: Scene) -> None:
    row = next(row for row in make_plan(draft).validity if row.name == "meetings")
    assert row.feed_rate is not None
    rates = [share * row.feed_rate / 3600.0 for share in (0.99, 1.01)]
    below, above = (make_plan(draft.replace({"feed.rate": rate})) for rate in rates)
    assert below.collisions is None
    assert above.collisions is not None
    coarse = make_plan(draft.replace({"feed.rate": rates[1]}), target_error=0.02)
    assert coarse.collisions is None


def test_a_switch_decides_by_hand(draft: Scene) -> None:
    off = make_plan(draft, force={COLLISIONS: False})
    assert off.collisions is None
    assert {row.fraction for row in off.left_out if row.name == COLLISIONS} == set(draft.fraction)
    assert all("switched off" in row.why for row in off.left_out if row.name == COLLISIONS)
    assert any(f"too dense for {INDEPENDENT}" in line for line in off.warnings)
    on = make_plan(draft.replace({"feed.rate": 1e-6}), force={COLLISIONS: True})
    assert on.collisions is not None


def test_without_a_rate_nobody_meets_unless_it_is_asked_for(vacuum: Scene) -> None:
    plan = make_plan(vacuum)
    assert plan.collisions is None
    assert not [line for line in plan.warnings if INDEPENDENT in line]
    assert all("no feed.rate" in row.why for row in plan.left_out if row.name == COLLISIONS)
    assert make_plan(vacuum, force={COLLISIONS: True}).collisions is not None
    fed = make_plan(vacuum.replace({"feed.rate": 0.05}))
    assert fed.collisions is not None
    assert fed.fractions["hard"].bounds[COLLISIONS] > fed.fractions["hard"].limit  # type: ignore[operator]


def test_granules_that_lie_on_the_body_are_no_stream(vacuum: Scene) -> None:
    tables = vacuum.tables()
    del tables["feed"]["height"]
    tables["feed"] |= {"start": "resting", "rate": 0.1}
    resting = Scene.parse(tables)
    plan = make_plan(resting)
    assert plan.collisions is None
    assert all("no stream" in row.why for row in plan.left_out if row.name == COLLISIONS)
    with pytest.raises(SceneError, match=r"collisions=on: .* no stream"):
        make_plan(resting, force={COLLISIONS: True})


def test_the_slab_is_as_deep_as_asked_and_no_deeper_than_the_machine(draft: Scene) -> None:
    draft = draft.replace({"feed.rate": 4.0 * draft.feed.mass_flow})
    depth = [make_plan(draft.replace(change)).collisions for change in ({}, {"collisions.depth": "30 mm"},
             {"feed.depth": "20 mm", "feed.rate": 0.01})]  # fmt: skip
    assert [one.depth for one in depth if one is not None] == pytest.approx([15 * 3.6e-3, 0.03, 0.02])
    thin = plan_collisions(draft.replace({"feed.rate": 0.1 * draft.feed.mass_flow}), laws(draft), 0.01)
    assert sum(thin.in_flight.values()) == pytest.approx(MANY_IN_FLIGHT)
    assert thin.depth == pytest.approx(15 * 3.6e-3 * 10 * MANY_IN_FLIGHT / sum(depth[0].in_flight.values()))  # type: ignore[union-attr]


def test_numbers_of_granules_carry_the_mass_that_is_fed(draft: Scene) -> None:
    for name, fraction in draft.fraction.items():
        diameter = fraction.diameters((np.arange(MASS_LEVELS) + 0.5) / MASS_LEVELS)
        mass = fraction.properties.density * math.pi / 6 * diameter**3
        carried = float(number_rates(draft, name) @ mass)
        assert carried == pytest.approx(draft.mass_shares()[name] * draft.feed.mass_flow)


def test_only_what_can_be_simulated_one_by_one_is(draft: Scene) -> None:
    slab = plan_collisions(draft, laws(draft), 0.01)
    assert dict(slab.tracers) == {"dust": 1.0, "chaff": 0.0, "wheat": 0.0}
    assert all(number <= MAX_IN_FLIGHT for number in slab.in_flight.values())
    many = {"feed.rate": 8 * draft.feed.mass_flow, "fraction.chaff.size": "0.7 mm"}
    busy = plan_collisions(draft.replace(many), laws(draft), 0.01)
    assert busy.tracers["chaff"] == 1.0  # of one size: all or none
    assert busy.tracers["wheat"] == 0.0
    quiet = plan_collisions(draft.replace({"feed.rate": 10.0 / 3600.0}), laws(draft), 0.01)
    assert quiet.tracers["dust"] == 1.0  # few enough, and too light to turn anybody
    sizes = {"distribution": "uniform", "low": "0.05 mm", "high": "4 mm"}
    spread = plan_collisions(draft.replace({"fraction.chaff.size": sizes}), laws(draft), 0.01)
    assert 0.0 < spread.tracers["chaff"] < 0.5  # the finest, by number most of them
    assert 0.0 < spread.in_flight["chaff"] <= MAX_IN_FLIGHT


def test_a_feed_of_too_many_heavy_granules_is_no_slab_of_tracers_alone() -> None:
    """Where the heaviest cannot be simulated nobody would meet anybody: it is left out, and the plan says so."""
    vacuum = shipped("vacuum", {"feed.rate": "50 t/hour"})
    plan = make_plan(vacuum)
    assert plan.collisions is None
    found = next(one for one in plan.left_out if one.name == "collisions" and one.fraction == "hard")
    assert "in flight in a slab 0.03 m deep, more than the 10000" in found.why
    assert any("too dense for independent granules" in notice.text for notice in plan.notices)
    with pytest.raises(SceneError, match=r"set collisions.depth below 0.02\d m, or feed.rate below"):
        make_plan(vacuum, force={"collisions": True})
    thin = make_plan(vacuum.replace({"collisions.depth": "10 mm"})).collisions
    assert thin.in_flight["hard"] > 1000


def test_a_tighter_accuracy_counts_for_longer(draft: Scene) -> None:
    draft = draft.replace({"fraction.chaff.size": "0.7 mm"})  # so many that none is rare
    known = laws(draft)
    whole = [
        s.replicates * s.operation for s in (plan_collisions(draft, known, target) for target in (0.1, 0.03, 0.01))
    ]
    assert whole[0] < whole[1] < whole[2]


def test_a_count_that_a_scene_gives_is_flown_as_it_is(draft: Scene) -> None:
    known = laws(draft)
    few, many = (
        plan_collisions(draft.replace({"collisions.count": count}), known, 0.01) for count in (100_000, 1_000_000)
    )
    assert many.fewest == many.replicates
    assert many.replicates * many.operation == pytest.approx(10.0 * few.replicates * few.operation, rel=1e-9)


def test_replicates_grow_by_half_up_to_those_of_the_plan(draft: Scene) -> None:
    slab = replace(plan_collisions(draft, laws(draft), 0.01), replicates=16)
    assert slab.fewest == 4
    assert [slab.after(flown) for flown in (4, 6, 8, 12, 14)] == [6, 8, 12, 16, 16]
    assert plan_collisions(draft, laws(draft), 0.01, paired=True).fewest == 8


IDLE = 30.0  # how many times what it bounds a bound may be


def test_estimate_and_bound_hold_in_a_vacuum() -> None:
    _hold(list(collisions.bound_rows("vacuum", rates=(200.0,), count=128)))


@pytest.mark.slow
@pytest.mark.openfoam
@pytest.mark.parametrize("name", ["rhombus", "prism", "labyrinth"])
def test_estimate_and_bound_hold_in_three_scenes(name: str) -> None:
    """Of tests/proofs/studies/collisions.py, which prints the table of docs/validation.md. In the prism's wake the air
    carries dust through the curtain, which the estimate leaves out; there the bound on shares alone is held.
    """
    _hold(list(collisions.bound_rows(name)), carried="dust" if name == "prism" else None)


def _hold(rows: list[Row], *, carried: str | None = None) -> None:
    """Meetings are estimated to within a factor of IDLE and not underestimated by more than a factor of 2; no share
    changes beyond its bound; and the bound that decides, that of the fraction which collisions move most, is not idle.
    """
    met = [row for row in rows if row["counted"] > 0.1 and row["fraction"] != carried]
    assert not [row for row in met if 0.5 * row["counted"] > row["estimated"]]
    for row in rows:
        assert row["holds"], row
        assert row not in met or row["estimated"] <= IDLE * row["counted"], row
    for rate in {row["rate"] for row in rows}:
        most = max((row for row in rows if row["rate"] == rate), key=lambda row: row["change"])
        if most["change"] > 2.0 * most["error"]:
            assert most["bound"] <= IDLE * most["change"], most
