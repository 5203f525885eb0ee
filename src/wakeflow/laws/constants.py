"""Constants that several laws share."""

from __future__ import annotations

GRAVITY = 9.81  # m/s2
STANDARD_AIR = (1.204, 1.825e-5)  # kg/m3 and Pa s at 20 C: where terminal velocities are measured
C_MU = 0.09  # of the k-epsilon and k-omega models: dissipation = C_MU k omega (Launder & Spalding 1974)
