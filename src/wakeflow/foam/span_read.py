"""Read layers of a three-dimensional airflow as plane wakes in time, for ``FlowField.from_arrays``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError
from .case import FlowSpec
from .read import FlowArrays, nodes_of
from .reconstruction import triangulate
from .solenoidal import solenoidal
from .span_record import SpanRecord

__all__ = ["apart", "lead_of", "read_layers"]

APART = 0.5  # body widths between layers that count as samples of their own, at least
LEAD = 3.0  # convective times over which a record's end is faded into its beginning: half a usual shedding


def apart(record: SpanRecord, width: float, integral_length: float) -> list[int]:
    """The layers to fly in: as many as lie at least half a body ``width`` and one integral length (m) apart."""
    layers = len(record.order)
    spacing = record.depth / layers
    step = max(APART * width, integral_length, spacing)
    count = max(1, int(record.depth / step + 1e-9))
    return [int(i * layers / count) for i in range(count)]


def lead_of(spec: FlowSpec, times: NDArray[np.float64]) -> int:
    """How many of the snapshots at ``times`` (t,) s the end of the record is faded into (``field.cross_fade``)."""
    step = float(np.median(np.diff(times)))
    return max(1, min(round(LEAD * spec.convective_time / step), len(times) // 4))


def read_layers(record: SpanRecord, layers: Sequence[int], begin: float, density: float) -> list[FlowArrays]:
    """Keyword arguments for ``FlowField.from_arrays`` of each of ``layers``: the snapshots from ``begin`` (s) on.

    Pressure in Pa for ``density`` (kg/m3), less 2k/3; node values as of a one-layer case; of the velocity in the plane
    the part without divergence (:mod:`.solenoidal`). Raises FoamError where there are fewer than two snapshots.
    """
    chosen = [(time, values[list(layers)]) for time, values in record.since(begin)]
    if len(chosen) < 2:
        raise FoamError(f"{record.folder} holds {len(chosen)} snapshots from {begin:.4g} s on: let its solver run on")
    plane, latest = record.plane.mesh.plane, record.plane.folder("latest")
    triangles = triangulate(plane.points, plane.cells)
    project = solenoidal(plane, triangles, np.unique(plane.faces[record.plane.wall]))
    times = np.array([time for time, _ in chosen])
    found = []
    for number in range(len(layers)):
        nodes = nodes_of(record.plane, latest, [record.snapshot(values[number]) for _, values in chosen])
        found.append(
            FlowArrays(
                points=plane.points,
                triangles=triangles,
                velocity=project(nodes.velocity),
                pressure=nodes.pressure * density,
                pressure_gradient=None,
                times=times - times[0],
                period=None,
                k=nodes.k,
                dissipation=nodes.dissipation,
                density=density,
                viscosity=record.plane.viscosity() * density,
                motion=None,
            )
        )
    return found
