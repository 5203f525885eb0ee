"""Mirror images of a flow field: the other half of a half domain, and the whole turned round."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError

if TYPE_CHECKING:
    from .flow import FlowField

__all__ = ["mirrored", "reflected"]

Array = NDArray[np.float64]


def mirrored(field: FlowField, x: float) -> FlowField:
    """See ``FlowField.mirrored``."""
    offset = field.points[:, 0] - x
    slack = 1e-9 * float(np.ptp(field.points, axis=0).max())
    axis = np.abs(offset) <= slack
    if offset.min() < -slack and offset.max() > slack:
        raise SceneError(f"mirrored: points lie on both sides of x = {x:g} m")
    if not axis.any():
        raise SceneError(f"mirrored: no points on the axis x = {x:g} m")
    if field.motion is not None and field.motion.x != 0.0:
        raise SceneError("mirrored: the mesh moves across the axis")
    count, off = len(field.points), ~axis
    image = np.arange(count)
    image[off] = count + np.arange(off.sum())
    points = field.points.copy()
    points[axis, 0] = x

    def double(nodal: Array) -> Array:
        if nodal.ndim == field.velocity.ndim:  # a vector
            near = nodal.copy()
            near[..., axis, 0] = 0.0
            return np.concatenate([near, near[..., off, :] * (-1.0, 1.0)], axis=-2)
        return np.concatenate([nodal, nodal[..., off]], axis=-1)

    whole = field.mapped(double)
    return replace(
        whole,
        points=np.concatenate([points, (2 * x, 0.0) + points[off] * (-1.0, 1.0)]),
        triangles=np.concatenate([field.triangles, image[field.triangles[:, ::-1]]]),
    )


def reflected(field: FlowField, x: float) -> FlowField:
    """The mirror image of the field about the vertical line at ``x``."""

    def flip(nodal: Array) -> Array:
        return nodal * (-1.0, 1.0) if nodal.ndim == field.velocity.ndim else nodal

    points = (2 * x, 0.0) + field.points * (-1.0, 1.0)
    motion = None if field.motion is None else field.motion._replace(x=-field.motion.x)
    triangles = np.ascontiguousarray(field.triangles[:, ::-1])
    return replace(field.mapped(flip), points=points, triangles=triangles, motion=motion)
