"""A user's own OpenFOAM case: is it of the scene, and what is its airflow in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.foam_text import read_entries
from ...core.geometry import distance_to, distance_to_edges
from ...core.number import Number
from ...core.record import JsonTable
from ...laws.turbulence import NUT
from .airflow_result import AirflowResult
from .case import FlowSpec
from .measure import Edges, motion_in, plane_numbers
from .read import READ, CaseFields, Snapshot, loop_of, read_flow, time_folders
from .reconstruction import PlaneMesh

Array = NDArray[np.float64]
MATCH = 0.01  # widths of the first body: how far the case's walls may lie from the scene's outlines; viscosities too
SPEED_MISMATCH = 0.05  # how far the speed that enters the case may lie from the scene's
ALONG = 0.9  # cosine: an opening counts as an end of the channel where the air crosses it so straight


def case_files(case: Path, time: str) -> list[Path]:
    """Everything of a case that its airflow depends on: mesh, properties, the times that are read, and what these
    include.
    """
    times = time_folders(case)
    chosen = times[-1:] if time == "latest" else times
    extra = [case / "system" / "parameters", case / "loop.json"]
    taken = list[Path]()
    for path in (item for folder in (case / "constant", *chosen) for item in folder.iterdir()):
        if path.name.removesuffix(".gz").removesuffix("Mean") in READ:
            taken += read_entries(path)[1]
    return [case / "constant", *(path for path in extra if path.exists()), *chosen, *taken]


def measure_given(spec: FlowSpec, case: Path, time: str) -> AirflowResult:
    """What a given case says of its airflow; verdict "given".

    ``spec`` holds the scene's bodies, channel and air; ``time``: "latest", "mean" or "all", as for ``read_flow``. Cd is
    from pressure and friction on the bodies' walls. Raises SceneError where the case is not of the scene: bodies,
    channel, speed, direction or viscosity differ.
    """
    fields = CaseFields(case)
    plane = fields.mesh.plane
    half = bool(plane.points[:, 0].min() > -1e-6 * spec.mesh.width)
    spec = replace(spec, mesh=replace(spec.mesh, half=half))
    wall = _inner(plane)
    _check_channel(spec, plane)
    _check_bodies(spec, plane, wall)
    loop = loop_of(case)
    cycle = loop if time == "all" else {}
    return AirflowResult(
        stepping="given",
        verdict="given",
        **_from_fields(spec, fields, _chosen_times(fields, time, loop), time, wall),
        field_time=time,
        period=cycle.get("period", np.nan),
        motion=motion_in(loop),
        loop_mismatch=cycle.get("mismatch", np.nan),
        half=half,
    )


def _chosen_times(fields: CaseFields, time: str, loop: JsonTable) -> list[Path]:
    """The time folders that "latest", "mean" or "all" means."""
    if time == "latest":
        return [fields.folder("latest")]
    return [fields.folder(name) for name in loop["times"]] if loop else time_folders(fields.case)


def _from_fields(
    spec: FlowSpec, fields: CaseFields, folders: list[Path], time: str, wall: NDArray[np.bool_]
) -> JsonTable:
    """What the stored fields say, None for what they do not. Raises SceneError where the air is not the scene's."""
    plane = fields.mesh.plane
    shots = [fields.snapshot(folder) for folder in folders]
    outward = _outward(fields, folders, shots)
    inlet, outlet = _ends(spec, plane, outward)
    inflow = -float(outward[outward < 0].sum())
    _check_air(spec, fields, -float(outward[inlet].sum() / plane.lengths[inlet].sum()))
    drag = [_drag(spec, fields, folder, shot, wall) for folder, shot in zip(folders, shots, strict=True)]
    flow = read_flow(fields.case, "latest" if time == "latest" else "mean", density=1.0)
    result, base = plane_numbers(spec, fields, folders[-1], shots, flow, Edges(inlet, outlet, wall))
    return {
        "turbulence": "given" if "k" in shots[0].cells else "laminar",
        "cells": len(plane.cells),
        "reynolds": spec.reynolds,
        "cd": Number(float(np.mean(drag))),
        "cp_base": Number(base),
        "flow_rate": inflow * (2.0 if spec.mesh.half else 1.0),
        "mass_error": float(-outward.sum()) / inflow,
        **result,
    }


def _inner(plane: PlaneMesh) -> NDArray[np.bool_]:
    """Boundary edges (b,) off the mesh's bounding box: those of what is in the channel."""
    low, high = plane.points.min(axis=0), plane.points.max(axis=0)
    slack = 1e-6 * (high - low)
    ends = plane.points[plane.faces]
    on_side = (np.abs(ends - low) < slack).all(axis=1) | (np.abs(ends - high) < slack).all(axis=1)
    return np.asarray(~on_side.any(axis=1))


def _check_channel(spec: FlowSpec, plane: PlaneMesh) -> None:
    mesh, (left, low), (right, high) = spec.mesh, plane.points.min(axis=0), plane.points.max(axis=0)
    left = -right if mesh.half else left
    slack = MATCH * mesh.projected_width
    if left > -mesh.width / 2 + slack or right < mesh.width / 2 - slack:
        raise SceneError(
            f"channel.width = {mesh.width:g} m reaches beyond the mesh of air.case, x from {left:.4g} to {right:.4g} m"
        )
    if low > mesh.bottom + slack or high < mesh.top - slack:
        raise SceneError(
            f"channel.bottom = {mesh.bottom:g} to channel.top = {mesh.top:g} m reaches beyond the mesh of air.case, "
            f"y from {low:.4g} to {high:.4g} m"
        )


def _check_bodies(spec: FlowSpec, plane: PlaneMesh, wall: NDArray[np.bool_]) -> None:
    """Check that every corner of a body lies on a wall of the case, and every wall in the channel on a body."""
    slack = MATCH * spec.mesh.projected_width
    nodes = plane.points[np.unique(plane.faces[wall])]
    outlines = [np.array(outline) for outline in spec.mesh.bodies]
    away = np.min([distance_to(nodes, outline) for outline in outlines], axis=0, initial=np.inf)
    if len(nodes) == 0 or away.max() > slack:
        where = "" if len(nodes) == 0 else " at x = {:.4g}, y = {:.4g} m".format(*nodes[away.argmax()])
        what = "has no body in the channel" if len(nodes) == 0 else f"has a wall{where} where no body of the scene is"
        raise SceneError(f"air.case {what}; the outlines of [body] must be those of the case")
    start, end = (plane.points[plane.faces[wall, i]] for i in (0, 1))
    for name, outline in zip(spec.mesh.names, outlines, strict=True):
        corners = outline[outline[:, 0] >= 0] if spec.mesh.half else outline
        gap = distance_to_edges(corners, start, end)
        if gap.max() > slack:
            x, y = corners[gap.argmax()]
            raise SceneError(f"air.case has no wall at x = {x:.4g}, y = {y:.4g} m, where body.{name} has a corner")


def _outward(fields: CaseFields, folders: Sequence[Path], shots: Sequence[Snapshot]) -> Array:
    """Volume flow (b,) m2/s out of the air through every boundary edge, mean of the times; conserved phi where there is
    one.
    """
    plane, total = fields.mesh.plane, []
    for folder, shot in zip(folders, shots, strict=True):
        flow = (shot.faces["velocity"] * plane.normals).sum(axis=1) * plane.lengths
        flow[fields.wall | fields.symmetry] = 0.0
        for patch in plane.patches if fields.has(folder, "phi") else ():
            chosen = plane.on(patch) & ~(fields.wall | fields.symmetry)
            if chosen.any():
                flow[chosen] = fields.boundary_flux(folder, patch) / fields.mesh.thickness
        total.append(flow)
    return np.asarray(np.mean(total, axis=0))


def _ends(spec: FlowSpec, plane: PlaneMesh, outward: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Boundary edges (b,) of the main inlet and of the outlet: where air crosses the channel's ends."""
    straight = spec.along * plane.normals[:, 1]
    inlet, outlet = (outward < 0) & (straight < -ALONG), (outward > 0) & (straight > ALONG)
    if not inlet.any() or not outlet.any():
        raise SceneError(
            f"air.direction = {spec.mesh.direction!r}: the air of air.case does not enter and leave that way"
        )
    return inlet, outlet


def _check_air(spec: FlowSpec, fields: CaseFields, speed: float) -> None:
    if abs(speed / spec.speed - 1.0) > SPEED_MISMATCH:
        raise SceneError(f"air.speed = {spec.speed:g} m/s, but {speed:.4g} m/s enter in air.case")
    viscosity = fields.viscosity() * spec.density
    if abs(viscosity / spec.viscosity - 1.0) > MATCH:
        raise SceneError(
            f"air.viscosity = {spec.viscosity:.4g} Pa s, but air.case has {viscosity:.4g} Pa s at this density"
        )


def _drag(spec: FlowSpec, fields: CaseFields, folder: Path, shot: Snapshot, wall: NDArray[np.bool_]) -> float:
    """Cd of all bodies: p as OpenFOAM has it, static at walls (k = 0), and nu_eff u / y of the cells at them, which is
    what the solver's momentum equation hands to a wall (0.4 % off forceCoeffs, which adds the transposed gradient).
    """
    plane = fields.mesh.plane
    normal, length, cell = plane.normals[wall], plane.lengths[wall], plane.owner[wall]
    pressure = fields.field(folder, "p")[1][wall]
    slip = shot.cells["velocity"][cell] - shot.faces["velocity"][wall]
    away = ((plane.midpoints[wall] - plane.centres[cell]) * normal).sum(axis=1)
    effective = np.full(len(cell), spec.viscosity / spec.density)
    if fields.has(folder, NUT.name) and "k" in shot.cells:
        effective += fields.field(folder, NUT.name)[1][wall]
    force = ((pressure[:, None] * normal + (effective / away)[:, None] * slip) * length[:, None]).sum(axis=0)
    twice = 2.0 if spec.mesh.half else 1.0
    return float(twice * spec.along * force[1] / (0.5 * spec.speed**2 * spec.mesh.projected_width))
