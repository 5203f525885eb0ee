"""Restitution laws: how the coefficient of restitution e depends on the normal speed v of approach, 0 <= e <= 1.

A plain number is the law of Newton, e the same at every speed. Measured values of e fall with the speed: the faster the
impact, the larger the part of the contact that yields (e ~ v^-1/4), or the part of the energy that viscous losses take
(1 - e ~ v^1/5). Each law here is fixed by what a drop test gives, one value at one speed, or by all the points that
were measured.

Laws are pure and vectorised; ``value(speed, *, parameters...)`` takes speeds (m/s, not negative) of any shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import numbers
from ..core.errors import SceneError
from ..core.geometry import halved
from ..core.registry import Registry

Array = NDArray[np.float64]
MAX_RESTITUTION = (
    0.99  # largest e of laws that are elastic below a yield speed, so that a bouncing granule comes to rest
)
MIN_RESTITUTION = 1e-3  # smallest e that a law of the speed can have been measured with: chosen
TABLE_SPEEDS = (1e-8, 1e3)  # m/s: between them a law is tabulated, beyond them it stays what it is there
TABLE_CELLS = 24  # cells a decade
PADE = (0.501086, 1.15345, 0.577977, 0.532178)  # of the viscoelastic law: c1 = b1, b2, b3, b4


@dataclass(frozen=True)
class RestitutionLaw:
    """``value(speed, **parameters)`` gives e; ``kinks(**parameters)`` the speeds (m/s) where its slope jumps; its
    ``source`` and the ``range`` of speeds it holds in.
    """

    value: Callable[..., Array]
    kinks: Callable[..., Sequence[float]]
    source: str
    range: str


restitution_laws: Registry[RestitutionLaw] = Registry("restitution law")


def _smooth(**parameters: Any) -> Sequence[float]:
    """Speeds where the slope of e jumps: none."""
    return ()


def _register(
    name: str, source: str, range_: str, kinks: Callable[..., Sequence[float]] = _smooth
) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    def add(function: Callable[..., Array]) -> Callable[..., Array]:
        restitution_laws.add(name, RestitutionLaw(function, kinks, source, range_))
        return function

    return add


@_register("constant", "Newton, I. 1687, Principia; the paper's R", "any speed, as an approximation")
def constant(speed: ArrayLike, *, value: float) -> Array:
    """e = value."""
    _check("value", value, 0.0, 1.0)
    return np.full(np.shape(speed), float(value))


def _power_kinks(*, value: float, at: float, exponent: float = 0.25, most: float = MAX_RESTITUTION) -> Sequence[float]:
    return (at * (value / most) ** (1.0 / exponent),)


@_register(
    "power",
    "Johnson, K.L. 1985, Contact Mechanics, ch. 11.5: e ~ v^-1/4 where the contact is fully plastic",
    "well above the speed at which the contact begins to yield; near it the law is cut off at `most`",
    _power_kinks,
)
def power(speed: ArrayLike, *, value: float, at: float, exponent: float = 0.25, most: float = MAX_RESTITUTION) -> Array:
    """e = min(most, value (v / at)^-exponent): ``value`` was measured at the speed ``at`` (m/s)."""
    _check_point(value, at, most)
    _check("exponent", exponent, 1e-3, 2.0)
    with np.errstate(divide="ignore"):
        return np.minimum(most, value * (np.asarray(speed, dtype=float) / at) ** -exponent)


def _thornton(ratio: Array) -> Array:
    """e of the ratio (yield speed) / speed, at most 1."""
    q = np.minimum(ratio, 1.0)
    plastic = q / (q + 2.0 * np.sqrt(1.2 - 0.2 * q * q))
    return math.sqrt(1.2 * math.sqrt(3.0)) * np.sqrt(1.0 - q * q / 6.0) * plastic**0.25


def _elastic_plastic_kinks(*, value: float, at: float, most: float = MAX_RESTITUTION) -> Sequence[float]:
    return (at * _solve(_thornton, value) / _solve(_thornton, most),)


@_register(
    "elastic-plastic",
    "Thornton, C. 1997, J. Appl. Mech. 64, 383, elastic-perfectly plastic spheres",
    "elastic below the yield speed (cut off at `most`), e ~ v^-1/4 far above it; low against tests where the material "
    "hardens",
    _elastic_plastic_kinks,
)
def elastic_plastic(speed: ArrayLike, *, value: float, at: float, most: float = MAX_RESTITUTION) -> Array:
    """e = (6 sqrt(3) / 5)^1/2 (1 - q^2 / 6)^1/2 [q / (q + 2 sqrt(6/5 - q^2 / 5))]^1/4, q = (yield speed) / v <= 1.

    The yield speed is the one that gives ``value`` at the speed ``at`` (m/s); below it e = 1, cut off at ``most``.
    """
    _check_point(value, at, most)
    yields = at * _solve(_thornton, value)
    v = np.maximum(np.asarray(speed, dtype=float), 0.5 * yields)  # elastic below the yield speed, whatever the speed
    return np.minimum(most, _thornton(yields / v))


def _pade(x: Array) -> Array:
    """e of x = beta^1/2 v^1/10."""
    c, b2, b3, b4 = PADE
    return (1.0 + c * x) / (1.0 + x * (c + x * (b2 + x * (b3 + x * b4))))


@_register(
    "viscoelastic",
    "Mueller, P. & Poeschel, T. 2011, Phys. Rev. E 84, 021302: Pade form of the series of Ramirez, R. et al. 1999, "
    "Phys. Rev. E 60, 4465 with delayed recovery (Schwager, T. & Poeschel, T. 2008, Phys. Rev. E 78, 051304)",
    "viscoelastic spheres that do not yield, small against the speed of sound; e -> 1 as v -> 0",
)
def viscoelastic(speed: ArrayLike, *, value: float, at: float) -> Array:
    """e = (1 + c x) / (1 + c x + b2 x^2 + b3 x^3 + b4 x^4), x^2 = beta v^1/5: 1 - 1.15345 beta v^1/5 + ... when slow.

    Hertz's contact with Kelvin-Voigt dissipation, which may not pull. beta is the one that gives ``value`` at the speed
    ``at`` (m/s). It agrees with the integrated contact within 3e-4 where e > 0.8 and within 9e-3 at any speed.
    """
    _check_point(value, at, 1.0)
    most = _solve(lambda x: _pade(1.0 / x), value)  # e rises with 1 / x
    return _pade((np.asarray(speed, dtype=float) / at) ** 0.1 / most)


def _table_kinks(*, speeds: Sequence[float], values: Sequence[float]) -> Sequence[float]:
    return tuple(speeds)


@_register("table", "your own measurement", "between the speeds measured; beyond them the nearest value", _table_kinks)
def table(speed: ArrayLike, *, speeds: Sequence[float], values: Sequence[float]) -> Array:
    """Measured ``values`` of e at rising ``speeds`` (m/s), linear in log v between them."""
    if len(speeds) != len(values) or not len(speeds):
        raise SceneError(f"restitution: {len(speeds)} speeds and {len(values)} values; give as many of both")
    if not (speeds[0] > 0.0 and all(b > a for a, b in pairwise(speeds))):
        raise SceneError("restitution: speeds must be positive and rise")
    for value in values:
        _check("values", value, 0.0, 1.0)
    v = np.clip(np.asarray(speed, dtype=float), speeds[0], speeds[-1])
    return np.asarray(np.interp(np.log(v), np.log(speeds), values))


def _check(name: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise SceneError(f"restitution: {name} = {value:g}, allowed {least:g} to {most:g}")


def _check_point(value: float, at: float, most: float) -> None:
    _check("most", most, 1e-3, 1.0)
    _check("value", value, 1e-3, most)
    if not 0.0 < at < math.inf:
        raise SceneError(f"restitution: at = {at:g} m/s must be positive")


def _solve(function: Callable[[Array], Array], value: float) -> float:
    """Where a ``function`` that rises from 0 at 0 to 1 at infinity (or 1) first has ``value``: bisection in log x."""
    ends = -60.0, 60.0  # e^-60 .. e^60
    return math.exp(halved(lambda x: not float(function(np.array(math.exp(x)))) >= value, *ends, 80)[1])


class Restitution:
    """A registered law with its parameters: ``Restitution("power", value=0.5, at=1.0)``; call it with speeds (m/s).

    Raises SceneError for an unknown law, for a parameter that is missing or that the law does not have, and for one out
    of range.
    """

    def __init__(self, law: str, **parameters: Any) -> None:
        entry = restitution_laws[law]
        wanted = {p.name: p.default for p in signature(entry.value).parameters.values() if p.kind is p.KEYWORD_ONLY}
        missing = [name for name, default in wanted.items() if default is Parameter.empty and name not in parameters]
        unknown = [name for name in parameters if name not in wanted]
        if missing or unknown:
            parts = [f"{word} {', '.join(names)}" for word, names in (("lacks", missing), ("has no", unknown)) if names]
            raise SceneError(f"restitution law {law!r} {' and '.join(parts)} (takes: {', '.join(wanted)})")
        units = {"at": "m/s", "speeds": "m/s"}
        self.law = law
        self.parameters = {
            key: numbers(f"restitution: {key}", given, units.get(key, "1")).tolist()
            for key, given in parameters.items()
        }
        entry.value(np.ones(1), **self.parameters)

    def __call__(self, speed: ArrayLike) -> Array:
        """e at normal approach speeds (m/s), of their shape."""
        return restitution_laws[self.law].value(numbers("speed", speed, "m/s"), **self.parameters)

    def __repr__(self) -> str:
        return f"Restitution({self.law!r}, {', '.join(f'{k}={v!r}' for k, v in self.parameters.items())})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Restitution) and (self.law, self.parameters) == (other.law, other.parameters)

    def __hash__(self) -> int:
        return hash(repr(self))

    def shifted(self, by: float) -> Restitution:
        """The law with ``by`` added to what was measured of it, its ``value`` or ``values``, no more than it can be."""
        most = self.parameters.get("most", MAX_RESTITUTION)
        said = {key: self.parameters[key] for key in ("value", "values") if key in self.parameters}
        least = 0.0 if self.law in ("constant", "table") else MIN_RESTITUTION
        most = 1.0 if least == 0.0 else most
        changed = dict(self.parameters)
        for key, measured in said.items():
            changed[key] = np.clip(np.asarray(measured) + by, least, most).tolist()
        return Restitution(self.law, **changed)

    @property
    def kinks(self) -> list[float]:
        """Speeds (m/s) where the slope of e jumps."""
        return sorted(restitution_laws[self.law].kinks(**self.parameters))


def restitution_at(restitution: ArrayLike | Restitution, approach: ArrayLike) -> Array:
    """e at normal ``approach`` speeds (m/s): a law's value there, or the numbers as they are."""
    return restitution(approach) if isinstance(restitution, Restitution) else numbers("restitution", restitution)


def restitution_table(law: Restitution) -> Array:
    """A law as piecewise cubics of log v for the compiled tracker, (cells, 6): log10 v at the cell's start, 1 / its
    width, and e = c0 + w (c1 + w (c2 + w c3)), 0 <= w <= 1 within it.

    Cells end at the law's kinks, so that the error, below 1e-7 for every registered law, does not grow there.
    """
    low, high = (round(math.log10(v)) for v in TABLE_SPEEDS)
    ends = np.linspace(low, high, (high - low) * TABLE_CELLS + 1)
    kinks = [math.log10(v) for v in law.kinks if TABLE_SPEEDS[0] < v < TABLE_SPEEDS[1]]
    ends = np.unique(np.concatenate([ends, kinks]))
    ends = ends[np.concatenate([[True], np.diff(ends) > 1e-12])]
    width = np.diff(ends)
    w = 0.5 - 0.5 * np.cos(np.pi * (2 * np.arange(4) + 1) / 8)
    values = law(10.0 ** (ends[:-1, None] + w * width[:, None]))
    cubic = np.linalg.solve(w[:, None] ** np.arange(4), values.T).T
    return np.ascontiguousarray(np.column_stack([ends[:-1], 1.0 / width, cubic]))
