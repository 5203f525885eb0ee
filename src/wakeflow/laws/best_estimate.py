"""The best estimate of a real wake between its two-dimensional ends: how much of each, from measurements.

A steady wake of a bluff body is too long and its suction too weak; a time-resolved one in two dimensions sheds too
coherently, and its suction is too strong. ``theta`` is the share of the second in the mean of the air, ``strength``
the rms of the real fluctuation over that of the second. A measured number x between the two ends says theta = (x -
steady) / (resolved - steady), a fluctuation of the velocity says strength = x / resolved. The lift goes by a number
of its own: it weighs what the whole body feels at once, not what moves the air behind it. The data are in wakes.toml.
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
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.number import NO_NUMBER, Number
from ..core.record import column

Array = NDArray[np.float64]
WAKE_FAMILIES = ("rhombus", "triangle-up", "triangle-down", "square", "plate")
NUMBER_OF = {  # which number a quantity gives
    "cd": "theta", "cp_base": "theta", "reversal_length": "theta", "residence_time": "theta",
    "u_rms": "strength", "v_rms": "strength", "cl_rms": "lift",
}  # fmt: skip
STATUSES, CHECKED = ("measured", "handbook", "computed"), ("read", "quoted", "unchecked", "own")
MAX_BLOCKAGE_RATIO = 2.0  # factor in blockage up to which a measurement counts as near, where two or more are; chosen
ERROR_PER_BLOCKAGE = (
    0.1  # error that a factor e in blockage adds. The handbooks' rhombus: theta 0.44 at 5 %, 0.38 at 12.5 %
)
ALIKE = 15.0  # deg: slopes that differ by no more count as one shape; chosen
MIN_SOURCES = 2  # sources that say how far they differ
# Half of the 95 % range of a source that is alone, beside its own error: twice the pooled standard deviation of theta
# among the 10 sources of the four shapes that have several, the duct left out
BETWEEN_SOURCES = 0.125
MIN_ENTRY_ERROR = 0.03  # own error of an entry: no measurement of a wake, and no mesh of ours, is better


@dataclass(frozen=True)
class WakeEstimate:
    """How much of the time-resolved wake the air is made of that granules are flown in; the rest is the steady one."""

    theta: Number = column("1", "share of the time-resolved mean, and the range that holds it")
    strength: Number = column("1", "rms of the fluctuation over that of the time-resolved wake, and its range")
    why: str = column("", "what they rest on")
    lift: Number = column("1", "rms of the lift over that of the time-resolved wake, and its range")

    def __bool__(self) -> bool:
        """Whether there is an estimate, :data:`NO_ESTIMATE` being none."""
        return bool(self.theta)


NO_ESTIMATE = WakeEstimate(NO_NUMBER, NO_NUMBER, "", NO_NUMBER)


@dataclass(frozen=True)
class WakeEntry:
    """One measurement of one body; keys as at the head of wakes.toml."""

    name: str
    datum: str
    family: str
    body: str
    blockage: float
    reynolds: tuple[float, float]
    quantity: str
    resolved: float
    source: str
    status: str
    checked: str
    value: tuple[float, ...] = ()  # at the entry's blockage, low and high of what was found
    coarse: tuple[float, ...] = ()
    steady: float = 0.0
    steady_within: float = 0.0
    resolved_within: float = 0.0
    between: tuple[tuple[float, float], ...] = ()
    slope: float = math.nan  # of any

    @property
    def number(self) -> str:
        """What it gives: theta, strength or lift."""
        return NUMBER_OF[self.quantity]

    @property
    def given(self) -> Number:
        """Estimate of :attr:`number`: the middle of what was found, and its own error on either side.

        A coarser mesh is no measurement of its own: what it differs by is an error of the finer one.
        """
        low, high = (self._place(x) for x in self.value)
        middle = 0.5 * (low + high)
        mesh = middle - 0.5 * sum(self._place(x) for x in self.coarse) if self.coarse else 0.0
        ends = math.hypot(middle * self.resolved_within, (1.0 - middle) * self.steady_within)
        half = max(MIN_ENTRY_ERROR, math.hypot(0.5 * (high - low), ends / (self.resolved - self.steady), mesh))
        return Number(middle, middle - half, middle + half)

    def _place(self, x: float) -> float:
        """Place between the ends, 0 the steady and 1 the resolved one; straight through what the blend itself gave."""
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
    pairs = ("reynolds", "value", "coarse")
    given: dict[str, Any] = {"datum": name} | {
        key: tuple(value) if key in pairs else value for key, value in table.items()
    }
    unconfined, base = given.pop("unconfined", ()), given.pop("base", ())
    given["between"] = tuple((float(theta), float(x)) for theta, x in table.get("between", ()))
    try:
        entry = WakeEntry(name=name, **given)
    except TypeError as problem:
        raise SceneError(f"wakes.toml: {name}: {problem}") from None
    drag = bool(unconfined and base) and entry.quantity in ("cd", "cp_base")
    wrong = (
        f"unknown family {entry.family!r}" if entry.family not in WAKE_FAMILIES
        else f"unknown quantity {entry.quantity!r}" if entry.quantity not in NUMBER_OF
        else "needs value, or unconfined and base of a drag" if bool(entry.value) == drag
        else f"value {entry.value}: low before high" if not drag and entry.value[0] > entry.value[1]
        else f"status {entry.status!r}: one of {', '.join(STATUSES)}" if entry.status not in STATUSES
        else f"checked {entry.checked!r}: one of {', '.join(CHECKED)}" if entry.checked not in CHECKED
        else "its ends are equal" if entry.resolved == entry.steady
        else ""
    )  # fmt: skip
    if wrong:
        raise SceneError(f"wakes.toml: {name}: {wrong}")
    if drag:
        ends = [
            blocked(*each, entry.blockage)[entry.quantity == "cp_base"] for each in zip(unconfined, base, strict=True)
        ]
        entry = replace(entry, value=tuple(sorted(ends)))
    return entry if entry.number == "theta" else replace(entry, steady=0.0, steady_within=0.0)


def best_estimate(
    family: str, blockage: float, reynolds: float, entries: Sequence[WakeEntry] = (), *, slope: float = math.nan
) -> WakeEstimate:
    """Theta, strength and lift of a wake, each from the measurements nearest to it, of ``entries`` (wakes.toml by
    default).

    ``family``: of the body's shape, one of :data:`WAKE_FAMILIES`; empty for another shape and for several bodies.
    ``slope`` (deg, from the horizontal) of its faces, which an entry's may differ from by :data:`ALIKE`; nan: any.

    Each number is the mean over the sources of the family, weighted by the inverse squares of their errors, to which
    another blockage adds; those within a factor :data:`MAX_BLOCKAGE_RATIO` in blockage alone where two or more are.
    Entries of one source (``datum``) are one: the mean of them, weighted likewise. A range is the common error, and
    never narrower than what is averaged differs by; a source that is alone has :data:`BETWEEN_SOURCES` added.
    Without a source of the shape, or below the Reynolds numbers of all of them, the range is the widest: it holds every
    source of every shape. But then the strength is theta times what other shapes' strengths are of their thetas: a wake
    that sheds less coherently has less of the mean suction and less of the fluctuation.
    """
    known = entries or wakes()
    theta, strength, lift = (_number(family, blockage, reynolds, known, slope, name) for name in _NUMBERS)
    if strength.widest:
        strength = _by_mean_weight(theta.value, known)
    return WakeEstimate(theta.value, strength.value, f"theta: {theta.why}; strength: {strength.why}", lift.value)


_NUMBERS = tuple(dict.fromkeys(NUMBER_OF.values()))


class _Number(NamedTuple):
    """One of the numbers, what it rests on, and whether its range is that of every shape."""

    value: Number
    why: str
    widest: bool = False


def _number(
    family: str, blockage: float, reynolds: float, every: Sequence[WakeEntry], slope: float, name: str
) -> _Number:
    """Theta, the strength or the lift, of those of ``every`` entry that are of the body's shape."""
    known = [entry for entry in every if entry.number == name]
    alike = [entry for entry in known if entry.family == family and not abs(slope - entry.slope) > ALIKE]
    near = [entry for entry in alike if 1.0 / MAX_BLOCKAGE_RATIO <= blockage / entry.blockage <= MAX_BLOCKAGE_RATIO]
    chosen = near if len({entry.datum for entry in near}) >= MIN_SOURCES else alike
    lowest = min((entry.reynolds[0] for entry in chosen), default=0.0)
    if not chosen or reynolds < lowest:
        why = (
            "several bodies or a shape without data" if not family
            else f"no measurement of the shape ({family})" if not chosen
            else f"Re {reynolds:.3g} is below the data's {lowest:.3g}"
        )  # fmt: skip
        value, widest = _mean(chosen or known, blockage).value, by_source(known)
        low, high = min(source.low for source in widest.values()), max(source.high for source in widest.values())
        return _Number(_within(value, low, high), f"{why}, so the range of all {len(widest)} sources", widest=True)
    where = "near this blockage" if chosen == near else "at other blockages"
    count = len({entry.datum for entry in chosen})
    sources = "one source" if count == 1 else f"{count} sources"
    return _Number(_mean(chosen, blockage), f"{sources} of the shape ({family}) {where}")


def _by_mean_weight(theta: Number, every: Sequence[WakeEntry]) -> _Number:
    """The strength of a shape of which ``theta`` alone is known; its range is that of the others' ratios of the two and
    of theta.
    """
    ratios = []
    for datum, strength in by_source([entry for entry in every if entry.number == "strength"]).items():
        entry = next(entry for entry in every if entry.datum == datum)
        of_shape = _number(entry.family, entry.blockage, max(entry.reynolds), every, entry.slope, "theta")
        ratios.append(strength.value / of_shape.value.value)
    middle = float(np.mean(ratios))
    value = _within(theta.value * middle, theta.low * min(ratios), theta.high * max(ratios))
    return _Number(value, f"theta times {middle:.2f}, its mean ratio to theta in {len(ratios)} sources of others")


def by_source(entries: Sequence[WakeEntry], blockage: float = 0.0) -> dict[str, Number]:
    """What each source (``datum``) of ``entries`` of one number says, at a ``blockage`` that adds to its error; 0: at
    each entry's own.
    """
    groups: dict[str, list[tuple[float, float]]] = {}
    for entry in entries:
        value, _, high = entry.given
        by_blockage = ERROR_PER_BLOCKAGE * math.log(blockage / entry.blockage) if blockage else 0.0
        groups.setdefault(entry.datum, []).append((value, math.hypot(high - value, by_blockage)))
    return {datum: _pooled(group) for datum, group in groups.items()}


def _pooled(group: Sequence[tuple[float, float]]) -> Number:
    """The weighted mean of values with halves of their ranges. Errors are not averaged away: handbooks copy one
    another, numbers of one run have its length in common, and all ends are of one program.
    """
    middle, half = np.array(group).T
    weight = half**-2.0
    value = float(np.average(middle, weights=weight))
    common = float(np.sqrt(np.average(half**2, weights=weight)))
    return Number(value, min(value - common, float(middle.min())), max(value + common, float(middle.max())))


def _mean(chosen: Sequence[WakeEntry], blockage: float) -> Number:
    """The mean of the sources of ``chosen``; the half of a range that is not symmetric is its larger side."""
    halves = [(x.value, max(x.high - x.value, x.value - x.low)) for x in by_source(chosen, blockage).values()]
    if len(halves) == 1:
        halves = [(halves[0][0], math.hypot(halves[0][1], BETWEEN_SOURCES))]
    return _within(*_pooled(halves))


def _within(value: float, low: float, high: float) -> Number:
    """Numbers between the ends: the blend is defined there only."""
    low, value, high = (min(max(x, 0.0), 1.0) for x in (low, value, high))
    return Number(value, low, high)


# -- How much slower the air is far behind a single body: a bound for what lies in its plane wake ----------------------
DRAG = 2.0  # Cd of a bluff body on its width: about the largest
DEFICIT, SPREAD = 0.98, 0.57  # of the far wake, times sqrt(Cd D / x) and sqrt(Cd D x): sqrt(10) / (18 b), sqrt(10) b
# with b = 0.18 as measured (Schlichting, Boundary-Layer Theory, free turbulent flows: wake behind a single body)


def apart(outline: Array, other: Array) -> float:
    """How far (m) two outlines are apart sideways; 0 where one is above the other."""
    return max(0.0, float(other[:, 0].min() - outline[:, 0].max()), float(outline[:, 0].min() - other[:, 0].max()))


def slower_behind(front: Array, behind: Array, along: float) -> float:
    """Part of the air's speed that the wake of the body in ``front`` lacks at the one ``behind`` it, at most; 0 where
    it does not come there. ``along``: 1 where the air blows up, else -1.
    """
    way = along * float(behind[:, 1].mean() - front[:, 1].mean())
    if way <= 0.0:
        return 0.0
    drag = DRAG * float(np.ptp(front[:, 0]))
    if apart(front, behind) > SPREAD * math.sqrt(drag * way):
        return 0.0
    return min(1.0, DEFICIT * math.sqrt(drag / way))
