"""What is known of an airflow: the ``airflow`` table of result.json. The solver's stage begins it, others end it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from ...core.errors import SceneError
from ...core.number import NO_NUMBER, Known, Measured, Number
from ...core.record import Null, column
from ...laws.best_estimate import NO_ESTIMATE, WakeEstimate
from ...laws.momentum import Momentum, momentum_pressure
from ...laws.operating_point import FanPoint
from ...scene.fan_speed import fan_point
from ..field.modes import KEPT_WHOLE, Truncation
from ..foam.airflow_result import NO_SUCTION, AirflowResult, SuctionZone
from ..mesh.spec import MeshReport as MeshReport  # handed on

if TYPE_CHECKING:
    from ...scene import Scene


@dataclass(frozen=True, kw_only=True)
class GridEstimate(Number):
    """A number with its mesh error: the finest grid's value, and round it the grid convergence index, or a multiple of
    the grids' range, the statistical interval added in quadrature; of "range-statistics" the range of all grids with
    their statistical intervals.
    """

    order: Known = column("1", "observed order of convergence; null where none was")
    kind: str = column("", "richardson, two-grid, range-oscillating or range-statistics")
    why: str = column("", "the kind in words")
    extrapolated: Known = column("as the quantity", "value at cells of no size", default=math.nan)
    gci_fine: Known = column("as the quantity", "half band between the two finest grids", default=math.nan)
    gci_coarse: Known = column("as the quantity", "half band between the second and the third grid", default=math.nan)
    asymptotic: Known = column(
        "1", "gci_coarse / (r21^p gci_fine), near 1 in the asymptotic range; p the order, at most the formal one",
        default=math.nan,
    )  # fmt: skip
    noise: float = column(
        "as the quantity", "part of half the interval: by statistics alone, were the grids alike", default=0.0
    )


@dataclass(frozen=True, kw_only=True)
class GridStudy(GridEstimate):
    """A quantity of the airflow on several grids, and what they say about the error of the mesh."""

    quantity: str = column("", "cd, cp_base or reversal_length (m)")
    cells: tuple[int, ...] = column("1", "mesh cells of every grid, the answer's first")
    values: tuple[float, ...] = column("as the quantity", "what each grid gave")


@dataclass(frozen=True)
class FieldDivergence:
    """How well the field that the tracker reads conserves volume: |div u| h / U over its triangles."""

    rms: float = column("1", "root mean square")
    max: float = column("1", "largest")


@dataclass(frozen=True)
class MomentumModel:
    """The paper's momentum model of the first body, for comparison."""

    cp_front: float = column("1", "pressure coefficient, mean over the front")
    cd: float = column("1", "drag coefficient, with the computed base pressure")

    def __bool__(self) -> bool:
        """Whether there is a body, and its base pressure."""
        return not math.isnan(self.cd)


NO_MOMENTUM = MomentumModel(math.nan, math.nan)


@dataclass(frozen=True)
class WakeEnd:
    """What one of the two ends alone has."""

    cd: Number = column("1", "drag coefficient of all bodies on the first one's width")
    cl_rms: Number = column("1", "lift coefficient, root mean square")
    cp_base: Number = column("1", "base pressure coefficient, behind the first body")
    suction: SuctionZone = column("", "the suction zone behind the first body")


@dataclass(frozen=True)
class WakeEnds:
    """The two ends between which a best estimate lies."""

    steady: WakeEnd = column("", "the steady wake")
    time_resolved: WakeEnd = column("", "the wake in time, in two dimensions")

    def __bool__(self) -> bool:
        """Whether there are two."""
        return bool(self.steady.cd)


NO_ENDS = WakeEnds(*[WakeEnd(NO_NUMBER, NO_NUMBER, NO_NUMBER, NO_SUCTION)] * 2)


@dataclass(frozen=True)
class FanSummary:
    """Where the fan's curve meets the machine's pressure drop, the channel's as the airflow has it."""

    point: FanPoint = column("", "point at the speed that the air was computed at")
    channel: float = column("Pa", "drop of the channel, as computed at that speed")
    meets: Known = column("m/s", "speed at which the curves meet by that drop; null where they do not")

    @property
    def off(self) -> float:
        """How far (m/s) the air's speed is from the one at which the curves meet."""
        return math.inf if math.isnan(self.meets) else abs(self.meets - self.point.speed.value)


@dataclass(frozen=True)
class AirLoadingSummary:
    """The granules' force on the air, and what it makes of the steady airflow, in which it is gathered."""

    passes: int = column("1", "solutions of the steady airflow under the force; the last by granules that meet, if any")
    change: float = column("1", "largest change of a share in the steady airflow by the last pass")
    force: tuple[float, ...] = column("N/m", "force x, y of all granules on air of the last pass, per metre of depth")
    given: float = column("N/m", "force, y, given to the air of the last pass")
    imbalance: float = column("1", "force less what the granules lost, over the latter")
    unanswered: float = column(
        "1", "how far the force gathered in the air of the last pass is from what that air was given, over the former"
    )
    sampling: float = column(
        "1", "half of the 95 % interval of the force by the granules that it is gathered from, over the force"
    )
    cd_without: Measured = column(
        "1", "drag coefficient of the steady airflow without the force; null without a body", default=NO_NUMBER
    )
    cd: Measured = column("1", "drag coefficient of the steady airflow with it; null without a body", default=NO_NUMBER)
    verdict: str = column("", "kind of the steady airflow with it; driven where nothing else moves the air", default="")
    cells: int = column("1", "mesh cells that feel a force; 0 where nothing is meshed", default=0)
    sources: int = column("1", "sources in OpenFOAM's momentum equation; 0 where it is not solved", default=0)
    speed: float = column(
        "m/s", "largest speed of air that the granules alone drive; left out where other air is moved", absent=True,
        default=math.nan,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Airflow(AirflowResult):
    """What was measured on the airflow, or is known of it; null where nothing is."""

    rung: str = column("", "analytic, draft, standard, reference, 3d or given", default="")
    grids: Annotated[tuple[GridStudy, ...], Null(())] = column(
        "", "quantities on several grids; null with one", default=()
    )
    wake: Annotated[WakeEstimate, Null(NO_ESTIMATE)] = column(
        "", "how the air lies between its ends; null where it is one", default=NO_ESTIMATE
    )
    ends: Annotated[WakeEnds, Null(NO_ENDS)] = column(
        "", "what each end alone has; null where there are none", default=NO_ENDS
    )
    momentum: Annotated[MomentumModel, Null(NO_MOMENTUM)] = column(
        "", "the paper's model; null without a body", default=NO_MOMENTUM
    )
    fan: FanSummary | None = column("", "left out without a fan", absent=True, default=None)
    loading: AirLoadingSummary | None = column(
        "", "the granules' force that it is solved under; null where the air does not feel them", default=None
    )
    divergence: FieldDivergence | None = column("", "divergence of the field that the tracker reads", default=None)
    truncation: Annotated[Truncation, Null(KEPT_WHOLE)] = column(
        "", "loss of a time-resolved field; null for a steady one", default=KEPT_WHOLE
    )

    @property
    def safer_settings(self) -> str:
        """A line that says which safer settings solved the airflow, and why; empty where the usual ones did."""
        from ..foam.airflow import warning

        return warning(self.settings or "normal", self.attempts or ())

    def loss(self, scene: Scene, *, loaded: bool) -> float:
        """The channel's loss coefficient on the mean speed of the air of a ``scene`` with a fan; where the air is
        ``loaded``, feels the granules, the weight that it bears is taken off as the scene estimates it.
        """
        air = scene.airstream
        borne = air.point.feed if loaded and air.point is not None else 0.0
        return max(0.0, self.pressure_drop - borne) / (0.5 * air.density * air.speed**2)

    def by_fan(self, scene: Scene, *, loaded: bool) -> FanSummary | None:
        """Where the scene's fan has the air by the drop that was computed; None without a fan, and without a drop."""
        air = scene.air
        if air is None or air.fan is None or air.point is None or math.isnan(self.pressure_drop):
            return None
        fan = air.fan.model_copy(update={"channel_loss": self.loss(scene, loaded=loaded)} if scene.body else {})
        try:
            meets = fan_point(scene, fan).speed.value
        except SceneError:  # so large a drop that the fan moves nothing
            meets = math.nan
        return FanSummary(air.point, self.pressure_drop, meets)

    def by_momentum(self, scene: Scene) -> MomentumModel:
        """The paper's momentum model of the first body, for comparison: pressure on its front, and Cd with the computed
        base pressure; empty without one of both.
        """
        if not scene.body or not self.cp_base:
            return NO_MOMENTUM
        model = momentum_of(scene)
        return MomentumModel(model.front, model.drag(self.cp_base.value))


def momentum_of(scene: Scene) -> Momentum:
    """The paper's momentum model of the first body."""
    return momentum_pressure(scene.outline, scene.airstream.direction)
