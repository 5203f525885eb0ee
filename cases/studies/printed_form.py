"""What eq. (2) of the paper gives as printed, beside what follows from eq. (1), in the body's frame.

.venv/bin/python cases/studies/printed_form.py

Spade, Vaicis, Vutukuru & Irbe 2020, doi 10.22616/ERDev.2020.19.TF365. Three forms of the velocity down the slope over
the closing speed W; the velocity off the slope is R cos(b) W in all. An energy (after over before) above 1 is energy
from nothing: the body's frame moves steadily during the impact, and neither R <= 1 nor friction can give any.
"""

from __future__ import annotations

import math

import wakeflow as wf

CASES = (  # slope angle (deg), restitution, friction
    (45, 0.5, 0.3),
    (45, 0.1, 0.6),
    (45, 0.5, 0.0),
    (30, 0.5, 0.2),
    (60, 0.5, 0.35),
    (60, 0.9, 0.2),
    (60, 0.0, 0.0),
    (30, 0.5, 0.6),
)


def forms(slope_angle: float, restitution: float, friction: float) -> tuple[float, float, float]:
    """Velocity down the slope over W: as derived (slip or stick), eq. (2) as printed, eq. (1) with its printed sign."""
    derived = wf.impact(slope_angle, 1.0, 0.0, restitution, friction).tangential
    sine, cosine = math.sin(slope_angle), math.cos(slope_angle)
    printed = math.sin(slope_angle - friction * cosine) * (1.0 + restitution)
    return float(derived), printed, -(sine + friction * (1.0 + restitution) * cosine)


def main() -> None:
    """Print the table of docs/model.md."""
    print("| b, deg | R | f | derived: v_x / W | energy | eq. (2), printed | energy | eq. (1), printed sign | energy |")
    print("|---|---|---|---|---|---|---|---|---|")
    for degrees, restitution, friction in CASES:
        angle = math.radians(degrees)
        off = restitution * math.cos(angle)
        cells = [f"{along:.4f} | {along**2 + off**2:.3f}" for along in forms(angle, restitution, friction)]
        print(f"| {degrees} | {restitution:g} | {friction:g} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
