"""Flights of the matrix: the tracker timed, and a reference for air that is uniform, of the drag laws' own formulas."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.extremes.matrix import Happened
from proofs.problems.exact import G, Setting, fly
from wakeflow.flight import Fate, Granules, Tracks, track
from wakeflow.laws.drag import drag_laws

Array = NDArray[np.float64]
TOLERANCE = 1e-6  # of the row's length: the tracker's default
RTOL = 1e-12  # of the reference
STIFF = 300.0  # relaxation times in a flight beyond which an implicit method is the quicker one


def timed_flight(*arguments: Any, **more: Any) -> tuple[Tracks, float]:
    """What ``wf.track`` returns, and the seconds it took."""
    begun = time.perf_counter()
    tracks = track(*arguments, **more)
    return tracks, time.perf_counter() - begun


def what_happened(tracks: Tracks, seconds: float, error: float | None, note: str = "") -> Happened:
    """What happened to ``tracks``, whose flight took ``seconds``."""
    numbers = (tracks.position, tracks.velocity, tracks.time, tracks.spin)
    fates = {Fate(fate).name.lower(): int(np.sum(tracks.fate == fate)) for fate in np.unique(tracks.fate)}
    finite = all(bool(np.isfinite(one).all()) for one in numbers)
    return Happened(len(tracks), fates, finite, error, float(np.mean(tracks.steps)), seconds, note)


def against_answer(setting: Setting, position: Array, tolerance: float = TOLERANCE, note: str = "") -> Happened:
    """Fly a setting; its error is the distance of the worst granule from where it must be, ``position`` (n, 2) m, over
    the tolerance times the setting's length.
    """
    length = float(setting.arguments.get("length", 1.0))
    begun = time.perf_counter()
    tracks = fly(setting, tolerance)
    seconds = time.perf_counter() - begun
    away = np.linalg.norm(tracks.position - position, axis=1) / (tolerance * length)
    return what_happened(tracks, seconds, float(away.max()), note)


def falls_in_uniform_air(
    grains: Granules, until: float, air: Sequence[float], fluid: tuple[float, float], law: str, *, submerged: bool
) -> Array:
    """Positions (n, 2) m at ``until`` (s) of granules born at 0 s in uniform ``air`` (m/s) of a ``fluid`` (kg/m3, Pa
    s): drag by the formula of a ``law``, not its table; ``submerged``: also buoyancy and the added mass of a sphere.

    scipy's DOP853, or Radau where the flight lasts many relaxation times; to a relative RTOL.
    """
    return np.array([_end(grains[[i]], until, np.asarray(air, dtype=float), fluid, law, submerged)
                     for i in range(len(grains))])  # fmt: skip


def _end(grain: Granules, until: float, air: Array, fluid: tuple[float, float], law: str, submerged: bool) -> Array:
    from scipy.integrate import solve_ivp

    rho, mu = fluid
    d, ratio = float(grain.diameter[0]), rho / float(grain.density[0])
    stokes = float(grain.drag_scale[0]) * 18.0 * mu / (float(grain.density[0]) * d * d)
    factor, phi = drag_laws[law].factor, float(grain.sphericity[0])
    pull = np.array([0.0, -G * (1.0 - ratio if submerged else 1.0)])
    inertia = 1.0 + 0.5 * ratio if submerged else 1.0

    def rhs(_: float, z: Any) -> Any:
        slip = air - z[2:]
        drag = stokes * float(factor(np.array(rho * float(np.hypot(*slip)) * d / mu), phi))
        return np.concatenate([z[2:], (drag * slip + pull) / inertia])

    start = np.concatenate([grain.position[0], grain.velocity[0]])
    method = "Radau" if until * stokes > STIFF * inertia else "DOP853"
    size = max(float(np.abs(start).max()), 1e-30)
    found = solve_ivp(rhs, (0.0, until), start, method=method, rtol=RTOL, atol=1e-6 * RTOL * size)
    if not found.success:
        raise ArithmeticError(f"the reference integrator gave up: {found.message}")
    end: Array = found.y[:2, -1]
    return end
