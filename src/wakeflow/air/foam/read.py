"""Read an OpenFOAM solution into arrays for ``FlowField.from_arrays``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FoamError
from ...core.foam_text import read_entries, text_of
from ...core.lazy import cached_property
from ...core.record import JsonTable
from ...laws.turbulence import FROM_EPSILON, FROM_OMEGA, Dissipation, TurbulenceModel, turbulence_models
from .case import read_parameters
from .polymesh import FoamMesh, read_polymesh
from .reconstruction import Reconstruction, triangulate

# -- The fields of one OpenFOAM case -----------------------------------------------------------------------------------
Array = NDArray[np.float64]
DIMENSIONS = {  # kg, m, s of what an incompressible solver stores
    "U": (0, 1, -1), "p": (0, 2, -2), "k": (0, 2, -2), "omega": (0, 0, -1), "epsilon": (0, 2, -3), "nut": (0, 2, -1),
}  # fmt: skip
READ = {*DIMENSIONS, "phi", "transportProperties", "physicalProperties", "turbulenceProperties", "momentumTransport"}
NU = (0, 2, -1, 0, 0, 0, 0)
NUMBER = re.compile(r"[0-9]+(\.[0-9]*)?(e[+-]?[0-9]+)?", re.I)  # the name of a time folder


def every_time(case: Path) -> list[Path]:
    """The case's time folders in order of time, whole or not; 0 is left out."""
    result = [path for path in case.iterdir() if path.is_dir() and NUMBER.fullmatch(path.name)] if case.is_dir() else []
    return sorted((path for path in result if float(path.name) > 0), key=lambda path: float(path.name))


def time_folders(case: Path) -> list[Path]:
    """The time folders that :func:`every_time` finds and that hold a velocity."""
    return [path for path in every_time(case) if any((path / name).exists() for name in ("U", "U.gz"))]


@dataclass(frozen=True)
class Snapshot:
    """One time of a case by name, at the ``cells`` and on the ``faces``, its boundary edges: velocity (m, 2) and (b, 2)
    m/s, kinematic static pressure (m2/s2) and, as far as they are stored, k (m2/s2), and its dissipation (m2/s3) at the
    cells alone.

    The pressure is OpenFOAM's p minus 2k/3, which its linear eddy-viscosity models leave in p. On the edges of no-slip
    walls it is p itself: k is 0 there. There k is what OpenFOAM stores, its wall function's value, that of the air
    beside the wall.
    """

    cells: dict[str, Array]
    faces: dict[str, Array]


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Raise FoamError, with the file's name, for what cannot be made a number of, or opened."""
    try:
        yield
    except FoamError:
        raise
    except (ValueError, LookupError, TypeError, AttributeError) as problem:
        why = str(problem) or type(problem).__name__
        raise FoamError(f"cannot read {path}: {why}; write it anew", log=path) from None
    except OSError as problem:
        raise FoamError(f"cannot read {path}: {problem.strerror or problem}", log=path) from None


def _said(path: Path, *keys: str) -> dict[str, Any]:
    """What a file of OpenFOAM's says under the ``keys``, by default under all."""
    from foamlib import FoamFile

    with _reading(path):
        entries, _ = read_entries(path)
        wanted = {key: entries[key] for key in ("FoamFile", *(keys or entries)) if key in entries}
        return dict(FoamFile.loads(text_of(wanted).encode("latin-1")))


class CaseFields:
    """The fields of one case folder. Raises FoamError for a case that is three-dimensional or only decomposed."""

    def __init__(self, case: Path) -> None:
        self.case = Path(case)
        if not time_folders(self.case) and (self.case / "processor0").is_dir():
            raise FoamError(f"{self.case} is decomposed: run reconstructPar in it first")
        if not self.parameters:
            self._check_what_lies_beside()
        self.mesh: FoamMesh = read_polymesh(self.case)
        plane = self.mesh.plane
        self.wall = plane.on(*(name for name, kind in self.mesh.types.items() if kind == "wall"))
        self.symmetry = plane.on(*(n for n, kind in self.mesh.types.items() if kind in ("symmetry", "symmetryPlane")))

    def _check_what_lies_beside(self) -> None:
        """Raise FoamError where a case of the user's holds later times in parts, or a mesh for each of its times."""
        times = time_folders(self.case)
        last = float(times[-1].name) if times else 0.0
        for part in sorted(self.case.glob("processor*")):
            if (later := time_folders(part)) and float(later[-1].name) > last:
                raise FoamError(f"{part} goes on to {later[-1].name}: run reconstructPar, or remove it")
        if moved := next((time for time in times if any((time / "polyMesh").glob("points*"))), None):
            raise FoamError(f"{moved / 'polyMesh'}: the mesh changes in time; one that stays is needed")

    def folder(self, time: str | float) -> Path:
        """The time folder called or nearest to ``time``. Raises FoamError naming those that are there."""
        folders = time_folders(self.case)
        if not folders:
            raise FoamError(f"{self.case} holds no solved time: run its solver, or rename 0 to 1 if that is a solution")
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
        plane, path, count = self.mesh.plane, folder / name, len(self.mesh.plane.cells)
        data = _said(path, "dimensions", "internalField")
        with _reading(path):
            cells, said = np.asarray(data["internalField"], dtype=float), data.get("dimensions")
        if (
            (known := DIMENSIONS.get(name.removesuffix("Mean")))
            and said is not None
            and tuple(said) != (*known, 0, 0, 0, 0)
        ):
            raise FoamError(
                f"{path} has dimensions {list(map(int, said))}, not {[*known, 0, 0, 0, 0]}; an incompressible solver's "
                "are needed: divide a pressure in Pa by the density", log=path,
            )  # fmt: skip
        vector = cells.ndim > 0 and cells.shape[-1:] == (3,) and name.removesuffix("Mean") == "U"
        shape = (count, 3) if vector else (count,)
        if cells.shape not in (shape, shape[1:]):
            raise FoamError(f"{path} holds {len(cells)} values for {count} cells: it is of another mesh", log=path)
        cells = np.broadcast_to(cells, shape)
        stored = self.boundary(folder, name)
        if not np.isfinite(cells).all():
            raise FoamError(f"{path} holds values that are not finite: the solution has diverged", log=path)
        faces = cells[plane.owner].copy()
        for index, patch in enumerate(plane.patches):
            entry = stored[patch]
            members = plane.patch == index
            if entry.get("type") == "noSlip":
                faces[members] = 0.0
            elif "value" in entry and not (isinstance(entry["value"], str) and entry["value"] == "$internalField"):
                with _reading(path):
                    values = np.asarray(entry["value"], dtype=float)
                listed = values.ndim > (1 if vector else 0)
                if listed and len(values) != np.count_nonzero(members):
                    raise FoamError(f"{path}: {patch} has {len(values)} values: it is of another mesh", log=path)
                faces[members] = values[self.mesh.slots[members]] if listed else values
        return (cells[:, :2], faces[:, :2]) if vector else (cells, faces)

    def boundary(self, folder: Path, name: str, *patches: str) -> dict[str, dict[str, Any]]:
        """What a field's file says of the ``patches``, by default of all: under its name, else a group of it, else the
        last pattern that it matches, as OpenFOAM reads it.

        Raises FoamError where the file says nothing of a patch.
        """
        result, path = {}, folder / name
        said = _said(path, "boundaryField").get("boundaryField", {})
        for patch in patches or self.mesh.plane.patches:
            groups = [key for key in said if key in self.mesh.groups[patch]]
            patterns = [key for key in said if key[:1] == '"' and re.fullmatch(key.strip('"'), patch)]
            key = patch if patch in said else next(iter((*groups, *reversed(patterns))), None)
            if key is None:
                raise FoamError(f"{path} has no condition for the patch {patch}", log=path)
            result[patch] = said[key]
        return result

    def boundary_flux(self, folder: Path, patch: str) -> Array:
        """Volume flux (m3/s) out of the air through the faces of one patch, from OpenFOAM's conserved phi."""
        count = int(np.count_nonzero(self.mesh.plane.on(patch)))
        with _reading(folder / "phi"):
            values = np.asarray(self.boundary(folder, "phi", patch)[patch]["value"], dtype=float)
            return np.broadcast_to(values, (count,))

    def snapshot(self, folder: Path, suffix: str = "") -> Snapshot:
        """All fields of one time folder; ``suffix`` "Mean" reads OpenFOAM's own averages (of U, p and k)."""
        plane = self.mesh.plane
        for name in ("U", "p", "k"):
            if not self.has(folder, name + suffix) and self.has(folder, name):
                cure = f"add {name} to its fieldAverage" if suffix else "run the solver to its end"
                raise FoamError(f"{folder} has no {name}{suffix}: {cure}, or take another time than the mean")
        velocity, at_faces = self.field(folder, "U" + suffix)
        sliding = self.slip(folder)
        across = (at_faces[sliding] * plane.normals[sliding]).sum(axis=1, keepdims=True)
        at_faces[sliding] -= across * plane.normals[sliding]
        pressure, pressure_faces = self.field(folder, "p" + suffix)
        cells, faces = {"velocity": velocity}, {"velocity": at_faces}
        if self.has(folder, "k" + suffix) and self.eddy_viscosity:
            k, k_faces = self.field(folder, "k" + suffix)
            at_rest = self.wall & ~sliding
            pressure, pressure_faces = pressure - 2 / 3 * k, pressure_faces - 2 / 3 * np.where(at_rest, 0.0, k_faces)
            cells["k"], faces["k"] = k, k_faces
            stored = (law for law in self._dissipations() if self.has(folder, law.field + suffix))
            if law := next(stored, None):
                cells["dissipation"] = law.rate(k, self.field(folder, law.field + suffix)[0])
        return Snapshot({**cells, "pressure": pressure}, {**faces, "pressure": pressure_faces})

    def slip(self, folder: Path) -> NDArray[np.bool_]:
        """Boundary edges (b,) that the air slides along: symmetry, and patches whose velocity is of type slip."""
        kinds = self.boundary(folder, "U")
        return self.symmetry | self.mesh.plane.on(*(name for name in kinds if kinds[name].get("type") == "slip"))

    @cached_property
    def eddy_viscosity(self) -> bool:
        """Whether a linear eddy-viscosity model ran, as ``constant/turbulenceProperties`` says (unknown: yes)."""
        if "turbulence" in self.parameters:
            return self.model is None or self.model.turbulent
        return self._properties("turbulenceProperties", "momentumTransport")[1].get("simulationType") != "laminar"

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

    def _properties(self, *names: str) -> tuple[Path, dict[str, Any]]:
        """The first of the files ``constant/NAME`` that is there, and what it says."""
        places = [self.case / "constant" / name for name in names]
        path = next((path for path in places if path.exists()), places[0])
        return path, _said(path) if path.exists() else {}

    def viscosity(self) -> float:
        """Kinematic viscosity (m2/s) from the parameters, or from ``constant/transportProperties``, which OpenFOAM of
        the Foundation calls ``physicalProperties`` from version 10 on.
        """
        if "nu" in self.parameters:
            return float(self.parameters["nu"])
        path, said = self._properties("transportProperties", "physicalProperties")
        value: Any = said.get("nu")
        model = said.get("transportModel", said.get("viscosityModel", "Newtonian"))
        if value is None or model not in ("Newtonian", "constant"):
            raise FoamError(f"{path} gives no nu of a Newtonian fluid, which is needed")
        with _reading(path):
            if tuple(getattr(value, "dimensions", NU)) != NU:
                raise FoamError(f"{path}: nu has dimensions {list(map(int, value.dimensions))}, not {list(NU)}")
            return float(getattr(value, "value", value))


# -- Read an OpenFOAM solution into arrays for ``FlowField.from_arrays`` -----------------------------------------------
LOOP = "loop.json"  # what a time-resolved airflow keeps: {"period": s, "times": [names of time folders]}
STATES = "states.json"  # what a steady airflow that does not settle keeps: {"begin": iteration, "states": [names]}


def read_flow(case_dir: Path | str, time: str | float = "latest", density: float = 1.2) -> dict[str, Any]:
    """Keyword arguments for ``FlowField.from_arrays`` from a one-layer OpenFOAM case.

    ``time``: "latest", a time (s), "mean" (OpenFOAM's UMean of the last time, else the mean over the stored times),
    "all" (the stored times; a loop of whole shedding periods where the case was made by the time-resolved rung), or
    "states" (:func:`late_states`, against iterations; their mean is then what "mean" gives).
    Pressure is OpenFOAM's kinematic p times ``density`` (kg/m3), in Pa, less 2k/3 where a k field and a linear
    eddy-viscosity model are present; at a no-slip wall k = 0, and it is p itself. Node values are second order up to
    the walls, see :mod:`.reconstruction`; k off such walls and the dissipation rate stay within the range of their
    cells. Raises FoamError for a case that is not one layer, decomposed only, or without the asked time.
    """
    fields = CaseFields(Path(case_dir))
    loop = loop_of(fields.case)
    folders, suffix = _folders_of(fields, time, loop)
    shots = [fields.snapshot(folder, suffix) for folder in folders]
    nodes = nodes_of(fields, folders[0], shots)
    if time not in ("all", "states") or len(folders) == 1:
        return flow_arrays(fields, mean_of(nodes), density)
    clock = np.array([float(path.name) for path in folders])
    flow = {**flow_arrays(fields, nodes, density), "times": clock - clock[0]}
    if loop:
        flow["period"] = loop["period"]
        if motion := loop.get("motion"):
            flow["motion"] = [*motion["amplitude"], motion["omega"], motion["phase"]]
    return flow


def flow_arrays(fields: CaseFields, nodes: Mapping[str, Array], density: float) -> dict[str, Any]:
    """The arrays at the ``nodes`` of a case and what is beside them, in air of ``density`` (kg/m3)."""
    points, cells = fields.mesh.plane.points, fields.mesh.plane.cells
    about = {"points": points, "triangles": triangulate(points, cells), "density": density}
    return {**about, **nodes, "pressure": nodes["pressure"] * density, "viscosity": fields.viscosity() * density}


def _folders_of(fields: CaseFields, time: str | float, loop: JsonTable) -> tuple[list[Path], str]:
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


def loop_of(case: Path) -> JsonTable:
    """What loop.json says: "period" (s), "periods" in it, "begin" (s), "times" (folder names), and "motion" where the
    mesh moves: "amplitude" (x, y) m, "omega" (rad/s), "phase" (rad) at the first time; empty without a loop.
    """
    path = case / LOOP
    return dict(json.loads(path.read_text())) if path.exists() else {}


def late_states(case: Path) -> list[str]:
    """The time folders, in order, that a steady airflow which does not settle keeps: iterations spread over its
    oscillation, each of which ``read_flow`` and ``FlowField.from_openfoam`` take as a ``time``; empty for others.
    """
    path = case / STATES
    return list(json.loads(path.read_text())["states"]) if path.exists() else []


def mean_of(nodes: Mapping[str, Array]) -> dict[str, Array]:
    """The mean over the snapshots of :func:`nodes_of`."""
    return {name: np.asarray(values.mean(axis=0)) for name, values in nodes.items()}


def nodes_of(fields: CaseFields, folder: Path, shots: Sequence[Snapshot]) -> dict[str, Array]:
    """What the t snapshots hold, at the nodes: velocity (t, n, 2) m/s, kinematic pressure and k (t, n) m2/s2, and the
    dissipation of k (t, n) m2/s3; ``folder`` tells which boundary values are prescribed.
    """
    plane = fields.mesh.plane
    slip = fields.slip(folder)
    wall = fields.wall & ~slip
    nodes = Reconstruction(plane, wall, slip)
    inlet, outlet = _fixed(fields, folder, "U"), _fixed(fields, folder, "p")
    cells = {name: np.stack([shot.cells[name] for shot in shots]) for name in shots[0].cells}
    faces = {name: np.stack([shot.faces[name] for shot in shots]) for name in shots[0].faces}
    result = {"pressure": nodes.scalar(cells["pressure"], faces["pressure"], outlet)}
    if "k" in cells:
        at_rest = np.unique(plane.faces[wall])
        result["pressure"][:, at_rest] += 2 / 3 * nodes.scalar(cells["k"], faces["k"], outlet)[:, at_rest]
        result["k"] = nodes.scalar(cells["k"], faces["k"], inlet & ~wall, bounded=True)
        result["k"][:, at_rest] = 0.0
    if "dissipation" in cells:
        none = np.zeros(len(plane.faces), dtype=bool)
        result["dissipation"] = nodes.scalar(cells["dissipation"], np.zeros_like(faces["k"]), none, bounded=True)
    return {**result, "velocity": nodes.vector(cells["velocity"], faces["velocity"], inlet | wall)}


def _fixed(fields: CaseFields, folder: Path, name: str) -> NDArray[np.bool_]:
    """Boundary edges (b,) whose value of a field is prescribed."""
    kinds = fields.boundary(folder, name)
    fixed = ("fixedValue", "noSlip", "movingWallVelocity", "uniformFixedValue", "timeVaryingMappedFixedValue")
    return fields.mesh.plane.on(*(p for p in kinds if kinds[p].get("type") in fixed))
