"""Flight without air, granule by granule: the reference of the tracker's bounces, slides and rolls.

Parabolas from impact to impact; an impact is where the distance from an outline, sampled in time and halved down to
round-off, has shrunk to the radius. A granule that stays has one coordinate, the arc length s along a face of the
outline offset by its radius, or round a corner; in the body's frame, with tangent t, normal n and k = I / (m r^2),

    free  = t . (g - d''),    press = -n . (g - d'') - u^2 / r (round a corner),    u = s'
    slips:  u' = free - sign f press,      slip' = free - sign f press (1 + 1/k)     (slip: of the contact point)
    rolls:  u' = free / (1 + k), as long as friction can give the rest (Routh 1897, ch. 4)
    held:   while abs(free) <= f press

It shares the law of impact, the motion of bodies and the random numbers with the tracker, nothing else. Slow: some
10 ms an impact.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakeflow.flight import Body, Fate, Granules, Tracks
from wakeflow.laws.collision import approach_speed, scattered_rebound
from wakeflow.laws.constants import GRAVITY
from wakeflow.laws.random_numbers import normal_pair
from wakeflow.laws.restitution import restitution_at

Array = NDArray[np.float64]
G = np.array([0.0, -GRAVITY])
SLOW = 1e-6  # m/s: slower rebounds are sliding
FIRST, GROWTH = 1e-8, 1.2  # s: the first look at a flight, and how the looks grow apart
NEAR, SWING = 0.05, 0.1  # of a radius, and rad of a vibration: a look at a flight, a step along a wall
STRETCH = 0.02  # s of a flight looked at in one piece
TOUCH = 1e-14  # m: deeper is inside
LOWEST = 0.01  # of the landing error: bounces that rise less are sliding
HALVINGS = 60  # of a time: then it is round-off
PATIENCE = 1.05  # vibrations: what is held that long stays
STATIC = 1e-12  # round-off of a friction coefficient


def _moved(body: Body, t: Any) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration (..., 2) of a body at times t."""
    if body.motion is None:
        zero = np.zeros((*np.shape(t), 2))
        return zero, zero, zero
    return body.motion.at(t)


def _halved(ahead: Callable[[float], bool], low: float, high: float) -> float:
    """The time between ``low``, where ``ahead`` holds, and ``high`` at which it has ended; just past it."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ahead(middle) else (low, middle)
    return high


@dataclass(frozen=True, eq=False)
class Piece:
    """A face of a body's outline, or a convex corner: from ``base``, the normal at angle ``angle + bend s`` (rad)."""

    body: Body
    base: Array
    angle: float
    bend: float
    length: float

    def at(self, s: float) -> tuple[Array, Array]:
        """Normal and tangent."""
        c, d = math.cos(self.angle + self.bend * s), math.sin(self.angle + self.bend * s)
        return np.array([c, d]), np.array([-d, c])


def _pieces(body: Body, radius: float) -> list[Piece]:
    """Faces and corners in turn, a corner that turns inwards of no length: 2 i is the face from point i on."""
    along = np.roll(body.outline, -1, axis=0) - body.outline
    angle, found = np.arctan2(-along[:, 0], along[:, 1]), []
    for i, start in enumerate(body.outline):
        turn = (angle[(i + 1) % len(along)] - angle[i] + math.pi) % (2 * math.pi) - math.pi
        found.append(Piece(body, start, angle[i], 0.0, float(np.hypot(*along[i]))))
        end = body.outline[(i + 1) % len(along)]
        found.append(Piece(body, end, angle[i], 1.0 / radius, max(0.0, radius * turn)))
    return found


class _Granule:
    """One granule on its way."""

    def __init__(self, grains: Granules, i: int, bodies: Sequence[Body], lines: Sequence[Array], seed: int) -> None:
        self.one, self.i, self.bodies, self.lines, self.seed = grains[i : i + 1], i, bodies, lines, seed
        self.x, self.v = grains.position[i].copy(), grains.velocity[i].copy()
        self.t, self.spin, self.r = float(grains.time[i]), float(grains.spin[i]), 0.5 * float(grains.diameter[i])
        self.mobility, self.impacts, self.line = 1.0 / float(grains.inertia[i]), 0, -1
        self.pieces = [_pieces(body, self.r) for body in bodies]

    def run(self, until: float, tiny: float) -> Fate:
        """Fly, strike and slide to the end; bounces that rise less than ``tiny`` (m) are sliding."""
        while (met := self.fly(until)) is not None:
            stays = self.strike(*met, tiny)
            how = "flies" if stays is None else self.slide(*stays, until)
            if how != "flies":
                return Fate.RESTING if how == "rests" else Fate.AIRBORNE
        return Fate.AIRBORNE if self.line < 0 else Fate.BINNED

    # -- flight --------------------------------------------------------------------------------------------------------

    def _gap(self, body: Body, after: Array) -> tuple[Array, Array, Array]:
        """Distance (n,) between the surface of the granule and a body at times from now, the nearest edge, and where
        along it, 0 to 1.
        """
        x = self.x + after[:, None] * (self.v + 0.5 * after[:, None] * G) - _moved(body, self.t + after)[0]
        along = np.roll(body.outline, -1, axis=0) - body.outline
        off = x[:, None] - body.outline
        share = np.clip((off * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
        far = np.linalg.norm(off - share[..., None] * along, axis=2)
        edge = far.argmin(axis=1)
        rows = np.arange(len(after))
        return far[rows, edge] - self.r, edge, share[rows, edge]

    def _looks(self, last: float) -> Array:
        """Times up to ``last`` at which a flight is looked at: growing from nothing, as a bounce may be short."""
        fast = math.hypot(*self.v) + GRAVITY * last
        pace = max((body.motion.pace for body in self.bodies if body.motion is not None), default=0.0)
        step = min(NEAR * self.r / fast, SWING / pace if pace else math.inf)
        growing = FIRST * GROWTH ** np.arange(math.log(max(step / FIRST, GROWTH)) / math.log(GROWTH))
        return np.minimum(np.concatenate([growing, np.arange(growing[-1] + step, last + step, step)]), last)

    def _crossing(self, last: float) -> tuple[float, int]:
        """When the centre crosses a line first, and which; (last, -1) where it meets none."""
        first, which = last, -1
        for number, line in enumerate(self.lines):
            for a, b in pairwise(line):
                n = np.array([a[1] - b[1], b[0] - a[0]])
                for root in np.roots([0.5 * G @ n, self.v @ n, (self.x - a) @ n]):
                    t = float(root.real)
                    hit = self.x + t * (self.v + 0.5 * t * G) - a
                    if abs(root.imag) < 1e-12 and 1e-12 < t < first and 0.0 <= hit @ (b - a) <= (b - a) @ (b - a):
                        first, which = t, number
        return first, which

    def fly(self, until: float) -> tuple[Body, int, float] | None:
        """Fly to what is met first: a body, its edge and where along it; None where a line or the clock ends it."""
        while (met := self._fly_on(until)) is None and self.line < 0 and until - self.t > 1e-12:
            pass
        return met

    def _fly_on(self, until: float) -> tuple[Body, int, float] | None:
        """Fly a stretch, or to what ends it."""
        last, line = self._crossing(min(until - self.t, STRETCH))
        looks, met, end = self._looks(last), None, last
        for body in self.bodies:
            inside = np.flatnonzero(self._gap(body, looks)[0] <= -TOUCH)
            if len(inside) and looks[inside[0]] < end:
                low = looks[inside[0] - 1] if inside[0] else 0.0
                end = _halved(lambda t, b=body: bool(self._gap(b, np.array([t]))[0][0] > -TOUCH), low, looks[inside[0]])
                met = body
        found = None if met is None else (met, *(part[0] for part in self._gap(met, np.array([end]))[1:]))
        self.x, self.v, self.t = self.x + end * (self.v + 0.5 * end * G), self.v + end * G, self.t + end
        self.line = line if met is None else -1
        return found

    def strike(self, body: Body, edge: int, share: float, tiny: float) -> tuple[Piece, float, float] | None:
        """Collide; returns the piece, arc length and speed along it of a granule that stays, None where it flies on."""
        shift, wall, shaken = (part for part in _moved(body, self.t))
        pieces = next(ring for ring in self.pieces if ring[0].body is body)
        corner = share in (0.0, 1.0)
        piece = pieces[(2 * edge + (1 if share == 1.0 else -1 if share == 0.0 else 0)) % len(pieces)]
        arm = self.x - shift - piece.base
        normal = arm / np.hypot(*arm) if corner else piece.at(0.0)[0]
        e = body.restitution
        if e is None:
            e = float(np.ravel(restitution_at(self.one.restitution, approach_speed(*self.v, *normal, *wall)))[0])
        friction, scatter = self._friction(body), float(self.one.scatter[0])
        drawn = normal_pair(*(np.array([n]) for n in (self.seed, self.i, -1 - self.impacts)))[0] if scatter else 0.0
        velocity, spin, impulse = scattered_rebound(
            self.v[None], np.array([self.spin]), normal[None], wall[None], e, friction, self.mobility, self.r,
            self.one.tangential_restitution, scatter * np.ones(1) * drawn,
        )  # fmt: skip
        self.v, self.spin, self.impacts = velocity[0], float(spin[0]), self.impacts + int(impulse[0] > 0.0)
        own = self.v - wall
        rebound, u = float(own @ normal), float(normal[0] * own[1] - normal[1] * own[0])
        lift = float((G - shaken) @ normal) + (u**2 / self.r if corner else 0.0)
        if lift >= 0.0 or (rebound > SLOW and rebound**2 > -2.0 * lift * tiny):
            return None
        s = (math.atan2(arm[1], arm[0]) - piece.angle + math.pi) % (2 * math.pi) - math.pi
        return piece, min(max(s * self.r if corner else share * piece.length, 0.0), piece.length), u

    def _friction(self, body: Body) -> float:
        return float(self.one.friction[0]) if body.friction is None else body.friction

    # -- contact -------------------------------------------------------------------------------------------------------

    def slide(self, piece: Piece, s: float, u: float, until: float) -> str:
        """Move along a body until it flies off, rests, or the clock ends it: "flies", "rests" or "late"."""
        pieces, held = next(ring for ring in self.pieces if piece in ring), 0.0
        slip = u - (self.r * self.spin if self.mobility else 0.0)
        how = ""
        while not how:
            way = _Way(piece, self._friction(piece.body), self.mobility, s, u, slip, self.t)
            s, u, slip, spent = way.go(until, self.r)
            self.t, held = self.t + spent, held + spent if way.held else 0.0
            period = 0.0 if piece.body.motion is None else 1.0 / piece.body.motion.frequency
            over = (s <= 0.0 and u < 0.0) or (s >= piece.length and u > 0.0)
            if way.held and (period == 0.0 or held > PATIENCE * period):
                how = "rests"
            elif self.t >= until:
                how = "late"
            elif over:
                new = pieces[(pieces.index(piece) + (1 if u > 0.0 else -1)) % len(pieces)]
                if new.length == 0.0:  # a corner that turns inwards
                    how = "flies"
                else:
                    piece, s = new, 0.0 if u > 0.0 else new.length
            elif way.forces(s, u, self.t)[1] <= 0.0:
                how = "flies"
        shift, wall, _ = _moved(piece.body, self.t)
        normal, tangent = piece.at(s)
        self.x = piece.base + shift + self.r * normal + (0.0 if piece.bend else s) * tangent
        self.v = wall + u * tangent
        self.spin = (u - slip) / self.r if self.mobility else self.spin
        return how


class _Way:
    """One way of moving along a piece, from arc length s, speed u and slip at time t on, until it ends."""

    def __init__(
        self, piece: Piece, friction: float, mobility: float, s: float, u: float, slip: float, t: float
    ) -> None:
        self.piece, self.friction, self.mobility, self.t = piece, friction, mobility, t
        free, press = self.forces(s, u, t)
        still, self.share = 1e-13 * (1.0 + abs(free)), 1.0 / (1.0 + mobility)
        slip = slip if abs(slip) > still else 0.0
        self.sign = math.copysign(1.0, slip or free)
        self.slips = slip != 0.0 or abs(free) * self.share > (friction + STATIC) * press
        self.held = not self.slips and (mobility == 0.0 or (abs(u) <= still and abs(free) <= STATIC * press))
        self.start = np.array([s, 0.0 if self.held else u, slip])

    def forces(self, s: float, u: float, t: float) -> tuple[float, float]:
        """Free tangential acceleration, and what presses the granule on, m/s2."""
        normal, tangent = self.piece.at(s)
        pull = G - _moved(self.piece.body, t)[2]
        return float(tangent @ pull), float(-normal @ pull) - self.piece.bend * u * u

    def _rates(self, y: Array, t: float) -> Array:
        free, press = self.forces(y[0], y[1], t)
        rub = self.sign * self.friction * max(press, 0.0)
        if self.slips:
            return np.array([y[1], free - rub, free - (1.0 + self.mobility) * rub])
        return np.zeros(3) if self.held else np.array([y[1], free * (1.0 - self.share), 0.0])

    def _after(self, h: float) -> Array:
        """Runge and Kutta's fourth order."""
        y, t = self.start, self.t
        a = self._rates(y, t)
        b = self._rates(y + 0.5 * h * a, t + 0.5 * h)
        c = self._rates(y + 0.5 * h * b, t + 0.5 * h)
        return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + self._rates(y + h * c, t + h))

    def _lasts(self, h: float) -> bool:
        """Whether it still moves in this way a time h later."""
        s, u, slip = self._after(h)
        free, press = self.forces(s, u, self.t + h)
        grips = abs(free) * self.share <= (self.friction + 2.0 * STATIC) * press
        return 0.0 <= s <= self.piece.length and press > 0.0 and (self.sign * slip >= 0.0 if self.slips else grips)

    def go(self, until: float, radius: float) -> tuple[float, float, float, float]:
        """Arc length, speed, slip and the seconds spent: at the end of the way, or of a step short enough."""
        h, motion = until - self.t, self.piece.body.motion
        if motion is not None:
            h = min(h, SWING / motion.pace)
        if self.piece.bend:
            h = min(h, NEAR * min(math.sqrt(radius / GRAVITY), radius / max(abs(self.start[1]), 1e-300)))
        h = h if self._lasts(h) else _halved(self._lasts, 0.0, h)
        s, u, slip = (float(part) for part in self._after(h))
        return min(max(s, 0.0), self.piece.length), u, slip if self.sign * slip > 0.0 else 0.0, h


def follow(
    grains: Granules, *, until: float, length: float, bodies: Sequence[Body], lines: Sequence[Array],
    tolerance: float = 1e-6, seed: int = 0,
) -> Tracks:  # fmt: skip
    """Arguments and answer of :func:`wakeflow.track` in a vacuum."""
    found = Tracks.empty(len(grains))
    for i in range(len(grains)):
        one = _Granule(grains, i, bodies, lines, seed)
        found.fate[i] = one.run(until, LOWEST * tolerance * length)
        found.position[i], found.velocity[i], found.time[i], found.spin[i] = one.x, one.v, one.t, one.spin
        found.line[i], found.impacts[i] = one.line, one.impacts
    return found
