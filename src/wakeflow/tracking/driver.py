"""The front door of the tracker: checks its arguments, packs them, and runs blocks of granules on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..field import FlowField
from ..registry import nearest
from .exponential import PATH
from .granules import Body, Granules, Motion, Tracks
from .kernel import fly_block
from .prepare import FORCES, pack_air, pack_granules, pack_lines, pack_state, pack_tables, pack_walls
from .state import AFFINE, CONSTRAINT, FATE, IMPACTS, LINE, STEPS, STORED, TURN, VX, VY, Rules, T, Walls, X, Y

__all__ = ["track"]

Array = NDArray[np.float64]
BLOCK = 512  # granules handed to a thread at a time
ROOM = 1024  # points kept of a recorded track
MOST_STEPS = 1_000_000
MOST_IMPACTS = 5_000  # a granule that rattles in a notch of a vibrating body would go on for good


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
    gravity: Sequence[float] = (0.0, -9.81),
    seed: int = 0,
    record: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Tracks:
    """Follow ``grains`` through ``field`` (None: a vacuum) until each meets its fate, or the clock shows ``until`` (s).

    ``tolerance`` is the landing error in units of ``length`` (m; default: width of the first body, 1 m without one).
    ``forces``: drag, gravity (g alone), buoyancy, pressure-gradient; those of the air do nothing in a vacuum.
    ``bodies`` are outlines (k, 2), which move by ``motion``, or Body; ``lines`` (k, 2) polylines that end a track
    when its centre crosses them. An edge of the mesh that no body covers ends it there: BINNED when it lies on a
    line, else ESCAPED. A granule that reaches into a wall at birth is pushed out; one born inside a body is STOPPED,
    one born outside the mesh ESCAPED with no step. ``seed`` is for random forces; there are none in this version.
    ``record`` keeps each path, thinned to at most 1024 points. ``workers`` threads (default: all cores); results do
    not depend on their number. ``progress(done, total)``. Raises SceneError for an unknown force or drag law, or
    arguments out of range.
    """
    for force in forces:
        if force not in FORCES:
            raise SceneError(f"unknown force {force!r}{nearest(force, list(FORCES))} (known: {', '.join(FORCES)})")
    solids = [body if isinstance(body, Body) else Body(np.asarray(body, dtype=float), motion=motion) for body in bodies]
    if length is None:
        length = float(np.ptp(solids[0].outline[:, 0])) if solids else 1.0
    for name, value in (("length", length), ("tolerance", tolerance)):
        if not (np.isfinite(value) and value > 0):
            raise SceneError(f"{name} = {value:g} must be positive and finite")
    if not np.isfinite(until):
        raise SceneError(f"until = {until:g} s must be finite")
    reach = 1e-6 * length
    walls = pack_walls(solids, pack_lines(lines))
    air = pack_air(field, solids, reach, "pressure-gradient" in forces)
    tables, table_of = pack_tables(drag, grains.sphericity)
    floats, ints = pack_state(grains, field, air, solids, reach)
    rules = _rules(field, solids, walls, until, tolerance, length)
    constants = pack_granules(grains, field, forces, gravity)
    recorded: list[Array] = [np.zeros((0, 5))] * len(grains)

    def fly(low: int) -> int:
        part = slice(low, min(low + BLOCK, len(grains)))
        count = part.stop - low
        room = np.zeros((count, ROOM if record else 0, 5))
        scratch = (np.zeros(PATH), np.zeros(AFFINE), np.zeros(CONSTRAINT))
        block = (floats[part], ints[part], constants[part], tables, table_of[part])
        fly_block(*block, air, walls, rules, room, *scratch)
        if record:
            for i in range(count):
                recorded[low + i] = room[i, : ints[low + i, STORED]].copy()
        return count

    done = 0
    pool = ThreadPoolExecutor(max_workers=workers or os.cpu_count() or 1)
    try:
        for future in as_completed([pool.submit(fly, low) for low in range(0, len(grains), BLOCK)]):
            done += future.result()
            if progress is not None:
                progress(done, len(grains))
    finally:  # an interruption waits for the blocks that fly now, not for those that are still queued
        pool.shutdown(cancel_futures=True)
    return Tracks(
        position=floats[:, [X, Y]],
        velocity=floats[:, [VX, VY]],
        time=floats[:, T].copy(),
        fate=ints[:, FATE].copy(),
        steps=ints[:, STEPS].copy(),
        impacts=ints[:, IMPACTS].copy(),
        line=ints[:, LINE].copy(),
        spin=floats[:, TURN].copy(),
        recorded=tuple(recorded) if record else None,
    )


def _rules(
    field: FlowField | None,
    bodies: Sequence[Body],
    walls: Walls,
    until: float,
    tolerance: float,
    length: float,
) -> Rules:
    extent = 10 * length if field is None else float(np.hypot(*np.ptp(field.points, axis=0)))
    periods = [1.0 / body.motion.frequency for body in bodies if body.motion is not None and body.motion.frequency > 0]
    rest = max(periods, default=0.0)
    if field is not None and field.times is not None and len(field.times) > 1:
        rest = max(rest, field.period) if field.period is not None else np.inf
    box, swing = walls.bodies[:, :4], np.abs(walls.bodies[:, 4:6])
    return Rules(
        until=float(until),
        allowance=tolerance * length / extent,
        extent=extent,
        length=float(length),
        skin=1e-11 * length,
        tiny=0.01 * tolerance * length,
        rest=1.05 * rest,
        left=float(np.min(box[:, 0] - swing[:, 0], initial=0.0)),
        right=float(np.max(box[:, 2] + swing[:, 0], initial=0.0)),
        bottom=float(np.min(box[:, 1] - swing[:, 1], initial=0.0)),
        top=float(np.max(box[:, 3] + swing[:, 1], initial=0.0)),
        steps=MOST_STEPS,
        impacts=MOST_IMPACTS,
    )
