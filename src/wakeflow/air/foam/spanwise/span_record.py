"""What a three-dimensional run leaves: snapshots of its layers, each a plane wake on the mesh that was extruded.

A snapshot is one file ``packed/TIME.npy``: single precision, one row a cell in OpenFOAM's order, columns
:data:`COLUMNS` (the velocity's three components, kinematic p as OpenFOAM holds it, k, omega). ``layers.npz`` says which
cell of the plane mesh each of them is over (``at``) and at which height its centre lies (``z``, m).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.errors import FoamError
from ....core.files import atomic_write
from ....core.geometry import area
from ....core.lazy import cached_property
from ..case import FlowSpec
from ..read import NUMBER, CaseFields, Snapshot, flow_arrays, nodes_of
from ..reconstruction import solenoidal, triangulate

Array = NDArray[np.float64]
Single = NDArray[np.float32]
PACKED, LAYERS = "packed", "layers.npz"
COLUMNS = ("U", "p", "k", "omega")  # fields of a snapshot; U takes three columns
P_AT, K_AT, OMEGA_AT = 3, 4, 5
C_DES = 0.60  # OpenFOAM's of the k-epsilon branch, which holds in a wake (0.82 near walls): Gritskevich et al. 2012
C_MU = 0.09


def pack(time: Path, folder: Path) -> None:
    """Write the fields of one of OpenFOAM's binary time folders into ``folder``/packed, whole or not at all.

    Raises FoamError for a field that cannot be read or holds values that are not finite.
    """
    (folder / PACKED).mkdir(exist_ok=True)
    values = np.hstack([_internal(time / name) for name in COLUMNS]).astype(np.float32)
    if not np.isfinite(values).all():
        raise FoamError(f"{time} holds values that are not finite: the solution has diverged")
    with atomic_write(folder / PACKED / f"{time.name}.npy", "wb") as stream:
        np.save(stream, values)


def _internal(path: Path) -> Array:
    """Values of the cells (n, 1 or 3) in a binary OpenFOAM field."""
    content = path.read_bytes()
    head = re.search(rb"internalField\s+nonuniform\s+List<(\w+)>\s*\n?(\d+)\s*\n?\(", content)
    if head is None:
        raise FoamError(f"{path} is not a binary OpenFOAM field with one value a cell")
    count, width = int(head[2]), 3 if head[1] == b"vector" else 1
    if len(content) < head.end() + 8 * count * width:
        raise FoamError(f"{path} is cut short")
    return np.frombuffer(content, "<f8", count * width, head.end()).reshape(count, width)


def des_dissipation(k: Array, omega: Array, edge: Array) -> Array:
    """Dissipation of the modelled k (m2/s3) in a detached-eddy simulation: k^(3/2) / l.

    l is the smaller of the model's own length sqrt(k) / (C_mu omega) and C_DES ``edge``, the cell's edge (m). That is
    the k equation's sink but for the shield of delayed DES, which acts in attached boundary layers only, where the
    model's own length is the smaller one beyond the first cells anyway.
    """
    of_model = C_MU * k * omega
    return np.maximum(of_model, np.maximum(k, 0.0) ** 1.5 / (C_DES * edge))


@dataclass(frozen=True, eq=False)
class SpanRecord:
    """The snapshots of a three-dimensional run in ``folder``; ``plane``: the one-layer case that was extruded."""

    folder: Path
    plane: CaseFields

    @cached_property
    def files(self) -> list[Path]:
        """The snapshots in order of time. Raises FoamError where there is none."""
        result = [path for path in (self.folder / PACKED).glob("*.npy") if NUMBER.fullmatch(path.stem)]
        if not result:
            raise FoamError(f"{self.folder} holds no snapshots of a three-dimensional airflow: run its solver on")
        return sorted(result, key=lambda path: float(path.stem))

    @cached_property
    def times(self) -> Array:
        """Times (t,) s of the snapshots."""
        return np.array([float(path.stem) for path in self.files])

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """The cell (l, m) of each layer, lowest first, over each cell of the plane. Raises FoamError if one lacks."""
        with np.load(self.folder / LAYERS) as data:
            at, z = data["at"], data["z"]
        count = len(self.plane.mesh.plane.cells)
        layers = len(at) // count
        if layers * count != len(at) or (np.bincount(at, minlength=count) != layers).any():
            raise FoamError(f"{self.folder / LAYERS} does not put the same number of cells over each cell of the plane")
        return np.asarray(np.lexsort((z, at)).reshape(count, layers).T)

    @cached_property
    def depth(self) -> float:
        """Length of the span (m)."""
        with np.load(self.folder / LAYERS) as data:
            z = data["z"]
        return float(np.ptp(z)) * len(self.order) / (len(self.order) - 1)

    def values(self, index: int) -> Single:
        """One snapshot (l, m, 6), layer by layer."""
        return np.asarray(np.load(self.files[index])[self.order])

    def since(self, begin: float) -> Iterator[tuple[float, Single]]:
        """Time (s) and values (l, m, 6) of the snapshots from ``begin`` (s) on."""
        for index, time in enumerate(self.times):
            if begin <= time:
                yield float(time), self.values(index)

    @cached_property
    def edge(self) -> Array:
        """Edge (m,) m of a cube as large as each cell: the filter of the detached-eddy model."""
        plane = self.plane.mesh.plane
        areas = np.array([abs(area(plane.points[corners])) for corners in plane.cells])
        return np.asarray(np.cbrt(areas * self.depth / len(self.order)))

    def snapshot(self, values: NDArray[np.floating]) -> Snapshot:
        """A layer's values (m, 6), or a mean over layers, as a snapshot of the plane case with its edges' values."""
        plane, cells = self.plane.mesh.plane, np.asarray(values, dtype=float)
        prescribed, k, sliding, inlet, outlet = self._edges
        at_faces = cells[plane.owner]
        velocity = at_faces[:, :2].copy()
        velocity[self.plane.wall] = 0.0
        across = (velocity[sliding] * plane.normals[sliding]).sum(axis=1, keepdims=True)
        velocity[sliding] -= across * plane.normals[sliding]
        velocity[inlet] = prescribed[inlet]
        k_faces = at_faces[:, K_AT].copy()
        k_faces[inlet] = k[inlet]
        at_rest = self.plane.wall & ~sliding
        pressure = np.where(outlet, 0.0, at_faces[:, P_AT]) - 2 / 3 * np.where(at_rest, 0.0, k_faces)
        at_cells = {
            "velocity": cells[:, :2],
            "pressure": cells[:, P_AT] - 2 / 3 * cells[:, K_AT],
            "k": cells[:, K_AT],
            "dissipation": des_dissipation(cells[:, K_AT], cells[:, OMEGA_AT], self.edge),
        }
        return Snapshot(at_cells, {"velocity": velocity, "pressure": pressure, "k": k_faces})

    @cached_property
    def _edges(self) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """Velocity (b, 2) and k (b,) prescribed on the inlets' edges; which edges slide, are inlets, are the outlet."""
        plane, latest = self.plane.mesh.plane, self.plane.folder("latest")
        wall = self.plane.wall
        sliding = self.plane.slip(latest) & ~wall
        inlet = plane.on(*(name for name in plane.patches if name.startswith("inlet")))
        velocity, k = (self.plane.field(latest, name)[1] for name in ("U", "k"))
        return velocity, k, sliding, inlet, plane.on("outlet")


# -- Read layers of a three-dimensional airflow as plane wakes in time -------------------------------------------------
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
    """How many of the snapshots at ``times`` (t,) s the end of the record is faded into (``air.field.combined``)."""
    step = float(np.median(np.diff(times)))
    return max(1, min(round(LEAD * spec.convective_time / step), len(times) // 4))


def read_layers(record: SpanRecord, layers: Sequence[int], begin: float, density: float) -> list[dict[str, Any]]:
    """Keyword arguments for ``FlowField.from_arrays`` of each of ``layers``: the snapshots from ``begin`` (s) on.

    Pressure in Pa for ``density`` (kg/m3), less 2k/3; node values as of a one-layer case; of the velocity in the plane
    the part without divergence (:func:`solenoidal`). Raises FoamError where there are fewer than two snapshots.
    """
    chosen = [(time, values[list(layers)]) for time, values in record.since(begin)]
    if len(chosen) < 2:
        raise FoamError(f"{record.folder} holds {len(chosen)} snapshots from {begin:.4g} s on: let its solver run on")
    plane, latest = record.plane.mesh.plane, record.plane.folder("latest")
    triangles = triangulate(plane.points, plane.cells)
    project = solenoidal(plane, triangles, np.unique(plane.faces[record.plane.wall]))
    times = np.array([time for time, _ in chosen])
    result = []
    for number in range(len(layers)):
        nodes = nodes_of(record.plane, latest, [record.snapshot(values[number]) for _, values in chosen])
        nodes["velocity"] = project(nodes["velocity"])
        result.append({**flow_arrays(record.plane, nodes, density), "times": times - times[0]})
    return result
