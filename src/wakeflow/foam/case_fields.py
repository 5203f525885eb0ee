"""The fields of one OpenFOAM case: values at cells and on boundary edges, time by time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError
from ..core.lazy import cached_property
from ..laws.turbulence_models import FROM_EPSILON, FROM_OMEGA, Dissipation, TurbulenceModel, turbulence_models
from .case import read_parameters
from .polymesh import FoamMesh, read_polymesh

__all__ = ["CaseFields", "Snapshot", "time_folders"]

Array = NDArray[np.float64]


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

    ``pressure`` is OpenFOAM's p minus 2k/3, which its linear eddy-viscosity models leave in p. On the edges of no-slip
    walls it is p itself: k is 0 there. ``k_faces`` holds what OpenFOAM stores, on walls its wall function's value, that
    of the air beside the wall.
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
            at_rest = self.wall & ~sliding
            pressure, pressure_faces = pressure - 2 / 3 * k, pressure_faces - 2 / 3 * np.where(at_rest, 0.0, k_faces)
            stored = (law for law in self._dissipations() if self.has(folder, law.field + suffix))
            if law := next(stored, None):
                dissipation = law.rate(k, self.field(folder, law.field + suffix)[0])
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
            return self.model is None or self.model.turbulent
        path = self.case / "constant" / "turbulenceProperties"
        return not path.exists() or re.search(r"^\s*simulationType\s+laminar", path.read_text(), re.M) is None

    @cached_property
    def model(self) -> TurbulenceModel | None:
        """The turbulence model of a case written from the template; None for other cases and for unknown models."""
        name = self.parameters.get("turbulence")
        return turbulence_models[name] if name is not None and name in turbulence_models else None

    def _dissipations(self) -> Sequence[Dissipation]:
        """How the rate may follow from what is stored: as the model says; either way where the model is unknown."""
        if self.model is not None and self.model.dissipation is not None:
            return (self.model.dissipation,)
        return (FROM_EPSILON, FROM_OMEGA)

    @cached_property
    def parameters(self) -> dict[str, str]:
        """The parameters of a case written from the template; empty for other cases."""
        return read_parameters(self.case)

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
