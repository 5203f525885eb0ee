"""A strike's coefficient of restitution, and the normal of a wall as a granule that is no sphere feels it."""

from __future__ import annotations

import math

from ...laws.collision import HALVINGS, approach_speed, collide, throws_off, turned
from ...laws.flake import flung
from ...laws.random_numbers import normal_pair, uniform
from . import layout as at
from .jit import compiled

# -- The coefficient of restitution of one strike ----------------------------------------------------------------------
_approach, _uniform = compiled(approach_speed), compiled(uniform)
MIN_SPEED = 1e-300  # m/s: has a logarithm


@compiled
def stays(state, ints, grain, walls, body, nx, ny, wx, wy, seed):
    """Whether a granule ends at ``body``, whose surface moves with w and has the normal n there: the body keeps a part
    of the impacts, as does any wall of those that are slower than the granule's capture speed. One that ends has that
    fate then, and the body's line. The draw is this impact's own, see ``tilted``.
    """
    approach, part = -((state[at.VX] - wx) * nx + (state[at.VY] - wy) * ny), walls.bodies[body, at.KEEPS]
    if 0.0 <= approach < grain[at.CAPTURE]:
        part = max(part, grain[at.STICKS])
    ends = part >= 1.0 or (part > 0.0 and _uniform(seed, ints[at.STREAM], -1 - ints[at.IMPACTS]) < part)
    if ends:
        ints[at.FATE], ints[at.LINE] = at.CAPTURED, walls.members[body, at.COUNTS_AS]
    return ends


@compiled
def friction_of(grain, walls, body):
    """The coefficient of friction at a body: the body's, else the granule's."""
    of_body = walls.bodies[body, at.BODY_FRICTION]
    return grain[at.FRICTION] if of_body < 0.0 else of_body


@compiled
def restitution_of(state, grain, walls, body, nx, ny, wx, wy):
    """e of the collision with ``body``, whose surface moves with w and has the normal n there."""
    of_body = walls.bodies[body, at.BODY_RESTITUTION]
    if of_body >= 0.0:
        return of_body
    if grain[at.RESTITUTION] >= 0.0:
        return grain[at.RESTITUTION]
    cells = walls.restitution
    y = math.log10(max(_approach(state[at.VX], state[at.VY], nx, ny, wx, wy), MIN_SPEED))
    low, high = 0, cells.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if cells[middle, at.CELL_BEGIN] <= y:
            low = middle
        else:
            high = middle
    w = min(1.0, max(0.0, (y - cells[low, at.CELL_BEGIN]) * cells[low, at.CELL_PER]))
    e = cells[low, at.CELL_0] + w * (cells[low, at.CELL_1] + w * (cells[low, at.CELL_2] + w * cells[low, at.CELL_3]))
    return min(1.0, max(0.0, e))


# -- The wall's normal as an impact of a granule that is no sphere feels it --------------------------------------------
_collide, _normals, _turned, _throws_off, spin_flung = (
    compiled(law) for law in (collide, normal_pair, turned, throws_off, flung)
)


@compiled
def _is_thrown_off(state, hold, grain, wx, wy, e, friction, angle):
    """Whether the wall in ``hold`` turned by an angle throws the granule off the wall."""
    vx, vy, nx, ny = state[at.VX], state[at.VY], hold[at.NX], hold[at.NY]
    mx, my = _turned(nx, ny, angle)
    ax, ay, _, _, _ = _collide(
        vx, vy, state[at.SPIN], mx, my, wx, wy, e, friction, grain[at.BLOW], grain[at.RADIUS], grain[at.GIVES_BACK]
    )
    return _throws_off(vx, vy, nx, ny, wx, wy, mx, my, ax, ay)


@compiled
def tilted(state, ints, hold, grain, wx, wy, e, friction, seed):
    """The normal of the wall in ``hold``, which moves with w, turned by the random angle of this impact.

    Its number counts the granule's impacts downward from -1; those of the air's noise count upward (``dispersion``).
    """
    nx, ny = hold[at.NX], hold[at.NY]
    if e == 0.0:
        return nx, ny
    xi, _ = _normals(seed, ints[at.STREAM], -1 - ints[at.IMPACTS])
    angle = grain[at.SCATTER] * xi
    for _ in range(HALVINGS):
        if _is_thrown_off(state, hold, grain, wx, wy, e, friction, angle) and _is_thrown_off(
            state, hold, grain, wx, wy, e, friction, -angle
        ):
            return _turned(nx, ny, angle)
        angle *= 0.5
    return nx, ny


@compiled
def flake_spin(ints, grain, spin, rx, ry, sx, sy, nx, ny, seed):
    """Spin of a flake after the blow that brings its velocity seen from the wall from r to s, by this impact's numbers:
    the second of the pair whose first is in ``tilted``.
    """
    _, xi = _normals(seed, ints[at.STREAM], -1 - ints[at.IMPACTS])
    jx, jy = sx - rx, sy - ry
    freed = rx * rx + ry * ry - sx * sx - sy * sy
    return spin_flung(spin, grain[at.TOSS], jx * nx + jy * ny, jy * nx - jx * ny, freed, xi)
