"""The loop of a flight without air: every granule flies to what it meets first, strikes it, and flies or slides on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core.errors import SceneError
from ..core.geometry import contains
from ..laws.collision import approach_speed
from ..laws.constants import GRAVITY
from ..laws.random_numbers import normal_pair
from ..laws.rebound import thrown
from ..laws.restitution import Restitution, restitution_at
from ..tracking import Body, Fate, Granules, Tracks
from ..tracking.kernel import layout as at
from .hits import CORNER, FACE, LINE, NOTHING, Falling, Hit, first_hits
from .slide import FLIES, RESTS, Contact, arc_length, place, slide
from .surfaces import Array, Index, Surfaces

__all__ = ["follow"]

FLYING = -1
POINTS = 17  # of a recorded flight between two impacts


def follow(
    grains: Granules,
    *,
    until: float,
    tolerance: float = 1e-6,
    length: float | None = None,
    bodies: Sequence[Body] = (),
    lines: Sequence[Any] = (),
    gravity: Sequence[float] = (0.0, -GRAVITY),
    seed: int = 0,
    record: bool = False,
) -> Tracks:
    """Follow ``grains`` in a vacuum until each meets its fate, or the clock shows ``until`` (s).

    Arguments and answer are those of :func:`wakeflow.track`, and so is the physics; a bounce that rises by less than
    0.01 ``tolerance`` x ``length`` (m; default: width of the first body, else 1 m) is sliding from then on. Places of
    impacts are found to round-off. Granules born inside a body are STOPPED. Raises SceneError for a gravity
    that is not vertical.
    """
    if gravity[0] != 0.0:
        raise SceneError(f"gravity = {tuple(gravity)}: without air it has to be vertical")
    if length is None:
        length = float(np.ptp(bodies[0].outline[:, 0])) if bodies else 1.0
    flight = _Flight(grains, Surfaces.of(bodies, lines), np.asarray(gravity, dtype=float), until, length, record)
    flight.tiny, flight.seed = at.LOWEST_BOUNCE * tolerance * length, seed
    flight.stop_inside(bodies)
    while flight.advance():
        pass
    return flight.tracks


class _Flight:
    """Granules on their way; arrays (n,) or (n, 2), changed in place."""

    tiny = 0.0  # m: bounces that rise less are sliding
    seed = 0  # of the random angles of rebounds

    def __init__(
        self, grains: Granules, surfaces: Surfaces, gravity: Array, until: float, length: float, record: bool
    ) -> None:
        count = len(grains)
        self.grains, self.surfaces, self.gravity, self.until, self.length = grains, surfaces, gravity, until, length
        self.tracks = Tracks.empty(count, recorded=record)
        self.tracks.position[:], self.tracks.velocity[:] = grains.position, grains.velocity
        self.tracks.time[:], self.tracks.spin[:] = grains.time, grains.spin
        self.tracks.line[:], self.tracks.fate[:] = -1, FLYING
        self.radius, self.mobility = grains.diameter / 2, 1.0 / grains.inertia
        self.on: Contact | None = None  # those that touch a body
        self.who = np.zeros(0, dtype=np.int64)  # and which granules they are
        self.falling = np.arange(count)
        self.path: list[list[Array]] = [[] for _ in range(count)] if record else []

    def stop_inside(self, bodies: Sequence[Body]) -> None:
        """Granules born with their centre inside a body go nowhere."""
        within = np.zeros(len(self.grains), dtype=bool)
        for number, body in enumerate(bodies):
            if not body.open:
                moved = self.surfaces.moved(np.full(len(self.grains), number), self.grains.time)[0]
                within |= contains(body.outline, self.grains.position - moved)
        self.tracks.fate[within] = Fate.STOPPED
        self.falling = np.flatnonzero(~within)
        if self.path:
            rows = np.column_stack([self.grains.time, self.grains.position, self.grains.velocity])
            for i, row in enumerate(rows):
                self.path[i].append(row[None])

    def advance(self) -> bool:
        """One flight of all that fly, one step of all that slide; False when all have ended."""
        if len(self.falling):
            self._fly()
        if len(self.who):
            self._slide()
        if len(self.falling) or len(self.who):
            return True
        if self.tracks.recorded is not None:
            self.tracks.recorded[:] = [np.concatenate(parts) for parts in self.path]
        return False

    # -- flight --------------------------------------------------------------------------------------------------------

    def _fly(self) -> None:
        tracks, who = self.tracks, self.falling
        fall = Falling(tracks.position[who], tracks.velocity[who], self.radius[who], tracks.time[who], self.gravity)
        left = np.maximum(self.until - tracks.time[who], 0.0)
        hit = first_hits(fall, self.surfaces, left, self.length)
        if self.path:
            self._draw(fall, hit)
        tracks.position[who], tracks.velocity[who] = fall.at(hit.time)
        tracks.time[who] += hit.time
        tracks.steps[who] += 1
        tracks.fate[who[hit.kind == NOTHING]] = Fate.AIRBORNE
        ended = hit.kind == LINE
        tracks.fate[who[ended]] = Fate.BINNED
        tracks.line[who[ended]] = self.surfaces.line_of[hit.which[ended]]
        struck = (hit.kind == FACE) | (hit.kind == CORNER)
        self.falling = self._strike(who[struck], hit.kind[struck], hit.which[struck])

    def _draw(self, fall: Falling, hit: Hit) -> None:
        for share in np.linspace(0.0, 1.0, POINTS):
            x, v = fall.at(share * hit.time)
            rows = np.column_stack([fall.clock + share * hit.time, x, v])
            for i, row in zip(self.falling, rows, strict=True):
                self.path[i].append(row[None])

    def _strike(self, who: Index, kind: Index, which: Index) -> Index:
        """Collisions of granules ``who``; returns those that fly on, the others touch from then on."""
        tracks, surfaces = self.tracks, self.surfaces
        corner, face = kind == CORNER, np.where(kind == FACE, which, 0)
        vertex = np.where(corner, which, 0)
        body = np.where(corner, surfaces.corner_body[vertex], surfaces.face_body[face])
        moved, wall, shaken = surfaces.moved(body, tracks.time[who])
        normal = surfaces.normal[face].copy()
        origin = np.where(corner[:, None], surfaces.corner[vertex], surfaces.start[face])
        arm = tracks.position[who] - moved - origin
        normal[corner] = arm[corner] / np.linalg.norm(arm[corner], axis=1, keepdims=True)
        off = (arm * normal).sum(axis=1) - self.radius[who]
        tracks.position[who] -= off[:, None] * normal
        (vx, vy), (nx, ny), (wx, wy) = tracks.velocity[who].T, normal.T, wall.T
        law = self.grains.restitution
        own = law if isinstance(law, Restitution) else law[who]
        restitution = restitution_at(own, approach_speed(vx, vy, nx, ny, wx, wy))
        restitution = np.where(np.isnan(surfaces.restitution[body]), restitution, surfaces.restitution[body])
        friction = np.where(np.isnan(surfaces.friction[body]), self.grains.friction[who], surfaces.friction[body])
        captured = surfaces.captures[body]
        tracks.fate[who[captured]] = Fate.CAPTURED
        velocity, spin, impulse = thrown(
            tracks.velocity[who], tracks.spin[who], normal, wall, restitution, friction, self.mobility[who],
            self.radius[who], self.grains.tangential_restitution[who], self._angle(who),
        )  # fmt: skip
        go = ~captured
        tracks.velocity[who[go]], tracks.spin[who[go]] = velocity[go], spin[go]
        tracks.impacts[who[go]] += (impulse > 0.0)[go]
        rattles = go & (tracks.impacts[who] >= at.MOST_IMPACTS)
        tracks.fate[who[rattles]] = Fate.STOPPED
        go &= ~rattles
        after = tracks.velocity[who] - wall
        rebound = (after * normal).sum(axis=1)
        along = normal[:, 0] * after[:, 1] - normal[:, 1] * after[:, 0]
        lift = ((self.gravity - shaken) * normal).sum(axis=1) + np.where(corner, along**2 / self.radius[who], 0.0)
        stays = go & (lift < 0.0) & ((rebound <= at.SLOW) | (rebound**2 <= -2.0 * lift * self.tiny))
        self._touch(who[stays], kind[stays], which[stays], along[stays], friction[stays])
        return np.asarray(who[go & ~stays])

    def _angle(self, who: Index) -> Array:
        """By what angle (rad) the shape of each granule turns the wall's normal at this impact: the tracker's draw."""
        scatter = self.grains.scatter[who]
        if not scatter.any():
            return np.zeros(len(who))
        drawn: Array = normal_pair(np.full(len(who), self.seed), who, -1 - self.tracks.impacts[who])[0]
        return np.asarray(scatter * drawn)

    # -- contact -------------------------------------------------------------------------------------------------------

    def _touch(self, who: Index, kind: Index, which: Index, along: Array, friction: Array) -> None:
        """Granules ``who`` stay on what they struck, moving along it at ``along`` (m/s)."""
        if not len(who):
            return
        zero, mobility = np.zeros(len(who)), self.mobility[who]
        slip = along - np.where(mobility > 0.0, self.radius[who] * self.tracks.spin[who], 0.0)
        new = Contact(
            kind.copy(), which.copy(), zero.copy(), along, slip, self.tracks.time[who], self.radius[who], friction,
            mobility, zero.copy(), np.zeros(len(who), dtype=np.int64),
        )  # fmt: skip
        new.s = arc_length(new, self.surfaces, self.tracks.position[who])
        self.who = np.concatenate([self.who, who])
        if self.on is None:
            self.on = new
        else:
            both = {name: np.concatenate([values, getattr(new, name)]) for name, values in vars(self.on).items()}
            self.on = Contact(**both)

    def _slide(self) -> None:
        assert self.on is not None
        tracks, on, who = self.tracks, self.on, self.who
        slide(on, self.surfaces, self.gravity, self.until, 1e-13 * self.length)
        tracks.position[who], tracks.velocity[who] = place(on, self.surfaces)
        turns = on.mobility > 0.0
        tracks.spin[who[turns]] = ((on.u - on.slip) / on.radius)[turns]
        tracks.time[who] = on.clock
        tracks.steps[who] += 1
        if self.path:
            rows = np.column_stack([tracks.time[who], tracks.position[who], tracks.velocity[who]])
            for i, row in zip(who, rows, strict=True):
                self.path[i].append(row[None])
        tracks.fate[who[on.state == RESTS]] = Fate.RESTING
        late = (on.state != RESTS) & (on.clock >= self.until)
        tracks.fate[who[late]] = Fate.AIRBORNE
        self.falling = np.concatenate([self.falling, who[(on.state == FLIES) & ~late]])
        keep = (on.state != FLIES) & (on.state != RESTS) & ~late
        self.on, self.who = on.part(keep), who[keep]
