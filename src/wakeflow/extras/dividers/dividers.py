"""Where dividers must be: the most recovery of a fraction at a purity asked, from landings that are stored.

Granules landed on a line (the floor, a side, a bin's points) are rows of (place along it, mass). A product is up to m
stretches of the line, between 2m dividers. It is to hold the most of one fraction while that fraction's part of its
mass is at least the purity asked. One stretch is searched through all pairs of places; of several, each is searched so
in turn while the others stay, from the start that a Lagrange multiplier on the purity gives (Everett 1963, Oper. Res.
11, 399), until nothing gains.

What is chosen on the granules that judge it flatters itself. So dividers are chosen on one half of the granules and
judged on the other, both ways (Stone 1974, J. R. Stat. Soc. B 36, 111); the dividers that are handed out rest on all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...answer.joint import PRODUCT
from ...answer.result import Result, kept_granules
from ...core.errors import SceneError
from ...core.geometry import along, halved
from ...core.number import Number
from ...core.registry import did_you_mean
from ...scene import Scene
from ...scene.bins import SIDES
from ...scene.overrides import share_in

Array = NDArray[np.float64]
PLACES = 400  # candidates for a divider: quantiles of the landings, finer than what 2000 granules a fraction resolve
ON_LINE = 1e-6  # m: a landing is on a line that it is no further from
LEVEL = ("floor", "top")  # sides along x
LEVELS = 20  # of a trade-off curve
STEPS = 60  # bisections of the Lagrange multiplier
MAX_STRETCHES = 50  # of a product: each is searched beside all others, and no machine has so many dividers


@dataclass(frozen=True)
class Dividers:
    """A product: its ``stretches`` (m along the ``line`` (k, 2), low and high of each), what is asked, and what it
    gives on granules that had no part in the choice. ``possible`` is False where no stretch reaches the purity.
    """

    fraction: str
    asked: float
    line: Array
    stretches: tuple[tuple[float, float], ...]
    purity: Number
    recovery: Number

    @property
    def possible(self) -> bool:
        """Whether any stretch reaches the purity."""
        return bool(self.stretches)


class Landed1D(NamedTuple):
    """Landings on a line: ``place`` (n,) m along it, ``mass`` (n,) of each, whether they are of the ``wanted`` fraction
    (n,) bool; ``lost`` mass of that fraction lands elsewhere; ``line`` (k, 2) m.
    """

    place: Array
    mass: Array
    wanted: NDArray[np.bool_]
    lost: float
    line: Array


def dividers(
    run: Result | Path | str, fraction: str, purity: float | str, *, stretches: int = 1, on: str = "floor"
) -> Dividers:
    """The dividers that give the most recovery of ``fraction`` at a ``purity`` (0.95 or "95 %") of the product by mass.

    ``run``: a finished run or its folder. ``stretches``: of the line that the product may be made of. ``on``: floor,
    top, left, right, or a bin of the scene whose line is taken. The granules are those of granules.npz
    (numerics.keep a fraction). Raises SceneError where the run has none, or not that fraction or line.
    """
    return trade_off(run, fraction, [purity], stretches=stretches, on=on)[0]


def trade_off(
    run: Result | Path | str, fraction: str, purities: Sequence[float | str], *, stretches: int = 1, on: str = "floor"
) -> list[Dividers]:
    """:func:`dividers` at every one of ``purities``. Raises SceneError as that does."""
    if isinstance(purities, str) or not isinstance(purities, Iterable):
        raise SceneError(f"purities = {purities!r}: a list of them, as [0.9, 0.95]")
    least = [share_in(purity, "purity") for purity in purities]
    if wrong := [share for share in least if not 0.0 < share < 1.0]:
        raise SceneError(f"purity = {wrong[0]:g}: above 0 and below 1 ('99 %' or 0.99: one percent of others)")
    if isinstance(stretches, bool) or not isinstance(stretches, Integral):
        raise SceneError(f"stretches = {stretches!r}: a whole number")
    if not 1 <= stretches <= MAX_STRETCHES:
        raise SceneError(f"stretches = {stretches}: at least 1, at most {MAX_STRETCHES}")
    result = run if isinstance(run, Result) else Result.load(run)
    landed = landed_along(result, fraction, on)
    return [_judged(result, on, landed, fraction, purity, stretches) for purity in least]


def purities(run: Result | Path | str, fraction: str, on: str = "floor") -> list[float]:
    """Purities to ask for a whole trade-off curve: from what all of the line has to one granule in a thousand of
    others, evenly in the logarithm of the part of others.
    """
    landed = landed_along(run, fraction, on)
    others = float(landed.mass[~landed.wanted].sum() / landed.mass.sum())
    return [1.0 - part for part in np.geomspace(max(others, 2e-3) * 0.98, 1e-3, LEVELS).tolist()]


def landed_along(run: Result | Path | str, fraction: str, on: str) -> Landed1D:
    """The stored landings of a run on a line of its channel. Raises SceneError as :func:`dividers` does."""
    result = run if isinstance(run, Result) else Result.load(run)
    scene = Scene.parse(result.scene)
    if fraction not in list(scene.fraction):
        known = list(scene.fraction)
        raise SceneError(f"no fraction {fraction!r}{did_you_mean(fraction, known)} (known: {', '.join(known)})")
    data, line = kept_granules(result.folder), _line(scene, on)
    wanted, mass = np.asarray(data["names"])[data["fraction"]] == fraction, data["weight"]
    place, distance = along(line, data["position"])
    here = distance <= ON_LINE
    lost = float(mass[wanted & ~here].sum())
    if not np.any(wanted & here):
        raise SceneError(f"no granule of {fraction} landed on {on}; choose another line with --on")
    return Landed1D(place[here], mass[here], wanted[here], lost, line)


def cut(line: Array, low: float, high: float) -> list[tuple[float, float]]:
    """The points of a polyline (k, 2) between two places (m) along it: what a bin's ``points`` are."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    places = [low, *at[(at > low) & (at < high)].tolist(), high]
    return [(float(np.interp(place, at, line[:, 0])), float(np.interp(place, at, line[:, 1]))) for place in places]


def _line(scene: Scene, on: str) -> Array:
    if on in SIDES:
        at = scene.channel.sides[on]
        return np.array([(end, at) if on in LEVEL else (at, end) for end in scene.channel.span(on)], dtype=float)
    if on not in scene.bin:
        known = [*SIDES, *scene.bin]
        raise SceneError(f"no line {on!r}{did_you_mean(on, known)} (known: {', '.join(known)})")
    return scene.bin[on].line(scene)


def best_stretches(landed: Landed1D, purity: float, count: int) -> tuple[tuple[float, float], ...]:
    """Up to ``count`` stretches of the line that hold the most of the wanted mass at a ``purity``; none where it cannot
    be reached. The best of all for one stretch; of several no single one can be moved for more.
    """
    edges = _edges(landed)
    cell = np.clip(np.searchsorted(edges, landed.place, side="right") - 1, 0, len(edges) - 2)
    cells = len(edges) - 1
    gain = np.bincount(cell, landed.mass * landed.wanted, cells).astype(float)
    slack = np.bincount(cell, landed.mass * (landed.wanted - purity), cells).astype(float)
    chosen = _improved(gain, slack, _start(gain, slack, count) if count > 1 else [(0, 0)])
    return tuple((float(edges[low]), float(edges[high])) for low, high in sorted(chosen) if high > low)


def _edges(landed: Landed1D) -> Array:
    """Where a divider may be: the ends of the line, and between neighbours among the landings."""
    length = float(np.linalg.norm(np.diff(landed.line, axis=0), axis=1).sum())
    places = np.unique(landed.place)
    between = 0.5 * (places[1:] + places[:-1])
    if len(between) > PLACES:
        between = between[np.linspace(0, len(between) - 1, PLACES).astype(int)]
    return np.unique(np.concatenate([[0.0], between, [length]]))


Stretch = tuple[int, int]  # cells [low, high)


def _improved(gain: Array, slack: Array, chosen: list[Stretch]) -> list[Stretch]:
    """The stretches with each in turn put where it serves best beside the others, until none gains."""
    best = -1.0
    while True:
        for place in range(len(chosen)):
            others = [stretch for i, stretch in enumerate(chosen) if i != place]
            chosen[place] = _best_beside(gain, slack, others)
        held = float(sum(gain[low:high].sum() for low, high in chosen))
        if held <= best * (1.0 + 1e-12):
            return chosen
        best = held


def _best_beside(gain: Array, slack: Array, others: Sequence[Stretch]) -> Stretch:
    """The stretch with the most gain that keeps the slack of all at or above 0 and no cell of ``others``."""
    taken = np.zeros(len(gain))
    for low, high in others:
        taken[low:high] = 1.0
    have = float(slack[taken > 0].sum())
    sums = [np.concatenate([[0.0], np.cumsum(part)]) for part in (gain, slack, taken)]
    held, left, crossed = (sum_[None, :] - sum_[:, None] for sum_ in sums)  # [low, high]
    allowed = (left + have >= -1e-15) & (crossed == 0) & np.triu(np.ones_like(held, dtype=bool))
    value = np.where(allowed, held, -np.inf)
    if not np.isfinite(value).any():
        return 0, 0  # the others alone fall short: nothing that can be added mends it
    first, last = np.unravel_index(int(value.argmax()), value.shape)
    return int(first), int(last)


def _start(gain: Array, slack: Array, count: int) -> list[Stretch]:
    """``count`` stretches that solve the problem with the purity as a price: feasible, near the best."""

    def falls_short(price: float) -> bool:
        return bool(sum(slack[a:b].sum() for a, b in _most(gain + price * slack, count)) < 0)

    high = 1.0
    while falls_short(high) and high < 1e9:
        high *= 4.0
    high = halved(falls_short, 0.0, high, STEPS)[1]
    chosen = [] if falls_short(high) else _most(gain + high * slack, count)
    return chosen + [(0, 0)] * (count - len(chosen))


def _most(value: Array, count: int) -> list[Stretch]:
    """The at most ``count`` disjoint stretches with the largest sum of ``value``: from the runs of positive cells, the
    pair of neighbours whose joining costs least is joined, or the least run dropped, until so many are left; this is
    exact (Csuros 2004, IEEE/ACM Trans. Comput. Biol. Bioinf. 1, 139).
    """
    sign = np.concatenate([[False], value > 0, [False]])
    turns = np.flatnonzero(sign[1:] != sign[:-1])
    runs = [(int(a), int(b)) for a, b in zip(turns[::2], turns[1::2], strict=True)]
    while len(runs) > count:
        sums = [float(value[a:b].sum()) for a, b in runs]
        gaps = [-float(value[runs[i][1] : runs[i + 1][0]].sum()) for i in range(len(runs) - 1)]
        if min(sums) <= min(gaps):
            runs.pop(int(np.argmin(sums)))
        else:
            i = int(np.argmin(gaps))
            runs[i : i + 2] = [(runs[i][0], runs[i + 1][1])]
    return runs


def _judged(result: Result, on: str, landed: Landed1D, fraction: str, purity: float, count: int) -> Dividers:
    """Dividers from all granules; purity and recovery from each half with the dividers of the other, with the interval
    that the joint answer has for what lies between the dividers from all.
    """
    inside = np.zeros(len(landed.place), dtype=bool)
    half = np.arange(len(landed.place)) % 2 == 0
    for chosen_on in (half, ~half):
        part = Landed1D(landed.place[chosen_on], landed.mass[chosen_on], landed.wanted[chosen_on], 0.0, landed.line)
        for low, high in best_stretches(part, purity, count):
            inside |= ~chosen_on & (landed.place >= low) & (landed.place < high)
    chosen = best_stretches(landed, purity, count)
    mass, wanted = landed.mass, landed.wanted
    product, pure_mass = float(mass[inside].sum()), float(mass[inside & wanted].sum())
    recovery, pure = (
        pure_mass / (float(mass[wanted].sum()) + landed.lost),
        pure_mass / product if product > 0.0 else math.nan,
    )
    first = float(landed.line[0, 0 if on in LEVEL else 1])
    if on not in result.joint.cells.edges or not chosen or product == 0.0:
        return Dividers(fraction, purity, landed.line, chosen, Number(pure), Number(recovery))
    bins = result.joint.between(on, [(first + low, first + high) for low, high in chosen])
    numbers = (bins.number(of, value=value) for of, value in (
        (bins.of_purity(PRODUCT, fraction), pure), (bins.of_share(fraction, [PRODUCT]), recovery)))  # fmt: skip
    return Dividers(fraction, purity, landed.line, chosen, *numbers)
