"""Spin lift (Magnus) and the air's torque on the spin; laws/rotation.py."""

from __future__ import annotations

import math

from ..rotation import magnus_factor, spin_rate
from .record import AirProperties, Force, Grains, Instant, Slots, Vector
from .scales import Bound, FlightScales

__all__ = ["SPIN_LIFT"]


def _shift(flight: FlightScales) -> float:
    spin = (flight.thrown if flight.calm else flight.arrival) / (0.5 * flight.diameter)  # rolling off slope or wall
    scale = flight.air_density * flight.diameter / flight.viscosity
    lift = 0.75 * flight.ratio * magnus_factor(scale * flight.typical_slip, scale * flight.diameter * spin)
    lasting = 1.0 / float(spin_rate(flight.diameter, flight.density, flight.viscosity))
    by_granule = flight.passage(lift * spin * flight.typical_slip, lasting)
    by_air = 0.75 * flight.ratio * flight.typical_slip * 0.5 * flight.turned * flight.reach(flight.time)
    return flight.widths(by_granule + by_air)


def _factors(grains: Grains, air: AirProperties) -> Slots:
    """MAGNUS: 3/4 rho / rho_p, times the compiled factor."""
    return {"MAGNUS": 0.75 * (air.density / grains.density)}


def _constants(grains: Grains, air: AirProperties) -> Slots:
    """SPIN_RATE (1/s): rate at which the air takes a spin away."""
    return {"SPIN_RATE": spin_rate(grains.diameter, grains.density, air.viscosity, grains.inertia)}


def _reference(now: Instant) -> Vector:
    relative = 0.5 * now.curl - now.spin
    c = 0.75 * now.granule.ratio * magnus_factor(now.reynolds, now.rotation_reynolds(relative)) * relative
    return -(c * now.slip[1]), c * now.slip[0]


def _torque(now: Instant) -> float:
    """The torque of Dennis, Singh & Ingham 1980 over the creeping one, written out once more as they print it."""
    granule, relative = now.granule, 0.5 * now.curl - now.spin
    fast = now.rotation_reynolds(relative)
    slowing = 24 * granule.viscosity / (granule.inertia * granule.density * granule.diameter**2)
    return slowing * relative * max(1.0, (12.9 * math.sqrt(fast) + 128.4) / (64 * math.pi))


SPIN_LIFT = Force(
    name="magnus",
    means="spin lift across the slip, and the air's torque on the spin",
    source="Rubinow, S.I. & Keller, J.B. 1961, J. Fluid Mech. 11, 447; Loth, E. 2008, AIAA J. 46, 801",
    turns=True,
    by_gradient=True,
    bound=Bound(_shift, "Loth: spin of a sphere that leaves the slope rolling, and half the air's turning"),
    factors=_factors,
    constants=_constants,
    reference=_reference,
    torque=_torque,
)
