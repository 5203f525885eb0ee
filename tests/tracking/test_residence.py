"""Near-wake residence time: decays that are known exactly, wakes that keep what they hold, mirror images, scaling."""

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from support import field_of
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.laws.turbulence import LIFETIME
from wakeflow.tracking.residence import LONGEST, ResidenceTime, residence_time

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
    result = found(field, outline=lid, count=2048)
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
