"""What a force that is not a parabola in time displaces: the error of the multi-cell steps, derived in docs/kernel.md.

A step makes N = F + B v a parabola in w = time / step, right at w = 0, 1/2 and 1. What N differs from it by at 1/4 and
3/4, o and m, has an even part, whose mean displaces most, and an odd one, of which only the first moment is left.
"""

from __future__ import annotations

import math

from .dense_output import phis
from .jit import compiled

__all__ = ["BOOLE", "carried", "displaced"]

BOOLE = 32.0 / 90.0  # Boole's rule: mean of a quartic that is zero at 0, 1/2 and 1 over its sum at 1/4 and 3/4
# First moment of a cubic with these zeros over its difference between 1/4 and 3/4 is 4/45; twice, rounded up: what it
# displaces in the step, and as much again by the velocity that drag's weighting of it leaves
ODD = 0.18


@compiled
def carried(rate, h, horizon):
    """Displacement over h (s) by a constant error of the force: within the step h, and after it by the velocity that it
    leaves, which lasts min(1 / B, horizon).
    """
    _, p1, p2, _, _ = phis(-rate * h)
    return h * p2 + p1 * min(1.0 / rate, horizon)


@compiled
def displaced(ox, oy, mx, my, carry, rate, h):
    """Displacement per time (m/s) by defects o at 1/4 and m at 3/4 of a step h; ``carry`` see ``carried``."""
    even = math.sqrt((ox + mx) ** 2 + (oy + my) ** 2)
    odd = math.sqrt((ox - mx) ** 2 + (oy - my) ** 2)
    return BOOLE * carry * even + ODD * h / (1.0 + rate * h) * odd
