"""The air of a scene: what granules fly through, how it comes about, what is known and not known of it.

Air is bare (a kind that the plan names: ``planning.airflow_choice.AirflowPlan.kind``), loaded by granules, or a blend
of two airs; grids are an ensemble of them. Each has a ``key`` in the cache, a ``field``, ``numbers`` (the ``airflow``
table of result.json) and the ``unknown`` parts of its error. Here is what all of them have, and those of an OpenFOAM
case; the kinds themselves are in the modules that :mod:`.every_kind` names.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.record import load
from ...core.registry import Registry
from ...core.store import content_key
from ...laws.span import CONVECTIVE_PERIOD, Span
from ...laws.turbulence import USUAL, turbulence_models
from ...planning.plan import Plan
from ...planning.stage_cache import StageCache, code_of, version_of
from ...scene import Scene
from ..mesh.spec import NO_MESH, MeshReport
from .airflow_table import Airflow

if TYPE_CHECKING:
    from ..field import FlowField
    from ..foam import FlowSpec
    from ..mesh import MeshSpec


# -- Realisations of an airflow ----------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Realisations:
    """The fields of one airflow. Replicate r flies in number r mod n of the n there are.

    ``field``: the first, which pictures show too; None in a vacuum. ``others`` make the further ones when they are
    flown in, since fields may be large: a late state of a steady airflow that does not settle, a layer of a record in
    three dimensions. All have one period, or none has. ``cycles``: of the shedding in that period, or parts of a record
    that are as good as independent; 1 where nothing changes. Each of them is one draw of the real airflow: their number
    is what the intervals rest on beside that of the granules.
    """

    field: FlowField | None
    others: tuple[Callable[[], FlowField], ...] = ()
    cycles: int = 1

    def __len__(self) -> int:
        return 1 + len(self.others)

    @property
    def period(self) -> float:
        """Time (s) over which granules are released; 0 in a steady airflow and in a vacuum."""
        return 0.0 if self.field is None else self.field.period

    def make(self, number: int) -> FlowField | None:
        """Make the field of this ``number``. Raises SceneError where its period is not the first one's."""
        if number == 0:
            return self.field
        made = self.others[number - 1]()
        if made.period != self.period:
            raise SceneError(f"realisation {number}: its period is {made.period} s, the first one's {self.period} s")
        return made

    def mapped(self, change: Callable[[FlowField], FlowField]) -> Realisations:
        """These realisations with ``change`` applied to each field."""
        if self.field is None:
            return self
        others = tuple(partial(_changed, change, other) for other in self.others)
        return replace(self, field=change(self.field), others=others)

    def cycle_of(self, time: NDArray[np.float64]) -> NDArray[np.uint16]:
        """The cycle, from 0, within which granules are released at ``time`` (n,) s."""
        if not self.period:
            return np.zeros(len(time), dtype=np.uint16)
        return np.minimum(np.floor(time / self.period % 1.0 * self.cycles), self.cycles - 1).astype(np.uint16)


def _changed(change: Callable[[FlowField], FlowField], make: Callable[[], FlowField]) -> FlowField:
    return change(make())


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
        extend=channel.extend and not air.case,
        half=plan.airflow.half,
    )


def flow_spec(scene: Scene, plan: Plan, mesh: MeshSpec) -> FlowSpec:
    """The airflow that the plan wants through a mesh, or that a given case must be."""
    from ..foam import FlowSpec, Stream
    from ..foam.case import MeshMotion, SpanSpec

    air, how = scene.airstream, plan.airflow
    amplitude, omega = scene.motion
    plane = FlowSpec(
        mesh=mesh,
        speed=air.speed,
        density=air.density,
        viscosity=air.viscosity,
        turbulence=how.turbulence if how.turbulence and how.turbulence in turbulence_models else USUAL,
        stepping=how.stepping or "steady",
        intensity=air.turbulence,
        profile=air.profile,
        inlets=tuple(
            Stream(name, inlet.side, inlet.width, inlet.velocity) for name, inlet in scene.channel.inlet.items()
        ),
        accuracy=how.accuracy,
        ranks=0 if scene.numerics.ranks == "auto" else scene.numerics.ranks,
        vibration=MeshMotion(float(amplitude[1]), omega) if how.moving else None,
    )
    return SpanSpec(**vars(plane), span=how.span) if how.span else plane


# -- Air ---------------------------------------------------------------------------------------------------------------
@dataclass
class FlownAir(ABC):
    """The air of one scene under one plan: its ``key`` in the cache, ``field``, ``numbers``, ``unknown`` parts of its
    error. ``grid`` is the place among the plan's grids, 0 the answer's.
    """

    scene: Scene
    plan: Plan
    cache: StageCache
    grid: int = 0
    means: ClassVar[str] = ""  # what granules fly in, in words
    at_once: ClassVar[bool] = False  # known without meshing, solving or reading files

    @property
    @abstractmethod
    def key(self) -> str:
        """The field's key in the cache: everything that the field depends on."""

    @abstractmethod
    def make_field(self) -> FlowField:
        """The field of the whole channel."""

    @abstractmethod
    def make_numbers(self) -> Airflow:
        """What was measured on the airflow, or is known of it, but its rung."""

    @property
    def unknown(self) -> tuple[str, ...]:
        """Sources of error of the airflow that stay unknown unless flying again in another airflow measures them:
        mesh, airflow-model (how far the airflow is from the real one), airflow-statistics (a finite sample of it).
        """
        return ()

    @cached_property
    def field(self) -> FlowField:
        """:meth:`make_field`, made once, in the scene's gas."""
        return self.in_gas(self.make_field())

    def in_gas(self, field: FlowField) -> FlowField:
        """A field with the temperature and the mean free path of the scene's air."""
        air = self.scene.airstream
        return field.with_values(temperature=air.temperature, mean_free_path=air.mean_free_path)

    def between(self, theta: float, strength: float) -> FlowField:
        """The field with another wake, of ``theta`` and ``strength`` as in ``field.blended_wake``; the field itself
        where the air is no blend.
        """
        del theta, strength  # for a blend
        return self.field

    @property
    def realisations(self) -> Realisations:
        """The fields in which the replicates fly in turn: :attr:`field` unless a kind has more."""
        return Realisations(self.field)

    @cached_property
    def numbers(self) -> Airflow:
        """The ``airflow`` table of result.json."""
        return replace(self.make_numbers(), rung=self.plan.rung)

    @property
    def mesh_quality(self) -> MeshReport:
        """Counts and quality of the mesh; no cells without one."""
        return NO_MESH

    @property
    def in_case(self) -> CaseAir:
        """This air as one in an OpenFOAM case. Raises SceneError where it is in none."""
        raise SceneError(f"airflow {self.plan.airflow.kind}: it has neither mesh nor OpenFOAM case")

    @property
    def solver(self) -> str:
        """Version of the OpenFOAM that solves it; empty where none does."""
        return ""


airflow_kinds: Registry[type[FlownAir]] = Registry("kind of airflow")


class CaseAir(FlownAir):
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
    def in_case(self) -> CaseAir:
        return self

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

    def make_numbers(self) -> Airflow:
        return self.measured

    @cached_property
    def stored(self) -> StoredFields:
        """The fields that granules can fly in, in the cache."""
        span = self.plan.airflow.span
        return layer_fields(self, span) if span else plane_fields(self)

    @property
    def key(self) -> str:
        return self.stored.shown.parent.name

    def make_field(self) -> FlowField:
        return self._loaded(self.stored.shown)

    @cached_property
    def realisations(self) -> Realisations:
        """The late states of an airflow that does not settle, the layers of one in three dimensions; else the field."""
        first, *others = self.stored.flown
        shown = self.field if first == self.stored.shown else self._loaded(first)
        return Realisations(shown, tuple(partial(self._loaded, file) for file in others), self.stored.cycles)

    def _loaded(self, file: Path) -> FlowField:
        from ..field import FlowField

        return self.in_gas(FlowField.load(file))

    @property
    def unknown(self) -> tuple[str, ...]:
        statistics = () if math.isnan(self.measured.period) else ("airflow-statistics",)
        return ("mesh", *(("airflow-model",) if self.model_is_unknown else ()), *statistics)

    @property
    def model_is_unknown(self) -> bool:
        """Whether nobody says how far the airflow is from the real one."""
        return False


# -- The fields of a solved airflow that granules can fly in, files in the cache ---------------------------------------
class StoredFields(NamedTuple):
    """The file of the field that is ``shown`` in pictures, those that are ``flown`` in, each as likely as the others,
    and the ``cycles`` of the shedding in their period, each a sample of the airflow; 1 where nothing changes.
    """

    shown: Path
    flown: Sequence[Path]
    cycles: int


def plane_fields(air: CaseAir) -> StoredFields:
    """Stored fields of a plane airflow: field.npz, and state-N.npz for each late state of one that does not settle. Its
    cycles are whole shedding periods of the loop that the case keeps.
    """

    def write(part: Path) -> None:
        from .case_field import case_field, state_fields

        air.cache.tell("field", "reading the airflow")
        density = air.scene.airstream.density
        case_field(air.case, air.measured.field_time, density, half=air.half).save(part / "field.npz")
        for number, state in enumerate(state_fields(air.case, density, half=air.half)):
            state.save(part / f"state-{number}.npz")

    from ..foam.read import loop_of

    folder = _made("field", air, write)
    shown, cycles = folder / "field.npz", 1
    if not math.isnan(air.measured.period):
        cycles = max(1, int(loop_of(air.case)["periods"]))
    return StoredFields(shown, sorted(folder.glob("state-*.npz")) or [shown], cycles)


def layer_fields(air: CaseAir, span: Span) -> StoredFields:
    """Stored fields of an airflow in three dimensions: the layers that are flown in, each a plane wake.

    Its cycles are the parts of a layer's period that count as independent: as many, over all layers, as there were
    sheddings. Layers of one run shed together, so that they are no further samples of that.
    """
    from .case_field import layer_file, save_layers

    spec, result = air.flow_spec, air.measured
    flown = result.span.flown

    def write(part: Path) -> None:
        air.cache.tell("field", "reading the layers of the airflow")
        save_layers(air.case, part, spec, span.start_up * spec.convective_time, flown)

    folder = _made("layers", air, write)
    files = [layer_file(folder, number) for number in range(len(flown))]
    number = result.strouhal.value if result.strouhal else 1.0 / CONVECTIVE_PERIOD
    sheddings = result.period / spec.convective_time * number
    return StoredFields(files[0], files, max(1, int(sheddings / len(flown))))


def _made(what: str, air: CaseAir, write: Callable[[Path], None]) -> Path:
    """The folder of the fields, from the cache or written now."""
    key = content_key(what, air.solution[0], code_of("air.kinds.case_field"), version_of("foamlib"))
    return air.cache.make("field", key, write)


# -- An airflow made of another ----------------------------------------------------------------------------------------
class MadeOf(CaseAir):
    """An airflow made of another one, ``bare``: on its mesh, by its solver."""

    def __init__(self, bare: CaseAir) -> None:
        super().__init__(bare.scene, bare.plan, bare.cache, bare.grid)
        self.bare = bare

    @property
    def mesh_spec(self) -> MeshSpec:
        return self.bare.mesh_spec

    @property
    def mesh_quality(self) -> MeshReport:
        return self.bare.mesh_quality

    @property
    def solver(self) -> str:
        return self.bare.solver

    @property
    def model_is_unknown(self) -> bool:
        return self.bare.model_is_unknown
