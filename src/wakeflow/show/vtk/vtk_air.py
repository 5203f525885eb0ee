"""The air for ParaView: its mean, and as many moments of its loop as are asked for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.files import link_or_copy
from ..air_pictures import as_flown, at_moments, dynamic_pressure, inlet_pressure
from .vtk_files import clear_pieces, lifted, save_piece, save_series

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...air.kinds.airflow_table import Airflow
    from ...scene import Scene

Array = NDArray[np.float64]
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
    if mean.pressure is not None and airflow is not None and not scene.airstream.still:
        level = inlet_pressure(mean, scene, airflow)
    steady = save_piece(_grid(mean, scene, level), folder / NAMES[0 if field.times is None else 1])
    if field.times is None or not scene.numerics.snapshots:
        return steady
    times, states = at_moments(field, scene.numerics.snapshots)
    return save_series(folder / "field.pvd", times, (_grid(state, scene, level) for state in states), ".vtu")


def link_field(source: Path, folder: Path) -> None:
    """Show in ``folder`` what :func:`write_field` has left in ``source``, without copying it where that can be."""
    for file in [*sorted((source / "field").glob("*.vtu")), source / ITSELF, *(source / name for name in NAMES)]:
        if file.exists():
            link_or_copy(file, folder / file.relative_to(source))


def _clear(folder: Path) -> None:
    for name in (*reversed(NAMES), ITSELF):
        (folder / name).unlink(missing_ok=True)
    clear_pieces(folder, "field")


def _grid(state: FlowField, scene: Scene, level: float | None) -> Any:
    """A steady field; ``level`` (Pa): the pressure at which Cp is zero, None without any."""
    import pyvista

    from ...air.field.derived import vorticity

    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: state.triangles}, lifted(state.points))
    values = {"velocity (m/s)": lifted(state.velocity), "vorticity (1/s)": vorticity(state)}
    if state.pressure is not None:
        values["pressure (Pa)"] = state.pressure
        if level is not None:
            values["Cp"] = (state.pressure - level) / dynamic_pressure(state, scene)
    if state.k is not None:
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
