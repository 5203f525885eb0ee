"""What is constant of a granule for the kernel, and its state at birth; the frame of a mesh that swings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..air.field import AT_REST, FlowField, MeshOscillation
from ..core.arrays import numbers
from ..core.errors import SceneError
from ..laws.drag import drag_laws, drag_table
from ..laws.flake import section
from ..laws.forces import Force
from ..laws.forces import forces as all_forces
from ..laws.restitution import Restitution
from .bodies import Body
from .granules import Granules, toss_of
from .kernel import layout as at
from .kernel.layout import PackedAir, Rules, Walls

# -- What is constant of a call and of a granule for the kernel --------------------------------------------------------
Array = NDArray[np.float64]
Index = NDArray[np.int64]
MAX_TABLES = 4096
# In place of a field where there is none
VACUUM = FlowField(np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 2)), density=0.0, viscosity=0.0)
BY_LAW = -1.0  # in place of a granule's restitution: look it up at the approach speed


@dataclass(frozen=True)
class Packed:
    """What all blocks of granules of one call share, most of it as the kernel takes it."""

    field: FlowField
    grains: Granules
    forces: Sequence[str]
    gravity: Sequence[float]
    solids: Sequence[Body]
    swing: MeshOscillation  # how the mesh moves, in whose frame granules fly
    reach: float  # m, how near to a body the mesh's edge counts as covered by it
    points: int  # kept of a path, 0: none
    walls: Walls
    air: PackedAir
    rules: Rules
    tables: Array  # of the drag law
    table_of: Index  # which of them each granule uses


def check_forces(forces: Sequence[str], field: FlowField) -> None:
    """Raise SceneError for a force that is unknown, not computed, or lacks what it needs of the field."""
    for name in forces:
        force = all_forces[name]
        if not force.computed:
            computed = ", ".join(known for known in all_forces if all_forces[known].computed)
            raise SceneError(f"force {name!r} is only bounded, not computed (computed: {computed})")
        if field is not VACUUM and (lacking := lacking_for(force, field)):
            raise SceneError(f"forces: {name} needs {lacking}")


def lacking_for(force: Force, field: FlowField) -> str:
    """What a field lacks for a force, in words; empty where it has all."""
    if force.needs == "pressure" and not (field.has("pressure") or field.has("given_gradient")):
        return "a field with pressure"
    if force.needs == "turbulence" and not (field.has("k") and field.has("dissipation")):
        return "a field with k and dissipation; a laminar airflow has none"
    return ""


def pack_granules(grains: Granules, field: FlowField, forces: Sequence[str], gravity: Sequence[float]) -> Array:
    """Constants of every granule (n, CONSTANTS), see ``layout``: those of its walls, and those of each force.

    ``gravity`` (2,) m/s2. Without a field only forces act that need none. Raises SceneError for a gravity that is no
    finite vector.
    """
    rows = np.zeros((len(grains), at.CONSTANTS))
    g = numbers("gravity", gravity, "m/s^2")
    if g.shape != (2,) or not np.all(np.isfinite(g)):
        raise SceneError(f"gravity = {gravity}, expected two finite numbers in m/s2")
    rows[:, at.RADIUS] = grains.diameter / 2
    rows[:, at.RESTITUTION] = BY_LAW if isinstance(grains.restitution, Restitution) else grains.restitution
    rows[:, at.FRICTION] = grains.friction
    rows[:, at.BLOW] = 1.0 / grains.inertia
    rows[:, at.MOBILITY] = np.where(grains.flake, 0.0, rows[:, at.BLOW])
    rows[:, at.TOSS] = toss_of(grains)
    area, perimeter = section(grains.shape, grains.flake)
    rows[:, at.SECTION], rows[:, at.GIRTH] = area * rows[:, at.RADIUS] ** 2, perimeter * rows[:, at.RADIUS]
    rows[:, at.SCATTER], rows[:, at.GIVES_BACK] = grains.scatter, grains.tangential_restitution
    rows[:, at.CAPTURE], rows[:, at.STICKS] = grains.capture_speed, grains.sticks
    acting = [
        force
        for name in all_forces
        if name in forces
        for force in [all_forces[name]]
        if field is not VACUUM or force.in_vacuum
    ]
    pull = np.zeros((len(grains), 2))
    for force in acting:
        pull += force.acceleration(grains, field, g)
    rows[:, [at.GX, at.GY]] = pull
    if field is not VACUUM:
        rows[:, at.REYNOLDS2] = (field.density * grains.diameter / field.viscosity) ** 2
        rows[:, at.VORTICITY] = field.density * grains.diameter**2 / field.viscosity
        _fill_by_air(rows, acting, grains, field)
    return rows


def _fill_by_air(rows: Array, acting: Sequence[Force], grains: Granules, field: FlowField) -> None:
    """The constants of the ``acting`` forces of the air, in place; added mass divides all accelerations by 1 + chi."""
    inertia = np.ones(len(grains))
    for force in acting:
        inertia += force.inertia(grains, field)
    rows[:, [at.GX, at.GY]] /= inertia[:, None]
    for force in acting:
        factors, constants = force.factors(grains, field), force.constants(grains, field)
        for slot, values in factors.items():
            rows[:, getattr(at, slot)] = values / inertia
        for slot, values in constants.items():
            rows[:, getattr(at, slot)] = values
        if force.by_gradient:
            rows[:, at.EXTRA] = np.maximum(rows[:, at.EXTRA], _any_of(rows, factors))
        if force.random:
            rows[:, at.NOISE] = np.maximum(rows[:, at.NOISE], _any_of(rows, constants))


def _any_of(rows: Array, slots: Iterable[str]) -> NDArray[np.bool_]:
    """Which granules (n,) have a number other than zero in one of the ``slots``."""
    return np.asarray(np.any(rows[:, [getattr(at, slot) for slot in slots]] != 0.0, axis=1))


def pack_tables(law: str | Sequence[str], sphericity: Array, fraction: Index) -> tuple[Array, Index]:
    """Tables of the drag law (k, cells, 4), one for every sphericity that occurs, and which one each granule uses; of
    several laws each granule's is the one at the place of its ``fraction``. Raises SceneError where there are too few.
    """
    if isinstance(law, str):
        return _tables_of(law, sphericity)
    if len(fraction) and not 0 <= fraction.min() <= fraction.max() < len(law):
        raise SceneError(f"drag: {len(law)} laws, granules of fraction {fraction.min()} to {fraction.max()}")
    tables, which, count = [], np.zeros(len(sphericity), dtype=np.int64), 0
    for name in dict.fromkeys(law):
        mine = np.isin(fraction, [i for i, other in enumerate(law) if other == name])
        made, used = _tables_of(name, sphericity[mine])
        which[mine] = count + used
        tables.append(made)
        count += len(made)
    return np.concatenate(tables), which


def _tables_of(law: str, sphericity: Array) -> tuple[Array, Index]:
    if not drag_laws[law].uses_sphericity:
        return drag_table(law)[None], np.zeros(len(sphericity), dtype=np.int64)
    values, which = np.unique(sphericity, return_inverse=True)
    if len(values) > MAX_TABLES:
        raise SceneError(f"granule sphericity: {len(values)} different values, allowed {MAX_TABLES}; round them")
    if not len(values):
        values = np.ones(1)
    return np.stack([drag_table(law, float(value)) for value in values]), which.astype(np.int64)


# -- From granules at birth to the state arrays of the kernel ----------------------------------------------------------
PAIRS = 1024  # granules whose distances from all covered edges are in memory at a time


def pack_state(flight: Packed, grains: Granules, streams: Index) -> tuple[Array, Index]:
    """State arrays at birth of granules with these ``streams`` (n,) of random numbers; one in the room a vibrating body
    has left begins at the boundary edge it is next to.
    """
    floats = np.zeros((len(grains), at.FLOATS))
    floats[:, at.X], floats[:, at.Y] = grains.position.T
    floats[:, at.VX], floats[:, at.VY] = grains.velocity.T
    floats[:, [at.LAG, at.LAG + 1]] = grains.velocity if grains.arrival is None else grains.arrival
    floats[:, at.SPIN], floats[:, at.T], floats[:, at.BORN] = grains.spin, grains.time, grains.time
    ints = np.zeros((len(grains), at.INTS), dtype=np.int64)
    ints[:, [at.FATE, at.LINE, at.FEATURE, at.GAP, at.TRI]] = -1
    ints[:, at.FATE] = at.FLYING
    ints[:, at.STREAM] = streams
    if flight.field is not VACUUM and len(grains):
        ints[:, at.TRI] = flight.field.locate(grains.position)
        outside = np.flatnonzero(ints[:, at.TRI] < 0)
        if len(outside) and len(flight.air.covered):
            ints[outside, at.GAP] = _nearest_covered(flight, flight.field, grains.position[outside])
    return floats, ints


def _nearest_covered(flight: Packed, field: FlowField, x: Array) -> Index:
    """Covered edge next to each point outside the mesh, -1 where none is as near as its body may have moved."""
    swing = max((float(np.hypot(*body.reach)) for body in flight.solids), default=0.0)
    triangle, edge = flight.air.covered[:, at.COVER_TRI], flight.air.covered[:, at.COVER_EDGE]
    a = field.points[field.triangles[triangle, (edge + 1) % 3]]
    along = field.points[field.triangles[triangle, (edge + 2) % 3]] - a
    nearest = np.full(len(x), -1, dtype=np.int64)
    for low in range(0, len(x), PAIRS):
        offset = x[low : low + PAIRS, None] - a
        w = np.clip(np.einsum("nci,ci->nc", offset, along) / np.einsum("ci,ci->c", along, along), 0.0, 1.0)
        distance = np.linalg.norm(offset - w[..., None] * along, axis=2)
        best = distance.argmin(axis=1)
        near = distance[np.arange(len(best)), best] <= swing + flight.reach
        nearest[low : low + PAIRS] = np.where(near, best, -1)
    return nearest


# -- The frame of a mesh that swings -----------------------------------------------------------------------------------
# Granules fly in it, so that the mesh and the body it moves with stand still. With the mesh displaced by d, y = x - d
# and w = v - d' obey the same equation with the air's velocity u(y, t) - d' and gravity g - d'': slips, drag and Du/Dt
# are what they are in the lab, and nothing is approximated. Bodies and bins that rest in the lab move by -d.
FREQUENCY_ROUNDING = 1e-9  # relative difference of frequencies and phases that counts as none
MINUTE = 1e-9  # of an amplitude: relative motion below it is round-off


def mesh_motion_of(field: FlowField) -> MeshOscillation:
    """How the field's mesh moves."""
    swing = field.motion
    return AT_REST if swing.x == 0.0 and swing.y == 0.0 else swing


def relative(body: Body, swing: MeshOscillation) -> list[float]:
    """Amplitude (x, y), angular frequency and phase of a body's motion seen from the mesh; zeros for none.

    Of one that rocks: its largest displacement. Of samples: the largest displacement, the pace of their fastest change,
    and the phase as a time (s). Raises SceneError for a body that vibrates otherwise than the mesh: about a pivot, with
    another frequency or phase, or by samples.
    """
    seen, motion = [0.0] * 4, body.motion
    if motion is not None and motion.moves:
        amplitude = np.asarray(motion.amplitude) if motion.pivot is None else body.reach
        seen = [*amplitude.tolist(), motion.pace, float(motion.phase)]
        if motion.record is not None:
            seen[3] *= motion.record.period / (2 * math.pi)
    if swing == AT_REST:
        return seen
    if motion is not None and motion.moves and motion.pivot is not None:
        raise SceneError(
            "bodies: one rocks about a pivot, the field's mesh vibrates; they must agree, or the body rest"
        )
    if motion is not None and motion.record is not None:
        raise SceneError("bodies: one moves by samples, the field's mesh vibrates; they must agree, or the body rest")
    if seen[2] != 0.0:
        lag = (seen[3] - swing.phase + math.pi) % (2 * math.pi) - math.pi
        if abs(seen[2] - swing.omega) > FREQUENCY_ROUNDING * swing.omega or abs(lag) > FREQUENCY_ROUNDING:
            raise SceneError(
                f"bodies: one vibrates at {seen[2] / (2 * math.pi):g} Hz, phase {seen[3]:g}, the field's mesh at "
                f"{swing.omega / (2 * math.pi):g} Hz, phase {swing.phase:g}: they must agree, or the body rest"
            )
    x, y = seen[0] - swing.x, seen[1] - swing.y
    if math.hypot(x, y) <= MINUTE * math.hypot(swing.x, swing.y):
        return [0.0] * 4
    return [x, y, swing.omega, swing.phase]


def to_frame(grains: Granules, swing: MeshOscillation) -> Granules:
    """Granules at birth as seen from the mesh."""
    if swing == AT_REST:
        return grains
    t, pace = grains.time, swing.velocity(grains.time)
    came = None if grains.arrival is None else grains.arrival - pace
    return grains.replace(
        position=grains.position - swing.displacement(t), velocity=grains.velocity - pace, arrival=came
    )


def from_frame(position: Any, velocity: Any, time: Any, swing: MeshOscillation) -> tuple[Array, Array]:
    """Positions and velocities (n, 2) at times (n,) back in the lab."""
    if swing == AT_REST:
        return position, velocity
    return position + swing.displacement(time), velocity + swing.velocity(time)
