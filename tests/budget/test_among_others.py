"""The factor from what a shift moves of granules alone to what it moves among others."""

import numpy as np
import pytest

from support import shipped
from wakeflow.budget.comparison import MOST, AmongOthers
from wakeflow.pipeline.landings import Landings
from wakeflow.scene import Scene

COUNT = 2**14
SHIFT = 0.004  # m


@pytest.fixture
def scene() -> Scene:
    return shipped("rhombus", {"numerics.rung": "none"})


def landed(x: np.ndarray, scene: Scene) -> Landings:
    """Granules on the floor at ``x`` (n,) m."""
    zero, bins = np.zeros(len(x)), np.full(len(x), -1)
    for number, place in enumerate(scene.bin.values()):
        (left, _), (right, _) = place.line(scene.channel)[[0, -1]]
        bins[(x >= min(left, right)) & (x < max(left, right))] = number
    position = np.stack([x, np.full(len(x), scene.channel.bottom)], axis=1)
    return Landings(position, bins, zero.astype(int), zero, zero, zero, zero, zero, zero)


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
    end = scene.bin["middle"].line(scene.channel)[-1][0]
    few[:4], many[: COUNT // 2] = end, end
    alone = landed(nowhere, scene)
    assert 1.0 < AmongOthers(scene, {"a": alone}, {"a": landed(few, scene)}).factor("a") <= 1.5
    assert AmongOthers(scene, {"a": alone}, {"a": landed(many, scene)}).factor("a") == MOST
    assert AmongOthers(scene, {"a": landed(many, scene)}, {"a": alone}).factor("a") == 1.0 / MOST
