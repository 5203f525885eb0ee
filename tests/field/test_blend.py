"""Fields made of fields: the wake between its two ends, the change by a force, a record that is made periodic."""

from dataclasses import replace

import numpy as np
import pytest

from support import field_of, shaken_mesh
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField, blended_wake, interpolated
from wakeflow.field.combined import changed_as, cross_faded, fade

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
    assert end.times is None
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
    assert now.times is not None
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
        blended_wake(whole, replace(steady, k=None), 0.4, 0.4)
    with pytest.raises(SceneError, match="is one in time"):
        blended_wake(whole, whole, 0.4, 0.4)


def turning(points: np.ndarray) -> np.ndarray:
    return np.stack([1.0 + points[:, 1], 0.3 - points[:, 0]], axis=1)


def steady(n: int = 12, more: float = 0.0) -> FlowField:
    """A linear flow with pressure and turbulence; ``more`` of each."""
    points, cells = shaken_mesh(n, -1.0, 1.0)
    x = points[:, 0]
    return FlowField.from_arrays(
        points, cells, (1.0 + more) * turning(points), pressure=(2.0 + more) * x,
        k=(1.0 + more) * (2.0 + x), dissipation=(1.0 + 2.0 * more) * (3.0 + x),
    )  # fmt: skip


def in_time(n: int, snapshots: int = 8) -> FlowField:
    base, phase = steady(n), np.arange(snapshots) / snapshots * 2 * np.pi
    waves = 1.0 + 0.2 * np.cos(phase)
    return FlowField.from_arrays(
        base.points, base.triangles, waves[:, None, None] * base.velocity, np.outer(waves, base.pressure),
        times=phase, period=2 * np.pi, k=np.outer(waves, base.k), dissipation=np.outer(waves, base.dissipation),
    )  # fmt: skip


def test_the_change_of_a_field_itself_is_the_changed_one() -> None:
    before, after = steady(), steady(more=0.25)
    found = changed_as(before, before, after)
    for name in ("velocity", "pressure", "k", "dissipation"):
        np.testing.assert_allclose(getattr(found, name), getattr(after, name), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_field_in_time_keeps_its_fluctuation_and_gets_the_difference_on_its_own_nodes(compressed: bool) -> None:
    whole = in_time(9)
    field = whole.compressed(1e-6) if compressed else whole
    found = changed_as(field, steady(), steady(more=0.25))
    places = np.array([[0.1, 0.2], [-0.4, 0.5], [0.0, -0.61]])
    for t in (0.3, 2.0, 5.1):
        old, new = field.sample(places, t), found.sample(places, t)
        np.testing.assert_allclose(new[0] - old[0], 0.25 * turning(places), atol=2e-6)  # linear: no interpolation error
        np.testing.assert_allclose(new[1] - old[1], 0.25 * places[:, 0], atol=2e-6)
    old, new = field.snapshots(), found.snapshots()
    np.testing.assert_allclose(new.k / old.k, 1.25, rtol=1e-5)
    np.testing.assert_allclose(new.dissipation / old.dissipation, 1.5, rtol=1e-5)
    assert found.period == field.period


def test_the_result_conserves_volume() -> None:
    found = changed_as(in_time(9), steady(), steady(more=0.25))
    assert found.mean().divergence().max < 1e-12


def test_where_there_was_next_to_no_turbulence_it_grows_by_no_more_than_ten() -> None:
    before = steady()
    calm = replace(before, k=np.full(len(before.points), 1e-9))
    found = changed_as(calm, calm, replace(before, k=np.full(len(before.points), 1.0)))
    np.testing.assert_allclose(found.k, 1e-8)


def test_walls_stay_at_rest_on_another_mesh() -> None:
    def shear(points: np.ndarray) -> np.ndarray:  # at rest on y = -1
        return np.stack([1.0 + points[:, 1], np.zeros(len(points))], axis=1)

    before, field = field_of(shear, 12), field_of(shear, 7)
    after = replace(before, velocity=before.velocity + 0.1)  # also on the wall, as interpolation may make it
    found = changed_as(field, before, after)
    wall = np.isclose(field.points[:, 1], -1.0)
    assert wall.sum() > 5
    np.testing.assert_array_equal(found.velocity[wall], field.velocity[wall])
    np.testing.assert_allclose(found.velocity[~wall] - field.velocity[~wall], 0.1)


def test_fields_that_do_not_fit_are_refused() -> None:
    with pytest.raises(SceneError, match="steady fields on one mesh"):
        changed_as(steady(), steady(), steady(10))
    with pytest.raises(SceneError, match="steady fields on one mesh"):
        changed_as(steady(), steady(), in_time(12))
    bare = field_of(turning, 12)
    with pytest.raises(SceneError, match="no pressure"):
        changed_as(steady(), bare, bare)


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
    assert made.k is not None
    np.testing.assert_allclose(made.k, 1.0)
    for other in (field.mean(), made):
        with pytest.raises(SceneError, match="do not repeat"):
            cross_faded(other, LEAD)
    with pytest.raises(SceneError, match="too few"):
        cross_faded(field, COUNT // 3)
