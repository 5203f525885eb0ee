"""The collision of a granule with a wall or another granule: one law of impulses for the impact of eq. (1)-(2), the
tracker's walls, the labyrinth and crowds.

Rigid disc or sphere, Newton restitution R and Coulomb friction f. With the unit normal n (from the wall to the
granule), the tangent t = z x n and the spin counter-clockwise positive, the contact point moves along the wall with
s = (v - v_wall) . t - r omega. The normal impulse per mass is (1 + R) |v_n|. The tangential one changes s by (1 + 1/k)
times itself, k = I / (m r^2), so -s / (1 + 1/k) brings the contact point to rest (rolling); Coulomb's law caps it at
f (1 + R) |v_n|. Hence friction alone never reverses the contact point. The elasticity of the contact can: with the
tangential restitution b the slip of a contact that sticks becomes -b s, 0 where it is not given (Walton, O.R. 1993, in
Particulate Two-Phase Flow, ch. 25; Foerster, S.F., Louge, M.Y., Chang, H. & Allia, K. 1994, Phys. Fluids 6, 1108). A
point mass has 1/k = 0 and does not turn.
Source: Routh, E.J. 1897, Dynamics of a System of Rigid Bodies, ch. 4; Spade, Vaicis, Vutukuru & Irbe 2020, doi
10.22616/ERDev.2020.19.TF365, eq. (1)-(2), with the parenthesis and the sign misprinted there put right.

Two granules (``collide_pair``): the same impulses over the reduced mass m = 1 / (1/m1 + 1/m2), in three dimensions, the
slip opposite to its own direction. 1 + 1/k becomes m ((1 + 1/k1) / m1 + (1 + 1/k2) / m2); a wall is a second granule
without an inverse mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..core.registry import Registry
from .restitution import Restitution, restitution_at

__all__ = [
    "Impact", "ImpactModel", "approach_speed", "bounce", "collide", "collide_pair", "impact", "impact_models",
    "impulses",
]  # fmt: skip

Array = NDArray[np.float64]
TINY = np.finfo(float).tiny
STEEPEST = 1.5708  # rad, a vertical wall with room for round-off
ROUGH = 1e300  # a larger friction counts as this one: an infinite friction times no impulse would not be a number


@dataclass(frozen=True)
class ImpactModel:
    """How a granule turns when it is struck: ``inertia`` k = I / (m r^2) about its axis, None for a point mass that
    does not; the shape it ``means``; ``source``.
    """

    inertia: float | None
    means: str
    source: str

    @property
    def mobility(self) -> float:
        """1 / k = m r^2 / I; 0 for a point mass."""
        return 0.0 if self.inertia is None else 1.0 / self.inertia


impact_models: Registry[ImpactModel] = Registry("impact model")
_ROUTH = "Routh, E.J. 1897, Dynamics of a System of Rigid Bodies, ch. 1 (moments of inertia) and 4 (impact)"
impact_models.add("paper", ImpactModel(None, "a point mass: slips, or stops along the slope", "Spade et al. 2020"))
impact_models.add("sphere", ImpactModel(0.4, "a solid sphere: bead, round seed", _ROUTH))
impact_models.add("disc", ImpactModel(0.5, "a disc or solid cylinder about its axis: a lying kernel", _ROUTH))
impact_models.add("shell", ImpactModel(2.0 / 3.0, "a hollow sphere with a thin wall: an empty husk", _ROUTH))
impact_models.add("tube", ImpactModel(1.0, "a hollow cylinder with a thin wall about its axis: lying straw", _ROUTH))


def impulses(approach: Any, slip: Any, give: Any, restitution: Any, friction: Any, back: Any) -> Any:
    """Sizes (m/s, per reduced mass) of the normal impulse, and of the tangential one, which opposes the slip.

    ``approach`` and ``slip`` (m/s, not negative) of the contact point, ``give`` 1 + m r^2 / I: what a tangential
    impulse changes the slip by; coefficients of ``restitution``, ``friction`` and tangential restitution ``back``.
    Energy does not grow for restitutions within 0 and 1.
    """
    normal = (1.0 + restitution) * approach
    grip = np.minimum(friction, ROUGH) * normal
    return normal, np.minimum((1.0 + back) * slip / give, grip)


def collide(
    vx: Any, vy: Any, spin: Any, nx: Any, ny: Any, wx: Any, wy: Any, restitution: Any, friction: Any, mobility: Any,
    radius: Any, tangential_restitution: Any = 0.0,
) -> Any:  # fmt: skip
    """One collision with a wall; returns (vx, vy, spin, normal impulse, tangential impulse along t) after it, impulses
    per mass in m/s.

    ``n`` unit normal away from the wall, ``w`` velocity of the wall, ``mobility`` = m r^2 / I (0: point mass, 2.5:
    sphere, 2: disc), ``tangential_restitution`` of a contact that sticks. Numpy arithmetic only: takes arrays, and
    scalars inside the tracker's compiled kernel. Without approach (relative normal velocity >= 0) nothing changes.
    """
    rx = vx - wx
    ry = vy - wy
    approach = np.maximum(-(rx * nx + ry * ny), 0.0)
    slip = ry * nx - rx * ny - radius * spin * np.sign(mobility)
    normal, along = impulses(approach, np.abs(slip), 1.0 + mobility, restitution, friction, tangential_restitution)
    along = -np.copysign(along, slip)
    return (
        vx + normal * nx - along * ny,
        vy + normal * ny + along * nx,
        spin - mobility * along / radius,
        normal,
        along,
    )


def collide_pair(
    rx: Any, ry: Any, rz: Any, sx: Any, sy: Any, sz: Any, nx: Any, ny: Any, nz: Any, light: Any, heavy: Any,
    mobility: Any, other: Any, restitution: Any, friction: Any, tangential_restitution: Any = 0.0,
) -> Any:  # fmt: skip
    """The impulse (N s, three components) that the first of two granules gets from the second, the one that it gives
    with the sign turned; and its normal part.

    ``r`` velocity (m/s) of the first seen from the second, ``n`` unit normal from the second to the first, ``s`` =
    r1 omega1 + r2 omega2 (m/s, radii times spins of those that turn): the contact point slips with r - s x n. ``light``
    and ``heavy`` inverse masses (1/kg; a wall has 0), ``mobility`` and ``other`` = m r^2 / I of both (0: a point mass).
    The impulse J changes the velocities by J / m1 and -J / m2, the spins by -m r^2 / I (n x J) / (m r) of either.
    Momentum is kept; angular momentum is, where both turn. Takes arrays, and scalars inside the compiled kernel.
    """
    closing = rx * nx + ry * ny + rz * nz
    gx = rx - closing * nx - (sy * nz - sz * ny)
    gy = ry - closing * ny - (sz * nx - sx * nz)
    gz = rz - closing * nz - (sx * ny - sy * nx)
    slip = np.sqrt(gx * gx + gy * gy + gz * gz)
    mass = 1.0 / (light + heavy)
    give = mass * (light * (1.0 + mobility) + heavy * (1.0 + other))
    normal, along = impulses(np.maximum(-closing, 0.0), slip, give, restitution, friction, tangential_restitution)
    normal, along = mass * normal, mass * along / np.maximum(slip, TINY)
    return normal * nx - along * gx, normal * ny - along * gy, normal * nz - along * gz, normal


def approach_speed(vx: Any, vy: Any, nx: Any, ny: Any, wx: Any, wy: Any) -> Any:
    """Normal speed (m/s) at which a granule closes in on a wall, of which a restitution law is a function; 0 if not."""
    return np.maximum(-((vx - wx) * nx + (vy - wy) * ny), 0.0)


def bounce(
    velocity: ArrayLike,
    normal: ArrayLike,
    wall_velocity: ArrayLike,
    restitution: ArrayLike | Restitution,
    friction: ArrayLike,
) -> Array:
    """Velocities (..., 2) of point masses after they hit walls with unit outward normals (..., 2); all broadcast."""
    v, n, w = (np.asarray(a, dtype=float) for a in (velocity, normal, wall_velocity))
    ways = v[..., 0], v[..., 1], n[..., 0], n[..., 1], w[..., 0], w[..., 1]
    e = restitution_at(restitution, approach_speed(*ways))
    after = collide(*ways[:2], 0.0, *ways[2:], e, np.asarray(friction), 0.0, 1.0)
    return np.stack(np.broadcast_arrays(after[0], after[1]), axis=-1)


@dataclass(frozen=True)
class Impact:
    """The outcome of :func:`impact`; arrays of the broadcast shape."""

    tangential: Array  # m/s down the slope, body frame
    normal: Array  # m/s along the outward normal, body frame
    velocity: Array  # (..., 2) m/s, lab frame
    sticks: NDArray[np.bool_]  # the contact point comes to rest: it rolls (a point mass: stops along the slope)
    spin: Array  # rad/s, counter-clockwise positive (rolling towards +x is negative); NaN without a radius
    normal_impulse: Array  # m/s, per unit mass
    tangential_impulse: Array  # m/s, per unit mass, along the slope downwards: negative, since friction opposes sliding
    restitution: Array  # at the approach speed


def impact(
    slope_angle: ArrayLike,
    fall_speed: ArrayLike,
    body_speed: ArrayLike,
    restitution: ArrayLike | Restitution,
    friction: ArrayLike,
    inertia: ArrayLike | None = None,
    radius: ArrayLike | None = None,
) -> Impact:
    """A granule falling straight down at ``fall_speed`` (m/s) meets a slope that moves up at ``body_speed`` (m/s).

    ``slope_angle`` (rad) is measured from the horizontal; the slope descends towards +x. ``restitution``: numbers, or a
    law of the approach speed. ``inertia`` is I / (m r^2): None for the paper's point mass, 0.4 for a sphere, 0.5 for a
    disc (``impact_models``); ``radius`` (m) gives the spin its size. All broadcast. With W = fall_speed + body_speed
    <= 0 there is no impact and the velocity stays what it was. Raises SceneError for numbers out of range.

    >>> import numpy as np
    >>> np.round(impact(np.pi / 4, 1.4, 0.3, 0.5, 0.3).velocity, 4)
    array([0.8925, 0.2575])
    """
    approach = np.maximum((np.asarray(fall_speed) + np.asarray(body_speed)) * np.cos(slope_angle), 0.0)
    at_approach = restitution_at(restitution, approach)
    for name, given, least, most in (
        ("slope_angle (rad)", slope_angle, 0.0, STEEPEST),
        ("restitution", at_approach, 0.0, 1.0),
        ("friction", friction, 0.0, np.inf),
        ("inertia", 1.0 if inertia is None else inertia, TINY, np.inf),
        ("radius", 1.0 if radius is None else radius, TINY, np.inf),
    ):
        if not np.all((np.asarray(given) >= least) & (np.asarray(given) <= most)):
            raise SceneError(f"{name} = {given!r}: must be {'positive' if least > 0 else f'{least:g} to {most:g}'}")
    arguments = (slope_angle, fall_speed, body_speed, at_approach, friction)
    mobility = 0.0 if inertia is None else 1.0 / np.asarray(inertia, dtype=float)
    arm = 1.0 if radius is None else np.asarray(radius, dtype=float)
    b, fall, body, e, f, mobility, arm = np.broadcast_arrays(
        *(np.asarray(a, dtype=float) for a in (*arguments, mobility, arm))
    )
    nx, ny = np.sin(b), np.cos(b)
    vx, vy, spin, normal, along = collide(0.0, -fall, 0.0, nx, ny, 0.0, body, e, f, mobility, arm)
    hits = fall + body > 0.0
    slip = np.abs((fall + body) * nx)
    return Impact(
        tangential=vx * ny - (vy - body) * nx,
        normal=vx * nx + (vy - body) * ny,
        velocity=np.stack([vx, vy], axis=-1),
        sticks=hits & (np.minimum(f, ROUGH) * normal * (1.0 + mobility) >= slip),
        spin=np.full(b.shape, np.nan) if radius is None else spin,
        normal_impulse=normal,
        tangential_impulse=-along,
        restitution=e,
    )
