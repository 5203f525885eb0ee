"""Fields and tracks as files that ParaView opens: .vtu (steady), .pvd with a .vtu a snapshot (in time), .vtp (tracks).

Binary XML in float64. Lengths in m, y up, z = 0; nothing is drawn here, so no OpenGL is needed.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ..core.files import atomic_write
from ..core.links import link_or_copy

if TYPE_CHECKING:
    from ..field import FlowField

__all__ = ["link_field", "write_field", "write_tracks"]

Array = NDArray[np.float64]
Track = Mapping[str, Array]


def write_field(folder: Path | str, field: FlowField, name: str = "field") -> Path:
    """Write a flow field: point data velocity (m/s, 3 components), pressure (Pa) and k (m2/s2) where known.

    A steady field becomes ``name.vtu``; one in time ``name.pvd`` beside a folder ``name`` with a .vtu a snapshot, times
    in s. The other form left by an earlier run is removed. ``name.npz`` is the field itself, for ``wf.FlowField.load``.
    Returns the file to open.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    field.save(folder / f"{name}.npz")
    field = field.snapshots()
    velocity = np.asarray(field.velocity)
    steady, series, snapshots = folder / f"{name}.vtu", folder / f"{name}.pvd", folder / name
    series.unlink(missing_ok=True)  # first the index, so that it never names files that are gone
    if snapshots.is_dir():
        shutil.rmtree(snapshots)
    if velocity.ndim == 2:
        _save(_grid(field, velocity, field.pressure, field.k), steady)
        return steady
    steady.unlink(missing_ok=True)
    snapshots.mkdir()
    count = len(velocity)
    times = np.arange(count, dtype=float) if field.times is None else np.asarray(field.times, dtype=float)
    lines = []
    for i in range(count):
        file = snapshots / f"{name}_{i:04d}.vtu"
        _save(_grid(field, velocity[i], _at(field.pressure, i), _at(field.k, i)), file)
        lines.append(f'    <DataSet timestep="{float(times[i])!r}" part="0" file={quoteattr(f"{name}/{file.name}")}/>')
    with atomic_write(series) as stream:
        stream.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n')
        stream.write("\n".join(["  <Collection>", *lines, "  </Collection>", "</VTKFile>", ""]))
    return series


def link_field(source: Path, folder: Path, name: str = "field") -> None:
    """Show in ``folder`` what :func:`write_field` has left in ``source``, without copying it where that can be."""
    whole = (source / f"{name}{suffix}" for suffix in (".npz", ".vtu", ".pvd"))
    found = [*sorted((source / name).glob("*.vtu")), *whole]
    for file in found:  # the index last, so that it never names files that are not there
        if file.exists():
            link_or_copy(file, folder / file.relative_to(source))


def write_tracks(folder: Path | str, tracks: Mapping[str, Sequence[Track]], name: str = "tracks") -> Path:
    """Write all tracks as polylines in one ``name.vtp``.

    ``tracks``: fraction name to dicts of time (m,) s, position (m, 2) m, velocity (m, 2) m/s. Point data: time (s),
    velocity (3 components, m/s), speed (m/s); cell data: fraction, an index into the field data ``fraction_names``. A
    track of one point becomes a vertex.
    """
    import pyvista

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    labelled = [(index, track) for index, part in enumerate(tracks.values()) for track in part if len(track["time"])]
    labelled.sort(key=lambda item: len(item[1]["time"]) > 1)  # VTK numbers vertices before lines
    sizes = np.array([len(track["time"]) for _, track in labelled], dtype=np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)])
    cells = [
        np.concatenate([[size], np.arange(start, start + size)]) for start, size in zip(first, sizes, strict=False)
    ]
    single = int(np.sum(sizes == 1))
    data = pyvista.PolyData()
    if cells:
        data.points = _lifted(np.concatenate([track["position"] for _, track in labelled]))
        if single:
            data.verts = np.concatenate(cells[:single])
        if single < len(cells):
            data.lines = np.concatenate(cells[single:])
        velocity = np.concatenate([track["velocity"] for _, track in labelled]).astype(float)
        data.point_data["time"] = np.concatenate([track["time"] for _, track in labelled]).astype(float)
        data.point_data["velocity"] = _lifted(velocity)
        data.point_data["speed"] = np.hypot(*velocity.T)
        data.cell_data["fraction"] = np.array([index for index, _ in labelled], dtype=np.int64)
    data.field_data["fraction_names"] = list(tracks)
    path = folder / f"{name}.vtp"
    _save(data, path)
    return path


def _grid(field: FlowField, velocity: Array, pressure: Array | None, k: Array | None) -> Any:
    import pyvista

    triangles = np.asarray(field.triangles, dtype=np.int64)
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: triangles}, _lifted(field.points))
    grid.point_data["velocity"] = _lifted(velocity)
    for label, values in (("pressure", pressure), ("k", k)):
        if values is not None:
            grid.point_data[label] = np.asarray(values, dtype=float)
    return grid


def _at(values: Array | None, snapshot: int) -> Array | None:
    """One snapshot of values (T, N); steady values (N,) serve all snapshots."""
    return values[snapshot] if values is not None and np.ndim(values) == 2 else values


def _lifted(plane: Array) -> Array:
    """(n, 2) to (n, 3) with z = 0."""
    plane = np.asarray(plane, dtype=float)
    return np.column_stack([plane, np.zeros(len(plane))])


def _save(data: Any, path: Path) -> None:
    """Write through a temporary neighbour: VTK wants a path whose suffix says the format."""
    draft = path.with_name(f".{path.stem}.tmp{path.suffix}")
    try:
        data.save(draft, binary=True)
        with draft.open("rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
