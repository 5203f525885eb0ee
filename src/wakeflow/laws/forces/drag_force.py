"""Drag: what the slip through the air costs a granule, by the drag law of its fraction."""

from __future__ import annotations

from .record import AirProperties, Force, Grains, Instant, Slots, Vector

__all__ = ["DRAG"]


def _factors(grains: Grains, air: AirProperties) -> Slots:
    """STOKES (1/s): rate of Stokes drag, 18 mu / (rho_p d^2), times the factor on the law."""
    return {"STOKES": grains.drag_scale * 18.0 * air.viscosity / (grains.density * grains.diameter**2)}


def _reference(now: Instant) -> Vector:
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
    reference=_reference,
)
