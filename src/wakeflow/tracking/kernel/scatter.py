"""The wall's normal as an impact of a granule that is no sphere feels it; the law is in laws/rebound.py."""

from __future__ import annotations

from ...laws.collision import collide
from ...laws.random_numbers import normal_pair
from ...laws.rebound import HALVINGS, throws_off, turned
from . import layout as at
from .jit import compiled

__all__ = ["tilted"]

_collide, _normals, _turned, _throws_off = (compiled(law) for law in (collide, normal_pair, turned, throws_off))


@compiled
def _is_thrown_off(state, hold, grain, wx, wy, e, friction, angle):
    """Whether the wall in ``hold`` turned by an angle throws the granule off the wall."""
    vx, vy, nx, ny = state[at.VX], state[at.VY], hold[at.NX], hold[at.NY]
    mx, my = _turned(nx, ny, angle)
    ax, ay, _, _, _ = _collide(
        vx, vy, state[at.SPIN], mx, my, wx, wy, e, friction, grain[at.MOBILITY], grain[at.RADIUS], grain[at.GIVES_BACK]
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
