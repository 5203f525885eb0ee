"""The air's pressure gradient, which presses a granule into the suction zone."""

from __future__ import annotations

from ...core.errors import known
from .record import AirProperties, Force, Grains, Instant, Slots, Vector
from .scales import Bound, FlightScales

__all__ = ["PRESSURE_GRADIENT"]


def _shift(flight: FlightScales) -> float:
    return flight.widths(flight.passage(flight.ratio * flight.flow_acceleration, flight.near))


def _factors(grains: Grains, _air: AirProperties) -> Slots:
    """PRESSURE (m3/kg): -1 / rho_p."""
    return {"PRESSURE": -1.0 / grains.density}


def _reference(now: Instant) -> Vector:
    density = now.granule.density
    return -(known(now.pressure_gradient)[0] / density), -(known(now.pressure_gradient)[1] / density)


PRESSURE_GRADIENT = Force(
    name="pressure-gradient",
    means="-grad p / rho_p: what presses a granule into the suction zone",
    source="Maxey, M.R. & Riley, J.J. 1983, Phys. Fluids 26, 883",
    needs="pressure",
    bound=Bound(_shift, "rho/rho_p U^2/D within 3 D of the body"),
    factors=_factors,
    reference=_reference,
)
