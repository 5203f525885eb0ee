"""Read an OpenFOAM solution into arrays for ``FlowField.from_arrays``."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError
from ..laws.constants import C_MU
from .polymesh import FoamMesh, read_polymesh
from .reconstruction import Reconstruction, triangulate

__all__ = ["CaseFields", "Snapshot", "loop_of", "read_flow", "time_folders"]

Array = NDArray[np.float64]
LOOP = "loop.json"  # what a time-resolved airflow keeps: {"period": s, "times": [names of time folders]}


def time_folders(case: Path) -> list[Path]:
    """The case's time folders that hold a velocity, in order of time; 0 is left out."""
    found = []
    for path in case.iterdir() if case.is_dir() else []:
        try:
            time = float(path.name)
        except ValueError:
            continue
        if time > 0 and any((path / name).exists() for name in ("U", "U.gz")):
            found.append((time, path))
    return [path for _, path in sorted(found)]


@dataclass(frozen=True)
class Snapshot:
    """One time of a case: velocity (m, 2) m/s at cells and (b, 2) at boundary edges, kinematic static pressure
    (m2/s2), k, omega (1/s).

    ``pressure`` is OpenFOAM's p minus 2k/3, which its linear eddy-viscosity models leave in p.
    """

    velocity: Array
    velocity_faces: Array
    pressure: Array
    pressure_faces: Array
    k: Array | None
    k_faces: Array | None
    dissipation: Array | None


class CaseFields:
    """The fields of one case folder. Raises FoamError for a case that is three-dimensional or only decomposed."""

    def __init__(self, case: Path) -> None:
        self.case = Path(case)
        if not time_folders(self.case) and (self.case / "processor0").is_dir():
            raise FoamError(f"{self.case} is decomposed: run reconstructPar in it first")
        self.mesh: FoamMesh = read_polymesh(self.case)
        plane = self.mesh.plane
        self.wall = plane.on(*(name for name, kind in self.mesh.types.items() if kind == "wall"))
        self.symmetry = plane.on(*(n for n, kind in self.mesh.types.items() if kind in ("symmetry", "symmetryPlane")))

    def folder(self, time: str | float) -> Path:
        """The time folder called or nearest to ``time``. Raises FoamError naming those that are there."""
        folders = time_folders(self.case)
        if not folders:
            raise FoamError(f"{self.case} holds no solved time: run its solver first")
        if time == "latest":
            return folders[-1]
        times = np.array([float(path.name) for path in folders])
        wanted = float(time)
        nearest = int(np.abs(times - wanted).argmin())
        if abs(times[nearest] - wanted) > 1e-6 * max(abs(wanted), 1e-9):
            raise FoamError(
                f"{self.case} has no time {wanted:g} (it has {times[0]:g} to {times[-1]:g}, {len(times)} times)"
            )
        return folders[nearest]

    def has(self, folder: Path, name: str) -> bool:
        """Whether a time folder holds the field ``name``."""
        return any((folder / (name + end)).exists() for end in ("", ".gz"))

    def field(self, folder: Path, name: str) -> tuple[Array, Array]:
        """Cell values (m,) or (m, 2), boundary-edge values (b,) or (b, 2) of one field.

        An edge of a patch without stored values takes its cell's value (zero gradient).
        """
        from foamlib import FoamFieldFile

        plane = self.mesh.plane
        path = folder / name
        data = FoamFieldFile(path if path.exists() else path.with_name(name + ".gz"))
        count = len(plane.cells)
        try:
            cells = np.asarray(data.internal_field, dtype=float)
            stored = {
                patch: dict(data.boundary_field[patch]) for patch in plane.patches if patch in data.boundary_field
            }
        except (ValueError, KeyError, TypeError) as problem:
            raise FoamError(f"cannot read {path}: {problem}") from None
        vector = cells.shape[-1:] == (3,) and name != "p"
        cells = np.broadcast_to(cells, (count, 3) if vector else (count,))
        if not np.isfinite(cells).all():
            raise FoamError(f"{path} holds values that are not finite: the solution has diverged", log=path)
        faces = cells[plane.owner].copy()
        for index, patch in enumerate(plane.patches):
            entry = stored.get(patch, {})
            members = plane.patch == index
            if entry.get("type") == "noSlip":
                faces[members] = 0.0
            elif "value" in entry:
                values = np.asarray(entry["value"], dtype=float)
                listed = values.ndim > (1 if vector else 0)
                faces[members] = values[self.mesh.slots[members]] if listed else values
        return (cells[:, :2], faces[:, :2]) if vector else (cells, faces)

    def boundary_flux(self, folder: Path, patch: str) -> Array:
        """Volume flux (m3/s) out of the air through the faces of one patch, from OpenFOAM's conserved phi."""
        from foamlib import FoamFieldFile

        entry = FoamFieldFile(folder / "phi").boundary_field[patch]
        count = int(np.count_nonzero(self.mesh.plane.on(patch)))
        return np.broadcast_to(np.asarray(entry["value"], dtype=float), (count,))

    def snapshot(self, folder: Path, suffix: str = "") -> Snapshot:
        """All fields of one time folder; ``suffix`` "Mean" reads OpenFOAM's own averages (of U, p and k)."""
        plane = self.mesh.plane
        velocity, at_faces = self.field(folder, "U" + suffix)
        sliding = self.slip(folder)
        across = (at_faces[sliding] * plane.normals[sliding]).sum(axis=1, keepdims=True)
        at_faces[sliding] -= across * plane.normals[sliding]
        pressure, pressure_faces = self.field(folder, "p" + suffix)
        k = k_faces = dissipation = None
        if self.has(folder, "k" + suffix) and self.eddy_viscosity:
            k, k_faces = self.field(folder, "k" + suffix)
            pressure, pressure_faces = pressure - 2 / 3 * k, pressure_faces - 2 / 3 * k_faces
            if self.has(folder, "epsilon" + suffix):
                dissipation = self.field(folder, "epsilon" + suffix)[0]
            elif self.has(folder, "omega" + suffix):
                dissipation = C_MU * k * self.field(folder, "omega" + suffix)[0]
        return Snapshot(velocity, at_faces, pressure, pressure_faces, k, k_faces, dissipation)

    def slip(self, folder: Path) -> NDArray[np.bool_]:
        """Boundary edges (b,) that the air slides along: symmetry, and patches whose velocity is of type slip."""
        from foamlib import FoamFieldFile

        kinds = FoamFieldFile(folder / "U").boundary_field if (folder / "U").exists() else {}
        names = [name for name in self.mesh.plane.patches if name in kinds and kinds[name].get("type") == "slip"]
        return self.symmetry | self.mesh.plane.on(*names)

    @cached_property
    def eddy_viscosity(self) -> bool:
        """Whether a linear eddy-viscosity model ran, as ``constant/turbulenceProperties`` says (unknown: yes)."""
        if "turbulence" in self.parameters:
            return self.parameters["turbulence"] != "laminar"
        path = self.case / "constant" / "turbulenceProperties"
        return not path.exists() or re.search(r"^\s*simulationType\s+laminar", path.read_text(), re.M) is None

    @cached_property
    def parameters(self) -> dict[str, str]:
        """The parameters of a case written from the template; empty for other cases."""
        path = self.case / "system" / "parameters"
        return dict(re.findall(r"^(\w+)\s+([^;]*);", path.read_text(), re.M)) if path.exists() else {}

    def viscosity(self) -> float:
        """Kinematic viscosity (m2/s) from the parameters or ``constant/transportProperties``."""
        if "nu" in self.parameters:
            return float(self.parameters["nu"])
        from foamlib import FoamFile

        path = self.case / "constant" / "transportProperties"
        try:
            value: Any = FoamFile(path)["nu"]
        except (FileNotFoundError, KeyError):
            raise FoamError(f"{path} gives no nu: a Newtonian fluid is needed") from None
        return float(getattr(value, "value", value))


def read_flow(case_dir: Path | str, time: str | float = "latest", density: float = 1.2) -> dict[str, Any]:
    """Keyword arguments for ``FlowField.from_arrays`` from a one-layer OpenFOAM case.

    ``time``: "latest", a time (s), "mean" (OpenFOAM's UMean of the last time, else the mean over the stored times),
    or "all" (the stored times; a loop of whole shedding periods where the case was made by the time-resolved rung).
    Pressure is OpenFOAM's kinematic p times ``density`` (kg/m3), in Pa, less 2k/3 where a k field and a linear
    eddy-viscosity model are present. Node values are second order up to the walls, see
    :mod:`.reconstruction`; k and the dissipation rate stay within the range of their cells. Raises FoamError
    for a case that is not one layer, decomposed only, or without the asked time.
    """
    fields = CaseFields(Path(case_dir))
    loop = loop_of(fields.case)
    times: Array | None = None
    suffix = ""
    if time in ("mean", "all"):
        folders = [fields.folder(name) for name in loop["times"]] if loop else time_folders(fields.case)
        if time == "mean" and not loop and fields.has(fields.folder("latest"), "UMean"):
            folders, suffix = [fields.folder("latest")], "Mean"
        if not folders:
            fields.folder("latest")
        times = np.array([float(path.name) for path in folders])
    else:
        folders = [fields.folder(time)]
    shots = [fields.snapshot(folder, suffix) for folder in folders]
    arrays = _nodes(fields, folders[0], shots)
    if time == "all" and len(folders) > 1:
        assert times is not None
        arrays["times"] = times - times[0]
        arrays["period"] = loop["period"] if loop else None
        if loop and "motion" in loop:
            arrays["motion"] = [*loop["motion"]["amplitude"], loop["motion"]["omega"], loop["motion"]["phase"]]
    else:
        for name in ("velocity", "pressure", "k", "dissipation"):
            if arrays[name] is not None:
                arrays[name] = arrays[name].mean(axis=0)
    arrays["pressure"] = arrays["pressure"] * density
    arrays["density"] = density
    arrays["viscosity"] = fields.viscosity() * density
    return arrays


def loop_of(case: Path) -> dict[str, Any] | None:
    """What loop.json says: "period" (s), "periods" in it, "begin" (s), "times" (folder names), and "motion" where the
    mesh moves: "amplitude" (x, y) m, "omega" (rad/s), "phase" (rad) at the first time; None without a loop.
    """
    path = case / LOOP
    return json.loads(path.read_text()) if path.exists() else None


def _nodes(fields: CaseFields, folder: Path, shots: Sequence[Snapshot]) -> dict[str, Any]:
    """Node arrays over the snapshots: velocity (t, n, 2), kinematic pressure (t, n), k, dissipation."""
    plane = fields.mesh.plane
    slip = fields.slip(folder)
    wall = fields.wall & ~slip
    nodes = Reconstruction(plane, wall, slip)
    inlet, outlet = _fixed(fields, folder, "U"), _fixed(fields, folder, "p")

    def stack(name: str) -> Array:
        return np.stack([getattr(shot, name) for shot in shots])

    none = np.zeros(len(plane.faces), dtype=bool)
    arrays: dict[str, Any] = {
        "points": plane.points,
        "triangles": triangulate(plane.points, plane.cells),
        "velocity": nodes.vector(stack("velocity"), stack("velocity_faces"), inlet | wall),
        "pressure": nodes.scalar(stack("pressure"), stack("pressure_faces"), outlet),
        "pressure_gradient": None,
        "times": None,
        "period": None,
        "k": None,
        "dissipation": None,
    }
    if shots[0].k is not None:
        arrays["k"] = nodes.scalar(stack("k"), stack("k_faces"), inlet | wall, bounded=True)
    if shots[0].dissipation is not None:
        faces = np.zeros((len(shots), len(plane.faces)))
        arrays["dissipation"] = nodes.scalar(stack("dissipation"), faces, none, bounded=True)
    return arrays


def _fixed(fields: CaseFields, folder: Path, name: str) -> NDArray[np.bool_]:
    """Boundary edges (b,) whose value of a field is prescribed."""
    from foamlib import FoamFieldFile

    kinds = FoamFieldFile(folder / name).boundary_field if (folder / name).exists() else {}
    fixed = ("fixedValue", "noSlip", "movingWallVelocity", "uniformFixedValue", "timeVaryingMappedFixedValue")
    return fields.mesh.plane.on(*(p for p in fields.mesh.plane.patches if p in kinds and kinds[p].get("type") in fixed))
