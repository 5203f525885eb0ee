"""When a falling granule first touches a face or corner: closed forms for what is at rest, a bracketed search where
the body vibrates and at round corners.

The gap to a face at rest is a parabola in time, g0 + g1 t + g2 t^2 / 2: it passes a level downward at most once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.roots import halved_all

__all__ = ["falls_below", "first_roots", "rises_above"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Gap = Callable[[Index, Array], tuple[Array, Array]]  # (which pairs, times) to value and rate
Counts = Callable[[Index, Array], NDArray[np.bool_]]  # (which pairs, times) to whether a root there is a contact
ITERATIONS = 60  # of Newton's method, which needs about six
HALVINGS = 26  # of a piece: a turning point need not be known better


def falls_below(g0: Any, g1: Any, g2: Any) -> Any:
    """Time (s) at which g0 + g1 t + g2 t^2 / 2 passes zero downward; negative where it is below,
    inf where it stays above.

    The rate there is -s, s^2 = g1^2 - 2 g0 g2; of the two forms of the root the one without cancellation.
    """
    square = g1 * g1 - 2.0 * g0 * g2
    s = np.sqrt(np.maximum(square, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.where(g1 < 0.0, 2.0 * g0 / (s - g1), (-g1 - s) / g2)
    never = (square < 0.0) | ((g1 >= 0.0) & (g2 == 0.0)) | ((g0 > 0.0) & (time < 0.0))
    return np.where(never, np.where(g0 < 0.0, -np.inf, np.inf), time)


def rises_above(g0: Any, g1: Any, g2: Any) -> Any:
    """Time (s) at which it passes zero upward; negative where it is above, inf where it stays below."""
    return falls_below(-g0, -g1, -g2)


def first_roots(
    gap: Gap, counts: Counts, owner: Index, low: Array, high: Array, step: Array, skin: float, still: float
) -> Array:
    """First time (n,) in [low, high] at which each gap falls below zero by more than ``skin``; inf where none does, or
    another of the same ``owner`` (n,) does before. Only roots that ``counts`` accepts are any: a crossing of a face's
    plane beyond its ends hides nothing.

    The interval is searched in pieces of ``step``, each with at most one turning point. A gap at most ``skin`` at
    ``low`` is touched at once when its rate is below -``still``, else it must rise first.
    """
    found = np.full(low.shape, np.inf)
    at = np.arange(len(low))
    f, r = gap(at, low)
    touching = (f <= skin) & (r < -still)
    touching[touching] = counts(at[touching], low[touching])
    found[touching] = low[touching]
    soonest = np.full(int(owner.max(initial=-1)) + 1, np.inf)
    np.minimum.at(soonest, owner[touching], low[touching])
    at = at[~touching & (high > low) & (low < soonest[owner])]
    now, f, r = low[at], f[at], r[at]
    while len(at):
        end = np.minimum(now + step[at], high[at])
        fe, re = gap(at, end)
        a, b, fa, fb = now.copy(), end.copy(), f.copy(), fe.copy()
        dips = (fe >= -skin) & (r < 0.0) & (re > 0.0)
        bumps = (fe < -skin) & (f <= skin) & (r >= 0.0) & (re < 0.0)
        turns = np.flatnonzero(dips | bumps)
        if len(turns):
            turn = _turning(gap, at[turns], now[turns], end[turns], np.where(bumps[turns], 1.0, -1.0))
            value, dip = gap(at[turns], turn)[0], dips[turns]
            b[turns[dip]], fb[turns[dip]] = turn[dip], value[dip]
            a[turns[~dip]], fa[turns[~dip]] = turn[~dip], value[~dip]
        hits = (fb < -skin) & (fa >= -skin)
        if hits.any():
            times = _root(gap, at[hits], a[hits], b[hits])
            found[at[hits]] = np.where(counts(at[hits], times), times, np.inf)
            np.minimum.at(soonest, owner[at[hits]], found[at[hits]])
        on = ~hits & (end < high[at]) & (end < soonest[owner[at]])
        at, now, f, r = at[on], end[on], fe[on], re[on]
    return found


def _turning(gap: Gap, at: Index, low: Array, high: Array, sign: Array) -> Array:
    """Where the rate times ``sign``, positive at ``low`` and negative at ``high``, passes zero."""
    return halved_all(lambda middle: gap(at, middle)[1] * sign > 0.0, low, high, HALVINGS)[1]


def _root(gap: Gap, at: Index, low: Array, high: Array) -> Array:
    """Root between ``low`` (gap not below zero) and ``high`` (below): Newton, kept in the bracket."""
    time = 0.5 * (low + high)
    for _ in range(ITERATIONS):
        f, rate = gap(at, time)
        low, high = np.where(f > 0.0, time, low), np.where(f > 0.0, high, time)
        with np.errstate(divide="ignore", invalid="ignore"):
            better = time - f / rate
        better = np.where((better >= low) & (better <= high), better, 0.5 * (low + high))
        done = np.abs(better - time) <= 1e-14 * np.abs(time) + 1e-17
        time = better
        if done.all():
            break
    return time
