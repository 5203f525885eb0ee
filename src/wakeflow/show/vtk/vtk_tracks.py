"""Granules for ParaView: their tracks, where they are at each moment of the air's loop, and where they land."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.tables import Columns
from ...flight.stages.landings import FATES
from ..air_pictures import moments_of
from ..moving import Path2D
from .vtk_files import clear_pieces, lifted, lines_of, number_by_name, save_piece, save_series

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...scene import Scene
    from ..outcome import Track

Array = NDArray[np.float64]
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

    ``tracks``: fraction name to what :class:`..outcome.Outcome` holds of each. In a ``field`` that repeats,
    ``loop time (s)`` is the time in field.pvd of the air that a granule is in.
    """
    found = sorted(_granules(tracks, scene), key=lambda one: len(one.track["time"]) > 1)  # VTK: vertices before lines
    data = lines_of([one.track["position"] for one in found])
    if found:
        clock, velocity, arriving = (
            np.concatenate([one.track[key] for one in found]) for key in ("time", "velocity", "arriving")
        )
        sizes = [len(one.track["time"]) for one in found]
        born = np.array([one.track["time"][0] for one in found])
        points = {"time since release (s)": clock - np.repeat(born, sizes), **_moving(velocity)}
        points[ARRIVING] = lifted(arriving)
        if field is not None and field.period:
            points["loop time (s)"] = _loop_time(clock, field)
        data.point_data.update({name: np.asarray(values, dtype=np.float32) for name, values in points.items()})
        data.cell_data.update({**_columns(found), "release (s)": born})
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
    found = [one for one in _granules(tracks, scene) if len(one.track["time"]) > 1]
    times = moments_of(field, scene.numerics.snapshots)
    return save_series(path, times, (_at_phase(found, scene, float(t), field.period) for t in times), ".vtp")


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


def _columns(found: Sequence[_Granule]) -> Columns:
    """What is known of each granule."""
    numbers = {key: np.array([int(one.track[key]) for one in found], dtype=np.int32) for key in ("bin", "fate")}
    return {
        "fraction": np.array([one.fraction for one in found], dtype=np.int32),
        "diameter (m)": np.array([float(one.track["diameter"]) for one in found]),
        "weight": np.array([one.weight for one in found]),
        **numbers,
    }


def _moving(velocity: Array) -> Columns:
    return {"velocity (m/s)": lifted(velocity), "speed (m/s)": np.hypot(*velocity.T)}


def _loop_time(clock: Array, field: FlowField) -> Array:
    begin = field.time_axis.times[0]
    return np.asarray(begin + (clock - begin) % field.time_axis.period)


def _at_phase(found: Sequence[_Granule], scene: Scene, time: float, period: float) -> Any:
    """Every granule at the moments of its flight that are whole periods (s) from ``time`` (s)."""
    here: list[int] = []
    clock, position, velocity = [np.zeros(0)], [np.zeros((0, 2))], [np.zeros((0, 2))]
    for number, one in enumerate(found):
        born, ends = one.track["time"][[0, -1]]
        moments = np.arange(time + period * np.ceil((born - time) / period), ends, period)
        where, pace = Path2D.of(one.track).at(moments)
        here += [number] * len(moments)
        clock.append(moments - born)
        position.append(where)
        velocity.append(pace)
    data = _points(np.concatenate(position))
    if here:
        rows = {name: values[here] for name, values in _columns(found).items()}
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
