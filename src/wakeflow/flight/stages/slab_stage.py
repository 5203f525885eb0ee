"""The slab: granules that meet each other, flown in replicates of steady operation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, as_completed, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import flight as tracking
from ...air.field import FlowField
from ...air.kinds.airflow_kinds import Realisations
from ...core.errors import SceneError
from ...core.process import cores
from ...core.tables import save_arrays
from ...laws.forces import forces
from ...planning.collisions import CollisionPlan
from ...planning.plan import Plan
from ...scene import Scene
from ...scene.changes import AS_GIVEN, Variation
from ..feed.feedstock import Feedstock
from ..feed.stream import SlabFeed, slab_stream
from .fraction_flights import PATIENCE, landing_columns, passage, track_in
from .landings import Landings

CODE = "flight.stages.slab_stage", "flight.stages.landings"  # what computes it


SHARE_OF_SHIFT = 0.5  # share that changes its bin, about, over the mean shift of all landings (body widths)


@dataclass(frozen=True)
class SlabFound:
    """What a slab of ``depth`` (m) found after the ``start_up`` (s) that was dropped: ``landings`` by fraction of the
    granules that came in steady operation, in so many ``replicates``; the step of its ``clock`` and what it was chosen
    by (errors in body widths); in how many replicates the feed ``jammed``; ``steps`` of granules in all; the ``folder``
    that keeps them.
    """

    landings: Mapping[str, Landings]
    clock: tracking.ClockStep
    jammed: int
    steps: int
    replicates: int
    depth: float
    start_up: float
    folder: Path


# -- The slab flown ----------------------------------------------------------------------------------------------------
LATE = 0.99  # share of a fraction's granules that have landed when its flight counts as over
SEVERAL = 3.0  # flights of a granule that landed late, within which one that met others does


@dataclass(frozen=True)
class SlabFlight:
    """How a slab of ``depth`` (m), or a ``part`` of one, is flown: ``start_up`` (s) until it is steady, at least
    ``operation`` (s) that count, in a whole number of the airflow's periods; ``tolerance`` (body widths) for the step
    of its clock, or the ``step`` (s) itself; where it is 0 ``measured`` hears the one that was found; ``tell`` hears of
    progress; granules are as the ``variation`` has them. A replicate is one thread's work: ``workers`` fly at a time.
    ``also`` gets each replicate's number, its feed and its tracks with as many points as are ``recorded`` of each.
    """

    scene: Scene
    plan: Plan
    airs: Realisations
    depth: float
    start_up: float
    operation: float
    tolerance: float
    step: float = 0.0
    workers: int = field(default_factory=cores)
    tell: Callable[[str], None] = lambda _: None
    part: float = 1.0
    measured: Callable[[tracking.ClockStep], object] = lambda _: None
    variation: Variation = AS_GIVEN
    also: Callable[[int, SlabFeed, tracking.Tracks], object] = lambda *_: None
    recorded: int = 0

    def fly_all(self, folder: Path, replicates: int) -> None:
        """Fly the first ``replicates`` and keep the landings of each in ``folder``; those that are there already are
        left alone. Where no ``step`` is given the first finds that of the others, which wait for no more than that.
        """
        left = [number for number in range(replicates) if not _file(folder, number).exists()]
        pool = ThreadPoolExecutor(self.workers)
        try:
            jobs: list[Future[None]] = []
            step = self.step
            if not step and 0 in left:
                first, step = self._first(pool, folder)
                jobs.append(first)
                left.remove(0)
            others = replace(self, step=step or step_of(folder))
            jobs += [pool.submit(others.keep, number, folder) for number in left]
            for done, job in enumerate(as_completed(jobs), replicates - len(jobs)):
                job.result()
                self.tell(f"{done + 1} of {replicates} replicates")
        finally:
            pool.shutdown(cancel_futures=True)

    def _first(self, pool: ThreadPoolExecutor, folder: Path) -> tuple[Future[None], float]:
        """The first replicate's flight, and the step (s) that it has found."""
        clock: Future[tracking.ClockStep] = Future()
        job = pool.submit(replace(self, measured=clock.set_result).keep, 0, folder)
        both: tuple[Future[Any], ...] = (clock, job)
        wait(both, return_when=FIRST_COMPLETED)
        if not clock.done():
            job.result()  # raises: it failed before it knew
        self.tell(clock.result().told)
        return job, clock.result().step

    def keep(self, number: int, folder: Path) -> None:
        """Fly one replicate and keep its landings in ``folder``. Where an airflow's mirror image is as likely, every
        second one flies in it, and the two of a pair count as one: between an airflow and its image there is no
        sampling error to find.
        """
        self.tell(f"replicate {number + 1}")
        mirrored = self.plan.airflow.mirrored and self.airs.field is not None
        pair, image = (number // 2, number % 2 == 1) if mirrored else (number, False)
        realisation = pair % len(self.airs)
        field = self.airs.make(realisation)
        if image and field is not None:
            field = field.image
        period = self.airs.period
        operation = period * math.ceil(self.operation / period) if period else self.operation
        stream = self._stream(field, number, operation)
        tracks = self._track(field, stream, number, self.recorded)
        self.also(number, stream, tracks)
        kept = np.flatnonzero(stream.counted)
        feed = Feedstock(stream.granules[kept], np.zeros(len(kept), dtype=bool), np.full(len(kept), pair))
        cycle = self.airs.cycle_of(feed.granules.time)
        columns = landing_columns(feed, tracks.some(kept), len(self.scene.bin), realisation, cycle)
        further = {
            "clock": np.array(tracks.collisions.clock),
            "jammed": np.array(tracks.collisions.jammed),
            "flown": np.array(tracks.collisions.flown),
            "fraction": stream.fraction[kept].astype(np.int16),
            "weight": stream.mass[kept],
            "meetings": tracks.meetings[kept].astype(np.int32),
        }
        save_arrays(_file(folder, number), columns | further)

    def load(self, folder: Path, replicates: int) -> SlabFound:
        """What :meth:`fly_all` kept in a folder."""
        parts = []
        for number in range(replicates):
            with np.load(_file(folder, number)) as data:
                parts.append({key: data[key] for key in data.files})
        step, error, wanted, trials = parts[0]["clock"].tolist()
        clock = tracking.ClockStep(step, error, wanted, int(trials))
        jammed, flown = (sum(int(part[key]) for part in parts) for key in ("jammed", "flown"))
        kept = [key for key in parts[0] if key not in ("clock", "jammed", "flown", "injected")]
        columns = {key: np.concatenate([part[key] for part in parts]) for key in kept}
        fraction, many = columns.pop("fraction"), len(self.scene.fraction)
        columns["replicate"] = _grouped(fraction, columns["replicate"], columns["realisation"], many)
        landed = {}
        for number, name in enumerate(self.scene.fraction):
            mine: dict[str, Any] = {key: values[fraction == number] for key, values in columns.items()}
            if not len(mine["bin"]):
                raise SceneError(
                    f"fraction.{name}: none of it came in the slab's steady operation; raise feed.count or "
                    "collisions.depth"
                )
            weight = mine["weight"]
            mine["weight"] = weight * (weight.sum() / (weight @ weight))
            landed[name] = Landings(**mine)
        return SlabFound(landed, clock, jammed, flown, replicates, self.part * self.depth, self.start_up, folder)

    def record(self, points: int) -> tuple[SlabFeed, tracking.Tracks]:
        """The first replicate's feed over ``operation``, no whole periods, in the first realisation of the airflow, and
        its tracks with ``points`` kept of each.
        """
        stream = self._stream(self.airs.field, 0, self.operation)
        return stream, self._track(self.airs.field, stream, 0, points)

    def _stream(self, field: FlowField | None, number: int, operation: float) -> SlabFeed:
        """What a replicate is fed with, over so much ``operation`` (s), from any moment of the airflow's period, or of
        the vibration's, on.
        """
        vibration = self.scene.vibration
        cycle = self.airs.period or (0.0 if vibration is None else vibration.period)
        begin = cycle * float(np.random.default_rng([self.scene.feed.seed, number]).random())
        return slab_stream(
            self.scene, self.plan, field, number, begin=begin, start_up=self.start_up,
            operation=operation, depth=self.depth, part=self.part, variation=self.variation,
        )  # fmt: skip

    def _track(self, field: FlowField | None, stream: SlabFeed, number: int, record: int) -> tracking.Tracks:
        rebound, every = self.scene.collisions, 2 * list(self.plan.fractions.values())  # granules, then the tracers
        flown = {force for how in every for force in how.forces}
        patience = max(SEVERAL * self.start_up, passage(self.scene, self.plan, self.plan.fractions, PATIENCE))
        collisions = tracking.Collisions(
            self.part * self.depth, rebound.restitution, rebound.friction, tracers=stream.tracers,
            forces=[how.forces for how in every], step=self.step or None, measured=self.measured,
        )  # fmt: skip
        return track_in(
            self.scene, field, stream.granules, ("slab", number), patience, tolerance=self.tolerance, record=record,
            forces=[name for name in forces if name in flown], drag=[how.drag for how in every], workers=1,
            collisions=collisions,
        )  # fmt: skip


def late_in(landings: Mapping[str, Landings]) -> Callable[[str], float]:
    """Seconds, by fraction, after which all but few of its granules have landed."""
    return lambda name: float(np.quantile(landings[name].time, LATE))


def steady_after(collisions: CollisionPlan, late: Callable[[str], float]) -> float:
    """Seconds until a slab is steady: the longest flight, alone, of the granules that are simulated one by one, which
    is as ``late`` says.
    """
    real = [name for name, fine in collisions.tracers.items() if fine < 1.0] or list(collisions.tracers)
    return max(late(name) for name in real)


def _file(folder: Path, number: int) -> Path:
    return folder / f"replicate-{number}.npz"


def step_of(folder: Path) -> float:
    """The step (s) that the first replicate in a folder flew with."""
    with np.load(_file(folder, 0)) as data:
        return float(data["clock"][0])


def _grouped(
    fraction: NDArray[np.int16], replicate: NDArray[np.uint8], realisation: NDArray[np.uint8], fractions: int
) -> NDArray[np.uint8]:
    """Replicates taken together, two and two, until every one holds granules of every fraction: a share of nothing is
    no sample. Those of one realisation of the airflow only.
    """
    count, fields = int(replicate.max()) + 1, int(realisation.max()) + 1
    while count % 2 == 0 and count > 2 and (count // 2) % fields == 0:
        held = np.zeros((fractions, count), dtype=bool)
        held[fraction, replicate] = True
        if held.all():
            break
        count //= 2
        replicate = replicate % count
    return replicate
