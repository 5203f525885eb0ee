"""The machine in a vacuum at its own feed rate: the slab's granules, and where the slab lets them land.

The shipped rhombus without its air, fed with 500 kg/h of wheat alone: spheres of Coulomb friction, one restitution and
no scatter, which a code of soft spheres can do as well.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakeflow.core.files import scene_templates
from wakeflow.injection.stream import slab_stream
from wakeflow.laws.constants import GRAVITY
from wakeflow.pipeline.tracks import bodies_and_walls, end_lines
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import Plan
from wakeflow.planning.variation import Variation
from wakeflow.scene import Scene
from wakeflow.tracking import Collisions, Granules, track

Array = NDArray[np.float64]
DEPTH = 0.06  # m: 15 diameters, the plan's own
RESTITUTION, FRICTION = 0.5, 0.3
TOLERANCE = 1e-3  # body widths: of the landing of a granule that meets nobody
LONGEST = 5.0  # s after the last birth
CHUNK = 0.005  # s between two makings of granules in a code that makes them by the batch


@dataclass(frozen=True)
class Machine:
    """A scene without air and its plan; a slab of ``depth`` (m) that is fed for ``start_up``, for the ``operation``
    that counts, and for as long as the start-up again (s). One coefficient of ``restitution`` and of ``friction``
    for all contacts.
    """

    scene: Scene
    plan: Plan
    depth: float
    start_up: float
    operation: float
    restitution: float = RESTITUTION
    friction: float = FRICTION


@dataclass(frozen=True)
class Flown:
    """The place (n,) of each granule among the scene's bins, -1 where it reached none, and processor ``seconds``."""

    place: NDArray[np.int64]
    seconds: float


def the_machine(operation: float, changes: Mapping[str, Any] | None = None) -> Machine:
    """The shipped rhombus in a vacuum, fed with wheat alone; ``changes`` as of ``Scene.replace``."""
    table = tomllib.loads(scene_templates()["rhombus"].read_text())
    del table["air"]
    law = {"restitution": RESTITUTION, "friction": FRICTION, "rebound_scatter": 0.0, "tangential_restitution": 0.0}
    table["fraction"] = {"wheat": table["fraction"]["wheat"] | law | {"impact": "sphere", "mass_share": 1.0}}
    table["collisions"] = {"depth": DEPTH, "restitution": RESTITUTION, "friction": FRICTION}
    scene = Scene.model_validate(table).replace(dict(changes or {}))
    plan = make_plan(scene)
    assert plan.crowd is not None
    return Machine(scene, plan, plan.crowd.depth, plan.crowd.start_up, operation)


def fed(machine: Machine, replicate: int) -> tuple[Granules, NDArray[np.bool_]]:
    """The granules of a replicate by time of birth, at rest in their spin, and which came in steady operation.

    Those that would overlap another one are left out, had both been made up to CHUNK earlier, higher up.
    """
    timing = {"begin": 0.0, "start_up": machine.start_up, "operation": machine.operation, "depth": machine.depth}
    stream = slab_stream(machine.scene, machine.plan, None, replicate, **timing, variation=Variation())
    kept = _apart_earlier(stream.granules, machine.depth)
    return stream.granules[kept], stream.counted[kept]


def _apart_earlier(grains: Granules, depth: float) -> NDArray[np.intp]:
    """Indices of the granules that overlap no earlier one at any time up to CHUNK before their own birth."""
    assert grains.depth is not None
    kept: list[int] = []
    for new in range(len(grains)):
        old = np.array(kept[-64:], dtype=np.intp)
        for early in (0.0, CHUNK):
            since = grains.time[new] - early - grains.time[old]
            fall = grains.velocity[old] * since[:, None] - [0.0, 0.5 * GRAVITY] * (since**2)[:, None]
            own = -grains.velocity[new] * early - np.array([0.0, 0.5 * GRAVITY]) * early**2
            away = grains.position[old] + fall - grains.position[new] - own
            across = grains.depth[old] - grains.depth[new]
            across -= depth * np.round(across / depth)
            reach = 0.5 * (grains.diameter[old] + grains.diameter[new])
            if np.any(np.hypot(np.hypot(away[:, 0], away[:, 1]), across) < reach):
                break
        else:
            kept.append(new)
    return np.array(kept, dtype=np.intp)


def fly_machine(machine: Machine, grains: Granules, seed: int, step: float | None = None) -> tuple[Flown, float]:
    """Let the slab fly ``grains``; returns where they landed, and the step (s) of its clock, found where not given."""
    begun = time.process_time()
    tracks = track(
        None, grains, until=float(grains.time.max()) + LONGEST, tolerance=TOLERANCE, length=machine.scene.width,
        forces=("gravity",), seed=seed, bodies=bodies_and_walls(machine.scene), lines=end_lines(machine.scene),
        gravity=(0.0, -GRAVITY), workers=1,
        collisions=Collisions(machine.depth, machine.restitution, machine.friction, step=step),
    )  # fmt: skip
    seconds = time.process_time() - begun
    assert tracks.crowd is not None
    binned = (tracks.line >= 0) & (tracks.line < len(machine.scene.bin))
    return Flown(np.where(binned, tracks.line, -1), seconds), tracks.crowd.step
