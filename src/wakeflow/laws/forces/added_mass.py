"""Added mass: the air that a granule pushes aside takes part in its inertia."""

from __future__ import annotations

from .record import AirProperties, Array, Force, Grains, Granule, Instant, Slots, Vector
from .scales import Bound, FlightScales

__all__ = ["ADDED_MASS"]


def _shift(flight: FlightScales) -> float:
    granule = max(flight.landing, flight.arrival) * flight.reach(flight.whole)  # by its own change of velocity
    return flight.widths(0.5 * flight.ratio * (flight.passage(flight.flow_acceleration, flight.near) + granule))


def _inertia(grains: Grains, air: AirProperties) -> Array:
    """chi = rho / (2 rho_p): half of the displaced air's mass over the granule's."""
    return 0.5 * (air.density / grains.density)


def _factors(grains: Grains, air: AirProperties) -> Slots:
    """INERTIAL: chi, by which the air's own acceleration Du/Dt acts."""
    return {"INERTIAL": _inertia(grains, air)}


def _chi(granule: Granule) -> float:
    return 0.5 * granule.ratio


def _reference(now: Instant) -> Vector:
    chi = _chi(now.granule)
    return chi * now.air_acceleration[0], chi * now.air_acceleration[1]


ADDED_MASS = Force(
    name="added-mass",
    means="half the displaced air's mass takes part in the difference of accelerations; inside the inertia",
    source="Auton, T.R., Hunt, J.C.R. & Prud'homme, M. 1988, J. Fluid Mech. 197, 241",
    calm=True,
    by_gradient=True,
    bound=Bound(_shift, "rho/2rho_p times U^2/D within 3 D of the body and the granule's own change of velocity"),
    inertia=_inertia,
    factors=_factors,
    reference=_reference,
    reference_inertia=_chi,
)
