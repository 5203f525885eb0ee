"""What an airflow in three dimensions amounts to: means over time and span, and the proof that it has three."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....core.errors import known
from ..airflow_result import AirflowResult, SpanwiseMotion
from ..case import FlowSpec
from ..force_history import Tail
from ..measure import coefficients_of, plane_numbers
from ..read import nodes_of, time_folders
from .span_means import SpanMeans, axis_profile, span_means
from .span_record import SpanRecord, apart, lead_of

# Rms of the spanwise velocity in the near wake over the inlet speed below which the wake counts as plane: wakes that
# broke up have 0.2 to 0.3, the one that stayed plane had 3e-4. Chosen between, nearer to the former.
PLANE_BELOW = 0.05
QUARTERS = 4
FADING = 0.5  # of the first quarter's: three-dimensional motion that falls so far is dying


def measure_span(
    spec: FlowSpec, record: SpanRecord, deep: Path, begin: float | None = None, *, seconds: float = 0.0
) -> AirflowResult:
    """The airflow of the run in ``deep`` whose snapshots are ``record``, from ``begin`` (s; default: after the
    start-up) on. ``seconds`` of wall time are passed on.

    Raises FoamError for a run that has not come so far.
    """
    if begin is None:
        begin = known(spec.span).start_up * spec.convective_time
    rows = Tail(deep).update()
    late = rows[rows[:, 0] >= begin]
    means = span_means(spec, record, begin)
    shot = record.snapshot(means.mean)
    nodes = nodes_of(record.plane, record.plane.folder("latest"), [shot]).mean()
    in_plane, _ = plane_numbers(spec, record.plane, deep, [shot], nodes.pressure, nodes.velocity)
    flow_rate, lost = _balance(record, deep)
    history = coefficients_of(spec, late, {"begin": begin})
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
        steps=len(rows),
        seconds=seconds,
        field_time="all",
        period=(len(means.times) - lead) * step,
        statistics=history.statistics,
        notes=(*history.notes, *_proof_notes(spec, means)),
        span=_spanwise(spec, record, means),
        **in_plane,
    )


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
