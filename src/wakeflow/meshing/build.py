"""From a mesh spec to mesh files, through Gmsh in a process of its own."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from ..core.errors import MeshError, known
from ..core.process import call_in_child
from ..core.record import save
from .quality import MeshReport, read_mesh, report_on, write_vtu
from .spec import MeshSpec

__all__ = ["build_mesh"]

MIN_ANGLE = 12.0  # degrees: a smaller one in a 2D cell is refused. Chosen


def build_mesh(spec: MeshSpec, folder: Path, *, timeout: float = 300.0) -> MeshReport:
    """Write ``mesh.msh`` (one layer, MSH 2.2), ``mesh.vtu`` (2D) and ``mesh.json`` (the report) into ``folder``.

    Raises MeshError when Gmsh fails, does not end within ``timeout`` (s), or a 2D cell has an angle below 12 degrees.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.gmsh"
    partial = folder / "partial.msh"
    argument = {"spec": asdict(spec), "path": str(partial)}
    call_in_child(
        "wakeflow.meshing.gmsh_child:mesh_in_this_process", argument, log=log, timeout=timeout, error=MeshError
    )
    points, cells, boundary = read_mesh(partial)
    report = report_on(points, cells, boundary)
    missing = sorted(set(spec.patches) - {"front", "back"} - set(boundary))
    if missing:
        raise MeshError(f"the mesh has no edges on: {', '.join(missing)}; log: {log}", log=log)
    if (sharpest := known(report.min_angle)) < MIN_ANGLE:
        raise MeshError(
            f"the mesh has a cell with an angle of {sharpest:.1f} degrees (at least {MIN_ANGLE:g} needed): "
            f"check the outlines for near-coincident corners; log: {log}",
            log=log,
        )
    write_vtu(points, cells, folder / "mesh.vtu")
    save(folder / "mesh.json", report)
    partial.replace(folder / "mesh.msh")
    return report
