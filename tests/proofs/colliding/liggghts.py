"""The machine in a vacuum at its own feed rate, by the slab and by LIGGGHTS.

machine: The machine in a vacuum at its own feed rate: the slab's granules, and where the slab lets them land.

The shipped rhombus without its air, fed with 500 kg/h of wheat alone: spheres of Coulomb friction, one restitution and
no scatter, which a code of soft spheres can do as well.

liggghts: The machine in a vacuum flown by LIGGGHTS: the same granules at the same times and places, as soft spheres.

Contacts are Hertz' springs with the damping that gives the restitution, softened, and a tangential dashpot under
Coulomb's cap. With a restitution of 0.5 that dashpot leaves less than a hundredth of the slip of a contact that sticks:
the law of ``wf.Collisions`` without tangential restitution. ``tangential="history"`` is Mindlin's spring.

LIGGGHTS makes granules between its runs only: every CHUNK those of the next one are made, as much higher up as they
fall until their time comes.
"""

from __future__ import annotations

import math
import resource
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakeflow.core.files import atomic_write, scene_templates
from wakeflow.extras.funnel.engine import read_dump, run_script, write_settings, write_triangles
from wakeflow.extras.funnel.pour import POISSON
from wakeflow.flight import Collisions, Granules, track
from wakeflow.flight.feed.first_contact import motion_of
from wakeflow.flight.feed.stream import slab_stream
from wakeflow.flight.stages.fraction_flights import bodies_and_walls, end_lines
from wakeflow.laws.collision import contact_time
from wakeflow.laws.constants import GRAVITY
from wakeflow.planning.plan import Plan
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.changes import Variation

# -- machine -----------------------------------------------------------------------------------------------------------
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
    assert plan.collisions is not None
    return Machine(scene, plan, plan.collisions.depth, plan.collisions.start_up, operation)


def fed(machine: Machine, replicate: int) -> tuple[Granules, NDArray[np.bool_]]:
    """The granules of a replicate by time of birth, at rest in their spin, and which came in steady operation.

    Those that would overlap another one are left out, had both been made up to CHUNK earlier, higher up.
    """
    timing = {"begin": 0.0, "start_up": machine.start_up, "operation": machine.operation, "depth": machine.depth}
    stream = slab_stream(machine.scene, machine.plan, None, replicate, **timing, variation=Variation())
    balls = stream.granules.replace(shape=1.0)  # as LIGGGHTS flies them
    kept = _apart_earlier(balls, machine.depth)
    return balls[kept], stream.counted[kept]


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
    assert tracks.collisions is not None
    binned = (tracks.line >= 0) & (tracks.line < len(machine.scene.bin))
    return Flown(np.where(binned, tracks.line, -1), seconds), tracks.collisions.clock.step


# -- liggghts ----------------------------------------------------------------------------------------------------------
SCRIPT = Path(__file__).with_name("machine.liggghts")
FAST = 3.0  # m/s: the quickest collision that the step resolves; all fall through half a metre
ROOM = 0.08  # m below the floor, in which granules are seen once at least
SHOT = 0.005  # s between looks below the floor
EMPTY = 2.0  # s at most until the last granules are out


@dataclass(frozen=True)
class SoftSpheres:
    """Young's ``modulus`` (Pa), steps in the quickest collision, and the tangential model of LIGGGHTS."""

    modulus: float = 1e7
    steps: float = 25.0
    tangential: str = "no_history"

    def step(self, grains: Granules) -> float:
        """Time step (s) of LIGGGHTS: of the smallest granules, in CHUNK a whole number of times."""
        smallest = int(np.argmin(grains.diameter))
        size, density = float(grains.diameter[smallest]), float(grains.density[smallest])
        most = contact_time(size, density, self.modulus, FAST, POISSON) / self.steps
        return CHUNK / math.ceil(CHUNK / most)


def fly_liggghts(machine: Machine, grains: Granules, soft: SoftSpheres, folder: Path) -> Flown:
    """Let LIGGGHTS fly ``grains``, which are sorted by time, in ``folder``. Raises ProgramError as LIGGGHTS does."""
    folder.mkdir(parents=True, exist_ok=True)
    dt = soft.step(grains)
    _write_body(machine, folder)
    _write_feed(grains, round(CHUNK / dt), folder)
    write_settings(folder, _settings(machine, grains, soft, dt))
    busy = _busy()
    run_script(folder, SCRIPT)
    seconds = _busy() - busy
    return Flown(_places(machine, _landings(machine, len(grains), folder / "fallen.dump")), seconds)


def _busy() -> float:
    """Processor time (s) of the programs that this one started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _settings(machine: Machine, grains: Granules, soft: SoftSpheres, dt: float) -> dict[str, float | int | str]:
    channel, motion = machine.scene.channel, motion_of(machine.scene)
    half, along = channel.width / 2, tuple(map(float, motion.amplitude))
    return {
        "left": -half - 0.01, "right": half + 0.01, "wall_left": -half, "wall_right": half,
        "low": channel.bottom - ROOM, "high": channel.top + 0.05, "floor": channel.bottom, "depth": machine.depth,
        "youngs": soft.modulus, "poisson": POISSON, "tangential": soft.tangential,
        "e": machine.restitution, "ew": float(grains.restitution[0]),
        "f": machine.friction, "fw": float(grains.friction[0]),
        "g": GRAVITY, "dt": dt, "skin": 0.25 * float(grains.diameter.max()),
        "amplitude": math.hypot(*along), "along_x": along[0], "along_y": along[1],
        "period": 1.0 / (motion.frequency or 1.0),
        "chunk": round(CHUNK / dt), "shot": round(SHOT / dt), "turns": math.ceil(EMPTY / CHUNK),
    }  # fmt: skip


def _write_body(machine: Machine, folder: Path) -> None:
    """The outlines of all bodies, extruded across the slab."""
    found = []
    for body in machine.scene.body.values():
        outline = body.outline()
        for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            near, far = (np.array([[*start, z], [*end, z]]) for z in (0.0, machine.depth))
            found += [np.stack([near[0], near[1], far[1]]), np.stack([near[0], far[1], far[0]])]
    write_triangles(folder / "body.stl", "body", found)


def _write_feed(grains: Granules, chunk: int, folder: Path) -> None:
    """``feed.liggghts``: runs of ``chunk`` steps, before each the granules whose time comes in it."""
    assert grains.depth is not None
    made = np.maximum(np.floor(grains.time / CHUNK).astype(int), 0)
    made[0] = 0  # an empty box cannot run
    early = grains.time - CHUNK * made
    height = grains.position[:, 1] - grains.velocity[:, 1] * early - 0.5 * GRAVITY * early**2
    speed = grains.velocity[:, 1] + GRAVITY * early
    aside = grains.position[:, 0] - grains.velocity[:, 0] * early
    with atomic_write(folder / "feed.liggghts") as stream:
        last = 0
        for i, when in enumerate(made):
            stream.write(f"run {chunk}\n" * (when - last))
            last = when
            stream.write(f"create_atoms 1 single {aside[i]:.12g} {height[i]:.12g} {grains.depth[i]:.12g} units box\n")
            stream.write(
                f"set atom {i + 1} diameter {grains.diameter[i]:.12g} density {grains.density[i]:.12g}"
                f" vx {grains.velocity[i, 0]:.12g} vy {speed[i]:.12g} vz 0\n"
            )
        stream.write(f"run {chunk}\n")


def _landings(machine: Machine, count: int, dump: Path) -> Array:
    """Where each granule went through the floor (n,) m, NaN where it did not: back along its fall from where it was
    first seen below.
    """
    floor, x = machine.scene.channel.bottom, np.full(count, np.nan)
    for _, rows in read_dump(dump):
        fresh = rows[np.isnan(x[rows[:, 0].astype(int) - 1])]
        below, vx, vy = fresh[:, 2] - floor, fresh[:, 3], fresh[:, 4]
        since = (vy + np.sqrt(vy**2 + 2.0 * GRAVITY * below)) / GRAVITY
        x[fresh[:, 0].astype(int) - 1] = fresh[:, 1] + vx * since
    return x


def _places(machine: Machine, x: Array) -> NDArray[np.int64]:
    """The bin of each landing (n,), of those on the floor; what left beside the walls, by round-off, is at the wall."""
    half = machine.scene.channel.width / 2
    place, at = np.full(len(x), -1), np.clip(x, -half, half)
    for number, bin_ in enumerate(machine.scene.bin.values()):
        low, high = bin_.line(machine.scene)[:, 0]
        place[(at >= low) & (at <= high)] = number
    return place
