"""The agenda of a sweep: which stages its scenes share, what waits for what, what it will cost.

Where neighbours help an airflow waits for the one that it starts from (``neighbours``), and goes on from rest where
that one fails.
Scenes that fly in one airflow wait for it, and it is solved once. Of scenes whose flights are the same (they differ in
mass shares, targets or the feed's rate) one flies and the others wait for it. Both are reported from plans alone,
before anything is computed. Where two stages turn out equal beyond that, the lock of the cache makes one wait for the
other.

What a worker does, :func:`solve_airflow_of` and :func:`fly_scene`, other processes know by name. Nothing is raised for
a scene that fails: what is returned says why, nothing where it went well, and the sweep goes on.
"""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from heapq import heapify, heappop, heappush
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..answer.result import FILE, Request, Result, key_in
from ..core import own_files
from ..core.errors import ProgramError, SceneError, WakeflowError
from ..core.executor import Cluster
from ..core.files import atomic_write, read_json, write_json
from ..core.lazy import cached_property
from ..core.record import JsonMapping
from ..planning.cost import SHARED, airflow_cost, ranks_for, typical_cells
from ..planning.plan import Plan
from ..planning.plan_messages import unfelt, unfelt_line
from ..planning.stage_cache import Listener, null_listener
from ..planning.stages import FLIGHTS
from ..runs import answer_key, compile_tracker, run_once
from ..runs.planned import make_plan
from ..runs.progress import OVERDUE, TRUSTED, time_left
from ..runs.run_stages import airflow_key, flights_key
from ..scene import Scene
from .variant import SCENES_PER_LINE, Variant


# -- Which airflow of a sweep starts from which ------------------------------------------------------------------------
def starts(points: Sequence[Mapping[str, object]]) -> list[int]:
    """Place of the point that each of the ``points`` (inputs by dotted key) starts from; its own for the most central
    one, which starts from rest.

    Whoever is farthest from those that are there comes next, and starts from the nearest of them (farthest-first
    traversal: Gonzalez 1985, Theor. Comput. Sci. 38, 293): few wait for few. Numbers are compared over the range that
    the points span, other values by whether they are the same.
    """
    count = len(points)
    places = list(range(count))
    if not count:
        return places
    apart = _distances(points)
    near = np.full(count, int(apart.sum(axis=1).argmin()))
    there = np.arange(count) == near[0]
    for _ in range(count - 1):
        away = np.where(there, -1.0, apart[np.arange(count), near])
        new = int(away.argmax())
        places[new] = int(near[new])
        there[new] = True
        near = np.where(apart[:, new] < apart[np.arange(count), near], new, near)
    return places


def _distances(points: Sequence[Mapping[str, object]]) -> NDArray[np.float64]:
    """Distances between all of the points, (n, n)."""
    squares = np.zeros((len(points), len(points)))
    for key in sorted({key for point in points for key in point}):
        values = [point.get(key) for point in points]
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            numbers = np.array(values, dtype=float)
            squares += ((numbers[:, None] - numbers) / (np.ptp(numbers) or 1.0)) ** 2
        else:
            squares += [[float(value != other) for other in values] for value in values]
    return np.asarray(np.sqrt(squares))


# -- The agenda of a sweep ---------------------------------------------------------------------------------------------
AIRFLOWS = "airflows"  # folder of the airflows' own results
ON_ALL_CORES, BOTH_CORES = (FLIGHTS, "slab"), 2.0  # work whose expected seconds are those of two cores together


@dataclass(frozen=True)
class Step:
    """One job of the agenda: for a scene, or for the airflow of several, on so many MPI ``ranks``; ``needs`` the step
    of that name before it, "" none.
    """

    name: str
    job: Job
    airflow: bool
    needs: str
    seconds: float  # of cores, expected
    disk: float  # bytes, expected
    ranks: int = 1

    @property
    def wall(self) -> float:
        """Expected seconds on the threads that it has; programs of the airflow take one core."""
        return self.seconds if self.airflow else self.seconds / self.job.threads


@dataclass(frozen=True)
class Agenda:
    """All steps in the order in which they are begun, the folders of the scenes by name with their stamps, and what
    cannot be planned with the reason.
    """

    steps: tuple[Step, ...]
    stamps: Mapping[str, str]
    problems: Mapping[str, str]

    @property
    def seconds(self) -> float:
        """Expected core-seconds of all steps."""
        return sum(step.seconds for step in self.steps)

    @property
    def disk(self) -> float:
        """Expected bytes that all steps leave."""
        return sum(step.disk for step in self.steps)


@dataclass(frozen=True)
class _Planned:
    """One scene under its plan."""

    variant: Variant
    scene: Scene
    plan: Plan
    request: Request

    @cached_property
    def stamp(self) -> str:
        """What its answer is made for."""
        return answer_key(self.scene, self.request)

    @cached_property
    def airflow(self) -> str:
        """What tells its airflow from others; empty where it costs nothing."""
        return airflow_key(self.scene, self.plan)

    def job(self, folder: Path, threads: int, *, report: bool = False) -> Job:
        """What a worker does for it in a folder."""
        return Job(self.scene.tables(), self.request, folder, self.stamp, self.plan, threads, report)

    def seconds(self, *, airflow: bool, report: bool) -> float:
        """Expected core-seconds of what is shared with scenes in the same airflow, its other grids among it, or of the
        rest, which is all where no airflow is solved; with a ``report`` or without.
        """
        names = {stage.name for stage in SHARED} if self.airflow else set[str]()
        return sum(
            stage.whole * (BOTH_CORES if stage.key.stage.work in ON_ALL_CORES else 1.0)
            for stage in self.plan.stages
            if (stage.key.name in names) is airflow and (report or stage.key.name != "report")
        )

    @property
    def ranks(self) -> int:
        """MPI processes of its airflow for which a cluster must have cores. The two that a large airflow in two
        dimensions takes unasked are not counted: any worker may run it.
        """
        ranks, airflow = self.scene.numerics.ranks, self.plan.airflow
        if ranks != "auto":
            return ranks
        return 1 if not airflow.span else ranks_for(round(typical_cells(self.scene, airflow)))[0]

    @cached_property
    def flight(self) -> str:
        """What tells its flights from others in the same airflow."""
        return flights_key(self.scene, self.plan)


def make_agenda(
    variants: Sequence[Variant],
    out: Path,
    request: Request,
    *,
    threads: Callable[[int], int] = lambda _: 1,
    report: bool = False,
    neighbours: bool = False,
    listener: Listener = null_listener,
) -> Agenda:
    """What is still to be done for ``variants`` in the folder ``out``; scenes that are finished there need nothing.

    ``threads(scenes)``: on how many each of so many scenes is flown. With ``neighbours`` an airflow starts from the
    nearest one that is there by then.
    """
    planned: list[_Planned] = []
    problems: dict[str, str] = {}
    for number, variant in enumerate(variants, 1):
        if number % SCENES_PER_LINE == 0:
            listener("sweep", f"planning scene {number} of {len(variants)}")
        if variant.scene is None:
            problems[variant.name] = variant.problem
            continue
        try:
            plan = make_plan(variant.scene, rung=request.rung, force=request.force, target_error=request.target_error)
        except SceneError as problem:
            problems[variant.name] = str(problem)
            continue
        planned.append(_Planned(variant, variant.scene, plan, request))
    if deaf := _unfelt(planned):
        listener("sweep", unfelt_line(deaf))
    planned = _started(planned, out) if neighbours else planned
    stamps = {member.variant.name: member.stamp for member in planned}
    unfinished = [member for member in planned if finished(out / member.variant.name, member.stamp) is None]
    count = threads(len(unfinished))
    steps = *_airflow_steps(unfinished, out, count), *_flight_steps(unfinished, out, count, report=report)
    return Agenda(steps, stamps, problems)


def _unfelt(planned: Sequence[_Planned]) -> list[str]:
    """The inputs in which scenes differ and which none of them feels. Raises SceneError where there are no others: all
    answers would be the same.
    """
    keys = list(dict.fromkeys(key for member in planned for key in member.variant.inputs))
    varied = [key for key in keys if len({repr(member.variant.inputs.get(key)) for member in planned}) > 1]
    deaf = [key for key in varied if all(unfelt([key], member.scene, member.plan.rung) for member in planned)]
    if varied and deaf == varied:
        raise SceneError(unfelt_line(deaf))
    return deaf


def _started(planned: Sequence[_Planned], out: Path) -> list[_Planned]:
    """The scenes, each asked for near the one whose airflow its own starts from."""
    first = _by_airflow(planned)
    keys = list(first)
    places = starts([member.variant.inputs for member in first.values()])
    near = {key: str(out / _folder(keys[place])) for key, place in zip(keys, places, strict=True) if keys[place] != key}
    return [replace(member, request=replace(member.request, near=near.get(member.airflow))) for member in planned]


def _by_airflow(planned: Iterable[_Planned]) -> dict[str, _Planned]:
    """The first scene of each airflow that costs something, by what tells that airflow from others."""
    first: dict[str, _Planned] = {}
    for member in planned:
        if member.airflow:
            first.setdefault(member.airflow, member)
    return first


def _folder(airflow: str) -> str:
    """Where the own result of an airflow stands, in the sweep's folder."""
    return f"{AIRFLOWS}/{airflow[:12]}"


def _airflow_steps(planned: Iterable[_Planned], out: Path, threads: int) -> Iterable[Step]:
    """One step for each airflow, the longest first, so that none is left alone at the end."""
    first = _by_airflow(planned)
    folders = {str(out / _folder(key)): _folder(key) for key in first}
    steps = []
    for key, lead in first.items():
        cost, folder = airflow_cost(lead.scene, lead.plan.airflow), _folder(key)
        job, needs = lead.job(out / folder, threads), folders.get(lead.request.near or "", "")
        steps.append(Step(folder, job, True, needs, lead.seconds(airflow=True, report=False), cost.disk, lead.ranks))
    return sorted(steps, key=lambda step: -step.seconds)


def _flight_steps(planned: Iterable[_Planned], out: Path, threads: int, *, report: bool) -> Iterable[Step]:
    leaders: dict[tuple[str, str], str] = {}
    for member in planned:
        same, name = (member.airflow, member.flight), member.variant.name
        air = airflow_cost(member.scene, member.plan.airflow)
        needs = leaders.get(same, _folder(member.airflow) if member.airflow else "")
        leaders.setdefault(same, name)
        seconds, disk = member.seconds(airflow=False, report=report), member.plan.estimate["disk"] - air.disk
        yield Step(name, member.job(out / name, threads, report=report), False, needs, seconds, disk)


# -- Doing an agenda ---------------------------------------------------------------------------------------------------
LOOK_EVERY = 1.0  # s between looks at the time left, where nothing ends
TOLD_AGAIN, SHORTER = 1.5, 5.0  # times, and s, shorter than the one told last: the time left is told anew
TRUSTED_PART = 0.05  # of all that is expected: until so much is done, if that is less than TRUSTED, as that; chosen
STARTS = 3.5  # s of a worker's first step: what it imports, and the compiled kernels that it reads; measured
AT_HAND = 0.02  # of the expected time: a step that takes less was found in the cache, and says nothing of the pace


@dataclass
class SweepProgress:
    """How far an agenda of ``steps`` is on so many ``workers``: what has begun and ended when, by the name of a step.

    What is left is laid out on the workers, each kind of step, airflows and flights, at the pace that it had so far,
    without the seconds in which a worker starts.
    """

    steps: Sequence[Step]
    workers: int
    clock: Callable[[], float] = time.monotonic
    began: dict[str, float] = field(default_factory=dict)  # of steps under way: when
    took: dict[str, float] = field(default_factory=dict)  # of steps that have ended: s
    first: set[str] = field(default_factory=set)  # the first step of each worker
    failed: int = 0
    least: float = math.inf  # seconds left as reported so far
    reported: float = math.inf  # those reported last, if nothing has ended since

    def begin(self, handed_out: Iterable[Step]) -> None:
        """Note which steps are under way: of those that are handed out, and have not ended, as many as work at once."""
        for step in islice(handed_out, self.workers):
            self.began.setdefault(step.name, self.clock())
            if len(self.first) < self.workers:
                self.first.add(step.name)

    def end(self, step: Step, problem: str) -> None:
        """Note that a step has ended, perhaps before it began."""
        self.took[step.name] = self.clock() - self.began.pop(step.name, self.clock())
        self.failed += bool(problem)
        self.reported = math.inf

    def news(self, tell: Callable[[str], None]) -> None:
        """Tell how far it is, where a step has ended or much less is left than at the last time."""
        if self.reported > max(TOLD_AGAIN * (left := self.left), left + SHORTER):
            self.reported = left
            tell(str(self))

    def _pace(self, airflow: bool) -> float:
        """Seconds that steps of a kind take over those expected of them."""
        trusted = min(TRUSTED, TRUSTED_PART * sum(step.wall for step in self.steps if step.airflow is airflow))
        taken = expected = trusted
        for step in self.steps:
            now = self.took.get(step.name)
            if now is None and step.name in self.began:
                now = self.clock() - self.began[step.name]
                now = now if now > step.wall else None  # overdue
            if step.airflow is airflow and now is not None and now > AT_HAND * step.wall:
                started = STARTS if step.name in self.first else 0.0
                taken, expected = taken + max(0.0, now - started), expected + step.wall
        return taken / expected if expected else 1.0

    @property
    def left(self) -> float:
        """Seconds until the last step has ended."""
        pace = {airflow: self._pace(airflow) for airflow in (True, False)}
        ends, free = dict[str, float](), [0.0] * max(0, self.workers - len(self.began))
        for step in self.steps:
            if step.name in self.began:
                spent, whole = self.clock() - self.began[step.name], pace[step.airflow] * step.wall
                ends[step.name] = max(whole - spent, (1.0 - OVERDUE) * max(whole, spent))
                free.append(ends[step.name])
        heapify(free)
        for step in self.steps:
            if step.name not in self.began and step.name not in self.took:
                ends[step.name] = max(heappop(free), ends.get(step.needs, 0.0)) + pace[step.airflow] * step.wall
                heappush(free, ends[step.name])
        return max(ends.values(), default=0.0)

    def __str__(self) -> str:
        """Scenes and stages that have ended of all, how many failed, and the time left."""
        scenes = [step for step in self.steps if not step.airflow]
        left, failed = "", f", {self.failed} failed" if self.failed else ""
        if len(self.took) < len(self.steps):
            seconds = self.left
            self.least = min(self.least, seconds)
            left = f", {time_left(seconds, self.least)} left"
        done = sum(step.name in self.took for step in scenes)
        return f"{done} of {len(scenes)} scenes, {len(self.took)} of {len(self.steps)} stages{failed}{left}"


def do_agenda(
    agenda: Agenda, executor: Executor, tell: Callable[[str], None], ended: Callable[[Step, str], None],
    workers: int = 1,
) -> None:  # fmt: skip
    """Do every step; ``ended(step, problem)`` hears of each in the order in which they end. ``tell`` hears how far it
    is, as ``workers`` work at once: whenever a step has ended, and when much less is left than it heard last.

    Steps are handed out in the order of the agenda as soon as what they need has ended: airflows first, then flights.
    """
    if not agenda.steps:
        return
    progress, left = SweepProgress(agenda.steps, workers), list(agenda.steps)
    running: dict[Future[str], Step] = {}
    done = {""}  # names of steps that have ended
    lost: dict[str, str] = {}  # by name why flights that need a step fail with it

    def end(step: Step, problem: str) -> None:
        done.add(step.name)
        if step.airflow and problem:
            lost[step.name] = f"its airflow failed: {problem}"
        progress.end(step, problem)
        ended(step, problem)

    while True:
        while ready := [step for step in left if step.needs in done]:
            left = [step for step in left if step.needs not in done]
            for step in ready:
                if step.needs in lost and not step.airflow:
                    lost[step.name] = lost[step.needs]
                    end(step, lost[step.name])
                else:
                    running[_begun(step, executor)] = step
        if not running:
            break
        progress.begin(running.values())
        progress.news(tell)
        for future in wait(running, timeout=LOOK_EVERY, return_when=FIRST_COMPLETED).done:
            end(running.pop(future), _problem(future))
    tell(f"done {progress}")


def _begun(step: Step, executor: Executor) -> Future[str]:
    able = executor.on(step.ranks) if isinstance(executor, Cluster) else executor
    return able.submit(solve_airflow_of if step.airflow else fly_scene, step.job)


def _problem(future: Future[str]) -> str:
    try:
        return future.result()
    except ProgramError as problem:  # the worker died
        return str(problem)


# -- What a worker does ------------------------------------------------------------------------------------------------
LOCK = ".job.lock"  # held by the process that works on a folder
STAMP = ".point.json"  # written last into a scene's folder: what the numbers beside it were made for
CRASH = "failure.log"  # the traceback of a failure that is nobody's wrong input


@dataclass(frozen=True)
class Job:
    """One scene to compute: plain ``tables``, how it is asked for, its folder, the ``stamp`` of all that it was made
    for, and its ``plan``; on how many ``threads`` it is flown; whether a ``report`` is due.
    """

    tables: JsonMapping
    request: Request
    folder: Path
    stamp: str
    plan: Plan
    threads: int = 1
    report: bool = False

    @property
    def request_now(self) -> Request:
        """The request as it can be met: from rest where the airflow to start from has failed."""
        near = self.request.near
        return replace(self.request, near=near if near is not None and (Path(near) / FILE).exists() else None)


def finished(folder: Path, stamp: str) -> Result | None:
    """The result in a folder, where it was made for the same ``stamp``; None where it was not, where another run has
    replaced it, or where none is there.
    """
    try:
        noted = read_json(folder / STAMP)
    except (FileNotFoundError, NotADirectoryError, SceneError):
        return None
    if not isinstance(noted, dict) or noted.get("stamp") != stamp:
        return None
    try:
        result = Result.load(folder)
    except WakeflowError:  # removed by hand, or written by another version
        return None
    return result if noted.get("key") == result.key else None


def solve_airflow_of(job: Job) -> str:
    """Solve the airflow that a scene flies in, the grids beside it and the airflow that it starts from."""
    with _alone(job.folder):
        return _tried(job, until="airflow")


def fly_scene(job: Job) -> str:
    """Compute a scene to its end; the stamp goes last into its folder, so that a killed job is none that was done."""
    with _alone(job.folder):
        if finished(job.folder, job.stamp) is not None:  # by a worker that was thought lost, or of an earlier sweep
            return ""
        problem = _tried(job, until=None)
        if not problem:
            write_json(job.folder / STAMP, {"stamp": job.stamp, "key": key_in(job.folder)})
        return problem


def _alone(folder: Path) -> AbstractContextManager[object]:
    """Wait until no other process works on a job's folder, as one may that a cluster's scheduler has lost sight of."""
    from filelock import FileLock

    folder.mkdir(parents=True, exist_ok=True)
    return FileLock(folder / LOCK)


def _tried(job: Job, until: str | None) -> str:
    try:
        own_files.refuse_foreign(job.folder, [job.folder / CRASH], CRASH)
        (job.folder / STAMP).unlink(missing_ok=True)
        if until is None:
            compile_tracker()
        run_once(
            Scene.parse(job.tables), job.folder, replace(job.request_now, until=until), workers=job.threads,
            report=job.report, made=job.plan,
        )  # fmt: skip
    except ProgramError as problem:
        _note(job.folder, f"{problem}\n{problem.tail}\n")
        return str(problem)
    except (WakeflowError, OSError) as problem:
        return str(problem)
    except Exception as problem:  # a mistake of the program: the other scenes go on, the traceback is kept and named
        file = _note(job.folder, traceback.format_exc())
        return f"{type(problem).__name__}: {problem} (traceback: {file})"
    (job.folder / CRASH).unlink(missing_ok=True)
    return ""


def _note(folder: Path, text: str) -> Path:
    with own_files.writing(folder, lambda: [folder / CRASH], CRASH), atomic_write(folder / CRASH) as stream:
        stream.write(text)
    return folder / CRASH
