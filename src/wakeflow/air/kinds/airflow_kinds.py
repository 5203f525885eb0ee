"""The kinds of airflow: how the air of a scene comes about, and what is known and not known of it.

Each kind is one class. It gives the field that granules fly through with its cache key, the ``airflow`` and the
``mesh`` table of result.json, what was lost when the field was stored, and which parts of its error nobody measures.
The plan names the kind (``planning.airflow_choice.AirflowPlan.kind``); nothing else asks which one it is. Here stands
what all of them have, and those of an OpenFOAM case; the kinds themselves in the modules that
:mod:`.every_kind` names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, Self

from ...core.errors import known
from ...core.geometry import ForceDensity
from ...core.lazy import cached_property
from ...core.record import load
from ...core.registry import Registry
from ...core.store import content_key
from ...laws.turbulence import USUAL, turbulence_models
from ...planning.plan import Plan
from ...planning.stage_cache import StageCache, code_of, version_of
from ...scene import Scene
from ..mesh.spec import MeshReport
from .airflow_table import Airflow
from .realisations import Realisations

if TYPE_CHECKING:
    from ..field import FlowField, Truncation
    from ..foam import FlowSpec
    from ..mesh import MeshSpec


# -- What a scene asks of Gmsh and OpenFOAM under its plan -------------------------------------------------------------
def mesh_spec(scene: Scene, plan: Plan, grid: int = 0) -> MeshSpec:
    """What the plan wants meshed, on one of its grids."""
    from ..mesh import SideInlet, plan_mesh

    channel, air = scene.channel, scene.airstream
    return plan_mesh(
        [body.outline() for body in scene.body.values()],
        width=channel.width,
        top=channel.top,
        bottom=channel.bottom,
        names=list(scene.body),
        walls=channel.walls,
        direction=air.direction,
        rung="standard" if plan.airflow.stepping == "time-resolved" else "draft",
        scale=scene.numerics.mesh_scale * plan.airflow.scales[grid],
        inlets=[SideInlet(name, inlet.side, *inlet.span) for name, inlet in channel.inlet.items()],
        extend=channel.extend and air.case is None,
        half=plan.airflow.half,
    )


def flow_spec(scene: Scene, plan: Plan, mesh: MeshSpec) -> FlowSpec:
    """The airflow that the plan wants through a mesh, or that a given case must be."""
    from ..foam import FlowSpec, Stream
    from ..foam.mesh_motion import MeshMotion

    air, how = scene.airstream, plan.airflow
    amplitude, omega = scene.motion
    return FlowSpec(
        mesh=mesh,
        speed=air.speed,
        density=air.density,
        viscosity=air.viscosity,
        turbulence=known(how.turbulence) if known(how.turbulence) in turbulence_models else USUAL,
        stepping=how.stepping or "steady",
        intensity=air.turbulence,
        profile=air.profile,
        inlets=tuple(
            Stream(name, inlet.side, inlet.width, inlet.velocity) for name, inlet in scene.channel.inlet.items()
        ),
        accuracy=how.accuracy,
        ranks=0 if scene.numerics.ranks == "auto" else scene.numerics.ranks,
        vibration=MeshMotion(float(amplitude[1]), omega) if how.moving else None,
        span=how.span,
    )


# -- The kinds of airflow ----------------------------------------------------------------------------------------------
class ForceOnAir(Protocol):
    """What the granules of a scene exert on its airflow."""

    @property
    def force(self) -> ForceDensity:
        """Under which the airflow is made."""

    @property
    def key(self) -> str:
        """Of the steady airflow under it."""


class ForceOnCase(ForceOnAir, Protocol):
    """The same where OpenFOAM solves that."""

    @property
    def early(self) -> ForceOnAir:
        """The same as it is known first."""

    def solution_on(self, air: CaseAir) -> tuple[str, Path]:
        """Key and folder of the steady ``air``, which does not feel it, under the force."""


@dataclass
class AirflowKind(ABC):
    """The airflow of one scene under one plan.

    ``grid`` is the place among the plan's grids, 0 the answer's; ``steady`` gives the scene's steady airflow, and
    ``nearest`` that of the same kind to start from, of another scene or a coarser grid; both solved where they are not.
    ``loading``: the granules' force on the air, None where it does not feel them.
    """

    scene: Scene
    plan: Plan
    cache: StageCache
    grid: int
    steady: Callable[[], CaseAir]
    nearest: Callable[[], CaseAir | None] = field(default=lambda: None, kw_only=True)
    loading: Callable[[], ForceOnAir | None] = field(default=lambda: None, kw_only=True)
    means: ClassVar[str] = ""  # what granules fly in, in words
    at_once: ClassVar[bool] = False  # known without meshing, solving or reading files

    @abstractmethod
    def make_field(self) -> tuple[str, FlowField] | None:
        """Cache key and field of the whole channel; None where there is no air."""

    @abstractmethod
    def make_table(self) -> Airflow:
        """What was measured on the airflow, or is known of it, but its rung."""

    @cached_property
    def bare(self) -> Self:
        """The same airflow where it does not feel the granules."""
        return replace(self, loading=lambda: None)

    @property
    def solver(self) -> str | None:
        """Version of the OpenFOAM that solves it; None where none does."""
        return None

    @cached_property
    def field(self) -> tuple[str, FlowField] | None:
        """:meth:`make_field`, made once, in the scene's gas."""
        made = self.make_field()
        return None if made is None else (made[0], self.in_gas(made[1]))

    def in_gas(self, field: FlowField) -> FlowField:
        """A field with the temperature and the mean free path of the scene's air."""
        air = self.scene.airstream
        return field.with_values(temperature=air.temperature, mean_free_path=air.mean_free_path)

    def between(self, theta: float, strength: float) -> tuple[str, FlowField] | None:
        """Key and field with another wake, of ``theta`` and ``strength`` as in ``field.blended_wake``; the field itself
        where the wake is no time-resolved one.
        """
        del theta, strength  # for subclasses
        return self.field

    @property
    def realisations(self) -> Realisations:
        """The fields in which the replicates fly in turn: the one of :meth:`make_field` unless a kind has more."""
        return Realisations(None if self.field is None else self.field[1], cycles=self.cycles)

    @property
    def cycles(self) -> int:
        """Cycles of the shedding in the field's period, each a sample of the airflow; 1 where nothing changes."""
        return 1

    @cached_property
    def table(self) -> Airflow:
        """The ``airflow`` table of result.json."""
        return replace(self.make_table(), rung=self.plan.rung)

    @property
    def mesh_quality(self) -> MeshReport | None:
        """Counts and quality of the mesh; None without one."""
        return None

    @property
    def truncation(self) -> Truncation | None:
        """What the field lost when it was stored as a mean and modes; None for a field that is stored whole."""
        return None if self.field is None else self.field[1].truncation

    def unknown_parts(self) -> tuple[str, ...]:
        """Sources of error of the airflow that stay unknown unless flying again in another airflow measures them:
        mesh, airflow-model (how far the airflow is from the real one), airflow-statistics (a finite sample of it).
        """
        return ()


airflow_kinds: Registry[type[AirflowKind]] = Registry("kind of airflow")


class CaseAir(AirflowKind):
    """An airflow that is in an OpenFOAM case."""

    @cached_property
    def mesh_spec(self) -> MeshSpec:
        """What the plan wants meshed, or what a given case must hold."""
        return mesh_spec(self.scene, self.plan, self.grid)

    @cached_property
    def flow_spec(self) -> FlowSpec:
        """The airflow that the plan wants through the mesh, or that a given case must be."""
        return flow_spec(self.scene, self.plan, self.mesh_spec)

    @cached_property
    def solution(self) -> tuple[str, Path]:
        """Cache key and folder of the airflow; its numbers are in case/airflow.json."""
        return self.make_solution()

    @abstractmethod
    def make_solution(self) -> tuple[str, Path]:
        """Solve or measure the airflow, or take it from the cache: key and folder."""

    @property
    def case(self) -> Path:
        """The OpenFOAM case that the field is read from."""
        return self.solution[1] / "case"

    @property
    def half(self) -> bool:
        """Whether the case is the right half of a symmetric channel."""
        return self.mesh_spec.half

    @property
    def measured(self) -> Airflow:
        """What was measured on the case."""
        return load(Airflow, self.solution[1] / "case" / "airflow.json")

    def make_table(self) -> Airflow:
        return self.measured

    @cached_property
    def _stored(self) -> tuple[str, Path]:
        """Cache key and folder of what granules can fly in: field.npz, and state-N.npz for each late state."""
        from .case_field import case_field, state_fields

        key = content_key("field", self.solution[0], code_of("air.kinds.case_field"), version_of("foamlib"))
        density, table = self.scene.airstream.density, self.measured

        def work(part: Path) -> None:
            self.cache.tell("field", "reading the airflow")
            field = case_field(self.case, known(table.field_time), density, half=self.half)
            field.save(part / "field.npz")
            for number, state in enumerate(state_fields(self.case, density, half=self.half)):
                state.save(part / f"state-{number}.npz")

        return key, self.cache.make("field", key, work)

    def make_field(self) -> tuple[str, FlowField]:
        key, folder = self._stored
        return key, self._loaded(folder / "field.npz")

    @cached_property
    def realisations(self) -> Realisations:
        """The late states where the airflow does not settle, each as likely as the others; else the one field."""
        states = sorted(self._stored[1].glob("state-*.npz"))
        if not states:
            return super().realisations
        first, *others = (partial(self._loaded, path) for path in states)
        return Realisations(first(), tuple(others))

    def _loaded(self, file: Path) -> FlowField:
        from ..field import FlowField

        return self.in_gas(FlowField.load(file))

    @cached_property
    def cycles(self) -> int:
        """Whole shedding periods of the loop that the case keeps."""
        from ..foam.read import loop_of

        loop = loop_of(self.case) if self.measured.period is not None else None
        return 1 if loop is None else max(1, int(loop["periods"]))

    def unknown_parts(self) -> tuple[str, ...]:
        statistics = () if self.measured.period is None else ("airflow-statistics",)
        return ("mesh", *(("airflow-model",) if self.model_is_unknown else ()), *statistics)

    @property
    def model_is_unknown(self) -> bool:
        """Whether nobody says how far the airflow is from the real one."""
        return False
