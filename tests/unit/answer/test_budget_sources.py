"""Sources of the budget are registered objects: what each of them owes, and one that is added from outside."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest

import wakeflow as wf
from support import landings_in, shipped
from wakeflow.answer.budget.budget import NOTICEABLE, gain_by_replicates, in_ensemble, numerical, remedies, total_of
from wakeflow.answer.budget.flown_again import MAX_FACTOR, AmongOthers, Comparison, compared, differences
from wakeflow.answer.budget.inputs import AIR_SPEED, NO_EFFECT, VIBRATION, swung
from wakeflow.answer.budget.mesh import Grid, difference_noise, mesh_error, shedding_noise
from wakeflow.answer.budget.model import MODEL
from wakeflow.answer.budget.slab_sources import beyond_chance
from wakeflow.answer.budget.source import INPUTS, FractionResults, Parts, Source, add, budget_sources, signed_column
from wakeflow.answer.budget.steps import NOISE
from wakeflow.answer.cells import LandingCells
from wakeflow.answer.draws import columns
from wakeflow.answer.joint import JointAnswer
from wakeflow.answer.provenance import RefinedSettings
from wakeflow.answer.shares import (
    CALIBRATED,
    LEFT_OUT,
    MEASURED,
    NOT_COMPUTED,
    PERTURBED_RERUN,
    UNKNOWN,
    BudgetPart,
    BudgetRow,
    BudgetTotal,
)
from wakeflow.core.number import Number, student
from wakeflow.core.store import Store
from wakeflow.flight.stages.landings import Landings, Tracked
from wakeflow.flight.stages.pipeline import CollisionRerun, PerturbedRerun, Pipeline
from wakeflow.laws.best_estimate import WakeEstimate, best_estimate
from wakeflow.planning.airflow_choice import SHARES_MOVED
from wakeflow.planning.collisions import CollisionPlan
from wakeflow.planning.plan import COMPARED, REPLICATES
from wakeflow.planning.stage_cache import StageTime
from wakeflow.planning.unknowns import SIGMAS, unknowns
from wakeflow.planning.wake import Wake
from wakeflow.runs.planned import make_plan
from wakeflow.runs.refine import unreached_lines
from wakeflow.runs.time_budget import RoundPrices, expected_half, expected_part
from wakeflow.scene import Scene


@pytest.mark.parametrize("others", [0.0, 0.3, 1.0, 2.0, 2.5, 3.3, 5.0, 10.0])
def test_how_many_replicates_fly_hardly_depends_on_the_seed(others: float) -> None:
    """Over 20 seeds of three fractions in four bins: the most over the median. ``others``: all other errors of a share
    over the standard deviation of a replicate's; where they are large the fewest are enough, without them all fly.
    """
    slab, flown = CollisionPlan(0.03, {}, {}, 16, 4, 1.0, 1.0, 1000, 60.0, 1e6), []
    for seed in range(20):
        apart = np.random.default_rng(seed).standard_normal((3, 4, 16))
        apart -= apart.mean(axis=1, keepdims=True)
        number = slab.fewest
        while number < slab.replicates:
            half = student(number - 1) * apart[..., :number].std(axis=-1, ddof=1) / np.sqrt(number)
            parts = {
                str(i): {str(j): [_part("sampling", half[i, j]), _part("mesh", others)] for j in range(4)}
                for i in range(3)
            }
            if gain_by_replicates(parts, number) < NOTICEABLE:
                break
            number = slab.after(number)
        flown.append(number)
    assert max(flown) <= 1.5 * np.median(flown)
    assert others > 0.3 or min(flown) == 16
    assert others < 10.0 or max(flown) == 4


def _part(source: str, error: float) -> BudgetPart:
    return BudgetPart(source, error, 0.0, MEASURED)


class CoarserSteps(Source[Tracked]):
    """Granules flown again at ten times the tolerance: an example of a source, as docs/extending.md shows it."""

    name, how, place = "coarser-steps", PERTURBED_RERUN, 70
    if_unknown = "numerics.tolerance = 1e-3"
    if_large = "fly by hand"

    reruns = (PerturbedRerun("coarser-steps", looser=10.0, times=0.5),)  # a flight takes half as long

    def shares(self, fraction: FractionResults) -> Parts:
        (coarse,), bins = fraction.flights.of(self), len(fraction.pipeline.scene.bin)
        moved = coarse.landings[fraction.name].counts(bins) - fraction.compared.counts(bins)
        errors, seconds = np.abs(moved.mean(axis=0)), self.seconds(fraction)
        return {place: [self.part(float(error), seconds)] for place, error in zip(fraction.shares, errors, strict=True)}

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        return (part.error or 0.0) * then.tolerance / now.tolerance


@pytest.fixture
def coarser() -> Iterator[Source[Tracked]]:
    """The example, registered as any source is, and taken out again."""
    source = add(CoarserSteps())
    yield source
    budget_sources.remove(source.name)


def test_a_new_source_stands_in_the_budget_of_a_run(coarser: CoarserSteps, cases: Path, tmp_path: Path) -> None:
    result = wf.run(Scene.load(cases / "vacuum.toml", {"feed.count": 256}), tmp_path)
    shares = [row for row in result.budget if row.quantity.startswith("share.")]
    assert shares
    for row in shares:
        names = [part.source for part in row.parts]
        assert names.index("inputs") < names.index("integration") < names.index("coarser-steps")
        (part,) = [part for part in row.parts if part.source == coarser.name]
        assert part.error is not None
        assert part.seconds > 0.0
    assert "coarser-steps" in result.table["seconds"]
    assert "coarser-steps" in (tmp_path / "budget.csv").read_text()
    assert "coarser-steps" in (tmp_path / "report.html").read_text()


def test_a_new_source_that_flies_again_is_in_the_plans_cost(cases: Path, request: pytest.FixtureRequest) -> None:
    scene = Scene.load(cases / "vacuum.toml")
    before = make_plan(scene)
    request.getfixturevalue("coarser")
    after = make_plan(scene)
    (added,) = set(after.stages) - set(before.stages)
    assert (added.name, added.when, added.key.stage.work, added.key.heading) == (
        "coarser-steps", "after", "flights", "companions"
    )  # fmt: skip
    assert after.estimate["seconds"] == pytest.approx(before.estimate["seconds"] + added.seconds)


@pytest.mark.usefixtures("coarser")
def test_a_new_source_is_refined_and_has_a_remedy(cases: Path) -> None:
    now = RefinedSettings(granules=1024, tolerance=1e-3, mesh_scale=None, averaging=None, slab=None)
    finer = replace(now, tolerance=1e-4)
    part = BudgetPart("coarser-steps", 0.2, 1.0, PERTURBED_RERUN)
    assert expected_part(part, now, finer) == pytest.approx(0.02)
    row = BudgetRow("share.wheat.left", None, (part,), BudgetTotal(0.2, 1.0, 0.0, 1.0, 0.2))
    assert expected_half(row, now, finer) == pytest.approx(0.02)
    spent = {"coarser-steps": StageTime(5.0, False)}
    assert RoundPrices.measured(spent, now).at(replace(now, granules=4096)).seconds == pytest.approx(0.4 + 4.0 * 4.6)
    assert remedies(["coarser-steps"]) == ["numerics.tolerance = 1e-3"]
    scene = Scene.load(cases / "vacuum.toml")
    (line,) = unreached_lines([row], now, 1e-9, scene, make_plan(scene))
    assert line.startswith("wheat in left: coarser-steps stays at")
    assert line.endswith(": fly by hand")


@pytest.mark.parametrize("name", list(budget_sources))
def test_a_source_says_what_it_is(name: str) -> None:
    source: Source[Any] = budget_sources[name]
    assert source.name == name
    assert source.how in (MEASURED, PERTURBED_RERUN, CALIBRATED, UNKNOWN)
    assert type(source).__doc__


def test_every_source_that_flies_granules_again_is_in_the_plans_cost() -> None:
    again = {name for name in budget_sources if budget_sources[name].reruns}
    kinds = {name: type(budget_sources[name]) for name in budget_sources}
    flying, priced = (
        again | {name for name, kind in kinds.items() if getattr(kind, way) is not getattr(Source, way)}
        for way in ("fly", "costs")
    )
    assert flying == priced
    assert {name for name in flying if budget_sources[name].how != PERTURBED_RERUN} == set()


def test_no_two_sources_share_a_place_in_a_row() -> None:
    assert budget_sources[MODEL.name] is MODEL
    places = [budget_sources[name].place for name in budget_sources]
    assert len(set(places)) == len(places)


def test_the_models_error_is_of_no_best_estimate_and_the_farthest_wake_of_another() -> None:
    """Shares of one bin by wake. The two numbers of a best estimate are drawn; its ends stand in the bracket alone."""
    share = {Wake.STEADY: 0.9, Wake.TIME_RESOLVED: 0.1, Wake.ANSWER: 0.5}
    wakes = Comparison({wake: {"dust": np.full((4, 1), value)} for wake, value in share.items()}, 7.0)
    estimate = best_estimate("rhombus", 0.125, 1.65e4)

    def parts(wake: WakeEstimate | None, found: Comparison[Wake]) -> Mapping[str, Sequence[BudgetPart]]:
        pipeline = SimpleNamespace(plan=SimpleNamespace(airflow=SimpleNamespace(wake=wake)))
        flights = SimpleNamespace(of=lambda source: [found])
        asked = SimpleNamespace(name="dust", shares={"middle": None}, flights=flights, pipeline=pipeline)
        return MODEL.shares(asked)  # type: ignore[arg-type]

    assert parts(estimate, wakes) == {}
    laminar = Comparison({wake: wakes.shares[wake] for wake in (Wake.STEADY, Wake.ANSWER)}, 1.0)
    (part,) = parts(None, laminar)["middle"]
    assert (part.error, part.note) == (pytest.approx(0.4), "farthest: steady (+40 points)")


Array = NDArray[np.int64]


@pytest.fixture
def pipeline(cases: Path, tmp_path: Path) -> Pipeline:
    scene = Scene.load(cases / "vacuum.toml", {"feed.count": 256})
    return Pipeline(scene, make_plan(scene), store=Store(tmp_path))


def test_a_companion_flies_the_first_replicates_granules_again(pipeline: Pipeline) -> None:
    combine, part = pipeline.tracks(), pipeline.run(PerturbedRerun("again"))
    for name in pipeline.scene.fraction:
        first, again = compared(combine.landings[name]), part.landings[name]
        assert len(again.bin) == len(combine.landings[name].bin) * COMPARED // REPLICATES
        for column in ("position", "bin", "replicate", "diameter", "time"):
            np.testing.assert_array_equal(getattr(first, column), getattr(again, column))
    assert {"tracks", "again"} <= set(pipeline.seconds)
    assert pipeline.spent("again") > 0.0


def test_differences_are_from_the_answers_own_share() -> None:
    shares = {
        Wake.STEADY: {"chaff": np.array([[0.5, 0.5], [0.7, 0.3]])},
        Wake.ANSWER: {"chaff": np.array([[0.2, 0.8], [0.4, 0.6]])},
    }
    found = Comparison(shares, 1.0)
    assert dict(differences(found, "chaff", 0)) == {Wake.STEADY: pytest.approx(0.3)}
    assert dict(differences(found, "chaff", 1)) == {Wake.STEADY: pytest.approx(-0.3)}
    table = found.means(["middle"])
    assert table["chaff"]["middle"] == {"steady": pytest.approx(0.6), "answer": pytest.approx(0.3)}
    assert list(table["chaff"]) == ["middle", "elsewhere"]


def test_a_share_that_converges_at_second_order_has_its_mesh_error() -> None:
    """Shares 0.3 + C h^2 on three grids: the interval holds 0.3, whatever the replicates scatter by, since the same
    granules fly on all of them.

    The answer's own grid is the finest, and last.
    """
    scatter = np.array([-0.1, 0.1, -0.1, 0.1])
    shares = {
        Grid(place, n): {"chaff": (0.3 + 50.0 / n + scatter)[:, None]} for place, n in ((1, 2000), (2, 900), (0, 4500))
    }
    found, (granules, sheddings) = mesh_error(Comparison(shares, 1.0), "chaff", 0)
    assert granules == sheddings == 0.0
    assert found.kind == "richardson"
    assert found.order == pytest.approx(2.0, abs=0.05)
    assert found.low <= 0.3 <= found.high
    others = [grid for grid in shares if grid.place]
    quiet, loud = ({grid: {"chaff": np.array([[3.0], [4.0]]) * half} for grid in others} for half in (2e-5, 2e-3))
    assert mesh_error(Comparison(shares, 1.0, quiet), "chaff", 0)[0] == found
    hidden, noise = mesh_error(Comparison(shares, 1.0, loud), "chaff", 0)
    assert hidden.kind == "range-statistics"
    np.testing.assert_allclose(noise, [6e-3, 8e-3])  # most of it the sheddings'


def landings(places: Array, cycle: NDArray[np.uint16] | None = None) -> Landings:
    """Granules that ended in bins of the numbers ``places`` (COMPARED, n)."""
    shed = {} if cycle is None else {"cycle": cycle}
    return landings_in(places.ravel(), replicate=np.indices(places.shape)[0].ravel(), **shed)


def test_what_longer_intervals_of_noise_move_is_a_part_that_chance_leaves_wide() -> None:
    """One in ten leaves the bin and none comes; in a fraction that nothing moves by chance there is no part."""
    own = np.tile(np.arange(1000) % 2, (COMPARED, 1))
    moved = np.where(np.arange(1000) % 10 == 0, 1, own)
    plan = SimpleNamespace(fractions={"dust": SimpleNamespace(random=True)})
    scene = SimpleNamespace(bin={"left": None, "right": None}, images=None)
    pipeline = SimpleNamespace(scene=scene, plan=plan, spent=lambda stage: 1.0)
    flown = SimpleNamespace(landings={"dust": landings(moved)})
    flights = SimpleNamespace(of=lambda source: [flown])
    shares = {"left": 0.5, "right": 0.5, "elsewhere": 0.0}
    asked = SimpleNamespace(name="dust", shares=shares, flights=flights, pipeline=pipeline, compared=landings(own))
    parts: Parts = NOISE.shares(asked)  # type: ignore[arg-type]
    chance = np.sqrt(0.1 / 4000)
    for place in ("left", "right"):
        (part,) = parts[place]
        assert part.error == pytest.approx(np.hypot(0.1, chance), rel=1e-3)
        assert part.of_granules == pytest.approx(chance, rel=2e-3)
    assert parts["elsewhere"][0].error == pytest.approx(np.sqrt(0.5 / 4001 / 4000))
    now = RefinedSettings(granules=1024, tolerance=1e-3, mesh_scale=None, averaging=None, slab=None)
    expected = NOISE.expected(parts["left"][0], now, replace(now, granules=1024 * 16**3))
    assert expected == pytest.approx(0.1, rel=1e-4)
    plan.fractions["dust"].random = False
    assert NOISE.shares(asked) == {}  # type: ignore[arg-type]


def test_the_noise_of_a_difference_is_of_granules_that_change_their_bin() -> None:
    """Half of the granules in either bin: where none moves, one in 2000 is what is unknown, not the sampling's 2 %."""
    count = 500
    before = np.tile(np.arange(count) % 2, (COMPARED, 1))
    same, shed = difference_noise(landings(before), landings(before), 2)
    assert not shed.any()
    assert not difference_noise(landings(before), landings(before), 3)[:, 2].any()  # a bin that nobody reaches
    np.testing.assert_allclose(same[:2], SIGMAS * np.sqrt(2.0) / (COMPARED * count + 2), rtol=1e-12)
    chance = np.random.default_rng(1)
    share, halves, moved = 0.05, [], []
    for _ in range(200):  # 5 % of bin 0 move to bin 1: the interval holds that in 95 % of the samples
        after = np.where((before == 0) & (chance.random(before.shape) < 2 * share), 1, before)
        halves.append(difference_noise(landings(before), landings(after), 2)[0, 1])
        moved.append(np.mean(after == 1) - np.mean(before == 1))
    held = np.abs(np.array(moved) - share) <= halves
    assert 0.91 <= held.mean() <= 0.99


def test_grids_are_compared_beside_what_their_finite_sheddings_leave() -> None:
    """Half of the granules of a strong shedding and none of a weak one land in the bin: that is no error of a mesh."""

    def landed(shares: tuple[float, ...]) -> Landings:
        count, cycles = 400, len(shares)
        cycle = np.indices((COMPARED, cycles * count))[1].ravel()
        cycle, within = cycle // count, cycle % count
        inside = within < np.array(shares)[cycle] * count
        return landings(np.where(inside, 0, -1).reshape(COMPARED, -1), cycle.astype(np.uint16))

    np.testing.assert_allclose(shedding_noise(landed((0.3, 0.3, 0.3, 0.3)), 1), 0.0, atol=1e-12)
    wide = shedding_noise(landed((0.5, 0.0, 0.5, 0.0)), 1)
    expected = student(3) * np.std([0.5, 0.0, 0.5, 0.0], ddof=1) / 2
    np.testing.assert_allclose(wide, expected)
    quiet, loud = landed((0.3, 0.3, 0.3, 0.3)), landed((0.5, 0.0, 0.5, 0.0))
    np.testing.assert_allclose(difference_noise(quiet, loud, 1)[1], wide)  # each wake in time is a sample of its own


def test_how_granules_rebound_from_each_other_is_no_part_of_computing() -> None:
    halves = {"uncertainty.collisions.restitution": 0.3, "uncertainty.collisions.friction": 0.1}
    scene = shipped("rhombus", {"collisions.restitution": 0.8, **halves})
    met = CollisionRerun("again", restitution=1.0, friction=3.0).applied(scene).collisions
    assert (met.restitution, met.friction) == (1.0, pytest.approx(scene.collisions.friction + 0.3))
    met = CollisionRerun("below", restitution=-3.0, friction=-1.0).applied(scene).collisions
    assert (met.restitution, met.friction) == (0.0, pytest.approx(scene.collisions.friction - 0.1))
    parts = [part("collisions.friction", 0.04), part("steps", 0.03)]
    assert numerical(parts) == pytest.approx(0.03)
    total = total_in(parts)
    assert (total.error, total.numerical) == (pytest.approx(0.05, rel=CLOSE), pytest.approx(0.03, rel=CLOSE))


@pytest.mark.parametrize("paired", [True, False])
def test_of_two_slabs_what_chance_makes_is_taken_off(paired: bool) -> None:
    """In squares, over many tries: nothing is left of none, and a true difference is found."""
    chance, found = np.random.default_rng(3), {0.0: [], 0.05: []}
    for true, parts in found.items():
        for _ in range(400):
            own = 0.4 + 0.03 * chance.normal(size=4 if paired else 16)
            changed = (own if paired else 0.4) + true + 0.03 * chance.normal(size=4)
            parts.append(beyond_chance(changed, own, paired=paired)[0] ** 2)
    assert np.sqrt(np.mean(found[0.05])) == pytest.approx(0.05, rel=0.05)
    assert np.median(found[0.0]) == 0.0
    assert beyond_chance(np.array([0.5]), np.array([0.4]), paired=True) == (pytest.approx(0.1), "")
    assert beyond_chance(np.array([0.4]), np.array([0.5]), paired=True) == (pytest.approx(-0.1), "")
    between, note = beyond_chance(own, changed, paired=paired, part=0.5)  # the two ends of an interval
    whole, _ = beyond_chance(own, changed, paired=paired)
    assert between == 0.5 * whole < 0.0  # it was changed to more
    assert note.startswith("half of a difference ")


def test_what_a_number_between_granules_changes_goes_together_and_is_the_same_in_every_run() -> None:
    """Signed, at the upper end of its interval: what one bin gains another loses, of all fractions at once."""
    assert not signed_column("collisions.friction", [{}, {}])
    changes = [{"near": 0.04, "far": -0.03, "elsewhere": -0.01}, {}]
    (column,) = signed_column("collisions.friction", changes)
    assert (column.computing, column.shared, column.roots.shape) == (False, True, (2, 3, 1))
    found = column.draws(["a", "b"], "a run")
    assert np.array_equal(found, column.draws(["a", "b"], "another"))
    np.testing.assert_allclose(found[:, 0].sum(axis=1), 0.0, atol=1e-12)
    assert not found[:, 1].any()
    assert np.ptp(np.quantile(found[:, 0, 0], [0.025, 0.975])) == pytest.approx(0.08, rel=0.01)
    assert np.corrcoef(found[:, 0, 0], found[:, 0, 1])[0, 1] == pytest.approx(-1.0)


def part(source: str, error: float | None, kind: str | None = None, **more: float) -> BudgetPart:
    return BudgetPart(source, error, 1.0, "measured", kind, **more)


CLOSE = 0.03  # of the half of an interval: so well do 2048 draws tell its ends
PLACES = ("near", "far", "elsewhere")
# So that no source knows how the errors of its shares go together
NOTHING_FLOWN = cast("FractionResults", SimpleNamespace(flights=SimpleNamespace(of=lambda source: (), slab=())))


def answer_of(value: float, moved: Callable[[np.ndarray], np.ndarray] | None = None) -> JointAnswer:
    """One fraction of which ``value`` lands near and all else far, and an input that moves granules from far to near by
    what ``moved`` says at z (n,) standard deviations.
    """
    cells, keys = LandingCells.of(shipped("vacuum"), 1), ("air.speed",)
    even, z = cells.parts() / cells.parts().sum(axis=0), columns(keys)
    by = np.zeros(len(z)) if moved is None else moved(z[:, 0])
    change = (by[:, None, None] * (even[:, 0] - even[:, 1])).astype(np.float32)
    return JointAnswer(
        ("grain",), np.ones(1), {"grain": ("near",)}, 1.0, cells, (), keys, z,
        (even @ np.array([value, 1.0 - value, 0.0]))[None], change, salt="run",
    )  # fmt: skip


def with_parts(joint: JointAnswer, parts: Sequence[BudgetPart]) -> Number:
    """The share near where the ``parts`` are those of the two bins: of elsewhere nobody errs."""
    every = {"grain": {"near": parts, "far": parts, "elsewhere": []}}
    return in_ensemble(joint, every, {"grain": NOTHING_FLOWN}).own.share("grain", "near")


def total_in(
    parts: Sequence[BudgetPart], value: float = 0.5, moved: Callable[[np.ndarray], np.ndarray] | None = None,
    seconds: float = 0.0,
) -> BudgetTotal:  # fmt: skip
    """The total of the row of the share near."""
    return total_of(with_parts(answer_of(value, moved), parts), parts, seconds)


def arms(below: float, above: float) -> Callable[[np.ndarray], np.ndarray]:
    """What an input moves whose 95 % range reaches so far below and above the answer."""
    return lambda z: z / SIGMAS * np.where(z < 0.0, below, above)


def test_independent_parts_add_up_in_squares() -> None:
    total = total_in([part("steps", 0.03), part("mesh", 0.04)], seconds=7.0)
    assert (total.error, total.numerical) == (pytest.approx(0.05, rel=CLOSE), pytest.approx(0.05, rel=CLOSE))
    assert total.seconds == 7.0
    assert (total.low, total.high) == (pytest.approx(0.45, abs=CLOSE * 0.05), pytest.approx(0.55, abs=CLOSE * 0.05))
    assert not total.note


def test_two_fractions_err_apart_and_what_one_bin_has_too_much_the_others_lack() -> None:
    joint = answer_of(0.5)
    pair = replace(
        joint, fractions=("grain", "chaff"), mass=np.full(2, 0.5), targets={"grain": ("near",), "chaff": ()},
        base=np.repeat(joint.base, 2, axis=0), change=np.repeat(joint.change, 2, axis=1),
    )  # fmt: skip
    parts = {name: {place: [part("mesh", 0.04 if place != "elsewhere" else 0.0)] for place in PLACES}
             for name in pair.fractions}  # fmt: skip
    results = dict.fromkeys(pair.fractions, NOTHING_FLOWN)
    made = in_ensemble(pair, parts, results)
    errors = made.errors["mesh"]
    np.testing.assert_allclose(errors.sum(axis=-1), 0.0, atol=1e-12)
    assert abs(np.corrcoef(errors[:, 0, 0], errors[:, 1, 0])[0, 1]) < 0.1
    for name in pair.fractions:
        assert made.own.share(name, "near").half == pytest.approx(0.04, rel=CLOSE)
        assert made.own.share(name, "near").half == pytest.approx(made.own.share(name, "far").half)
    both = made.own.number(made.own.of_share("grain", ["near", "far"]))
    assert both.half < 1e-9


def test_a_range_over_inputs_keeps_its_two_arms() -> None:
    """Errors of a normal part beside: the arms of a bent range and of it are nearly squares that add up. The ends of
    the middle 95 % of the sum lie within 6 % of the range of those.
    """
    total = total_in([part("steps", 0.04)], moved=arms(0.08, 0.03))
    assert total.low == pytest.approx(0.5 - math.hypot(0.08, 0.04), abs=0.06 * 0.08)
    assert total.high == pytest.approx(0.5 + math.hypot(0.03, 0.04), abs=0.06 * 0.08)
    assert total.error == pytest.approx(0.5 - total.low)
    assert total.numerical == pytest.approx(0.04, rel=CLOSE)  # inputs are not computed away
    alone = total_in([], moved=arms(0.08, 0.03))
    assert (0.5 - alone.low, alone.high - 0.5) == (pytest.approx(0.08, rel=CLOSE), pytest.approx(0.03, rel=CLOSE))
    told = total_in([part(INPUTS, 0.08, low=-0.08, high=0.03)], moved=arms(0.08, 0.03))
    assert (told.low, told.high) == (alone.low, alone.high)  # what the ensemble holds already is not in it twice


def test_a_bound_is_a_rectangular_distribution_and_no_part_of_computing() -> None:
    total = total_in([part("lift", 0.01, LEFT_OUT), part("steps", 0.05)])
    half = math.hypot(SIGMAS / math.sqrt(3.0) * 0.01, 0.05)
    assert total.high == pytest.approx(0.5 + half, abs=CLOSE * half)
    assert total.numerical == pytest.approx(0.05, rel=CLOSE)
    assert not total.note  # small beside the total
    alone = with_parts(answer_of(0.5), [part("lift", 0.2, LEFT_OUT)])
    assert alone.half == pytest.approx(0.95 * 0.2, rel=CLOSE)  # between two bounds nothing is likelier
    assert alone.numerical is None


def test_nothing_is_beyond_a_bound_and_nothing_within_it_likelier() -> None:
    """Of three bins too, whose errors go together."""
    parts = {"grain": {place: [part("lift", 0.1, LEFT_OUT)] for place in PLACES}}
    results = {"grain": NOTHING_FLOWN}
    errors = in_ensemble(answer_of(0.5), parts, results).errors["lift"][:, 0]
    assert np.abs(errors).max() <= 0.1 + 1e-12
    for error in errors.T:
        assert kstest(error, "uniform", (-0.1, 0.2)).statistic < 0.03
    assert np.abs(errors.sum(axis=1)).max() < 0.1


@pytest.mark.parametrize("kind", [LEFT_OUT, NOT_COMPUTED])
def test_a_row_says_when_it_is_mostly_a_bound(kind: str) -> None:
    """0.95 of a bound of 0.2, not the 0.226 of a normal part with its variance: nobody errs beyond a bound."""
    total = total_in([part("magnus", 0.2, kind), part("steps", 0.01)])
    assert total.error == pytest.approx(0.19, rel=CLOSE)
    assert "magnus" in total.note


def test_an_unknown_part_leaves_no_total_but_says_what_to_do() -> None:
    total = total_in([part("steps", 0.01), part("mesh", None)])
    assert total.error is None
    assert (total.low, total.high) == (
        pytest.approx(0.49, abs=CLOSE * 0.01),
        pytest.approx(0.51, abs=CLOSE * 0.01),
    )  # of what is known
    assert "mesh" in total.note
    assert "numerics.rung" in total.note


def test_shares_keep_within_nothing_and_everything() -> None:
    total = total_in([], 0.99, arms(0.5, 0.5))
    assert (total.low, total.high) == (pytest.approx(0.49, abs=CLOSE * 0.5), 1.0)
    assert total_in([part("steps", 0.02)], 0.0).low == 0.0


def test_a_range_that_leaves_the_answer_out_does_not_turn_its_interval_round() -> None:
    """All draws lie above the answer: nothing below it but the numerical part."""
    total = total_in([part("steps", 0.01)], moved=lambda z: 0.06 + 0.02 * z)
    assert total.low == 0.5
    # No draw of an input is farther than 2.5 standard deviations: that takes a hundredth off the half
    assert total.high == pytest.approx(0.56 + math.hypot(0.02 * SIGMAS, 0.01), abs=(CLOSE + 0.01) * 0.04)
    assert total.error == pytest.approx(total.high - 0.5)


def test_the_numerical_part_is_neither_inputs_nor_bounds() -> None:
    parts = [part(INPUTS, 0.3), part("magnus", 0.2, NOT_COMPUTED), part("steps", 0.03), part("mesh", 0.04)]
    assert numerical(parts) == pytest.approx(0.05)
    assert total_in(parts, moved=arms(0.3, 0.3)).numerical == pytest.approx(0.05, rel=CLOSE)


COUNT = 2**14
SHIFT = 0.004  # m


@pytest.fixture
def scene() -> Scene:
    return shipped("rhombus", {"numerics.rung": "none"})


def landed(x: np.ndarray, scene: Scene) -> Landings:
    """Granules on the floor at ``x`` (n,) m."""
    bins = np.full(len(x), -1)
    for number, place in enumerate(scene.bin.values()):
        (left, _), (right, _) = place.line(scene)[[0, -1]]
        bins[(x >= min(left, right)) & (x < max(left, right))] = number
    position = np.stack([x, np.full(len(x), scene.channel.bottom)], axis=1)
    return landings_in(bins, position=position, replicate=np.zeros(len(x), dtype=int))


def spread(scene: Scene, width: float) -> np.ndarray:
    """Places of granules spread normally about the middle."""
    chance = np.random.default_rng(1)
    return np.clip(width * chance.normal(size=COUNT), -0.45 * scene.channel.width, 0.45 * scene.channel.width)


@pytest.mark.parametrize(("alone", "met"), [(0.05, 0.09), (0.09, 0.05), (0.06, 0.06)])
def test_a_shift_moves_so_much_more_of_a_share(scene: Scene, alone: float, met: float) -> None:
    """Granules farther or less far apart, all shifted by the same: the factor says what that does to bins."""
    far, near = spread(scene, met), spread(scene, alone)
    among = AmongOthers(scene, {"wheat": landed(near, scene)}, {"wheat": landed(far, scene)})
    moved = []
    for x in (near, far):  # outward, as faster air or a livelier rebound would
        before, after = (landed(x + by * np.sign(x), scene).bin for by in (0.0, SHIFT))
        moved.append(np.mean(before != after))
    assert among.factor("wheat") == pytest.approx(moved[1] / moved[0], rel=0.25)


def test_few_granules_near_an_end_make_no_large_factor(scene: Scene) -> None:
    nowhere = np.full(COUNT, 0.0)
    few, many = nowhere.copy(), nowhere.copy()
    end = scene.bin["middle"].line(scene)[-1][0]
    few[:4], many[: COUNT // 2] = end, end
    alone = landed(nowhere, scene)
    assert 1.0 < AmongOthers(scene, {"a": alone}, {"a": landed(few, scene)}).factor("a") <= 1.5
    assert AmongOthers(scene, {"a": alone}, {"a": landed(many, scene)}).factor("a") == MAX_FACTOR
    assert AmongOthers(scene, {"a": landed(many, scene)}, {"a": alone}).factor("a") == 1.0 / MAX_FACTOR


def test_a_bin_that_no_draw_changes_is_not_moved_by_air_that_does_not_see_the_vibration() -> None:
    """The bound on single flights said that a third of the dust may land where none of it does in any air."""
    scene = shipped("rhombus")
    plan = make_plan(scene)
    speed = next(one for one in unknowns(scene, plan) if one.key == AIR_SPEED)
    crude = BudgetPart(VIBRATION, 0.3, 0.0, CALIBRATED, NOT_COMPUTED)
    assert swung(scene, plan, crude, NO_EFFECT, [speed]).error == 0.0
    assert swung(scene, plan, crude, NO_EFFECT, []).error == SHARES_MOVED < 0.3
    stronger = shipped("rhombus", {"vibration.gamma": 3.0})  # than was measured
    assert swung(stronger, make_plan(stronger), crude, NO_EFFECT, []).error == 0.3
