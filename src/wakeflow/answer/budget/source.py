"""A source of the budget: what may make a share or a landing place wrong, and how far, as a registered object.

Sampling falls with the granules as n^-RATE: plain Monte Carlo would give 1/2, balanced samples of few dimensions up to
1 (Owen 1997, SIAM J. Numer. Anal. 34, 1884); the rate between them is assumed, not fitted. What is an upper
limit of a counted share (steps, terms left out) is read back to the share and limited again: with few granules the
limit is most of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np

from ...core.lazy import cached_property
from ...core.registry import Registry
from ...flight.stages.input_samples import NOT_DRAWN, InputSamples
from ...flight.stages.landings import Landings
from ...flight.stages.pipeline import Pipeline, Rerun
from ...planning.stages import StageCost, Workload
from ...planning.unknowns import SIGMAS, Dependence, dependence
from ..draws import ErrorSource as Column
from ..joint import Bins, JointAnswer
from ..provenance import RefinedSettings
from ..separation import changed, joint_answer, responses
from ..shares import UNKNOWN, BudgetPart, How
from ..spread import SampleErrors, Spread, sample_errors, share_spreads
from .flown_again import AmongOthers, compared

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked
    from ...flight.stages.slab_stage import SlabFound


# -- A source of the budget --------------------------------------------------------------------------------------------
Flown = TypeVar("Flown")
Parts = Mapping[str, Sequence[BudgetPart]]
INPUTS = "inputs"  # the part of what the scene does not say exactly
CHANGED = "changed by inputs"


class Source(Generic[Flown]):
    """What may make an answer wrong. A subclass says how far, for a share, for a landing place, or for both.

    ``name``: in the budget; ``how`` the error is known: measured (from this run), companion (from flying granules
    again), calibrated (from a bound and what was found) or unknown; ``place``: sources fly, and are parts of a row of
    the budget, by growing place; ``beyond_computing``: whether no finer computing makes it smaller, as where it is of
    numbers of the scene or of what no plane air has; ``if_unknown``, ``if_large``: what to give or to run where its
    size is not known, and where no setting makes it small enough; ``reruns``: what it flies in every scene.
    """

    name: ClassVar[str]
    how: ClassVar[How]
    place: ClassVar[int]
    beyond_computing: ClassVar[bool] = False
    if_unknown: ClassVar[str] = ""
    if_large: ClassVar[str] = "beyond the finest settings of a scene; ask for a larger --target-error"
    reruns: ClassVar[Sequence[Rerun[Any]]] = ()

    def costs(self, work: Workload) -> Iterable[StageCost]:
        """Each stage in which this source flies granules again, with what it is expected to take."""
        return [cost for rerun in self.reruns for cost in rerun.costs(work)]

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[Flown]:
        """What this source flies again to know its error; nothing where it needs nothing.

        It is called once a run, through :meth:`Flights.of`.
        """
        return (pipeline.run(rerun) for rerun in self.reruns)

    def seconds(self, fraction: FractionResults) -> float:
        """Run time (s) of its reruns that flew."""
        flown = zip(self.reruns, fraction.flights.of(self), strict=False)
        return sum(fraction.pipeline.spent(rerun.name) for rerun, _ in flown)

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        """Stages that :meth:`fly` asks ``pipeline`` for and that need not wait for the answer's own airflow: another
        core makes them meanwhile, and ``fly`` finds them in the cache.
        """
        return ()

    def shares(self, fraction: FractionResults) -> Parts:
        """Parts of the error of the fraction's share in every bin, by the bin's name; absolute errors."""
        return {}

    def column(self, fractions: Sequence[FractionResults]) -> Sequence[Column]:
        """Columns of this source in the joint answer, where it knows how the errors of shares go together; none where
        it does not: what one bin of a fraction has too much, its others then lack.
        """
        return ()

    def landing(self, fraction: FractionResults) -> Sequence[BudgetPart]:
        """Parts of the error of where the fraction's granules land, in body widths."""
        return ()

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """What the error of a ``part`` that was found with the settings ``now`` would be with those of ``then``: as it
        is, where no setting changes it.
        """
        return part.size

    def part(self, error: float, seconds: float = 0.0, note: str = "") -> BudgetPart:
        """A part of the budget in this source's name."""
        return BudgetPart(self.name, error, seconds, self.how, note=note)

    def unless_known(self, fraction: FractionResults) -> Parts:
        """A part of unknown size, where nothing was flown to know it, unless the kind of airflow knows it."""
        unknown = self.name in fraction.pipeline.air.unknown
        return {bin_: [BudgetPart(self.name, None, 0.0, UNKNOWN)] for bin_ in fraction.shares if unknown}


@dataclass(frozen=True)
class Flights:
    """What the sources of one run fly again; each flies at most once. ``tracked``: every granule alone; ``slab``: the
    same among others, one where the plan has them meet.
    """

    pipeline: Pipeline
    tracked: Tracked
    slab: tuple[SlabFound, ...] = ()
    _made: dict[str, Any] = field(default_factory=dict, repr=False)

    def of(self, source: Source[Flown]) -> tuple[Flown, ...]:
        """What ``source`` flew again."""
        if source.name not in self._made:
            self._made[source.name] = tuple(source.fly(self.pipeline, self.tracked))
        flown: tuple[Flown, ...] = self._made[source.name]
        return flown

    @cached_property
    def sample_errors(self) -> SampleErrors:
        """How the errors of all shares go together that finite numbers of granules and of shedding cycles make."""
        return sample_errors(self.landings, len(self.pipeline.scene.bin), self.pipeline.scene.images or ())

    @cached_property
    def factors(self) -> dict[str, float]:
        """Factor on what a shift alone moves of a fraction's shares, if granules meet; empty where each flies alone."""
        scene, alone = self.pipeline.scene, self.tracked.landings
        both = [AmongOthers(scene, alone, collisions.landings) for collisions in self.slab]
        return {name: among.factor(name) for among in both for name in self.landings}

    @property
    def draws(self) -> InputSamples:
        """The draws of what is not known exactly, once they flew."""
        return next(iter(self._made.get(INPUTS, ())), NOT_DRAWN)

    @cached_property
    def ties(self) -> Dependence:
        """How the inputs that are drawn depend on each other."""
        return dependence(self.pipeline.scene, self.pipeline.plan, self.draws.unknowns)

    @cached_property
    def ensemble(self) -> JointAnswer:
        """The joint answer with what the unknown inputs change, and with no other source of error."""
        scene, draws = self.pipeline.scene, self.draws
        if draws.unknowns and CHANGED not in self._made:
            self._made[CHANGED] = changed(scene, draws.unknowns, self.ties, responses(scene, draws))
        salt = self.pipeline.collisions_key if self.slab else self.pipeline.tracks_key
        return joint_answer(scene, self.landings, inputs=self._made.get(CHANGED), factors=self.factors, salt=salt)

    @property
    def landings(self) -> Mapping[str, Landings]:
        """Landings of the answer: of granules that meet where they do, else of each alone."""
        return self.slab[0].landings if self.slab else self.tracked.landings

    @property
    def tracking(self) -> float:
        """Run time (s) of the answer's own tracks."""
        return self.pipeline.spent("slab" if self.slab else "tracks")


@dataclass(frozen=True)
class FractionResults:
    """A fraction whose errors are asked for: its name, its landings (the answer's), and the answer with what the inputs
    change of it.
    """

    name: str
    landings: Landings
    answer: Bins
    flights: Flights

    @cached_property
    def shares(self) -> dict[str, float]:
        """Share of the fraction in every bin, and elsewhere."""
        row = self.answer.value[self.answer.joint.fractions.index(self.name)]
        return dict(zip(self.answer.names, map(float, row), strict=True))

    @property
    def pipeline(self) -> Pipeline:
        return self.flights.pipeline

    @cached_property
    def compared(self) -> Landings:
        """The landings, each granule alone, of those that fly again in comparisons."""
        return compared(self.flights.tracked.landings[self.name])

    @cached_property
    def spreads(self) -> dict[str, Spread]:
        """What the share in every bin may be off by for being taken from few granules and few sheddings."""
        spreads = share_spreads(self.landings, len(self.shares) - 1, self.pipeline.scene.images or ())
        return dict(zip(self.shares, spreads, strict=True))


budget_sources: Registry[Source[Any]] = Registry("source of the budget")


def signed_column(name: str, changes: Sequence[Mapping[str, float]]) -> Sequence[Column]:
    """A number of the world, the same one in every run, by what it ``changes`` of every fraction's share in every bin
    at the upper end of its 95 % interval.
    """
    bins = max(map(len, changes))
    halves = [list(change.values()) or [0.0] * bins for change in changes]
    return [Column(name, np.array(halves)[..., None] / SIGMAS, computing=False, shared=True)] if bins else ()


def add(source: Source[Flown]) -> Source[Flown]:
    """Register a source under its name."""
    return budget_sources.add(source.name, source)


def in_order() -> list[Source[Any]]:
    """The sources by their places."""
    return sorted((budget_sources[name] for name in budget_sources), key=lambda source: source.place)


def source_of(part: BudgetPart) -> Source[Any]:
    """The source that a part is of; of a term that is left out one that no setting changes."""
    return budget_sources[part.source] if not part.kind and part.source in budget_sources else Source()


# -- What an error would be with other settings ------------------------------------------------------------------------
RATE = 0.6  # of sampling with the number of granules; assumed


def landed(settings: RefinedSettings) -> int:
    """Granules of a fraction whose landings make the shares."""
    return settings.granules if settings.slab is None else settings.slab


def sampled(error: float, now: RefinedSettings, then: RefinedSettings) -> float:
    """An ``error`` that goes as sampling does."""
    return error * float((landed(now) / landed(then)) ** RATE)


def averaged(now: RefinedSettings, then: RefinedSettings) -> float:
    """The factor on what the finite averages of a wake make of an error."""
    return 1.0 if now.averaging is None or then.averaging is None else then.averaging / now.averaging


def limited_again(limit: float, count: float, again: float, times: float = 1.0) -> float:
    """The upper 95 % limit of a share from ``again`` granules that is ``times`` the one whose limit from ``count`` is
    ``limit`` (Wilson's, solved for the share: it lies SIGMAS standard errors of the limit below it).
    """
    share = min(1.0, times * max(0.0, limit - SIGMAS * sqrt(limit * (1.0 - limit) / count)))
    beyond = SIGMAS**2 / again
    spread = SIGMAS * sqrt(share * (1.0 - share) / again + beyond / (4.0 * again))
    return (share + 0.5 * beyond + spread) / (1.0 + beyond)
