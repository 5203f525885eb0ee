"""How much slower the air is far behind a body: the plane wake of a single one, a bound for what lies in it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DRAG = 2.0  # Cd of a bluff body on its width: about the largest
DEFICIT, SPREAD = 0.98, 0.57  # of the far wake, times sqrt(Cd D / x) and sqrt(Cd D x): sqrt(10) / (18 b), sqrt(10) b
# with b = 0.18 as measured (Schlichting, Boundary-Layer Theory, free turbulent flows: wake behind a single body)


def apart(one: Array, other: Array) -> float:
    """How far (m) two outlines are apart sideways; 0 where one is above the other."""
    return max(0.0, float(other[:, 0].min() - one[:, 0].max()), float(one[:, 0].min() - other[:, 0].max()))


def slower_behind(front: Array, behind: Array, along: float) -> float:
    """Part of the air's speed that the wake of the body in ``front`` lacks at the one ``behind`` it, at most; 0 where
    it does not come there. ``along``: 1 where the air blows up, else -1.
    """
    way = along * float(behind[:, 1].mean() - front[:, 1].mean())
    if way <= 0.0:
        return 0.0
    drag = DRAG * float(np.ptp(front[:, 0]))
    if apart(front, behind) > SPREAD * math.sqrt(drag * way):
        return 0.0
    return min(1.0, DEFICIT * math.sqrt(drag / way))
