"""The forces on a granule: a record each, listed here in the order of plans and tables.

The tracker computes what it is asked to; the plan decides by a bound on the landing shift of each force.
"""

from __future__ import annotations

from . import records
from .force import Bound, FlightScales, Force, Granule, Instant, forces
from .history_force import HISTORY_FORCE

__all__ = ["Bound", "FlightScales", "Force", "Granule", "Instant", "forces"]

for _force in (
    records.DRAG, records.GRAVITY_FORCE, records.BUOYANCY, records.PRESSURE_GRADIENT, records.ADDED_MASS,
    records.SHEAR_LIFT, records.SPIN_LIFT, records.DISPERSION, records.BROWNIAN_MOTION, HISTORY_FORCE,
):  # fmt: skip
    forces.add(_force.name, _force)
