"""The air that is meshed and solved: steady, in time, in three dimensions; and any of these loaded by granules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from ...core.code_key import PACKAGE
from ...core.files import atomic_write, case_template
from ...core.geometry import ForceDensity
from ...core.lazy import cached_property
from ...core.record import load
from ...core.store import content_key, digest_files
from ...planning.airflow_choice import SHEDDING_ABOVE
from ...planning.cost import ranks_for
from ...planning.stage_cache import code_of, version_of
from ..foam.steady import MOST
from ..mesh.spec import MeshReport
from .airflow_kinds import CaseAir, MadeOf, airflow_kinds

if TYPE_CHECKING:
    from ..foam import AirflowResult, FlowSpec


# -- Solved as it is ---------------------------------------------------------------------------------------------------
@dataclass
class SolvedAir(CaseAir):
    """An airflow that Gmsh meshes and OpenFOAM solves, from that of ``start``, or from a uniform stream where that is
    None; ``made_as``: the stage that this is.
    """

    start: CaseAir | None = field(default=None, kw_only=True)
    made_as: str = field(default="airflow", kw_only=True)
    code: ClassVar[str] = "air.foam.airflow"  # the module of ``solver_function``

    @cached_property
    def mesh(self) -> tuple[str, Path]:
        """Key and folder (mesh.msh, mesh.vtu, mesh.json); in a checkout its folder ``meshes`` gets <key>.msh too."""
        from ..mesh import build_mesh

        key = content_key("mesh", repr(self.mesh_spec), code_of("air.mesh.spec"), version_of("gmsh"))
        folder = self.cache.make("mesh", key, lambda part: build_mesh(self.mesh_spec, part))
        _publish(folder / "mesh.msh", key)
        return key, folder

    @property
    def mesh_quality(self) -> MeshReport:
        return load(MeshReport, self.mesh[1] / "mesh.json")

    @property
    def solve(self) -> Callable[..., AirflowResult]:
        """:func:`wakeflow.air.foam.solve_airflow`, or what takes its place with the same arguments."""
        from ..foam import solve_airflow

        return solve_airflow

    @property
    def cells(self) -> int:
        """Cells that are solved in."""
        return self.mesh_quality.cells

    @cached_property
    def solved_spec(self) -> FlowSpec:
        """The airflow that the plan wants, with its number of ranks: by the mesh alone, so that every machine computes
        the same.
        """
        spec = self.flow_spec
        return spec if spec.ranks else replace(spec, ranks=1 if spec.vibration else ranks_for(self.cells)[0])

    @property
    def solver(self) -> str:
        from ..foam.programs import openfoam_version

        return openfoam_version()

    def make_solution(self) -> tuple[str, Path]:
        return self.solved(None)

    def solved(self, force: ForceDensity | None) -> tuple[str, Path]:
        """Key and folder of this airflow under a ``force``, from the cache or solved now."""
        (mesh_key, _), spec = self.mesh, self.solved_spec
        code = content_key(code_of(self.code), digest_files([case_template()]), self.solver)
        about = {name: value for name, value in asdict(spec).items() if name != "mesh"}
        start = None if self.start is None else self.start.case  # in the key: from another it ends at another moment
        begun, under = (None if start is None else start.parent.name), (None if force is None else force.digest)
        key = content_key("airflow", mesh_key, about, code, begun, under)
        return self._solved(self.made_as, key, spec, start, force=force)

    def solved_on(self, force: ForceDensity, before: CaseAir, most: int = MOST) -> tuple[str, Path]:
        """Key and folder of the steady airflow under a ``force``, solved from a solved one ``before`` with the settings
        that served there, in at ``most`` so many iterations.
        """
        from ..foam.airflow import schemes_in

        limit, code = None if most == MOST else most, code_of("air.foam.airflow")
        key = content_key("loaded-airflow", before.solution[0], force.digest, limit, code)
        spec = replace(self.solved_spec, settings=schemes_in(before.case))
        return self._solved("loaded-airflow", key, spec, before.case, force=force, most=most)

    def _solved(self, stage: str, key: str, spec: FlowSpec, start: Path | None, **how: object) -> tuple[str, Path]:
        """Key and folder of what is solved as a ``stage`` where the cache has not got it."""

        def work(part: Path) -> None:
            msh, case = self.mesh[1] / "mesh.msh", part / "case"
            self.solve(spec, msh, case, start=start, listener=lambda now: self.cache.tell(stage, str(now)), **how)

        return key, self.cache.make(stage, key, work)


@airflow_kinds.register("steady")
class SteadyAir(SolvedAir):
    """One steady solution: the flow itself where the wake does not shed."""

    means = "one steady wake"

    @property
    def model_is_unknown(self) -> bool:
        return self.scene.reynolds >= SHEDDING_ABOVE


@airflow_kinds.register("time-resolved")
class TimeResolvedAir(SolvedAir):
    """A solution in time: whole periods of the shedding wake, repeated."""

    means = "the wake in time"


@airflow_kinds.register("three-dimensional")
class SpanAir(SolvedAir):
    """A scale-resolving solution in three dimensions: its layers are realisations of a plane wake."""

    means = "the wake in three dimensions"
    code = "air.foam.spanwise.span_run"

    @property
    def solve(self) -> Callable[..., AirflowResult]:
        from ..foam.spanwise.span_run import solve_span

        return solve_span

    @property
    def cells(self) -> int:
        return super().cells * self.plan.airflow.span.layers

    @property
    def model_is_unknown(self) -> bool:
        return True


def _publish(file: Path, key: str) -> None:
    """Show a cached mesh under its key in the folder ``meshes`` of this program's checkout, where that is the current
    folder; one of that name anywhere else is not the program's.
    """
    folder = Path("meshes").absolute()
    target = folder / f"{key}.msh"
    if folder == PACKAGE.parent.parent / "meshes" and folder.is_dir() and not target.exists():
        with atomic_write(target, "wb") as stream:
            stream.write(file.read_bytes())


# -- Solved under the granules' force ----------------------------------------------------------------------------------
class LoadedAir(MadeOf):
    """The airflow ``bare`` as it is under the ``force`` of granules, which is gathered when it is called."""

    bare: SolvedAir

    def __init__(self, bare: SolvedAir, force: Callable[[], ForceDensity]) -> None:
        super().__init__(bare)
        self.force = force

    def make_solution(self) -> tuple[str, Path]:
        return self.bare.solved(self.force())  # another core solves the start while that is gathered
