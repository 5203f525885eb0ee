"""The best estimate of a real wake between its two-dimensional ends: how much of each, from measurements.

A steady wake of a bluff body is too long and its suction too weak; a time-resolved one in two dimensions sheds too
coherently, and its suction is too strong. ``theta`` is the share of the second in the mean of the air, ``strength``
the rms of the real fluctuation over that of the second. A measured number x between the two ends says theta = (x -
steady) / (resolved - steady), a fluctuation says strength = x / resolved. The data are in wakes.toml.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import SceneError
from ..core.number import Number
from ..core.record import column

WAKE_FAMILIES = ("rhombus", "triangle-up", "triangle-down", "square", "plate")
OF_MEAN_WEIGHT = ("cd", "cp_base", "reversal_length", "residence_time")
OF_FLUCTUATION_WEIGHT = ("cl_rms", "u_rms", "v_rms")
STATUSES, CHECKED = ("measured", "handbook", "computed"), ("read", "quoted", "unchecked", "own")
MAX_BLOCKAGE_RATIO = 2.0  # factor in blockage up to which a measurement counts as near, where two or more are; chosen
ERROR_PER_BLOCKAGE = (
    0.1  # error that a factor e in blockage adds. The handbooks' rhombus: theta 0.44 at 5 %, 0.38 at 12.5 %
)
ALIKE = 15.0  # deg: slopes that differ by no more count as one shape; chosen
MIN_MEASUREMENTS = 2  # measurements that say how far they scatter
MIN_ENTRY_ERROR = 0.03  # own error of an entry: no measurement of a wake, and no mesh of ours, is better


@dataclass(frozen=True)
class WakeEstimate:
    """How much of the time-resolved wake the air is made of that granules are flown in; the rest is the steady one."""

    theta: Number = column("1", "share of the time-resolved mean, and the range that holds it")
    strength: Number = column("1", "rms of the fluctuation over that of the time-resolved wake, and its range")
    why: str = column("", "what they rest on")


@dataclass(frozen=True)
class WakeEntry:
    """One measurement of one body; keys as at the head of wakes.toml."""

    name: str
    family: str
    body: str
    blockage: float
    reynolds: tuple[float, float]
    quantity: str
    resolved: float
    source: str
    status: str
    checked: str
    value: tuple[float, float] | None = None
    unconfined: tuple[float, float] | None = None
    base: tuple[float, float] | None = None
    steady: float = 0.0
    steady_within: float = 0.0
    resolved_within: float = 0.0
    between: tuple[tuple[float, float], ...] = ()
    slope: float | None = None

    @property
    def of_mean_weight(self) -> bool:
        """Whether it gives theta; else the strength."""
        return self.quantity in OF_MEAN_WEIGHT

    @property
    def here(self) -> tuple[float, float]:
        """The quantity at the entry's blockage, low and high of what was found."""
        if self.value is not None:
            return self.value
        assert self.unconfined is not None
        assert self.base is not None
        pairs = (blocked(drag, base, self.blockage) for drag, base in zip(self.unconfined, self.base, strict=True))
        first, second = ((drag if self.quantity == "cd" else base) for drag, base in pairs)
        return min(first, second), max(first, second)

    @property
    def given(self) -> Number:
        """Theta or strength by this entry: the middle of what was found, and its own error on either side."""
        low, high = (self._place(x) for x in self.here)
        middle = 0.5 * (low + high)
        ends = math.hypot(middle * self.resolved_within, (1.0 - middle) * self.steady_within)
        half = max(MIN_ENTRY_ERROR, math.hypot(0.5 * (high - low), ends / (self.resolved - self.steady)))
        return Number(middle, middle - half, middle + half)

    def _place(self, x: float) -> float:
        """Between the ends, 0 the steady and 1 the resolved one; straight through what the blend itself gave."""
        if not self.between:
            return (x - self.steady) / (self.resolved - self.steady)
        theta, value = np.array([(0.0, self.steady), *self.between, (1.0, self.resolved)]).T
        order = np.argsort(value)
        return float(np.interp(x, value[order], theta[order]))


def blocked(drag: float, base: float, blockage: float) -> tuple[float, float]:
    """Drag and base pressure coefficient between walls, of a body that has ``drag`` and ``base`` without them.

    Maskell 1963 (Aeronaut. Res. Counc. R & M 3400): both go with the square k^2 = 1 - Cp_base of the speed at
    separation, and k^2 / k_c^2 = Cd / Cd_c = 1 + Cd B / (k_c^2 - 1), the index c for no walls, B the blockage.
    """
    factor = 1.0 / (1.0 - drag * blockage / -base)
    return drag * factor, 1.0 - (1.0 - base) * factor


@cache
def wakes() -> tuple[WakeEntry, ...]:
    """Every entry of wakes.toml, in its sequence."""
    return read_wakes(tomllib.loads((Path(__file__).parent / "wakes.toml").read_text(encoding="utf-8")))


def read_wakes(tables: Mapping[str, Mapping[str, Any]]) -> tuple[WakeEntry, ...]:
    """The entries in plain tables. Raises SceneError for one that breaks the rules at the head of wakes.toml."""
    return tuple(_entry(name, dict(table)) for name, table in tables.items())


def _entry(name: str, table: dict[str, Any]) -> WakeEntry:
    pairs = ("reynolds", "value", "unconfined", "base")
    given: dict[str, Any] = {key: tuple(value) if key in pairs else value for key, value in table.items()}
    given["between"] = tuple((float(theta), float(x)) for theta, x in table.get("between", ()))
    try:
        entry = WakeEntry(name=name, **given)
    except TypeError as problem:
        raise SceneError(f"wakes.toml: {name}: {problem}") from None
    drag = entry.unconfined is not None and entry.base is not None and entry.quantity in ("cd", "cp_base")
    wrong = (
        f"unknown family {entry.family!r}" if entry.family not in WAKE_FAMILIES
        else f"unknown quantity {entry.quantity!r}" if entry.quantity not in (*OF_MEAN_WEIGHT, *OF_FLUCTUATION_WEIGHT)
        else "needs value, or unconfined and base of a drag" if (entry.value is None) == (not drag)
        else f"value {entry.value}: low before high" if entry.value is not None and entry.value[0] > entry.value[1]
        else f"status {entry.status!r}: one of {', '.join(STATUSES)}" if entry.status not in STATUSES
        else f"checked {entry.checked!r}: one of {', '.join(CHECKED)}" if entry.checked not in CHECKED
        else "its ends are equal" if entry.resolved == entry.steady
        else None
    )  # fmt: skip
    if wrong:
        raise SceneError(f"wakes.toml: {name}: {wrong}")
    return entry if entry.of_mean_weight else replace(entry, steady=0.0, steady_within=0.0)


def best_estimate(
    family: str | None,
    blockage: float,
    reynolds: float,
    entries: Sequence[WakeEntry] | None = None,
    *,
    slope: float | None = None,
) -> WakeEstimate:
    """Theta and strength of a wake, each from the measurements nearest to it, of ``entries`` (wakes.toml by default).

    ``family``: of the body's shape, one of :data:`WAKE_FAMILIES`; None for another shape and for several bodies.
    ``slope`` (deg, from the horizontal) of its faces, which an entry's may differ from by :data:`ALIKE`; None: any.

    Each number is the mean over the entries of the family, weighted by the inverse squares of their own errors, to
    which another blockage adds; those within a factor :data:`MAX_BLOCKAGE_RATIO` in blockage alone where two or more
    are. Its range is their common error, and never narrower than what they differ by. Where fewer than two measurements
    of the shape are known, or below the Reynolds numbers of all of them, the range is the widest: it holds every entry
    of every shape. But a shape whose theta is known and whose strength is not has theta times what other shapes'
    strengths are of their thetas: a wake that sheds less coherently has less of the mean suction and less of the
    fluctuation.
    """
    known = wakes() if entries is None else entries
    theta = _number(family, blockage, reynolds, known, slope, of_mean_weight=True)
    strength = _number(family, blockage, reynolds, known, slope, of_mean_weight=False)
    if strength.widest and not theta.widest:
        strength = _by_mean_weight(theta.value, known)
    return WakeEstimate(theta.value, strength.value, f"theta: {theta.why}; strength: {strength.why}")


def _alike(one: float | None, other: float | None) -> bool:
    return one is None or other is None or abs(one - other) <= ALIKE


class _Number(NamedTuple):
    """One of the two numbers, what it rests on, and whether its range is that of every shape."""

    value: Number
    why: str
    widest: bool = False


def _number(
    family: str | None,
    blockage: float,
    reynolds: float,
    every: Sequence[WakeEntry],
    slope: float | None,
    *,
    of_mean_weight: bool,
) -> _Number:
    """Theta or the strength, of those of ``every`` entry that are of the body's shape."""
    known = [entry for entry in every if entry.of_mean_weight == of_mean_weight]
    own = [entry for entry in known if entry.family == family and _alike(slope, entry.slope)]
    near = [entry for entry in own if 1.0 / MAX_BLOCKAGE_RATIO <= blockage / entry.blockage <= MAX_BLOCKAGE_RATIO]
    chosen = near if len(near) >= MIN_MEASUREMENTS else own
    lowest = min((entry.reynolds[0] for entry in chosen), default=0.0)
    if len(chosen) < MIN_MEASUREMENTS or reynolds < lowest:
        why = (
            "several bodies or a shape without data" if family is None
            else f"no measurement of the shape ({family})" if not chosen
            else f"one measurement of the shape ({family})" if len(chosen) < MIN_MEASUREMENTS
            else f"Re {reynolds:.3g} is below the data's {lowest:.3g}"
        )  # fmt: skip
        value, widest = _mean(chosen or known, blockage).value, [entry.given for entry in known]
        low, high = min(one.low for one in widest), max(one.high for one in widest)
        return _Number(_within(value, low, high), f"{why}, so the range of all {len(known)}", widest=True)
    where = "near this blockage" if chosen is near else "at other blockages"
    return _Number(_mean(chosen, blockage), f"{len(chosen)} measurements of the shape ({family}) {where}")


def _by_mean_weight(theta: Number, every: Sequence[WakeEntry]) -> _Number:
    """The strength of a shape of which ``theta`` alone is known; its range is that of the others' ratios of the two and
    of theta.
    """
    ratios = []
    for entry in every:
        if not entry.of_mean_weight:
            own = _number(entry.family, entry.blockage, max(entry.reynolds), every, entry.slope, of_mean_weight=True)
            ratios.append(entry.given.value / own.value.value)
    middle = float(np.mean(ratios))
    value = _within(theta.value * middle, theta.low * min(ratios), theta.high * max(ratios))
    return _Number(value, f"theta times {middle:.2f}, its mean ratio to theta in {len(ratios)} measurements of others")


def _mean(chosen: Sequence[WakeEntry], blockage: float) -> Number:
    """The weighted mean. Own errors are not averaged away: handbooks copy one another, and ends are of one program."""
    given = [entry.given for entry in chosen]
    middle = np.array([one.value for one in given])
    other = ERROR_PER_BLOCKAGE * np.log([blockage / entry.blockage for entry in chosen])
    half = np.hypot([one.high - one.value for one in given], other)
    weight = half**-2.0
    value = float(np.average(middle, weights=weight))
    common = float(np.sqrt(np.average(half**2, weights=weight)))
    return _within(value, min(value - common, float(middle.min())), max(value + common, float(middle.max())))


def _within(value: float, low: float, high: float) -> Number:
    """Numbers between the ends: the blend is defined there only."""
    low, value, high = (min(max(x, 0.0), 1.0) for x in (low, value, high))
    return Number(value, low, high)
