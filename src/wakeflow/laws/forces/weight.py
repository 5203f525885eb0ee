"""Weight: what pulls a granule down, in air and in a vacuum."""

from __future__ import annotations

import numpy as np

from .record import AirProperties, Array, Force, Grains, Instant, Vector

__all__ = ["GRAVITY_FORCE"]


def _acceleration(grains: Grains, _air: AirProperties | None, gravity: Array) -> Array:
    return np.tile(gravity, (len(grains), 1))


def _reference(now: Instant) -> Vector:
    return now.granule.gravity


GRAVITY_FORCE = Force(
    name="gravity",
    means="weight",
    source="g",
    needs="nothing",
    calm=True,
    acceleration=_acceleration,
    reference=_reference,
)
