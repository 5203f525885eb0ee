"""The kinds of airflow that are meshed and solved in the plane: steady, and resolved in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self, cast

from ...core.errors import known
from ...core.files import atomic_write, case_template
from ...core.geometry import ForceDensity
from ...core.lazy import cached_property
from ...core.record import load
from ...core.sources import PACKAGE
from ...core.store import content_key, digest_files
from ...planning.airflow_choice import SHEDDING_ABOVE
from ...planning.cost import ranks_for
from ...planning.stage_cache import code_of, version_of
from ..mesh.spec import MeshReport
from .airflow_kinds import CaseAir, ForceOnCase, airflow_kinds

if TYPE_CHECKING:
    from ..field import FlowField
    from ..field.combined import Wakes
    from ..foam import AirflowResult, FlowSpec


ROUGH = 0.5  # relative half width of averages: a wake that others start from ends with the fewest periods


@dataclass
class SolvedAir(CaseAir):
    """An airflow that Gmsh meshes and OpenFOAM solves; ``made_as``: the stage that this is."""

    made_as: str = field(default="airflow", kw_only=True)
    code: ClassVar[str] = "air.foam.airflow"  # the module of ``solve``

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
        """:func:`wakeflow.air.foam.solve_airflow` under the force, or what takes its place with the same arguments."""
        from ..foam import solve_airflow

        return partial(solve_airflow, force=self.force)

    @cached_property
    def force(self) -> ForceDensity | None:
        """That of granules on the air; None where it does not feel them."""
        loading = self.loading()
        return None if loading is None else loading.force

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
        (mesh_key, mesh_folder), spec = self.mesh, self.solved_spec
        code = content_key(code_of(self.code), digest_files([case_template()]), self.solver)
        asked = {name: value for name, value in asdict(spec).items() if name != "mesh"}
        under = None if self.force is None else self.force.digest  # another core solves the start meanwhile
        start = self.start()  # by its key: the same airflow from another start would end at another moment
        key = content_key("airflow", mesh_key, asked, code, None if start is None else start.parent.name, under)

        def work(part: Path) -> None:
            self.solve(
                spec,
                mesh_folder / "mesh.msh",
                part / "case",
                start=start,
                listener=lambda now: self.cache.tell(self.made_as, str(now)),
            )

        return key, self.cache.make(self.made_as, key, work)

    def start(self) -> Path | None:
        """The case folder of the solved airflow that this one starts from; None: from a uniform stream."""
        near = self.nearest()
        return None if near is None else near.bare.case


@airflow_kinds.register("steady")
class SteadyAir(SolvedAir):
    """One steady solution: the flow itself where the wake does not shed."""

    means = "one steady wake"

    def make_solution(self) -> tuple[str, Path]:
        loading = self.loading()
        return super().make_solution() if loading is None else cast(ForceOnCase, loading).solution_on(self.bare)

    @property
    def model_is_unknown(self) -> bool:
        return self.scene.reynolds >= SHEDDING_ABOVE


@airflow_kinds.register("time-resolved")
class TimeResolvedAir(SolvedAir):
    """A solution in time: whole periods of the shedding wake, repeated."""

    means = "the wake in time"

    @cached_property
    def early(self) -> Self:
        """The same under the granules' force as it is known first: only to start from, so that its averages may be
        rough. The same itself where it does not feel the granules.
        """
        if not self.plan.airflow.loaded:
            return self
        rough = replace(self.plan, airflow=replace(self.plan.airflow, accuracy=ROUGH))
        return replace(
            self, plan=rough, steady=lambda: self.steady().bare, nearest=lambda: None,
            loading=lambda: cast(ForceOnCase, self.loading()).early, made_as="early-airflow",
        )  # fmt: skip

    def start(self) -> Path:
        """The wake in time that is nearest, developed already; else the steady one."""
        return (self.nearest() or self.steady()).case

    @cached_property
    def resolved(self) -> tuple[str, FlowField]:
        """Key and field as computed, in time."""
        return super().make_field()

    def make_field(self) -> tuple[str, FlowField]:
        return self.resolved

    @cached_property
    def wakes(self) -> Wakes:
        """The steady wake and the one in time, to be blended."""
        from ..field.combined import Wakes

        return Wakes(self.resolved[1], known(self.steady().field)[1])

    def between(self, theta: float, strength: float) -> tuple[str, FlowField]:
        key, resolved = self.resolved
        if resolved.times is None or theta == strength == 1.0:  # it came to rest, or is asked for as it is
            return self.resolved
        steady, _ = known(self.steady().field)
        made = content_key("blend", key, steady, theta, strength, code_of("air.field.combined"))
        return made, self.wakes.blended(theta, strength)


def _publish(file: Path, key: str) -> None:
    """Show a cached mesh under its key in the folder ``meshes`` of this program's checkout, where that is the current
    folder; one of that name anywhere else is not the program's.
    """
    folder = Path("meshes").absolute()
    target = folder / f"{key}.msh"
    if folder == PACKAGE.parent.parent / "meshes" and folder.is_dir() and not target.exists():
        with atomic_write(target, "wb") as stream:
            stream.write(file.read_bytes())
