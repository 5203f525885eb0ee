"""Weight, buoyancy, drag, the air's pressure gradient and added mass."""

from __future__ import annotations

import numpy as np

from .force import (
    AirProperties,
    Array,
    Bound,
    FlightScales,
    Force,
    Grains,
    Granule,
    Instant,
    Slots,
    Vector,
    drag_scale,
)


# -- Weight ------------------------------------------------------------------------------------------------------------
def _weight(grains: Grains, _air: AirProperties | None, gravity: Array) -> Array:
    return np.tile(gravity, (len(grains), 1))


def _weight_now(now: Instant) -> Vector:
    return now.granule.gravity


GRAVITY_FORCE = Force(
    name="gravity",
    means="weight",
    source="g",
    needs="nothing",
    calm=True,
    acceleration=_weight,
    reference=_weight_now,
)


# -- Buoyancy ----------------------------------------------------------------------------------------------------------
def _shift(flight: FlightScales) -> float:
    return flight.slope * flight.widths(flight.steady(flight.ratio * flight.gravity, flight.whole))


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


# -- Drag --------------------------------------------------------------------------------------------------------------
def _factors(grains: Grains, air: AirProperties) -> Slots:
    """STOKES (1/s): rate of Stokes drag, 18 mu / (rho_p d^2), times the factor on the law."""
    return {"STOKES": drag_scale(grains, air) * 18.0 * air.viscosity / (grains.density * grains.diameter**2)}


def _drag_force_reference(now: Instant) -> Vector:
    granule = now.granule
    stokes = granule.drag_scale * 18 * granule.viscosity / (granule.density * granule.diameter**2)
    rate = stokes * granule.drag_factor(now.reynolds)
    return rate * now.slip[0], rate * now.slip[1]


DRAG = Force(
    name="drag",
    means="drag of the air at the slip velocity",
    source="laws/drag.py: a registered law for each fraction",
    calm=True,
    factors=_factors,
    reference=_drag_force_reference,
)


# -- The air's pressure gradient ---------------------------------------------------------------------------------------
def _pressure_gradient_shift(flight: FlightScales) -> float:
    return flight.widths(flight.passage(flight.ratio * flight.flow_acceleration, flight.near))


def _pressure_gradient_factors(grains: Grains, _air: AirProperties) -> Slots:
    """PRESSURE (m3/kg): -1 / rho_p."""
    return {"PRESSURE": -1.0 / grains.density}


def _pressure_gradient_reference(now: Instant) -> Vector:
    density = now.granule.density
    return -(now.pressure_gradient[0] / density), -(now.pressure_gradient[1] / density)


PRESSURE_GRADIENT = Force(
    name="pressure-gradient",
    means="-grad p / rho_p: what presses a granule into the suction zone",
    source="rho Du/Dt of Maxey, M.R. & Riley, J.J. 1983, Phys. Fluids 26, 883, in its mean over eddies: Minier, J.-P. "
    "& Peirano, E. 2001, Phys. Rep. 352, 1",
    needs="pressure",
    bound=Bound(_pressure_gradient_shift, "rho/rho_p U^2/D within 3 D of the body"),
    factors=_pressure_gradient_factors,
    reference=_pressure_gradient_reference,
)


# -- Added mass --------------------------------------------------------------------------------------------------------
def _added_mass_shift(flight: FlightScales) -> float:
    granule = max(flight.landing, flight.arrival) * flight.reach(flight.whole)  # by its own change of velocity
    return flight.widths(0.5 * flight.ratio * (flight.passage(flight.flow_acceleration, flight.near) + granule))


def _inertia(grains: Grains, air: AirProperties) -> Array:
    """chi = rho / (2 rho_p): half of the displaced air's mass over the granule's."""
    return 0.5 * (air.density / grains.density)


def _added_mass_factors(grains: Grains, air: AirProperties) -> Slots:
    """INERTIAL: chi, by which the air's own acceleration Du/Dt acts."""
    return {"INERTIAL": _inertia(grains, air)}


def _chi(granule: Granule) -> float:
    return 0.5 * granule.ratio


def _added_mass_reference(now: Instant) -> Vector:
    chi = _chi(now.granule)
    return chi * now.air_acceleration[0], chi * now.air_acceleration[1]


ADDED_MASS = Force(
    name="added-mass",
    means="half the displaced air's mass takes part in the difference of accelerations; inside the inertia",
    source="Auton, T.R., Hunt, J.C.R. & Prud'homme, M. 1988, J. Fluid Mech. 197, 241",
    calm=True,
    by_gradient=True,
    bound=Bound(
        _added_mass_shift, "rho/2rho_p times U^2/D within 3 D of the body and the granule's own change of velocity"
    ),
    inertia=_inertia,
    factors=_added_mass_factors,
    reference=_added_mass_reference,
    reference_inertia=_chi,
)
