"""The wake that a scene is flown in: which shape of the best estimate's data its bodies are, and which other wakes part
of the granules fly in.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ..laws.best_estimate import WakeEstimate, best_estimate
from ..scene import Scene

__all__ = ["ShapeFamily", "Wake", "family_of", "wake_of", "wakes_beside"]

SHARP = 0.02  # radius over width up to which an edge is sharp: Munson's triangles lose a seventh of their drag there
SQUARE, THIN = (0.8, 1.25), 0.25  # extent along the air over that across it, of a square and of a plate; chosen
ON_BOX = 1e-9  # of the width: how far a rectangle's corners may lie off the corners of its box


class ShapeFamily(NamedTuple):
    """A shape of the data, None for one without; ``slope`` (deg) of its faces from the horizontal, where it has any."""

    name: str | None
    slope: float | None = None


class Wake(StrEnum):
    """The wakes in which the granules of a comparison fly."""

    STEADY = "steady"
    TIME_RESOLVED = "time-resolved"
    MEAN = "mean"  # of the time-resolved wake
    HALF = "half"  # of its fluctuation
    ANSWER = "answer"  # the answer's own


def wakes_beside(brackets: bool, estimate: WakeEstimate | None) -> dict[Wake, tuple[float, float]]:
    """Theta and strength of the wakes in which part of the granules fly beside the answer's own.

    Around a best estimate: its two ends. Around a time-resolved wake that is the answer itself: the steady one, and two
    with less of the fluctuation.
    """
    if not brackets:
        return {}
    if estimate is None:
        return {Wake.STEADY: (0.0, 0.0), Wake.MEAN: (1.0, 0.0), Wake.HALF: (1.0, 0.5)}
    return {Wake.STEADY: (0.0, 0.0), Wake.TIME_RESOLVED: (1.0, 1.0)}


def wake_of(scene: Scene, reynolds: float) -> WakeEstimate:
    """The best estimate of the wake of a scene's bodies, at a Reynolds number at which it is turbulent."""
    family = family_of(scene)
    return best_estimate(family.name, scene.width / scene.channel.width, reynolds, slope=family.slope)


def family_of(scene: Scene) -> ShapeFamily:
    """Which shape of the data stands in the air; none for several bodies, rounded edges and other shapes."""
    (body, *others) = scene.body.values()
    if others or (body.rounding or 0.0) > SHARP * scene.width:
        return ShapeFamily(None)
    outline = body.outline()
    across, along = np.ptp(outline, axis=0)
    if body.shape == "rhombus":
        return ShapeFamily("rhombus", math.degrees(math.atan2(along, across)))
    if body.shape == "prism":
        upstream = (body.apex or "up") == ("up" if scene.airstream.direction == "down" else "down")
        slope = math.degrees(math.atan2(2.0 * along, across))
        return ShapeFamily("triangle-up" if upstream else "triangle-down", slope)
    box = np.abs(outline - 0.5 * (outline.min(axis=0) + outline.max(axis=0))) - 0.5 * np.array([across, along])
    if len(outline) == 4 and np.abs(box).max() < ON_BOX * across:
        name = "plate" if along < THIN * across else "square" if SQUARE[0] <= along / across <= SQUARE[1] else None
        return ShapeFamily(name)
    return ShapeFamily(None)
