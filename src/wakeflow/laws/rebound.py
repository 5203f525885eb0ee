"""The rebound of granules that are no spheres: the wall's normal, as the impact feels it, turned by a random angle.

A kernel touches a wall with some point of its surface that does not lie under its centre, so the impulse does not point
along the wall's normal. Seen from its centre the wall is turned: by a normal angle of zero mean, whose rms grows with
the shape's departure from a sphere (Glielmo, Gunkelmann & Poeschel 2014, Phys. Rev. E 90, 052204: the restitution of
aspherical particles is a random variable for this reason; the same turned normal stands for rough walls in Sommerfeld &
Huber 1999, Int. J. Multiphase Flow 25, 1457). The impact on the turned wall is the one of ``collision.collide``: with
the granule's own restitution, friction and spin, so it makes no energy.

A granule must leave the true wall. An angle that would throw it into the wall is halved until it and its opposite both
throw it off: the law stays symmetric, so its mean stays zero, as truncation on one side would not leave it. A granule
that grazes the wall, w along it and u << w into it, is turned by less than R u / (1 + R) / w without friction: its
rebound stays within 0 and 2 R u, about the R u of the smooth wall. Bounces die away as they do without scatter, and
sliding stays sliding; without restitution nothing is scattered.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .collision import collide

__all__ = ["HALVINGS", "thrown", "throws_off", "turned"]

Array = NDArray[np.float64]
HALVINGS = 40  # of an angle: then it is round-off, and none


def turned(nx: Any, ny: Any, angle: Any) -> Any:
    """The unit vector n turned counter-clockwise by an ``angle`` (rad). Arrays, or scalars in the compiled kernel."""
    c, s = np.cos(angle), np.sin(angle)
    return c * nx - s * ny, s * nx + c * ny


def throws_off(vx: Any, vy: Any, nx: Any, ny: Any, wx: Any, wy: Any, mx: Any, my: Any, ax: Any, ay: Any) -> Any:
    """Whether velocity v meets a turned wall of normal m, and velocity a, which it gives, leaves the true one of normal
    n; both walls move with w. Arrays, or scalars in the compiled kernel.
    """
    return ((vx - wx) * mx + (vy - wy) * my < 0.0) & ((ax - wx) * nx + (ay - wy) * ny > 0.0)


def thrown(
    velocity: Array, spin: Array, normal: Array, wall: Array, restitution: Any, friction: Any, mobility: Any,
    radius: Any, tangential_restitution: Any, angle: Array,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Collisions of granules of ``velocity`` (n, 2) m/s and ``spin`` (n,) rad/s with walls of unit ``normal`` (n, 2)
    and velocity ``wall`` (n, 2) m/s, the normals turned by ``angle`` (n,) rad or as much of it as throws them off.

    Other arguments as of :func:`~wakeflow.laws.collision.collide`. Returns velocity, spin and normal impulse (n,) m/s.
    """
    (vx, vy), (nx, ny), (wx, wy) = velocity.T, normal.T, wall.T

    def after(by: Array) -> tuple[Any, NDArray[np.bool_]]:
        mx, my = turned(nx, ny, by)
        ends = collide(
            vx, vy, spin, mx, my, wx, wy, restitution, friction, mobility, radius, tangential_restitution
        )  # fmt: skip
        return ends, throws_off(vx, vy, nx, ny, wx, wy, mx, my, *ends[:2])

    angle = np.where(np.asarray(restitution) > 0.0, angle, 0.0)
    held = angle != 0.0
    for _ in range(HALVINGS):
        if held.any():
            held &= ~(after(angle)[1] & after(-angle)[1])
            angle = np.where(held, 0.5 * angle, angle)
    (ax, ay, turning, impulse, _), _ = after(np.where(held, 0.0, angle))
    return np.stack([ax, ay], axis=-1), turning, impulse
