"""First rebound of hard spheres from a hard plate, angle by angle (Kharaz, Gorham & Salman 2001).

5 mm spheres of aluminium oxide fell on a thick anvil of glass at 3.9 m/s, from nearly normal to nearly grazing. Read:
the rebound angle phi of the contact patch against the impact angle theta, both from the normal, as digitised for Chung
& Ooi's benchmark 4 (Granular Matter 13, 643, 2011) and kept with the tests of several programs. With the sphere's
tangential impulse J = 2/7 (v_t - e v_n tan phi) the centre leaves at atan(e_t tan theta / e), e_t = 1 - J / v_t; a
degree of reading in phi is 0.3 degrees of that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from proofs.report import Report, Row, Table, Tell
from wakeflow.laws.collision import collide
from wakeflow.laws.constants import GRAVITY

Array = NDArray[np.float64]
SOURCE = "Kharaz, Gorham & Salman 2001, Powder Technol. 120, 281, digitised"
SPEED, RADIUS, RESTITUTION, FRICTION = 3.9, 2.5e-3, 0.98, 0.092  # m/s, m; read in the benchmark's data
SPHERE = 0.4  # I / (m r^2)
HARD = 0.4  # tangential restitution of hard spheres
MEASURED = (  # degrees from the normal: impact of the centre, rebound of the contact patch
    (2.10, 0.77), (3.94, 0.77), (9.72, -1.06), (20.31, -8.53), (30.16, -2.55), (39.12, 9.91), (49.51, 30.02),
    (59.90, 49.95), (70.46, 66.90), (78.86, 78.87), (84.78, 85.68),
)  # fmt: skip
OBLIQUE, WITHIN_OBLIQUE, WITHIN = 30.0, 0.4, 0.9  # degrees: from this angle on, and everywhere
DROP = 0.5  # m below the plate: where the landing is compared
READABLE = (15.0, 72.0)  # degrees between which the landing is told: beyond them the reading amplifies
COLUMNS = {
    "impact, deg": "{theta:.2f}", "measured rebound of the centre, deg": "{measured:.2f}",
    "no tangential restitution": "{plain:.2f}", "0.4": "{hard:.2f}", "deviation": "{off:+.2f}",
    "gate": "{gate}", "met": "{met:yes|NO}", "lands 0.5 m lower, m": "{lands:.3f}",
    "measured": "{landed:.3f}", "without": "{landed_plain:.3f}",
}  # fmt: skip


def centre_angle(theta: float, phi: float) -> float:
    """Rebound angle (degrees from the normal) of the centre, from that of the contact patch."""
    t, p = np.radians([theta, phi])
    along, into = np.sin(t), np.cos(t)
    gone = 2.0 / 7.0 * (along - RESTITUTION * into * np.tan(p))
    return float(np.degrees(np.arctan((1.0 - gone / along) * np.tan(t) / RESTITUTION)))


def rebound(theta: float, back: float) -> float:
    """The same as the program has it, with a tangential restitution ``back``."""
    t = np.radians(theta)
    plate = 0.0, 1.0, 0.0, 0.0, RESTITUTION, FRICTION, 1.0 / SPHERE, RADIUS, back
    along, up, *_ = collide(SPEED * np.sin(t), -SPEED * np.cos(t), 0.0, *plate)
    return float(np.degrees(np.arctan2(along, up)))


def landing(theta: float, rebound_angle: float) -> float:
    """How far (m) to the side a sphere lands DROP below a plate that is inclined by ``theta`` degrees and that it
    leaves ``rebound_angle`` degrees off its normal, without air.
    """
    t, a = np.radians([theta, rebound_angle])
    normal = RESTITUTION * SPEED * np.cos(t)
    along = normal * np.tan(a)
    across, up = along * np.cos(t) + normal * np.sin(t), normal * np.cos(t) - along * np.sin(t)
    return float(across * (up + np.sqrt(up**2 + 2.0 * GRAVITY * DROP)) / GRAVITY)


def rows() -> list[Row]:
    """A row an angle."""
    made = []
    for theta, phi in MEASURED:
        measured, plain, hard = centre_angle(theta, phi), rebound(theta, 0.0), rebound(theta, HARD)
        within = WITHIN_OBLIQUE if theta >= OBLIQUE else WITHIN
        told = READABLE[0] < theta < READABLE[1]
        made.append({
            "case": "rebound", "quantity": f"{theta} deg", "theta": theta, "measured": measured, "plain": plain,
            "hard": hard, "off": hard - measured, "gate": f"within {within}", "met": abs(hard - measured) <= within,
            "lands": landing(theta, hard) if told else None, "landed": landing(theta, measured) if told else None,
            "landed_plain": landing(theta, plain) if told else None, "source": SOURCE,
        })  # fmt: skip
    return made


def run_rebound(tell: Tell = lambda _: None) -> Report:
    """Of all angles."""
    tell("rebound of spheres")
    found = rows()
    largest = max(abs(row["off"]) for row in found)
    notes = [f"{SOURCE}; largest deviation {largest:.2f} deg, without tangential restitution "
             f"{max(abs(row['plain'] - row['measured']) for row in found):.2f} deg"]  # fmt: skip
    missed = [f"rebound at {row['theta']} deg" for row in found if not row["met"]]
    return Report("rebound", [Table("rebound of 5 mm spheres", COLUMNS, found)], {"rows": found}, notes, missed)
