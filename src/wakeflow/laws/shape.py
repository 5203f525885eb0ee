"""Shapes of bodies: registered functions from a few numbers to a closed outline.

An outline is a (k, 2) array of corners in metres, counter-clockwise, y up, origin at the body's centre. The slope
angle is measured from the horizontal, as in the impact law.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..core.quantities import metres
from ..core.registry import Registry

Outline = NDArray[np.float64]
shapes: Registry[Callable[..., Outline]] = Registry("shape")


def _height(half_width: float, slope_angle: float, height: float) -> float:
    """Height (m) of a slope over ``half_width``, from its angle (rad) or as given: one of the two, and one alone."""
    if math.isnan(slope_angle) == math.isnan(height):
        raise SceneError("give either slope_angle or height, not both and not neither")
    return half_width * float(np.tan(slope_angle)) if math.isnan(height) else height


@shapes.register("rhombus")
def rhombus(*, width: float, slope_angle: float = math.nan, height: float = math.nan) -> Outline:
    """Rhombus standing on a corner; ``width``, ``height`` are its diagonals. Origin where they cross."""
    half = width / 2
    rise = _height(half, slope_angle, height / 2)
    return np.array([(half, 0.0), (0.0, rise), (-half, 0.0), (0.0, -rise)])


@shapes.register("prism")
def prism(*, width: float, slope_angle: float = math.nan, height: float = math.nan, apex: str = "up") -> Outline:
    """Isosceles triangle with a horizontal base of ``width``, apex up or down. Origin at the centroid."""
    half = width / 2
    rise = _height(half, slope_angle, height)
    up = np.array([(-half, -rise / 3), (half, -rise / 3), (0.0, 2 * rise / 3)])
    return up if apex == "up" else -up


@shapes.register("circle")
def circle(*, width: float, corners: int = 120) -> Outline:
    """Circle of diameter ``width`` as the polygon of ``corners`` points on it (a multiple of 4: width and height are
    exact). With 120 its area is 0.05 % below the circle's and its edges lie within 1.7e-4 diameters of it.
    """
    if corners % 4:
        raise SceneError(f"corners = {corners}: a multiple of 4")
    quarter = np.linspace(0.0, np.pi / 2, corners // 4 + 1)
    x = np.where(quarter <= np.pi / 4, np.cos(quarter), np.sin(np.pi / 2 - quarter))  # a mirror image to the last bit
    arc = 0.5 * width * np.stack([x, x[::-1]], axis=1)[:-1]
    turns = [
        arc @ np.array(turn) for turn in (((1, 0), (0, 1)), ((0, 1), (-1, 0)), ((-1, 0), (0, -1)), ((0, -1), (1, 0)))
    ]
    return np.concatenate(turns)


@shapes.register("plate")
def plate(*, length: float, thickness: float, slope_angle: float, descends: str = "right") -> Outline:
    """Plate of ``length`` along its faces, inclined by ``slope_angle`` (rad), which falls to the right or left.

    Origin at its middle. With a rounding below half of the thickness its ends are round.
    """
    if thickness > length:
        raise SceneError(f"thickness = {metres(thickness)} is more than length = {metres(length)}")
    along, across = length / 2, thickness / 2
    x, y = np.array([(along, across), (-along, across), (-along, -across), (along, -across)]).T
    c, s = float(np.cos(slope_angle)), float(np.sin(slope_angle))
    right = np.stack([c * x + s * y, c * y - s * x], axis=1)
    return right if descends == "right" else np.ascontiguousarray((right * (-1.0, 1.0))[::-1])


@shapes.register("polygon")
def polygon(*, points: ArrayLike) -> Outline:
    """Any simple polygon, corners (k, 2) in metres in the body's own frame, either direction of travel."""
    outline = np.asarray(points, dtype=float)
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
        raise SceneError("points must be at least three [x, y] pairs")
    x, y = outline.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    if area == 0.0:
        raise SceneError("points enclose no area")
    return outline if area > 0 else np.ascontiguousarray(outline[::-1])
