"""Shares, purities and recoveries of landings; how they go with the inputs; convergence over grids."""

import math
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm, qmc

from support import landings_in, shipped
from wakeflow.answer.budget.mesh import cell_size, estimate, extrapolate, observed_order
from wakeflow.answer.cells import LandingCells
from wakeflow.answer.draws import DRAWS, ErrorSource, columns
from wakeflow.answer.joint import Bins, JointAnswer, effects_in
from wakeflow.answer.separation import change_of, changed, joint_answer, responses, separate
from wakeflow.answer.shares import InputPart
from wakeflow.answer.spread import share_interval
from wakeflow.core.errors import SceneError
from wakeflow.core.number import Number
from wakeflow.flight.stages.input_samples import DrawnLandings, InputSamples
from wakeflow.planning.unknowns import FARTHEST, SIGMAS, Dependence, Unknown
from wakeflow.scene import Scene


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "vacuum.toml").replace(
        {"fraction.soft.mass_share": 0.25, "fraction.hard.mass_share": 0.75, "feed.rate": "3600 kg/hour"}
    )


def test_shares_purity_recovery_throughput(scene: Scene) -> None:
    soft = np.repeat([0, 1, -1, 0], 160)  # half near, a quarter far, a quarter elsewhere
    hard = np.repeat([1, 1, 1, 0], 160)
    found = separate(scene, {"soft": landings_in(soft), "hard": landings_in(hard)})
    assert found.bins == ("near", "far", "elsewhere")
    shares = [found.fractions["soft"][place].value for place in found.bins]
    assert shares == pytest.approx([0.5, 0.25, 0.25], rel=1e-14)  # sums of cells
    for shares in found.fractions.values():
        assert sum(share.value for share in shares.values()) == pytest.approx(1.0)
        assert all(share.low <= share.value <= share.high for share in shares.values())
    recovery, purity = found.recovery["soft"], found.purity["near"]
    assert recovery.value == pytest.approx(0.5, rel=1e-14)
    near_soft, near_hard = 0.25 * 0.5, 0.75 * 0.25
    assert purity["soft"].value == pytest.approx(near_soft / (near_soft + near_hard))
    assert found.throughput["near"] == pytest.approx(3600 * (near_soft + near_hard))
    assert sum(found.throughput.values()) == pytest.approx(3600)


def test_an_empty_bin_has_no_purity_and_still_an_upper_limit(scene: Scene) -> None:
    found = separate(scene, {"soft": landings_in(np.zeros(640, int)), "hard": landings_in(np.zeros(640, int))})
    assert found.purity["far"] is None
    assert found.fractions["soft"]["far"].value == 0.0
    assert 0.003 < found.fractions["soft"]["far"].high < 0.01  # Wilson: z^2 / (n + z^2) = 0.006


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        samples = rng.binomial(64, 0.3, size=16) / 64
        _, low, high = share_interval(samples, 1024)
        covered += low <= 0.3 <= high
    assert 0.92 <= covered / 400 <= 0.98


def test_balanced_samples_do_not_pretend_to_be_exact() -> None:
    """With the real sampler: the interval of a share covers it at least as often as it says, for cuts anywhere."""
    from wakeflow.flight.feed.feedstock import samples

    covered = total = 0
    for seed in range(40):
        points, replicate = samples("a", 1024, seed)
        for cut in (0.2503, 0.5, 0.61, 0.013):
            shares = np.array([np.mean(points[replicate == r, 0] < cut) for r in range(16)])
            _, low, high = share_interval(shares, len(points))
            covered += low <= cut <= high
            total += 1
    assert covered / total >= 0.95


def test_purity_of_a_nearly_pure_bin_admits_what_was_not_seen(scene: Scene) -> None:
    """Truth 0.957: few granules of the rarer fraction reach the bin, often none; the interval must still hold it."""
    rng = np.random.default_rng(3)
    n, p_soft, p_hard = 4096, 0.01, 5e-5
    truth = 0.25 * p_soft / (0.25 * p_soft + 0.75 * p_hard)
    covered = 0
    for _ in range(60):
        soft, hard = (np.where(rng.random(n) < p, 1, 0) for p in (p_soft, p_hard))
        purity = separate(scene, {"soft": landings_in(soft), "hard": landings_in(hard)}).purity["far"]
        low, high = purity["soft"].low, purity["soft"].high
        assert high is not None
        covered += low <= truth <= high
    assert covered >= 54


FLOWN = 64  # draws, as many as a run flies
FIRST, SECOND = 0.12, 0.3  # m: ends of the bins near and far on the floor of the shipped vacuum


def points(dimensions: int, seed: int) -> np.ndarray:
    """Where draws lie, as in ``flight.stages.input_samples``."""
    sobol = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    return np.clip(norm.ppf(sobol.random(FLOWN)), -FARTHEST, FARTHEST)


def fresh(dimensions: int, seed: int, count: int = 2000) -> np.ndarray:
    """Draws that nobody flew."""
    return np.clip(np.random.default_rng([9, seed]).standard_normal((count, dimensions)), -FARTHEST, FARTHEST)


def known(*kinds: str) -> tuple[Unknown, ...]:
    return tuple(Unknown(f"number-{i}", kind, 1.0, 0.1, 0.1, "1", "the test") for i, kind in enumerate(kinds))


def of_one_fraction(name: str, fraction: str) -> Scene:
    """A shipped scene without air that feeds one of its fractions alone."""
    tables = shipped(name, {"numerics.rung": "none"}).tables()
    return Scene.parse({**tables, "fraction": {fraction: {**tables["fraction"][fraction], "mass_share": 1.0}}})


ONE, PAIR = of_one_fraction("vacuum", "soft"), of_one_fraction("rhombus", "wheat")


def on_floor(x: np.ndarray, scene: Scene) -> DrawnLandings:
    """Granules that land at x (...) m on the floor."""
    bins = np.full(x.shape, -1, dtype=np.int16)
    for number, place in enumerate(scene.bin.values()):
        bins[(x > place.start) & (x <= place.to)] = number
    return DrawnLandings(np.stack([x, np.full_like(x, scene.channel.bottom)], axis=-1).astype(np.float32), bins)


def answered(
    z: np.ndarray, own: np.ndarray, then: np.ndarray, answer: np.ndarray | None = None, scene: Scene = ONE,
    kinds: tuple[str, ...] = (),
) -> Bins:  # fmt: skip
    """The answer of granules at ``answer`` (n,) m on the floor, of which those at ``own`` (R, M) land at ``then`` (R,
    M) in the draws at z: with what the inputs change of it, and no other source of error.
    """
    (name,) = scene.fraction
    numbers = known(*(kinds or ("size",) * z.shape[1]))
    draws = InputSamples(numbers, z, {name: on_floor(then, scene)}, {name: on_floor(own, scene)})
    every = on_floor(own.ravel() if answer is None else answer, scene)
    landings = {name: landings_in(every.bin, position=every.position.astype(float))}
    inputs = changed(scene, numbers, Dependence(tuple(numbers), np.eye(len(numbers))), responses(scene, draws))
    return joint_answer(scene, landings, inputs=inputs).own


def share_in(own: Bins, *places: str) -> Number:
    return own.number(own.of_share(own.joint.fractions[0], places))


def effects_on(own: Bins, *places: str) -> dict[str, InputPart]:
    return own.effects(own.of_share(own.joint.fractions[0], places), own.joint.fractions[0])


def normal_places(count: int, wide: float) -> np.ndarray:
    """Places (count,) that are spread as a normal distribution is."""
    return np.asarray(wide * norm.ppf((np.arange(count) + 0.5) / count))


def test_a_straight_response_has_the_range_of_a_sum_of_normal_numbers() -> None:
    """Granules that lie evenly over the end of a bin and are shifted: their share in it goes straight."""
    slopes, density = np.array([4e-3, -1e-2, 0.0, 2e-3]), 2.5  # of a share, and of the granules per m
    z, even = points(4, 1), np.tile((np.arange(1024) + 0.5) / 1024 / density - 0.1, (FLOWN, 1))
    found = answered(z, even, even + (z @ slopes)[:, None] / density)
    _, low, high = share_in(found, "far")
    value, half = 0.45, SIGMAS * float(np.linalg.norm(slopes))  # the ends of 2048 draws are known to 3 % of the half
    assert (value - low, high - value) == pytest.approx((half, half), rel=0.05)
    effects = effects_on(found, "far")
    key, first = next(iter(effects.items()))
    assert key == "number-1"
    assert first.rise == pytest.approx(-SIGMAS * 1e-2, rel=0.02)  # read by a regression on them, known to 0.5 %
    assert first.variance == pytest.approx(100.0 / 120.0, abs=0.06)  # of the draws' own variances
    assert sum(effect.variance for effect in effects.values()) == pytest.approx(1.0, abs=0.03)
    assert effects["number-2"].half < 1e-3 * half  # it does nothing
    assert share_in(found, "near", "far", "elsewhere").half < 1e-9


def test_what_never_changes_has_no_range() -> None:
    still = np.tile(np.linspace(0.001, 0.29, 64), (FLOWN, 1))
    found = answered(points(3, 1), still, still)
    assert np.ptp(share_in(found, "near")) < 1e-9
    assert effects_on(found, "near") == {}


@pytest.mark.parametrize("granules", [32, 128])
def test_few_granules_a_draw_are_no_part_of_the_range(granules: int) -> None:
    """The change of a share from few granules, each in the bin or not by chance: over many tries the ranges hold what
    they say of the response itself, though the changes scatter by more.
    """
    slopes, held = np.array([0.04, 0.03, 0.02, 0.01, 0.01]), []
    spread = float(np.linalg.norm(slopes))

    def landed(inside: np.ndarray, chance: np.random.Generator) -> np.ndarray:
        """Anywhere in the bin near, or anywhere on the floor beside it."""
        return np.where(inside, *(chance.uniform(*ends, inside.shape) for ends in ((1e-3, 0.119), (-0.29, -1e-3))))

    answer = landed(np.arange(4000) < 1200, np.random.default_rng(0))
    for seed in range(20):
        z, chance = points(5, seed), np.random.default_rng(seed)
        own = landed(np.tile(np.arange(granules) < round(0.3 * granules), (FLOWN, 1)), chance)
        then = landed(chance.random((FLOWN, granules)) < (0.3 + z @ slopes)[:, None], chance)
        low, high = (np.array(share_in(answered(z, own, then, answer), "near")[1:]) - 0.3) / spread
        held.append(norm.cdf(high) - norm.cdf(low))
    assert 0.93 <= np.mean(held) <= 0.975


@pytest.mark.parametrize("scene", [ONE, PAIR], ids=["one side", "two equal sides"])
def test_what_inputs_change_of_bins_is_the_sum_of_their_cells(scene: Scene) -> None:
    (name,) = scene.fraction
    numbers, z = known("size", "restitution"), points(2, 3)
    own = np.broadcast_to(0.02 + normal_places(128, 0.03), (len(z), 128))
    then = on_floor(own + 0.01 * (z[:, :1] + z[:, 1:] ** 2), scene)
    how = responses(scene, InputSamples(numbers, z, {name: then}, {name: on_floor(own, scene)}))[name]
    at = fresh(2, 4)[:200]
    (cells, doubt), (bins, same) = (change_of(scene, numbers, name, how, at, by_bin=one) for one in (False, True))
    np.testing.assert_allclose(bins, cells @ how.cells.parts(), atol=1e-9)
    np.testing.assert_array_equal(doubt, same)
    assert np.ptp(bins, axis=0).max() > 0.1


def test_the_range_holds_what_it_says_of_responses_that_are_not_straight() -> None:
    """Shares in a bin of granules that land about a place which the inputs move, some of them by bends: over many such
    bins 93 to 97.5 % of fresh draws lie within.
    """
    held = []
    for seed in range(24):
        chance = np.random.default_rng(seed)
        many = int(chance.integers(5, 12))
        slopes = chance.normal(size=many) * np.exp(chance.normal(size=many))
        slopes *= math.exp(chance.uniform(-2.0, 0.4)) / np.linalg.norm(slopes)
        bends = np.outer(slopes, slopes) * chance.normal(size=(many, many)) * 0.2
        spread, edge = math.exp(chance.uniform(-1.5, 0.7)), chance.normal()
        grains, z = normal_places(128, spread) - edge, points(many, seed)  # 1 is 20 mm

        def shift(z: np.ndarray, slopes=slopes, bends=bends) -> np.ndarray:
            return z @ slopes + ((z @ bends) * z).sum(axis=1)

        own, then = (np.clip(FIRST + 0.02 * (grains + by[:, None]), -0.29, 0.299) for by in (0.0 * z[:, 0], shift(z)))
        _, low, high = share_in(answered(z, own, then), "far")
        share = (grains + shift(fresh(many, seed))[:, None] > 0.0).mean(axis=1)
        held.append(np.mean((share > low - 1e-4) & (share < high + 1e-4)))
    assert 0.93 <= np.mean(held) <= 0.975


@pytest.mark.parametrize(("anew", "steadier"), [(False, 0.5), (True, 1.1)])
def test_the_change_of_a_share_is_the_density_at_an_end_times_the_shift(anew: bool, steadier: float) -> None:
    """Few granules a draw, each shifted with the inputs, or also landing anew by chance: over many tries the half is
    that of the whole distribution, and scatters by half of that of counts. What lands anew shows no shift; a regression
    of shares is left, which scatters as counts do: their own granules are of chance too.
    """
    slopes, wide, halves, counted = np.array([4e-3, 2e-3, 0.0, 0.0, 0.0]), 0.02, [], []
    answer = 0.11 + normal_places(4096, wide)
    for seed in range(20):
        z, chance = points(5, seed), np.random.default_rng(seed)
        x = 0.11 + wide * chance.normal(size=(FLOWN, 64))
        then = (0.11 + wide * chance.normal(size=x.shape) if anew else x) + (z @ slopes)[:, None]
        found = answered(z, x, then, answer)
        halves.append(share_in(found, "far").half)
        moved = np.mean((then > FIRST) * 1.0 - (x > FIRST), axis=1)
        line, *_ = np.linalg.lstsq(np.column_stack([np.ones(FLOWN), z]), moved, rcond=None)
        counted.append(SIGMAS * np.linalg.norm(line[1:]))
    ends = np.quantile(norm.sf((FIRST - 0.11 - fresh(5, 0, 20000) @ slopes) / wide), [0.025, 0.975])
    # Of granules that land anew few draws leave the response itself unknown by some per cent, which is in the range
    assert np.mean(halves) == pytest.approx(0.5 * np.ptp(ends), rel=0.12 if anew else 0.06)
    assert np.std(halves) < steadier * np.std(counted)
    assert share_in(found, "near").half == pytest.approx(halves[-1], rel=0.05)
    assert share_in(found, "near", "far", "elsewhere").half < 1e-9


def test_draws_of_a_machine_and_of_its_image_are_pooled() -> None:
    """Granules on either side of a body, thrown farther by one input and all to the right by the feed's position: both
    sides have one range, less known from either alone; the middle does not go with the position.
    """
    side, rises = np.repeat([-0.08, 0.08], 1024), {True: [], False: []}
    answer = side + np.tile(normal_places(1024, 0.02), 2)
    beside = PAIR.replace({"feed.position": 1e-3})
    assert (PAIR.images, beside.images) == ((0, 2, 1, 4, 3, 5), ())
    for seed in range(10):
        z, chance = points(2, seed), np.random.default_rng(seed)
        x = 0.08 * np.where(chance.random((FLOWN, 64)) < 0.5, -1.0, 1.0) + 0.02 * chance.normal(size=(FLOWN, 64))
        then = x + 4e-3 * np.sign(x) * z[:, :1] + 2e-3 * z[:, 1:]
        for mirrored_mean, scene in ((True, PAIR), (False, beside)):
            found = answered(z, x, then, answer, scene, ("size", "feed_position"))
            rises[mirrored_mean].append(effects_on(found, "inner-left")["number-0"].rise)
            if mirrored_mean:
                both = found
    left, right, middle = (effects_on(both, place) for place in ("inner-left", "inner-right", "middle"))
    for place in ("inner", "outer"):
        assert share_in(both, f"{place}-left") == share_in(both, f"{place}-right")
    size, position = left["number-0"], left["number-1"]
    assert size.rise == pytest.approx(right["number-0"].rise, rel=0.02)  # the draws are no images of each other
    assert middle["number-1"].half < 0.01 * middle["number-0"].half
    sides = share_in(both, "inner-left", "inner-right", "outer-left", "outer-right", "elsewhere")
    assert sides.half == pytest.approx(share_in(both, "middle").half)
    assert np.mean(rises[True]) == pytest.approx(np.mean(rises[False]), rel=0.05)
    assert np.std(rises[True]) < 0.85 * np.std(rises[False])
    assert position.rise == pytest.approx(-right["number-1"].rise, rel=0.05)
    assert position.rise == pytest.approx(-0.5 * size.rise, rel=0.2)


def test_the_answer_of_many_fractions_is_there_at_once() -> None:
    """Each of n purities rests on all n shares: 300 fractions took 90 000 regressions a bin."""
    count, chance = 300, np.random.default_rng(7)
    names, cells = tuple(f"f{i}" for i in range(count)), LandingCells.of(ONE, count)
    assert cells.count * count < 4000
    keys = ("air.speed", "fraction.f0.size")
    z, base = columns(keys), np.tile(chance.dirichlet(np.ones(cells.count)), (count, 1))
    way = np.zeros(cells.count)
    way[cells.first["floor"] + np.array([0, len(cells.edges["floor"]) - 2])] = -1.0, 1.0  # from elsewhere into far
    change = np.broadcast_to(0.02 * z[:, :1, None] * way, (DRAWS, count, cells.count)).astype(np.float32)
    change[:, 0] = 0.0  # f0 stays where it is
    sampling = ErrorSource("sampling", np.zeros((count, 3, 1)), together=True)
    many = JointAnswer(
        names, np.full(count, 1.0 / count), dict.fromkeys(names, ("far",)), 1.0, cells, (), keys, z, base, change,
        (sampling,),
    ).own  # fmt: skip
    began = time.thread_time()
    found, (shares, of_targets) = many.separation(), effects_in(many)
    assert time.thread_time() - began < 20.0  # s; 5 on one core of 2024
    still, *others = (found.purity["far"][name].half for name in names)
    assert still > 5 * others[0] > 0.0  # the others move alike, and with the sum
    assert others == pytest.approx(others[:1] * (count - 1))
    assert next(iter(of_targets["purity.far.f0"])) == "air.speed"
    assert shares["f0"] == {}
    assert len(of_targets) == 2 * count


def test_the_two_sides_of_a_mirrored_machine_have_one_share_and_interval() -> None:
    scene, chance = shipped("rhombus"), np.random.default_rng(2)
    places = chance.choice(6, size=16 * 64, p=[0.2, 0.1, 0.1, 0.3, 0.3, 0.0])
    landing = landings_in(np.where(places < 5, places, -1), replicate=np.arange(16).repeat(64))
    found = separate(scene, dict.fromkeys(scene.fraction, landing)).fractions["wheat"]
    beside = separate(scene.replace({"feed.position": 1e-3}), dict.fromkeys(scene.fraction, landing)).fractions["wheat"]
    for side in ("inner", "outer"):
        assert found[f"{side}-left"] == found[f"{side}-right"]
        alone = [beside[f"{side}-{which}"] for which in ("left", "right")]
        assert found[f"{side}-left"].value == pytest.approx(0.5 * (alone[0].value + alone[1].value))
        assert found[f"{side}-left"].half < max(one.half for one in alone)
    assert found["middle"].value == beside["middle"].value
    # The ends of other draws, of roots that go together otherwise: 2048 of them tell these to 3 % of the half
    for end in ("low", "high"):
        apart = abs(getattr(found["middle"], end) - getattr(beside["middle"], end))
        assert apart < 0.05 * beside["middle"].half


# NASA's "spatconv" tutorial: pressure recovery of an inlet on three grids
NASA = ([1.0, 2.0, 4.0], [0.97050, 0.96854, 0.96178])
# Celik et al. 2008, table 1: backward-facing step; cell counts 18000, 8000, 4500 and 18000, 4500, 980
CELIK = ([1.0, 1.5, 1.5 * 4 / 3], [6.063, 5.972, 5.863])
CELIK_SLOW = ([1.0, 2.0, 2.0 * 2.143], [10.7880, 10.7250, 10.6050])
CELIK_OSCILLATING = ([1.0, 2.0, 2.0 * 2.143], [6.0042, 5.9624, 6.0909])


def test_nasa_example() -> None:
    found = estimate(*NASA)
    assert found.kind == "richardson"
    assert found.order == pytest.approx(1.786170, abs=1e-6)
    assert found.extrapolated == pytest.approx(0.971300, abs=1e-6)
    assert 100 * found.gci_fine / 0.97050 == pytest.approx(0.103083, abs=1e-6)
    assert 100 * found.gci_coarse / 0.96854 == pytest.approx(0.356249, abs=1e-6)
    assert found.asymptotic == pytest.approx(0.356249 * 0.96854 / (2**1.786170 * 0.103083 * 0.97050), rel=1e-5)
    assert (found.low, found.value, found.high) == pytest.approx((0.9695, 0.9705, 0.9715), abs=1e-5)


def test_celik_example_with_unequal_ratios() -> None:
    found = estimate(*CELIK)
    assert found.order == pytest.approx(1.53, abs=0.01)
    assert found.extrapolated == pytest.approx(6.1685, abs=2e-3)
    assert 100 * found.gci_fine / 6.063 == pytest.approx(2.17, abs=0.03)


def test_celik_example_below_first_order() -> None:
    found = estimate(*CELIK_SLOW)
    assert found.order == pytest.approx(0.75, abs=0.01)
    assert found.extrapolated == pytest.approx(10.8801, abs=1e-3)
    assert 100 * found.gci_fine / 10.788 == pytest.approx(1.1, abs=0.05)


def test_oscillating_values_give_three_times_their_range() -> None:
    found = estimate(*CELIK_OSCILLATING)
    assert found.kind == "range-oscillating"
    assert math.isnan(found.order)
    half = 3 * (6.0909 - 5.9624)
    assert (found.low, found.value, found.high) == pytest.approx((6.0042 - half, 6.0042, 6.0042 + half), rel=1e-12)
    assert "3 times the range" in found.why


def test_an_order_above_the_formal_one_enters_the_index_as_the_formal_one() -> None:
    """LandingCells 1.5 apart, order 2.45: 1.25 |f1 - f2| / (1.5^p - 1) is 0.037 with that order, 0.050 with 2."""
    near, sizes = 0.05, [1.0, 1.5, 2.25]
    values = [1.0, 1.0 - near, 1.0 - near - near * 1.5**2.45]
    found = estimate(sizes, values)
    assert found.order == pytest.approx(2.45, rel=1e-9)
    assert 1.25 * near / (1.5**found.order - 1) == pytest.approx(0.037, abs=5e-4)
    assert found.gci_fine == pytest.approx(0.050, rel=1e-9)
    assert found.high - found.value == pytest.approx(0.050, rel=1e-9)
    assert found.extrapolated == pytest.approx(1.0 + near / (1.5**2 - 1), rel=1e-12)
    assert found.asymptotic == pytest.approx(1.5**0.45, rel=1e-9)
    assert "counted as 2" in found.why
    third = estimate(sizes, values, formal=3.0)
    assert third.gci_fine == pytest.approx(1.25 * near / (1.5**2.45 - 1), rel=1e-9)


@pytest.mark.parametrize("order", [0.6, 1.0, 1.7, 2.0])
@pytest.mark.parametrize("ratios", [(1.2, 1.2), (1.5, 2.0), (2.0, 1.3)])
def test_a_power_law_gives_its_order_and_limit(order: float, ratios: tuple[float, float]) -> None:
    sizes = [0.1, 0.1 * ratios[0], 0.1 * ratios[0] * ratios[1]]
    values = [3.0 - 0.5 * h**order for h in sizes]
    assert observed_order(sizes, values) == pytest.approx(order, rel=1e-9)
    found = estimate(sizes[::-1], values[::-1])  # any sequence
    assert found.kind == "richardson"
    assert found.extrapolated == pytest.approx(3.0, rel=1e-12)
    assert found.value == values[0]
    assert found.low < values[0] < 3.0 < found.high
    assert found.high - found.value == pytest.approx(1.25 * (3.0 - values[0]), rel=1e-9)
    assert found.asymptotic == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize(("order", "times"), [(0.2, 3.0), (3.5, 1.25)])
def test_implausible_orders_give_a_multiple_of_the_range(order: float, times: float) -> None:
    values = [1.0 + 0.5 * h**order for h in (1.0, 1.5, 2.25)]
    found = estimate([1.0, 1.5, 2.25], values)
    assert found.kind == "range-oscillating"
    assert "order" in found.why
    half = times * (max(values) - min(values))
    assert (found.low, found.high) == pytest.approx((values[0] - half, values[0] + half), rel=1e-12)
    assert estimate([1.0, 1.5, 2.25], values, formal=4.0).kind == ("richardson" if order > 3 else "range-oscillating")


def test_diverging_values_give_three_times_their_range() -> None:
    assert math.isnan(observed_order([1, 2, 4], [1.0, 1.5, 1.6]))
    found = estimate([1, 2, 4], [1.0, 1.5, 1.6])
    assert found.kind == "range-oscillating"
    assert "do not shrink" in found.why
    assert (found.low, found.high) == pytest.approx((1.0 - 1.8, 1.0 + 1.8))


def test_two_grids_assume_the_order_and_take_factor_three() -> None:
    found = estimate([1.0, 1.5], [2.0, 2.1])
    assert found.kind == "two-grid"
    assert math.isnan(found.order)
    assert found.high - found.value == pytest.approx(3 * 0.1 / (1.5**2 - 1))
    assert found.extrapolated == pytest.approx(extrapolate([1.0, 1.5], [2.0, 2.1], 2.0))


def test_noise_above_a_third_of_the_difference_forbids_extrapolation() -> None:
    sizes, values = [1.0, 2.0, 4.0], [1.01, 1.04, 1.16]
    quiet = estimate(sizes, values, [0.009, 0.002, 0.002])
    assert quiet.kind == "richardson"
    exact = estimate(sizes, values)
    assert exact.gci_fine is not None
    assert quiet.high - quiet.value == pytest.approx(np.hypot(exact.gci_fine, 0.009))
    loud = estimate(sizes, values, [0.011, 0.002, 0.002])
    assert loud.kind == "range-statistics"
    assert (loud.low, loud.high) == pytest.approx((0.999, 1.162))
    assert "0.011" in loud.why


def test_of_two_grids_noise_is_added_to_what_they_differ_by() -> None:
    """The difference counts with its square less the variance that is chance alone."""
    noises = np.array([0.5, 0.11, 0.09, 0.01, 0.0])
    halves = [estimate([1.0, 1.5], [2.0, 2.1], [0.0, noise]) for noise in noises]
    bands = [found.high - found.value for found in halves]
    gci = 3 / (1.5**2 - 1) * np.sqrt(np.maximum(0.0, 0.1**2 - (noises / SIGMAS) ** 2))
    assert bands == pytest.approx(np.hypot(gci, noises).tolist())
    assert bands[0] == 0.5  # all of the difference may be chance
    assert [math.isnan(found.extrapolated) for found in halves] == [True, True, False, False, False]
    assert all(found.why.startswith("statistical half width") for found in halves[:2])
    chance = np.random.default_rng(1).normal(0.0, 0.09 / SIGMAS, 20000)  # of grids that are alike
    alike = [estimate([1.0, 1.5], [2.0, 2.0 + one], [0.0, 0.09]) for one in chance]
    assert halves[2].noise == pytest.approx(np.sqrt(np.mean([(one.high - 2.0) ** 2 for one in alike])), rel=0.02)
    same = estimate([1.0, 1.5], [1.0, 1.0], [1e-3, 1e-3])
    assert same.high - same.value == pytest.approx(np.hypot(1e-3, 1e-3))


def test_statistical_intervals_are_inside_the_band() -> None:
    found = estimate([1, 2, 4], [1.0, 1.2, 1.1], [0.01, 0.02, 0.01])
    assert found.kind == "range-oscillating"
    assert found.high - found.value == pytest.approx(np.hypot(3 * 0.2, 0.01))
    assert found.value - found.low == pytest.approx(np.hypot(3 * 0.2, 0.01))


def test_grids_that_agree_have_no_error() -> None:
    found = estimate([1, 2, 4], [1.0, 1.0, 1.0])
    assert (found.low, found.value, found.high) == (1.0, 1.0, 1.0)
    zero = estimate([1, 2, 4], [0.0, 0.0, 0.0])
    assert (zero.low, zero.high) == (0.0, 0.0)


def test_only_the_three_finest_count() -> None:
    assert estimate([8, 4, 2, 1], [9.9, *NASA[1][::-1]]).order == pytest.approx(1.786170, abs=1e-6)


@pytest.mark.parametrize(
    ("sizes", "values", "words"),
    [
        ([1.0], [1.0], "at least two"),
        ([1.0, 1.05], [1.0, 1.1], "at least 1.1 times"),
        ([1.0, 2.0], [1.0, 1.1, 1.2], "as many"),
        ([1.0, 2.0], [1.0, float("nan")], "finest first"),
        ([0.0, 2.0], [1.0, 1.1], "finest first"),
    ],
)
def test_what_is_no_grid_study_is_refused(sizes: list[float], values: list[float], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        estimate(sizes, values)


def test_cell_size_is_the_edge_of_the_mean_cell() -> None:
    assert cell_size(2.0, 800) == pytest.approx(0.05)
