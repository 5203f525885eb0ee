"""A repeating field as mean and modes: what is lost is what is stated, time is smooth, a moving mesh carries its
air along.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import shaken_mesh
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField

PERIOD = 0.4


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
    assert whole.times is not None
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
        replace(whole, period=None).compressed()
    with pytest.raises(SceneError, match=r"repeats after 1\.5 swings"):
        whole.moving((0, 0.1), 3 * np.pi / PERIOD)
    with pytest.raises(SceneError, match="omega positive"):
        whole.mean().moving((0, 0.1), 0.0)
    small = whole.compressed(0.1)
    arrays = {n: getattr(small, n) for n in ("points", "triangles", "velocity", "times", "period")}
    with pytest.raises(SceneError, match="a row for each time"):
        FlowField.from_arrays(**arrays, coefficients=np.ones((3, 2)))
    assert small.coefficients is not None
    with pytest.raises(SceneError, match="the first column must be 1"):
        FlowField.from_arrays(**arrays, coefficients=2 * small.coefficients)
    arrays["times"] = small.times**2  # type: ignore[operator]
    with pytest.raises(SceneError, match="must be uniform"):
        FlowField.from_arrays(**arrays, coefficients=small.coefficients)
