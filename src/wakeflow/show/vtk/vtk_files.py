"""VTK's files, each whole or absent: pieces by PyVista, the indices that name them, the machine as blocks, the air."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files import atomic_write
from ..air_pictures import as_flown, at_moments, dynamic_pressure, inlet_pressure

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...air.kinds.airflow_table import Airflow
    from ...scene import Scene

Array = NDArray[np.float64]

PIECES = {  # the program's own files in each folder
    "field": r"field_\d{4,}\.vtu",
    "granules": r"granules_\d{4,}\.vtp",
    "machine": r"[a-z]+_\d{2,}\.vtp",
}
HEAD = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
FOOT = "  </Collection>\n</VTKFile>\n"


def lifted(plane: ArrayLike) -> NDArray[np.float32]:
    """(n, 2) to (n, 3) with z = 0, in single precision."""
    flat = np.asarray(plane, dtype=np.float32).reshape(-1, 2)
    return np.column_stack([flat, np.zeros(len(flat), dtype=np.float32)])


def lines_of(parts: Sequence[ArrayLike]) -> Any:
    """Polylines (m, 2) as one PolyData; those of one point, which must come first, as vertices."""
    import pyvista

    data = pyvista.PolyData()
    sizes = [len(np.asarray(part)) for part in parts]
    if not sizes:
        return data
    first = np.concatenate([[0], np.cumsum(sizes)])
    cells = [np.concatenate([[size], np.arange(at, at + size)]) for size, at in zip(sizes, first, strict=False)]
    single = sizes.count(1)
    data.points = lifted(np.concatenate([np.asarray(part, dtype=float) for part in parts]))
    if single:
        data.verts = np.concatenate(cells[:single])
    if single < len(cells):
        data.lines = np.concatenate(cells[single:])
    return data


def number_by_name(data: Any, what: str, names: Iterable[str]) -> None:
    """Say in the field data of a file which name each value of its array ``what`` represents."""
    data.field_data[f"{what}_names"] = list(names)


def pieces(folder: Path, *names: str) -> list[Path]:
    """The pieces in the folders ``names``, by default all that there are, next to their indices in ``folder``."""
    found = ((folder / name, re.compile(PIECES[name])) for name in names or PIECES)
    return [path for place, own in found if place.is_dir() for path in place.iterdir() if own.fullmatch(path.name)]


def clear_pieces(folder: Path, *names: str) -> None:
    """Remove these pieces, and their folders where nothing else is in them."""
    for path in pieces(folder, *names):
        path.unlink(missing_ok=True)
    for name in names or PIECES:
        with suppress(OSError):  # not there, or not empty
            (folder / name).rmdir()


def save_piece(data: Any, path: Path) -> Path:
    """Write through a temporary neighbour: VTK wants a path whose suffix says the format."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.tmp{path.suffix}")
    try:
        data.save(draft, binary=True)
        with draft.open("rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
    return path


def save_series(path: Path, times: Iterable[float], pieces: Iterable[Any], suffix: str) -> Path:
    """Write the ``pieces`` at ``times`` (s) into a folder next to ``path`` (.pvd), which names them and comes last."""
    lines, name = [], path.stem
    for number, (time, piece) in enumerate(zip(times, pieces, strict=True)):
        file = save_piece(piece, path.parent / name / f"{name}_{number:04d}{suffix}")
        place = quoteattr(f"{name}/{file.name}")
        lines.append(f'    <DataSet timestep="{float(time)!r}" part="0" file={place}/>\n')
    with atomic_write(path) as stream:
        stream.write("".join([HEAD, *lines, FOOT]))
    return path


BLOCKS_HEAD = '<?xml version="1.0"?>\n<VTKFile type="vtkMultiBlockDataSet" version="1.0" byte_order="LittleEndian">\n'
BLOCKS_FOOT = "  </vtkMultiBlockDataSet>\n</VTKFile>\n"


def write_machine(folder: Path | str, scene: Scene) -> Path:
    """Write machine.vtm: the groups bodies, bins, walls and inlets, each of blocks with the scene's own names.

    Bodies are polygons at the middle of their motion, the others lines. A body that vibrates has in its field data the
    ``vibration (m)``, its amplitude (x, y), and the ``frequency (Hz)``; one that rocks the angle ``rocks (rad)`` and
    the ``pivot (m)`` too.
    """
    folder, place = Path(folder), Path(folder) / "machine"
    clear_pieces(folder, "machine")
    lines = ["  <vtkMultiBlockDataSet>\n"]
    for number, (group, blocks) in enumerate(machine_blocks(scene).items()):
        lines.append(f'    <Block index="{number}" name={quoteattr(group)}>\n')
        for index, (name, block) in enumerate(blocks.items()):
            file = save_piece(block, place / f"{group}_{index:02d}.vtp")
            path = quoteattr(f"machine/{file.name}")
            lines.append(f'      <DataSet index="{index}" name={quoteattr(name)} file={path}/>\n')
        lines.append("    </Block>\n")
    with atomic_write(folder / "machine.vtm") as stream:
        stream.write("".join([BLOCKS_HEAD, *lines, BLOCKS_FOOT]))
    return folder / "machine.vtm"


def machine_blocks(scene: Scene) -> dict[str, dict[str, Any]]:
    """The groups bodies, bins, walls and inlets, those that there are, of blocks by the scene's own names."""
    channel, half = scene.channel, scene.channel.width / 2
    walls = {side: [(x, channel.bottom), (x, channel.top)] for side, x in (("left", -half), ("right", half))}
    inlets = {
        name: [(-half if inlet.side == "left" else half, y) for y in inlet.span]
        for name, inlet in channel.inlet.items()
    }
    groups = {
        "bodies": {name: _body(scene, body.outline()) for name, body in scene.body.items()},
        "bins": {name: lines_of([bin_.line(scene)]) for name, bin_ in scene.bin.items()},
        "walls": {name: lines_of([ends]) for name, ends in walls.items()},
        "inlets": {name: lines_of([ends]) for name, ends in inlets.items()},
    }
    return {name: blocks for name, blocks in groups.items() if blocks}


def _body(scene: Scene, outline: Any) -> Any:
    import pyvista

    polygon = pyvista.PolyData(lifted(outline), faces=[len(outline), *range(len(outline))])
    if scene.vibration is not None:
        polygon.field_data["vibration (m)"] = np.abs(scene.motion[0])
        if scene.vibration.pivot is not None:
            polygon.field_data["rocks (rad)"] = np.array([scene.vibration.given["angle"]])
            polygon.field_data["pivot (m)"] = np.asarray(scene.vibration.pivot)
        polygon.field_data["frequency (Hz)"] = np.array([1.0 / scene.vibration.period])
    return polygon


ITSELF = "field.npz"
NAMES = ("field.vtu", "mean.vtu", "field.pvd")  # the index last, so that it never names files that are not there


def write_field(folder: Path | str, field: FlowField, scene: Scene, airflow: Airflow | None) -> Path:
    """Write the air: velocity, vorticity, and where they are known pressure, Cp and k, at the nodes.

    A steady field becomes field.vtu. One in time becomes mean.vtu, the mean as the granules flew in it, and field.pvd
    with a file in the folder field for each of ``numerics.snapshots`` moments, evenly over the loop; where the mesh
    swings with the bodies, each with the mesh where it then is. field.npz is the field itself, for
    ``wf.FlowField.load``. Returns the file to open.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)
    field.save(folder / ITSELF)
    mean = as_flown(field.mean(), scene)
    level = None
    if mean.has("pressure") and airflow is not None and not scene.airstream.still:
        level = inlet_pressure(mean, scene, airflow)
    steady = save_piece(_grid(mean, scene, level), folder / NAMES[int(field.in_time)])
    if not field.in_time or not scene.numerics.snapshots:
        return steady
    times, states = at_moments(field, scene.numerics.snapshots)
    return save_series(folder / "field.pvd", times, (_grid(state, scene, level) for state in states), ".vtu")


def _clear(folder: Path) -> None:
    for name in (*reversed(NAMES), ITSELF):
        (folder / name).unlink(missing_ok=True)
    clear_pieces(folder, "field")


def _grid(state: FlowField, scene: Scene, level: float | None) -> Any:
    """A steady field; ``level`` (Pa): the pressure at which Cp is zero, None without any."""
    import pyvista

    from ...air.field.flow import vorticity

    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: state.triangles}, lifted(state.points))
    values = {"velocity (m/s)": lifted(state.velocity), "vorticity (1/s)": vorticity(state)}
    if state.has("pressure"):
        values["pressure (Pa)"] = state.pressure
        if level is not None:
            values["Cp"] = (state.pressure - level) / dynamic_pressure(state, scene)
    if state.has("k"):
        values["k (m2/s2)"] = state.k
    for name, nodal in values.items():
        grid.point_data[name] = np.asarray(nodal, dtype=np.float32)
    known = {"density (kg/m3)": state.density, "viscosity (Pa s)": state.viscosity}
    if scene.air is not None:
        known["air speed (m/s)"] = scene.air.speed
    if level is not None:
        known["pressure at the inlet (Pa)"] = level
    for name, value in known.items():
        grid.field_data[name] = np.array([value])
    return grid
