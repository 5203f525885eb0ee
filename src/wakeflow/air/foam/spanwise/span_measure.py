"""What an airflow in three dimensions amounts to: means over its span, and its numbers, by those of a plane one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.errors import FoamError
from ..airflow_result import AirflowResult, AxisProfiles, SpanwiseMotion
from ..case import SpanSpec, axis_points
from ..measure import AxisCrossings, Edges, in_time, plane_numbers
from ..read import mean_of, nodes_of, time_folders
from ..reconstruction import Reconstruction, triangulate
from ..statistics import Tail
from .span_record import K_AT, OMEGA_AT, SpanRecord, apart, des_dissipation, lead_of

Array = NDArray[np.float64]
NEAR_WAKE = (0.5, 4.0)  # widths behind the body, and
BESIDE = 1.0  # widths to each side of its middle: where the span's correlation is taken
PLACES = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)  # widths behind the body of the profiles


@dataclass(frozen=True, eq=False)
class SpanMeans:
    """Means over ``begin`` to ``end`` (s) and the span, at the m cells of the plane.

    ``mean`` (m, 6) as the record's columns; ``stresses`` (m, 3): variances of the three components of velocity (m2/s2);
    ``coherent`` (m,): variance over time of the span's mean of the velocity across the air (m2/s2), the part of its
    stress that moves alike along the whole span; ``dissipation`` (m,) of the modelled k. ``correlation``
    (l // 2 + 1, 3): of each component of velocity in the near wake with itself, 0, 1, 2 ... layers apart, its
    fluctuation about the mean over time. ``spread`` (t, 2): rms over the near wake of the spanwise velocity, and of the
    others about their mean over the span (m/s), at ``times`` (t,) s; ``spacing`` (m) of the layers.
    """

    begin: float
    end: float
    times: Array
    mean: Array
    stresses: Array
    coherent: Array
    dissipation: Array
    correlation: Array
    spread: Array
    spacing: float

    @property
    def three_dimensional(self) -> tuple[float, float]:
        """Rms over time of ``spread`` (m/s): of the spanwise velocity, of the others about their mean over the span."""
        spanwise, other = np.sqrt((self.spread**2).mean(axis=0))
        return float(spanwise), float(other)

    def parts(self, count: int = 4) -> list[tuple[float, float]]:
        """Rms as of ``three_dimensional`` in ``count`` equal parts of the time, in order: does it grow or decay."""
        pieces = np.array_split(self.spread, count)
        return [tuple(np.sqrt((piece**2).mean(axis=0)).tolist()) for piece in pieces]

    @property
    def integral_lengths(self) -> tuple[float, float, float]:
        """Integral (m) of each component's correlation over the distance up to its first zero, or half the span."""
        result = []
        for column in self.correlation.T:
            negative = np.flatnonzero(column <= 0)
            last = int(negative[0]) if len(negative) else len(column) - 1
            result.append(float(np.trapezoid(np.maximum(column[: last + 1], 0.0)) * self.spacing))
        return result[0], result[1], result[2]


def span_means(spec: SpanSpec, record: SpanRecord, begin: float) -> SpanMeans:
    """Means over the record's snapshots from ``begin`` (s) on. Raises FoamError where there are less than 2."""
    near = _near(spec, record)
    layers, cells = record.order.shape
    total, square = np.zeros((cells, 6)), np.zeros((cells, 3))
    together, dissipation = np.zeros(cells), np.zeros(cells)
    products = np.zeros((layers // 2 + 1, len(near), 3))
    local = np.zeros((len(near), 3))
    times, spread = [], []
    for time, values in record.since(begin):
        wide = values.astype(float)
        alike = wide.mean(axis=0)
        total += alike
        together += alike[:, 0] ** 2
        square += (wide[..., :3] ** 2).mean(axis=0)
        dissipation += des_dissipation(wide[..., K_AT], wide[..., OMEGA_AT], record.edge).mean(axis=0)
        chosen = wide[:, near, :3]
        local += chosen.mean(axis=0)
        for distance in range(len(products)):
            products[distance] += (chosen * np.roll(chosen, -distance, axis=0)).mean(axis=0)
        about = chosen[..., :2] - chosen[..., :2].mean(axis=0)
        spread.append(np.sqrt([(chosen[..., 2] ** 2).mean(), (about**2).mean()]))
        times.append(time)
    if len(times) < 2:
        raise FoamError(f"{record.folder} holds {len(times)} snapshots from {begin:.4g} s on: let its solver run on")
    count = len(times)
    mean = total / count
    covariance = products / count - (local / count) ** 2
    correlation = covariance.sum(axis=1)
    return SpanMeans(
        begin=times[0],
        end=times[-1],
        times=np.array(times),
        mean=mean,
        stresses=np.maximum(square / count - mean[:, :3] ** 2, 0.0),
        coherent=np.maximum(together / count - mean[:, 0] ** 2, 0.0),
        dissipation=dissipation / count,
        correlation=correlation / np.where(correlation[0] > 0, correlation[0], 1.0),
        spread=np.array(spread),
        spacing=record.depth / layers,
    )


def _near(spec: SpanSpec, record: SpanRecord) -> NDArray[np.intp]:
    """Numbers of the plane's cells in the near wake."""
    middle, _, rear = axis_points(spec)
    size, centres = spec.mesh.projected_width, record.plane.mesh.plane.centres
    behind = (spec.along * centres[:, 1] - rear) / size
    beside = np.abs(centres[:, 0] - middle) / size
    return np.flatnonzero((behind > NEAR_WAKE[0]) & (behind < NEAR_WAKE[1]) & (beside < BESIDE))


def axis_profile(spec: SpanSpec, record: SpanRecord, means: SpanMeans) -> AxisProfiles:
    """The profiles on the body's axis at PLACES."""
    plane, behind = record.plane.mesh.plane, np.array(PLACES)
    axis = AxisCrossings.of(spec, plane.points, triangulate(plane.points, plane.cells))
    nodes = nodes_of(record.plane, record.plane.folder("latest"), [record.snapshot(means.mean)])
    free = np.zeros(len(plane.faces), dtype=bool)
    spread = Reconstruction(plane, free, free).scalar(
        np.vstack([means.stresses.T, means.coherent, means.mean[:, K_AT]]),
        np.zeros((5, len(plane.faces))), free, bounded=True,
    )  # fmt: skip
    places, speed = behind * spec.mesh.projected_width, spec.speed
    across, along, spanwise, coherent, k = (axis.at(places, row) for row in spread)
    mean = spec.along * axis.at(places, nodes["velocity"][0, :, 1])
    rms = (np.sqrt(square) for square in (along, across, coherent, spanwise, 2 / 3 * k))
    return AxisProfiles(tuple(PLACES), *(tuple((row / speed).tolist()) for row in (mean, *rms)))


# Rms of the spanwise velocity in the near wake over the inlet speed below which the wake counts as plane: wakes that
# broke up have 0.2 to 0.3, the one that stayed plane had 3e-4. Chosen between, nearer to the former.
PLANE_BELOW = 0.05
QUARTERS = 4
FADING = 0.5  # of the first quarter's: three-dimensional motion that falls so far is dying


def measure_span(
    spec: SpanSpec, record: SpanRecord, deep: Path, begin: float, *, seconds: float = 0.0
) -> AirflowResult:
    """The airflow of the run in ``deep`` whose snapshots are ``record``, from ``begin`` (s) on. ``seconds`` of wall
    time are passed on.

    Raises FoamError for a run that has not come so far.
    """
    rows = Tail(deep).update()
    late = rows[rows[:, 0] >= begin]
    means = span_means(spec, record, begin)
    shot = record.snapshot(means.mean)
    nodes = mean_of(nodes_of(record.plane, record.plane.folder("latest"), [shot]))
    in_plane, _ = plane_numbers(spec, record.plane, deep, [shot], nodes, Edges.of(record.plane))
    flow_rate, lost = _balance(record, deep)
    history = in_time(spec, late, begin)
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


def _proof_notes(spec: SpanSpec, means: SpanMeans) -> list[str]:
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


def _spanwise(spec: SpanSpec, record: SpanRecord, means: SpanMeans) -> SpanwiseMotion:
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
