"""Mass flow of granules through an orifice under gravity, without vibration: Beverloo's law and its cone factor.

An empirical law for dry, free-flowing, nearly equal granules. Range: orifice wider than about 6 granules (narrower ones
jam), container wider than about 2.5 orifices, filled higher than about one orifice, granules above 0.5 mm (finer ones
are held back by the air). Vibration is outside the range.
"""

from __future__ import annotations

import math

from .constants import GRAVITY

__all__ = ["BEVERLOO_C", "BEVERLOO_K", "STAGNANT_ANGLE", "beverloo", "cone_factor"]

BEVERLOO_C = 0.58  # Beverloo, Leniger & van de Velde (1961); later authors: 0.55 to 0.65
BEVERLOO_K = 1.4  # spheres; the same source: 1.3 to 2.9 with the shape
STAGNANT_ANGLE = math.radians(45)  # angle of the stagnant zone's edge to the horizontal, where it is not measured


def beverloo(
    orifice: float,
    diameter: float,
    bulk_density: float,
    *,
    gravity: float = GRAVITY,
    c: float = BEVERLOO_C,
    k: float = BEVERLOO_K,
) -> float:
    """Mass flow (kg/s), W = C rho_b sqrt(g) (D - k d)^(5/2); 0 for an orifice narrower than k granules.

    ``orifice`` D and ``diameter`` d in m, ``bulk_density`` rho_b in kg/m3 (of the bed, not of a granule). A round
    orifice in a flat floor. Source: Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260.
    """
    value: float = c * bulk_density * math.sqrt(gravity) * max(0.0, orifice - k * diameter) ** 2.5
    return value


def cone_factor(half_angle: float, stagnant: float = STAGNANT_ANGLE) -> float:
    """Factor (tan(alpha) tan(phi))^-0.35 on Beverloo's rate for a cone of ``half_angle`` alpha (rad, to the vertical).

    phi is the angle of the stagnant zone's edge to the horizontal, 45 degrees where it is not known. Range: alpha < 90
    deg - phi; wider cones flow as a flat floor, factor 1. Source: Rose & Tanaka (1959), The Engineer 208, 465, as
    quoted by Nedderman (1992), Statics and Kinematics of Granular Materials; taken from secondary literature.
    """
    if half_angle >= math.pi / 2 - stagnant:
        return 1.0
    value: float = (math.tan(half_angle) * math.tan(stagnant)) ** -0.35
    return value
