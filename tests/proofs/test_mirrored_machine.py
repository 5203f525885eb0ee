"""A machine and its mirror image: their answers are mirror images of each other, within the intervals they state."""

from __future__ import annotations

import math
from typing import Any

import pytest

from wakeflow.answer.separation import separate
from wakeflow.answer.shares import Separation
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

BINS = {
    "outer-left": (-0.2, -0.1),
    "inner-left": (-0.1, -0.03),
    "middle": (-0.03, 0.03),
    "inner-right": (0.03, 0.1),
    "outer-right": (0.1, 0.2),
}
# Fifteen comparisons at once: one in twenty differs by more than its own 95 % allows, all stay within this multiple of
# it 95 times in a hundred (Bonferroni: the normal quantile for 0.05 / 15 is 2.94, that for 0.05 is 1.96).
JOINT = 1.5
OPPOSITE = dict(zip(BINS, reversed(BINS), strict=True))


def machine(side: int, air: dict[str, float], rung: str, scale: float) -> Scene:
    """Two bodies of 5 cm, the lower one beside the axis: to the right, or with ``side`` -1 to the left."""
    tables: dict[str, Any] = {
        "body": {
            "upper": {"shape": "rhombus", "width": 0.05, "slope_angle": math.pi / 4},
            "lower": {"shape": "prism", "width": 0.05, "slope_angle": math.pi / 4, "at": [0.06 * side, -0.12]},
        },
        "channel": {"width": 0.4, "top": 0.2, "bottom": -0.3},
        "air": air,
        "feed": {"height": 0.1, "width": 0.04, "count": 1024},
        "fraction": {name: {"material": name} for name in ("wheat", "chaff", "dust")},
        "bin": {name: {"from": start, "to": end} for name, (start, end) in BINS.items()},
        "numerics": {"rung": rung, "mesh_scale": scale},
    }
    return Scene.parse(tables)


def _answer(scene: Scene) -> Separation:
    return separate(scene, Pipeline(scene, make_plan(scene)).tracks().landings)


def differences(air: dict[str, float], rung: str, scale: float) -> dict[str, float]:
    """By how much each share differs from the mirrored machine's, over what both intervals allow."""
    right, left = (machine(side, air, rung, scale) for side in (1, -1))
    assert not make_plan(right).airflow.mirrored  # nothing is averaged over images that would hide a difference
    one, other = _answer(right), _answer(left)
    found = {}
    for name in right.fraction:
        for place, opposite in OPPOSITE.items():
            value, low, high = one.share(name, place)
            image, image_low, image_high = other.share(name, opposite)
            allowed = math.hypot(0.5 * (high - low), 0.5 * (image_high - image_low))
            found[f"{name} {place}: {100 * value:.2f} and {100 * image:.2f}"] = abs(value - image) / allowed
    return found


@pytest.mark.openfoam
@pytest.mark.slow
def test_the_mirror_image_of_a_machine_gives_the_mirrored_answer() -> None:
    """Its steady airflow does not settle (Cd swings by 14 to 19 %): at one iteration each, dust in inner-left was 85.6
    and 37.6 % +- 3.3. At eight late states each it is 66 and 53 +- 19, and the farthest of all is 1.15 intervals off.
    """
    found = differences({"speed": 5.0}, "draft", 2.5)
    assert max(found.values()) <= JOINT, found
    assert sum(ratio > 1.0 for ratio in found.values()) <= 2, found
