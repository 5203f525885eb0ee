"""The front door of the tracker: checks its arguments, packs them, and runs blocks of granules on all cores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..air.field import AT_REST, FlowField
from ..core.arrays import number
from ..core.errors import SceneError
from ..core.process import check_workers, cores
from ..laws.constants import GRAVITY
from .bodies import Body, Collisions, Motion
from .granules import Granules
from .kernel import layout as at
from .kernel.layout import PackedAir, Rules, Walls
from .kernel.loop import fly_block
from .pack import (
    VACUUM,
    Packed,
    check_forces,
    from_frame,
    mesh_motion_of,
    pack_granules,
    pack_state,
    pack_tables,
    to_frame,
)
from .pack_surroundings import eddy_life, pack_air, pack_lines, pack_walls
from .tracks import Tracks

Array = NDArray[np.float64]
BLOCK = 512  # granules handed to a thread at a time, at least
MAX_BLOCK = 2048  # at most: an interruption waits for them
PARTS = 4  # blocks that each thread gets, where they are longer: some take longer than others
RECORD_POINTS = 1024  # points kept of a recorded track
NOISE_STEP = 0.1  # an interval of noise, of an eddy's lifetime and the granule's response time
EDDIES = 20.0  # lifetimes that a granule held by friction waits before it counts as resting
FINER = 0.01  # of the tolerance: that of the flights which the step of the common clock is judged by
MAX_STEPS = 1_000_000  # of a track, also points of a record; then it is STOPPED
REACH = 1e-6  # of ``length``: the mesh's edge this near to an outline at rest is covered by it, round-off of meshes
SKIN = 1e-11  # of ``length``: distances below it are contact: far above round-off, far below any tolerance
AGAIN = 1.05  # of the period of what may shake a granule off: held for so long it has seen all of it
IN_VACUUM = 10.0  # lengths: extent of a flight without a mesh


def unheard(_done: int, _count: int) -> None:
    """What hears of the progress of a flight that nobody follows."""


def track(
    field: FlowField | None,
    grains: Granules,
    *,
    until: float,
    tolerance: float = 1e-6,
    length: float | None = None,
    forces: Sequence[str] = ("drag", "gravity"),
    drag: str | Sequence[str] = "brown-lawler",
    bodies: Sequence[Body | Any] = (),
    lines: Sequence[Any] = (),
    motion: Motion | None = None,
    gravity: Sequence[float] = (0.0, -GRAVITY),
    seed: int = 0,
    noises: int = 1,
    record: bool | int = False,
    march: bool = True,
    workers: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    collisions: Collisions | None = None,
) -> Tracks:
    """Follow ``grains`` through ``field`` (None: a vacuum) until each meets its fate, or the clock shows ``until`` (s).

    ``tolerance`` is the landing error in units of ``length`` (m; default: width of the first body, 1 m without one).
    ``forces``: names of :mod:`wakeflow.laws.forces`: drag, gravity (g alone), buoyancy, pressure-gradient, added-mass,
    lift, magnus, dispersion, brownian, basset-history; those of the air do nothing in a vacuum. ``drag``: a law, or one
    for each ``fraction`` of the granules.
    ``bodies`` are outlines (k, 2), which move by ``motion``, or Body; ``lines`` (k, 2) polylines that end a track
    when its centre crosses them. An edge of the mesh that no body covers ends it there: BINNED when it lies on a
    line, else ESCAPED. A granule that reaches into a wall at birth is pushed out; one born inside a body is STOPPED,
    one born outside the mesh ESCAPED with no step. ``seed`` numbers the random streams of dispersion and Brownian
    motion, one a granule, by its place among ``grains``; ``noises`` 2: its intervals last twice as long, along the same
    Brownian path, so that the difference is their error.
    ``record`` keeps each path, thinned to at most 1024 points, or as many as it says. ``march`` False takes confined
    steps only, none over several triangles (docs/model.md): a switch for tests, which measure the order of these
    steps by it; flights become slower, and their landing error is bounded by the same ``tolerance``. ``workers``
    threads (default: all cores); results do not depend on their number. ``progress(done, total)``.
    ``collisions`` (:class:`Collisions`): granules meet. All fly on one clock in three dimensions, each from its time
    and its place across the slab (``grains.depth``, or drawn by ``seed``); docs/model.md. Raises SceneError for an
    unknown force or drag law, a force that needs what the field has not, or arguments out of range.
    """
    field = VACUUM if field is None else field
    check_forces(forces, field)
    until, tolerance = number("until", until, "s"), number("tolerance", tolerance)
    solids = [body if isinstance(body, Body) else Body(body, motion=motion) for body in bodies]
    across = float(np.ptp(solids[0].outline[:, 0])) if solids else 1.0
    length = across if length is None else number("length", length, "m")
    _check(record, length, tolerance, until, seed, noises, workers)
    swing, reach, points = mesh_motion_of(field), REACH * length, RECORD_POINTS if record is True else int(record)
    walls = pack_walls(solids, pack_lines(lines), swing, grains.restitution)
    air = pack_air(field, solids, reach, forces)
    rules = _rules(field, air, solids, walls, until, tolerance, length, seed, noises, march)
    tables = pack_tables(drag, grains.sphericity, grains.fraction)
    flight = Packed(field, grains, forces, gravity, solids, swing, reach, points, walls, air, rules, *tables)
    tracks = Tracks.empty(len(grains), recorded=bool(record))
    if not len(grains):
        pack_granules(grains, field, forces, gravity)  # for what it raises
    if collisions is not None:
        return _fly_colliding(flight, tracks, collisions, seed, progress or unheard)
    return _fly_all(flight, tracks, workers or cores(), progress or unheard)


def _check(
    record: bool | int, length: float, tolerance: float, until: float, seed: int, noises: int, workers: int | None
) -> None:
    """Raise SceneError for numbers that are out of range."""
    check_workers(workers)
    if record is not True and not (record == 0 or 16 <= record <= MAX_STEPS):
        raise SceneError(f"record = {record}: True, or 16 to {MAX_STEPS} points")
    for name, value in (("length", length), ("tolerance", tolerance)):
        if not (np.isfinite(value) and value > 0):
            raise SceneError(f"{name} = {value:g} must be positive and finite")
    if not np.isfinite(until):
        raise SceneError(f"until = {until:g} s must be finite")
    if not 0 <= seed < 2**63:
        raise SceneError(f"seed = {seed} must lie between 0 and 2^63 - 1")
    if noises not in (1, 2):
        raise SceneError(f"noises = {noises}: 1 or 2")


def _fly_block(flight: Packed, tracks: Tracks, rows: NDArray[np.int64]) -> int:
    """One block, packed here so that what the kernel needs of a granule exists for few of them at a time; returns how
    many granules it holds.
    """
    some = to_frame(flight.grains[rows], flight.swing)
    floats, ints = pack_state(flight, some, rows)
    constants = pack_granules(some, flight.field, flight.forces, flight.gravity)
    room = np.zeros((len(some), flight.points, at.RECORD))
    scratch = (np.zeros(at.PATH), np.zeros(at.AFFINE), np.zeros(at.CONSTRAINT))
    tables = flight.tables, flight.table_of[rows]
    fly_block(floats, ints, constants, *tables, flight.air, flight.walls, flight.rules, room, *scratch)
    tracks.keep(rows, floats, ints)
    ends = from_frame(tracks.position[rows], tracks.velocity[rows], tracks.time[rows], flight.swing)
    tracks.position[rows], tracks.velocity[rows] = ends
    if tracks.recorded:
        for row, table, kept in zip(rows, room, ints[:, at.KEPT], strict=True):
            table[:, 1:3], table[:, 3:5] = from_frame(table[:, 1:3], table[:, 3:5], table[:, 0], flight.swing)
            tracks.recorded[row] = table[:kept].copy()
    return len(some)


def _fly_all(flight: Packed, tracks: Tracks, workers: int, progress: Callable[[int, int], object]) -> Tracks:
    """All blocks, on ``workers`` threads; a single block in this one, since few granules fly faster than a thread
    starts. Neighbours fly one after the other: they look at the same nodes, which then are in the cache.
    """
    done, count = 0, len(flight.grains)
    size = BLOCK if tracks.recorded else int(np.clip(count // (PARTS * workers), BLOCK, MAX_BLOCK))
    order = np.argsort(flight.grains.position[:, 0], kind="stable")
    blocks = [order[low : low + size] for low in range(0, count, size)]
    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        for flown in (pool.map if len(blocks) > 1 else map)(partial(_fly_block, flight, tracks), blocks):
            done += flown
            progress(done, count)
    finally:  # an interruption waits for the blocks that fly now, not for those that are still queued
        pool.shutdown(cancel_futures=True)
    return tracks


def _fly_colliding(
    flight: Packed, tracks: Tracks, collisions: Collisions, seed: int, progress: Callable[[int, int], object]
) -> Tracks:
    """Fly granules that meet, in the lab; far finer flights of a sample, each granule alone, judge the step."""
    from .collisions.slab_driver import Slab, fly_colliding

    def alone(rows: NDArray[np.int64], forces: Sequence[str]) -> Tracks:
        finer = {name: FINER * getattr(flight.rules, name) for name in ("allowance", "tiny")}
        some = replace(
            flight, grains=flight.grains[rows], forces=forces, points=0, table_of=flight.table_of[rows],
            rules=flight.rules._replace(**finer),
        )  # fmt: skip
        sample = Tracks.empty(len(rows))
        _fly_all(some, sample, cores(), unheard)
        return sample

    walls = pack_walls(flight.solids, (flight.walls.lines, flight.walls.line_ids), AT_REST, flight.grains.restitution)
    slab = Slab(**vars(flight) | {"walls": walls, "collisions": collisions})
    return fly_colliding(slab, tracks, alone, seed, progress)


def _longest_wait(field: FlowField, air: PackedAir, bodies: Sequence[Body], omega: float) -> float:
    """Seconds that a granule held by friction waits for what may blow or shake it off; inf: for ever."""
    periods = [1.0 / body.motion.frequency for body in bodies if body.motion is not None and body.motion.frequency > 0]
    rest = max([*periods, 2 * np.pi / omega] if omega > 0 else periods, default=0.0)
    if len(field.times) > 1:
        rest = max(rest, field.period) if field.period else np.inf
    if air.values.shape[-1] > at.NODE_RMS:  # eddies may blow it off; after many of them it stays
        rest = max(rest, EDDIES * eddy_life(field))
    return rest


def _rules(
    field: FlowField,
    air: PackedAir,
    bodies: Sequence[Body],
    walls: Walls,
    until: float,
    tolerance: float,
    length: float,
    seed: int,
    noises: int,
    march: bool,
) -> Rules:
    """The kernel's scalars; ``length`` (m), ``until`` (s)."""
    extent = IN_VACUUM * length if field is VACUUM else float(np.hypot(*(field.box[1] - field.box[0])))
    coarse = 1.0 / air.smooth[at.KNOT_RATE] if air.smooth[at.KNOT_RATE] != 0.0 else np.inf
    omega = float(air.swing[at.SWING_OMEGA])
    box, swing = walls.bodies[:, : at.REACH_X], np.abs(walls.bodies[:, [at.REACH_X, at.REACH_Y]])
    return Rules(
        until=float(until),
        allowance=tolerance * length / extent,
        extent=extent,
        length=float(length),
        skin=SKIN * length,
        tiny=at.LOWEST_BOUNCE * tolerance * length,
        rest=AGAIN * _longest_wait(field, air, bodies, omega),
        coarse=float(min(coarse, 0.5 / omega) if omega > 0 else coarse),
        shaken=float(np.hypot(air.swing[at.SWING_X], air.swing[at.SWING_Y]) * omega**2),
        noise=NOISE_STEP * noises,
        noises=noises,
        seed=int(seed),
        march=int(march),
        left=float(np.min(box[:, at.LOW_X] - swing[:, 0], initial=0.0)),
        right=float(np.max(box[:, at.HIGH_X] + swing[:, 0], initial=0.0)),
        bottom=float(np.min(box[:, at.LOW_Y] - swing[:, 1], initial=0.0)),
        top=float(np.max(box[:, at.HIGH_Y] + swing[:, 1], initial=0.0)),
        steps=MAX_STEPS,
        impacts=at.MAX_IMPACTS,
    )
