"""From a mesh file to an OpenFOAM case that is ready to run: written, converted, checked."""

from __future__ import annotations

import re
from pathlib import Path

from ...core.errors import FoamError, MeshError
from ...core.process import tail
from ...core.record import load, save
from .airflow_result import CheckMesh
from .case import INSTALL, FlowSpec, set_patch_types, write_case, write_inlets
from .programs import call

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
