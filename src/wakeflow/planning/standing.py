"""What the plan warns of at the bodies: faces on which granules may stay, a record of vibration that does not close."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..core.geometry import normals
from ..core.graded import Notice, information, less_sure
from ..scene import Scene

__all__ = ["standing"]

SEAM = 0.1  # of a record's peak acceleration: a larger jump from its end to its beginning is warned of; chosen


def standing(scene: Scene) -> Iterator[Notice]:
    """One each: level faces, faces that friction alone makes a granule stay on, a record with a jump."""
    for name, body in scene.body.items():
        across, up = normals(body.outline()).T
        slopes = np.unique(np.round(np.abs(across[up > 0]) / up[up > 0], 9))  # tangents
        if slopes[0] == 0.0:
            yield information(
                f"body.{name} has a level face: granules come to rest on it unless [vibration] throws them off"
            )
        for kind, fraction in scene.fraction.items():
            friction = fraction.properties.friction
            held = slopes[(slopes > 0.0) & (slopes <= friction)]
            if len(held) and fraction.inertia is None:  # what can roll, does
                angle = math.degrees(math.atan(float(held[-1])))
                yield less_sure(
                    f"body.{name}: friction {friction:g} holds {kind} on its faces of up to {angle:.3g} deg unless "
                    "[vibration] shakes it off"
                )
    vibration = scene.vibration
    if vibration is not None and vibration.samples is not None and vibration.record.seam > SEAM:
        yield less_sure(
            "vibration.samples: from the record's end to its beginning the acceleration jumps by "
            f"{vibration.record.seam:.0%} of its peak; give a whole number of periods"
        )
