"""How long the step of a crowd's clock may be: measured, by flights of a sample in which nobody meets anybody.

The tracker flies the sample too, each granule by steps of its own and within the tolerance. Nine of ten must land where
it says, to the tolerance; the tenth is for paths that a corner splits. The scheme is of second order, so the step of
the next trial is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...laws.forces import forces as all_forces
from ..tracks import CrowdFlight, Tracks
from .driver import Slab, fly_slab

__all__ = ["fly_crowd", "measured_step"]

Index = NDArray[np.int64]
SAMPLE = 96  # granules
NINE_OF_TEN = 0.9
HOP = 0.25  # of the largest diameter: what a granule goes in a step at most, so that cells stay small
SHAKE = 0.05  # rad of a vibration, and part of the time in which the air changes
ORDER = 2.0  # of the scheme
SAFE, MOST_TRIALS, LEAST = 0.8, 6, 1e-3  # of a step; trials; of the first step
HALF = 0.5


def fly_crowd(
    slab: Slab,
    found: Tracks,
    alone: Callable[[Index, Sequence[str]], Tracks],
    seed: int,
    progress: Callable[[int, int], object] | None,
) -> Tracks:
    """Let the crowd fly; ``alone(rows, forces)`` flies some of its granules by themselves."""
    slab.collisions.tables(slab.grains)
    found = replace(found, meetings=np.zeros(len(found), dtype=np.int64))
    step, error = slab.collisions.step, np.nan
    if step is None:
        step, error = measured_step(slab, alone)
        if slab.collisions.measured is not None:
            slab.collisions.measured(step)
    told: dict[str, Any] = {"flown": 0, "steps": 0, "standing": []}
    if len(found):
        told = fly_slab(slab, found, step, seed, progress)
    standing = np.array(told["standing"], dtype=float).reshape(-1, 3)
    return replace(found, crowd=CrowdFlight(step, error, told["steps"], told["flown"], standing, _jammed(standing)))


def _jammed(standing: NDArray[np.float64]) -> bool:
    """Whether most of what is born in the second half of the births still lies there when the last is born."""
    born = standing[:, 2]
    if len(standing) < 4 or not born[-1] > 0:
        return False
    first, last = np.searchsorted(born, [HALF * born[-1], born[-1]])
    if last <= first:
        return False
    return bool(standing[last, 1] - standing[first, 1] > HALF * (born[last] - born[first]))


def measured_step(slab: Slab, alone: Callable[[Index, Sequence[str]], Tracks]) -> tuple[float, float]:
    """The step (s), and the landing error that it was seen to make (lengths)."""
    count = len(slab.grains)
    if not count:
        return 1.0, 0.0
    rows = np.unique(np.linspace(0, count - 1, min(SAMPLE, count)).round().astype(np.int64))
    calm = [name for name in slab.forces if not all_forces[name].random]
    right = alone(rows, calm)
    tolerance = slab.rules.allowance * slab.rules.extent / slab.rules.length
    step = first = _longest(slab, right)
    lonely = replace(
        slab.collisions, tracers=tuple(np.unique(slab.grains.fraction).tolist())
    )  # tracers meet each other never
    sample = replace(
        slab, grains=slab.grains[rows], forces=calm, points=0, table_of=slab.table_of[rows], collisions=lonely
    )
    best = (step, np.inf)
    for _ in range(MOST_TRIALS):
        tracks = Tracks.empty(len(rows))
        fly_slab(sample, replace(tracks, meetings=np.zeros(len(rows), dtype=np.int64)), step, 0)
        away = np.linalg.norm(tracks.position - right.position, axis=1)
        error = float(np.quantile(away, NINE_OF_TEN)) / slab.rules.length
        if error < best[1]:
            best = (step, error)
        if error <= tolerance or step <= LEAST * first:
            break
        step = max(LEAST * first, step * min(0.5, max(0.05, SAFE * (tolerance / error) ** (1.0 / ORDER))))
    return best


def _longest(slab: Slab, right: Tracks) -> float:
    """The longest step worth trying (s)."""
    grains, rules = slab.grains, slab.rules
    solid = ~np.isin(grains.fraction, np.asarray(slab.collisions.tracers, dtype=np.int64))
    thick = float(grains.diameter[solid].max(initial=0.0)) or rules.length
    speeds = np.concatenate([np.linalg.norm(grains.velocity, axis=1), np.linalg.norm(right.velocity, axis=1)])
    fall = float(np.hypot(*np.asarray(slab.gravity, dtype=float)) * rules.length) ** 0.5
    step = HOP * thick / max(float(speeds.max(initial=0.0)), fall, 1e-9 * rules.length)
    paces = [body.motion.pace for body in slab.solids if body.motion is not None and body.motion.moves]
    if paces:
        step = min(step, SHAKE / max(paces))
    return float(min(step, SHAKE * rules.coarse))
