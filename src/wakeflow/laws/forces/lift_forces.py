"""Lift: of shear (Saffman-Mei) and of spin (Magnus)."""

from __future__ import annotations

import math

import numpy as np

from ..flake import plate_lift, plate_torque
from ..lift import lift_coefficient, magnus_factor, spin_rate
from .force import AirProperties, Bound, FlightScales, Force, Grains, Instant, Slots, Vector

# -- Shear lift --------------------------------------------------------------------------------------------------------
SHEAR = 20.0  # U / D: vorticity of a wake's shear layer; chosen: the lift goes with its square root


def _shear_shift(flight: FlightScales) -> float:
    shear = SHEAR * flight.air_speed / flight.width
    scale = flight.air_density * flight.diameter / flight.viscosity
    coefficient = lift_coefficient(scale * flight.typical_slip, scale * flight.diameter * shear)
    kick = flight.ratio * coefficient * flight.typical_slip * flight.turned
    return flight.widths(kick * flight.reach(flight.time))


def _shear_factors(grains: Grains, air: AirProperties) -> Slots:
    """LIFT: rho / rho_p, times the compiled coefficient."""
    return {"LIFT": air.density / grains.density}


def _shear_reference(now: Instant) -> Vector:
    c = now.granule.ratio * lift_coefficient(now.reynolds, now.rotation_reynolds(now.curl))
    return c * now.slip[1] * now.curl, -(c * now.slip[0] * now.curl)


SHEAR_LIFT = Force(
    name="lift",
    means="shear lift: across the slip in air that turns",
    source="Saffman, P.G. 1965, J. Fluid Mech. 22, 385; Mei, R. 1992, Int. J. Multiphase Flow 18, 145",
    by_gradient=True,
    bound=Bound(
        _shear_shift,
        "Saffman-Mei: slip times the angle through which the air turns across the shear layers that are met",
    ),
    factors=_shear_factors,
    reference=_shear_reference,
)


# -- Spin lift ---------------------------------------------------------------------------------------------------------
def _shift(flight: FlightScales) -> float:
    rolls = flight.thrown if flight.calm or flight.kept else flight.arrival
    spin = rolls / (0.5 * flight.diameter)  # off a slope or a wall
    scale = flight.air_density * flight.diameter / flight.viscosity
    lift = 0.75 * flight.ratio * magnus_factor(scale * flight.typical_slip, scale * flight.diameter * spin)
    lasting = 1.0 / float(spin_rate(flight.diameter, flight.density, flight.viscosity))
    by_granule = flight.passage(lift * spin * flight.typical_slip, lasting)
    by_air = 0.75 * flight.ratio * flight.typical_slip * 0.5 * flight.turned * flight.reach(flight.time)
    return flight.widths(by_granule + by_air)


def _factors(grains: Grains, air: AirProperties) -> Slots:
    """MAGNUS: 3/4 rho / rho_p, times the compiled factor; of flakes their own."""
    ratio = air.density / grains.density
    return {"MAGNUS": grains.spin_lift * np.where(grains.flake, plate_lift(grains.shape, ratio), 0.75 * ratio)}


def _constants(grains: Grains, air: AirProperties) -> Slots:
    """SPIN_RATE (1/s): rate at which the air takes a spin away; of flakes SPIN_TORQUE, which grows with the spin."""
    torque = np.where(grains.flake, plate_torque(grains.shape, air.density / grains.density), 0.0)
    rate = spin_rate(grains.diameter, grains.density, air.viscosity, grains.inertia)
    return {"SPIN_RATE": rate, "SPIN_TORQUE": torque}


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
