"""Sources of the budget of granules that meet: part of the slab's replicates flown again with one thing changed.

Granules that meet part ways after a few collisions whatever is changed, so that a difference holds the sampling error
of the replicates that fly again. Its variance is taken off the square of the difference: what is left is expected to be
the change's alone, and is nothing where the two agree within their noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from math import copysign, sqrt
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ...core.number import student
from ...flight.stages.pipeline import CollisionRerun, half_of_meeting
from ...flight.stages.slab_stage import SlabFound
from ...planning.stages import Scaling, Stage, stages
from ..draws import ErrorSource as Column
from ..provenance import RefinedSettings
from ..shares import PERTURBED_RERUN, BudgetPart
from .source import FractionResults, Parts, Source, add, sampled, signed_column

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked
    from ...flight.stages.pipeline import Pipeline

COARSER = 2.0  # step of the companion over the answer's: changes more than the answer's own step errs
SURE = 2.0  # standard errors
THINNER = 0.5  # depth of the companion's slab over the answer's
BETWEEN = 0.25  # run time of a companion of how granules rebound from each other, over the slab's


class _SlabAgain(Source[SlabFound]):
    """Some replicates of the slab under a companion's change, the same granules, compared with the slab or with others,
    each replicate with the same one.
    """

    how = PERTURBED_RERUN
    reruns: ClassVar[tuple[CollisionRerun, ...]]

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[SlabFound]:
        return () if pipeline.plan.collisions is None else super().fly(pipeline, tracked)

    def shares(self, fraction: FractionResults) -> Parts:
        changes, seconds = self._compared(fraction), self.seconds(fraction)
        return {place: [self.part(abs(moved), seconds, note)] for place, (moved, note) in changes.items()}

    def _compared(self, fraction: FractionResults) -> dict[str, tuple[float, str]]:
        """What the change is of the fraction's share in every bin, beyond chance, and what was compared in words."""
        varied, slab = fraction.flights.of(self), fraction.flights.slab
        if not varied or not slab:
            return {}
        both = (*varied, *slab)[:2]
        bins, images = len(fraction.shares) - 1, fraction.pipeline.scene.images
        changed, usual = (slab.landings[fraction.name].counts(bins, images) for slab in both)
        paired = all(_apart(slab, fraction) for slab in both)
        if paired:
            usual = usual[: len(changed)]
        return {
            place: beyond_chance(changed[:, i], usual[:, i], paired=paired, part=1.0 / len(varied))
            for i, place in enumerate(fraction.shares)
        }

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """A difference of replicates that go apart: sampling in all but the name."""
        return sampled(part.size, now, then)


class SlabStep(_SlabAgain):
    """The time step in which granules that meet are moved: part of the replicates with one twice as long."""

    name, place = "slab-time-step", 21
    reruns = (CollisionRerun("slab longer steps", step=COARSER, times=0.18),)


class _BetweenGranules(_SlabAgain):
    """How granules rebound from each other: part of the replicates with the number at the upper end of its interval,
    beside the same feed as it is. Where that shows (:func:`shows`), or the upper end is cut off at the ``most`` that
    the number can be, the lower end flies too, and it is half of the difference of both.
    """

    beyond_computing = True
    number: ClassVar[str]
    most: ClassVar[float]

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[SlabFound]:
        scene, half = pipeline.scene, half_of_meeting(pipeline.scene, self.number)
        for slab in super().fly(pipeline, tracked) if half else ():
            yield slab
            cut_off = getattr(scene.collisions, self.number) + half > self.most
            if not cut_off and not shows(slab, pipeline.collisions(), len(scene.bin)):
                return

    def column(self, fractions: Sequence[FractionResults]) -> Sequence[Column]:
        compared = [self._compared(fraction) for fraction in fractions]
        return signed_column(self.name, [{place: moved for place, (moved, _) in row.items()} for row in compared])

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """The size of the ``part`` as it is: no setting makes a number of the scene better known."""
        return part.size


class BetweenGranulesRestitution(_BetweenGranules):
    """The restitution of one granule on another."""

    name, place, number, most = "collisions.restitution", 16, "restitution", 1.0
    reruns = (
        CollisionRerun("livelier meetings", restitution=1.0, times=BETWEEN),
        CollisionRerun("duller meetings", restitution=-1.0),
    )


class BetweenGranulesFriction(_BetweenGranules):
    """The friction of one granule on another."""

    name, place, number, most = "collisions.friction", 17, "friction", math.inf
    reruns = (
        CollisionRerun("rougher meetings", friction=1.0, times=BETWEEN),
        CollisionRerun("smoother meetings", friction=-1.0),
    )


class SlabDepth(_SlabAgain):
    """The slab's depth, beyond which it repeats itself: of part of the replicates half of the depth, cut off."""

    name, place = "slab-depth", 22
    reruns = (CollisionRerun("thinner slab", depth=THINNER, times=0.14),)


def _apart(slab: SlabFound, fraction: FractionResults) -> bool:
    """Whether each replicate that was flown is a row of its own, or the two of an airflow and its image: not where some
    were put together since one alone had nothing of a fraction.
    """
    pipeline = fraction.pipeline
    images = 2 if pipeline.plan.airflow.mirrored and pipeline.field[1] is not None else 1
    return 1 + int(slab.landings[fraction.name].replicate.max()) == -(-slab.replicates // images)


def shows(changed: SlabFound, slab: SlabFound, bins: int) -> bool:
    """Whether a change moves the share of any fraction in any bin by more than SURE standard errors, as if none of its
    granules were the same: what so few replicates show of their own spread is itself chance.
    """
    for name, landings in slab.landings.items():
        share, changed_share = (
            (lot.count_by_bin(bins).sum(axis=(0, 2)) / lot.size) for lot in (landings, changed.landings[name])
        )
        both = np.clip(0.5 * (share + changed_share), 0.0, 1.0)  # sums of weights may pass 1 by a rounding
        error = np.sqrt(both * (1.0 - both) * (1.0 / landings.size + 1.0 / changed.landings[name].size))
        if np.any(np.abs(share - changed_share) > SURE * error):
            return True
    return False


def beyond_chance(changed: np.ndarray, usual: np.ndarray, *, paired: bool, part: float = 1.0) -> tuple[float, str]:
    """What is beyond chance of the difference of two means, of which a ``part`` is the error, with its sign, and what
    was compared in words; the whole difference where too few replicates show no chance.
    """
    apart = float(changed.mean() - usual.mean())
    if min(len(changed), len(usual)) < 2:
        return part * apart, ""
    if paired:
        which, variance = f"between the same {len(usual)} replicates", (changed - usual).var(ddof=1) / len(usual)
    else:
        which = f"of {len(changed)} replicates from {len(usual)}"
        variance = changed.var(ddof=1) / len(changed) + usual.var(ddof=1) / len(usual)
    of, chance = "" if part == 1.0 else "half of ", 100 * student(len(changed) - 1) * sqrt(variance)
    note = f"{of}a difference {which} of {100 * apart:+.2g} points, of which chance alone may make {chance:.2g}"
    return part * copysign(sqrt(max(0.0, apart**2 - variance)), apart), note


for _source in (SlabStep(), SlabDepth(), BetweenGranulesRestitution(), BetweenGranulesFriction()):
    add(_source)
    for _rerun in _source.reruns:
        stages.add(_rerun.name, Stage(_rerun.name, work="slab", scaling=Scaling.SLAB, heading="slab"))
