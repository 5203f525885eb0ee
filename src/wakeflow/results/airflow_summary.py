"""What is known of an airflow: the ``airflow`` table of result.json, read from what the solver's stage wrote."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..core.record import Partial, column, from_json
from ..pipeline.pipeline import Pipeline
from .measured import Measured

__all__ = [
    "AirLoadingSummary",
    "Airflow",
    "AxisProfiles",
    "BestEstimate",
    "CheckMesh",
    "FieldDivergence",
    "FieldTruncation",
    "GridStudy",
    "MeshMotionSummary",
    "MomentumModel",
    "RunStatistics",
    "SolverAttempt",
    "SpanwiseMotion",
    "SuctionZone",
    "WakeEnd",
    "WakeEnds",
    "WakeNumber",
    "airflow_of",
    "with_mesh_error",
    "with_residence",
]

SPANNED = 0.99  # channel widths: a suction zone as wide as this reaches both walls, but for a cell at each


@dataclass(frozen=True)
class SuctionZone(Partial):
    """The suction zone behind the first body: Cp below the threshold, connected to the body."""

    threshold: float | None = column("1", "the pressure coefficient below which air counts", default=None)
    cp_min: float | None = column("1", "lowest pressure coefficient in it", default=None)
    length: float | None = column("m", "along the air, from the body's rear-most point", default=None)
    width: float | None = column("m", "across the air", default=None)
    area: float | None = column("m2", "of both sides together", default=None)
    reversal_length: float | None = column(
        "m", "how far behind the body the mean air on its axis runs backwards", default=None
    )

    def spans(self, channel: float) -> bool:
        """Whether it reaches both walls of a channel so wide (m), but for a cell at each."""
        return self.width is not None and self.width > SPANNED * channel


@dataclass(frozen=True)
class MeshMotionSummary:
    """How the mesh moves where the body vibrates in the air: amplitude sin(omega t + phase)."""

    amplitude: tuple[float, ...] = column("m", "x and y")
    omega: float = column("rad/s", "angular frequency")
    phase: float = column("rad", "at the start of the stored loop")


@dataclass(frozen=True)
class SolverAttempt:
    """A solution that failed before the settings that served were found."""

    settings: str = column("", "the settings it was tried with")
    cause: str = column("", "why it failed, in a word")
    message: str = column("", "why it failed, in a line")


@dataclass(frozen=True)
class CheckMesh(Partial):
    """What OpenFOAM's checkMesh says of the cells."""

    non_orthogonality: float | None = column("deg", "largest non-orthogonality", default=None)
    mean_non_orthogonality: float | None = column("deg", "mean non-orthogonality", default=None)
    skewness: float | None = column("1", "largest skewness", default=None)


@dataclass(frozen=True)
class RunStatistics(Partial):
    """What the averages of a time-resolved run rest on."""

    periods: int | None = column("1", "whole shedding periods averaged", default=None)
    start_up: float | None = column("s", "time dropped at the beginning", default=None)
    accuracy: float | None = column("1", "relative half width of the intervals that was asked for", default=None)
    excess: float | None = column("1", "largest half width over the one asked for", default=None)


@dataclass(frozen=True)
class GridStudy:
    """A quantity of the airflow on several grids, and what they say about the error of the mesh."""

    quantity: str = column("", "cd, cp_base or reversal_length (m)")
    cells: tuple[int, ...] = column("1", "mesh cells of every grid, the answer's first")
    values: tuple[float, ...] = column("as the quantity", "what each grid gave")
    value: float = column("as the quantity", "the finest grid's")
    low: float = column("as the quantity", "lower end of the interval: mesh error and statistical error")
    high: float = column("as the quantity", "upper end of the interval")
    order: float | None = column("1", "observed order of convergence; null where none was")
    kind: str = column("", "richardson, two-grid, range-oscillating or range-statistics")
    why: str = column("", "the kind in words")
    extrapolated: float | None = column("as the quantity", "to cells of no size")
    gci_fine: float | None = column("as the quantity", "half band between the two finest grids")
    gci_coarse: float | None = column("as the quantity", "half band between the second and the third grid")
    asymptotic: float | None = column("1", "near 1 in the asymptotic range")
    noise: float | None = column(
        "as the quantity", "of half the interval: by statistics alone, were the grids alike", absent=True, default=None
    )


@dataclass(frozen=True)
class MomentumModel:
    """The paper's momentum model of the first body, for comparison."""

    cp_front: float = column("1", "pressure coefficient, mean over the front")
    cd: float = column("1", "drag coefficient, with the computed base pressure")


@dataclass(frozen=True)
class FieldDivergence:
    """How well the field that the tracker reads conserves volume: |div u| h / U over its triangles."""

    rms: float = column("1", "root mean square")
    max: float = column("1", "largest")


@dataclass(frozen=True)
class FieldTruncation:
    """What a time-resolved field lost when it was stored as a mean and modes."""

    modes: int = column("1", "modes kept")
    knots: int = column("1", "knots of the splines in time")
    snapshots: int = column("1", "of the loop that was stored")
    velocity: float = column("1", "velocity cut off: rms over the rms of its fluctuation")
    velocity_max: float = column("1", "largest velocity cut off, over the rms speed of the field")
    pressure: float = column("1", "pressure cut off: rms over the rms of its fluctuation")
    k: float = column("1", "turbulent kinetic energy cut off: rms over its rms")
    dissipation: float = column("1", "its dissipation cut off: rms over its rms")


@dataclass(frozen=True)
class WakeNumber:
    """A number that says how much of the time-resolved wake is taken, and the range that holds it."""

    value: float = column("1", "the number")
    low: float = column("1", "lower end of its range")
    high: float = column("1", "upper end of its range")


@dataclass(frozen=True)
class BestEstimate:
    """How much of the time-resolved wake the air is made of that granules are flown in; the rest is the steady one."""

    theta: WakeNumber = column("", "share of the time-resolved mean")
    strength: WakeNumber = column("", "rms of the fluctuation over that of the time-resolved wake")
    why: str = column("", "what they rest on")


@dataclass(frozen=True)
class WakeEnd(Partial):
    """What one of the two ends alone has."""

    cd: Measured | None = column("1", "drag coefficient of all bodies on the first one's width", default=None)
    cl_rms: Measured | None = column("1", "lift coefficient, root mean square", default=None)
    cp_base: Measured | None = column("1", "base pressure coefficient, behind the first body", default=None)
    suction: SuctionZone | None = column("", "the suction zone behind the first body", default=None)
    residence_time: Measured | None = column("1", "of fine dust in the near wake, times U / D", default=None)


@dataclass(frozen=True)
class WakeEnds:
    """The two ends between which a best estimate lies."""

    steady: WakeEnd = column("", "the steady wake")
    time_resolved: WakeEnd = column("", "the wake in time, in two dimensions")


@dataclass(frozen=True)
class AxisProfiles:
    """The mean wake behind the first body on its axis, rms values of what is resolved beside what is modelled."""

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
    """Of an airflow in three dimensions: what moves along its span, in the near wake."""

    depth: float = column("m", "of the periodic span")
    layers: int = column("1", "layers of cells over it")
    recorded: float = column("s", "time that means and fields rest on")
    snapshots: int = column("1", "of all layers in that time")
    w_rms: float = column("air speeds", "rms of the velocity along the span")
    uv_rms: float = column("air speeds", "rms of the other components about their mean over the span")
    quarters: tuple[float, ...] = column("air speeds", "w_rms in each quarter of the time: growing or dying")
    integral_lengths: tuple[float, ...] = column("m", "along the span: of the velocity across, along the air, spanwise")
    flown: tuple[int, ...] = column("1", "the layers that granules are flown in, each a plane airflow")
    axis: AxisProfiles = column("", "on the body's axis")


@dataclass(frozen=True)
class AirLoadingSummary(Partial):
    """The granules' force on the air, and what it makes of the steady airflow."""

    passes: int | None = column("1", "solutions of the steady airflow under the force", default=None)
    change: float | None = column("1", "largest change of a share in the steady airflow by the last pass", default=None)
    force: tuple[float, ...] | None = column(
        "N/m", "x and y, of all granules on the air of the last pass, per metre of depth", default=None
    )
    given: float | None = column("N/m", "y, given to the air of the last pass", default=None)
    imbalance: float | None = column("1", "force less what the granules lost, over the latter", default=None)
    unanswered: float | None = column(
        "1", "force that the air of the last pass should be given less what it was given, over that", default=None
    )
    cd_without: Measured | None = column("1", "drag coefficient of the steady airflow without the force", default=None)
    cd: Measured | None = column("1", "drag coefficient of the steady airflow with it", default=None)
    verdict: str | None = column("", "of the steady airflow with it", default=None)
    cells: int | None = column("1", "mesh cells that feel a force", default=None)
    sources: int | None = column("1", "sources in OpenFOAM's momentum equation", default=None)


@dataclass(frozen=True)
class Airflow(Partial):
    """What was measured on the airflow, or is known of it. Which keys are told depends on the kind of airflow."""

    rung: str = column("", "analytic, draft, standard, reference, 3d or given", default="")
    stepping: str | None = column("", "steady, time-resolved or given", default=None)
    verdict: str = column("", "steady, periodic, broadband, given, or the profile of air that is known", default="")
    turbulence: str | None = column("", "turbulence model", default=None)
    cells: int | None = column("1", "mesh cells", default=None)
    reynolds: float | None = column("1", "Reynolds number on the first body's width, inlet's speed", default=None)
    cd: Measured | None = column("1", "drag coefficient of all bodies on the first one's width", default=None)
    cl_rms: Measured | None = column("1", "lift coefficient, root mean square", default=None)
    strouhal: Measured | None = column("1", "Strouhal number of the shedding; null when steady", default=None)
    cp_base: Measured | None = column("1", "base pressure coefficient, behind the first body", default=None)
    cp_front: float | None = column("1", "pressure coefficient at the first body's front", default=None)
    p_inlet: float | None = column("Pa", "mean static pressure on the inlet", default=None)
    pressure_drop: float | None = column("Pa", "inlet less outlet", default=None)
    flow_rate: float | None = column("m2/s", "air flow of the whole channel, per metre of depth", default=None)
    mass_error: float | None = column("1", "inflow less outflow, over inflow", default=None)
    suction: SuctionZone | None = column("", "the suction zone behind the first body", default=None)
    y_plus: tuple[float, ...] | None = column("1", "least and largest y+ of the cells at the bodies", default=None)
    steps: int | None = column("1", "iterations or time steps of the solver", default=None)
    seconds: float | None = column("s", "wall time of the solver", default=None)
    field_time: str | None = column("", "what the tracker reads: latest, mean, all or states", default=None)
    period: float | None = column("s", "length of the stored loop; null when steady", default=None)
    motion: MeshMotionSummary | None = column("", "of the mesh; null where it rests", default=None)
    loop_mismatch: float | None = column(
        "1", "rms velocity jump where the loop joins over rms fluctuation", default=None
    )
    residuals: dict[str, float] | None = column("1", "last residual of every equation", default=None)
    mesh: CheckMesh | None = column("", "how good the cells are", default=None)
    statistics: RunStatistics | None = column("", "of a time-resolved run", default=None)
    notes: tuple[str, ...] | None = column("", "what a reader must know of the solution", default=None)
    cd_of: dict[str, float] | None = column("1", "each body's part of cd, where several stand", default=None)
    settings: str | None = column("", "the solver's settings that served", default=None)
    attempts: tuple[SolverAttempt, ...] | None = column("", "solutions that failed before", default=None)
    checks: dict[str, float] | None = column("1", "share of every sanity limit that is taken up", default=None)
    span: SpanwiseMotion | None = column("", "of an airflow in three dimensions; null in the plane", default=None)
    half: bool | None = column("", "whether a given case is the right half of the channel", default=None)
    grids: tuple[GridStudy, ...] | None = column("", "quantities on several grids; null with one", default=None)
    residence_time: Measured | None = column("1", "of fine dust in the near wake, times U / D", default=None)
    wake: BestEstimate | None = column("", "how the air lies between its ends; null where it is one", default=None)
    ends: WakeEnds | None = column("", "what each end alone has; null where there are none", default=None)
    momentum: MomentumModel | None = column("", "the paper's model; null without a body", default=None)
    loading: AirLoadingSummary | None = column(
        "", "what the granules change of the steady airflow; null where the air does not feel them", default=None
    )
    divergence: FieldDivergence | None = column("", "of the field that the tracker reads", default=None)
    truncation: FieldTruncation | None = column("", "of a time-resolved field; null for a steady one", default=None)

    @classmethod
    def read(cls, table: dict[str, Any]) -> Airflow:
        """The airflow that a stage of the pipeline wrote down as ``table``."""
        return from_json(cls, table, "airflow.json")


def with_mesh_error(airflow: Airflow, studies: Sequence[GridStudy]) -> Airflow:
    """The airflow with the mesh's part in the intervals of what several grids were compared in. A best estimate keeps
    its own: its grids are those of one end.
    """
    found = {study.quantity: study for study in studies if airflow.ends is None}
    return airflow.extended(
        cd=_on_meshes(airflow.cd, found.get("cd")), cp_base=_on_meshes(airflow.cp_base, found.get("cp_base"))
    )


def _on_meshes(number: Measured | None, study: GridStudy | None) -> Measured | None:
    """A number with the wider of its own interval and that of a comparison of grids, which holds it."""
    if number is None or study is None:
        return number
    low, high = (study.low if number.low is None else number.low), (study.high if number.high is None else number.high)
    return replace(number, low=min(low, study.low), high=max(high, study.high))


def with_residence(airflow: Airflow, found: dict[str, Any] | None) -> Airflow:
    """The airflow with the near wakes' residence times, ``found`` by ``AirflowKind.residence``; as it is without."""
    if found is None:
        return airflow
    times = {which: from_json(Measured, row, "residence.json") for which, row in found.items()}
    answered = airflow.extended(residence_time=times["answer"])
    if airflow.ends is None:
        return answered
    ends = WakeEnds(
        airflow.ends.steady.extended(residence_time=times["steady"]),
        airflow.ends.time_resolved.extended(residence_time=times["time_resolved"]),
    )
    return replace(answered, ends=ends)


def airflow_of(pipeline: Pipeline) -> Airflow:
    """What is known of a pipeline's airflow; it is solved where it is not yet."""
    return Airflow.read(pipeline.airflow)
