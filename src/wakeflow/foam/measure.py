"""What an airflow amounts to in numbers: drag, shedding, pressures, the suction zone, mass balance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number
from ..core.record import from_json
from ..laws.turbulence_models import NUT
from .airflow_result import AirflowResult, CheckMesh, MeshMotionSummary
from .case import FlowSpec, axis_points
from .case_fields import CaseFields, Snapshot
from .coefficients import coefficients_of, drag_of_each
from .history import Tail
from .read import LOOP, STATES, late_states, loop_of, read_flow
from .reconstruction import PlaneMesh
from .suction import suction_zone

__all__ = ["mean_pressure", "measure", "motion_in", "on_edges", "y_plus"]

Array = NDArray[np.float64]


def measure(
    spec: FlowSpec,
    folder: Path,
    verdict: str,
    *,
    seconds: float,
    residuals: dict[str, float] | None = None,
    mesh: CheckMesh | None = None,
) -> AirflowResult:
    """Measure the solved case ``folder``: the latest time of a steady airflow, the loop of a time-resolved one.

    ``verdict``, ``seconds``, ``residuals`` and the quality of the ``mesh`` are passed on into the result. Raises
    FoamError for a case without a solved time, or whose values are not finite.
    """
    loop, states = loop_of(folder), late_states(folder)
    rows = Tail(folder).update()
    since = json.loads((folder / STATES).read_text())["begin"] if states else None
    history = coefficients_of(spec, rows, loop, since)
    return AirflowResult(
        stepping=spec.stepping,
        verdict=verdict,
        turbulence=spec.turbulence,
        reynolds=spec.reynolds,
        cd=history.cd,
        cl_rms=history.cl_rms,
        strouhal=history.strouhal,
        steps=len(rows),
        seconds=seconds,
        field_time="all" if loop else "states" if states else "latest",
        period=loop["period"] if loop else None,
        motion=motion_in(loop),
        loop_mismatch=loop["mismatch"] if loop else None,
        residuals=residuals or {},
        mesh=mesh or CheckMesh(),
        statistics=history.statistics,
        notes=tuple(history.notes),
        cd_of=drag_of_each(spec, folder, loop["begin"] if loop else since),
        **_from_fields(spec, folder, loop, rows, history.cp_base),
    )


def _from_fields(
    spec: FlowSpec, folder: Path, loop: dict[str, Any] | None, rows: Array, probed: Number
) -> dict[str, Any]:
    """What the stored fields say, by the names of :class:`AirflowResult`; ``probed``: the history's base pressure."""
    fields = CaseFields(folder)
    names = loop["times"] if loop else late_states(folder)
    times = [fields.folder(name) for name in names or ["latest"]]
    shots = [fields.snapshot(time) for time in times]
    flow = read_flow(folder, "mean" if names else "latest", density=1.0)
    plane = fields.mesh.plane
    at_inlet, at_outlet = (mean_pressure(plane, shots, plane.on(patch)) for patch in ("inlet", "outlet"))
    cp = (flow["pressure"] - at_inlet) / (0.5 * spec.speed**2)
    middle, front, rear = axis_points(spec)
    body = fields.wall & plane.on(*(name for name in plane.patches if name.startswith("body_")))
    edges, points = plane.faces[body], flow["points"]
    at_rear = on_edges(points, edges, cp, np.array([middle, rear * spec.along]))
    flow_rate, mass_error = _mass_balance(spec, fields, shots)
    return {
        "cells": len(plane.cells),
        "cp_base": _base(probed, rows, names, at_rear),
        "cp_front": on_edges(points, edges, cp, np.array([middle, front * spec.along])),
        "p_inlet": spec.density * at_inlet,
        "pressure_drop": spec.density * (at_inlet - at_outlet),
        "flow_rate": flow_rate,
        "mass_error": mass_error,
        "suction": suction_zone(spec, points, flow["triangles"], cp, flow["velocity"], np.unique(edges)),
        "y_plus": y_plus(spec, fields, times[-1], shots[-1], body),
    }


def motion_in(loop: dict[str, Any] | None) -> MeshMotionSummary | None:
    """How the mesh moves that a ``loop`` was recorded on; None where it rests."""
    return None if loop is None or "motion" not in loop else from_json(MeshMotionSummary, loop["motion"], LOOP)


def mean_pressure(plane: PlaneMesh, shots: Sequence[Snapshot], chosen: NDArray[np.bool_]) -> float:
    """Mean kinematic static pressure (m2/s2) over boundary edges (b,), by length and over the snapshots."""
    weight = plane.lengths[chosen]
    return float(np.mean([np.average(shot.pressure_faces[chosen], weights=weight) for shot in shots]))


def on_edges(points: Array, edges: NDArray[np.intp], values: Array, where: Array) -> float:
    """Value at ``where`` (2,) m on the nearest of the boundary ``edges`` (e, 2), linear along it; ``values`` (n,) at
    the ``points`` (n, 2) m.
    """
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    along = end - start
    share = np.clip(((where - start) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
    nearest = int(np.linalg.norm(start + share[:, None] * along - where, axis=1).argmin())
    a, b = values[edges[nearest]]
    return float(a + share[nearest] * (b - a))


def _base(probed: Number, rows: Array, names: Sequence[str], field: float) -> Number:
    """The probe's base pressure coefficient, shifted to what the fields give: second order on the wall, and less the
    static pressure on the inlet, where the probe's is less p.

    The shift is the mean of the fields at the times ``names`` (none: the last one) less the probe's at the same times.
    """
    if not rows[:, 3].any():
        return Number(field, field, field)
    times = np.array([float(name) for name in names]) if names else rows[-1:, 0]
    shift = field - float(np.interp(times, rows[:, 0], rows[:, 3]).mean())
    return probed.shifted(shift)


def _mass_balance(spec: FlowSpec, fields: CaseFields, shots: Sequence[Snapshot]) -> tuple[float, float]:
    """Flow rate through the whole channel (m2/s, secondary streams included) and (inflow - outflow)/inflow, from the
    conserved flux where it is stored. That of a moving mesh is relative to it: what is lost is seen there as well, the
    flow rate is not.
    """
    plane = fields.mesh.plane
    latest = fields.folder("latest")

    def through(patch: str, *, conserved: bool) -> float:
        chosen = plane.on(patch)
        if conserved and fields.has(latest, "phi"):
            return float(fields.boundary_flux(latest, patch).sum()) / fields.mesh.thickness
        across = (shots[-1].velocity_faces[chosen] * plane.normals[chosen]).sum(axis=1)
        return float((across * plane.lengths[chosen]).sum())

    inlets = [patch for patch in plane.patches if patch == "inlet" or patch.startswith("inlet_")]
    inflow = -sum(through(patch, conserved=spec.vibration is None) for patch in inlets)
    lost = -sum(through(patch, conserved=True) for patch in (*inlets, "outlet"))
    return inflow * (2 if spec.mesh.half else 1), lost / inflow


def y_plus(
    spec: FlowSpec, fields: CaseFields, time: Path, shot: Snapshot, body: NDArray[np.bool_]
) -> tuple[float, float]:
    """Least and largest y+ of the first cells on the bodies: sqrt(nu_eff |u_t| / y) y / nu."""
    plane = fields.mesh.plane
    nu = spec.viscosity / spec.density
    cell, normal = plane.owner[body], plane.normals[body]
    distance = ((plane.midpoints[body] - plane.centres[cell]) * normal).sum(axis=1)
    velocity = shot.velocity[cell] - shot.velocity_faces[body]
    along = velocity - (velocity * normal).sum(axis=1, keepdims=True) * normal
    effective = np.full(len(cell), nu)
    if spec.model.turbulent and fields.has(time, NUT.name):
        effective += fields.field(time, NUT.name)[1][body]
    value = np.sqrt(effective * np.linalg.norm(along, axis=1) / distance) * distance / nu
    return float(value.min()), float(value.max())
