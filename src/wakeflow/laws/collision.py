"""The collision of a granule with a wall or another granule: one law of impulses for the impact of eq. (1)-(2), the
tracker's walls, the labyrinth and granules that meet.

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

Source: Hertz (1881); Johnson (1985), Contact Mechanics, section 11.4. Range: elastic, no adhesion,
depth small against the radius.

A kernel touches a wall with some point of its surface that does not lie under its centre, so the impulse does not point
along the wall's normal. Seen from its centre the wall is turned: by a normal angle of zero mean, whose rms grows with
the shape's departure from a sphere (Glielmo, Gunkelmann & Poeschel 2014, Phys. Rev. E 90, 052204: the restitution of
aspherical particles is a random variable for this reason; the same turned normal represents rough walls in Sommerfeld &
Huber 1999, Int. J. Multiphase Flow 25, 1457). The impact on the turned wall is the one of ``collision.collide``: with
the granule's own restitution, friction and spin, so it makes no energy.

A granule must leave the true wall. An angle that would throw it into the wall is halved until it and its opposite both
throw it off: the law stays symmetric, so its mean stays zero, as truncation on one side would not leave it. A granule
that grazes the wall, w along it and u << w into it, is turned by less than R u / (1 + R) / w without friction: its
rebound stays within 0 and 2 R u, about the R u of the smooth wall. Bounces die away as they do without scatter, and
sliding stays sliding; without restitution nothing is scattered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import numbers
from ..core.errors import SceneError
from ..core.registry import Registry
from .flake import flung
from .restitution import Restitution, restitution_at

Array = NDArray[np.float64]
TINY = np.finfo(float).tiny
STEEPEST = 1.5708  # rad, a vertical wall with room for round-off
ROUGH = 1e300  # a larger friction counts as this one: an infinite friction times no impulse would not be a number


@dataclass(frozen=True)
class ImpactModel:
    """How a granule turns when it is struck: ``inertia`` k = I / (m r^2) about its axis, infinite for a point mass that
    does not; the shape it ``means``; ``source``; whether it is a ``flake``, whose spin is drawn (``laws.flake``).
    """

    inertia: float
    means: str
    source: str
    flake: bool = False


impact_models: Registry[ImpactModel] = Registry("impact model")
_ROUTH = "Routh, E.J. 1897, Dynamics of a System of Rigid Bodies, ch. 1 (moments of inertia) and 4 (impact)"
impact_models.add("paper", ImpactModel(math.inf, "a point mass: slips, or stops along the slope", "Spade et al. 2020"))
impact_models.add("sphere", ImpactModel(0.4, "a solid sphere: bead, round seed", _ROUTH))
impact_models.add("kernel", ImpactModel(
    0.4, "a kernel that comes any way: along a slope it goes, in the mean, as a solid sphere",
    "rigid ellipsoids of measured kernels' dimensions on slopes: 2.0 to 3.0 of m r^2 / I (docs/model.md)",
))  # fmt: skip
impact_models.add("disc", ImpactModel(0.5, "a disc or solid cylinder about its axis: a lying kernel", _ROUTH))
impact_models.add("shell", ImpactModel(2.0 / 3.0, "a hollow sphere with a thin wall: an empty husk", _ROUTH))
impact_models.add("tube", ImpactModel(1.0, "a hollow cylinder with a thin wall about its axis: lying straw", _ROUTH))
impact_models.add(
    "flake", ImpactModel(0.5, "a thin plate: its centre goes as a disc's, its spin is drawn", _ROUTH, True)
)


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
    b, f = numbers("slope_angle", slope_angle, "rad"), numbers("friction", friction)
    fall, body = numbers("fall_speed", fall_speed, "m/s"), numbers("body_speed", body_speed, "m/s")
    k = numbers("inertia", np.inf if inertia is None else inertia)
    arm = numbers("radius", 1.0 if radius is None else radius, "m")
    e = restitution_at(restitution, np.maximum((fall + body) * np.cos(b), 0.0))
    for name, given, least, most in (
        ("slope_angle (rad)", b, 0.0, STEEPEST),
        ("restitution", e, 0.0, 1.0),
        ("friction", f, 0.0, np.inf),
        ("inertia", k, TINY, np.inf),
        ("radius", arm, TINY, np.inf),
    ):
        if not np.all((given >= least) & (given <= most)):
            raise SceneError(
                f"{name} = {given.tolist()}: must be {'positive' if least > 0 else f'{least:g} to {most:g}'}"
            )
    b, fall, body, e, f, mobility, arm = np.broadcast_arrays(b, fall, body, e, f, 1.0 / k, arm)
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


# -- Hertz' contact of elastic spheres ---------------------------------------------------------------------------------
def contact_time(diameter: float, density: float, modulus: float, speed: float, poisson: float = 0.25) -> float:
    """Duration (s) of the collision of two equal spheres at relative ``speed`` (m/s).

    2.868 (m^2 / (R E^2 v))^(1/5) with the effective mass m, radius R and modulus E; ``diameter`` m, ``density`` kg/m3,
    Young's ``modulus`` Pa.
    """
    mass, radius, stiff = density * math.pi / 12 * diameter**3, 0.25 * diameter, modulus / (2 * (1 - poisson**2))
    value: float = 2.868 * (mass**2 / (radius * stiff**2 * speed)) ** 0.2
    return value


# -- The rebound of granules that are no spheres -----------------------------------------------------------------------
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


def scattered_rebound(
    velocity: Array, spin: Array, normal: Array, wall: Array, restitution: Any, friction: Any, mobility: Any,
    radius: Any, tangential_restitution: Any, angle: Array, toss: Any = 0.0, xi: Any = 0.0,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Collisions of granules of ``velocity`` (n, 2) m/s and ``spin`` (n,) rad/s with walls of unit ``normal`` (n, 2)
    and velocity ``wall`` (n, 2) m/s, the normals turned by ``angle`` (n,) rad or as much of it as throws them off.

    ``toss`` of flakes and their numbers ``xi`` as of :func:`~wakeflow.laws.flake.flung`, other arguments as of
    :func:`~wakeflow.laws.collision.collide`. Returns velocity, spin and normal impulse (n,) m/s.
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
    (ax, ay, turning, impulse, along), _ = after(np.where(held, 0.0, angle))
    freed = (vx - wx) ** 2 + (vy - wy) ** 2 - (ax - wx) ** 2 - (ay - wy) ** 2
    turning = np.where(np.asarray(toss) > 0.0, flung(spin, np.asarray(toss), impulse, along, freed, xi), turning)
    return np.stack([ax, ay], axis=-1), turning, impulse
