"""From the mass that is left in the funnel to its discharge rate, with an interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.number import Number

# -- From the mass that is left in the funnel to its discharge rate, with an interval ----------------------------------
Array = NDArray[np.float64]
STEADY = (0.10, 0.75)  # shares of the mass discharged: between them the funnel neither starts nor runs empty
BATCHES = 8  # parts of the steady stretch whose rates give the interval
MIN_PARTS = 4  # parts below which no interval is given
EMPTY = 0.99  # share of the mass discharged at which the funnel counts as empty, since single beads may stay


@dataclass(frozen=True)
class Curve:
    """Time (k,) s since the outlet was opened, mass (k,) kg and beads (k,) that are still above the outlet."""

    time: Array
    mass: Array
    beads: Array


def read_curve(path: str, opened: float) -> Curve:
    """The curve that discharge.liggghts printed; ``opened`` (s) is when the lid went."""
    rows = np.loadtxt((line for line in path.splitlines() if line.startswith("curve ")), usecols=(1, 2, 3), ndmin=2)
    return Curve(rows[:, 0] - opened, rows[:, 1], rows[:, 2])


def time_to_empty(curve: Curve, total: float) -> float | None:
    """Time (s) at which the share :data:`EMPTY` of the ``total`` mass (kg) was out; None when that never happened."""
    out = curve.mass <= (1 - EMPTY) * total
    return float(curve.time[np.argmax(out)]) if out.any() else None


def rate_of(curve: Curve, total: float, period: float | None) -> Number | None:
    """The rate between :data:`STEADY` shares of the ``total`` mass (kg); None where the flow stopped before.

    The stretch is cut to whole periods (s) of the vibration and into up to :data:`BATCHES` parts of whole periods; the
    interval is Student's from the parts' rates, taken as independent. It is the scatter within one
    discharge: another pouring may differ by more.
    """
    gone = 1 - curve.mass / total
    if gone.max() < STEADY[1]:
        return None
    start, end = (float(curve.time[np.argmax(gone >= share)]) for share in STEADY)
    length = end - start
    whole = 1
    if period is not None and length >= period:
        whole = math.floor(length / period)
        length = whole * period
    parts = BATCHES if period is None or end - start < period else min(BATCHES, whole)
    if period is not None and parts < BATCHES and whole < MIN_PARTS:
        parts = 1
    edges = start + length * np.arange(parts + 1) / parts
    if period is not None and parts > 1:  # parts of whole periods, some a period longer than others
        edges = start + period * np.round(whole * np.arange(parts + 1) / parts)
    mass = np.interp(edges, curve.time, curve.mass)
    return _student(-np.diff(mass), np.diff(edges))


def _student(mass: Array, time: Array) -> Number:
    """Total over total time, with Student's interval of the parts' rates weighted by their time."""
    value = float(mass.sum() / time.sum())
    count = len(mass)
    if count < MIN_PARTS:
        return Number(value)
    from scipy.stats import t

    spread = math.sqrt(float((time / time.mean() * (mass / time - value) ** 2).sum()) / (count - 1))
    half = float(t.ppf(0.975, count - 1)) * spread / math.sqrt(count)
    return Number(value, value - half, value + half)
