"""A granule that stays on a body: it slides against friction, rolls, is held, goes round a corner, and leaves.

On the outline offset by its radius the granule's centre has one coordinate, the arc length s along a face or round a
corner; in the body's frame, with the tangent t and the normal n (turning by s / r round a corner),

    free  = t . (g - d''),    press = -n . (g - d'') - u^2 / r (round a corner),    u = s'
    slips:  u' = free - sign f press,      slip' = free - sign f press (1 + 1/k)     (slip: of the contact point)
    rolls:  u' = free / (1 + k), k = I / (m r^2), as long as friction can give the rest (Routh 1897, ch. 4)
    held:   while abs(free) <= f press

Steps are classical Runge-Kutta: exact on a face at rest, where all is constant; else short against vibration and
corner. A step that would pass the end of its face, a halt, or the loss of pressure ends there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.roots import halved_all
from .hits import CORNER, FACE
from .roots import falls_below, rises_above
from .surfaces import Array, Index, Surfaces

__all__ = ["FLIES", "RESTS", "Contact", "arc_length", "place", "slide"]

STAYS, FLIES, RESTS = 0, 1, 2  # what becomes of it
SLIPS, ROLLS, HELD = 0, 1, 2  # how it moves there
SWING = 0.2  # rad of a vibration in one step
ROUND = 0.05  # of a corner's radius, or of the time of a pendulum as long as it, in one step
STATIC = 1e-12  # round-off of a friction coefficient: what is exactly balanced is held
HALVINGS = 40  # of a step, to find when its way ends
PATIENCE = 1.05  # vibrations: what is held that long stays

Mask = NDArray[np.bool_]


@dataclass
class Contact:
    """n granules on bodies, all arrays (n,): ``where`` FACE or CORNER, ``which``; ``s`` m along it and ``u`` m/s,
    ``slip`` m/s of the contact point (u of a point mass), ``clock`` s; ``radius`` m, ``friction``, ``mobility`` 1/k;
    ``held`` s that it has been at rest; ``state`` STAYS, FLIES (off) or RESTS (for good).
    """

    where: Index
    which: Index
    s: Array
    u: Array
    slip: Array
    clock: Array
    radius: Array
    friction: Array
    mobility: Array
    held: Array
    state: Index

    def part(self, chosen: Index | Mask) -> Contact:
        """The chosen granules, copied."""
        return Contact(**{name: values[chosen] for name, values in vars(self).items()})

    def put(self, chosen: Index | Mask, other: Contact) -> None:
        """Let ``other`` replace the chosen granules."""
        for name, values in vars(self).items():
            values[chosen] = getattr(other, name)


class _Piece(NamedTuple):
    """The stretch of offset outline each granule is on."""

    body: Index
    angle: Array  # rad, of the normal at s = 0
    bend: Array  # 1/m, how fast the normal turns
    length: Array  # m
    base: Array  # (n, 2) m, the face's start or the corner, at rest


def _pieces(c: Contact, surfaces: Surfaces) -> _Piece:
    corner = c.where == CORNER
    face = np.where(corner, surfaces.corner_faces[np.where(corner, c.which, 0), 0], c.which)
    after = np.where(corner, surfaces.corner_faces[np.where(corner, c.which, 0), 1], c.which)
    n, m = surfaces.normal[face], surfaces.normal[after]
    turn = np.arctan2(n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0], (n * m).sum(axis=1))
    base = surfaces.start[face].copy()
    base[corner] = surfaces.corner[c.which[corner]]
    return _Piece(
        surfaces.face_body[face],
        np.arctan2(n[:, 1], n[:, 0]),
        np.where(corner, 1.0 / c.radius, 0.0),
        np.where(corner, c.radius * turn, surfaces.size[face]),
        base,
    )


def _directions(piece: _Piece, s: Array) -> tuple[Array, Array]:
    """Normal and tangent (n, 2) at arc lengths s (n,)."""
    angle = piece.angle + piece.bend * s
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine, sine], axis=1), np.stack([-sine, cosine], axis=1)


def place(c: Contact, surfaces: Surfaces) -> tuple[Array, Array]:
    """Positions (n, 2) m and velocities (n, 2) m/s in the lab."""
    piece = _pieces(c, surfaces)
    n, t = _directions(piece, c.s)
    moved, speed, _ = surfaces.moved(piece.body, c.clock)
    straight = np.where(c.where == CORNER, 0.0, c.s)
    return piece.base + moved + c.radius[:, None] * n + straight[:, None] * t, speed + c.u[:, None] * t


def arc_length(c: Contact, surfaces: Surfaces, position: Array) -> Array:
    """Where along their faces or corners granules at ``position`` (n, 2) m are, m."""
    piece = _pieces(c, surfaces)
    arm = position - surfaces.moved(piece.body, c.clock)[0] - piece.base
    _, tangent = _directions(piece, np.zeros(len(c.s)))
    turned = np.arctan2(arm[:, 1], arm[:, 0]) - piece.angle
    turned = (turned + np.pi) % (2 * np.pi) - np.pi
    return np.clip(np.where(c.where == CORNER, c.radius * turned, (arm * tangent).sum(axis=1)), 0.0, piece.length)


def slide(c: Contact, surfaces: Surfaces, gravity: Array, until: float, eps: float) -> None:
    """Move all granules on by one step, or to what ends it first, in place; ``state`` says which of them are done.

    ``until`` s on the clock; ``eps`` m, round-off of lengths.
    """
    _over_ends(c, surfaces, eps)
    on = np.flatnonzero(c.state == STAYS)
    d = c.part(on)
    way = _Way(surfaces, gravity, until, eps, d, _pieces(d, surfaces))
    period = surfaces.period[way.piece.body]
    held = way.mode == HELD
    way.d.state = np.where(
        way.press <= 0.0,
        FLIES,
        np.where(held & ((period == 0.0) | (d.held > PATIENCE * period)), RESTS, STAYS),
    )
    step = np.where(d.state == STAYS, way.step(), 0.0)
    after = way.after(step)
    for_search = np.flatnonzero((d.state == STAYS) & ~way.exact & way.ends(after))
    if len(for_search):
        part, low = way.part(for_search), np.zeros(len(for_search))
        _, high = halved_all(lambda time: ~part.ends(part.after(time)), low, step[for_search], HALVINGS)
        after.put(for_search, part.after(high))
        step[for_search] = high
    after.held = np.where(held, d.held + step, 0.0)
    c.put(on, after)


def _over_ends(c: Contact, surfaces: Surfaces, eps: float) -> None:
    """Granules at the end of their face go on round the corner, from a corner on to the next face, or fly."""
    piece, corner = _pieces(c, surfaces), c.where == CORNER
    back = (c.s <= eps) & (c.u < 0.0)
    over = np.flatnonzero(back | ((c.s >= piece.length - eps) & (c.u > 0.0)))
    if not len(over):
        return
    corner, back = corner[over], back[over]
    links = surfaces.face_ends[np.where(corner, 0, c.which[over])]
    if corner.any():
        links[corner] = surfaces.corner_faces[c.which[over][corner]]
    following = np.where(back, links[:, 0], links[:, 1])
    c.s[over] = np.where(back, 0.0, piece.length[over])
    c.state[over[following < 0]] = FLIES
    on, new = over[following >= 0], following[following >= 0]
    c.where[on] = np.where(c.where[on] == CORNER, FACE, CORNER)
    c.which[on] = new
    c.s[on] = np.where(back[following >= 0], _pieces(c.part(on), surfaces).length, 0.0)


@dataclass
class _Way:
    """How granules ``d`` move at their clocks: ``mode``, the ``sign`` of the slip that friction opposes, the forces."""

    surfaces: Surfaces
    gravity: Array
    until: float
    eps: float
    d: Contact
    piece: _Piece

    def __post_init__(self) -> None:
        d = self.d
        self.free, self.press = self.forces(d.s, d.u, d.clock)
        still = 1e-13 * (1.0 + np.abs(self.free))
        slips, rolls = np.abs(d.slip) > still, d.mobility > 0.0
        d.slip = np.where(slips, d.slip, 0.0)
        d.u = np.where(~slips & ~rolls, 0.0, d.u)
        grip = np.abs(self.free) * self.share(d) <= (d.friction + STATIC) * self.press
        lies = (np.abs(d.u) <= still) & (np.abs(self.free) <= STATIC * self.press)
        self.mode = np.where(slips | ~grip, SLIPS, np.where(rolls & ~lies, ROLLS, HELD))
        self.sign = np.where(slips, np.sign(d.slip), np.sign(self.free))
        self.slips, self.goes = (self.mode == SLIPS) * 1.0, (self.mode != HELD) * 1.0
        self.yields = np.where(self.mode == ROLLS, 1.0 - self.share(d), self.slips)
        self.rub, self.grinds = self.slips * self.sign * d.friction, 1.0 + d.mobility
        self.exact = (self.surfaces.pace[self.piece.body] == 0.0) & (d.where == FACE)

    @staticmethod
    def share(d: Contact) -> Array:
        """Share of the free tangential acceleration that friction must give for the contact point to stay at rest."""
        return 1.0 / (1.0 + d.mobility)

    def part(self, chosen: Index) -> _Way:
        """The same for the chosen granules."""
        d = self.d.part(chosen)
        return _Way(self.surfaces, self.gravity, self.until, self.eps, d, _pieces(d, self.surfaces))

    def forces(self, s: Array, u: Array, t: Array) -> tuple[Array, Array]:
        """Free tangential acceleration and what presses the granule on (n,), m/s2."""
        angle = self.piece.angle + self.piece.bend * s
        nx, ny = np.cos(angle), np.sin(angle)
        px, py = (self.gravity - self.surfaces.moved(self.piece.body, t)[2]).T
        return nx * py - ny * px, -nx * px - ny * py - self.piece.bend * u * u

    def rates(self, s: Array, u: Array, t: Array) -> tuple[Array, Array, Array]:
        """Rates of s, u and slip."""
        free, press = self.forces(s, u, t)
        rub = self.rub * np.maximum(press, 0.0)
        return self.goes * u, self.yields * free - rub, self.slips * free - self.grinds * rub

    def after(self, h: Array) -> Contact:
        """All of them a step h (n,) s later (Runge & Kutta, fourth order)."""
        d = self.d
        a = self.rates(d.s, d.u, d.clock)
        b = self.rates(d.s + 0.5 * h * a[0], d.u + 0.5 * h * a[1], d.clock + 0.5 * h)
        c = self.rates(d.s + 0.5 * h * b[0], d.u + 0.5 * h * b[1], d.clock + 0.5 * h)
        e = self.rates(d.s + h * c[0], d.u + h * c[1], d.clock + h)
        found = d.part(np.arange(len(d.s)))
        mean = [(w + 2.0 * x + 2.0 * y + z) / 6.0 for w, x, y, z in zip(a, b, c, e, strict=True)]
        found.s, found.u, found.slip = d.s + h * mean[0], d.u + h * mean[1], d.slip + h * mean[2]
        found.clock = d.clock + h
        return found

    def ends(self, later: Contact) -> Mask:
        """Whether the way of moving has ended by then."""
        free, press = self.forces(later.s, later.u, later.clock)
        off = (later.s < -self.eps) | (later.s > self.piece.length + self.eps) | (press <= 0.0)
        turned = (self.mode == SLIPS) & (self.sign * later.slip < 0.0)
        grip = np.abs(free) * self.share(self.d) <= (self.d.friction + 2.0 * STATIC) * press
        return np.asarray(off | turned | ((self.mode != SLIPS) & ~grip))

    def step(self) -> Array:
        """Seconds (n,) to the end of the way in closed form, on a face at rest; else a short step."""
        d, piece, surfaces = self.d, self.piece, self.surfaces
        _, du, dslip = self.rates(d.s, d.u, d.clock)
        with np.errstate(divide="ignore", invalid="ignore"):
            halt = np.where((self.mode == SLIPS) & (dslip * self.sign < 0.0), -d.slip / dslip, np.inf)
        ends = [rises_above(d.s - piece.length - self.eps, d.u, du), falls_below(d.s + self.eps, d.u, du), halt]
        exact = np.min([np.where(end >= 0.0, end, np.inf) for end in ends], axis=0)
        pace = np.maximum(surfaces.pace[piece.body], 1e-300)
        pull = float(np.hypot(*self.gravity)) + 1e-300
        with np.errstate(divide="ignore"):
            turn = ROUND * np.minimum(np.sqrt(d.radius / pull), d.radius / np.abs(d.u))
        short = np.minimum(SWING / pace, np.where(d.where == CORNER, turn, np.inf))
        return np.minimum(np.where(self.exact, exact, short), np.maximum(self.until - d.clock, 0.0))
