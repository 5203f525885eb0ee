"""Shear lift (Saffman-Mei): a granule that slips in air which turns is pushed across its slip; laws/lift.py."""

from __future__ import annotations

from ..lift import lift_coefficient
from .record import AirProperties, Force, Grains, Instant, Slots, Vector
from .scales import Bound, FlightScales

__all__ = ["SHEAR_LIFT"]

SHEAR = 20.0  # U / D: vorticity of a wake's shear layer; chosen: the lift goes with its square root


def _shift(flight: FlightScales) -> float:
    shear = SHEAR * flight.air_speed / flight.width
    scale = flight.air_density * flight.diameter / flight.viscosity
    coefficient = lift_coefficient(scale * flight.typical_slip, scale * flight.diameter * shear)
    kick = flight.ratio * coefficient * flight.typical_slip * flight.turned
    return flight.widths(kick * flight.reach(flight.time))


def _factors(grains: Grains, air: AirProperties) -> Slots:
    """LIFT: rho / rho_p, times the compiled coefficient."""
    return {"LIFT": air.density / grains.density}


def _reference(now: Instant) -> Vector:
    c = now.granule.ratio * lift_coefficient(now.reynolds, now.rotation_reynolds(now.curl))
    return c * now.slip[1] * now.curl, -(c * now.slip[0] * now.curl)


SHEAR_LIFT = Force(
    name="lift",
    means="shear lift: across the slip in air that turns",
    source="Saffman, P.G. 1965, J. Fluid Mech. 22, 385; Mei, R. 1992, Int. J. Multiphase Flow 18, 145",
    by_gradient=True,
    bound=Bound(
        _shift, "Saffman-Mei: slip times the angle through which the air turns across the shear layers that are met"
    ),
    factors=_factors,
    reference=_reference,
)
