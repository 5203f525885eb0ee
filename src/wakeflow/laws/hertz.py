"""Hertz' contact of elastic spheres: how long a collision lasts and how deep it goes.

Source: Hertz (1881); Johnson (1985), Contact Mechanics, section 11.4. Range: elastic, no adhesion,
depth small against the radius.
"""

from __future__ import annotations

import math

__all__ = ["contact_time", "depth"]


def _stiffness(diameter: float, density: float, modulus: float, poisson: float) -> tuple[float, float, float]:
    """Effective mass (kg), radius (m) and modulus (Pa) of two equal spheres."""
    return (
        density * math.pi / 12 * diameter**3,
        0.25 * diameter,
        modulus / (2 * (1 - poisson**2)),
    )


def contact_time(diameter: float, density: float, modulus: float, speed: float, poisson: float = 0.25) -> float:
    """Duration (s) of the collision of two equal spheres at relative ``speed`` (m/s).

    2.868 (m^2 / (R E^2 v))^(1/5) with the effective mass m, radius R and modulus E; ``diameter`` m, ``density`` kg/m3,
    Young's ``modulus`` Pa.
    """
    mass, radius, stiff = _stiffness(diameter, density, modulus, poisson)
    value: float = 2.868 * (mass**2 / (radius * stiff**2 * speed)) ** 0.2
    return value


def depth(diameter: float, density: float, modulus: float, speed: float, poisson: float = 0.25) -> float:
    """Deepest approach (m) in the same collision: (15 m v^2 / (16 sqrt(R) E))^(2/5)."""
    mass, radius, stiff = _stiffness(diameter, density, modulus, poisson)
    value: float = (15 * mass * speed**2 / (16 * radius**0.5 * stiff)) ** 0.4
    return value
