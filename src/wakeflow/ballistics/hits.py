"""The first thing that each falling granule meets: a face, a corner, a line, or the end of the clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .roots import falls_below, first_roots, rises_above
from .surfaces import Array, Index, Surfaces

__all__ = ["CORNER", "FACE", "LINE", "NOTHING", "Falling", "Hit", "first_hits"]

Mask = NDArray[np.bool_]
_Gap = Callable[[Index, Array], tuple[Array, Array]]
_Counts = Callable[[Index, Array], Mask]
NOTHING, FACE, CORNER, LINE = range(4)
TURN = 0.3  # rad of a body's vibration looked at in one piece
PIECES = 8  # of a passage by a corner at rest
STILL = 1e-12  # m/s: approaches slower than this are round-off
CHUNK = 2**18  # pairs of granules and features looked at in one table


class Hit(NamedTuple):
    """``time`` (n,) s from now, ``kind`` (n,) NONE, FACE, CORNER or LINE, ``which`` (n,) of them."""

    time: Array
    kind: Index
    which: Index


@dataclass(frozen=True)
class Falling:
    """Granules in free fall: ``position``, ``velocity`` (n, 2), ``radius``, ``clock`` (n,) s; ``gravity`` (2,)."""

    position: Array
    velocity: Array
    radius: Array
    clock: Array
    gravity: Array

    def part(self, chosen: Any) -> Falling:
        """The chosen granules."""
        return Falling(
            self.position[chosen], self.velocity[chosen], self.radius[chosen], self.clock[chosen], self.gravity
        )

    def at(self, time: Array) -> tuple[Array, Array]:
        """Positions and velocities (n, 2) a time (n,) s from now."""
        t = time[:, None]
        return self.position + t * (self.velocity + 0.5 * t * self.gravity), self.velocity + t * self.gravity


def first_hits(fall: Falling, surfaces: Surfaces, left: Array, length: float) -> Hit:
    """What each granule meets first within its time ``left`` (n,) s; lengths below 1e-12 ``length`` are round-off."""
    features = len(surfaces.size) + len(surfaces.corner) + len(surfaces.line) + 1
    rows = max(1, CHUNK // features)
    parts = [
        _first(fall.part(slice(i, i + rows)), surfaces, left[i : i + rows], 1e-12 * length)
        for i in range(0, len(left), rows)
    ]
    return Hit(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _first(fall: Falling, surfaces: Surfaces, left: Array, skin: float) -> Hit:
    best = Hit(left.copy(), np.full(len(left), NOTHING), np.full(len(left), -1))
    _lines(fall, surfaces, best)
    moving = surfaces.pace[surfaces.face_body] > 0.0
    _faces(fall, surfaces, best, np.flatnonzero(~moving), skin)
    pairs = [_moving_faces(fall, surfaces, best, np.flatnonzero(moving), skin), *_corners(fall, surfaces, best)]
    _search(fall, surfaces, best, pairs, skin)
    return best


def _take(best: Hit, times: Array, kind: int, which: Index) -> None:
    """Let the earliest of ``times`` (n, m) count where it comes before what is known."""
    if not times.shape[1]:
        return
    column = np.argmin(times, axis=1)
    time = np.take_along_axis(times, column[:, None], axis=1)[:, 0]
    sooner = time < best.time
    best.time[sooner], best.kind[sooner], best.which[sooner] = time[sooner], kind, which[column[sooner]]


def _lines(fall: Falling, surfaces: Surfaces, best: Hit) -> None:
    """Crossings of the granules' centres with the lines, from either side."""
    (a, b), c = (surfaces.line[:, :2], surfaces.line[:, 2:]), fall.position
    along = b - a
    size = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / size[:, None]
    g0 = c @ normal.T - (a * normal).sum(axis=1)
    g1, g2 = fall.velocity @ normal.T, np.broadcast_to(normal @ fall.gravity, g0.shape)
    times = np.stack([falls_below(g0, g1, g2), rises_above(g0, g1, g2)])
    times = np.where((times > 0.0) & np.isfinite(times), times, np.inf)
    foot = _foot(fall, a, along / size[:, None], np.where(np.isfinite(times), times, 0.0))
    slack = 1e-9 * size
    times = np.where((foot >= -slack) & (foot <= size + slack), times, np.inf).min(axis=0)
    _take(best, times, LINE, np.arange(len(size)))


def _foot(fall: Falling, start: Array, along: Array, times: Array) -> Array:
    """How far along each line the granules are at ``times`` (..., n, m)."""
    f0 = fall.position @ along.T - (start * along).sum(axis=1)
    return np.asarray(f0 + times * (fall.velocity @ along.T + 0.5 * times * (along @ fall.gravity)))


def _gaps(fall: Falling, surfaces: Surfaces, faces: Index) -> tuple[Array, Array, Array]:
    """g0, g1, g2 of the gaps (n, m) to ``faces`` at rest."""
    normal = surfaces.normal[faces]
    g0 = fall.position @ normal.T - (surfaces.start[faces] * normal).sum(axis=1) - fall.radius[:, None]
    g1 = fall.velocity @ normal.T
    return g0, g1, np.broadcast_to(normal @ fall.gravity, g0.shape)


def _faces(fall: Falling, surfaces: Surfaces, best: Hit, faces: Index, skin: float) -> None:
    """Faces at rest, in closed form."""
    g0, g1, g2 = _gaps(fall, surfaces, faces)
    grazing = (np.abs(g0) <= skin) & (np.abs(g1) <= STILL)
    g0, g1 = np.where(grazing, 0.0, g0), np.where(grazing, 0.0, g1)
    times = falls_below(g0, g1, g2)
    over = (times < 0.0) & (g1 < 0.0) & (g0 > -fall.radius[:, None] - skin)  # a little inside, and going deeper
    times = np.where(over, 0.0, times)
    usable = (times >= 0.0) & np.isfinite(times)
    along = np.stack([-surfaces.normal[faces, 1], surfaces.normal[faces, 0]], axis=1)
    safe = np.where(usable, times, 0.0)
    foot = _foot(fall, surfaces.start[faces], along, safe)
    onward = fall.velocity @ along.T + safe * (along @ fall.gravity)
    size = surfaces.size[faces]
    inside = (foot >= np.where(onward >= 0.0, 0.0, skin)) & (foot <= np.where(onward <= 0.0, size, size - skin))
    _take(best, np.where(usable & inside, times, np.inf), FACE, faces)


class _Pairs(NamedTuple):
    """Granules and features that may meet, and when: from ``low`` to ``high`` (s), looked at in steps of ``step``."""

    granule: Index
    feature: Index
    kind: Index
    low: Array
    high: Array
    step: Array

    def part(self, chosen: Any) -> _Pairs:
        """The chosen pairs."""
        return _Pairs(
            self.granule[chosen], self.feature[chosen], self.kind[chosen], self.low[chosen], self.high[chosen],
            self.step[chosen],
        )  # fmt: skip


def _moving_faces(fall: Falling, surfaces: Surfaces, best: Hit, faces: Index, skin: float) -> _Pairs:
    """Faces that vibrate: the gap differs by at most their amplitude from that to the face at rest, so a hit lies in
    the first stretch below that level, or in the one after the granule came back to it.
    """
    g0, g1, g2 = _gaps(fall, surfaces, faces)
    body = surfaces.face_body[faces]
    swing = np.abs((surfaces.swing[body] * surfaces.normal[faces]).sum(axis=1)) + skin
    last = best.time[:, None]
    gone = falls_below(g0 + swing, g1, g2)  # from there on it is inside, or behind
    gone = np.where(gone < 0.0, np.where(g0 > -fall.radius[:, None] - swing, 0.0, -1.0), gone)
    high = np.minimum(gone, last)
    near, up = g0 <= swing, rises_above(g0 - swing, g1, g2)
    down = np.maximum(falls_below(g0 - swing, g1, g2), 0.0)
    windows = [(np.zeros_like(g0), np.where(near, np.minimum(high, np.where(up > 0, up, np.inf)), -1.0))]
    windows.append((np.where(near, np.where((up > 0) & (down > up), down, np.inf), down), high))
    along = np.stack([-surfaces.normal[faces, 1], surfaces.normal[faces, 0]], axis=1)
    margin = np.abs((surfaces.swing[body] * along).sum(axis=1)) + skin
    found = []
    for low, end in windows:
        row, column = np.nonzero((low <= end) & np.isfinite(low))
        a, b = low[row, column], end[row, column]
        one = fall.part(row)
        start, direction = surfaces.start[faces[column]], along[column]
        rate, bend = (one.velocity * direction).sum(axis=1), direction @ fall.gravity
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.clip(np.nan_to_num(-rate / bend, nan=0.0, posinf=0.0, neginf=0.0), a, b)
        feet = np.stack([((one.at(t)[0] - start) * direction).sum(axis=1) for t in (a, turn, b)])
        size = surfaces.size[faces[column]]
        k = (feet.max(axis=0) >= -margin[column]) & (feet.min(axis=0) <= size + margin[column])
        step = TURN / surfaces.pace[body[column[k]]]
        found.append((row[k], faces[column[k]], np.full(k.sum(), FACE), a[k], b[k], step))
    return _Pairs(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _corners(fall: Falling, surfaces: Surfaces, best: Hit) -> list[_Pairs]:
    """Convex corners: while the granule is within the box round a corner that its radius and the swing make."""
    corner, body = surfaces.corner, surfaces.corner_body
    reach_x, reach_y = (fall.radius[:, None] + np.abs(surfaces.swing[body][:, i]) for i in (0, 1))
    x, y = (fall.position[:, i, None] - corner[:, i] for i in (0, 1))
    vx, vy = (np.broadcast_to(fall.velocity[:, i, None], x.shape) for i in (0, 1))
    still = np.abs(vx) < STILL
    beside, speed = still & (np.abs(x) > reach_x), np.where(still, 1.0, vx)
    one, other = (-reach_x - x) / speed, (reach_x - x) / speed
    enter = np.where(still, 0.0, np.minimum(one, other))
    leave = np.where(still, np.inf, np.maximum(one, other))
    g = float(fall.gravity[1])
    rise, sink = rises_above(y + reach_y, vy, g), falls_below(y + reach_y, vy, g)  # above the box's floor
    above, below = rises_above(y - reach_y, vy, g), falls_below(y - reach_y, vy, g)  # above its ceiling
    first = np.maximum(np.maximum(enter, 0.0), np.where(np.isfinite(rise), rise, 0.0))
    last = np.minimum(np.minimum(leave, sink), best.time[:, None])
    through = np.isfinite(above) & np.isfinite(below)
    windows = [
        (first, np.where(through, np.minimum(last, above), last)),
        (np.where(through, np.maximum(first, below), np.inf), last),
    ]
    found = []
    for low, high in windows:
        row, column = np.nonzero((low < high) & ~beside & np.isfinite(low))
        a, b = low[row, column], high[row, column]
        pace = surfaces.pace[body[column]]
        step = np.minimum((b - a) / PIECES, TURN / np.where(pace > 0.0, pace, 1e-300))
        found.append(_Pairs(row, column, np.full(len(row), CORNER), a, b, step))
    return found


def _functions(fall: Falling, surfaces: Surfaces, pairs: _Pairs, skin: float) -> tuple[_Gap, _Counts]:
    """Of pairs k (m,) at times t (m,): the gap (m) between a granule and its feature with its rate (m/s), and whether a
    gap of zero is a contact.
    """
    is_face = pairs.kind == FACE
    face, corner = np.where(is_face, pairs.feature, 0), np.where(is_face, 0, pairs.feature)
    body = np.where(is_face, surfaces.face_body[face], surfaces.corner_body[corner])
    origin = np.where(is_face[:, None], surfaces.start[face], surfaces.corner[corner])
    normal = surfaces.normal[face]
    who = pairs.granule
    x, y = (fall.position[who] - origin).T
    columns = (x, y, *fall.velocity[who].T, fall.radius[who], fall.clock[who], *normal.T)
    table, g = np.ascontiguousarray(columns), float(fall.gravity[1])

    def relative(k: Index, t: Array) -> tuple[Array, Array, Array, Array]:
        """Place and velocity in the body's frame, from the face's start or the corner."""
        x, y, vx, vy, _, clock = table[:6, k]
        moved, speed, _ = surfaces.moved(body[k], clock + t)
        x, y = x + t * vx - moved[:, 0], y + t * (vy + 0.5 * g * t) - moved[:, 1]
        return x, y, vx - speed[:, 0], vy + g * t - speed[:, 1]

    def gap(k: Index, t: Array) -> tuple[Array, Array]:
        x, y, vx, vy = relative(k, t)
        distance = np.maximum(np.sqrt(x * x + y * y), 1e-300)
        nx, ny = np.where(is_face[k], table[6:, k], (x / distance, y / distance))
        return x * nx + y * ny - table[4, k], vx * nx + vy * ny

    def counts(k: Index, t: Array) -> Mask:
        x, y, vx, vy = relative(k, t)
        nx, ny = normal[k].T
        foot, onward, size = nx * y - ny * x, nx * vy - ny * vx, surfaces.size[face[k]]
        on_face = (foot >= np.where(onward >= 0.0, 0.0, skin)) & (foot <= np.where(onward <= 0.0, size, size - skin))
        return np.asarray(~is_face[k] | on_face)

    return gap, counts


def _search(fall: Falling, surfaces: Surfaces, best: Hit, parts: list[_Pairs], skin: float) -> None:
    """The first roots of all pairs that may come before what is known."""
    pairs = _Pairs(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    keep = pairs.low < best.time[pairs.granule]
    pairs = pairs.part(keep)
    if not len(pairs.granule):
        return
    who = pairs.granule
    gap, counts = _functions(fall, surfaces, pairs, skin)
    high = np.minimum(pairs.high, best.time[who])
    times = first_roots(gap, counts, who, pairs.low, high, pairs.step, skin, STILL)
    met = np.flatnonzero(np.isfinite(times))
    met = met[times[met] < best.time[pairs.granule[met]]]
    met = met[np.argsort(-times[met], kind="stable")]  # of one granule's the earliest is written last
    i = pairs.granule[met]
    best.time[i], best.kind[i], best.which[i] = times[met], pairs.kind[met], pairs.feature[met]
