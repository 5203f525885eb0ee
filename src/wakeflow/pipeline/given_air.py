"""The kind of airflow that the user brings."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import known
from ..core.record import save
from ..core.store import content_key, digest_files
from ..meshing.quality import MeshReport
from .airflow_kinds import CaseAir, airflow_kinds
from .cache import code_of

__all__ = ["GivenAir"]


@airflow_kinds.register("given")
class GivenAir(CaseAir):
    """A solved OpenFOAM case of the user's: it is measured, not solved."""

    means = "a solved case of yours"

    @property
    def case(self) -> Path:
        return Path(known(self.scene.airstream.case))

    @property
    def half(self) -> bool:
        return bool(self.measured.half)

    def make_solution(self) -> tuple[str, Path]:
        """Its files are in the key: a new solution counts."""
        from ..foam.user_case import case_files, measure_given

        time = self.scene.airstream.time or "latest"
        files = digest_files(case_files(self.case, time))
        key = content_key("given", repr(self.flow_spec), time, files, code_of("given"))

        def work(part: Path) -> None:
            self.cache.tell("airflow", f"measuring {self.case}")
            (part / "case").mkdir(exist_ok=True)
            save(part / "case" / "airflow.json", measure_given(self.flow_spec, self.case, time))

        return key, self.cache.make("airflow", key, work)

    @property
    def mesh_quality(self) -> MeshReport:
        return MeshReport(cells=known(self.measured.cells))

    @property
    def model_is_unknown(self) -> bool:
        return True
