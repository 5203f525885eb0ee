"""Buoyancy: the weight of the air that a granule displaces."""

from __future__ import annotations

from ..constants import GRAVITY
from .record import AirProperties, Array, Force, Grains, Instant, Vector
from .scales import Bound, FlightScales

__all__ = ["BUOYANCY"]


def _shift(flight: FlightScales) -> float:
    return flight.slope * flight.widths(flight.steady(flight.ratio * GRAVITY, flight.whole))


def _acceleration(grains: Grains, air: AirProperties | None, gravity: Array) -> Array:
    assert air is not None
    return -((air.density / grains.density)[:, None] * gravity)


def _reference(now: Instant) -> Vector:
    granule = now.granule
    return -granule.ratio * granule.gravity[0], -granule.ratio * granule.gravity[1]


BUOYANCY = Force(
    name="buoyancy",
    means="weight of the displaced air",
    source="Archimedes; OpenFOAM's p has no hydrostatic part",
    calm=True,
    bound=Bound(_shift, "g rho/rho_p over the whole flight, times the slope of the track at its end"),
    acceleration=_acceleration,
    reference=_reference,
)
