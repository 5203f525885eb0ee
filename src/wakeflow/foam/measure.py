"""What an airflow amounts to in numbers: drag, shedding, pressures, the suction zone, mass balance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..laws.turbulence_models import NUT
from .case import FlowSpec, axis_points
from .case_fields import CaseFields, Snapshot
from .failure import Attempt
from .history import CD, Interval, Tail, read_table, spread
from .read import STATES, late_states, loop_of, read_flow
from .reconstruction import PlaneMesh
from .statistics import evaluate, is_still
from .steady import WINDOW
from .suction import Suction, suction_zone

__all__ = ["AirflowResult", "mean_pressure", "measure", "on_edges", "y_plus"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AirflowResult:
    """Measured airflow. Coefficients use the inlet's mean speed and, for Cd and Cl, the first body's projected width;
    with several bodies Cd and Cl are of all of them together, and ``cd_of`` holds each one's share of Cd by name.

    Cp = (p - mean p on the inlet) / (rho U^2 / 2), p static: OpenFOAM's without 2k/3, k being 0 at no-slip walls.
    ``cp_base`` and ``cp_front`` are taken where the vertical line through the middle of the first body meets its rear
    and its front. ``p_inlet`` (Pa): mean static p on the inlet; ``pressure_drop`` (Pa): that less the mean on the
    outlet. ``flow_rate`` (m2/s, per metre of depth, whole channel); ``mass_error``: inflow less outflow over inflow.
    ``strouhal`` = f D / U, None when steady. ``field_time`` is the ``time`` to give to ``read_flow`` for tracking
    ("states": one of ``late_states`` after the other). ``loop_mismatch``: rms velocity difference between the snapshots
    at the join of the loop over the rms fluctuation. ``motion``: of the mesh, where the body vibrates in the air:
    amplitude (x, y) m, omega (rad/s), phase (rad) at the loop's start; the stored field belongs to positions less
    amplitude sin(omega t + phase). ``seconds`` of wall time. ``settings`` that served and the ``attempts`` that failed
    before, see :mod:`wakeflow.foam.ladder`; ``checks``: share of each limit of :mod:`wakeflow.foam.sanity` that is
    taken up; ``span``: of an airflow in three dimensions, see :mod:`wakeflow.foam.span_measure`.

    Intervals: of a steady run the range over its last iterations, of one that did not settle over those of its late
    states; of a time-resolved one 95 % intervals of the long-time mean (:mod:`wakeflow.foam.statistics`).
    ``statistics`` of a time-resolved run: whole ``periods`` averaged, ``start_up`` (s) dropped, ``accuracy`` asked,
    ``excess`` (largest half-width over the one asked). ``notes``: what a reader must know.

    Cd is OpenFOAM's forceCoeffs. Its pressure part uses OpenFOAM's p, which is right: at a wall k = 0, and p there is
    the static pressure (p, static pressure plus normal stress 2k/3, does not change across the layer beside it).
    """

    stepping: str
    verdict: str
    turbulence: str
    cells: int
    reynolds: float
    cd: Interval
    cl_rms: Interval
    strouhal: Interval | None
    cp_base: Interval
    cp_front: float
    p_inlet: float
    pressure_drop: float
    flow_rate: float
    mass_error: float
    suction: Suction
    y_plus: tuple[float, float]
    steps: int
    seconds: float
    field_time: str
    period: float | None = None
    motion: dict[str, Any] | None = None
    loop_mismatch: float | None = None
    residuals: dict[str, float] = field(default_factory=dict)
    mesh: dict[str, float] = field(default_factory=dict)
    statistics: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    cd_of: dict[str, float] = field(default_factory=dict)
    settings: str = "normal"
    attempts: tuple[Attempt, ...] = ()
    checks: dict[str, float] = field(default_factory=dict)
    span: dict[str, Any] | None = None


def measure(
    spec: FlowSpec,
    folder: Path,
    verdict: str,
    *,
    seconds: float,
    residuals: dict[str, float] | None = None,
    mesh: dict[str, float] | None = None,
) -> AirflowResult:
    """Measure the solved case ``folder``: the latest time of a steady airflow, the loop of a time-resolved one.

    ``verdict``, ``seconds``, ``residuals`` and the quality of the ``mesh`` are passed on into the result. Raises
    FoamError for a case without a solved time, or whose values are not finite.
    """
    loop, states = loop_of(folder), late_states(folder)
    rows = Tail(folder).update()
    since = json.loads((folder / STATES).read_text())["begin"] if states else None
    history = _coefficients(spec, rows, loop, since)
    return AirflowResult(
        stepping=spec.stepping,
        verdict=verdict,
        turbulence=spec.turbulence,
        reynolds=spec.reynolds,
        cd=history.cd,
        cl_rms=history.cl_rms,
        strouhal=history.strouhal,
        steps=history.steps,
        seconds=seconds,
        field_time="all" if loop else "states" if states else "latest",
        period=loop["period"] if loop else None,
        motion=loop.get("motion") if loop else None,
        loop_mismatch=loop["mismatch"] if loop else None,
        residuals=residuals or {},
        mesh=mesh or {},
        statistics=history.statistics,
        notes=history.notes,
        cd_of=_drag_of_each(spec, folder, loop["begin"] if loop else since),
        **_from_fields(spec, folder, loop, rows, history.cp_base),
    )


def _from_fields(
    spec: FlowSpec, folder: Path, loop: dict[str, Any] | None, rows: Array, probed: Interval
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


@dataclass(frozen=True)
class _Coefficients:
    """What the history says; ``cp_base`` is the probe's, ``begin`` (s) where its averages start."""

    cd: Interval
    cl_rms: Interval
    cp_base: Interval
    strouhal: Interval | None
    steps: int
    statistics: dict[str, float]
    notes: list[str]


def _drag_of_each(spec: FlowSpec, folder: Path, begin: float | None) -> dict[str, float]:
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


def _coefficients(
    spec: FlowSpec, rows: Array, loop: dict[str, Any] | None, since: float | None = None
) -> _Coefficients:
    """Steady: means over the last iterations with the range they moved through; those ``since`` an iteration where the
    airflow did not settle. Time-resolved: means since the end of the start-up; the last values of a wake that came to
    rest.
    """
    if loop is None:
        recent = _window(rows) if since is None else rows[rows[:, 0] > since]
        ended = _range if spec.stepping == "steady" else _last
        rms = float(recent[:, 2].std())
        lift = Interval(rms, 0.0, float(np.ptp(recent[:, 2])))
        said = [] if since is None else [_unsettled(recent[:, 1])]
        return _Coefficients(ended(recent[:, 1]), lift, ended(recent[:, 3]), None, len(rows), {}, said)
    swings = spec.vibration is not None and is_still(rows, spec.convective_time, swings=True)
    found = None if swings else evaluate(rows, spec.accuracy)
    if found is None:  # an irregular wake that shed less than six times, or one that only swings with the body
        late = rows[rows[:, 0] >= loop["begin"]]
        rms = float(late[:, 2].std())
        wide = Interval(rms, 0.0, float(np.ptp(late[:, 2])))
        note = f"the airflow shed too few vortices in {rows[-1, 0]:.3g} s for intervals: they are the ranges it spanned"
        said = [] if swings else [note]
        return _Coefficients(_range(late[:, 1]), wide, _range(late[:, 3]), None, len(rows), {}, said)
    scale = spec.convective_time
    notes: list[str] = []
    if not found.stands:
        notes = [
            f"the airflow's intervals are up to {found.excess:.1f} times as wide as asked after "
            f"{rows[-1, 0] / scale:.0f} widths of travel, where the run was ended"
        ]
    table = {"periods": found.periods, "start_up": found.begin, "accuracy": spec.accuracy, "excess": found.excess}
    number = None if found.frequency is None else _times(found.frequency, scale)
    return _Coefficients(found.cd, found.cl_rms, found.cp_base, number, len(rows), table, notes)


def _unsettled(drag: Array) -> str:
    part = 50 * spread(drag)
    return (
        f"the iterations do not settle: over the last {len(drag)} Cd swings by {part:.2g} % to either side of its mean"
    )


def _window(rows: Array) -> Array:
    """The last iterations or steps that a steady airflow is measured on."""
    return rows[-max(min(WINDOW, len(rows) // 4), 1) :]


def _last(values: Array) -> Interval:
    return Interval(float(values[-1]), float(values.min()), float(values.max()))


def _range(values: Array) -> Interval:
    return Interval(float(values.mean()), float(values.min()), float(values.max()))


def _times(part: Interval, factor: float) -> Interval:
    return Interval(part.value * factor, part.low * factor, part.high * factor)


def _base(probed: Interval, rows: Array, names: Sequence[str], field: float) -> Interval:
    """The probe's base pressure coefficient, shifted to what the fields give: second order on the wall, and less the
    static pressure on the inlet, where the probe's is less p.

    The shift is the mean of the fields at the times ``names`` (none: the last one) less the probe's at the same times.
    """
    if not rows[:, 3].any():
        return Interval(field, field, field)
    times = np.array([float(name) for name in names]) if names else rows[-1:, 0]
    shift = field - float(np.interp(times, rows[:, 0], rows[:, 3]).mean())
    return Interval(probed.value + shift, probed.low + shift, probed.high + shift)


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
