"""The air feels the granules: their force on it, gathered along tracks, is given to the airflow.

Pass after pass, granules fly through the steady airflow as it is known so far, one way; what they exert on the air is
gathered (``gathered_force``), and the steady airflow is made anew under that force: OpenFOAM solves it on, and air at
rest becomes a jet (``laws.driven_jet``). Each granule flies alone until the shares no longer change; where granules
meet, those of the slab give the force of one pass more. An airflow that leads only to the next pass need not have
settled: OpenFOAM solves each on from the one before for few iterations, and the last one to its end. Under the force of
the last pass every airflow of the scene is solved: the steady one on all grids, and from it the one in time.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...air.field import FlowField
from ...air.foam.steady import MOST
from ...air.kinds.airflow_kinds import CaseAir, FlownAir, MadeOf
from ...air.kinds.airflow_table import AirLoadingSummary
from ...air.kinds.analytic import jet_of
from ...air.kinds.case_field import case_field
from ...air.kinds.known_air import JetAir
from ...air.kinds.solved_air import SolvedAir, SteadyAir
from ...core.geometry import ForceDensity
from ...core.lazy import cached_property
from ...core.record import JsonTable
from ...core.store import content_key
from ...planning.collisions import CollisionPlan
from ...planning.plan import GATHERED, PASSING, Plan, gathered
from ...planning.stage_cache import StageCache, code_of, version_of
from ...scene import Scene
from .compilation import Compilation
from .gathered_force import Gathered, Gatherer, boxes_of, resolved
from .slab_stage import steady_after

Array = NDArray[np.float64]
SHARES = (0.05, 1.0)  # of the way to the force gathered last, at least and at most; chosen
ON_THE_WAY = 200  # iterations of a pass before the last, where the air follows a force that changes itself; chosen
GATHERING = "flight.stages.gathered_force"  # the module that computes it
WITHOUT_SOLVER = 8  # passes where no solver runs for one where it does; chosen


@dataclass(frozen=True)
class Pass:
    """One pass: the ``force`` (N/m3) that the steady ``air`` was made under, what granules alone ``gathered`` in it and
    the largest ``change`` of their shares from the pass before; how far the force is known by ``source``, those that it
    was gathered from, and what they would exert on that air (``exerted``, (2,) N/m).
    """

    force: ForceDensity
    air: FlownAir
    gathered: Gathered
    change: float
    source: Gathered
    exerted: Array

    @property
    def unanswered(self) -> float:
        """How far the force that the air was given is from the one that granules exert in it, over the latter."""
        off, whole = (float(np.linalg.norm(force)) for force in (self.exerted - self.force.total, self.exerted))
        return off / max(whole, 1e-300)


class _Passes(NamedTuple):
    """The ``passes`` before the last, what granules gathered ``before`` it and the air that it has to ``start`` from,
    its ``force``, and what gathered that ``among`` others.
    """

    passes: tuple[Pass, ...]
    before: Gathered
    start: FlownAir
    force: ForceDensity
    among: Gathered | None


@dataclass
class AirLoading(ABC):
    """The granules' force on the airflow of a scene, gathered in the ``steady`` one, which itself feels none."""

    steady: FlownAir
    compilation: Compilation
    workers: int
    scene: Scene = field(init=False, repr=False)
    plan: Plan = field(init=False, repr=False)  # of the steady airflow
    cache: StageCache = field(init=False, repr=False)
    answered: ClassVar[float]  # of the force: what the air may lack of it; chosen

    def __post_init__(self) -> None:
        self.scene, self.plan, self.cache = self.steady.scene, self.steady.plan, self.steady.cache

    @property
    @abstractmethod
    def summary(self) -> AirLoadingSummary:
        """What the passes found."""

    @property
    def start(self) -> FlownAir:
        """The air in which the force is gathered first."""
        return self.steady

    @abstractmethod
    def under(self, force: ForceDensity, before: FlownAir, *, last: bool) -> FlownAir:
        """The steady air under a ``force``, from the one ``before``; settled where it is the ``last``."""

    def settled(self, made: Pass) -> bool:
        """Whether one pass more is enough: neither shares nor the force change."""
        return made.change <= self.plan.target_error and made.unanswered <= self.answered

    @property
    def most(self) -> int:
        """Passes under the force of granules alone, at most."""
        return self.scene.numerics.loading_passes

    @property
    def collisions(self) -> CollisionPlan | None:
        """The slab that gives the force of the last pass; None where that is the force of granules alone."""
        return self.plan.collisions if self.scene.numerics.loading_passes > 1 else None

    @property
    def _fed(self) -> int:
        """Granules of a fraction at most whose force is gathered in a pass, each alone."""
        return GATHERED if self.collisions is None else PASSING

    @cached_property
    def passes(self) -> tuple[Pass, ...]:
        """Every pass: one more once the shares are within the accuracy asked for, or as many as the scene allows."""
        way = self._way
        return *way.passes, self._pass(way.force, way.start, way.before, way.among, last=True)

    @property
    def force(self) -> ForceDensity:
        """The force that the answer's air is solved under; known before the steady airflow under it."""
        return self._way.force

    @cached_property
    def first(self) -> Gathered:
        """What granules exert on the air that does not feel them."""
        return self._alone(self.start, self._fed)

    def _summary(self, given: float, **further: Any) -> AirLoadingSummary:
        """What the passes found; ``given``: force (N/m, y) on the air of the last one."""
        last = self.passes[-1]
        return AirLoadingSummary(
            passes=len(self.passes),
            change=last.change,
            force=tuple(last.exerted.tolist()),
            given=given,
            imbalance=last.source.imbalance,
            unanswered=last.unanswered,
            sampling=self.sampling,
            **further,
        )

    @property
    def sampling(self) -> float:
        """Half of the 95 % interval of that force by the granules that it is gathered from, over it."""
        return self.passes[-1].source.sampling

    def last_change(self, name: str, place: int) -> float:
        """What the last pass changed of a fraction's share in bin number ``place``, in the steady airflow."""
        before = self.passes[-2].gathered if len(self.passes) > 1 else self.first
        return self.passes[-1].gathered.shares[name][place] - before.shares[name][place]

    @cached_property
    def _way(self) -> _Passes:
        """The passes before the last, in airflows that need not settle, until one more is enough or allowed."""
        made: list[Pass] = []
        before, start, force = self.first, self.start, self.first.force
        share, lacked = 1.0, force.density  # the whole way from no force
        while len(made) < self.most - (self.collisions is None) and not (made and self.settled(made[-1])):
            flown = self._pass(force, start, before, last=False)
            made.append(flown)
            lacking = flown.gathered.force.density - force.density
            share, lacked = secant(share, lacked, lacking), lacking
            before, start, force = flown.gathered, flown.air, force.towards(flown.gathered.force, share)
            self.cache.tell("air-loading", f"pass {len(made)}: shares moved by up to {100 * flown.change:.2g} points")
        among = None if self.collisions is None else self._among_others(made[-1], self.collisions)
        return _Passes(tuple(made), before, start, force if among is None else among.force, among)

    def _pass(
        self, force: ForceDensity, start: FlownAir, before: Gathered, among: Gathered | None = None, *, last: bool
    ) -> Pass:
        """The steady airflow under a force, from ``start``, where granules alone gathered ``before``; ``among``: what
        gathered that force there instead of them. The ``last`` one settles.
        """
        air = self.under(force, start, last=last)
        after = self._alone(air, self._fed)
        source, other = (after, 0.0) if among is None else (among, among.force.total - before.force.total)
        return Pass(force, air, after, _farthest(before, after), source, after.force.total + other)

    def _alone(self, air: FlownAir, most: int) -> Gathered:
        """What granules that fly alone, at ``most`` so many of a fraction, exert on an air."""
        bins = [(name, repr(bin_)) for name, bin_ in self.scene.bin.items()]
        count = gathered(self.scene.feed.count, most)
        made = content_key("momentum", air.key, exerted_by(self.scene, self.plan), bins, count, code_of(GATHERING))

        def work(part: Path) -> None:
            self._gatherer("momentum", air).alone(count, part)

        return Gathered.load(self.compilation.make(self.cache, "momentum", made, work))

    def _among_others(self, last: Pass, collisions: CollisionPlan) -> Gathered:
        """What granules that meet in the slab exert on the air of the ``last`` pass, and more of them above it."""
        alone = self._alone(last.air, GATHERED)
        stage, start_up = "slab-momentum", steady_after(collisions, alone.late.__getitem__)
        made = content_key(stage, last.air.key, exerted_by(self.scene, self.plan), start_up, code_of(GATHERING))

        def work(part: Path) -> None:
            self._gatherer(stage, last.air).among_others(collisions, start_up, alone.before, part)

        return Gathered.load(self.compilation.make(self.cache, stage, made, work, slab=True))

    def _gatherer(self, stage: str, air: FlownAir) -> Gatherer:
        return Gatherer(self.scene, self.plan, air.field, self.workers, partial(self.cache.tell, stage))


@dataclass
class CaseLoading(AirLoading):
    """The granules' force on an airflow which OpenFOAM solves."""

    steady: SteadyAir
    answered = 0.1

    @property
    def summary(self) -> AirLoadingSummary:
        from ...air.foam.momentum_source import SOURCE

        air = self.passes[-1].air.in_case
        laid = json.loads((air.case / SOURCE).read_text())
        before, after = self.steady.measured, air.measured
        return self._summary(
            (2.0 if self.steady.half else 1.0) * laid["force"][1],
            cd_without=before.cd,
            cd=after.cd,
            verdict=after.verdict,
            cells=laid["cells"],
            sources=laid["sources"],
        )

    def under(self, force: ForceDensity, before: FlownAir, *, last: bool) -> FlownAir:
        return PassAir(self.steady, force, before.in_case, MOST if last else ON_THE_WAY)


@dataclass
class JetLoading(AirLoading):
    """The granules' force on air at rest, a jet under it. The granules' speed follows the force where no share does."""

    answered = 0.01

    @property
    def summary(self) -> AirLoadingSummary:
        last = self.passes[-1]
        speed = float(jet_of(self.scene, last.force).speed.max())
        return self._summary(float(last.force.total[1]), verdict="driven", speed=speed)

    @property
    def start(self) -> FlownAir:
        """Air at rest, with the jet's eddies: none."""
        boxes = boxes_of(self.scene)
        return self.under(ForceDensity(boxes, np.zeros((boxes.rows, boxes.columns, 2))), self.steady, last=True)

    def under(self, force: ForceDensity, before: FlownAir, *, last: bool) -> FlownAir:
        del before, last  # no solver starts from it
        return JetAir(self.steady, lambda: force)

    @property
    def most(self) -> int:
        """A pass takes a flight of few granules, and no solution."""
        return WITHOUT_SOLVER * super().most


# -- The steady air under it -------------------------------------------------------------------------------------------
class PassAir(MadeOf):
    """The airflow ``bare`` under the ``force`` of a pass, solved on from ``before`` in at ``most`` so many iterations;
    its field is not kept.
    """

    bare: SolvedAir

    def __init__(self, bare: SolvedAir, force: ForceDensity, before: CaseAir, most: int) -> None:
        super().__init__(bare)
        self.force, self.before, self.most = force, before, most

    def make_solution(self) -> tuple[str, Path]:
        return self.bare.solved_on(self.force, self.before, self.most)

    @property
    def key(self) -> str:
        return self.solution[0]

    def make_field(self) -> FlowField:
        return case_field(self.case, self.measured.field_time, self.scene.airstream.density, half=self.half)


class LoadedSteadyAir(MadeOf):
    """A steady airflow under the force: that of the last pass, on another grid solved on from the one without."""

    bare: SolvedAir

    def __init__(self, bare: SolvedAir, loading: CaseLoading) -> None:
        super().__init__(bare)
        self.loading = loading

    def make_solution(self) -> tuple[str, Path]:
        _ = self.bare.solution  # another core gathers the force meanwhile
        last = self.loading.passes[-1]
        same = self.grid == self.loading.steady.grid
        return last.air.in_case.solution if same else self.bare.solved_on(last.force, self.bare)


# -- The passes --------------------------------------------------------------------------------------------------------
def secant(share: float, lacked: Array, lacking: Array) -> float:
    """Which share of the way to the force gathered last the next one goes, after one of ``share`` that led from an air
    which ``lacked`` a force density to one that is ``lacking`` another: Aitken's relaxation, as of Irons & Tuck 1969,
    Int. J. Numer. Meth. Eng. 1, 275. Slower air drags less, and air as fast as the granules not at all, so that the
    whole way oversteps.
    """
    change = lacking - lacked  # summed without a BLAS, whose threads decide the last digit, and that the next key
    wanted = -share * float(np.sum(lacked * change)) / max(float(np.sum(change**2)), 1e-300)
    return float(np.clip(wanted, *SHARES))


def exerted_by(scene: Scene, plan: Plan) -> JsonTable:
    """What the granules' force on an air depends on beside that air and where the bins stand."""
    tables: JsonTable = scene.model_dump(mode="json", by_alias=True)
    for name in ("numerics", "picture", "report", "funnel", "force", "uncertainty", "bin", "limit", "price"):
        del tables[name]
    tables["feed"]["count"] = gathered(scene.feed.count)
    del tables["collisions"]["count"]
    collisions = None if plan.collisions is None else [plan.collisions.depth, dict(plan.collisions.tracers)]
    how = {name: row.tracked for name, row in resolved(plan).fractions.items()}
    versions = [version_of(package) for package in ("numpy", "scipy", "numba")]
    made = {"how": repr(how), "collisions": collisions, "symmetric": plan.airflow.symmetric, "versions": versions}
    return {**tables, **made}


def _farthest(before: Gathered, after: Gathered) -> float:
    """The largest change of any share."""
    rows = ((before.shares[name], after.shares[name]) for name in after.shares)
    return max(abs(new - old) for olds, news in rows for old, new in zip(olds, news, strict=True))
