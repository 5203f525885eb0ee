"""Read an OpenFOAM solution into arrays for ``FlowField.from_arrays``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError
from .case_fields import CaseFields, Snapshot, time_folders
from .reconstruction import Reconstruction, triangulate

__all__ = ["LOOP", "STATES", "FlowArrays", "late_states", "loop_of", "nodes_of", "read_flow"]

Array = NDArray[np.float64]
LOOP = "loop.json"  # what a time-resolved airflow keeps: {"period": s, "times": [names of time folders]}
STATES = "states.json"  # what a steady airflow that does not settle keeps: {"begin": iteration, "states": [names]}


class FlowArrays(TypedDict):
    """Keyword arguments of ``FlowField.from_arrays``, shapes and units as there; T times, N nodes, M triangles."""

    points: Array
    triangles: NDArray[np.intp]
    velocity: Array
    pressure: Array
    pressure_gradient: Array | None
    times: Array | None
    period: float | None
    k: Array | None
    dissipation: Array | None
    density: float
    viscosity: float
    motion: list[float] | None


def read_flow(case_dir: Path | str, time: str | float = "latest", density: float = 1.2) -> FlowArrays:
    """Keyword arguments for ``FlowField.from_arrays`` from a one-layer OpenFOAM case.

    ``time``: "latest", a time (s), "mean" (OpenFOAM's UMean of the last time, else the mean over the stored times),
    "all" (the stored times; a loop of whole shedding periods where the case was made by the time-resolved rung), or
    "states" (:func:`late_states`, against iterations; their mean is then what "mean" gives).
    Pressure is OpenFOAM's kinematic p times ``density`` (kg/m3), in Pa, less 2k/3 where a k field and a linear
    eddy-viscosity model are present; at a no-slip wall k = 0, and it is p itself. Node values are second order up to
    the walls, see :mod:`.reconstruction`; k and the dissipation rate stay within the range of their cells. Raises
    FoamError for a case that is not one layer, decomposed only, or without the asked time.
    """
    fields = CaseFields(Path(case_dir))
    loop = loop_of(fields.case)
    folders, suffix = _folders_of(fields, time, loop)
    shots = [fields.snapshot(folder, suffix) for folder in folders]
    nodes = nodes_of(fields, folders[0], shots)
    looped = time in ("all", "states") and len(folders) > 1
    if not looped:
        nodes = nodes.mean()
    flow = FlowArrays(
        points=fields.mesh.plane.points,
        triangles=triangulate(fields.mesh.plane.points, fields.mesh.plane.cells),
        velocity=nodes.velocity,
        pressure=nodes.pressure * density,
        pressure_gradient=None,
        times=None,
        period=None,
        k=nodes.k,
        dissipation=nodes.dissipation,
        density=density,
        viscosity=fields.viscosity() * density,
        motion=None,
    )
    if looped:
        clock = np.array([float(path.name) for path in folders])
        flow["times"] = clock - clock[0]
        flow["period"] = loop["period"] if loop else None
        if loop and "motion" in loop:
            flow["motion"] = [*loop["motion"]["amplitude"], loop["motion"]["omega"], loop["motion"]["phase"]]
    return flow


def _folders_of(fields: CaseFields, time: str | float, loop: dict[str, Any] | None) -> tuple[list[Path], str]:
    """The time folders that ``time`` means, and what OpenFOAM appends to the names of the fields to read there."""
    if time not in ("mean", "all", "states"):
        return [fields.folder(time)], ""
    kept = [] if time == "all" else late_states(fields.case)
    if kept:
        return [fields.folder(name) for name in kept], ""
    if time == "states":
        raise FoamError(f"{fields.case} has no {STATES}: its airflow settled, or was not computed by wakeflow")
    if loop:
        return [fields.folder(name) for name in loop["times"]], ""
    latest = fields.folder("latest")
    if time == "mean" and fields.has(latest, "UMean"):
        return [latest], "Mean"
    return time_folders(fields.case), ""


def loop_of(case: Path) -> dict[str, Any] | None:
    """What loop.json says: "period" (s), "periods" in it, "begin" (s), "times" (folder names), and "motion" where the
    mesh moves: "amplitude" (x, y) m, "omega" (rad/s), "phase" (rad) at the first time; None without a loop.
    """
    path = case / LOOP
    return json.loads(path.read_text()) if path.exists() else None


def late_states(case: Path) -> list[str]:
    """The time folders, in order, that a steady airflow which does not settle keeps: iterations spread over its
    oscillation, each of which ``read_flow`` and ``FlowField.from_openfoam`` take as a ``time``; empty for others.
    """
    path = case / STATES
    return list(json.loads(path.read_text())["states"]) if path.exists() else []


class _Nodes(NamedTuple):
    """Node arrays over t snapshots: velocity (t, n, 2) m/s, kinematic pressure and k (t, n) m2/s2, dissipation of k (t,
    n) m2/s3; without the first axis their mean.
    """

    velocity: Array
    pressure: Array
    k: Array | None
    dissipation: Array | None

    def mean(self) -> _Nodes:
        """The mean over the snapshots."""
        k, dissipation = (None if values is None else values.mean(axis=0) for values in (self.k, self.dissipation))
        return _Nodes(self.velocity.mean(axis=0), self.pressure.mean(axis=0), k, dissipation)


def nodes_of(fields: CaseFields, folder: Path, shots: Sequence[Snapshot]) -> _Nodes:
    """The snapshots' fields at the nodes; ``folder`` tells which boundary values are prescribed."""
    plane = fields.mesh.plane
    slip = fields.slip(folder)
    wall = fields.wall & ~slip
    nodes = Reconstruction(plane, wall, slip)
    inlet, outlet = _fixed(fields, folder, "U"), _fixed(fields, folder, "p")

    def stack(name: str) -> Array:
        return np.stack([getattr(shot, name) for shot in shots])

    pressure = nodes.scalar(stack("pressure"), stack("pressure_faces"), outlet)
    k = dissipation = None
    if shots[0].k is not None:
        at_rest = np.unique(plane.faces[wall])
        pressure[:, at_rest] += 2 / 3 * nodes.scalar(stack("k"), stack("k_faces"), outlet)[:, at_rest]
        k = nodes.scalar(stack("k"), stack("k_faces"), inlet | wall, bounded=True)
    if shots[0].dissipation is not None:
        no_faces, none = np.zeros((len(shots), len(plane.faces))), np.zeros(len(plane.faces), dtype=bool)
        dissipation = nodes.scalar(stack("dissipation"), no_faces, none, bounded=True)
    velocity = nodes.vector(stack("velocity"), stack("velocity_faces"), inlet | wall)
    return _Nodes(velocity, pressure, k, dissipation)


def _fixed(fields: CaseFields, folder: Path, name: str) -> NDArray[np.bool_]:
    """Boundary edges (b,) whose value of a field is prescribed."""
    from foamlib import FoamFieldFile

    kinds = FoamFieldFile(folder / name).boundary_field if (folder / name).exists() else {}
    fixed = ("fixedValue", "noSlip", "movingWallVelocity", "uniformFixedValue", "timeVaryingMappedFixedValue")
    return fields.mesh.plane.on(*(p for p in fields.mesh.plane.patches if p in kinds and kinds[p].get("type") in fixed))
