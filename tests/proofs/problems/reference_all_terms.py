"""The reference for problems without a closed form: scipy's integrators on the tracker's own interpolant.

One granule at a time, triangle by triangle and from snapshot to snapshot, so that the air is affine within each piece
and a method of high order meets no kinks; infinite planes stand for walls. DOP853 (Hairer, Norsett & Wanner 1993,
Solving Ordinary Differential Equations I) or, for stiff granules, Radau (Hairer & Wanner 1996, part II). The drag
factor is read from the tracker's table: its error, below 1e-8 of the law, is tested with the laws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.problems.exact import Setting
from wakeflow.air.field import FlowField
from wakeflow.core.errors import ProgramError
from wakeflow.laws.collision import collide
from wakeflow.laws.constants import GRAVITY
from wakeflow.laws.drag import TABLE_CELLS, TABLE_DECADES, drag_table
from wakeflow.laws.forces import Granule, Instant, forces
from wakeflow.laws.forces.force import drag_scale

Array = NDArray[np.float64]
MAX_PIECES = 20_000


@dataclass(frozen=True)
class Plane:
    """A wall of infinite extent: a ``point`` (2,) m on it, and the unit ``normal`` (2,) towards the granules."""

    point: Sequence[float]
    normal: Sequence[float]


def scalar_drag(law: str, sphericity: float) -> Callable[[float], float]:
    """The tracker's table of a drag law as a function of one Reynolds number."""
    table = drag_table(law, sphericity).tolist()
    low, high = TABLE_DECADES

    def factor(reynolds: float) -> float:
        at = (math.log10(min(max(reynolds, 10.0**low), 10.0**high)) - low) * TABLE_CELLS
        cell = min(int(at), len(table) - 1)
        c, w = table[cell], at - cell
        value: float = c[0] + w * (c[1] + w * (c[2] + w * c[3]))
        return value * max(reynolds / 10.0**high, 1.0)

    return factor


class _Air:
    """The interpolant within one triangle and one interval between snapshots or knots, as plain floats."""

    def __init__(self, field: FlowField, triangle: int, start: float) -> None:
        corner = field.triangles[triangle]
        gradient, origin = field.gradients[triangle], field.points[corner[0]]
        self.origin = (float(origin[0]), float(origin[1]))
        self.sides = [(1.0 if k == 0 else 0.0, *map(float, gradient[k])) for k in range(3)]
        nodal = [field.velocity]
        if field.pressure_gradient.size:
            nodal.append(field.pressure_gradient)
        self.start, self.end, shares = field.polynomial(start)
        self.powers: list[list[tuple[float, float, float]]] = []  # of the time since the start
        for share in shares:
            self.powers.append([])
            for values in nodal:
                parts = values if field.in_time else values[None]
                self.powers[-1] += _affine(np.tensordot(share, parts[:, corner], axes=1), gradient)

    def at(self, x: float, y: float, t: float) -> list[tuple[float, float, float, float]]:
        """Every component as (value, d/dx, d/dy, d/dt)."""
        dx, dy, dt = x - self.origin[0], y - self.origin[1], t - self.start
        found = []
        for terms in zip(*self.powers, strict=True):
            value = along = across = rise = 0.0
            for a, ax, ay in reversed(terms):  # Horner, the derivative with it
                rise = rise * dt + value
                value, along, across = value * dt + a + ax * dx + ay * dy, along * dt + ax, across * dt + ay
            found.append((value, along, across, rise))
        return found


def _affine(corners: Array, gradient: Array) -> list[tuple[float, float, float]]:
    slope = np.einsum("kd,kc->cd", gradient, corners)
    return [(float(corners[0, c]), float(slope[c, 0]), float(slope[c, 1])) for c in range(2)]


class _Motion:
    """The equation of motion of one granule: the right-hand side (x', y', vx', vy', spin', and of each memory of the
    slip its lag's x' and y').

    The forces bring their own formulas, written in plain Python beside their records.
    """

    def __init__(self, setting: Setting, i: int, field: FlowField) -> None:
        grains, arguments = setting.grains, setting.arguments
        acting = [forces[name] for name in forces if name in arguments.get("forces", ("drag", "gravity"))]
        self.accelerations = [force.reference for force in acting]
        self.inertias = [force.reference_inertia for force in acting]
        self.torques = [force.torque for force in acting]
        gravity = arguments.get("gravity", (0.0, -GRAVITY))
        self.granule = Granule(
            diameter=float(grains.diameter[i]),
            density=float(grains.density[i]),
            drag_scale=float(drag_scale(grains, field)[i]),
            inertia=float(grains.inertia[i]),
            drag_factor=scalar_drag(arguments.get("drag", "brown-lawler"), float(grains.sphericity[i])),
            air_density=field.density,
            viscosity=field.viscosity,
            gravity=(float(gravity[0]), float(gravity[1])),
            sphericity=float(grains.sphericity[i]),
        )
        self.memories = [pair for force in acting for pair in force.memory(self.granule)]
        self.air: _Air

    def lags(self, t: float, x: float, y: float, vx: float, vy: float) -> list[float]:
        """The memories of a granule that has had its slip for long."""
        (u, *_), (w, *_) = self.air.at(x, y, t)[:2]
        return [u - vx, w - vy] * len(self.memories)

    def __call__(self, t: float, z: Any) -> list[float]:
        x, y, vx, vy, spin, *lags = z
        air = self.air.at(x, y, t)
        (u, ux, uy, ut), (w, wx, wy, wt) = air[:2]
        now = Instant(
            granule=self.granule,
            slip=(u - vx, w - vy),
            curl=wx - uy,
            spin=spin,
            air_acceleration=(ut + u * ux + w * uy, wt + u * wx + w * wy),
            pressure_gradient=(air[2][0], air[3][0]) if len(air) > 2 else (math.nan, math.nan),
        )
        ax = ay = slowed = 0.0
        for acceleration in self.accelerations:
            along, across = acceleration(now)
            ax, ay = ax + along, ay + across
        for torque in self.torques:
            slowed += torque(now)
        rates: list[float] = []
        for (time, weight), lag_x, lag_y in zip(self.memories, lags[::2], lags[1::2], strict=True):
            new_x, new_y = u - vx - lag_x, w - vy - lag_y
            ax, ay = ax + weight * new_x, ay + weight * new_y
            rates += [new_x / time, new_y / time]
        inertia = 1.0 + sum(share(self.granule) for share in self.inertias)
        return [vx, vy, ax / inertia, ay / inertia, slowed, *rates]


def reference_end_states(
    setting: Setting, planes: Sequence[Plane] = (), stiff: bool = False, rtol: float = 1e-12
) -> Array:
    """End states (n, 5): position m, velocity m/s and spin rad/s of every granule after ``setting.until``.

    Forces: drag, gravity, buoyancy, pressure-gradient, lift, magnus, added-mass, basset-history. Granules bounce off
    ``planes`` with their surface, as point masses, which keep their spin. Raises ProgramError where scipy gives up or a
    granule leaves the mesh.
    """
    field = setting.field
    if field is None:
        raise ProgramError("the reference integrator needs a field")
    return np.array([_end_state(setting, field, i, planes, stiff, rtol) for i in range(len(setting.grains))])


def _end_state(
    setting: Setting, field: FlowField, i: int, planes: Sequence[Plane], stiff: bool, rtol: float
) -> list[float]:
    grains = setting.grains
    motion = _Motion(setting, i, field)
    z = [*map(float, grains.position[i]), *map(float, grains.velocity[i]), float(grains.spin[i])]
    t, triangle = float(grains.time[i]), int(field.locate(grains.position[i])[0])
    radius = float(grains.diameter[i]) / 2
    motion.air = _Air(field, triangle, t)
    came = grains.velocity[i] if grains.arrival is None else grains.arrival[i]
    z += motion.lags(t, z[0], z[1], float(came[0]), float(came[1]))
    for _ in range(MAX_PIECES):
        motion.air = _Air(field, triangle, t)
        if motion.air.end <= t + 1e-15 * max(1.0, abs(t)):  # round-off: on the snapshot, not just before it
            t = math.nextafter(t, math.inf) if motion.air.end <= t else motion.air.end
            continue
        end = min(setting.until, motion.air.end)
        t, z, event = _piece(motion, t, end, z, planes, radius, stiff, rtol)
        if event is None:
            if t >= setting.until:
                return z[:5]
        elif event < 3:
            triangle = int(field.neighbours[triangle, event])
            if triangle < 0:
                raise ProgramError(f"reference integrator: granule {i} left the mesh at t = {t:g} s")
        else:
            plane = planes[event - 3]
            rest = 0.0, 0.0, grains.restitution[i], grains.friction[i], 0.0, 1.0
            after = collide(*z[2:4], 0.0, *plane.normal, *rest)[:2]
            z = [z[0], z[1], float(after[0]), float(after[1]), *z[4:]]
    raise ProgramError(f"reference integrator: granule {i} went through {MAX_PIECES} pieces")


def _piece(
    motion: _Motion, t: float, end: float, z: list[float], planes: Sequence[Plane], radius: float, stiff: bool,
    rtol: float,
) -> tuple[float, list[float], int | None]:  # fmt: skip
    """Integrate to ``end`` or the first event: edges 0 to 2 of the triangle, then the planes.

    After an event the piece is integrated again up to the event's time, so that the result does not rest on dense
    output of lower order.
    """
    from scipy.integrate import solve_ivp

    method = "Radau" if stiff else "DOP853"
    options = {"method": method, "rtol": rtol, "atol": 1e-3 * rtol}
    ox, oy = motion.air.origin
    limits = [(c - bx * ox - by * oy, bx, by) for c, bx, by in motion.air.sides]
    for p in planes:
        nx, ny = p.normal
        limits.append((-nx * p.point[0] - ny * p.point[1] - radius, nx, ny))
    events: list[Any] = [lambda _, q, s=s: s[0] + s[1] * q[0] + s[2] * q[1] for s in limits]
    for event in events:
        event.terminal, event.direction = True, -1
    found = solve_ivp(motion, (t, end), z, events=events, dense_output=True, **options)
    if found.status < 0:
        raise ProgramError(f"reference integrator: {method} gave up at t = {found.t[-1]:g} s: {found.message}")
    which = None
    if found.status == 1:
        which = min((k for k in range(len(events)) if len(found.t_events[k])), key=lambda k: found.t_events[k][0])
        end = float(found.t_events[which][0])
    dips = [dip for k, s in enumerate(limits) if (dip := _dip(found, s, end, k)) is not None]
    if dips:
        end, which = min(dips)
    if which is not None and end > t:
        found = solve_ivp(motion, (t, end), z, **options)
    return end, [float(value) for value in found.y[:, -1]], which


def _dip(found: Any, limit: tuple[float, float, float], end: float, k: int) -> tuple[float, int] | None:
    """Find a crossing of a limit that returns within one step of the integrator, so that the ends of the step do not
    show it.
    """
    from scipy.optimize import brentq, minimize_scalar

    c, bx, by = limit
    rate = bx * found.y[2] + by * found.y[3]
    for i in np.flatnonzero((rate[:-1] < 0) & (rate[1:] > 0) & (found.t[:-1] < end)):

        def height(s: float) -> float:
            x, y = found.sol(s)[:2]
            return float(c + bx * x + by * y)

        span = (float(found.t[i]), min(float(found.t[i + 1]), end))
        lowest = float(minimize_scalar(height, bounds=span, method="bounded", options={"xatol": 1e-12}).x)
        if height(lowest) < -1e-12 * math.hypot(bx, by) and height(span[0]) > 0.0:
            return float(brentq(height, span[0], lowest, xtol=1e-16)), k
    return None
