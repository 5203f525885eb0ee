"""The kinds of airflow that nobody has to solve: none, that of an empty channel, and the user's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import SceneError
from ...core.geometry import ForceDensity
from ...core.record import save
from ...core.store import content_key, digest_files
from ...planning.stage_cache import code_of
from ..mesh.spec import MeshReport
from .airflow_kinds import CaseAir, FlownAir, Realisations, airflow_kinds
from .airflow_table import Airflow

if TYPE_CHECKING:
    from ..field import FlowField


# -- The kinds of airflow that nobody has to solve ---------------------------------------------------------------------
@airflow_kinds.register("none")
class NoAir(FlownAir):
    """No air: granules fly in a vacuum."""

    means = "left out, granules fly in parabolas from impact to impact"
    at_once = True
    key = "vacuum"

    def make_field(self) -> FlowField:
        raise SceneError("the granules fly in a vacuum: there is no airflow")

    def make_numbers(self) -> Airflow:
        raise SceneError("the granules fly in a vacuum: there is no airflow to tell of")

    @property
    def realisations(self) -> Realisations:
        return Realisations(None)


@airflow_kinds.register("analytic")
class AnalyticAir(FlownAir):
    """The air of a channel without bodies, or at rest; made in no time, so not kept."""

    means = "known everywhere, nothing is solved"
    at_once = True

    @property
    def key(self) -> str:
        air, channel = self.scene.air, self.scene.channel
        about = (repr(air), channel.width, channel.top, channel.bottom, self.plan.airflow.turbulence)
        return content_key("duct", about, code_of("air.kinds.analytic"))

    def make_field(self) -> FlowField:
        from .analytic import duct_field

        return duct_field(self.scene, turbulent=self.plan.airflow.turbulence == "decaying")

    def make_numbers(self) -> Airflow:
        from .analytic import duct_airflow

        return duct_airflow(self.scene, self.plan.airflow.turbulence)

    @property
    def unknown(self) -> tuple[str, ...]:
        return ("airflow-model",)  # nothing is solved; how far a real duct's air is from it nobody says


class JetAir(AnalyticAir):
    """The air at rest ``bare`` with the jet in it that the ``force`` of granules drives, gathered when it is called."""

    def __init__(self, bare: FlownAir, force: Callable[[], ForceDensity]) -> None:
        super().__init__(bare.scene, bare.plan, bare.cache)
        self.bare, self.force = bare, force

    @property
    def key(self) -> str:
        feed = self.scene.feed
        curtain = self.scene.level, feed.position, feed.width, repr(feed.profile)
        return content_key("jet", self.bare.key, curtain, self.force().digest, code_of("air.kinds.analytic"))

    def make_field(self) -> FlowField:
        from .analytic import jet_field

        return jet_field(self.scene, self.force())

    def make_numbers(self) -> Airflow:
        from .analytic import jet_of

        flux = jet_of(self.scene, self.force()).flux
        return replace(super().make_numbers(), verdict="driven", flow_rate=float(flux[-1]))


# -- The kind of airflow that the user brings --------------------------------------------------------------------------
@airflow_kinds.register("given")
class GivenAir(CaseAir):
    """A solved OpenFOAM case of the user's: it is measured, not solved."""

    means = "a solved case of yours"

    @property
    def case(self) -> Path:
        return Path(self.scene.airstream.case)

    @property
    def half(self) -> bool:
        return bool(self.measured.half)

    def make_solution(self) -> tuple[str, Path]:
        """Key and folder of what was measured on the case. Its files are in the key: a new solution counts."""
        from ..foam.user_case import case_files, measure_given

        time = self.scene.airstream.time or "latest"
        files = digest_files(case_files(self.case, time))
        key = content_key("given", repr(self.flow_spec), time, files, code_of("air.foam.user_case"))

        def work(part: Path) -> None:
            self.cache.tell("airflow", f"measuring {self.case}")
            (part / "case").mkdir(exist_ok=True)
            save(part / "case" / "airflow.json", measure_given(self.flow_spec, self.case, time))

        return key, self.cache.make("airflow", key, work)

    @property
    def mesh_quality(self) -> MeshReport:
        return MeshReport(cells=self.measured.cells)

    @property
    def model_is_unknown(self) -> bool:
        return True
