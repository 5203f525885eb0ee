"""The reference of the benchmark: the same equation of motion on the same interpolant, integrated to errors far below
every error that is measured.

Within one triangle, and between two snapshots or knots, the field is affine with coefficients polynomial in time, so a
method of high order meets no kinks: Dormand & Prince's method of order 8 with scipy's coefficients and error estimate
(Hairer, Norsett & Wanner 1993, Solving Ordinary Differential Equations I, II.5), every granule with a step of its own,
all granules at once. A step that would leave the triangle or enter a wall is shortened by Newton's method until it ends
there. It shares with the tracker the drag law's formula and the collision function, and nothing else.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..field import FlowField
from ..laws.collision import collide
from ..laws.constants import GRAVITY
from ..laws.drag import drag_laws
from ..tracking import Body, Granules

Array = NDArray[np.float64]
Index = NDArray[np.int64]
ON_EDGE = 1e-13  # barycentric coordinate, and gap over length, that counts as being there
BULGE = 1e-9  # how far the middle of a step may lie outside the triangle
SLOW = 1e-6  # m/s, rebounds slower than this begin sliding, which is not followed
IMPACTS = 50
FLYING, LANDED, AIRBORNE, UNFINISHED = range(4)


@dataclass(frozen=True)
class TrackingProblem:
    """What every tracker solves: field, bodies at rest, ``until`` (s), drag law, forces and gravity (m/s2)."""

    field: FlowField
    bodies: tuple[Body, ...]
    until: float
    length: float  # m, unit of errors
    drag: str = "putnam"
    forces: tuple[str, ...] = ("drag", "gravity", "buoyancy")
    gravity: tuple[float, float] = (0.0, -GRAVITY)

    @property
    def arguments(self) -> dict[str, Any]:
        """Those of ``track`` and ``fly_explicit``, but for the field, granules and accuracy."""
        names = ("until", "length", "drag", "forces", "bodies", "gravity")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Reference:
    """Where granules left the mesh: ``position`` (n, 2) m, ``time`` (n,) s, ``impacts`` (n,), ``landed`` (n,).

    Granules that are still in flight at the end, that began to slide or that ran out of the allowed time have not
    landed.
    """

    position: Array
    time: Array
    impacts: Index
    landed: NDArray[np.bool_]


class _Flight:
    """Granules in flight; arrays over all of them, worked on by index."""

    def __init__(self, problem: TrackingProblem, grains: Granules) -> None:
        self.problem, self.grains, self.field = problem, grains, problem.field
        assert problem.field.times is None or problem.field.period is not None  # steady, or it repeats
        field, count = problem.field, len(grains)
        self.y = np.concatenate([grains.position, grains.velocity], axis=1)
        self.t = grains.time.copy()
        self.spin = grains.spin.copy()
        self.tri = field.locate(grains.position)
        self.impacts = np.zeros(count, dtype=np.int64)
        self.state = np.where(self.tri >= 0, FLYING, UNFINISHED)
        self.h = np.full(count, np.inf)
        self.aim = np.full(count, np.inf)
        self.t_from, self.t_end, self.origin = np.zeros(count), np.zeros(count), np.zeros((count, 2))
        self.degrees = 1 if field.times is None else (2 if field.coefficients is None else 4)
        self.span = 0.0 if field.times is None else float(field.times[-1] - field.times[0])
        self.powers = np.zeros((self.degrees, count, 3, 4))  # of the time: value, d/dx, d/dy of u, v, ax, ay
        viscous = "drag" in problem.forces
        self.stokes = viscous * grains.drag_scale * 18.0 * field.viscosity / (grains.density * grains.diameter**2)
        self.per_slip = field.density * grains.diameter / field.viscosity
        self.pull = np.tile(np.array(problem.gravity) * ("gravity" in problem.forces), (count, 1))
        if "buoyancy" in problem.forces:
            self.pull -= (field.density / grains.density)[:, None] * np.array(problem.gravity)
        margin = float(grains.diameter.max()) + 0.02 * problem.length
        self.boxes = [(b.outline.min(axis=0) - margin, b.outline.max(axis=0) + margin, b) for b in problem.bodies]
        self.load_triangles(np.flatnonzero(self.state == FLYING))

    # -- the field -----------------------------------------------------------------------------------------------------

    def load_triangles(self, i: Index) -> None:
        """The affine field in the triangle that holds granules ``i`` now, as polynomials of the time from now on."""
        field, forces = self.field, self.problem.forces
        corner, gradient = field.triangles[self.tri[i]], field.gradients[self.tri[i]]
        self.origin[i] = field.points[corner[:, 0]]
        near = 1e-12 * (np.abs(self.t[i]) + self.span)  # on a snapshot, not just before it
        pieces = [field.polynomial(t) for t in self.t[i] + near]
        self.t_from[i], self.t_end[i] = [piece[0] for piece in pieces], [piece[1] for piece in pieces]
        shares = np.array([piece[2] for piece in pieces]).reshape(len(i), self.degrees, -1)

        def drawn(nodal: Array) -> Array:
            """The coefficients (P, n, 3, 2) of nodal values in the corners."""
            parts = nodal[None] if field.times is None else nodal
            return np.asarray(np.einsum("npr,rnkc->pnkc", shares, parts[:, corner]))

        value = np.concatenate([drawn(field.velocity), np.zeros((self.degrees, len(i), 3, 2))], axis=3)
        value[0, :, :, 2:] = self.pull[i, None]
        if "pressure-gradient" in forces:
            assert field.pressure_gradient is not None
            value[..., 2:] -= drawn(field.pressure_gradient) / self.grains.density[i, None, None]
        self.powers[:, i] = np.concatenate([value[:, :, :1], np.einsum("nkd,pnkm->pndm", gradient, value)], axis=2)

    def rhs(self, i: Index, t: Array, y: Array) -> Array:
        """d(x, v)/dt (n, 4) of granules ``i``."""
        away = y[:, :2] - self.origin[i]
        since, value = (t - self.t_from[i])[:, None], np.zeros((len(i), 4))
        for now in self.powers[::-1, i]:
            value = since * value + now[:, 0] + away[:, :1] * now[:, 1] + away[:, 1:] * now[:, 2]
        slip = value[:, :2] - y[:, 2:]
        reynolds = self.per_slip[i] * np.hypot(slip[:, 0], slip[:, 1])
        rate = self.stokes[i] * drag_laws[self.problem.drag].factor(reynolds, self.grains.sphericity[i])
        return np.concatenate([y[:, 2:], rate[:, None] * slip + value[:, 2:]], axis=1)

    # -- where they are ------------------------------------------------------------------------------------------------

    def inside(self, i: Index, y: Array) -> tuple[Array, Array]:
        """Distances from everything that ends a step, positive inside, and their rates: three edges of the triangle,
        then every body.

        (n, 3 + bodies); barycentric coordinates, gaps over the length.
        """
        gradient = self.field.gradients[self.tri[i]]
        level = np.einsum("nkd,nd->nk", gradient, y[:, :2] - self.origin[i])
        level[:, 0] += 1.0
        rate = np.einsum("nkd,nd->nk", gradient, y[:, 2:])
        size = self.problem.length
        for low, high, body in self.boxes:
            gap, along = np.full(len(i), np.inf), np.zeros(len(i))
            near = np.flatnonzero(((y[:, :2] > low) & (y[:, :2] < high)).all(axis=1))
            if len(near):
                away, normal = distance(body.outline, y[near, :2])
                gap[near] = (away - 0.5 * self.grains.diameter[i[near]]) / size
                along[near] = (normal * y[near, 2:]).sum(axis=1) / size
            level, rate = np.column_stack([level, gap]), np.column_stack([rate, along])
        return level, rate

    def arrive(self, i: Index) -> None:
        """Cross edges and bounce off bodies where granules stand on them and move out."""
        level, rate = self.inside(i, self.y[i])
        out = (level <= ON_EDGE) & (rate < 0.0)
        hit = out[:, 3:].any(axis=1)
        if hit.any():
            self._bounce(i[hit], out[hit, 3:].argmax(axis=1))
        over = out[:, :3].any(axis=1) & ~hit
        j = i[over]
        edge = np.where(out[over, :3], rate[over, :3], 0.0).argmin(axis=1)
        onward = self.field.neighbours[self.tri[j], edge]
        self.state[j[onward < 0]] = LANDED
        stay = onward >= 0
        self.tri[j[stay]] = onward[stay]
        turn = i[(self.t[i] >= self.t_end[i]) & (self.state[i] == FLYING)]
        fresh = np.union1d(j[stay], turn)
        self.aim[fresh] = np.inf
        if len(fresh):
            self.load_triangles(fresh)

    def _bounce(self, i: Index, which: Index) -> None:
        for number, body in enumerate(self.problem.bodies):
            j = i[which == number]
            if not len(j):
                continue
            g = self.grains
            nx, ny = distance(body.outline, self.y[j, :2])[1].T
            e = g.restitution[j] if body.restitution is None else body.restitution
            f = g.friction[j] if body.friction is None else body.friction
            vx, vy, self.spin[j], _, _ = collide(
                self.y[j, 2], self.y[j, 3], self.spin[j], nx, ny, 0.0, 0.0, e, f, 1.0 / g.inertia[j],
                0.5 * g.diameter[j],
            )  # fmt: skip
            self.y[j, 2], self.y[j, 3] = vx, vy
            self.impacts[j] += 1
            slow = nx * vx + ny * vy < SLOW
            self.state[j[slow | (self.impacts[j] > IMPACTS)]] = UNFINISHED
            self.aim[j] = np.inf

    # -- steps ---------------------------------------------------------------------------------------------------------

    def step(self, i: Index, rtol: float) -> None:
        """One attempt at a step of every granule ``i``."""
        y, t = self.y[i], self.t[i]
        left = np.minimum(self.t_end[i], self.problem.until) - t
        h = np.minimum(self._longest(i, y), left)
        h = np.where(np.isfinite(h), h, 1e-3)
        with np.errstate(over="ignore", invalid="ignore"):
            end, error = dormand_prince(lambda at, z: self.rhs(i, at, z), t, y, h, rtol)
        good = error < 1.0
        outside, bulge, share = self._beyond(i, y, np.where(good[:, None], end, y), h)
        self.aim[i] = np.where(good & outside, np.minimum(share * h, np.nextafter(h, 0.0)), np.inf)
        self.aim[i] = np.where(good & bulge, np.minimum(self.aim[i], 0.5 * h), self.aim[i])
        grown = h * np.clip(0.9 * np.maximum(error, 1e-16) ** (-1.0 / 8.0), 0.2, 10.0)
        # an accepted step that an event cut short says little about the next one, which may be as long as before
        self.h[i] = np.where(good & (h < self.h[i]), np.maximum(self.h[i], grown), grown)
        accept = good & ~outside & ~bulge
        j, done = i[accept], h[accept] == left[accept]
        self.y[j] = end[accept]
        self.t[j] = np.where(done, np.minimum(self.t_end[j], self.problem.until), t[accept] + h[accept])
        self.state[j[self.t[j] >= self.problem.until]] = AIRBORNE

    def _longest(self, i: Index, y: Array) -> Array:
        """The next step: limited by the last error, and by the planned end or the straight way to what ends it."""
        level, rate = self.inside(i, y)
        with np.errstate(divide="ignore", invalid="ignore"):
            straight = np.where(rate < 0.0, np.maximum(level, 0.0) / -rate, np.inf).min(axis=1)
        guess = np.where(straight > 1e-9, 1.02, 1.0) * straight
        return np.asarray(np.minimum(self.h[i], np.where(np.isfinite(self.aim[i]), self.aim[i], guess)))

    def _beyond(self, i: Index, y: Array, end: Array, h: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
        """Whether steps end outside, or bulge out between; and the share of the step after which Newton sees the way
        out.
        """
        level, rate = self.inside(i, end)
        middle = 0.5 * (y + end)[:, :2] + 0.125 * h[:, None] * (y - end)[:, 2:]
        bulge = (self.inside(i, np.concatenate([middle, y[:, 2:]], axis=1))[0] < -BULGE).any(axis=1)
        over, outwards = level < -ON_EDGE, rate < 0.0
        newton = np.clip(1.0 - level / np.where(outwards, rate, -1.0) / h[:, None], 0.05, 1.0)
        share = np.where(over, np.where(outwards, newton, 0.5), 1.0).min(axis=1)
        return np.asarray(over.any(axis=1)), np.asarray(bulge), share


def dormand_prince(rhs: Any, t: Array, y: Array, h: Array, rtol: float) -> tuple[Array, Array]:
    """The end of a step (n, 4) and its error over what is allowed (n,), as scipy's DOP853 forms them."""
    from scipy.integrate import DOP853

    k = np.zeros((DOP853.n_stages + 1, *y.shape))
    k[0] = rhs(t, y)
    for s in range(1, DOP853.n_stages):
        k[s] = rhs(t + DOP853.C[s] * h, y + h[:, None] * np.tensordot(DOP853.A[s, :s], k[:s], axes=1))
    end = y + h[:, None] * np.tensordot(DOP853.B, k[:-1], axes=1)
    k[-1] = rhs(t + h, end)
    scale = rtol * (1e-3 + np.maximum(np.abs(y), np.abs(end)))
    fifth = (np.tensordot(DOP853.E5, k, axes=1) / scale) ** 2
    third = (np.tensordot(DOP853.E3, k, axes=1) / scale) ** 2
    five, three = fifth.sum(axis=1), third.sum(axis=1)
    denominator = np.sqrt((five + 0.01 * three) * y.shape[1])
    error = np.where(denominator > 0.0, h * five / np.where(denominator > 0.0, denominator, 1.0), 0.0)
    sound = np.isfinite(denominator) & np.isfinite(end).all(axis=1)
    return end, np.where(sound, error, 1e8)


def distance(outline: Array, x: Array) -> tuple[Array, Array]:
    """Distance (n,) of points from a closed outline, negative inside, and the unit vector (n, 2) away from it."""
    least, away = np.full(len(x), np.inf), np.zeros((len(x), 2))
    odd = np.zeros(len(x), dtype=bool)
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        along = b - a
        w = np.clip((x - a) @ along / (along @ along), 0.0, 1.0)
        offset = x - a - w[:, None] * along
        size = np.hypot(offset[:, 0], offset[:, 1])
        nearer = size < least
        least[nearer], away[nearer] = size[nearer], offset[nearer]
        if a[1] != b[1]:
            odd ^= ((a[1] > x[:, 1]) != (b[1] > x[:, 1])) & (x[:, 0] < a[0] + (x[:, 1] - a[1]) / along[1] * along[0])
    sign = np.where(odd, -1.0, 1.0)
    return sign * least, (sign / np.where(least > 0.0, least, 1.0))[:, None] * away


def fly_reference(
    problem: TrackingProblem, grains: Granules, *, rtol: float = 1e-12, seconds: float = np.inf
) -> Reference:
    """Integrate every granule until it leaves the mesh; ``seconds`` bounds the run time; granules that are not done by
    then have not landed.
    """
    flight = _Flight(problem, grains)
    begun = clock.monotonic()
    while True:
        i = np.flatnonzero(flight.state == FLYING)
        if not len(i) or clock.monotonic() - begun > seconds:
            break
        flight.arrive(i)
        i = i[flight.state[i] == FLYING]
        flight.step(i, rtol)
    return Reference(flight.y[:, :2].copy(), flight.t.copy(), flight.impacts, flight.state == LANDED)
