"""What an airflow amounts to in numbers: drag, shedding, pressures, the suction zone, mass balance."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import area
from ...core.number import NO_NUMBER, Number
from ...core.record import JsonTable, from_json
from ...laws.turbulence import NUT
from .airflow_result import (
    AT_REST,
    NO_STATISTICS,
    AirflowResult,
    CheckMesh,
    MeshMotionSummary,
    RunStatistics,
    SuctionZone,
)
from .case import FlowSpec, axis_points
from .read import LOOP, STATES, CaseFields, Snapshot, late_states, loop_of, mean_of, nodes_of
from .reconstruction import PlaneMesh, triangulate
from .statistics import CD, NOTHING, Tail, evaluate, is_still, read_table, spread
from .steady import WINDOW

# -- The suction zone behind a body: how far, how wide, how deep, and how far the air runs backwards -------------------
# -- Values on a body's axis -------------------------------------------------------------------------------------------
ASIDE = 1e-7  # widths beside the axis, where no node lies: an edge that ends on the axis would cross it twice or never
ON_BODY = 1e-9  # widths before the rear: edges of the body's own, which round-off puts before it, count


@dataclass(frozen=True, eq=False)
class AxisCrossings:
    """The places where the edges of a mesh cross the axis behind the body.

    ``behind`` (p,) m from the rear, rising; ``ends`` (p, 2) the nodes of the edge that crosses there, and how far along
    it, from the first to the second, ``share`` (p,).
    """

    behind: Array
    ends: NDArray[np.intp]
    share: Array

    @classmethod
    def of(cls, spec: FlowSpec, points: Array, triangles: NDArray[np.intp]) -> AxisCrossings:
        """Crossings of the mesh of ``triangles`` (t, 3) between ``points`` (n, 2) m."""
        middle, _, rear = axis_points(spec)
        size = spec.mesh.projected_width
        x, s = points[:, 0] - middle - ASIDE * size, spec.along * points[:, 1]
        sides = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        ends = np.unique(np.sort(sides, axis=1), axis=0)
        ends = ends[(x[ends[:, 0]] * x[ends[:, 1]] < 0) & (s[ends].max(axis=1) > rear - ON_BODY * size)]
        share = x[ends[:, 0]] / (x[ends[:, 0]] - x[ends[:, 1]])
        place = s[ends[:, 0]] + share * (s[ends[:, 1]] - s[ends[:, 0]])
        order = np.argsort(place)
        return cls(place[order] - rear, ends[order], share[order])

    def values(self, nodes: Array) -> Array:
        """Values (p,) at the crossings of what is ``nodes`` (n,) at the mesh's nodes: linear along each edge."""
        first, second = nodes[self.ends[:, 0]], nodes[self.ends[:, 1]]
        return np.asarray(first + self.share * (second - first))

    def at(self, behind: Array, nodes: Array) -> Array:
        """Values at ``behind`` (q,) m from the rear: linear from one crossing to the next."""
        return np.interp(behind, self.behind, self.values(nodes))


# -- The suction zone behind a body ------------------------------------------------------------------------------------
THRESHOLD = -0.5  # pressure coefficient below which the air counts as the suction zone


def suction_zone(
    spec: FlowSpec, points: Array, triangles: NDArray[np.intp], cp: Array, velocity: Array, body: NDArray[np.intp]
) -> SuctionZone:
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
    whole = (cp[chosen] <= THRESHOLD).all(axis=1) & (s[chosen] >= widest).all(axis=1)  # nearly all: nothing to cut
    pieces = [_cut(np.column_stack([x[t], s[t], cp[t]]), widest) for t in chosen[~whole]]
    pieces = [piece[:, :2] for piece in pieces if len(piece) >= 3]
    uncut = np.stack([x, s], axis=1)[chosen[whole]]  # (w, 3, 2)
    reversal = _reversal(spec, points, triangles, spec.along * velocity[:, 1])
    if not pieces and not len(uncut):
        return SuctionZone(THRESHOLD, float(cp[s >= widest].min()), 0.0, 0.0, 0.0, reversal)
    corners = np.vstack([uncut.reshape(-1, 2), *pieces])
    (x1, s1), (x2, s2) = ((uncut[:, i] - uncut[:, 0]).T for i in (1, 2))
    twice = 2.0 if spec.mesh.half else 1.0
    across = 2 * corners[:, 0].max() if spec.mesh.half else np.ptp(corners[:, 0])
    return SuctionZone(
        threshold=THRESHOLD,
        cp_min=float(cp[inside].min()),
        length=max(float(corners[:, 1].max()) - rear, 0.0),
        width=float(across),
        area=twice * (0.5 * float(np.abs(x1 * s2 - x2 * s1).sum()) + sum(abs(area(item - item[0])) for item in pieces)),
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


def _reversal(spec: FlowSpec, points: Array, triangles: NDArray[np.intp], forward: Array) -> float:
    """Distance (m) from the rear to where the velocity along the air on the body's axis turns forward; 0 when it
    never turns back.
    """
    axis = AxisCrossings.of(spec, points, triangles)
    place, speed = axis.behind, axis.values(forward)
    backwards = np.flatnonzero(speed < -1e-6 * spec.speed)
    if not len(backwards) or place[backwards[0]] > spec.mesh.projected_width:
        return 0.0
    turns = np.flatnonzero((speed[:-1] < 0) & (speed[1:] >= 0) & (place[1:] > place[backwards[0]]))
    if not len(turns):
        return float(place[-1])
    i = turns[0]
    return float(place[i] - speed[i] * (place[i + 1] - place[i]) / (speed[i + 1] - speed[i]))


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
    strouhal: Number = NO_NUMBER
    statistics: RunStatistics = NO_STATISTICS
    notes: tuple[str, ...] = ()


def drag_of_each(spec: FlowSpec, folder: Path, begin: float) -> dict[str, float]:
    """Cd of each of several bodies: the mean from ``begin`` (s) on; 0: averaged as Cd of a run that came to rest is."""
    drags = {}
    for name in spec.mesh.names if len(spec.mesh.names) > 1 else ():
        rows = read_table(folder, f"drag_{name}", (CD,))
        late = rows[rows[:, 0] >= begin] if begin else _window(rows)
        integral = np.trapezoid(late[:, 1], late[:, 0]) / np.ptp(late[:, 0]) if begin else late[:, 1].mean()
        drags[name] = float(integral)
    return drags


def spanned(rows: Array, *notes: str) -> Coefficients:
    """Means of ``rows`` (n, 4) with the range that they moved through."""
    drag, lift, base = (Number(float(part.mean()), float(part.min()), float(part.max())) for part in rows[:, 1:].T)
    return Coefficients(drag, Number(float(rows[:, 2].std()), 0.0, lift.high - lift.low), base, notes=notes)


def at_rest(spec: FlowSpec, rows: Array) -> Coefficients:
    """Means over the last iterations of a steady run that settled; the last values of a wake in time that came to
    rest.
    """
    late = _window(rows)
    result = spanned(late)
    if spec.stepping == "steady":
        return result
    drag, base = replace(result.cd, value=float(late[-1, 1])), replace(result.cp_base, value=float(late[-1, 3]))
    return replace(result, cd=drag, cp_base=base)


def in_time(spec: FlowSpec, rows: Array, begin: float) -> Coefficients:
    """Means since the end of the start-up; from ``begin`` (s) on where there are too few periods for that."""
    swings = spec.vibration is not None and is_still(rows, spec.convective_time, swings=True)
    result = NOTHING if swings else evaluate(rows, spec.accuracy)
    if not result:  # an irregular wake that shed less than six times, or one that only swings with the body
        note = f"the airflow shed too few vortices in {rows[-1, 0]:.3g} s for intervals: they are the ranges it spanned"
        return spanned(rows[rows[:, 0] >= begin], *(() if swings else (note,)))
    number = result.frequency.times(spec.convective_time)
    made_of = RunStatistics(result.periods, result.begin, spec.accuracy, result.excess)
    note = (
        f"the airflow's intervals are up to {result.excess:.1f} times as wide as asked, from {result.periods} periods, "
        f"after {rows[-1, 0] / spec.convective_time:.0f} widths of travel, where the run was ended"
    )
    said = () if result.stands else (note,)
    return Coefficients(result.cd, result.cl_rms, result.cp_base, number, made_of, said)


def _unsettled(drag: Array) -> str:
    part = 50 * spread(drag)
    return (
        f"the steady airflow does not settle: over its last {len(drag)} iterations Cd swings by {part:.2g} % to either "
        "side of its mean"
    )


def _window(rows: Array) -> Array:
    """The last iterations or steps that a steady airflow is measured on."""
    return rows[-max(min(WINDOW, len(rows) // 4), 1) :]


# -- What an airflow amounts to in numbers -----------------------------------------------------------------------------
class Edges(NamedTuple):
    """Boundary edges (b,) of a plane case: of the main inlet, of the outlet, of the bodies."""

    inlet: NDArray[np.bool_]
    outlet: NDArray[np.bool_]
    body: NDArray[np.bool_]

    @classmethod
    def of(cls, fields: CaseFields) -> Edges:
        """Boundary edges of a case written by this program, by the names of its patches."""
        plane = fields.mesh.plane
        body = plane.on(*(name for name in plane.patches if name.startswith("body_")))
        return cls(plane.on("inlet"), plane.on("outlet"), fields.wall & body)


def _since(spec: FlowSpec, folder: Path, rows: Array, loop: JsonTable) -> tuple[float, Coefficients]:
    """When the record began (s, or iterations) that an airflow is measured on, and what its history says since then;
    0 of one that came to rest: its end alone counts.
    """
    if loop:
        return loop["begin"], in_time(spec, rows, loop["begin"])
    if not late_states(folder):
        return 0.0, at_rest(spec, rows)
    begin = json.loads((folder / STATES).read_text())["begin"]
    late = rows[rows[:, 0] > begin]
    return begin, spanned(late, _unsettled(late[:, 1]))


def measure(
    spec: FlowSpec, folder: Path, verdict: str, *, residuals: dict[str, float], mesh: CheckMesh
) -> AirflowResult:
    """Measure the solved case ``folder``: the latest time of a steady airflow, the loop of a time-resolved one.

    ``verdict``, ``residuals`` and the quality of the ``mesh`` are passed on into the result. Raises
    FoamError for a case without a solved time, or whose values are not finite.
    """
    loop, states, rows = loop_of(folder), late_states(folder), Tail(folder).update()
    begin, history = _since(spec, folder, rows, loop)
    fields, names = CaseFields(folder), loop["times"] if loop else states
    times = [fields.folder(name) for name in names or ["latest"]]
    shots = [fields.snapshot(time) for time in times]
    nodes = mean_of(nodes_of(fields, times[0], shots))
    result, at_rear = plane_numbers(spec, fields, times[-1], shots, nodes, Edges.of(fields))
    flow_rate, mass_error = _mass_balance(spec, fields, shots)
    return AirflowResult(
        stepping=spec.stepping,
        verdict=verdict,
        turbulence=spec.turbulence,
        cells=len(fields.mesh.plane.cells),
        reynolds=spec.reynolds,
        cd=history.cd,
        cl_rms=history.cl_rms,
        strouhal=history.strouhal,
        cp_base=_base(history.cp_base, rows, names, at_rear),
        flow_rate=flow_rate,
        mass_error=mass_error,
        steps=len(rows),
        field_time="all" if loop else "states" if states else "latest",
        period=loop.get("period", np.nan),
        motion=motion_in(loop),
        loop_mismatch=loop.get("mismatch", np.nan),
        residuals=residuals,
        mesh=mesh,
        statistics=history.statistics,
        notes=history.notes,
        cd_of=drag_of_each(spec, folder, begin),
        **result,
    )


def plane_numbers(
    spec: FlowSpec,
    fields: CaseFields,
    time: Path,
    shots: Sequence[Snapshot],
    mean: Mapping[str, Array],
    edges: Edges,
) -> tuple[JsonTable, float]:
    """What ``shots`` and their ``mean`` at the nodes, kinematic pressure (n,) and velocity (n, 2), say of a plane
    airflow by the names of :class:`AirflowResult`, and Cp at the rear of the first body.

    ``time`` is the folder of the last shot.
    """
    plane = fields.mesh.plane
    at_inlet, at_outlet = (_mean_pressure(plane, shots, end) for end in (edges.inlet, edges.outlet))
    cp = (mean["pressure"] - at_inlet) / (0.5 * spec.speed**2)
    middle, front, rear = axis_points(spec)
    ends = plane.faces[edges.body]
    triangles = triangulate(plane.points, plane.cells)
    at_front, at_rear = (
        _on_edges(plane.points, ends, cp, np.array([middle, end * spec.along])) for end in (front, rear)
    )
    return {
        "cp_front": at_front,
        "p_inlet": spec.density * at_inlet,
        "pressure_drop": spec.density * (at_inlet - at_outlet),
        "suction": suction_zone(spec, plane.points, triangles, cp, mean["velocity"], np.unique(ends)),
        "y_plus": _y_plus(spec, fields, time, shots[-1], edges.body),
    }, at_rear


def motion_in(loop: JsonTable) -> MeshMotionSummary:
    """How the mesh moves that a ``loop`` was recorded on."""
    return from_json(MeshMotionSummary, loop["motion"], LOOP) if "motion" in loop else AT_REST


def _mean_pressure(plane: PlaneMesh, shots: Sequence[Snapshot], chosen: NDArray[np.bool_]) -> float:
    """Mean kinematic static pressure (m2/s2) over boundary edges (b,), by length and over the snapshots."""
    weight = plane.lengths[chosen]
    return float(np.mean([np.average(shot.faces["pressure"][chosen], weights=weight) for shot in shots]))


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
        across = (shots[-1].faces["velocity"][chosen] * plane.normals[chosen]).sum(axis=1)
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
    velocity = shot.cells["velocity"][cell] - shot.faces["velocity"][body]
    along = velocity - (velocity * normal).sum(axis=1, keepdims=True) * normal
    effective = np.full(len(cell), nu)
    if spec.model.turbulent and fields.has(time, NUT.name):
        effective += fields.field(time, NUT.name)[1][body]
    value = np.sqrt(effective * np.linalg.norm(along, axis=1) / distance) * distance / nu
    return float(value.min()), float(value.max())
