"""What an airflow amounts to in numbers: drag, shedding, pressures, the suction zone, mass balance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.number import Number
from ...core.record import JsonTable, from_json
from ...laws.turbulence import NUT
from .airflow_result import CaseResult, CheckMesh, MeshMotionSummary, RunStatistics
from .case import FlowSpec, axis_points
from .force_history import CD, Tail, read_table, spread
from .read import LOOP, STATES, CaseFields, Snapshot, late_states, loop_of, nodes_of
from .reconstruction import PlaneMesh, triangulate
from .statistics import evaluate, is_still
from .steady import WINDOW
from .suction import suction_zone

# -- Drag, lift, base pressure and shedding from the history of a run, with their intervals ----------------------------
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coefficients:
    """What the history says: intervals as of :class:`~wakeflow.air.foam.airflow_result.AirflowResult`; ``cp_base`` is
    the probe's.
    """

    cd: Number
    cl_rms: Number
    cp_base: Number
    strouhal: Number | None
    statistics: RunStatistics | None = None
    notes: list[str] = field(default_factory=list)


def drag_of_each(spec: FlowSpec, folder: Path, begin: float | None) -> dict[str, float]:
    """Cd of each of several bodies, averaged as Cd of a steady run is; else the mean from ``begin`` (s) on."""
    found = {}
    for name in spec.mesh.names if len(spec.mesh.names) > 1 else ():
        rows = read_table(folder, f"drag_{name}", (CD,))
        if begin is None:
            found[name] = float(_window(rows)[:, 1].mean())
            continue
        late = rows[rows[:, 0] >= begin]
        found[name] = float(np.trapezoid(late[:, 1], late[:, 0]) / np.ptp(late[:, 0]))
    return found


def coefficients_of(spec: FlowSpec, rows: Array, loop: JsonTable | None, since: float | None = None) -> Coefficients:
    """Steady: means over the last iterations with the range they moved through; those ``since`` an iteration where the
    airflow did not settle. Time-resolved: means since the end of the start-up; the last values of a wake that came to
    rest.
    """
    if loop is None:
        recent = _window(rows) if since is None else rows[rows[:, 0] > since]
        ended = _range if spec.stepping == "steady" else _last
        rms = float(recent[:, 2].std())
        lift = Number(rms, 0.0, float(np.ptp(recent[:, 2])))
        said = [] if since is None else [_unsettled(recent[:, 1])]
        return Coefficients(ended(recent[:, 1]), lift, ended(recent[:, 3]), None, notes=said)
    swings = spec.vibration is not None and is_still(rows, spec.convective_time, swings=True)
    found = None if swings else evaluate(rows, spec.accuracy)
    if found is None:  # an irregular wake that shed less than six times, or one that only swings with the body
        late = rows[rows[:, 0] >= loop["begin"]]
        rms = float(late[:, 2].std())
        wide = Number(rms, 0.0, float(np.ptp(late[:, 2])))
        note = f"the airflow shed too few vortices in {rows[-1, 0]:.3g} s for intervals: they are the ranges it spanned"
        said = [] if swings else [note]
        return Coefficients(_range(late[:, 1]), wide, _range(late[:, 3]), None, notes=said)
    number = None if found.frequency is None else found.frequency.times(spec.convective_time)
    made_of = RunStatistics(found.periods, found.begin, spec.accuracy, found.excess)
    note = (
        f"the airflow's intervals are up to {found.excess:.1f} times as wide as asked, from {found.periods} periods, "
        f"after {rows[-1, 0] / spec.convective_time:.0f} widths of travel, where the run was ended"
    )
    said = [] if found.stands else [note]
    return Coefficients(found.cd, found.cl_rms, found.cp_base, number, made_of, said)


def _unsettled(drag: Array) -> str:
    part = 50 * spread(drag)
    return (
        f"the steady airflow does not settle: over its last {len(drag)} iterations Cd swings by {part:.2g} % to either "
        "side of its mean"
    )


def _window(rows: Array) -> Array:
    """The last iterations or steps that a steady airflow is measured on."""
    return rows[-max(min(WINDOW, len(rows) // 4), 1) :]


def _last(values: Array) -> Number:
    return Number(float(values[-1]), float(values.min()), float(values.max()))


def _range(values: Array) -> Number:
    return Number(float(values.mean()), float(values.min()), float(values.max()))


# -- What an airflow amounts to in numbers -----------------------------------------------------------------------------
def measure(spec: FlowSpec, folder: Path, verdict: str, *, residuals: dict[str, float], mesh: CheckMesh) -> CaseResult:
    """Measure the solved case ``folder``: the latest time of a steady airflow, the loop of a time-resolved one.

    ``verdict``, ``residuals`` and the quality of the ``mesh`` are passed on into the result. Raises
    FoamError for a case without a solved time, or whose values are not finite.
    """
    loop, states = loop_of(folder), late_states(folder)
    rows = Tail(folder).update()
    since = json.loads((folder / STATES).read_text())["begin"] if states else None
    history = coefficients_of(spec, rows, loop, since)
    return CaseResult(
        stepping=spec.stepping,
        verdict=verdict,
        turbulence=spec.turbulence,
        reynolds=spec.reynolds,
        cd=history.cd,
        cl_rms=history.cl_rms,
        strouhal=history.strouhal,
        steps=len(rows),
        field_time="all" if loop else "states" if states else "latest",
        period=loop["period"] if loop else None,
        motion=motion_in(loop),
        loop_mismatch=loop["mismatch"] if loop else None,
        residuals=residuals,
        mesh=mesh,
        statistics=history.statistics,
        notes=tuple(history.notes),
        cd_of=drag_of_each(spec, folder, loop["begin"] if loop else since),
        **_from_fields(spec, folder, loop, rows, history.cp_base),
    )


def _from_fields(spec: FlowSpec, folder: Path, loop: JsonTable | None, rows: Array, probed: Number) -> JsonTable:
    """What the stored fields say, by the names of :class:`CaseResult`; ``probed``: the history's base pressure."""
    fields = CaseFields(folder)
    names = loop["times"] if loop else late_states(folder)
    times = [fields.folder(name) for name in names or ["latest"]]
    shots = [fields.snapshot(time) for time in times]
    nodes = nodes_of(fields, times[0], shots).mean()
    found, at_rear = plane_numbers(spec, fields, times[-1], shots, nodes.pressure, nodes.velocity)
    flow_rate, mass_error = _mass_balance(spec, fields, shots)
    return {
        "cells": len(fields.mesh.plane.cells),
        "cp_base": _base(probed, rows, names, at_rear),
        "flow_rate": flow_rate,
        "mass_error": mass_error,
        **found,
    }


def plane_numbers(
    spec: FlowSpec,
    fields: CaseFields,
    time: Path,
    shots: Sequence[Snapshot],
    pressure: Array,
    velocity: Array,
    *,
    ends: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None,
    body: NDArray[np.bool_] | None = None,
) -> tuple[JsonTable, float]:
    """What ``shots`` and their mean at the nodes, kinematic ``pressure`` (n,) and ``velocity`` (n, 2), say of a plane
    airflow by the names of :class:`CaseResult`, and Cp at the rear of the first body.

    Boundary edges (b,) of ``ends``, inlet and outlet, and of the bodies: by the names of patches where not given.
    ``time`` is the folder of the last shot.
    """
    plane = fields.mesh.plane
    if body is None:
        body = fields.wall & plane.on(*(name for name in plane.patches if name.startswith("body_")))
    inlet, outlet = ends or (plane.on("inlet"), plane.on("outlet"))
    at_inlet, at_outlet = (_mean_pressure(plane, shots, end) for end in (inlet, outlet))
    cp = (pressure - at_inlet) / (0.5 * spec.speed**2)
    middle, front, rear = axis_points(spec)
    edges = plane.faces[body]
    triangles = triangulate(plane.points, plane.cells)
    at_front, at_rear = (
        _on_edges(plane.points, edges, cp, np.array([middle, end * spec.along])) for end in (front, rear)
    )
    return {
        "cp_front": at_front,
        "p_inlet": spec.density * at_inlet,
        "pressure_drop": spec.density * (at_inlet - at_outlet),
        "suction": suction_zone(spec, plane.points, triangles, cp, velocity, np.unique(edges)),
        "y_plus": _y_plus(spec, fields, time, shots[-1], body),
    }, at_rear


def motion_in(loop: dict[str, object] | None) -> MeshMotionSummary | None:
    """How the mesh moves that a ``loop`` was recorded on; None where it rests."""
    return None if loop is None or "motion" not in loop else from_json(MeshMotionSummary, loop["motion"], LOOP)


def _mean_pressure(plane: PlaneMesh, shots: Sequence[Snapshot], chosen: NDArray[np.bool_]) -> float:
    """Mean kinematic static pressure (m2/s2) over boundary edges (b,), by length and over the snapshots."""
    weight = plane.lengths[chosen]
    return float(np.mean([np.average(shot.pressure_faces[chosen], weights=weight) for shot in shots]))


def _on_edges(points: Array, edges: NDArray[np.intp], values: Array, where: Array) -> float:
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


def _y_plus(
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
