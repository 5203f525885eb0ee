"""What an airflow amounts to in numbers: drag, shedding, pressures, the suction zone, mass balance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .case import FlowSpec, axis_points
from .failure import Attempt
from .history import CD, Interval, Tail, read_table
from .read import CaseFields, Snapshot, loop_of, read_flow
from .statistics import evaluate, is_still

__all__ = ["AirflowResult", "Suction", "measure", "suction_zone"]

Array = NDArray[np.float64]
THRESHOLD = -0.5  # pressure coefficient below which the air counts as the suction zone
WINDOW = 300  # last iterations of a steady run that its interval covers


@dataclass(frozen=True)
class Suction:
    """The suction zone: Cp < threshold, downstream of the body's widest place, connected to the body.

    ``length`` (m) along the air from the body's rear-most point, ``width`` (m) its extent across the air, ``area``
    (m2), both sides counted. ``cp_min`` is its lowest Cp. ``reversal_length`` (m): from the rear, how far the mean
    air on the body's axis runs backwards.
    """

    threshold: float
    cp_min: float
    length: float
    width: float
    area: float
    reversal_length: float


@dataclass(frozen=True)
class AirflowResult:
    """Measured airflow. Coefficients use the inlet's mean speed and, for Cd and Cl, the first body's projected width;
    with several bodies Cd and Cl are of all of them together, and ``cd_of`` holds each one's share of Cd by name.

    Cp = (p - mean p on the inlet) / (rho U^2 / 2), p static (without 2k/3). ``cp_base`` and ``cp_front`` are taken
    where the vertical line through the middle of the first body meets its rear and its front. ``p_inlet`` (Pa):
    mean static p on the inlet; ``pressure_drop`` (Pa): that less the mean on the outlet. ``flow_rate`` (m2/s,
    per metre of depth, whole channel); ``mass_error``: inflow less outflow over inflow. ``strouhal`` = f D / U, None
    when steady. ``field_time`` is the ``time`` to give to ``read_flow`` for tracking. ``loop_mismatch``: rms velocity
    difference between the snapshots at the join of the loop over the rms fluctuation. ``motion``: of the mesh, where
    the body vibrates in the air: amplitude (x, y) m, omega (rad/s), phase (rad) at the loop's start; the stored field
    belongs to positions less amplitude sin(omega t + phase). ``seconds`` of wall time. ``settings`` that served and
    the ``attempts`` that failed before, see :mod:`wakeflow.foam.ladder`; ``checks``: share of each limit of
    :mod:`wakeflow.foam.sanity` that the solution takes up.

    Intervals: of a steady run the range over its last iterations; of a time-resolved one 95 % intervals of the
    long-time mean (:mod:`wakeflow.foam.statistics`). ``statistics`` of a time-resolved run: whole ``periods`` averaged,
    ``start_up`` (s) dropped, ``accuracy`` asked, ``excess`` (largest half-width over the one asked). ``notes``: what a
    reader must know.

    Cd is OpenFOAM's forceCoeffs. Its pressure part uses p with the 2k/3 still in it, which is right: at a wall the
    normal Reynolds stress 2k/3 of the model acts on the body too, so that the sum is the momentum the body takes up.
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


def measure(
    spec: FlowSpec,
    folder: Path,
    verdict: str,
    *,
    seconds: float,
    residuals: dict[str, float] | None = None,
    mesh: dict[str, float] | None = None,
) -> AirflowResult:
    """Measure a solved case."""
    fields = CaseFields(folder)
    loop = loop_of(folder)
    times = [fields.folder(name) for name in loop["times"]] if loop else [fields.folder("latest")]
    shots = [fields.snapshot(time) for time in times]
    arrays = read_flow(folder, "mean" if loop else "latest", density=1.0)
    plane = fields.mesh.plane
    dynamic = 0.5 * spec.speed**2
    at_inlet = _mean_on(fields, shots, "inlet")
    cp = (arrays["pressure"] - at_inlet) / dynamic
    middle, front, rear = axis_points(spec)
    rows = Tail(folder).update()
    history = _coefficients(spec, rows, loop)
    flow, mass_error = _mass_balance(spec, fields, shots)
    body = fields.wall & plane.on(*(name for name in plane.patches if name.startswith("body_")))
    edges, points = plane.faces[body], arrays["points"]
    at_rear = _on_edges(points, edges, cp, np.array([middle, rear * spec.along]))
    return AirflowResult(
        stepping=spec.stepping,
        verdict=verdict,
        turbulence=spec.turbulence,
        cells=len(plane.cells),
        reynolds=spec.reynolds,
        cd=history.cd,
        cl_rms=history.cl_rms,
        strouhal=history.strouhal,
        cp_base=_base(history.cp_base, rows, loop, at_rear),
        cp_front=_on_edges(points, edges, cp, np.array([middle, front * spec.along])),
        p_inlet=spec.density * at_inlet,
        pressure_drop=spec.density * (at_inlet - _mean_on(fields, shots, "outlet")),
        flow_rate=flow,
        mass_error=mass_error,
        suction=suction_zone(spec, points, arrays["triangles"], cp, arrays["velocity"], np.unique(edges)),
        y_plus=_y_plus(spec, fields, times[-1], shots[-1], body),
        steps=history.steps,
        seconds=seconds,
        field_time="all" if loop else "latest",
        period=loop["period"] if loop else None,
        motion=loop.get("motion") if loop else None,
        loop_mismatch=loop["mismatch"] if loop else None,
        residuals=residuals or {},
        mesh=mesh or {},
        statistics=history.statistics,
        notes=history.notes,
        cd_of=_drag_of_each(spec, folder, None if loop is None else loop["begin"]),
    )


def _mean_on(fields: CaseFields, shots: Sequence[Snapshot], patch: str) -> float:
    """Mean kinematic static pressure on a patch, by length and over the snapshots."""
    chosen = fields.mesh.plane.on(patch)
    weight = fields.mesh.plane.lengths[chosen]
    return float(np.mean([np.average(shot.pressure_faces[chosen], weights=weight) for shot in shots]))


def _on_edges(points: Array, edges: NDArray[np.intp], values: Array, where: Array) -> float:
    """Value at ``where`` on the nearest boundary edge, linear along it."""
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


def _coefficients(spec: FlowSpec, rows: Array, loop: dict[str, Any] | None) -> _Coefficients:
    """Steady: means over the last iterations with the range they moved through. Time-resolved: means since the end of
    the start-up; the last values of a wake that came to rest.
    """
    if loop is None:
        recent, ended = _window(rows), _range if spec.stepping == "steady" else _last
        rms = float(recent[:, 2].std())
        lift = Interval(rms, 0.0, float(np.ptp(recent[:, 2])))
        return _Coefficients(ended(recent[:, 1]), lift, ended(recent[:, 3]), None, len(rows), {}, [])
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
    number = found.frequency and _times(found.frequency, scale)
    return _Coefficients(found.cd, found.cl_rms, found.cp_base, number, len(rows), table, notes)


def _window(rows: Array) -> Array:
    """The last iterations or steps that a steady airflow is measured on."""
    return rows[-max(min(WINDOW, len(rows) // 4), 1) :]


def _last(values: Array) -> Interval:
    return Interval(float(values[-1]), float(values.min()), float(values.max()))


def _range(values: Array) -> Interval:
    return Interval(float(values.mean()), float(values.min()), float(values.max()))


def _times(part: Interval, factor: float) -> Interval:
    return Interval(part.value * factor, part.low * factor, part.high * factor)


def _base(probed: Interval, rows: Array, loop: dict[str, Any] | None, field: float) -> Interval:
    """The probe's base pressure coefficient, shifted to what the fields give: second order on the wall, without 2k/3.

    The shift is the fields' mean over the loop less the probe's over the same times.
    """
    if not rows[:, 3].any():
        return Interval(field, field, field)
    times = rows[-1:, 0] if loop is None else np.array([float(name) for name in loop["times"]])
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
    if fields.has(time, "nut") and spec.turbulence != "laminar":
        effective += fields.field(time, "nut")[1][body]
    value = np.sqrt(effective * np.linalg.norm(along, axis=1) / distance) * distance / nu
    return float(value.min()), float(value.max())


def suction_zone(
    spec: FlowSpec, points: Array, triangles: NDArray[np.intp], cp: Array, velocity: Array, body: NDArray[np.intp]
) -> Suction:
    """Extent of the suction zone from node values; triangles are cut along Cp = threshold and at the body's widest
    place.
    """
    outline = np.array(spec.mesh.bodies[0])
    along = spec.along * outline[:, 1]
    left, right = outline[:, 0].min(), outline[:, 0].max()
    size = right - left
    widest = float(max(s for (x, _), s in zip(outline, along, strict=True) if min(x - left, right - x) < 1e-6 * size))
    rear = float(along.max())
    x, s = points[:, 0], spec.along * points[:, 1]
    inside = _connected((cp < THRESHOLD) & (s >= widest - 1e-6 * size), triangles, body)
    chosen = triangles[inside[triangles].any(axis=1)]
    pieces = [_cut(np.column_stack([x[t], s[t], cp[t]]), widest) for t in chosen]
    pieces = [piece for piece in pieces if len(piece) >= 3]
    reversal = _reversal(spec, points, triangles, spec.along * velocity[:, 1], rear)
    if not pieces:
        return Suction(THRESHOLD, float(cp[s >= widest].min()), 0.0, 0.0, 0.0, reversal)
    corners = np.vstack(pieces)
    twice = 2.0 if spec.mesh.half else 1.0
    across = 2 * corners[:, 0].max() if spec.mesh.half else np.ptp(corners[:, 0])
    return Suction(
        threshold=THRESHOLD,
        cp_min=float(cp[inside].min()),
        length=max(float(corners[:, 1].max()) - rear, 0.0),
        width=float(across),
        area=twice * sum(_area(piece) for piece in pieces),
        reversal_length=reversal,
    )


def _connected(low: NDArray[np.bool_], triangles: NDArray[np.intp], body: NDArray[np.intp]) -> NDArray[np.bool_]:
    """The nodes of ``low`` that a chain of mesh edges within ``low`` joins to the body."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    pairs = pairs[low[pairs].all(axis=1)]
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(low), len(low)))
    _, label = connected_components(graph, directed=False)
    return low & np.isin(label, label[body[low[body]]])


def _cut(corners: Array, widest: float) -> Array:
    """The part of a triangle, rows (x, s, Cp), with Cp below the threshold and s beyond ``widest``."""
    for column, sign, level in ((2, 1.0, THRESHOLD), (1, -1.0, widest)):
        if len(corners) == 0:
            break
        level_distance = sign * (corners[:, column] - level)
        kept = []
        for i, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
            da, db = level_distance[i], level_distance[(i + 1) % len(corners)]
            if da <= 0:
                kept.append(a)
            if da * db < 0:
                kept.append(a + da / (da - db) * (b - a))
        corners = np.array(kept).reshape(-1, 3)
    return corners


def _area(corners: Array) -> float:
    x, y = corners[:, 0] - corners[0, 0], corners[:, 1] - corners[0, 1]
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def _reversal(spec: FlowSpec, points: Array, triangles: NDArray[np.intp], forward: Array, rear: float) -> float:
    """Distance (m) from the rear to where the velocity along the air on the body's axis turns forward; 0 when it
    never turns back.
    """
    middle, _, _ = axis_points(spec)
    x, s = points[:, 0] - middle - 1e-7 * spec.mesh.projected_width, spec.along * points[:, 1]
    if spec.mesh.half:
        x = points[:, 0] - 1e-7 * spec.mesh.projected_width
    pairs = np.unique(
        np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1), axis=0
    )
    pairs = pairs[(x[pairs[:, 0]] * x[pairs[:, 1]] < 0) & (s[pairs].max(axis=1) > rear)]
    share = x[pairs[:, 0]] / (x[pairs[:, 0]] - x[pairs[:, 1]])
    place = s[pairs[:, 0]] + share * (s[pairs[:, 1]] - s[pairs[:, 0]])
    speed = forward[pairs[:, 0]] + share * (forward[pairs[:, 1]] - forward[pairs[:, 0]])
    order = np.argsort(place)
    place, speed = place[order] - rear, speed[order]
    backwards = np.flatnonzero(speed < -1e-6 * spec.speed)
    if not len(backwards) or place[backwards[0]] > spec.mesh.projected_width:
        return 0.0
    turns = np.flatnonzero((speed[:-1] < 0) & (speed[1:] >= 0) & (place[1:] > place[backwards[0]]))
    if not len(turns):
        return float(place[-1])
    i = turns[0]
    return float(place[i] - speed[i] * (place[i + 1] - place[i]) / (speed[i + 1] - speed[i]))
