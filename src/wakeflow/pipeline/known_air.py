"""The kinds of airflow that nobody has to solve: none, and that of a channel in which nothing stands."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..core.errors import SceneError
from ..core.store import content_key
from .airflow import Airflow
from .airflow_kinds import AirflowKind, airflow_kinds
from .cache import code_of

if TYPE_CHECKING:
    from ..field import FlowField

__all__ = ["AnalyticAir", "NoAir"]


@airflow_kinds.register("none")
class NoAir(AirflowKind):
    """No air: granules fly in a vacuum."""

    means = "left out, granules fly in parabolas from impact to impact"
    at_once = True

    def make_field(self) -> None:
        return None

    def make_table(self) -> Airflow:
        raise SceneError("the granules fly in a vacuum: there is no airflow to tell of")


@airflow_kinds.register("analytic")
class AnalyticAir(AirflowKind):
    """The air of a channel in which nothing stands; made in no time, so not kept."""

    means = "known everywhere, since nothing stands in it"
    at_once = True

    def make_field(self) -> tuple[str, FlowField]:
        from .analytic import duct_field

        air, channel, turbulence = self.scene.air, self.scene.channel, self.plan.airflow.turbulence
        asked = (repr(air), channel.width, channel.top, channel.bottom, turbulence)
        key = content_key("duct", asked, code_of("duct"))
        return key, duct_field(self.scene, turbulent=turbulence == "decaying")

    def make_table(self) -> Airflow:
        from .analytic import duct_airflow

        return replace(duct_airflow(self.scene), turbulence=self.plan.airflow.turbulence)

    def unknown_parts(self) -> tuple[str, ...]:
        return ("airflow-model",)  # nothing is solved; how far a real duct's air is from it nobody says
