"""The forces on a granule: one small file and one record each, listed here in the order of plans and tables.

The tracker computes what it is told to; the plan decides by a bound on the landing shift of each force.
"""

from __future__ import annotations

from .added_mass import ADDED_MASS
from .brownian_motion import BROWNIAN_MOTION
from .buoyancy import BUOYANCY
from .drag_force import DRAG
from .history_force import HISTORY_FORCE
from .pressure_gradient import PRESSURE_GRADIENT
from .record import Force, Granule, Instant, forces
from .scales import Bound, FlightScales
from .shear_lift import SHEAR_LIFT
from .spin_lift import SPIN_LIFT
from .turbulent_dispersion import DISPERSION
from .weight import GRAVITY_FORCE

__all__ = ["Bound", "FlightScales", "Force", "Granule", "Instant", "forces"]

for _force in (
    DRAG, GRAVITY_FORCE, BUOYANCY, PRESSURE_GRADIENT, ADDED_MASS, SHEAR_LIFT, SPIN_LIFT, DISPERSION, BROWNIAN_MOTION,
    HISTORY_FORCE,
):  # fmt: skip
    forces.add(_force.name, _force)
