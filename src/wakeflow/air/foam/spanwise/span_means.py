"""Means of an airflow in three dimensions over time and span: profiles behind the body, correlation along the span.

The plane mean wake is what a two-dimensional one is measured by; the rms next to it are of everything resolved about
that mean, the shedding and what broke it up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....core.errors import FoamError
from ..airflow_result import AxisProfiles
from ..case import FlowSpec, axis_points
from ..read import nodes_of
from ..reconstruction import Reconstruction, triangulate
from ..suction import AxisCrossings
from .span_record import K_AT, OMEGA_AT, SpanRecord, des_dissipation

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
        """The same of ``count`` equal parts of the time, in order: whether it grows or decays."""
        pieces = np.array_split(self.spread, count)
        return [tuple(np.sqrt((piece**2).mean(axis=0)).tolist()) for piece in pieces]

    @property
    def integral_lengths(self) -> tuple[float, float, float]:
        """Integral (m) of each component's correlation over the distance up to its first zero, or half the span."""
        found = []
        for column in self.correlation.T:
            negative = np.flatnonzero(column <= 0)
            last = int(negative[0]) if len(negative) else len(column) - 1
            found.append(float(np.trapezoid(np.maximum(column[: last + 1], 0.0)) * self.spacing))
        return found[0], found[1], found[2]


def span_means(spec: FlowSpec, record: SpanRecord, begin: float) -> SpanMeans:
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
        for apart in range(len(products)):
            products[apart] += (chosen * np.roll(chosen, -apart, axis=0)).mean(axis=0)
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


def _near(spec: FlowSpec, record: SpanRecord) -> NDArray[np.intp]:
    """Numbers of the plane's cells in the near wake."""
    middle, _, rear = axis_points(spec)
    size, centres = spec.mesh.projected_width, record.plane.mesh.plane.centres
    behind = (spec.along * centres[:, 1] - rear) / size
    beside = np.abs(centres[:, 0] - middle) / size
    return np.flatnonzero((behind > NEAR_WAKE[0]) & (behind < NEAR_WAKE[1]) & (beside < BESIDE))


def axis_profile(spec: FlowSpec, record: SpanRecord, means: SpanMeans) -> AxisProfiles:
    """The profiles on the body's axis at PLACES."""
    plane, behind = record.plane.mesh.plane, np.array(PLACES)
    axis = AxisCrossings.of(spec, plane.points, triangulate(plane.points, plane.cells))
    nodes = nodes_of(record.plane, record.plane.folder("latest"), [record.snapshot(means.mean)]).mean()
    free = np.zeros(len(plane.faces), dtype=bool)
    spread = Reconstruction(plane, free, free).scalar(
        np.vstack([means.stresses.T, means.coherent, means.mean[:, K_AT]]),
        np.zeros((5, len(plane.faces))), free, bounded=True,
    )  # fmt: skip
    places, speed = behind * spec.mesh.projected_width, spec.speed
    across, along, spanwise, coherent, k = (axis.at(places, row) for row in spread)
    mean = spec.along * axis.at(places, nodes.velocity[:, 1])
    rms = (np.sqrt(square) for square in (along, across, coherent, spanwise, 2 / 3 * k))
    return AxisProfiles(tuple(PLACES), *(tuple((row / speed).tolist()) for row in (mean, *rms)))
