"""Impaction efficiency: of a body in an airflow, and of a sphere that moves through fine granules.

A granule that comes with the speed v and the relaxation time tau (at its slip) passes the body of half width h in
h / v, while the air, of speed U, turns aside and drags it along: with K = tau v / h the share of the granules that get
round the body goes as (U / v) / K for large K. An aerosol drifts with the air, v = U, and K is then the inertial
parameter of the textbooks; a granule slower than the air is turned more, a faster one less. So nothing is fitted to K
alone: granules are flown through the exact ideal flow before the body, with their own drag, weight, radius and speed.

*wedge* (rhombus, prism, any body with an edge towards the air): ideal flow in a channel round a wedge that goes on as
a parallel wake of the body's width, by the Schwarz-Christoffel map dz/dw = [(1 - s / b) / (1 - s)]^(alpha / pi) / U,
s = exp(pi w / (U H)), b = (H / (H - h))^(pi / alpha); alpha the angle between face and stream, H the half channel
(Milne-Thomson, L.M. 1968, Theoretical Hydrodynamics, ch. 10). Before a bluff body air is close to ideal; its wake is
wider than the body, so that the real air turns granules aside somewhat more. What is behind the shoulder is not meant.
A sharp edge has no critical Stokes number: the strain at its tip has no bound, and some of the finest dust meets it.

*cylinder*: unbounded ideal flow, w = U (z + h^2 / z), stagnation strain 2 U / h: points with K < 1/8 all get round it
(Langmuir, I. & Blodgett, K.B. 1946, US Army Air Forces Tech. Rep. 5418; Taylor, G.I. 1940).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.registry import Registry

# -- Impaction efficiency ----------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
Complex = NDArray[Any]
STEP_PART = 0.1  # of the distance to the nearest edge of the body: how far a granule or the air goes in a step
NEAREST = 0.01  # half widths: nearer to an edge steps do not shrink any more
MIN_SPEED_PART = 1e-3  # of the air's speed: what a step's length is at least divided by
STEPS = 2000  # steps; granules that are not past the body by then hover before it
AHEAD = 2.5  # half channels upstream, where the flow is uniform to 4e-4
DOWN = 50.0  # half channels downstream, where nothing is left to change
RAYS = 48  # granules across the body, in each of two rounds: the efficiency is known to 1/2300


class Front(Protocol):
    """The ideal flow before a body. Points are complex, x with the stream and y across, the foremost point at 0; a
    ``label`` tells where in the flow a point is and moves along with it.
    """

    @property
    def half(self) -> float:
        """Half width of the body (m)."""

    @property
    def depth(self) -> float:
        """x of its widest point (m)."""

    def __hash__(self) -> int: ...

    def label(self, z: Complex) -> Complex:
        """Labels of points ahead of the body."""

    def air(self, label: Complex) -> tuple[Complex, Complex]:
        """Velocity u + i v (m/s) and the label's derivative along z."""

    def away(self, z: Complex) -> Complex:
        """The way from the nearest point of the body's face to z (m)."""

    def inside(self, z: Complex) -> NDArray[np.bool_]:
        """Whether z lies within the body or the wake behind it."""

    def edge(self, z: Complex) -> Array:
        """Distance (m) from the nearest point where the flow changes fast."""


@dataclass(frozen=True)
class Wedge:
    """A wedge of half width ``half`` (m) and length ``depth`` (m; 0: a plate across the stream) in a channel of half
    width ``channel`` (m) with air of ``speed`` (m/s), and its wake of constant width.
    """

    half: float
    depth: float
    channel: float
    speed: float

    @property
    def _power(self) -> float:
        return math.atan2(self.half, self.depth) / math.pi

    def _slope(self, w: Complex) -> Complex:
        """dw/dz / U at the potential w / (U H), a dimensionless complex number with 0 <= Im <= 1."""
        s = np.exp(math.pi * (np.minimum(w.real, DOWN) + 1j * np.clip(w.imag, 1e-12, 1.0)))
        far = (self.channel / (self.channel - self.half)) ** (-1.0 / self._power)
        return np.asarray(((1.0 - s) / (1.0 - far * s)) ** self._power)  # Im s >= 0: on one branch

    def label(self, z: Complex) -> Complex:
        """w / (U H), from far upstream, where w = U z but for a constant, straight down to z."""
        node, weight = np.polynomial.legendre.leggauss(48)
        t = 0.5 * math.sqrt(AHEAD) * (node + 1.0)  # w = -t^2 takes the singularity at the tip out
        along = (1.0 / self._slope(-(t**2) + 0j)).real
        offset = float(np.sum(0.5 * math.sqrt(AHEAD) * weight * along * 2.0 * t)) - AHEAD
        target = z / self.channel
        here = -AHEAD + 1j * target.imag
        w = here + offset
        steps = 64
        for k in range(steps):  # Heun in a quadratically refined way
            ahead = -AHEAD + (target.real + AHEAD) * (1.0 - (1.0 - (k + 1) / steps) ** 2) + 1j * target.imag
            slope = self._slope(w)
            trial = w + slope * (ahead - here)
            w = w + 0.5 * (slope + self._slope(trial)) * (ahead - here)
            here = ahead
        return w

    def air(self, label: Complex) -> tuple[Complex, Complex]:
        slope = self._slope(label)
        return self.speed * slope.conj(), slope / self.channel

    def away(self, z: Complex) -> Complex:
        face = complex(self.depth, self.half)
        along = np.clip((z * face.conjugate()).real / abs(face) ** 2, 0.0, 1.0)
        return np.asarray(z - along * face)

    def inside(self, z: Complex) -> NDArray[np.bool_]:
        return np.asarray((z.real * self.half - z.imag * self.depth > 0.0) & (z.imag < self.half))

    def edge(self, z: Complex) -> Array:
        return np.minimum(np.abs(z), np.abs(z - complex(self.depth, self.half)))


@dataclass(frozen=True)
class Cylinder:
    """A circle of radius ``half`` (m) in unbounded air of ``speed`` (m/s)."""

    half: float
    speed: float

    @property
    def depth(self) -> float:
        return self.half

    def label(self, z: Complex) -> Complex:
        return z

    def air(self, label: Complex) -> tuple[Complex, Complex]:
        z = label - self.half
        outside = np.maximum(np.abs(z), 0.5 * self.half)
        return self.speed * (1.0 - (self.half * z.conj() / outside**2) ** 2).conj(), np.ones_like(z)

    def away(self, z: Complex) -> Complex:
        from_centre = z - self.half
        return np.asarray(from_centre * (1.0 - self.half / np.maximum(np.abs(from_centre), 1e-300)))

    def inside(self, z: Complex) -> NDArray[np.bool_]:
        return np.asarray(np.abs(z - self.half) < self.half)

    def edge(self, z: Complex) -> Array:
        return np.abs(np.abs(z - self.half) - self.half)


fronts: Registry[Callable[..., Front]] = Registry("front")


@fronts.register("circle")
def circle(*, half: float, speed: float, **_rest: float) -> Front:
    """The cylinder; the channel's walls are left out, and its depth is its radius."""
    return Cylinder(half, speed)


@fronts.register("wedge")
def wedge(*, half: float, depth: float, channel: float, speed: float) -> Front:
    """The wedge that has the body's width, and the depth of its widest point below its foremost."""
    return Wedge(half, depth, channel, speed)


@dataclass(frozen=True)
class Met:
    """Granules (n, m) where their surface met the face, or where they were lost: ``hit``, centre ``z`` (m), velocity
    ``v`` (m/s), as complex numbers with the stream and across, and the outward unit ``normal`` there.
    """

    hit: NDArray[np.bool_]
    z: Complex
    v: Complex
    normal: Complex


@dataclass(frozen=True)
class Impaction:
    """What becomes of n kinds of granules. ``reach`` (n,) m: those that start nearer to the axis meet the body;
    ``efficiency`` (n,): ``reach`` over half width and radius, within which they would meet the body falling straight.
    ``start`` (n, m) m off the axis: where m of each kind begin, how they are ``turned`` by the air, and how they would
    fall ``straight``.
    """

    reach: Array
    efficiency: Array
    start: Array
    turned: Met
    straight: Met


def approach(
    front: Front, *, above: float, speed: float, radius: Array, relax: Callable[[Array], Array], pull: float
) -> Impaction:
    """Fly n kinds of granules, ``radius`` (n,) m, from ``above`` (m) ahead of the body with ``speed`` (m/s) along the
    stream, in its air and under ``pull`` (m/s2: weight less buoyancy, along the stream).

    ``relax``: relaxation times (n, m) s at slips (n, m) m/s. A granule meets the body when its surface does.
    """
    full = front.half + radius
    low, high = np.zeros(len(radius)), full.copy()
    rounds = []
    for _ in range(2):
        width = (high - low) / RAYS
        start = low[:, None] + width[:, None] * (np.arange(RAYS) + 0.5)
        rounds.append((start, _fly(front, start, above, speed, radius, relax, pull, deflect=True)))
        hits = rounds[-1][1].hit.cumprod(axis=1).sum(axis=1)  # up to the first that gets round
        low, high = low + width * np.maximum(hits - 0.5, 0.0), np.minimum(low + width * (hits + 0.5), full)
    reach = 0.5 * (low + high)
    start, turned = rounds[0]
    straight = _fly(front, start, above, speed, radius, relax, pull, deflect=False)
    return Impaction(reach, reach / full, start, turned, straight)


def _fly(
    front: Front, start: Array, above: float, speed: float, radius: Array, relax: Callable[[Array], Array],
    pull: float, *, deflect: bool,
) -> Met:  # fmt: skip
    """Fly every granule by second-order exponential steps, each with its own clock, until it meets the face or is past
    the body.
    """
    rim = np.broadcast_to(radius[:, None], start.shape)
    z = -(above + rim) + 1j * start
    v = np.full(z.shape, speed, dtype=complex)
    label = front.label(z) if deflect else z
    calm = _calm(front)
    hit, live = np.zeros(z.shape, dtype=bool), np.ones(z.shape, dtype=bool)
    gap = _gap(front, z) - rim

    def air(where: Complex) -> tuple[Complex, Complex]:
        return front.air(where) if deflect else (np.full(where.shape, calm), np.ones_like(where))

    for _ in range(STEPS):
        u, slope = air(label)
        way = STEP_PART * np.maximum(front.edge(z), NEAREST * front.half)
        dt = way / np.maximum(np.maximum(np.abs(v), np.abs(u)), max(MIN_SPEED_PART * abs(calm), 1e-300))
        dt = np.minimum(dt, np.sqrt(2.0 * way / max(abs(pull), 1e-300)))  # from rest
        tau = relax(np.abs(u - v))
        trial, _ = _step(z, v, u + pull * tau, tau, dt)
        ahead, later = air(label + slope * (trial - z))
        mean = 0.5 * (u + ahead)
        tau = relax(np.abs(mean - v))
        new_z, new_v = _step(z, v, mean + pull * tau, tau, dt)
        new_gap = _gap(front, new_z) - rim
        meets = live & (new_gap <= 0.0)
        part = np.where(meets, gap / np.maximum(gap - new_gap, 1e-300), np.where(live, 1.0, 0.0))
        label = label + part * 0.5 * (slope + later) * (new_z - z)
        z, v = z + part * (new_z - z), v + part * (new_v - v)
        gap = np.where(live, new_gap, gap)
        hit |= meets
        live &= ~meets & (z.real < front.depth + rim) & (z.real > -2.0 * (above + rim) - front.half)
        if not live.any():
            break
    away = front.away(z)
    return Met(hit, z, v, away / np.maximum(np.abs(away), 1e-300))


@cache
def _calm(front: Front) -> complex:
    """Velocity u + i v (m/s) of the air far ahead of the body."""
    return complex(front.air(front.label(np.array([-1e6 * front.half + 0j])))[0][0])


def _gap(front: Front, z: Complex) -> Array:
    return np.where(front.inside(z), -1.0, 1.0) * np.abs(front.away(z))


def _step(z: Complex, v: Complex, final: Complex, tau: Array, dt: Array) -> tuple[Complex, Complex]:
    """Exact position and velocity after ``dt`` where the granule's velocity tends to ``final`` with the relaxation time
    ``tau``.
    """
    left = np.exp(-dt / tau)
    return z + final * dt + (v - final) * tau * (1.0 - left), final + (v - final) * left


# -- Impaction of fine granules on a sphere that moves through their air -----------------------------------------------
WIDE = 2.0 / 3.0


def sphere_caught(stokes: Any, reynolds: Any) -> Any:
    """Share of the granules in the cross-section of a sphere that it meets: ((S - S0) / (S - S0 + 2/3))^(3/2), 0 for
    S <= S0 = (1.2 + ln(1 + R) / 12) / (1 + ln(1 + R)).

    ``stokes`` tau u / D (relaxation time at the relative speed u, diameter D of the sphere), S = twice that;
    ``reynolds`` rho u D / mu of the sphere, R half of that. Slinn's fit for raindrops (1984), as an open program writes
    it (rivm-syso/SBoo, after Wang, Zhang & Moran 2010, Atmos. Chem. Phys. Discuss. 10, 2503); neither paper was read.
    A fit between creeping flow, which meets none below S0 = 1.2, and potential flow, S0 = 1/12, with whose
    paths it agrees to 0.03; for granules much smaller than the sphere. Takes arrays, and the compiled kernel's scalars.
    """
    turn = np.log(1.0 + 0.5 * reynolds)
    above = np.maximum(2.0 * stokes - (1.2 + turn / 12.0) / (1.0 + turn), 0.0)
    part = above / (above + WIDE)
    return part * np.sqrt(part)
