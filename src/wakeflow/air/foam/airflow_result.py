"""The numbers of one airflow, as its solver's stage keeps them in airflow.json."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ...core.number import NO_NUMBER, Count, Known, Measured
from ...core.record import Null, column

SPANNED = 0.99  # channel widths: a suction zone as wide as this reaches both walls, but for a cell at each


@dataclass(frozen=True)
class SuctionZone:
    """The suction zone behind the first body: Cp below the threshold, downstream of its widest place, connected to it.
    Both sides count.
    """

    threshold: float = column("1", "the pressure coefficient below which air counts")
    cp_min: float = column("1", "lowest pressure coefficient in it")
    length: float = column("m", "length along the air, from the body's rear-most point")
    width: float = column("m", "width across the air")
    area: float = column("m2", "area of both sides together")
    reversal_length: Known = column(
        "m", "how far behind the body the mean air on its axis runs backwards", default=math.nan
    )

    def __bool__(self) -> bool:
        """Whether there is a body, behind which it was measured."""
        return not math.isnan(self.threshold)

    def spans(self, channel: float) -> bool:
        """Whether it reaches both walls of a channel so wide (m), but for a cell at each."""
        return self.width > SPANNED * channel


@dataclass(frozen=True)
class MeshMotionSummary:
    """How the mesh moves where the body vibrates in the air: amplitude sin(omega t + phase). The stored field belongs
    to positions less that.
    """

    amplitude: tuple[float, ...] = column("m", "amplitude, x and y")
    omega: float = column("rad/s", "angular frequency")
    phase: float = column("rad", "phase at the start of the stored loop")

    def __bool__(self) -> bool:
        """Whether it moves."""
        return self.omega > 0.0


@dataclass(frozen=True)
class Attempt:
    """A solution that failed before the settings that served were found, see
    :mod:`wakeflow.air.foam.airflow`.
    """

    settings: str = column("", "the settings it was tried with")
    cause: str = column("", "why it failed, in a word")
    message: str = column("", "why it failed, in a line")


@dataclass(frozen=True)
class CheckMesh:
    """What OpenFOAM's checkMesh says of the cells."""

    non_orthogonality: float = column("deg", "largest non-orthogonality")
    mean_non_orthogonality: float = column("deg", "mean non-orthogonality")
    skewness: float = column("1", "largest skewness")

    def __bool__(self) -> bool:
        """Whether it was asked."""
        return not math.isnan(self.skewness)


@dataclass(frozen=True)
class RunStatistics:
    """What the averages of a time-resolved run rest on."""

    periods: int = column("1", "whole shedding periods averaged")
    start_up: float = column("s", "time dropped at the beginning")
    accuracy: float = column("1", "relative half width of the intervals that was asked for")
    excess: float = column("1", "largest half width over the one asked for")

    def __bool__(self) -> bool:
        """Whether there are any."""
        return self.periods > 0


@dataclass(frozen=True)
class AxisProfiles:
    """The mean wake behind the first body on its axis, rms values of what is resolved next to what is modelled."""

    behind: tuple[float, ...] = column("body widths", "places, from the body's rear")
    speed: tuple[float, ...] = column("air speeds", "mean velocity along the air")
    along: tuple[float, ...] = column("air speeds", "rms of the velocity along the air")
    across: tuple[float, ...] = column("air speeds", "rms of the velocity across it, in the picture")
    coherent: tuple[float, ...] = column(
        "air speeds", "rms over time of its mean over the span: what of it moves alike along the whole span"
    )
    spanwise: tuple[float, ...] = column("air speeds", "rms of the velocity along the span")
    modelled: tuple[float, ...] = column("air speeds", "what the model adds to each: sqrt(2k/3)")


@dataclass(frozen=True)
class SpanwiseMotion:
    """Motion along the span of an airflow in three dimensions, in the near wake."""

    depth: float = column("m", "depth of the periodic span")
    layers: int = column("1", "layers of cells over it")
    recorded: float = column("s", "time that means and fields rest on")
    snapshots: int = column("1", "snapshots of all layers in that time")
    w_rms: float = column("air speeds", "rms of the velocity along the span")
    uv_rms: float = column("air speeds", "rms of the other components about their mean over the span")
    quarters: tuple[float, ...] = column("air speeds", "w_rms in each quarter of the time: growing or dying")
    integral_lengths: tuple[float, ...] = column("m", "lengths along the span: of velocity across, along air, spanwise")
    flown: tuple[int, ...] = column("1", "the layers that granules are flown in, each a plane airflow")
    axis: AxisProfiles = column("", "profiles on the body's axis")

    def __bool__(self) -> bool:
        """Whether there is a span."""
        return self.layers > 0


# Where nothing is known
NO_SUCTION = SuctionZone(*[math.nan] * 5)
AT_REST = MeshMotionSummary((), 0.0, 0.0)
UNCHECKED = CheckMesh(*[math.nan] * 3)
NO_STATISTICS = RunStatistics(0, 0.0, 0.0, 0.0)
IN_PLANE = SpanwiseMotion(0.0, 0, 0.0, 0, 0.0, 0.0, (), (), (), AxisProfiles(*[()] * 7))
Text = Annotated[str, Null("")]
Shares = Annotated[dict[str, float], Null({})]


@dataclass(frozen=True, kw_only=True)
class AirflowResult:
    """What was measured on an airflow, or is known of it; null where nothing is.

    Coefficients use the inlet's mean speed and, for Cd and Cl, the first body's projected width; with several bodies Cd
    and Cl are of all of them together. Cp = (p - mean p on the inlet) / (rho U^2 / 2), p static: OpenFOAM's without
    2k/3, k being 0 at no-slip walls. ``cp_base`` and ``cp_front`` are taken where the vertical line through the middle
    of the first body meets its rear and its front.

    Intervals: of a steady run the range over its last iterations, of one that did not settle over those of its late
    states; of a time-resolved one 95 % intervals of the long-time mean (:mod:`wakeflow.air.foam.statistics`).

    Cd is OpenFOAM's forceCoeffs. Its pressure part uses OpenFOAM's p, which is right: at a wall k = 0, and p there is
    the static pressure (p, static pressure plus normal stress 2k/3, does not change across the layer next to it).
    """

    stepping: Text = column("", "steady, time-resolved or given", default="")
    verdict: str = column(
        "",
        "steady, periodic, broadband, given, driven (by granules alone), or the profile of air that is known",
        default="",
    )
    turbulence: Text = column("", "turbulence model", default="")
    cells: Count = column("1", "mesh cells", default=0)
    reynolds: Known = column("1", "Reynolds number on the first body's width, inlet's speed", default=math.nan)
    cd: Measured = column("1", "drag coefficient of all bodies on the first one's width", default=NO_NUMBER)
    cl_rms: Measured = column("1", "lift coefficient, root mean square", default=NO_NUMBER)
    strouhal: Measured = column("1", "Strouhal number f D / U of the shedding; null when steady", default=NO_NUMBER)
    cp_base: Measured = column("1", "base pressure coefficient, behind the first body", default=NO_NUMBER)
    cp_front: Known = column("1", "pressure coefficient at the first body's front", default=math.nan)
    p_inlet: Known = column("Pa", "mean static pressure on the inlet", default=math.nan)
    pressure_drop: Known = column("Pa", "mean pressure, inlet less outlet", default=math.nan)
    flow_rate: Known = column("m2/s", "air flow of the whole channel, per metre of depth", default=math.nan)
    mass_error: Known = column("1", "inflow less outflow, over inflow", default=math.nan)
    suction: Annotated[SuctionZone, Null(NO_SUCTION)] = column(
        "", "the suction zone behind the first body", default=NO_SUCTION
    )
    y_plus: Annotated[tuple[float, ...], Null(())] = column(
        "1", "least and largest y+ of the cells at the bodies", default=()
    )
    steps: Count = column("1", "iterations or time steps of the solver", default=0)
    seconds: Known = column("s", "wall time of the solver", default=math.nan)
    field_time: Text = column("", "what the tracker reads: latest, mean, all or states", default="")
    period: Known = column("s", "length of the stored loop; null when steady", default=math.nan)
    motion: Annotated[MeshMotionSummary, Null(AT_REST)] = column(
        "", "motion of the mesh; null where it rests", default=AT_REST
    )
    loop_mismatch: Known = column("1", "rms velocity jump where the loop joins over rms fluctuation", default=math.nan)
    residuals: Shares = column("1", "last residual of every equation", default=dict)
    mesh: Annotated[CheckMesh, Null(UNCHECKED)] = column("", "how good the cells are", default=UNCHECKED)
    statistics: Annotated[RunStatistics, Null(NO_STATISTICS)] = column(
        "", "averages of a time-resolved run", default=NO_STATISTICS
    )
    notes: tuple[str, ...] | None = column("", "what a reader must know of the solution", default=None)
    cd_of: dict[str, float] | None = column("1", "each body's part of cd, where there are several", default=None)
    settings: Text = column("", "the solver's settings that served", default="")
    attempts: tuple[Attempt, ...] | None = column("", "solutions that failed before", default=None)
    checks: Shares = column("1", "share of every sanity limit that is taken up", default=dict)
    span: Annotated[SpanwiseMotion, Null(IN_PLANE)] = column(
        "", "motion along the span in three dimensions; null in the plane", default=IN_PLANE
    )
    half: bool | None = column("", "whether a given case is the right half of the channel", default=None)
