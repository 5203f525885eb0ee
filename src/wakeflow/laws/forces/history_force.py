"""The history force (Basset): drag's memory of past slip. It is bounded and not computed."""

from __future__ import annotations

import math

import numpy as np

from ..drag import relaxation_time
from .record import Array, Force
from .scales import SIDEWAYS, Bound, FlightScales

__all__ = ["HISTORY_FORCE", "history_kernel", "history_time"]

SLOWEST = 0.1  # of the typical slip: what the slip seldom falls below; chosen, and tried along recorded tracks
NODES = 2001  # of the quadrature in time^(1/4): error below 1e-4


def history_kernel(time: Array, radius: float, speed: float, kinematic: float) -> Array:
    """K(t) of the history force 6 pi mu a int K(t - s) d(u - v)/ds ds; ``time`` s, ``radius`` m, slip ``speed`` m/s.

    K = {[pi t nu / a^2]^(1/4) + [pi U^3 t^2 / (2 a nu f_H^3)]^(1/2)}^-2, f_H = 0.75 + 0.105 Re, Re = 2 a U / nu: Mei,
    R. & Adrian, R.J. 1992, J. Fluid Mech. 237, 323, for Re up to about 100; Basset's sqrt(a^2 / pi nu t) at first,
    falling as 1 / t^2 later. ``kinematic`` viscosity m2/s.
    """
    factor = 0.75 + 0.105 * 2.0 * radius * speed / kinematic
    early = (math.pi * time * kinematic / radius**2) ** 0.25
    late = np.sqrt(0.5 * math.pi * speed**3 / (radius * kinematic * factor**3)) * time
    return np.asarray(1.0 / (early + late) ** 2)


def history_time(time: float, radius: float, speed: float, kinematic: float) -> float:
    """Integral (s) of :func:`history_kernel` from 0 to ``time`` (s), to 1e-4."""
    z = np.linspace(0.0, time**0.25, NODES)  # t = z^4 takes the singularity out
    middle = 0.5 * (z[1:] + z[:-1])
    return float(np.sum(history_kernel(middle**4, radius, speed, kinematic) * 4.0 * middle**3 * np.diff(z)))


def _shift(flight: FlightScales) -> float:
    stokes = float(relaxation_time(flight.diameter, flight.density, flight.viscosity))
    slowest = max(SLOWEST * flight.typical_slip, min(flight.settling, flight.typical_slip))
    memory = history_time(flight.whole, 0.5 * flight.diameter, slowest, flight.viscosity / flight.air_density)
    last = min(flight.time, flight.tau)  # after a step of the air's velocity the shift grows as t exp(-t / tau)
    air = 0.0 if flight.calm else flight.air_speed
    sideways, along = max(SIDEWAYS * air, flight.thrown), max(air, flight.landing)  # change of the air's or its own
    change = min(math.hypot(sideways, flight.slope * along), flight.typical_slip)
    return flight.widths(memory / stokes * change * last * math.exp(-last / flight.tau))


HISTORY_FORCE = Force(
    name="basset-history",
    means="drag's memory of past slip",
    source="Basset, A.B. 1888, Phil. Trans. R. Soc. A 179, 43; Mei, R. & Adrian, R.J. 1992, J. Fluid Mech. 237, 323",
    computed=False,
    bound=Bound(_shift, "Mei & Adrian's kernel, an inertia of its integral over tau, times the change of slip"),
)
