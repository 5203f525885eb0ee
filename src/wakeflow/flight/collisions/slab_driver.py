"""The front of the slab: packs granules as their time comes, lets the slab march, and takes out those that ended.

The tracker flies the sample too, each granule by steps of its own and far finer than the tolerance. Nine of ten must
land where it says, to the tolerance; the tenth is for paths that a corner splits. The scheme is of second order, so the
step of the next trial is known, and an error that does not fall with the step is not the step's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...laws.forces import forces as all_forces
from ...laws.forces.records import SPIN_LIFT
from ..bodies import Collisions
from ..granules import Granules
from ..kernel import layout as at
from ..kernel.layout import PackedAir
from ..pack import Packed, pack_granules, pack_state, to_frame
from ..tracks import ClockStep, CollisionFlight, Tracks
from . import slab_layout as of
from .neighbours import AHEAD
from .slab import march_slab
from .slab_layout import Cells, Colliding, Laws, Nodes, Room

Array = NDArray[np.float64]
Index = NDArray[np.int64]
BATCH = 4096  # granules packed at a time, in the order of birth
PAIRS = 16  # a slot, in the list of who is near whom: more than touch each other where granules lie densely
CALL = 20_000  # steps of granules between two looks at the clock on the wall: some 10 ms
SAMPLES = 64  # of how many granules lie still, from the first birth to the last
PI_6 = np.pi / 6.0


@dataclass(frozen=True)
class Slab(Packed):
    """What granules that meet fly in; walls and granules in the lab."""

    collisions: Collisions


def _slots(count: int, points: int) -> Colliding:
    """Make so many empty slots, with room for as many points of a path in each."""
    return Colliding(
        np.zeros((count, at.FLOATS)), np.zeros((count, at.INTS), dtype=np.int64), np.zeros((count, at.CONSTANTS)),
        np.zeros(count, dtype=np.int64), np.zeros((count, of.EXTRAS)), np.zeros((count, of.TALLY), dtype=np.int64),
        np.zeros((count, points, at.RECORD)), np.zeros(count, dtype=np.int64), np.zeros(0, dtype=np.int64),
    )  # fmt: skip


class _Run:
    """One run of the slab: ``colliding`` holds the granules that fly or are about to, in slots, which become more
    as they do; ``who`` (S,): the index of the granule in a slot, -1: free; ``across`` (n,) m: places across the slab,
    the granules' own or drawn evenly.
    """

    def __init__(self, slab: Slab, step: float, seed: int) -> None:
        self.slab, self.step = slab, step
        depth, drawn = slab.collisions.depth, np.random.default_rng([seed, 13]).random(len(slab.grains))
        places = depth * drawn if slab.grains.depth is None else slab.grains.depth
        self.across = places - depth * np.floor(places / depth)
        self.order = np.argsort(slab.grains.time, kind="stable")
        self.fed = 0  # granules packed so far
        self.colliding, self.who = _slots(0, slab.points), np.zeros(0, dtype=np.int64)
        self.laws = Laws(*slab.collisions.tables(slab.grains), slab.tables)
        self.tracer = np.isin(slab.grains.fraction, np.asarray(slab.collisions.tracers, dtype=np.int64))
        air = slab.air
        self.timed = len(air.corners) > 0 and (len(air.times) > 1 or air.smooth[at.KNOT_RATE] != 0.0)
        self.nodes = _nodes(air, timed=self.timed, rates="added-mass" in slab.forces)
        self.clock = np.zeros(of.CLOCK)
        self.clock[of.STEP], self.clock[of.DEPTH] = step, slab.collisions.depth
        self.clock[of.AHEAD] = AHEAD
        self.clock[of.NOW] = float(slab.grains.time.min(initial=slab.rules.until))
        self.counts = np.zeros(of.COUNTS, dtype=np.int64)
        self.room = Room(
            np.zeros(at.PATH), np.zeros(at.AFFINE), np.zeros(at.CONSTRAINT), np.zeros(at.FLOATS),
            np.zeros(at.INTS, dtype=np.int64), np.zeros(at.FLOATS), np.zeros(at.INTS, dtype=np.int64),
            np.zeros(of.EXTRAS), np.zeros(2, dtype=np.int64),
        )  # fmt: skip
        self.cells = _cells(0)
        self.standing: list[tuple[float, int, int]] = []  # time, lying still, born

    def _free(self, count: int) -> Index:
        """Find so many free slots, in order; make more where there are too few."""
        if np.count_nonzero(self.who < 0) < count:
            more = max(len(self.who), count)
            rows = zip(self.colliding[:-1], _slots(more, self.slab.points)[:-1], strict=True)
            self.colliding = Colliding._make([*map(np.concatenate, rows), self.colliding.waiting])
            self.who = np.concatenate([self.who, np.full(more, -1)])
        return np.flatnonzero(self.who < 0)[:count]

    def feed(self) -> float:
        """Pack the next batch; returns until when (s) the slab may march with it."""
        slab, rows = self.slab, self.order[self.fed : self.fed + BATCH]
        self.fed += len(rows)
        slots = self._free(len(rows))
        colliding = self.colliding
        some = slab.grains[rows]
        floats, ints = pack_state(slab, to_frame(some, slab.swing), rows)
        floats[:, [at.X, at.Y]], floats[:, [at.VX, at.VY]] = some.position, some.velocity
        inside = ints[:, at.GAP] >= 0
        ints[inside, at.TRI] = slab.air.covered[ints[inside, at.GAP], at.COVER_TRI] if inside.any() else 0
        colliding.states[slots], colliding.counts[slots] = floats, ints
        colliding.grains[slots] = self._constants(some)
        colliding.table_of[slots] = slab.table_of[rows]
        colliding.extra[slots], colliding.tally[slots], colliding.records[slots] = 0.0, 0, 0.0
        colliding.extra[slots, of.Z] = self.across[rows]
        colliding.extra[slots, of.LIGHT] = 1.0 / (PI_6 * some.density * some.diameter**3)
        colliding.tally[slots, of.FRACTION], colliding.tally[slots, of.TRACER] = some.fraction, self.tracer[rows]
        colliding.tally[slots, of.PARTNER] = -1
        self.who[slots] = rows
        unborn = colliding.waiting[self.counts[of.BORN] :]
        self.colliding = colliding._replace(waiting=np.concatenate([unborn, slots]))
        self.counts[of.BORN] = 0
        self.clock[of.PULL] = max(self.clock[of.PULL], _pull(colliding.grains[slots]))
        if len(self.cells.next) < len(colliding.living):
            self.cells = _cells(len(colliding.living))
            self.counts[of.PAIRS] = self.counts[of.ANEW] = 0
        more = self.fed < len(self.order)
        return min(slab.rules.until, float(slab.grains.time[self.order[self.fed]])) if more else slab.rules.until

    def _constants(self, some: Granules) -> Array:
        """The tracker's constants (n, CONSTANTS), of the forces of each granule's fraction."""
        slab, acting_on = self.slab, self.slab.collisions.forces
        if not acting_on:
            return pack_granules(some, slab.field, slab.forces, slab.gravity)
        rows = np.zeros((len(some), at.CONSTANTS))
        for number in np.unique(some.fraction):
            mine, acting = some.fraction == number, [name for name in slab.forces if name in acting_on[number]]
            rows[mine] = pack_granules(some[mine], slab.field, acting, slab.gravity)
        return rows

    def march(self, stop: float) -> bool:
        """March some steps; returns whether the clock shows ``stop``, or all is over."""
        slab = self.slab
        steps = max(1, CALL // max(1, int(self.counts[of.LIVING])))
        return bool(march_slab(
            self.colliding, self.laws, slab.air, self.nodes, slab.walls, slab.rules, self.clock, self.room,
            self.cells, self.counts, stop, steps, self.timed, self.fed == len(self.order),
        ))  # fmt: skip

    def harvest(self, tracks: Tracks, *, all_of_them: bool = False) -> int:
        """Take those that ended out of their slots; returns how many."""
        colliding, taken = self.colliding, self.who >= 0
        if all_of_them:  # those that have not ended are at rest, or still in the air
            rest, flying = self.slab.rules.rest, taken & (colliding.counts[:, at.FATE] == at.FLYING)
            lies = flying & (colliding.states[:, at.HELD] > rest)
            colliding.counts[flying, at.FATE] = at.AIRBORNE
            colliding.counts[lies, at.FATE] = at.RESTING
            colliding.states[lies, at.T] -= colliding.states[lies, at.HELD] - rest
        slots = np.flatnonzero(taken & (colliding.counts[:, at.FATE] != at.FLYING))
        rows, self.who[slots] = self.who[slots], -1
        tracks.keep(rows, colliding.states[slots], colliding.counts[slots])
        tracks.meetings[rows] = colliding.tally[slots, of.MEETINGS]
        if tracks.recorded:
            for slot, row in zip(slots, rows, strict=True):
                tracks.recorded[row] = colliding.records[slot, : colliding.counts[slot, at.KEPT]].copy()
        return len(slots)


def _nodes(air: PackedAir, *, timed: bool, rates: bool) -> Nodes:
    """Room for the air at the nodes; the air itself where it is steady."""
    now = np.array(air.values[0]) if len(air.values) else np.zeros((0, 2))
    if timed:
        count = len(air.values) if air.smooth[at.KNOT_RATE] != 0.0 else air.values.shape[1]
        now = np.zeros((count, air.values.shape[2]))
    return Nodes(
        np.ascontiguousarray(now), np.zeros((len(now) if timed and rates else 0, 2)),
        np.zeros(len(now), dtype=np.int64), np.zeros(3, dtype=np.int64), np.zeros(2 * of.RATES),
    )  # fmt: skip


def _pull(grains: Array) -> float:
    return float(np.hypot(grains[:, at.GX], grains[:, at.GY]).max(initial=0.0))


def _cells(slots: int) -> Cells:
    """Room for meetings of so many granules: two buckets a granule, and the next power of two."""
    size = 1 << max(10, int(2 * slots - 1).bit_length())
    return Cells(
        np.zeros((slots, 4)), np.zeros((slots, 4)), np.zeros((slots, 3), dtype=np.int64),
        np.zeros(slots, dtype=np.int64), np.full(size, -1, dtype=np.int64), np.full(slots, -1, dtype=np.int64),
        np.zeros((PAIRS * slots + 64, of.EVENT), np.int64), np.zeros(4 * slots + 64),
        np.zeros((4 * slots + 64, of.EVENT), np.int64), np.zeros((8 * slots + 64, 2), dtype=np.int64),
    )  # fmt: skip


def fly_slab(
    slab: Slab, tracks: Tracks, clock: ClockStep, seed: int, progress: Callable[[int, int], object] = lambda *_: None
) -> CollisionFlight:
    """Let the granules fly by a ``clock``, filling ``tracks``; returns how it was flown."""
    if not len(tracks):
        return CollisionFlight(clock)
    run, done = _Run(slab, clock.step, seed), 0
    if not clock.step > 0:
        raise SceneError(f"collisions: step = {clock.step:g} s must be positive")
    born_last = min(float(slab.grains.time.max()), slab.rules.until)
    looks = iter(np.linspace(run.clock[of.NOW], born_last, SAMPLES).tolist())
    look = next(looks)
    while True:
        stop, over = run.feed(), False
        while not over:
            over = run.march(min(stop, look)) and stop <= look
            done += run.harvest(tracks)
            progress(done, len(slab.grains))
            born = run.fed - len(run.colliding.waiting) + int(run.counts[of.BORN])
            while run.clock[of.NOW] >= look:
                run.standing.append((look, int(run.counts[of.LEANING]), born))
                look = next(looks, np.inf)
        if run.fed == len(run.order):
            break
    done += run.harvest(tracks, all_of_them=True)
    progress(done, len(slab.grains))
    standing = np.array(run.standing, dtype=float).reshape(-1, 3)
    steps, flown = int(run.counts[of.STEPS]), int(run.counts[of.FLOWN])
    return CollisionFlight(clock, steps, flown, standing, _jammed(standing))


# -- How long the step of the common clock may be ----------------------------------------------------------------------
SAMPLE = 384  # granules: of a quarter of them the error varies by 20 times from seed to seed, of these by 2.5
NINE_OF_TEN = 0.9
HOP = 0.5  # of the largest diameter: what a granule goes in a step at most, so that cells stay small
ALONE = 0.5  # of the length, in place of that diameter where tracers fly alone
SHAKE = 0.05  # rad of a vibration
CHANGE = 0.25  # of the time in which the air changes
ORDER = 2.0  # of the scheme
SAFE, SHORTER, MAX_TRIALS = 0.8, 0.25, 6  # of the step that should do; of the step before, at least; trials
PATIENCE = 2  # trials in a row whose error does not fall with the step: no step makes it smaller
HALF = 0.5


def fly_colliding(
    slab: Slab,
    tracks: Tracks,
    alone: Callable[[Index, Sequence[str]], Tracks],
    seed: int,
    progress: Callable[[int, int], object],
) -> Tracks:
    """Let the granules fly; ``alone(rows, forces)`` flies some of its granules by themselves."""
    slab.collisions.tables(slab.grains)
    if slab.collisions.step is not None:
        clock = ClockStep(slab.collisions.step)
    else:
        clock = measured_step(slab, alone)
        if slab.collisions.measured is not None:
            slab.collisions.measured(clock)
    return replace(tracks, collisions=fly_slab(slab, tracks, clock, seed, progress))


def _jammed(standing: NDArray[np.float64]) -> bool:
    """Whether most of what is born in the second half of the births still lies there when the last is born."""
    born = standing[:, 2]
    if len(standing) < 4 or not born[-1] > 0:
        return False
    first, last = np.searchsorted(born, [HALF * born[-1], born[-1]])
    if last <= first:
        return False
    return bool(standing[last, 1] - standing[first, 1] > HALF * (born[last] - born[first]))


def measured_step(slab: Slab, alone: Callable[[Index, Sequence[str]], Tracks]) -> ClockStep:
    """The step of the common clock, judged on a sample that ``alone`` flies far finer than the tolerance."""
    count, tolerance = len(slab.grains), slab.rules.allowance * slab.rules.extent / slab.rules.length
    if not count:
        return ClockStep(1.0, 0.0, tolerance)
    rows = np.unique(np.linspace(0, count - 1, min(SAMPLE, count)).round().astype(np.int64))
    by_chance = {SPIN_LIFT.name} if bool(slab.grains.flake.any()) else set()  # a flake's spin is drawn at each impact
    calm = [name for name in slab.forces if not all_forces[name].random and name not in by_chance]
    right = alone(rows, calm)
    everybody = tuple(np.unique(slab.grains.fraction).tolist())
    lonely = replace(slab.collisions, tracers=everybody, forces=())  # tracers meet each other never
    sample = replace(
        slab, grains=slab.grains[rows], forces=calm, points=0, table_of=slab.table_of[rows], collisions=lonely
    )

    def error_of(step: float) -> float:
        tracks = Tracks.empty(len(rows))
        fly_slab(sample, replace(tracks, meetings=np.zeros(len(rows), dtype=np.int64)), ClockStep(step), 0)
        away = np.linalg.norm(tracks.position - right.position, axis=1)
        return float(np.quantile(away, NINE_OF_TEN)) / slab.rules.length

    return chosen_step(_longest(slab, right), error_of, tolerance)


def chosen_step(longest: float, error_of: Callable[[float], float], tolerance: float) -> ClockStep:
    """The first step (s) from the ``longest`` on that errs by no more than the ``tolerance``; where none does, the
    longest that no shorter one betters by at least the ratio of the two: half of what the order of the scheme promises.
    """
    step, in_vain, trials = longest, 0, 0
    kept = ClockStep(step, np.inf)
    while in_vain < PATIENCE and trials < MAX_TRIALS and not kept.step_error <= tolerance:
        error, trials = error_of(step), trials + 1
        in_vain += 1
        if error <= tolerance or error < kept.step_error * step / kept.step:
            kept, in_vain = ClockStep(step, error), 0
        step *= max(SHORTER, SAFE * (tolerance / max(error, tolerance)) ** (1.0 / ORDER))
    return kept._replace(asked=tolerance, trials=trials)


def _longest(slab: Slab, right: Tracks) -> float:
    """The longest step worth trying (s)."""
    grains, rules = slab.grains, slab.rules
    solid = ~np.isin(grains.fraction, np.asarray(slab.collisions.tracers, dtype=np.int64))
    thick = float(grains.diameter[solid].max(initial=0.0)) or ALONE * rules.length
    speeds = np.concatenate([np.linalg.norm(grains.velocity, axis=1), np.linalg.norm(right.velocity, axis=1)])
    fall = float(np.hypot(*np.asarray(slab.gravity, dtype=float)) * rules.length) ** 0.5
    step = HOP * thick / max(float(speeds.max(initial=0.0)), fall, 1e-9 * rules.length)
    paces = [body.motion.pace for body in slab.solids if body.motion is not None and body.motion.moves]
    if paces:
        step = min(step, SHAKE / max(paces))
    return float(min(step, CHANGE * rules.coarse))
