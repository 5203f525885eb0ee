"""Sources that are the air's model: other wakes, what the passes of the granules' force on the air leave open, and the
third dimension: how far a share in a run in three dimensions of such a machine is from the best estimate's in two.

Under the granules' force the two are one within what both leave open; where only air that does not feel them is known,
they differ, and whether they do in the answer's air is not known. So it does not move the answer, and its whole size
widens the interval (JCGM 100:2008, F.2.4.5). It is taken in ln(p / (1 - p)), which stays within 0 and 1; what the bin
gains the fraction's other bins lose in proportion. The shares to compare with are in three_dimensions.toml.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.number import Number
from ...flight.stages.air_loading import AirLoading
from ...flight.stages.pipeline import PerturbedRerun, Pipeline
from ...planning.plan import FractionPlan, Plan
from ...planning.stages import OWN, AirLabel, StageCost, Workload
from ...planning.terms import LOADING
from ...planning.wake import Wake, family_of
from ...scene import Scene
from ..draws import ErrorSource as Column
from ..shares import CALIBRATED, MEASURED, PERTURBED_RERUN, LoadingEffect
from .flown_again import Comparison, differences, shares_of
from .source import FractionResults, Parts, Source, add, signed_column

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked


class AirflowModel(Source[Comparison[Wake]]):
    """The airflow's model: of a time-resolved airflow the farthest of the steady wake, the mean wake and half of the
    fluctuation. The two numbers of a best estimate are unknowns among the others; the ends are flown for comparison.
    """

    name, how, place = "airflow-model", PERTURBED_RERUN, 50
    if_unknown = "numerics.rung = 'standard', or in a duct air.case, a solved OpenFOAM case of yours"
    if_large = "run rung 3d (--rung 3d)"

    def costs(self, work: Workload) -> Iterable[StageCost]:
        for wake in work.airflow.wakes_beside:
            yield from _in_wake(wake).costs(work, AirLabel(draft=True) if wake is Wake.STEADY else OWN)

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[Comparison[Wake]]:
        """The shares in the other wakes of the plan: the two ends between which the truth lies, and what is between
        them. Nothing where the computed airflow is the flow itself, or is the steady end.
        """
        wakes = pipeline.plan.airflow.wakes_beside
        if not wakes or not pipeline.field[1].in_time:
            return ()
        shares, seconds = {}, 0.0
        for wake, numbers in wakes.items():
            where, rerun = pipeline, _in_wake(wake, *numbers)
            if wake is Wake.STEADY:  # on its own mesh, where a second core may have flown it already
                where, rerun = pipeline.steady, _in_wake(wake)
            shares[wake] = shares_of(pipeline, where.run(rerun))
            seconds += where.spent(rerun.name)
        return [Comparison({**shares, Wake.ANSWER: shares_of(pipeline, tracked)}, seconds)]

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        if not pipeline.plan.airflow.brackets:
            return ()
        return [lambda: pipeline.steady.run(_in_wake(Wake.STEADY))]

    def shares(self, fraction: FractionResults) -> Parts:
        if not fraction.flights.of(self):
            return self.unless_known(fraction)
        if fraction.pipeline.plan.airflow.wake:
            return {}
        (wakes,), parts = fraction.flights.of(self), {}
        for number, bin_ in enumerate(fraction.shares):
            which, moved = max(differences(wakes, fraction.name, number), key=lambda pair: abs(pair[1]))
            note = f"farthest: {which} ({100 * moved:+.2g} points)"
            parts[bin_] = [self.part(abs(moved), wakes.seconds, note)]
        return parts


def _in_wake(wake: Wake, *numbers: float) -> PerturbedRerun:
    """The granules in a ``wake``, whose theta and strength are the ``numbers``."""
    return PerturbedRerun(f"{wake} wake", wake=numbers)


def loading_effects(loading: AirLoading, bins: Sequence[str]) -> dict[str, dict[str, LoadingEffect]]:
    """Effects on the share of each fraction in each of the ``bins``, elsewhere included, by their names in order."""
    last = loading.passes[-1].gathered.shares
    pairs = {name: zip(shares, last[name], strict=True) for name, shares in loading.first.shares.items()}
    return {name: {bin_: LoadingEffect(*pair) for bin_, pair in zip(bins, both, strict=True)}
            for name, both in pairs.items()}  # fmt: skip


class PassesOfLoading(Source[None]):
    """The granules' force on the air: what its last pass changed of a share in the steady airflow, and the part of what
    it does there that is not known for being gathered from few granules: a share moves with the force.
    """

    name, how, place = LOADING, MEASURED, 55
    if_large = "lower feed.rate"

    def shares(self, fraction: FractionResults) -> Parts:
        loading, parts = fraction.pipeline.loading, {}
        if loading is None:
            return {}
        effects = loading_effects(loading, list(fraction.shares))[fraction.name]
        for number, (bin_, effect) in enumerate(effects.items()):
            moved, last = effect.loaded - effect.without, loading.last_change(fraction.name, number)
            note = (
                f"in the steady airflow the force moves the share by {100 * moved:+.2g} points, its last pass by "
                f"{100 * last:+.2g}; of the force {100 * loading.sampling:.2g} % are not known"
            )
            parts[bin_] = [self.part(hypot(last, loading.sampling * moved), note=note)]
        return parts


# -- The third dimension -----------------------------------------------------------------------------------------------
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
        name: {place: Number(0.5 * sum(entry["share"]), *entry["share"]) for place, entry in places.items()}
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
    sticks = any(fraction.capture_speed or fraction.sticks for fraction in scene.fraction.values())
    rocks = scene.vibration is not None and scene.vibration.pivot is not None
    return sticks or rocks or any(bin_.keeps_part is not None for bin_ in scene.bin.values())


def _known_shares(scene: Scene, plan: Plan) -> dict[str, dict[str, Entry]]:
    """The entries for a machine like the scene's, by fraction and bin."""
    if not plan.airflow.wake or scene.airstream.direction != "down" or _keeps_or_rocks(scene):
        return {}
    body = next(iter(scene.body.values()))
    if abs(scene.feed.position - body.at[0]) > NEAR * scene.width:
        return {}
    ends = {place: (bin_.line(scene) - body.at) / scene.width for place, bin_ in scene.bin.items()}
    entries: dict[str, dict[str, Entry]] = {}
    feed, air, loading = scene.feed, scene.airstream, 0.0
    if plan.airflow.loaded:  # mass flow of the feed over that of the air through a body width
        loading = feed.mass_flow / (feed.depth * air.density * air.speed * scene.width)
    for name, how in plan.fractions.items():
        # Without a run under such a load, one in air that does not feel the granules says how far it may be
        for entry in list(_like(scene, how, loading)) or list(_like(scene, how, 0.0)):
            for place, line in ends.items():
                if line.shape == (2, 2) and np.abs(line - entry["bin"]).max() <= NEAR:
                    entries.setdefault(name, {})[place] = entry
    return entries


def _like(scene: Scene, how: FractionPlan, loading: float) -> Iterator[Entry]:
    """What was computed for the scene's body, of granules such as those of a fraction, in air under a ``loading``."""
    numbers = {
        "blockage": scene.width / scene.channel.width, "curtain": scene.feed.width / scene.width,
        "stokes": how.stokes, "reynolds": scene.reynolds, "loading": loading,
    }  # fmt: skip
    settling, (shape, slope) = (how.terminal_velocity or 0.0) / scene.airstream.speed, family_of(scene)
    for entry in span_shares().values():
        alike = shape == entry["family"] and abs(slope - entry["slope"]) < 1.0
        alike &= abs(settling - entry["settling"]) <= SETTLING
        if alike and all(entry[name] / by <= numbers[name] <= entry[name] * by for name, by in FACTORS.items()):
            yield entry


class ThirdDimension(Source[None]):
    """The wake's third dimension, where it was computed for a machine like the scene's."""

    name, how, place = "three-dimensions", CALIBRATED, 51
    beyond_computing = True
    if_large = "run rung 3d (--rung 3d)"

    def shares(self, fraction: FractionResults) -> Parts:
        note = "as far as its share in three dimensions is from the plane one, each granule alone"
        moves = self._moved(fraction)
        return {place: [self.part(abs(moved), note=note)] for place, moved in moves.items()}

    def column(self, fractions: Sequence[FractionResults]) -> Sequence[Column]:
        return signed_column(self.name, [self._moved(fraction) for fraction in fractions])

    def _moved(self, fraction: FractionResults) -> dict[str, float]:
        pipeline = fraction.pipeline
        entries = _known_shares(pipeline.scene, pipeline.plan).get(fraction.name, {})
        moves = dict.fromkeys(fraction.shares if entries else (), 0.0)
        for place, entry in entries.items():
            before = fraction.shares[place]
            if not 0.0 < before < 1.0:
                continue
            moved = 1.0 / (1.0 + math.exp(-log_odds(before) - _farther(entry["share"], entry["plane"]))) - before
            for bin_, share in fraction.shares.items():
                moves[bin_] += moved if bin_ == place else -moved * share / (1.0 - before)
        return moves


MODEL = add(AirflowModel())
add(PassesOfLoading())
add(ThirdDimension())
