"""What ParaView opens: the air in time and in the mean, the machine, tracks, granules on their way, and landings.

Lengths in m, y up, z = 0; units are in the names of the arrays. Binary XML; places and values in single precision.
Nothing is drawn here, so no OpenGL is needed.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.files import atomic_write
from ..core.tables import Columns
from ..flight.stages.landings import FATES
from .air_pictures import as_flown, at_moments, dynamic_pressure, inlet_pressure, moments_of
from .moving import Path2D

if TYPE_CHECKING:
    from ..air.field import FlowField
    from ..air.kinds.airflow_table import Airflow
    from ..scene import Scene
    from .outcome import Track

Array = NDArray[np.float64]

# what the functions here leave in a run's folder, besides the pieces that the indices among them name
FILES = ("field.npz", "field.vtu", "field.pvd", "mean.vtu", "machine.vtm", "tracks.vtp", "granules.pvd", "landings.vtp")
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
    places = ((folder / name, re.compile(PIECES[name])) for name in names or PIECES)
    return [
        path for place, pattern in places if place.is_dir() for path in place.iterdir() if pattern.fullmatch(path.name)
    ]


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
    level = math.nan
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


def _grid(state: FlowField, scene: Scene, level: float) -> Any:
    """A steady field; ``level`` (Pa): the pressure at which Cp is zero, nan without any."""
    import pyvista

    from ..air.field.flow import vorticity

    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: state.triangles}, lifted(state.points))
    values = {"velocity (m/s)": lifted(state.velocity), "vorticity (1/s)": vorticity(state)}
    if state.has("pressure"):
        values["pressure (Pa)"] = state.pressure
        if math.isfinite(level):
            values["Cp"] = (state.pressure - level) / dynamic_pressure(state, scene)
    if state.has("k"):
        values["k (m2/s2)"] = state.k
    for name, nodal in values.items():
        grid.point_data[name] = np.asarray(nodal, dtype=np.float32)
    known = {"density (kg/m3)": state.density, "viscosity (Pa s)": state.viscosity}
    if scene.air is not None:
        known["air speed (m/s)"] = scene.air.speed
    if math.isfinite(level):
        known["pressure at the inlet (Pa)"] = level
    for name, value in known.items():
        grid.field_data[name] = np.array([value])
    return grid


# -- Granules: their tracks, where they are at each moment of the air's loop, and where they land ----------------------
ARRIVING = "velocity before an impact (m/s)"  # at points without one the velocity


class _Granule(NamedTuple):
    """A track with what the scene knows of it: its fraction's place and the share of the feed that it represents."""

    fraction: int
    weight: float
    track: Track


def write_tracks(
    folder: Path | str, tracks: Mapping[str, Sequence[Track]], scene: Scene, field: FlowField | None = None
) -> Path:
    """Write all tracks as polylines in tracks.vtp; one of a single point becomes a vertex.

    ``tracks``: fraction name to what :class:`.outcome.Outcome` holds of each. In a ``field`` that repeats,
    ``loop time (s)`` is the time in field.pvd of the air that a granule is in.
    """
    granules = sorted(
        _granules(tracks, scene), key=lambda granule: len(granule.track["time"]) > 1
    )  # VTK: vertices before lines
    data = lines_of([granule.track["position"] for granule in granules])
    if granules:
        clock, velocity, arriving = (
            np.concatenate([granule.track[key] for granule in granules]) for key in ("time", "velocity", "arriving")
        )
        sizes = [len(granule.track["time"]) for granule in granules]
        born = np.array([granule.track["time"][0] for granule in granules])
        points = {"time since release (s)": clock - np.repeat(born, sizes), **_moving(velocity)}
        points[ARRIVING] = lifted(arriving)
        if field is not None and field.period:
            points["loop time (s)"] = _loop_time(clock, field)
        data.point_data.update({name: np.asarray(values, dtype=np.float32) for name, values in points.items()})
        data.cell_data.update({**_columns(granules), "release (s)": born})
    _name_numbers(data, scene)
    return save_piece(data, Path(folder) / "tracks.vtp")


def write_moving(
    folder: Path | str, tracks: Mapping[str, Sequence[Track]], scene: Scene, field: FlowField | None
) -> Path | None:
    """Write granules.pvd: at every time of field.pvd the granules that are then on their way, as points.

    A granule released at any time met the loop at that phase, so that all that are at that phase, whole loops apart,
    are there together. None, and nothing is written, without a field that repeats and moments of it.
    """
    path = Path(folder) / "granules.pvd"
    path.unlink(missing_ok=True)
    clear_pieces(Path(folder), "granules")
    if field is None or not field.period or not scene.numerics.snapshots:
        return None
    granules = [granule for granule in _granules(tracks, scene) if len(granule.track["time"]) > 1]
    times = moments_of(field, scene.numerics.snapshots)
    return save_series(path, times, (_at_phase(granules, scene, float(t), field.period) for t in times), ".vtp")


def write_landings(folder: Path | str, granules: Track, scene: Scene) -> Path:
    """Write where granules landed as points, landings.vtp; ``granules``: the columns of granules.npz."""
    data = _points(granules["position"])
    data.point_data.update({
        "fraction": granules["fraction"], "bin": granules["bin"].astype(np.int32), "weight": granules["weight"],
        "fate": granules["fate"].astype(np.int32), "diameter (m)": granules["diameter"],
        "time in flight (s)": granules["time"], "impacts": granules["impacts"],
    })  # fmt: skip
    _name_numbers(data, scene)
    return save_piece(data, Path(folder) / "landings.vtp")


def _granules(tracks: Mapping[str, Sequence[Track]], scene: Scene) -> Iterator[_Granule]:
    shares, places = scene.mass_shares(), {name: number for number, name in enumerate(scene.fraction)}
    for name, part in tracks.items():
        for track in part:
            if len(track["time"]):
                yield _Granule(places[name], shares[name] / len(part), track)


def _columns(granules: Sequence[_Granule]) -> Columns:
    """What is known of each granule."""
    numbers = {key: np.array([int(grain.track[key]) for grain in granules], dtype=np.int32) for key in ("bin", "fate")}
    return {
        "fraction": np.array([granule.fraction for granule in granules], dtype=np.int32),
        "diameter (m)": np.array([float(granule.track["diameter"]) for granule in granules]),
        "weight": np.array([granule.weight for granule in granules]),
        **numbers,
    }


def _moving(velocity: Array) -> Columns:
    return {"velocity (m/s)": lifted(velocity), "speed (m/s)": np.hypot(*velocity.T)}


def _loop_time(clock: Array, field: FlowField) -> Array:
    begin = field.time_axis.times[0]
    return np.asarray(begin + (clock - begin) % field.time_axis.period)


def _at_phase(granules: Sequence[_Granule], scene: Scene, time: float, period: float) -> Any:
    """Every granule at the moments of its flight that are whole periods (s) from ``time`` (s)."""
    here: list[int] = []
    clock, position, velocity = [np.zeros(0)], [np.zeros((0, 2))], [np.zeros((0, 2))]
    for number, granule in enumerate(granules):
        born, ends = granule.track["time"][[0, -1]]
        moments = np.arange(time + period * np.ceil((born - time) / period), ends, period)
        where, pace = Path2D.of(granule.track).at(moments)
        here += [number] * len(moments)
        clock.append(moments - born)
        position.append(where)
        velocity.append(pace)
    data = _points(np.concatenate(position))
    if here:
        rows = {name: values[here] for name, values in _columns(granules).items()}
        since = {"time since release (s)": np.concatenate(clock), **_moving(np.concatenate(velocity))}
        data.point_data.update({**rows, "track": np.array(here, dtype=np.int32), **since})
    _name_numbers(data, scene)
    return data


def _points(plane: Array) -> Any:
    """Places (n, 2) as points of their own."""
    import pyvista

    return pyvista.PolyData(lifted(plane)) if len(plane) else pyvista.PolyData()


def _name_numbers(data: object, scene: Scene) -> None:
    number_by_name(data, "fraction", scene.fraction)
    number_by_name(data, "bin", scene.bin)
    number_by_name(data, "fate", FATES)
