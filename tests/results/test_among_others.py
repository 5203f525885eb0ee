"""The factor from what a shift moves of granules alone to what it moves among others."""

from __future__ import annotations

import numpy as np
import pytest

from support import shipped
from wakeflow.pipeline.landings import Landings
from wakeflow.results.among_others import MOST, AmongOthers
from wakeflow.scene import RESERVED_BIN, Scene

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
    return np.clip(width * chance.normal(size=COUNT), -0.49 * scene.channel.width, 0.49 * scene.channel.width)


@pytest.mark.parametrize(("alone", "met"), [(0.05, 0.09), (0.09, 0.05), (0.06, 0.06)])
def test_a_shift_moves_so_much_more_of_a_share(scene: Scene, alone: float, met: float) -> None:
    """Granules farther or less far apart, all shifted by the same: the factor says what that does to the middle."""
    far, near = spread(scene, met), spread(scene, alone)
    among = AmongOthers(scene, {"wheat": landed(near, scene)}, {"wheat": landed(far, scene)})
    moved = []
    for x in (near, far):  # outward, as faster air or a livelier rebound would
        before, after = (np.mean(landed(x + by * np.sign(x), scene).bin == 0) for by in (0.0, SHIFT))
        moved.append(after - before)
    assert among.factor("wheat", ["middle"]) == pytest.approx(moved[1] / moved[0], rel=0.25)


def test_ends_that_bins_share_do_not_count_for_both_together(scene: Scene) -> None:
    """Nothing that passes between two bins changes what both hold."""
    near, far = spread(scene, 0.05), spread(scene, 0.09)
    among = AmongOthers(scene, {"wheat": landed(near, scene)}, {"wheat": landed(far, scene)})
    assert among.factor("wheat", list(scene.bin)) == 1.0  # the whole floor, from wall to wall
    assert among.factor("wheat", [*scene.bin, RESERVED_BIN]) == 1.0
    one, both = (among.factor("wheat", places) for places in (["middle"], ["middle", "inner-left"]))
    assert one != both


def test_few_granules_near_an_end_make_no_large_factor(scene: Scene) -> None:
    nowhere = np.full(COUNT, 0.0)
    few, many = nowhere.copy(), nowhere.copy()
    end = scene.bin["middle"].line(scene.channel)[-1][0]
    few[:4], many[: COUNT // 2] = end, end
    alone = landed(nowhere, scene)
    assert 1.0 < AmongOthers(scene, {"a": alone}, {"a": landed(few, scene)}).factor("a", ["middle"]) <= 1.5
    assert AmongOthers(scene, {"a": alone}, {"a": landed(many, scene)}).factor("a", ["middle"]) == MOST
    assert AmongOthers(scene, {"a": landed(many, scene)}, {"a": alone}).factor("a", ["middle"]) == 1.0 / MOST
