"""Shares in three dimensions to compare the answer of a scene with: three_dimensions.toml."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ...core.number import Number
from ...planning.plan import FractionPlan, Plan
from ...planning.wake import family_of
from ...scene import Scene

NEAR = 0.1  # body widths by which a bin's ends, and the curtain's middle, may differ; chosen
SETTLING = 0.02  # of the air's speed, by which the terminal velocity may differ; chosen
FACTORS = {
    "blockage": 1.2,
    "curtain": 1.2,
    "loading": 1.2,
    "stokes": 1.2,
    "reynolds": 3.0,
}  # chosen; sharp edges separate at any Re

Entry = dict[str, Any]  # keys as at the head of three_dimensions.toml


@cache
def span_shares() -> dict[str, Entry]:
    """Every entry of three_dimensions.toml."""
    return tomllib.loads((Path(__file__).parent / "three_dimensions.toml").read_text(encoding="utf-8"))


def in_three_dimensions(scene: Scene, plan: Plan) -> dict[str, dict[str, Number]]:
    """Shares by fraction and bin that were computed in three dimensions for a machine like the scene's; empty without,
    and where the wake is no best estimate.
    """
    return {
        name: {place: _interval(one["share"]) for place, one in places.items()}
        for name, places in _known_shares(scene, plan).items()
    }


def farther_in_three_dimensions(scene: Scene, plan: Plan) -> dict[str, dict[str, float]]:
    """How much larger ln(p / (1 - p)) of a share p is in three dimensions than in the best estimate's air, with what
    both leave open, by fraction and bin as :func:`in_three_dimensions` has them.
    """
    return {
        name: {place: _farther(one["share"], one["plane"]) for place, one in places.items()}
        for name, places in _known_shares(scene, plan).items()
    }


def _farther(deep: Sequence[float], plane: Sequence[float]) -> float:
    """The difference of two intervals' middles, and the root of the squares of it and of their halves, in
    ln(p / (1 - p)); with its sign.
    """
    (low, high), (least, most) = ((log_odds(end) for end in ends) for ends in (deep, plane))
    difference = 0.5 * (low + high - least - most)
    return math.copysign(math.hypot(difference, 0.5 * (high - low), 0.5 * (most - least)), difference)


def _loading(scene: Scene) -> float:
    """Mass flow of the feed over that of the air through a body width."""
    feed, air = scene.feed, scene.airstream
    return feed.mass_flow / (feed.depth * air.density * air.speed * scene.width)


def log_odds(share: float) -> float:
    """ln(p / (1 - p)) of a share p above 0 and below 1: stays within them wherever it is added."""
    return math.log(share / (1.0 - share))


def _interval(ends: Sequence[float]) -> Number:
    low, high = ends
    return Number(0.5 * (low + high), low, high)


def _keeps_or_rocks(scene: Scene) -> bool:
    """Whether walls keep granules or rock, as those of no entry do."""
    sticks = any(one.capture_speed or one.sticks for one in scene.fraction.values())
    rocks = scene.vibration is not None and scene.vibration.pivot is not None
    return sticks or rocks or any(one.keeps_part is not None for one in scene.bin.values())


def _known_shares(scene: Scene, plan: Plan) -> dict[str, dict[str, Entry]]:
    """The entries for a machine like the scene's, by fraction and bin."""
    if plan.airflow.wake is None or scene.airstream.direction != "down" or _keeps_or_rocks(scene):
        return {}
    body = next(iter(scene.body.values()))
    if abs(scene.feed.position - body.at[0]) > NEAR * scene.width:
        return {}
    ends = {place: (bin_.line(scene) - body.at) / scene.width for place, bin_ in scene.bin.items()}
    found: dict[str, dict[str, Entry]] = {}
    loading = _loading(scene) if plan.airflow.loaded else 0.0
    for name, how in plan.fractions.items():
        # Without a run under such a load, one in air that does not feel the granules says how far it may be
        for one in list(_like(scene, how, loading)) or list(_like(scene, how, 0.0)):
            for place, line in ends.items():
                if line.shape == (2, 2) and np.abs(line - one["bin"]).max() <= NEAR:
                    found.setdefault(name, {})[place] = one
    return found


def _like(scene: Scene, how: FractionPlan, loading: float) -> Iterator[Entry]:
    """What was computed for the scene's body, of granules such as those of a fraction, in air under a ``loading``."""
    numbers = {
        "blockage": scene.width / scene.channel.width, "curtain": scene.feed.width / scene.width,
        "stokes": how.stokes, "reynolds": scene.reynolds, "loading": loading,
    }  # fmt: skip
    settling, (shape, slope) = (how.terminal_velocity or 0.0) / scene.airstream.speed, family_of(scene)
    for one in span_shares().values():
        alike = shape == one["family"] and abs(slope - one["slope"]) < 1.0
        alike &= abs(settling - one["settling"]) <= SETTLING
        if alike and all(one[name] / by <= numbers[name] <= one[name] * by for name, by in FACTORS.items()):
            yield one
