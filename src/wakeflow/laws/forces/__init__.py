"""The forces on a granule: one small file and one record each, listed here in the order of plans and tables.

The tracker computes what it is asked to; the plan decides by a bound on the landing shift of each force.
"""

from __future__ import annotations

from .basic import ADDED_MASS, BUOYANCY, DRAG, GRAVITY_FORCE, PRESSURE_GRADIENT
from .fluctuations import BROWNIAN_MOTION, DISPERSION
from .force import Bound, FlightScales, Force, Granule, Instant, forces
from .history_force import HISTORY_FORCE
from .lift_forces import SHEAR_LIFT, SPIN_LIFT

__all__ = ["Bound", "FlightScales", "Force", "Granule", "Instant", "forces"]

for _force in (
    DRAG, GRAVITY_FORCE, BUOYANCY, PRESSURE_GRADIENT, ADDED_MASS, SHEAR_LIFT, SPIN_LIFT, DISPERSION, BROWNIAN_MOTION,
    HISTORY_FORCE,
):  # fmt: skip
    forces.add(_force.name, _force)
