"""What a run starts from: a case with a checked mesh, another case's solution, a push where it does not shed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FoamError, MeshError
from ...core.files import atomic_write
from ...core.process import tail
from ...core.record import load, save
from .airflow_result import CheckMesh
from .case import INSTALL, FlowSpec, set_patch_types, write_case, write_inlets
from .polymesh import read_polymesh
from .programs import call
from .read import CaseFields, loop_of

# -- From a mesh file to a case that is ready to run: written, converted, checked --------------------------------------
CHECKED = "mesh_check.json"  # in the case: what checkMesh found


def prepare_case(spec: FlowSpec, msh: Path, folder: Path) -> CheckMesh:
    """Write the case, convert ``msh`` and check it. Does nothing but read the result when it was done before.

    Raises MeshError naming the checks that failed, FoamError when OpenFOAM is not installed or cannot read the mesh.
    """
    if re.search(r"[\s'\"]", str(folder.resolve())):
        raise FoamError(
            f"OpenFOAM cannot work below a folder with blanks or quotes in its name: {folder.resolve()}; "
            "set WAKEFLOW_CACHE to another folder"
        )
    write_case(spec, folder)
    done = folder / CHECKED
    if done.exists():
        return load(CheckMesh, done)
    made = call(folder, ["gmshToFoam", str(msh.resolve())])
    if not (folder / "constant" / "polyMesh" / "boundary").exists():
        said = f"gmshToFoam ended well and wrote no mesh; is it OpenFOAM's? {INSTALL}; log: {made.log}"
        raise FoamError(said, command="gmshToFoam", log=made.log, tail=tail(made.log))
    set_patch_types(folder, walls=spec.mesh.walls)
    write_inlets(spec, folder)
    log = folder / "log.checkMesh"
    log.unlink(missing_ok=True)
    call(folder, ["checkMesh"])
    text = log.read_text()
    failed = re.findall(r"^\s*\*\*\*(.*)$", text, re.M)
    if failed or "Mesh OK" not in text:
        named = "; ".join(" ".join(line.split()) for line in failed) or "it did not say Mesh OK"
        raise MeshError(f"OpenFOAM refuses the mesh: {named}; log: {log}", command="checkMesh", log=log, tail=tail(log))
    check = CheckMesh(
        non_orthogonality=_number(r"non-orthogonality Max: (\S+)", text),
        mean_non_orthogonality=_number(r"non-orthogonality Max: \S+ average: (\S+)", text),
        skewness=_number(r"Max skewness = (\S+)", text),
    )
    save(done, check)
    return check


def _number(pattern: str, text: str) -> float:
    match = re.search(pattern, text)
    if match is None:
        raise FoamError(f"checkMesh's output lacks {pattern!r}: is this OpenFOAM 1912?")
    return float(match[1])


# -- From another case's solution, or a uniform stream -----------------------------------------------------------------
Array = NDArray[np.float64]
# Chosen: the vortex is a push that every wake forgets, no part of the result.
PUSH = 1.0  # peak speed of the vortex that sets off the shedding, over the inlet speed
BEHIND = 0.75  # widths from the first body's rear to the middle of the vortex
REACH = 0.5  # widths, radius of the vortex: its speed falls as r exp(-r^2) in this unit
CENTRE_ROUNDING = 1e-7  # of the first body's width: nearer cell centres are those of one mesh, as OpenFOAM writes them
FIRST_STEP = 0.2  # of a corner cell that the incoming air crosses in the first time step


def start_in_time(spec: FlowSpec, folder: Path, source: Path | None) -> None:
    """Begin a time-resolved run from case ``source`` or a uniform flow, pushed (:func:`perturb`) unless it sheds."""
    start_from(spec, folder, source)
    if source is None or not loop_of(source):
        perturb(spec, folder)


def start_from(spec: FlowSpec, folder: Path, source: Path | None) -> None:
    """Interpolate the latest fields of case ``source``, or those at the begin of its loop (phase zero of a vibration),
    onto the cells of ``folder``; without a source the flow starts uniform.

    A half domain is mirrored about x = 0 first. A source written from the template may have another speed, size or
    direction: lengths scale with the first body's width, U with the inlet speed, p with its square, turbulent fields by
    their units; a field that it lacks keeps its inlet value, as boundaries do. Linear between cell centres, the nearest
    cell's value outside them. Nothing but numbers is taken from the source, which may have come from others.
    """
    if source is None:
        return
    fields = CaseFields(source)
    moment = fields.folder((loop_of(source) or {"times": ["latest"]})["times"][0])
    given = fields.parameters
    speed = spec.speed / float(given.get("inletSpeed", spec.speed))
    size = spec.mesh.projected_width / float(given.get("bodyWidth", spec.mesh.projected_width))
    turned = np.sign(float(given.get("flowDirection", f"(0 {spec.along} 0)").strip("()").split()[1]) * spec.along)
    factors: dict[str, float | Array] = {"U": speed * np.array([1.0, turned]), "p": speed**2}
    factors |= {field.name: field.rescaled(speed, size) for field in spec.transported}
    target = read_polymesh(folder).plane.centres
    centres = fields.mesh.plane.centres * (size, size * turned)
    alike = (
        centres.shape == target.shape and np.abs(centres - target).max() <= CENTRE_ROUNDING * spec.mesh.projected_width
    )
    half = "axis" in fields.mesh.plane.patches and not alike
    if half:
        centres = np.vstack([centres, centres * (-1.0, 1.0)])
    result: dict[str, Array] = {}
    for name, factor in factors.items():
        if not fields.has(moment, name) or not (folder / "0" / name).exists():
            continue
        values = fields.field(moment, name)[0] * factor
        if half:
            values = np.concatenate([values, values * (-1.0, 1.0) if name == "U" else values])
        result[name] = values
    for name, values in (result if alike or not result else _interpolated(centres, result, target)).items():
        write_internal(folder / "0" / name, values)


def first_step(spec: FlowSpec) -> float:
    """The first time step (s) of a time-resolved run."""
    return FIRST_STEP * spec.mesh.h_corner / spec.speed


def perturb(spec: FlowSpec, folder: Path) -> None:
    """Add a vortex, free of divergence, behind the first body: peak speed PUSH times U, at BEHIND, as wide as REACH."""
    centres = read_polymesh(folder).plane.centres
    velocity = _read_start(spec, folder, len(centres))
    outline = np.array(spec.mesh.bodies[0])
    size = spec.mesh.projected_width
    rear = float((spec.along * outline[:, 1]).max()) + BEHIND * size
    offset = (centres - (outline[:, 0].min() + 0.5 * size, spec.along * rear)) / (REACH * size)
    swirl = np.exp(0.5 - (offset**2).sum(axis=1)) * np.sqrt(2.0)  # r exp(-r^2) peaks at 1/sqrt(2 e)
    velocity += PUSH * spec.speed * swirl[:, None] * np.column_stack([-offset[:, 1], offset[:, 0]])
    write_internal(folder / "0" / "U", velocity)


def _read_start(spec: FlowSpec, folder: Path, count: int) -> Array:
    text = (folder / "0" / "U").read_text()
    match = re.search(r"internalField\s+nonuniform[^(]*\((.*?)\n\);", text, re.S)
    if match is None:
        return np.tile([0.0, spec.along * spec.speed], (count, 1))
    words = match[1].replace("(", " ").replace(")", " ").split()
    return np.array(words, dtype=float).reshape(-1, 3)[:, :2]


def _interpolated(centres: Array, fields: dict[str, Array], target: Array) -> dict[str, Array]:
    """The ``fields`` at the ``target`` points: all by one triangulation, whose making and searching is what costs."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import cKDTree

    columns = [values.reshape(len(centres), -1) for values in fields.values()]
    known = np.hstack(columns)
    result = LinearNDInterpolator(centres, known)(target)
    outside = np.isnan(result).any(axis=1)
    result[outside] = known[cKDTree(centres).query(target[outside])[1]]
    parts = np.split(result, np.cumsum([column.shape[1] for column in columns])[:-1], axis=1)
    return {
        name: part.reshape(-1, *values.shape[1:]) for (name, values), part in zip(fields.items(), parts, strict=True)
    }


def write_internal(path: Path, values: Array) -> None:
    """Replace a field's internalField by one value (n,) or vector (n, 2) or (n, 3) a cell."""
    if values.ndim == 2:
        whole = np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
        kind, rows = "vector", "\n".join(f"({x:.10g} {y:.10g} {z:.10g})" for x, y, z in whole)
    else:
        kind, rows = "scalar", "\n".join(f"{value:.10g}" for value in values)
    entry = f"internalField   nonuniform List<{kind}>\n{len(values)}\n(\n{rows}\n);"
    text = re.sub(
        r"internalField\s+(uniform[^;]*|nonuniform.*?\n\));", lambda _: entry, path.read_text(), count=1, flags=re.S
    )
    with atomic_write(path) as stream:
        stream.write(text)
