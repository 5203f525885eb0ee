"""Every air of one scene under one plan: the steady one and the one in time, bare and loaded, on each grid.

An airflow in time starts from the steady one, or from another in time: of a run near by, or on the next coarser grid.
Where granules are felt, their force is gathered in the steady airflow that does not feel them, and loads all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...air.kinds.airflow_kinds import CaseAir, FlownAir
from ...air.kinds.blended_air import BlendedAir
from ...air.kinds.every_kind import airflow_kinds
from ...air.kinds.known_air import JetAir
from ...air.kinds.solved_air import LoadedAir, SolvedAir, SpanAir, SteadyAir, TimeResolvedAir
from ...core.lazy import cached_property
from ...planning.make import make_plan
from ...planning.plan import Plan
from ...planning.stage_cache import StageCache
from ...scene import Scene
from .air_loading import AirLoading, CaseLoading, JetLoading, LoadedSteadyAir
from .compilation import Compilation

ROUGH = 0.5  # relative half width of averages: a wake that others start from ends with the fewest periods


@dataclass
class Airs:
    """The airs of one scene, each made once; ``near``: those of a run whose airflows these start from."""

    scene: Scene
    plan: Plan
    cache: StageCache
    near: Airs | None
    compilation: Compilation
    workers: int

    @property
    def in_time(self) -> bool:
        """Whether the airflow is resolved in time."""
        return self.plan.airflow.stepping == "time-resolved"

    @cached_property
    def answers(self) -> tuple[FlownAir, ...]:
        """Airs that the plan wants, one a grid, the answer's first."""
        how, loading = self.plan.airflow, self.loading
        if not how.stepping:
            return (self._bare if loading is None else JetAir(self._bare, lambda: loading.force),)
        if how.span:
            return (self._felt(SpanAir(self.scene, self.plan, self.cache, start=self.steady[0])),)
        if not self.in_time:
            return self.steady
        ends = zip(self.steady, self.resolved, strict=True)
        return tuple(BlendedAir(*both) for both in ends) if how.brackets else self.resolved

    @property
    def _bare(self) -> FlownAir:
        """The air that nobody solves, of its kind."""
        return airflow_kinds[self.plan.airflow.kind](self.scene, self.plan, self.cache)

    def _felt(self, bare: SolvedAir) -> CaseAir:
        """The air as it feels the granules, where the plan has it so."""
        loading = self.loading
        return bare if loading is None else LoadedAir(bare, lambda: loading.force)

    # -- steady --------------------------------------------------------------------------------------------------------

    @cached_property
    def steady_plan(self) -> Plan:
        """The plan where it is steady, else that of the steady airflow beside it."""
        if not self.in_time:
            return self.plan
        plan = make_plan(self.scene, rung="draft", force=self.plan.force, target_error=self.plan.target_error)
        return replace(plan, airflow=plan.airflow.feeling(self.scene, loaded=self.plan.airflow.loaded))

    @cached_property
    def bare_steady(self) -> tuple[SteadyAir, ...]:
        """The steady airflow that feels no granules, for each grid of the plan; none for air that nobody solves."""
        if not self.plan.airflow.stepping:
            return ()
        plan, near = self.steady_plan, () if self.near is None else self.near.bare_steady
        coarsest = len(plan.airflow.scales) - 1
        return tuple(
            SteadyAir(self.scene, plan, cache, min(grid, coarsest), start=_like(near, grid))
            for grid, cache in enumerate(self._caches(draft=self.in_time))
        )

    @cached_property
    def steady(self) -> tuple[CaseAir, ...]:
        """The steady airflow, which feels the granules where the plan has it so."""
        loading = self.loading
        if not isinstance(loading, CaseLoading):
            return self.bare_steady
        return tuple(LoadedSteadyAir(bare, loading) for bare in self.bare_steady)

    @cached_property
    def loading(self) -> AirLoading | None:
        """The granules' force on the air, gathered on the answer's grid; None where the plan leaves it out."""
        if not self.plan.airflow.loaded:
            return None
        if not self.plan.airflow.stepping:
            return JetLoading(self._bare, self.compilation, self.workers)
        return CaseLoading(self.bare_steady[0], self.compilation, self.workers)

    # -- in time -------------------------------------------------------------------------------------------------------

    @cached_property
    def resolved(self) -> tuple[CaseAir, ...]:
        """The airflow in time on each grid, in the plane: it starts from that on the next coarser grid, or where it
        feels granules from the early one.
        """
        if not self.in_time or self.plan.airflow.span:
            return ()
        near, made = () if self.near is None else self.near.resolved, list[CaseAir]()
        for grid, cache in reversed([*enumerate(self._caches())]):
            start = _like(near, grid) or self.early or (made[-1] if made else self.steady[grid])
            made.append(self._felt(TimeResolvedAir(self.scene, self.plan, cache, grid, start=start)))
        return tuple(reversed(made))

    @cached_property
    def early(self) -> LoadedAir | None:
        """The airflow in time on the coarsest of several grids under the force as it is known first, to start from
        alone: its averages may be rough. None where the air feels no granules.
        """
        coarsest = len(self.plan.airflow.scales) - 1
        loading = self.loading
        if loading is None or not self.in_time or not coarsest:
            return None
        rough = replace(self.plan, airflow=replace(self.plan.airflow, accuracy=ROUGH))
        start, cache = self.bare_steady[coarsest], self._caches()[coarsest]
        bare = TimeResolvedAir(self.scene, rough, cache, coarsest, start=start, made_as="early-airflow")
        return LoadedAir(bare, lambda: loading.first.force)

    def solve_start(self) -> None:
        """Solve what the answer's airflow starts from, as far as it need not wait for the last force."""
        if self.early is not None and not (self.near is not None and self.near.resolved):
            _ = self.bare_steady[self.early.grid].solution
            _ = self.early.solution

    def _caches(self, *, draft: bool = False) -> list[StageCache]:
        """Caches by grid, each under the label of its airflow."""
        labels = [self.cache.label, *(self.cache.label._replace(grid=scale) for scale in self.plan.airflow.scales[1:])]
        return [replace(self.cache, label=label._replace(draft=draft)) for label in labels]


def _like(airs: Sequence[CaseAir], grid: int) -> CaseAir | None:
    """Airflow on the grid like one's own, or on the coarsest; None where there is none."""
    return airs[min(grid, len(airs) - 1)] if airs else None
