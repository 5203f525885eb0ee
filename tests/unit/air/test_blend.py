"""Fields made of fields: the wake between its two ends, the change by a force, a record that is made periodic."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import shaken_mesh
from wakeflow.air.field import EMPTY, FlowField, blended_wake, interpolated
from wakeflow.air.field.combined import cross_faded, fade
from wakeflow.core.errors import SceneError

PERIOD = 0.4
INFLOW = -2.0


def bump(x: np.ndarray) -> np.ndarray:
    """A stream function's part that vanishes with its gradient on the square's edges."""
    return np.prod(np.sin(np.pi * x) ** 2, axis=1)


def curl(x: np.ndarray) -> np.ndarray:
    """The velocity of that stream function."""
    s, c = np.sin(np.pi * x), np.cos(np.pi * x)
    slope = 2 * np.pi * s * c
    return np.stack([s[:, 0] ** 2 * slope[:, 1], -slope[:, 0] * s[:, 1] ** 2], axis=1)


def stream(x: np.ndarray) -> np.ndarray:
    """Uniform air downward."""
    return np.broadcast_to([0.0, INFLOW], (len(x), 2)).copy()


def still(n: int = 12, seed: int = 5) -> FlowField:
    """The steady end, on a mesh of its own."""
    points, cells = shaken_mesh(n, seed=seed)
    velocity = stream(points) + 0.2 * curl(points)
    near = bump(points)
    return FlowField.from_arrays(points, cells, velocity, points[:, 0] + near, k=0.5 + near, dissipation=2.0 + near)


def shedding(*, small: bool = True, n: int = 9, turning: float = 0.0) -> FlowField:
    """The end in time, whose fluctuation leaves the edges alone."""
    points, cells = shaken_mesh(n)
    times = 0.1 + PERIOD * np.arange(24) / 24
    swing = np.sin(2 * np.pi * times / PERIOD + turning)[:, None]
    near = bump(points)
    velocity = stream(points) + (0.5 + 0.3 * swing)[..., None] * curl(points)
    scalar = near * (1.0 + 0.9 * swing)
    field = FlowField.from_arrays(points, cells, velocity, scalar, times, PERIOD, 0.01 + scalar, 0.02 + scalar)
    return field.compressed(1e-5) if small else field


def at(field: FlowField, t: float) -> list[np.ndarray]:
    """Velocity and pressure at some points inside."""
    return list(field.sample(np.random.default_rng(2).uniform(0.1, 0.9, (30, 2)), t)[:2])


@pytest.mark.parametrize("small", [False, True])
def test_each_end_is_its_solution(small: bool) -> None:
    whole, steady = shedding(small=small), still()
    assert blended_wake(whole, steady, 1.0, 1.0) is whole
    for found, own in zip(at(blended_wake(whole, steady, 1.0, 1.0 - 1e-9), 0.23), at(whole, 0.23), strict=True):
        np.testing.assert_allclose(found, own, atol=1e-8)
    end = blended_wake(whole, steady, 0.0, 0.0)
    assert not end.in_time
    np.testing.assert_array_equal(end.points, whole.points)
    for found, own in zip(at(end, 0.0), at(steady, 0.0), strict=True):
        assert np.abs(found - own).max() < 0.08  # linear in cells of a tenth
    again = interpolated(steady, {"u": steady.velocity}, steady.points)["u"]
    np.testing.assert_allclose(again, steady.velocity, atol=1e-12)  # on its own nodes nothing is lost


def test_the_steady_end_is_the_nearer_the_finer_the_meshes_are() -> None:
    def miss(n: int) -> float:
        whole, steady = shedding(n=n), still(n)
        x = np.random.default_rng(2).uniform(0.1, 0.9, (30, 2))
        found = blended_wake(whole, steady, 0.0, 0.0).sample(x)[0]
        return float(np.abs(found - stream(x) - 0.2 * curl(x)).max())

    assert miss(24) < 0.45 * miss(12)  # between first and second order on shaken meshes


@pytest.mark.parametrize("small", [False, True])
def test_between_them_it_is_linear_in_both_numbers(small: bool) -> None:
    whole, steady = shedding(small=small), still()
    own, end, mean = at(whole, 0.23), at(blended_wake(whole, steady, 0.0, 0.0), 0.0), at(whole.mean(), 0.0)
    found = at(blended_wake(whole, steady, 0.4, 0.7), 0.23)
    for value, there, here, middle in zip(found, own, end, mean, strict=True):
        np.testing.assert_allclose(value, 0.6 * here + 0.4 * middle + 0.7 * (there - middle), atol=1e-9)


def test_turbulence_stays_positive_however_strong_the_fluctuation_is() -> None:
    whole, steady = shedding(small=False), still()
    for theta, strength in ((0.1, 1.0), (0.4, 0.7), (0.7, 0.2)):
        found = blended_wake(whole, steady, theta, strength)
        part = min(theta, strength)
        for name in ("k", "dissipation"):
            values = getattr(found, name)
            assert values.min() > 0
            spread = np.ptp(values, axis=0).max() / np.ptp(getattr(whole, name), axis=0).max()
            assert spread == pytest.approx(part)


def energies(field: FlowField) -> tuple[np.ndarray, np.ndarray]:
    """What the velocity's fluctuation holds (N,), m2/s2, and mean k, which is smooth in time."""
    whole = field.snapshots()
    velocity, k = (np.reshape(values, (-1, *shape)) for values, shape in (
        (whole.velocity, (len(whole.points), 2)), (whole.k, (len(whole.points),))
    ))  # fmt: skip
    return 0.5 * velocity.var(axis=0).sum(axis=1), k.mean(axis=0)


@pytest.mark.parametrize("small", [False, True])
@pytest.mark.parametrize(
    ("theta", "strength"), [(0.4, 0.65), (0.4, 0.0), (0.4, 0.2), (0.4, 1.0), (1.0, 0.6), (0.0, 0.0)]
)
def test_energy_that_the_fluctuation_lacks_is_in_k(small: bool, theta: float, strength: float) -> None:
    """Resolved and given energy together are those of a wake that is one of the two at a time; at theta 1 all of it."""
    whole, steady = shedding(small=small), still()
    resolved, own = energies(whole)
    apart = blended_wake(whole, steady, 0.0, 0.0)
    needed = theta * resolved + 0.5 * theta * (1 - theta) * np.sum(
        (apart.velocity - whole.mean().velocity) ** 2, axis=1
    )
    fluctuating, k = energies(blended_wake(whole, steady, theta, strength))
    given = k - (1 - theta) * apart.k - theta * own  # type: ignore[operator]
    np.testing.assert_allclose(fluctuating, strength**2 * resolved, atol=1e-9)
    expected = np.clip(
        needed, strength**2 * resolved, resolved
    )  # no more than what is dropped, and never less than it has
    np.testing.assert_allclose(fluctuating + given, expected, atol=1e-9)
    assert (given.max() > 1e-4) == (strength < 1.0 and theta > 0.0)


def test_what_is_given_keeps_its_lifetime_and_a_steady_air_its_k() -> None:
    whole, steady = shedding(small=False), still()
    with_it, without = blended_wake(whole, steady, 0.4, 0.0), blended_wake(whole, steady, 0.0, 0.0)
    for name in ("k", "dissipation"):
        np.testing.assert_array_equal(
            getattr(without, name), interpolated(steady, {"k": getattr(steady, name)}, whole.points)["k"]
        )
    mean = {name: 0.6 * getattr(without, name) + 0.4 * getattr(whole.mean(), name) for name in ("k", "dissipation")}
    assert (with_it.k / mean["k"]).max() > 1.01  # type: ignore[operator]
    np.testing.assert_allclose(with_it.k / with_it.dissipation, mean["k"] / mean["dissipation"])  # type: ignore[operator]
    assert blended_wake(steady, steady, 0.4, 0.65) is steady
    walls = np.prod(whole.points * (1 - whole.points), axis=1) < 1e-12
    rest = {name: np.where(walls, 0.0, getattr(whole, name)) for name in ("k", "dissipation")}
    flown = blended_wake(replace(whole, **rest), replace(steady, k=steady.k * bump(steady.points)), 0.4, 0.2)  # type: ignore[operator]
    assert np.isfinite(flown.k).all()  # type: ignore[arg-type]


def test_it_keeps_its_volume_no_worse_than_its_ends_do() -> None:
    whole, steady = shedding(n=20), still(24)
    ends = blended_wake(whole, steady, 0.0, 0.0).divergence().rms, whole.divergence().rms
    assert max(ends) < 0.2
    for theta in (0.2, 0.5, 0.8):
        assert blended_wake(whole, steady, theta, theta).divergence().rms <= max(ends)


def test_the_mirror_image_of_a_blend_is_the_blend_of_mirror_images() -> None:
    whole, steady = shedding(turning=0.3), still()
    found = blended_wake(whole.reflected(0.5), steady.reflected(0.5), 0.4, 0.6)
    own = blended_wake(whole, steady, 0.4, 0.6).reflected(0.5)
    np.testing.assert_allclose(found.velocity, own.velocity, atol=1e-12)
    np.testing.assert_allclose(found.pressure, own.pressure, atol=1e-12)  # type: ignore[arg-type]


def walled(field: FlowField) -> FlowField:
    """The field with air at rest on the lower edge, and a steady skin above it."""
    rises = np.minimum(1.0, 5.0 * field.points[:, 1])[:, None]
    parts = field.velocity * rises
    return replace(field, velocity=parts)


def test_walls_and_inlets_are_met_though_the_meshes_differ() -> None:
    whole, steady = walled(shedding()), walled(still())
    shifted = replace(steady, points=steady.points * (1.0, 0.99) + (0.0, 0.01))  # its wall lies above the other's
    found = blended_wake(whole, shifted, 0.4, 0.6).snapshots()
    floor = whole.points[:, 1] < 1e-9
    top = whole.points[:, 1] > 1 - 1e-9
    assert np.abs(found.velocity[:, floor]).max() < 1e-12
    np.testing.assert_allclose(found.velocity[:, top] - (0.0, INFLOW), 0.0, atol=1e-9)


def test_points_outside_take_the_nearest_value() -> None:
    steady = still()
    there = interpolated(
        steady, {"x": steady.points[:, 0], "u": steady.velocity}, np.array([[-0.01, 0.5], [1.02, 0.31]])
    )
    np.testing.assert_allclose(there["x"], [0.0, 1.0], atol=0.03)
    np.testing.assert_allclose(there["u"], [[0.0, INFLOW]] * 2, atol=0.05)


@pytest.mark.parametrize("small", [False, True])
def test_on_a_swinging_mesh_air_moves_with_the_wall_and_not_where_it_has_the_mean_speed(small: bool) -> None:
    omega, amplitude, strength = 2 * np.pi * 3 / PERIOD, 0.004, 0.6
    points, cells = shaken_mesh(9)
    times = 0.1 + PERIOD * np.arange(48) / 48
    speed = amplitude * omega * np.cos(omega * times + 0.2)
    beside = np.stack([np.zeros(len(points)), 2.0 * INFLOW * points[:, 0]], axis=1)  # INFLOW in the mean
    velocity = beside + speed[:, None, None] * np.stack([np.zeros(len(points)), 1.0 - points[:, 0]], axis=1)
    resolved = FlowField.from_arrays(points, cells, velocity, None, times, PERIOD)
    resolved = (resolved.compressed(1e-5) if small else resolved).moving((0.0, amplitude), omega, 0.2)
    found = blended_wake(resolved, FlowField.from_arrays(points, cells, beside), 0.3, strength)
    assert found.motion == resolved.motion
    now = found.snapshots()
    wall, x = points[:, 0] < 1e-9, points[:, 0]
    for t, air in zip(now.times, now.velocity, strict=True):
        push = amplitude * omega * np.cos(omega * t + 0.2)
        own = 2.0 * INFLOW * x + push * (strength * (1.0 - x) + (1.0 - strength) * (1.0 - 2.0 * x))
        np.testing.assert_allclose(air[:, 1], own, atol=5e-3 * amplitude * omega)
        np.testing.assert_allclose(air[wall, 1], push, atol=5e-3 * amplitude * omega)


def test_a_steady_field_stays_and_wrong_numbers_are_one_line() -> None:
    whole, steady = shedding(), still()
    assert blended_wake(steady, steady, 0.3, 0.2) is steady
    for name, numbers in (("theta", (1.2, 0.5)), ("strength", (0.5, -0.1))):
        with pytest.raises(SceneError, match=rf"blended_wake: {name} = -?\d\.\d, allowed 0 to 1"):
            blended_wake(whole, steady, *numbers)
    with pytest.raises(SceneError, match="has no k"):
        blended_wake(whole, replace(steady, k=EMPTY), 0.4, 0.4)
    with pytest.raises(SceneError, match="is one in time"):
        blended_wake(whole, whole, 0.4, 0.4)


LEAD, COUNT, MEAN = 24, 480, 3.0
POINTS = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])


def record(samples: int, memory: float = 8.0, seed: int = 3) -> np.ndarray:
    """Independent signals (COUNT, samples) with an exponential memory of so many snapshots, of variance 1."""
    random = np.random.default_rng(seed)
    keep = np.exp(-1.0 / memory)
    rows = [random.normal(size=samples)]
    for _ in range(COUNT - 1):
        rows.append(keep * rows[-1] + np.sqrt(1 - keep**2) * random.normal(size=samples))
    return MEAN + np.array(rows)


def test_the_variance_is_kept_where_the_record_is_faded() -> None:
    faded = fade(record(4000), LEAD, positive=False)[-LEAD:]
    np.testing.assert_allclose(faded.var(axis=1), 1.0, atol=0.1)  # sampling: 3 sqrt(2 / 4000) = 0.07
    np.testing.assert_allclose(faded.mean(axis=1), MEAN, atol=0.07)


def test_it_joins_as_smoothly_as_it_runs() -> None:
    made = fade(record(4000), LEAD, positive=False)
    step = np.sqrt((np.diff(made, axis=0) ** 2).mean(axis=1))
    join = np.sqrt(((made[0] - made[-1]) ** 2).mean())
    assert join < 1.2 * np.median(step)
    assert len(made) == COUNT - LEAD


def test_what_is_not_faded_stays_and_what_is_positive_stays_so() -> None:
    values = np.abs(record(50))
    made = fade(values, LEAD, positive=True)
    np.testing.assert_array_equal(made[:-LEAD], values[LEAD:-LEAD])
    assert (made[-LEAD:] >= np.minimum(values[-LEAD:], values[:LEAD]) - 1e-12).all()
    assert (made[-LEAD:] <= np.maximum(values[-LEAD:], values[:LEAD]) + 1e-12).all()


def test_a_field_becomes_periodic() -> None:
    velocity = record(6).reshape(COUNT, 3, 2)
    field = FlowField.from_arrays(POINTS, [(0, 1, 2)], velocity, times=0.1 * np.arange(COUNT), k=np.ones((COUNT, 3)))
    made = cross_faded(field, LEAD)
    assert made.period == pytest.approx(0.1 * (COUNT - LEAD))
    np.testing.assert_allclose(made.k, 1.0)
    for other in (field.mean(), made):
        with pytest.raises(SceneError, match="do not repeat"):
            cross_faded(other, LEAD)
    with pytest.raises(SceneError, match="too few"):
        cross_faded(field, COUNT // 3)


def street(x: np.ndarray, t: float, harmonics: int) -> np.ndarray:
    """A wave that travels in y, with overtones a fifth as strong each, on a stream."""
    u = np.stack([0.3 * x[:, 1], -1.0 - x[:, 0]], axis=1)
    for k in range(1, harmonics + 1):
        phase = 2 * np.pi * k * (x[:, 1] + t / PERIOD)
        u = u + 0.2 ** (k - 1) * 0.4 * np.stack([np.cos(phase), x[:, 0] * np.sin(phase)], axis=1)
    return u


def snapshots(count: int, harmonics: int = 3, n: int = 8) -> FlowField:
    points, cells = shaken_mesh(n)
    times = 0.1 + PERIOD * np.arange(count) / count
    velocity = np.stack([street(points, t, harmonics) for t in times])
    pressure = np.stack([np.sin(2 * np.pi * (points[:, 0] - t / PERIOD)) for t in times])
    k = 0.1 + 0.05 * pressure
    return FlowField.from_arrays(points, cells, velocity, pressure, times, PERIOD, k, 2.0 + pressure)


def rms(field: FlowField, values: np.ndarray) -> float:
    weight = np.bincount(field.triangles.ravel(), np.repeat(field.area, 3), len(field.points))
    square = values**2 if values.shape[-1] == len(weight) else (values**2).sum(axis=-1)
    return float(np.sqrt(np.mean(square @ weight) / weight.sum()))


def test_a_wave_of_three_harmonics_has_six_modes() -> None:
    small = snapshots(32).compressed(1e-4)
    assert small.truncation.modes == 6
    assert small.velocity.shape == (7, len(small.points), 2)
    assert small.truncation.velocity < 1e-4


@pytest.mark.parametrize("error", [0.1, 0.02, 0.004])
def test_the_stated_error_is_that_at_the_snapshots_and_below_what_was_asked(error: float) -> None:
    whole = snapshots(32)
    small = whole.compressed(error)
    lost = small.truncation
    for name, stated in (("velocity", lost.velocity), ("pressure", lost.pressure)):
        full, parts = getattr(whole, name), getattr(small, name)
        off = np.stack([np.tensordot(small.weights(t), parts, axes=1) for t in whole.times]) - full
        assert stated == pytest.approx(rms(whole, off) / rms(whole, full - full.mean(axis=0)), rel=1e-6, abs=1e-9)
        assert stated <= error
        if name == "velocity":
            assert lost.velocity_max == pytest.approx(np.linalg.norm(off, axis=2).max() / rms(whole, full), rel=1e-6)
    assert lost.knots <= 32
    assert lost.modes <= 6


def test_between_the_snapshots_it_is_of_fourth_order_in_time() -> None:
    worst = []
    for count in (16, 32, 64):
        small = snapshots(count, harmonics=2).compressed(1e-6, knots=count)
        times = np.linspace(0, 2 * PERIOD, 41)
        off = [np.tensordot(small.weights(t), small.velocity, axes=1) - street(small.points, t, 2) for t in times]
        worst.append(float(np.abs(off).max()))
    assert np.log2(worst[0] / worst[1]) > 3.7
    assert np.log2(worst[1] / worst[2]) > 3.7


def test_a_last_gap_of_another_length_is_no_harm() -> None:
    whole = snapshots(33, harmonics=2)
    keep = np.r_[0:31, 32]  # as of a loop whose length is no multiple of the snapshots' step
    parts = {n: getattr(whole, n)[keep] for n in ("velocity", "pressure", "k", "dissipation")}
    small = replace(whole, times=whole.times[keep], **parts).compressed(0.01)
    off = [np.tensordot(small.weights(t), small.velocity, axes=1) - street(small.points, t, 2) for t in whole.times]
    assert rms(small, np.array(off)) < 0.02 * rms(whole, whole.velocity - whole.velocity.mean(axis=0))


def test_saved_and_loaded_it_is_the_same_and_small(tmp_path: Path) -> None:
    whole = snapshots(64, n=30)
    small = whole.compressed(0.01).moving((0.0, 0.01), 2 * np.pi / PERIOD, 0.3)
    whole.save(tmp_path / "whole.npz")
    small.save(tmp_path / "small.npz")
    again = FlowField.load(tmp_path / "small.npz")
    for name in ("points", "velocity", "pressure", "k", "dissipation", "times", "coefficients"):
        np.testing.assert_array_equal(getattr(again, name), getattr(small, name))
    assert (again.motion, again.truncation, again.period) == (small.motion, small.truncation, small.period)
    assert (tmp_path / "small.npz").stat().st_size < 0.15 * (tmp_path / "whole.npz").stat().st_size


def test_mirror_images_snapshots_and_divergence_of_modes() -> None:
    whole = snapshots(24)
    small = whole.compressed(1e-4, knots=24)
    x = np.random.default_rng(3).uniform(0.1, 0.9, (20, 2))
    flipped = small.reflected().sample(x * (-1, 1), 0.3)[0]
    np.testing.assert_allclose(flipped, small.sample(x, 0.3)[0] * (-1, 1), atol=1e-12)
    again = small.snapshots()
    np.testing.assert_allclose(again.velocity, whole.velocity, atol=1e-4)
    assert again.divergence().max == pytest.approx(small.divergence().max)
    assert again.mean().divergence().rms == pytest.approx(small.mean().divergence().rms, rel=1e-9)


def test_truncation_leaves_k_and_dissipation_positive() -> None:
    whole = snapshots(32)
    bursts = np.stack([np.exp(-((whole.points[:, 1] - i / 32) ** 2) / 0.005) for i in range(32)]) + 1e-3
    small = replace(whole, k=bursts, dissipation=3 * bursts).compressed(0.1)
    assert min(np.tensordot(small.weights(t), np.asarray(small.k), axes=1).min() for t in small.times) < 0  # type: ignore[union-attr]
    drawn = small.snapshots()
    for values, mean in ((drawn.k, small.mean().k), (drawn.dissipation, small.mean().dissipation)):
        assert np.all(np.asarray(values) >= 0.049999 * np.asarray(mean))


def test_air_on_a_moving_mesh_is_where_the_mesh_is() -> None:
    points, cells = shaken_mesh(6)
    field = FlowField.from_arrays(points, cells, np.stack([points[:, 1], 2 * points[:, 0]], axis=1))
    moving = field.moving((0.01, 0.05), 7.0, 0.4)
    x, t = np.array([[0.4, 0.6]]), 0.9
    shift = np.array([0.01, 0.05]) * np.sin(7.0 * t + 0.4)
    np.testing.assert_allclose(moving.sample(x, t)[0], field.sample(x - shift)[0], atol=1e-14)
    np.testing.assert_allclose(moving.motion.velocity(t), np.array([0.01, 0.05]) * 7.0 * np.cos(7.0 * t + 0.4))
    edge = np.isnan(moving.sample([[0.4, 0.01], [0.4, 1.01]], 0.0)[0]).all(axis=1)  # it is 0.019 m higher now
    assert edge.tolist() == [True, False]
    image = moving.reflected()
    np.testing.assert_allclose(image.sample(x * (-1, 1), t)[0], moving.sample(x, t)[0] * (-1, 1), atol=1e-14)


def test_bad_input_is_one_line_that_names_it() -> None:
    whole = snapshots(24)
    with pytest.raises(SceneError, match="error = 2, allowed above 0"):
        whole.compressed(2.0)
    with pytest.raises(SceneError, match="knots = 40, allowed 8 to 24"):
        whole.compressed(0.1, knots=40)
    with pytest.raises(SceneError, match="snapshots over a whole period"):
        replace(whole, period=0.0).compressed()
    with pytest.raises(SceneError, match=r"repeats after 1\.5 swings"):
        whole.moving((0, 0.1), 3 * np.pi / PERIOD)
    with pytest.raises(SceneError, match="omega positive"):
        whole.mean().moving((0, 0.1), 0.0)
    small = whole.compressed(0.1)
    arrays = {n: getattr(small, n) for n in ("points", "triangles", "velocity", "times", "period")}
    with pytest.raises(SceneError, match="a row for each time"):
        FlowField.from_arrays(**arrays, coefficients=np.ones((3, 2)))
    with pytest.raises(SceneError, match="the first column must be 1"):
        FlowField.from_arrays(**arrays, coefficients=2 * small.coefficients)
    arrays["times"] = small.times**2  # type: ignore[operator]
    with pytest.raises(SceneError, match="must be uniform"):
        FlowField.from_arrays(**arrays, coefficients=small.coefficients)
