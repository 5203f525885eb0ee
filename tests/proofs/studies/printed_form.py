"""What eq. (2) of the paper gives as printed, next to what follows from eq. (1), in the body's frame.

Spade, Vaicis, Vutukuru & Irbe 2020, doi 10.22616/ERDev.2020.19.TF365. Three forms of the velocity down the slope over
the closing speed W; the velocity off the slope is R cos(b) W in all. An energy (after over before) above 1 is energy
from nothing: the body's frame moves steadily during the impact, and neither R <= 1 nor friction can give any.
"""

from __future__ import annotations

import math

import wakeflow as wf

from .common import Row, show

SLOPES = (  # slope angle (deg), restitution, friction
    (45, 0.5, 0.3), (45, 0.1, 0.6), (45, 0.5, 0.0), (30, 0.5, 0.2), (60, 0.5, 0.35), (60, 0.9, 0.2), (60, 0.0, 0.0),
    (30, 0.5, 0.6),
)  # fmt: skip
COLUMNS = {
    "b, deg": "{degrees}", "R": "{restitution:g}", "f": "{friction:g}",
    "derived: v_x / W": "{along[0]:.4f}", "energy": "{energy[0]:.3f}",
    "eq. (2), printed": "{along[1]:.4f}", "energy by (2)": "{energy[1]:.3f}",
    "eq. (1), printed sign": "{along[2]:.4f}", "energy by (1)": "{energy[2]:.3f}",
}  # fmt: skip


def forms(slope_angle: float, restitution: float, friction: float) -> tuple[float, float, float]:
    """Velocity down the slope over W: as derived (slip or stick), eq. (2) as printed, eq. (1) with its printed sign."""
    derived = wf.impact(slope_angle, 1.0, 0.0, restitution, friction).tangential
    sine, cosine = math.sin(slope_angle), math.cos(slope_angle)
    printed = math.sin(slope_angle - friction * cosine) * (1.0 + restitution)
    return float(derived), printed, -(sine + friction * (1.0 + restitution) * cosine)


def row(degrees: float, restitution: float, friction: float) -> Row:
    """Velocities and energies of the three forms."""
    angle = math.radians(degrees)
    along = forms(angle, restitution, friction)
    energy = [speed**2 + (restitution * math.cos(angle)) ** 2 for speed in along]
    return {"degrees": degrees, "restitution": restitution, "friction": friction, "along": along, "energy": energy}


def main() -> list[Row]:
    """Energy by eq. (1) and (2) of the paper as printed, and as derived."""
    return show(COLUMNS, (row(*slope) for slope in SLOPES))
