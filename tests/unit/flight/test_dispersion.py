"""Dispersion by turbulence, residence times of tracers, momentum handed to the air."""

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from scipy.stats import chi2

from proofs.airflow.residence import LONGEST, ResidenceTime, residence_time
from proofs.problems.exact import box
from support import DENSITY, G, field_of, with_tau
from wakeflow.air.field import FlowField
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import Boxes
from wakeflow.flight import Body, Collisions, Fate, Granules, Tracks, driver, track
from wakeflow.flight.stages.gathered_force import force_on_the_air
from wakeflow.laws.turbulence import LIFETIME

HEIGHT = 1.0


def closed_box(cells: int, k: object, dissipation: object) -> tuple[FlowField, list[Body]]:
    """Still mean air in a unit box with walls that reflect; k and dissipation of the height y."""
    points, triangles = box(cells, low=0.0, high=HEIGHT)
    y = points[:, 1]
    field = FlowField.from_arrays(points, triangles, 0 * points, k=k(y), dissipation=dissipation(y))  # type: ignore[operator]
    t = 0.1
    corners = [(-t, -t, 1 + t, 0.0), (-t, 1.0, 1 + t, 1 + t), (-t, 0.0, 0.0, 1.0), (1.0, 0.0, 1 + t, 1.0)]
    walls = [Body(np.array([[a, b], [c, b], [c, d], [a, d]]), restitution=1.0, friction=0.0) for a, b, c, d in corners]
    return field, walls


def tracers(count: int, seed: int = 3) -> Granules:
    rng = np.random.default_rng(seed)
    return Granules(rng.uniform(1e-3, 1 - 1e-3, (count, 2)), np.zeros((count, 2)), diameter=1e-6, density=1000.0)


def profile(y: np.ndarray) -> np.ndarray:
    """k from 0.06 at the walls to 1.5 in the middle: the deviation changes by a factor of five."""
    return 1.5 * (0.2 + 0.8 * np.sin(np.pi * y)) ** 2


@pytest.mark.parametrize("life", [0.02, 0.2])
def test_tracers_stay_well_mixed_in_uneven_turbulence(life: float) -> None:
    """Thomson (1987): what fills a box evenly goes on doing so. Without the drift it gathers at the walls."""
    field, walls = closed_box(24, profile, lambda y: LIFETIME * profile(y) / life)
    count, bins = 4000, 10
    tracks = track(
        field,
        tracers(count),
        until=1.0,
        forces=("drag", "dispersion"),
        bodies=walls,
        tolerance=1e-3,
        length=1.0,
        seed=5,
    )
    assert np.all(tracks.fate == Fate.AIRBORNE)
    found, _ = np.histogram(tracks.position[:, 1], bins=bins, range=(0, HEIGHT))
    statistic = np.sum((found - count / bins) ** 2 / (count / bins))
    assert statistic < chi2.ppf(0.999, bins - 1), found


LIFE, LATE = 0.05, 1.0  # s


def spread(slip: float, noise: float, monkeypatch: pytest.MonkeyPatch, seed: int = 1) -> np.ndarray:
    """Variances (across, along the fall) of granules that fall at ``slip`` m/s in even turbulence of rms 1 m/s, over
    those of tracers.
    """
    monkeypatch.setattr(driver, "NOISE_STEP", noise)
    return carried(slip, seed=seed).var(axis=0) / (2 * LIFE * (LATE - LIFE))


def carried(slip: float, density: float = 1000.0, count: int = 4000, **more: Any) -> np.ndarray:
    """Where such granules of 20 um are at the end."""
    life, until = LIFE, LATE
    points, triangles = box(8, low=-20.0, high=20.0)
    k = np.full(len(points), 1.5)
    field = FlowField.from_arrays(points, triangles, 0 * points, k=k, dissipation=LIFETIME * k / life)
    grains = Granules(np.zeros((count, 2)), np.tile([0.0, -slip], (count, 1)), diameter=2e-5, density=density)
    tau = density * 4e-10 / (18 * field.viscosity)
    tracks = track(
        field, grains, until=until, forces=("drag", "gravity", "dispersion"), drag="stokes",
        gravity=(0.0, -slip / tau), length=1.0, **{"tolerance": 1e-4, **more},
    )  # fmt: skip
    assert np.all(tracks.fate == Fate.AIRBORNE)
    return tracks.position


def test_the_spread_does_not_depend_on_the_intervals_of_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    fine, coarse = (
        np.mean([spread(0.0, noise, monkeypatch, seed=seed) for seed in range(8)], axis=0) for noise in (0.05, 0.4)
    )
    np.testing.assert_allclose(fine, coarse, rtol=0.045)  # 32 000 granules: 0.8 % each


def test_granules_that_fall_through_eddies_spread_less_and_least_across(monkeypatch: pytest.MonkeyPatch) -> None:
    """Csanady (1963): K along = rms^2 T / sqrt(1 + b^2), across = rms^2 T / sqrt(1 + 4 b^2), b = 0.8 slip / rms."""
    slip = 4.0
    across, along = spread(slip, 0.1, monkeypatch)
    b = 0.8 * slip
    assert along == pytest.approx(1 / np.sqrt(1 + b * b), rel=0.06)
    assert across == pytest.approx(1 / np.sqrt(1 + 4 * b * b), rel=0.06)


@pytest.mark.parametrize("stokes", [0.2, 1.0, 5.0])
def test_what_lags_behind_eddies_without_falling_crosses_none(stokes: float) -> None:
    """x = int u(s) (1 - exp((s - t) / tau)) ds of air whose fluctuation lives for its own lifetime: the slip that the
    eddies themselves make is none through them. As a slip it took a third of the spread.
    """
    found = carried(0.0, density=40_600.0 * stokes, tolerance=1e-3, seed=1).var(axis=0)
    s = np.linspace(0.0, LATE, 1001)
    weight = 1 - np.exp((s - LATE) / (stokes * LIFE))
    kept = np.exp(-np.abs(s[:, None] - s) / LIFE)
    assert found == pytest.approx(weight @ kept @ weight * (s[1] - s[0]) ** 2, rel=0.12)


@pytest.mark.parametrize(("density", "part"), [(1.0, 0.01), (1000.0, 0.2), (40_600.0, 0.5)])
def test_intervals_twice_as_long_see_the_same_brownian_path(density: float, part: float) -> None:
    """The variance of the difference, over that of two flights that chance alone tells apart."""
    own, longer, other = (
        carried(0.0, density, tolerance=1e-3, **more) for more in ({"seed": 1}, {"seed": 1, "noises": 2}, {"seed": 2})
    )
    assert np.all((longer - own).var(axis=0) < part * (other - own).var(axis=0))
    assert longer.var(axis=0) == pytest.approx(own.var(axis=0), rel=0.1)
    with pytest.raises(SceneError, match="noises = 3: 1 or 2"):
        carried(0.0, seed=1, noises=3)


def test_random_forces_are_bit_identical_for_any_threads_and_company() -> None:
    field, walls = closed_box(12, profile, lambda y: 10.0 * profile(y))
    grains = tracers(1500)
    forces = ("drag", "dispersion", "brownian")
    arguments = {"until": 0.3, "forces": forces, "bodies": walls, "tolerance": 1e-3, "length": 1.0}
    alone = track(field, grains, workers=1, seed=9, **arguments)  # type: ignore[arg-type]
    many = track(field, grains, workers=3, seed=9, **arguments)  # type: ignore[arg-type]
    np.testing.assert_array_equal(alone.position, many.position)
    first = track(field, grains[:700], workers=2, seed=9, **arguments)  # type: ignore[arg-type]
    np.testing.assert_array_equal(alone.position[:700], first.position)
    other = track(field, grains[:700], seed=10, **arguments)  # type: ignore[arg-type]
    assert np.all(np.any(other.position != first.position, axis=1))


def test_calm_air_disperses_nothing() -> None:
    field, walls = closed_box(6, lambda y: 0 * y, lambda y: 0 * y)
    grains = tracers(50)
    still = track(field, grains, until=0.5, forces=("drag",), bodies=walls, length=1.0)
    noisy = track(field, grains, until=0.5, forces=("drag", "dispersion"), bodies=walls, length=1.0)
    np.testing.assert_allclose(noisy.position, still.position, atol=1e-12)


WIDTH = 0.5  # m
PLATE = np.array([[-0.25, 0.0], [0.25, 0.0], [0.25, 0.01], [-0.25, 0.01]])  # m, its rear is y = 0 in downward air
SPEED = 2.0  # m/s
FAR = 2 * SPEED / WIDTH  # 1/s, of a decay with H = 0.5


def exponential(rate: float, scale: float = 1.0, **more: Any) -> FlowField:
    """Stagnation flow away from the plate's rear: what fills the box thins out as exp(-rate t), exactly."""
    return field_of(lambda x: rate * np.stack([-x[:, 0], x[:, 1]], axis=1), n=4, low=-2 * scale, high=2 * scale, **more)


def found(
    field: Any, speed: float = SPEED, direction: Literal["down", "up"] = "down", outline: Any = PLATE, **more: Any
) -> ResidenceTime:
    return residence_time(field, outline, direction, speed, **{"count": 1024, **more})


@pytest.mark.parametrize("rate", [0.5, FAR])
def test_an_exponential_decay_is_found_with_its_interval(rate: float) -> None:
    result = found(exponential(rate))
    assert result.value == pytest.approx(SPEED / WIDTH / rate, rel=0.1)
    assert result.low < SPEED / WIDTH / rate < result.high
    assert result.tau == pytest.approx(result.value * WIDTH / SPEED)
    assert result.samples == 1024
    assert not result.closed


def test_dust_that_is_not_fine_leaves_a_straining_flow_as_its_inertia_lets_it() -> None:
    """tau y'' + y' = r y, from the air's own velocity on: in the end y grows as exp(l t), tau l^2 + l = r."""
    stokes = 0.3
    late = (-1.0 + math.sqrt(1.0 + 4.0 * stokes * FAR * WIDTH / SPEED)) / (2.0 * stokes)
    fine, heavy = found(exponential(FAR)), found(exponential(FAR), stokes=stokes)
    assert heavy.value == pytest.approx(1.0 / late, rel=0.1)
    assert heavy.value > 1.2 * fine.value


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    truth = SPEED / WIDTH / FAR
    results = [found(exponential(FAR), count=256, seed=seed) for seed in range(40)]
    assert sum(result.low <= truth <= result.high for result in results) >= 34  # of 40 at 95 %: fewer once in 300


def test_fitted_between_half_and_three_percent_in_a_uniform_stream() -> None:
    """A box of one width empties evenly: 1 - t U / D left, whose logarithm is fitted."""
    result = found(field_of(lambda x: np.tile([0.0, -SPEED], (len(x), 1)), n=4, low=-2, high=2), count=4096)
    time = np.arange(0.5, 0.97, 0.05)
    expected = -1 / np.polyfit(time, np.log(1 - time), 1)[0]
    assert result.value == pytest.approx(expected, rel=0.05)


def test_a_closed_eddy_keeps_its_dust_and_says_so() -> None:
    def eddy(x: np.ndarray) -> np.ndarray:
        return np.stack([-(x[:, 1] + 0.25), x[:, 0]], axis=1) * 8.0

    result = found(field_of(eddy, n=4, low=-2, high=2), count=64)
    assert result.closed
    assert (result.value, result.high, result.tau) == (math.inf,) * 3
    assert result.low == pytest.approx(LONGEST / math.log(1 / 0.03))
    assert result.left > np.pi / 4 - 0.2


def slab(time: np.ndarray, length: float) -> np.ndarray:
    """What is left (n,) of an even filling of a slab between two walls that absorb; time in length^2 / diffusivity."""
    odd = np.arange(1, 40, 2)[:, None]
    return np.asarray((8 / (odd * np.pi) ** 2 * np.exp(-((odd * np.pi / length) ** 2) * time)).sum(axis=0))


def test_diffusion_out_of_a_box_decays_as_its_series() -> None:
    """Still air that ends where the box ends, below a body that reflects. Eddies small against the box carry tracers
    out by diffusion, as if the edges lay |zeta(1/2)| = 1.460 free paths farther out (Burschka & Titulaer 1981, J. Stat.
    Phys. 25, 569: the Milne problem of the Langevin process).
    """
    rms, life, side = 1.0, 0.02, 0.5  # m/s, s, m
    k, lid = np.full(9, 1.5 * rms**2), PLATE + np.array([0.0, side / 2])
    field = field_of(lambda x: 0.0 * x, n=2, low=-side / 2, high=side / 2, k=k, dissipation=LIFETIME * k / life)
    result = found(field, outline=lid, count=8192)
    time = np.arange(0.0, 40.0, 0.1) * WIDTH / SPEED
    edge = 1.460 * rms * life
    share = slab(time * rms**2 * life, side + 2 * edge) * slab(time * rms**2 * life, 2 * (side + edge))
    fitted = (share <= 0.5) & (share >= 0.03)
    assert result.tau == pytest.approx(-1 / np.polyfit(time[fitted], np.log(share[fitted]), 1)[0], rel=0.06)
    assert result.low < result.value < result.high


def test_speed_and_size_only_scale_it() -> None:
    base = found(exponential(FAR))
    faster = found(exponential(3 * FAR), speed=3 * SPEED)
    larger = found(exponential(FAR / 2, scale=2.0), outline=2 * PLATE)
    for other in (faster, larger):
        assert other.value == pytest.approx(base.value, rel=1e-3)
    assert faster.tau == pytest.approx(base.tau / 3, rel=1e-3)
    assert larger.tau == pytest.approx(base.tau * 2, rel=1e-3)


def test_upward_air_is_the_picture_upside_down() -> None:
    down, up = found(exponential(FAR)), found(exponential(FAR), direction="up", outline=-PLATE)
    assert up.value == pytest.approx(down.value, rel=5e-3)


def skew(scale: float = 1.0) -> FlowField:
    """Stagnation flow with a drift to the right, which is not its own mirror image."""
    return field_of(lambda x: FAR * np.stack([0.4 + 0.3 * x[:, 1] - x[:, 0], x[:, 1]], axis=1), n=8, low=-2, high=2)


def test_a_mirrored_wake_keeps_dust_as_long() -> None:
    own, image = found(skew(), count=4096), found(skew().reflected(), count=4096)
    assert own.value == pytest.approx(image.value, abs=own.high - own.low)
    assert own.low < SPEED / WIDTH / FAR  # the drift carries some out sideways, which is faster


def test_a_field_that_repeats_takes_tracers_over_its_whole_period() -> None:
    """An exponential decay whose rate swings: the births over all phases see its mean, the sheddings are batches."""
    times = np.linspace(0, 1, 16, endpoint=False)
    still = exponential(FAR)
    swing = 1 + 0.5 * np.sin(2 * np.pi * 8 * times / 8)
    field = replace(still, velocity=swing[:, None, None] * still.velocity, times=times, period=1.0)
    slow = replace(still, velocity=0.5 * still.velocity)
    both = found(field), found(field, sheddings=8)
    for result in both:
        assert found(still).value * 0.7 < result.value < found(slow).value
    assert both[0].value == both[1].value  # the same flights, other batches
    assert both[0].low != both[1].low


def test_snapshots_that_do_not_repeat_take_tracers_in_their_first_half() -> None:
    still = exponential(FAR)
    field = replace(still, velocity=np.stack([still.velocity] * 2), times=np.array([0.0, 50.0]))
    assert found(field).value == pytest.approx(found(still).value, rel=0.1)


def test_realisations_share_the_tracers() -> None:
    fields = [exponential(rate) for rate in (0.5 * FAR, FAR, FAR, 2 * FAR)]
    result = found(fields)
    assert result.samples == 1024
    assert found(fields[3]).value < result.value < found(fields[0]).value
    assert result.high - result.low > 3 * (found(fields[1]).high - found(fields[1]).low)  # they differ


def test_a_swinging_mesh_is_taken_in_its_middle_position() -> None:
    field = exponential(FAR)
    assert found(field.moving((0.0, 0.1), 30.0)).value == found(field).value


def test_one_seed_one_answer_whatever_else() -> None:
    first, again, other = found(skew()), found(skew()), found(skew(), seed=1)
    assert first == again
    assert first.value != other.value


def test_the_near_wake_begins_at_the_widest_place() -> None:
    """A rhombus: tracers beside its lower half count; a stream at rest there keeps them, and moves below its rear."""
    rhombus = np.array([[-0.25, 0.25], [0.0, 0.0], [0.25, 0.25], [0.0, 0.5]])
    field = field_of(lambda x: np.stack([0 * x[:, 0], np.minimum(x[:, 1], 0.0) * 8.0], axis=1), n=100, low=-2, high=2)
    result = found(field, outline=rhombus)
    assert result.closed
    beside, below, body = 0.0625, 0.25, 0.0625  # m2; the mesh has no hole: who is born in the body stays there
    assert result.left == pytest.approx((beside + body) / (beside + body + below), abs=0.05)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"count": 3}, "too few"),
        ({"sheddings": 0}, "too few"),
        ({"speed": 0.0}, "speed"),
        ({"outline": PLATE + 50.0}, "outside the mesh"),
        ({"field": []}, "too few"),
    ],
)
def test_what_cannot_be_asked(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        found(**{"field": exponential(FAR), **changes})


WIND = np.array([0.4, -1.5])  # m/s
FLOW = 0.7  # kg/s and metre
BOXES = Boxes.across(2.0, -1.0, 1.0, 0.05)
ROOF = np.array([[-0.4, -0.5], [0.4, -0.5], [0.0, 0.1]])  # m: granules bounce off it and slide down its sides


def windy(points: np.ndarray) -> np.ndarray:
    return np.broadcast_to(WIND, points.shape)


def falling(tau: float, count: int = 40, **more: Any) -> Granules:
    places = np.stack([np.linspace(-0.3, 0.3, count), np.full(count, 0.7)], axis=1)
    return with_tau(tau, places, np.zeros((count, 2)), **more)


def test_in_free_flight_the_force_is_what_the_ends_of_the_tracks_tell() -> None:
    grains = falling(0.2)
    tracks = track(field_of(windy), grains, until=0.35, tolerance=1e-6, record=True)
    force = force_on_the_air(tracks, grains, FLOW, BOXES)
    lost = -(tracks.velocity - grains.velocity - np.outer(tracks.time, (0.0, -G))).mean(axis=0) * FLOW
    assert force.total == pytest.approx(lost, rel=1e-11)
    assert force.total[0] < 0.0  # the wind pushes them to the right, they push it to the left


@pytest.mark.parametrize(("restitution", "error"), [(0.0, 1e-3), (0.6, 1e-4)])
def test_walls_take_no_part_of_it(restitution: float, error: float) -> None:
    """Under Stokes drag in a uniform wind u the air gives (u T - way) / tau, whatever walls give beside it; along a
    wall, where granules without rebound slide, to the trapezoidal rule over the tracker's steps.
    """
    tau = 0.2
    grains = falling(tau, restitution=restitution, friction=0.3)
    tracks = track(field_of(windy), grains, until=0.6, tolerance=1e-7, bodies=[ROOF], drag="stokes", record=True)
    assert np.mean(tracks.impacts > 0) > 0.8
    force = force_on_the_air(tracks, grains, FLOW, BOXES)
    way = tracks.position - grains.position
    given = ((np.outer(tracks.time, WIND) - way) / tau).mean(axis=0)
    assert force.total == pytest.approx(-FLOW * given, rel=error)


@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_other_granules_take_no_part_of_it(restitution: float) -> None:
    """The same where they meet, in the slab, each for its own mass flow."""
    tau, rng, count = 0.2, np.random.default_rng(5), 300
    places = np.stack([rng.uniform(-0.01, 0.01, count), rng.uniform(0.15, 0.2, count)], axis=1)
    grains = with_tau(tau, places, np.zeros((count, 2)), restitution=restitution, friction=0.3)
    collisions, floor = Collisions(1.5e-3, restitution, 0.3, step=1e-4), np.array([[-1.0, -0.2], [1.0, -0.2]])
    how: dict[str, Any] = {"until": 3.0, "bodies": [ROOF], "lines": [floor], "drag": "stokes", "length": 0.1}
    tracks = track(field_of(windy), grains, collisions=collisions, record=64, **how)
    ended = np.flatnonzero(tracks.fate == Fate.BINNED)
    assert len(ended) > 0.99 * count
    tracks, grains = tracks.some(ended), grains[ended]
    assert tracks.meetings.mean() > 5.0
    flow = rng.uniform(0.5, 1.5, len(ended))
    force = force_on_the_air(tracks, grains, flow, BOXES)
    given = (np.outer(tracks.time, WIND) - tracks.position + grains.position) / tau
    assert force.total == pytest.approx(-flow @ given, rel=2e-3)


def test_neither_boxes_nor_thinned_paths_change_the_whole_force() -> None:
    grains, field = falling(0.05), field_of(windy)
    tracks, thin = (
        track(field, grains, until=0.6, tolerance=1e-6, bodies=[ROOF], record=points) for points in (1024, 16)
    )
    fine = force_on_the_air(tracks, grains, FLOW, BOXES)
    coarse = force_on_the_air(tracks, grains, FLOW, Boxes.across(2.0, -1.0, 1.0, 1.0))
    assert coarse.total == pytest.approx(fine.total, rel=1e-12)
    assert force_on_the_air(thin, grains, FLOW, BOXES).total == pytest.approx(fine.total, rel=1e-9)


def test_at_terminal_velocity_the_air_carries_the_weight_of_what_is_in_a_box() -> None:
    """n m g: a mass flow M at the speed v is M / v in a metre of height, and buoyancy is no drag."""
    tau, speed = 0.01, 0.01 * G
    places = np.stack([np.full(32, 0.025), np.linspace(0.3, 0.35, 32)], axis=1)
    grains = with_tau(tau, places, np.tile([0.0, -speed], (32, 1)))
    tracks = track(
        field_of(np.zeros_like),
        grains,
        until=6.0,
        tolerance=1e-8,
        drag="stokes",
        forces=("drag", "gravity"),
        record=True,
    )
    force = force_on_the_air(tracks, grains, FLOW, BOXES)
    column = np.flatnonzero(np.abs(BOXES.centres[0, :, 0] - 0.025) < 1e-9)
    rows = np.flatnonzero(np.abs(BOXES.centres[:, 0, 1]) < 0.2)
    expected = -FLOW / speed * G / BOXES.pitch
    assert float(force.density[rows, column, 1].mean()) == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(force.density[rows, column, 1], expected, rtol=0.1)  # a piece of a track more or less
    light = force_on_the_air(tracks, grains, FLOW, BOXES, air_density=DENSITY, forces=("drag", "gravity", "buoyancy"))
    ratio = 1.0 - DENSITY / grains.density[0]  # the same path told as one with buoyancy: so much less was drag
    assert light.total[1] == pytest.approx(ratio * force.total[1], rel=1e-9)


def test_a_mirrored_scene_exerts_the_mirror_image() -> None:
    def bent(points: np.ndarray) -> np.ndarray:
        return np.stack([points[:, 0], -1.0 - points[:, 1]], axis=1)

    grid = np.linspace(-1.0, 1.0, 21)
    points = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    from scipy.spatial import Delaunay

    from wakeflow.air.field import FlowField

    field = FlowField.from_arrays(points, Delaunay(points).simplices, bent(points))
    place = np.array([[0.31, 0.6]])
    forces = []
    for sign in (1.0, -1.0):
        grains = with_tau(0.1, place * (sign, 1.0), np.zeros((1, 2)))
        tracks = track(field, grains, until=0.5, tolerance=1e-9, bodies=[ROOF], record=True)
        forces.append(force_on_the_air(tracks, grains, FLOW, BOXES))
    np.testing.assert_allclose(forces[0].total, forces[1].total * (-1.0, 1.0), rtol=1e-6)


def test_tracks_without_paths_are_refused() -> None:
    with pytest.raises(SceneError, match="no paths were kept"):
        force_on_the_air(Tracks.empty(1), falling(0.1, 1), FLOW, BOXES)


def test_what_flights_cost_hardly_depends_on_the_seed() -> None:
    """Over 20 seeds of places and eddies: evaluations of the equation of motion, of 64 granules in turbulence."""
    field, walls = closed_box(8, lambda y: 0.2 + 0 * y, lambda y: 4.0 + 0 * y)
    cost = []
    for seed in range(20):
        flown = track(
            field, tracers(64, seed), until=1.0, tolerance=1e-2, length=1.0, bodies=walls, seed=seed,
            forces=("drag", "dispersion"),
        )  # fmt: skip
        cost.append(int(flown.evaluations.sum()))
    assert max(cost) <= 1.5 * np.median(cost)
