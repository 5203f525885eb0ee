"""Drag laws: the factor f = Cd Re / 24 by which drag exceeds Stokes' on a sphere (f -> 1 for a sphere as Re -> 0).

Drag acceleration is  f (u - v) / tau  with  tau = rho_p d^2 / (18 mu)  and  Re = rho |u - v| d / mu; d is the
diameter of the sphere of equal volume. Laws are pure and vectorised; none divides by Re.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..core.registry import Registry
from .constants import GRAVITY
from .gas import MEAN_FREE_PATH

Array = NDArray[np.float64]
TABLE_DECADES = (-8, 7)  # log10 Re at the table's ends; 1000, where two laws break, is a boundary between cells
TABLE_CELLS = 96  # cells per decade


@dataclass(frozen=True)
class DragLaw:
    """``factor(reynolds, sphericity)`` gives f = Cd Re / 24 (both broadcast); the law holds up to ``reynolds_max``;
    ``source`` names where it comes from.
    """

    factor: Callable[[Array, ArrayLike], Array]
    reynolds_max: float
    source: str
    uses_sphericity: bool = False


drag_laws: Registry[DragLaw] = Registry("drag law")


def _register(
    name: str, reynolds_max: float, source: str, *, uses_sphericity: bool = False
) -> Callable[[Callable[[Array, ArrayLike], Array]], Callable[[Array, ArrayLike], Array]]:
    def add(function: Callable[[Array, ArrayLike], Array]) -> Callable[[Array, ArrayLike], Array]:
        drag_laws.add(name, DragLaw(function, reynolds_max, source, uses_sphericity))
        return function

    return add


@_register("stokes", 0.1, "Stokes, G.G. 1851, Trans. Camb. Phil. Soc. 9, 8; 2 % low at Re 0.1")
def stokes(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """f = 1: creeping flow."""
    return np.ones(np.broadcast_shapes(np.shape(reynolds), np.shape(sphericity)))


@_register(
    "schiller-naumann", 1000.0, "Schiller, L. & Naumann, A. 1935, Z. Ver. Dtsch. Ing. 77, 318; 0.44 above Re 1000"
)
def schiller_naumann(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """f = 1 + 0.15 Re^0.687; above Re = 1000 Cd = 0.44 (a jump of 0.4 % there)."""
    re = np.asarray(reynolds, dtype=float)
    return np.where(re < 1000.0, 1.0 + 0.15 * re**0.687, 0.44 / 24.0 * re)


@_register("putnam", 1000.0, "Putnam, A. 1961, ARS J. 31, 1467; the sphereDrag of OpenFOAM")
def putnam(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """f = 1 + Re^(2/3) / 6; above Re = 1000 Cd = 0.424, 10 % below the standard curve there."""
    re = np.asarray(reynolds, dtype=float)
    return np.where(re < 1000.0, 1.0 + re ** (2.0 / 3.0) / 6.0, 0.424 / 24.0 * re)


@_register("clift-gauvin", 2e5, "Clift, R. & Gauvin, W.H. 1970, Proc. Chemeca 70, 1, 14")
def clift_gauvin(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """Cd = 24/Re (1 + 0.152 Re^0.677) + 0.417 / (1 + 5070 Re^-0.94)."""
    re = np.asarray(reynolds, dtype=float)
    power = re**0.94
    return 1.0 + 0.152 * re**0.677 + 0.417 / 24.0 * re * power / (power + 5070.0)


@_register("brown-lawler", 2e5, "Brown, P.P. & Lawler, D.F. 2003, J. Environ. Eng. 129, 222")
def brown_lawler(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """Cd = 24/Re (1 + 0.15 Re^0.681) + 0.407 / (1 + 8710/Re)."""
    re = np.asarray(reynolds, dtype=float)
    value: Array = 1.0 + 0.15 * re**0.681 + 0.407 / 24.0 * re * re / (re + 8710.0)
    return value


@_register("haider-levenspiel", 2.6e5, "Haider, A. & Levenspiel, O. 1989, Powder Technol. 58, 63", uses_sphericity=True)
def haider_levenspiel(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """Cd = 24/Re (1 + A Re^B) + C / (1 + D/Re), with A..D of the sphericity, or their separate fit for exact spheres.

    The general fit (Re < 2.5e4) taken to sphericity 1 lies within 4 % of the one for spheres (Re < 2.6e5).
    """
    re, phi = np.broadcast_arrays(np.asarray(reynolds, dtype=float), np.asarray(sphericity, dtype=float))
    sphere = phi == 1.0
    a = np.where(sphere, 0.1806, np.exp(2.3288 - 6.4581 * phi + 2.4486 * phi**2))
    b = np.where(sphere, 0.6459, 0.0964 + 0.5565 * phi)
    c = np.where(sphere, 0.4251, np.exp(4.905 - 13.8944 * phi + 18.4222 * phi**2 - 10.2599 * phi**3))
    d = np.where(sphere, 6880.95, np.exp(1.4681 + 12.2584 * phi - 20.7322 * phi**2 + 15.8855 * phi**3))
    value: Array = 1.0 + a * re**b + c / 24.0 * re * re / (re + d)
    return value


@_register("ganser", 2.5e4, "Ganser, G.H. 1993, Powder Technol. 77, 143; isometric shapes", uses_sphericity=True)
def ganser(reynolds: Array, sphericity: ArrayLike = 1.0) -> Array:
    """Cd = 24 / (Re K1) (1 + 0.1118 X^0.6567) + 0.4305 K2 / (1 + 3305/X), X = Re K1 K2 < 1e5 (Re 2.7e4 at phi = 0.7).

    K1 = 1 / (1/3 + 2/3 phi^-1/2), so that f(0) = 1/K1 > 1: unlike Haider & Levenspiel's, the law knows that shape slows
    creeping flow too. K2 = 10^(1.8148 (-log10 phi)^0.5743); some codes print ln for log10, which is wrong. At phi = 1
    it lies up to 27 % below the standard curve (Re 255): not for spheres.
    """
    re, phi = np.broadcast_arrays(np.asarray(reynolds, dtype=float), np.asarray(sphericity, dtype=float))
    k1 = 1.0 / (1.0 / 3.0 + 2.0 / 3.0 / np.sqrt(phi))
    k2 = 10.0 ** (1.8148 * np.maximum(-np.log10(phi), 0.0) ** 0.5743)
    x = re * k1 * k2
    value: Array = (1.0 + 0.1118 * x**0.6567) / k1 + 0.4305 / 24.0 * k2 * re * x / (x + 3305.0)
    return value


def drag_table(law: str, sphericity: float = 1.0) -> Array:
    """A law as piecewise cubics of log Re, (cells, 4): f = c0 + w (c1 + w (c2 + w c3)), 0 <= w < 1 within a cell.

    Cells have equal width in log Re over TABLE_DECADES, TABLE_CELLS a decade, and interpolate at Chebyshev points
    inside the cell, so a law that jumps at Re = 1000 keeps its jump. Relative error below 1e-8 for every registered
    law. Raises SceneError for an unknown law. The last ones are kept, so nobody may write into them.
    """
    return _table(drag_laws[law].factor, sphericity)


@lru_cache(maxsize=64)
def _table(factor: Callable[..., Array], sphericity: float) -> Array:
    """Make the table of a law's ``factor``: a law that is registered anew has a table of its own."""
    low, high = TABLE_DECADES
    cells = (high - low) * TABLE_CELLS
    w = 0.5 - 0.5 * np.cos(np.pi * (2 * np.arange(4) + 1) / 8)
    reynolds = 10.0 ** (low + (np.arange(cells)[:, None] + w) / TABLE_CELLS)
    values = np.asarray(factor(reynolds, sphericity))
    return np.ascontiguousarray(np.linalg.solve(w[:, None] ** np.arange(4), values.T).T)


def relaxation_time(diameter: ArrayLike, density: ArrayLike, viscosity: float) -> Array:
    """Stokes relaxation time rho_p d^2 / (18 mu), s; ``viscosity`` dynamic, Pa s."""
    value: Array = np.asarray(density, dtype=float) * np.asarray(diameter, dtype=float) ** 2 / (18.0 * viscosity)
    return value


def slip_correction(diameter: ArrayLike, mean_free_path: float = MEAN_FREE_PATH) -> Array:
    """Cunningham's Cc: drag is divided by it, since a small sphere slips between the gas's molecules; -> 1 for a large
    one, and 1 in a liquid, whose path is 0.

    Cc = 1 + (2 L / d) (1.257 + 0.4 exp(-0.55 d / L)), diameter and mean free path L in m: Davies, C.N. 1945, Proc.
    Phys. Soc. 57, 259; creeping flow, any d / L. In air of 20 C 1.17 at 1 um, 1.017 at 10 um.
    """
    knudsen = 2.0 * max(mean_free_path, 1e-300) / np.asarray(diameter, dtype=float)
    return 1.0 + knudsen * (1.257 + 0.4 * np.exp(-1.1 / knudsen))


def terminal_velocity(
    diameter: ArrayLike,
    density: ArrayLike,
    fluid_density: ArrayLike = 1.2,
    viscosity: ArrayLike = 1.8e-5,
    gravity: float = GRAVITY,
    law: str = "brown-lawler",
    sphericity: ArrayLike = 1.0,
    drag_scale: ArrayLike = 1.0,
) -> Array:
    """Speed (m/s) at which drag balances the submerged weight; positive when it sinks, negative when it rises.

    Diameter m, densities kg/m3, dynamic viscosity Pa s, gravity m/s2; ``drag_scale`` multiplies the law: 1 / Cc of
    :func:`slip_correction` for the finest dust, or a calibration. All broadcast. The balance f(Re) v = v_Stokes /
    drag_scale has one root, which is bisected to round-off; since f >= 1, it lies below v_Stokes / drag_scale.
    """
    d, rho_p, rho, mu, phi, scale = np.broadcast_arrays(
        *(np.asarray(a, dtype=float) for a in (diameter, density, fluid_density, viscosity, sphericity, drag_scale))
    )
    entry = drag_laws[law]
    excess = (rho_p - rho) * gravity
    target = np.abs(excess) * d**2 / (18.0 * mu * scale)
    low, high = np.zeros(target.shape), target.copy()
    for _ in range(200):
        middle = np.where(low > 0.0, np.sqrt(low * high), 1e-3 * high)
        too_fast = entry.factor(rho * middle * d / mu, phi) * middle > target
        high = np.where(too_fast, middle, high)
        low = np.where(too_fast, low, middle)
        if np.all(high - low <= 4e-16 * high):
            break
    value: Array = np.copysign(high, excess)
    return value


def drag_factor_for_terminal_velocity(
    diameter: ArrayLike,
    density: ArrayLike,
    terminal_velocity: ArrayLike,
    fluid_density: ArrayLike = 1.2,
    viscosity: ArrayLike = 1.8e-5,
    gravity: float = GRAVITY,
    law: str = "brown-lawler",
    sphericity: ArrayLike = 1.0,
) -> Array:
    """Factor c on a drag law with which a granule's terminal velocity is the measured one: c f(Re_t) v_t = v_Stokes.

    Units as in :func:`terminal_velocity`. Raises SceneError where the velocity is not positive or the granule does
    not sink.
    """
    d, rho_p, v, rho, mu, phi = np.broadcast_arrays(
        *(
            np.asarray(a, dtype=float)
            for a in (diameter, density, terminal_velocity, fluid_density, viscosity, sphericity)
        )
    )
    if not np.all(v > 0.0):
        raise SceneError(f"terminal_velocity = {float(v.min()):g} m/s must be positive")
    if not np.all(rho_p > rho):
        raise SceneError(f"density = {float(rho_p.min()):g} kg/m3 must exceed the fluid's for a terminal velocity")
    factor = drag_laws[law].factor(rho * v * d / mu, phi)
    value: Array = (rho_p - rho) * gravity * d**2 / (18.0 * mu * v * factor)
    return value


# -- How a granule's velocity relaxes to that of steady uniform air ----------------------------------------------------
def relaxed(velocity: Any, final: Any, tau: Any, step: Any, left: Any) -> tuple[Any, Any]:
    """Way (m) and velocity (m/s) after ``step`` (s) of v' = (final - v) / tau, exactly.

    ``velocity`` m/s, of any component; ``final`` m/s: that of the air, and tau times what else accelerates the granule;
    ``tau`` s; ``left`` exp(-step / tau), which the caller knows. Numbers or arrays, which broadcast.
    """
    return final * step + (velocity - final) * tau * (1.0 - left), final + (velocity - final) * left
