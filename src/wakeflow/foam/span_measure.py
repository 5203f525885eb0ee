"""What an airflow in three dimensions amounts to: means over time and span, and the proof that it has three."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..core.number import Number
from .airflow_result import AirflowResult, SpanwiseMotion
from .case import FlowSpec, axis_points
from .history import CD, CL, read_table
from .measure import Coefficients, averaged, mean_pressure, on_edges, y_plus
from .read import Snapshot, nodes_of, time_folders
from .reconstruction import PlaneMesh, triangulate
from .span_means import SpanMeans, axis_profile, span_means
from .span_record import SpanRecord, apart, lead_of
from .statistics import evaluate
from .suction import suction_zone

Array = NDArray[np.float64]
# Rms of the spanwise velocity in the near wake over the inlet speed below which the wake counts as plane: wakes that
# broke up have 0.2 to 0.3, the one that stayed plane had 3e-4. Chosen between, nearer to the former.
PLANE_BELOW = 0.05
QUARTERS = 4
FADING = 0.5  # of the first quarter's: three-dimensional motion that falls so far is dying


def history_of(spec: FlowSpec, deep: Path) -> Array:
    """Rows (n, 4) of the run in ``deep``: time (s), Cd, Cl, base pressure coefficient, its mean over the span."""
    forces = read_table(deep, "forceCoefficients", (CD, CL))
    places = _columns(deep, "basePressure")
    base, inlet = read_table(deep, "basePressure", tuple(range(1, places))), read_table(deep, "inletPressure", (1,))
    above = np.interp(forces[:, 0], base[:, 0], base[:, 1:].mean(axis=1))
    above -= np.interp(forces[:, 0], inlet[:, 0], inlet[:, 1])
    return np.column_stack([forces, above / (0.5 * spec.speed**2)])


def _columns(case: Path, what: str) -> int:
    """How many columns a function's table has, its time included."""
    path = next(iter(sorted((case / "postProcessing" / what).glob("*/*"))))
    line = next(line for line in path.read_text().splitlines() if line.strip() and not line.lstrip().startswith("#"))
    return len(line.split())


@dataclass(frozen=True, eq=False)
class _Wake:
    """The plane mean wake as fields."""

    shot: Snapshot
    points: Array
    triangles: NDArray[np.intp]
    cp: Array
    velocity: Array


def measure_span(
    spec: FlowSpec, record: SpanRecord, deep: Path, begin: float | None = None, *, seconds: float = 0.0
) -> AirflowResult:
    """The airflow of the run in ``deep`` whose snapshots are ``record``, from ``begin`` (s; default: after the
    start-up) on. ``seconds`` of wall time are passed on.

    Raises FoamError for a run that has not come so far.
    """
    if begin is None:
        begin = known(spec.span).start_up * spec.convective_time
    rows = history_of(spec, deep)
    late = rows[rows[:, 0] >= begin]
    means = span_means(spec, record, begin)
    wake, plane = _plane_wake(spec, record, means), record.plane.mesh.plane
    body = record.plane.wall & plane.on(*(name for name in plane.patches if name.startswith("body_")))
    edges = plane.faces[body]
    flow_rate, lost = _balance(record, deep)
    history = _coefficients(spec, late)
    step, lead = float(np.diff(means.times).mean()), lead_of(spec, means.times)
    return AirflowResult(
        stepping="time-resolved",
        verdict="broadband",
        turbulence=spec.turbulence,
        cells=record.order.size,
        reynolds=spec.reynolds,
        cd=history.cd,
        cl_rms=history.cl_rms,
        strouhal=history.strouhal,
        cp_base=history.cp_base,
        flow_rate=flow_rate,
        mass_error=lost,
        suction=suction_zone(spec, wake.points, wake.triangles, wake.cp, wake.velocity, np.unique(edges)),
        y_plus=y_plus(spec, record.plane, deep, wake.shot, body),
        steps=len(rows),
        seconds=seconds,
        field_time="all",
        period=(len(means.times) - lead) * step,
        statistics=history.statistics,
        notes=(*history.notes, *_proof_notes(spec, means)),
        span=_spanwise(spec, record, means),
        **_pressures(spec, plane, wake, edges),
    )


def _plane_wake(spec: FlowSpec, record: SpanRecord, means: SpanMeans) -> _Wake:
    plane, latest, shot = record.plane.mesh.plane, record.plane.folder("latest"), record.snapshot(means.mean)
    nodes = nodes_of(record.plane, latest, [shot]).mean()
    cp = (nodes.pressure - mean_pressure(plane, [shot], plane.on("inlet"))) / (0.5 * spec.speed**2)
    return _Wake(shot, plane.points, triangulate(plane.points, plane.cells), cp, nodes.velocity)


def _pressures(spec: FlowSpec, plane: PlaneMesh, wake: _Wake, body: NDArray[np.intp]) -> dict[str, Any]:
    """By their names in AirflowResult; ``body``: its edges (e, 2)."""
    at_inlet, at_outlet = (mean_pressure(plane, [wake.shot], plane.on(patch)) for patch in ("inlet", "outlet"))
    middle, front, _ = axis_points(spec)
    return {
        "cp_front": on_edges(wake.points, body, wake.cp, np.array([middle, front * spec.along])),
        "p_inlet": spec.density * at_inlet,
        "pressure_drop": spec.density * (at_inlet - at_outlet),
    }


def _coefficients(spec: FlowSpec, late: Array) -> Coefficients:
    """Coefficients with their intervals from the history after the start-up."""
    found = evaluate(late, spec.accuracy)
    if found is not None:
        return averaged(spec, found)
    drag, lift, base = (_range(late, column) for column in (1, 2, 3))
    rms = float(np.sqrt(_mean(late[:, 0], (late[:, 2] - lift.value) ** 2)))
    note = f"the airflow shed too few vortices in {np.ptp(late[:, 0]):.3g} s for intervals: they are ranges"
    return Coefficients(drag, Number(rms, 0.0, float(np.ptp(late[:, 2]))), base, None, notes=[note])


def _mean(time: Array, values: Array) -> float:
    return float(np.trapezoid(values, time) / np.ptp(time))


def _range(late: Array, column: int) -> Number:
    values = late[:, column]
    return Number(_mean(late[:, 0], values), float(values.min()), float(values.max()))


def _balance(record: SpanRecord, deep: Path) -> tuple[float, float]:
    """Inflow (m2/s) and (inflow - outflow)/inflow from the conserved flux of the run's last state."""
    from foamlib import FoamFieldFile

    flux = FoamFieldFile(time_folders(deep)[-1] / "phi").boundary_field
    patches = [name for name in record.plane.mesh.plane.patches if name.startswith("inlet")]
    inflow = -sum(float(np.sum(np.asarray(flux[patch]["value"], dtype=float))) for patch in patches)
    outflow = float(np.sum(np.asarray(flux["outlet"]["value"], dtype=float)))
    return inflow / record.depth, (inflow - outflow) / inflow


def _proof_notes(spec: FlowSpec, means: SpanMeans) -> list[str]:
    """What a reader must know where the flow is hardly three-dimensional, or stops being so."""
    spanwise = means.three_dimensional[0] / spec.speed
    parts = [part / spec.speed for part, _ in means.parts(QUARTERS)]
    if spanwise < PLANE_BELOW:
        return [
            f"the wake stayed plane (spanwise rms {spanwise:.2g} of the air speed): this is a two-dimensional run at "
            "the price of a three-dimensional one; use a finer mesh or a longer span"
        ]
    if parts[-1] < FADING * parts[0]:
        return [
            f"the three-dimensional motion is dying (spanwise rms {parts[0]:.2g} of the air speed in the first quarter "
            f"of the record, {parts[-1]:.2g} in the last): the means are of no steady state; record more sheddings"
        ]
    return []


def _spanwise(spec: FlowSpec, record: SpanRecord, means: SpanMeans) -> SpanwiseMotion:
    """How long and deep it was looked at, what moves along it, and the profiles on the axis."""
    width, speed = spec.mesh.projected_width, spec.speed
    spanwise, other = means.three_dimensional
    return SpanwiseMotion(
        depth=record.depth,
        layers=len(record.order),
        recorded=float(np.ptp(means.times)),
        snapshots=len(means.times),
        w_rms=spanwise / speed,
        uv_rms=other / speed,
        quarters=tuple(part / speed for part, _ in means.parts(QUARTERS)),
        integral_lengths=tuple(means.integral_lengths),
        flown=tuple(apart(record, width, means.integral_lengths[1])),
        axis=axis_profile(spec, record, means),
    )
