"""The source that is the third dimension: how far a share in a run in three dimensions of such a machine is from the
best estimate's in two.

Under the granules' force the two are one within what both leave open; where only air that does not feel them is known,
they differ, and whether they do in the answer's air is not known. So it does not move the answer, and its whole size
widens the interval (JCGM 100:2008, F.2.4.5). It is taken in ln(p / (1 - p)), which stays within 0 and 1; what the bin
gains the fraction's other bins lose in proportion. The shares to compare with are in three_dimensions.toml.
"""

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
from ..draws import ErrorSource as Column
from ..shares import CALIBRATED
from .source import FractionResults, Parts, Source, add, signed_column

NEAR = 0.1  # body widths by which a bin's ends, and the curtain's middle, may differ; chosen
SETTLING = 0.02  # of the air's speed, by which the terminal velocity may differ; chosen
# Factors by which these may differ; chosen: sharp edges separate at any Re
FACTORS = {"blockage": 1.2, "curtain": 1.2, "loading": 1.2, "stokes": 1.2, "reynolds": 3.0}

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
        name: {place: Number(0.5 * sum(one["share"]), *one["share"]) for place, one in places.items()}
        for name, places in _known_shares(scene, plan).items()
    }


def _farther(deep: Sequence[float], plane: Sequence[float]) -> float:
    """How much larger ln(p / (1 - p)) of a share p is in three dimensions than in the best estimate's air: the
    difference of the middles of two intervals, and the root of the squares of it and of their halves; with its sign.
    """
    (low, high), (least, most) = ((log_odds(end) for end in ends) for ends in (deep, plane))
    difference = 0.5 * (low + high - least - most)
    return math.copysign(math.hypot(difference, 0.5 * (high - low), 0.5 * (most - least)), difference)


def log_odds(share: float) -> float:
    """ln(p / (1 - p)) of a share p above 0 and below 1: stays within them wherever it is added."""
    return math.log(share / (1.0 - share))


def _keeps_or_rocks(scene: Scene) -> bool:
    """Whether walls keep granules or rock, as those of no entry do."""
    sticks = any(one.capture_speed or one.sticks for one in scene.fraction.values())
    rocks = scene.vibration is not None and scene.vibration.pivot is not None
    return sticks or rocks or any(one.keeps_part is not None for one in scene.bin.values())


def _known_shares(scene: Scene, plan: Plan) -> dict[str, dict[str, Entry]]:
    """The entries for a machine like the scene's, by fraction and bin."""
    if not plan.airflow.wake or scene.airstream.direction != "down" or _keeps_or_rocks(scene):
        return {}
    body = next(iter(scene.body.values()))
    if abs(scene.feed.position - body.at[0]) > NEAR * scene.width:
        return {}
    ends = {place: (bin_.line(scene) - body.at) / scene.width for place, bin_ in scene.bin.items()}
    found: dict[str, dict[str, Entry]] = {}
    feed, air, loading = scene.feed, scene.airstream, 0.0
    if plan.airflow.loaded:  # mass flow of the feed over that of the air through a body width
        loading = feed.mass_flow / (feed.depth * air.density * air.speed * scene.width)
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


class ThirdDimension(Source[None]):
    """The wake's third dimension, where it was computed for a machine like the scene's."""

    name, how, place = "three-dimensions", CALIBRATED, 51
    beyond_computing = True
    if_large = "run rung 3d (--rung 3d)"

    def shares(self, fraction: FractionResults) -> Parts:
        note = "as far as its share in three dimensions is from the plane one, each granule alone"
        found = self._moved(fraction)
        return {place: [self.part(abs(moved), note=note)] for place, moved in found.items()}

    def column(self, fractions: Sequence[FractionResults]) -> Sequence[Column]:
        return signed_column(self.name, [self._moved(one) for one in fractions])

    def _moved(self, fraction: FractionResults) -> dict[str, float]:
        pipeline = fraction.pipeline
        entries = _known_shares(pipeline.scene, pipeline.plan).get(fraction.name, {})
        found = dict.fromkeys(fraction.shares if entries else (), 0.0)
        for place, entry in entries.items():
            own = fraction.shares[place]
            if not 0.0 < own < 1.0:
                continue
            moved = 1.0 / (1.0 + math.exp(-log_odds(own) - _farther(entry["share"], entry["plane"]))) - own
            for other, share in fraction.shares.items():
                found[other] += moved if other == place else -moved * share / (1.0 - own)
        return found


add(ThirdDimension())
