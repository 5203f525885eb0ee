"""The front door of the tracker: checks its arguments, packs them, and runs blocks of granules on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..field import FlowField
from ..laws.constants import GRAVITY
from .frame import from_frame, swing_of, to_frame
from .granules import Body, Granules, Motion, Tracks
from .kernel import layout as at
from .kernel.layout import Air, Rules, Walls
from .kernel.loop import fly_block
from .pack import check_forces, pack_air, pack_granules, pack_lines, pack_state, pack_tables, pack_walls

__all__ = ["track"]

Array = NDArray[np.float64]
BLOCK = 512  # granules handed to a thread at a time
ROOM = 1024  # points kept of a recorded track
NOISE_STEP = 0.1  # of an eddy's lifetime: an interval of noise
EDDIES = 20.0  # lifetimes that a granule held by friction waits before it counts as resting
MOST_STEPS = 1_000_000


def track(
    field: FlowField | None,
    grains: Granules,
    *,
    until: float,
    tolerance: float = 1e-6,
    length: float | None = None,
    forces: Sequence[str] = ("drag", "gravity"),
    drag: str = "brown-lawler",
    bodies: Sequence[Body | Any] = (),
    lines: Sequence[Any] = (),
    motion: Motion | None = None,
    gravity: Sequence[float] = (0.0, -GRAVITY),
    seed: int = 0,
    record: bool | int = False,
    march: bool = True,
    workers: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Tracks:
    """Follow ``grains`` through ``field`` (None: a vacuum) until each meets its fate, or the clock shows ``until`` (s).

    ``tolerance`` is the landing error in units of ``length`` (m; default: width of the first body, 1 m without one).
    ``forces``: names of :mod:`wakeflow.laws.forces`: drag, gravity (g alone), buoyancy, pressure-gradient, added-mass,
    lift, magnus, dispersion, brownian; those of the air do nothing in a vacuum.
    ``bodies`` are outlines (k, 2), which move by ``motion``, or Body; ``lines`` (k, 2) polylines that end a track
    when its centre crosses them. An edge of the mesh that no body covers ends it there: BINNED when it lies on a
    line, else ESCAPED. A granule that reaches into a wall at birth is pushed out; one born inside a body is STOPPED,
    one born outside the mesh ESCAPED with no step. ``seed`` numbers the random streams of dispersion and Brownian
    motion, one a granule, by its place among ``grains``.
    ``record`` keeps each path, thinned to at most 1024 points, or as many as it says. ``march`` False: third-order
    steps from face to face all the way, slower, and no better than ``tolerance`` either. ``workers`` threads (default:
    all cores); results do not depend on their number. ``progress(done, total)``. Raises SceneError for an unknown
    force or drag law, a force that needs what the field has not, or arguments out of range.
    """
    check_forces(forces, field)
    solids = [body if isinstance(body, Body) else Body(np.asarray(body, dtype=float), motion=motion) for body in bodies]
    if length is None:
        length = float(np.ptp(solids[0].outline[:, 0])) if solids else 1.0
    if record is not True and not (record == 0 or 16 <= record <= MOST_STEPS):
        raise SceneError(f"record = {record}: True, or 16 to {MOST_STEPS} points")
    for name, value in (("length", length), ("tolerance", tolerance)):
        if not (np.isfinite(value) and value > 0):
            raise SceneError(f"{name} = {value:g} must be positive and finite")
    if not np.isfinite(until):
        raise SceneError(f"until = {until:g} s must be finite")
    if not 0 <= seed < 2**63:
        raise SceneError(f"seed = {seed} must lie between 0 and 2^63 - 1")
    reach, points = 1e-6 * length, ROOM if record is True else int(record)
    swing = swing_of(field)
    walls = pack_walls(solids, pack_lines(lines), swing, grains.restitution)
    air = pack_air(field, solids, reach, forces)
    tables, table_of = pack_tables(drag, grains.sphericity)
    rules = _rules(field, air, solids, walls, until, tolerance, length, seed, march)
    found = Tracks.empty(len(grains), recorded=bool(record))

    def fly(low: int) -> int:
        """One block, packed here so that what the kernel needs of a granule exists for few of them at a time."""
        part = slice(low, min(low + BLOCK, len(grains)))
        some = to_frame(grains[part], swing)
        floats, ints = pack_state(some, low, field, air, solids, reach)
        constants = pack_granules(some, field, forces, gravity)
        room = np.zeros((len(some), points, at.RECORD))
        scratch = (np.zeros(at.PATH), np.zeros(at.AFFINE), np.zeros(at.CONSTRAINT))
        fly_block(floats, ints, constants, tables, table_of[part], air, walls, rules, room, *scratch)
        found.time[part], found.spin[part] = floats[:, at.T], floats[:, at.SPIN]
        ends = from_frame(floats[:, [at.X, at.Y]], floats[:, [at.VX, at.VY]], floats[:, at.T], swing)
        found.position[part], found.velocity[part] = ends
        for whole, column in (
            (found.fate, at.FATE), (found.steps, at.STEPS), (found.impacts, at.IMPACTS), (found.line, at.LINE),
            (found.evaluations, at.EVALUATIONS),
        ):  # fmt: skip
            whole[part] = ints[:, column]
        if found.recorded is not None:
            for table in room:
                table[:, 1:3], table[:, 3:5] = from_frame(table[:, 1:3], table[:, 3:5], table[:, 0], swing)
            found.recorded[part] = [room[i, : ints[i, at.KEPT]].copy() for i in range(len(some))]
        return len(some)

    if not len(grains):
        pack_granules(grains, field, forces, gravity)
    done = 0
    pool = ThreadPoolExecutor(max_workers=workers or os.cpu_count() or 1)
    try:
        for future in as_completed([pool.submit(fly, low) for low in range(0, len(grains), BLOCK)]):
            done += future.result()
            if progress is not None:
                progress(done, len(grains))
    finally:  # an interruption waits for the blocks that fly now, not for those that are still queued
        pool.shutdown(cancel_futures=True)
    return found


def _rules(
    field: FlowField | None,
    air: Air,
    bodies: Sequence[Body],
    walls: Walls,
    until: float,
    tolerance: float,
    length: float,
    seed: int,
    march: bool,
) -> Rules:
    extent = 10 * length if field is None else float(np.hypot(*np.ptp(field.points, axis=0)))
    coarse = 1.0 / air.smooth[1] if air.smooth[1] != 0.0 else np.inf
    omega = float(air.swing[2])
    periods = [1.0 / body.motion.frequency for body in bodies if body.motion is not None and body.motion.frequency > 0]
    rest = max([*periods, 2 * np.pi / omega] if omega > 0 else periods, default=0.0)
    if field is not None and field.times is not None and len(field.times) > 1:
        rest = max(rest, field.period) if field.period is not None else np.inf
    if air.values.shape[-1] > 4:  # eddies may blow it off later; what lay still for many of them stays
        rest = max(rest, EDDIES * float(np.median(air.values[..., 5])))
    box, swing = walls.bodies[:, :4], np.abs(walls.bodies[:, 4:6])
    return Rules(
        until=float(until),
        allowance=tolerance * length / extent,
        extent=extent,
        length=float(length),
        skin=1e-11 * length,
        tiny=0.01 * tolerance * length,
        rest=1.05 * rest,
        coarse=float(min(coarse, 0.5 / omega) if omega > 0 else coarse),
        shaken=float(np.hypot(air.swing[0], air.swing[1]) * omega**2),
        noise=NOISE_STEP,
        seed=int(seed),
        march=int(march),
        left=float(np.min(box[:, 0] - swing[:, 0], initial=0.0)),
        right=float(np.max(box[:, 2] + swing[:, 0], initial=0.0)),
        bottom=float(np.min(box[:, 1] - swing[:, 1], initial=0.0)),
        top=float(np.max(box[:, 3] + swing[:, 1], initial=0.0)),
        steps=MOST_STEPS,
        impacts=at.MOST_IMPACTS,
    )
