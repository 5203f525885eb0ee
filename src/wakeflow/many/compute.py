"""sweep(): many scenes, each stage once, one table and its figures in one folder."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..answer.result import Request, Result
from ..answer.result_table import FAILED, OPEN, Entry, ResultTable
from ..core import own_files
from ..core.errors import SceneError
from ..core.executor import Cluster, TaskPlace, Workers
from ..core.files import digest_of, made_folder, path_of, remove_drafts
from ..core.process import check_workers, cores
from ..core.store import cache_root
from ..planning.stage_cache import Listener, null_listener
from ..runs.progress import as_listener
from ..scene import Scene
from ..scene.scene_tables import States
from .agenda import Agenda, Step, do_agenda, finished, make_agenda
from .comparison import GrowingTable, InTable
from .variant import Variant, of_scenes, read_sweep_file

if TYPE_CHECKING:
    import distributed


WRITE_EVERY = 30.0  # s between tables on disk while scenes are computed
COMMAND, TABLE, WIDE, PARQUET = "sweep", "sweep.csv", "scenes.csv", "sweep.parquet"

Scenes = Iterable[Scene | Path | str | Variant] | Mapping[str, Scene | Path | str] | Path | str


@dataclass(frozen=True)
class Sweep(InTable):
    """The answers of many scenes: their ``table``, also in sweep.csv of ``folder`` (scenes.csv: a row a scene)."""

    folder: Path
    table: ResultTable

    def __repr__(self) -> str:
        return f"<Sweep {self.folder}: {self.table!r}>"

    @property
    def failed(self) -> dict[str, str]:
        """Why each scene failed that did, by its name."""
        return {entry.name: entry.reason for entry in self.table.entries if entry.state == FAILED}

    def frame(self, *, wide: bool = False) -> Any:
        """A row for each number of each scene, with its interval and the scene's inputs; ``wide``: a row a scene.

        A pandas DataFrame where pandas is installed, else a dict of numpy arrays. An input's unit is behind its
        key, a number's in the column ``unit``.
        """
        return self.table.frame(wide=wide)

    def plot(self, quantity: str, over: str, and_over: str | None = None, path: Path | str | None = None) -> Path:
        """Draw a quantity over the input ``over``, lines with whiskers, or with ``and_over`` as a map over two inputs.

        Returns the PNG, by default in the folder's figures. Raises SceneError for names that the table does not have.
        """
        from ..show.many_figures import draw_lines, draw_map

        name = "-".join(filter(None, (quantity, over, and_over)))
        target = self.folder / "figures" / f"{name}.png" if path is None else Path(path)
        if and_over is None:
            draw_lines(target, self.table, [quantity], over)
        else:
            draw_map(target, self.table, [quantity], over, and_over)
        return target

    def result(self, name: str) -> Result:
        """The whole result of one scene. Raises SceneError where it has none."""
        return Result.load(self.folder / name)


@dataclass(frozen=True)
class SweepEstimate:
    """What a sweep will cost from now on: ``scenes`` in all, those ``finished`` before, ``failed`` ones that cannot be
    planned with the reason, ``airflows`` and ``flights`` to compute, core-seconds on one core, bytes of disk.
    """

    scenes: int
    finished: int
    failed: Mapping[str, str]
    airflows: int
    flights: int
    seconds: float
    disk: float


def look_ahead(
    scenes: Scenes,
    out: Path | str = Path("runs", "sweep"),
    *,
    rung: str | None = None,
    force: States | None = None,
    target_error: float | str | None = None,
    neighbours: bool = False,
    listener: Listener = null_listener,
) -> SweepEstimate:
    """What :func:`sweep` would have to do; starts nothing. Raises SceneError as it does."""
    given, request = _variants(scenes), Request.of(None, rung, force, target_error)
    agenda = make_agenda(given, path_of(out, "out"), request, neighbours=neighbours, listener=listener)
    airflows = sum(step.airflow for step in agenda.steps)
    flights = len(agenda.steps) - airflows
    before = len(given) - flights - len(agenda.problems)
    return SweepEstimate(len(given), before, agenda.problems, airflows, flights, agenda.seconds, agenda.disk)


def sweep(
    scenes: Scenes,
    out: Path | str = Path("runs", "sweep"),
    *,
    scheduler: str | distributed.Client | Executor | None = None,
    workers: int | None = None,
    rung: str | None = None,
    force: States | None = None,
    target_error: float | str | None = None,
    neighbours: bool = False,
    report: bool = False,
    figures: bool = True,
    listener: Listener | None = None,
) -> Sweep:
    """Compute many scenes and write one table to the folder ``out``; each stage is computed once.

    ``scenes``: scenes or their files, or a mapping of names to them, or what :func:`variants` made, or the path of a
    sweep file.
    ``scheduler``: the address of a Dask scheduler (tcp://host:8786), a ``dask.distributed.Client``, or any other
    ``concurrent.futures.Executor``, whose workers see the same folders; by default ``workers`` processes on this
    machine, one a core. ``rung``, ``force`` and ``target_error`` as of ``wakeflow.plan``; with ``neighbours`` a steady
    airflow starts from the nearest one that is solved by then, the same in every run; with ``report`` each scene's
    is drawn too, without ``figures`` none of the table's. The same call goes on where an interrupted or killed one
    ended; a scene that fails is in the table with its reason, and is tried again by the next call.

    Raises SceneError where there is nothing to compute, another sweep writes to ``out``, the disk is too small, or no
    scheduler answers.
    """
    from filelock import FileLock, Timeout

    given, (listener, _) = _variants(scenes), as_listener(listener)
    _check_workers(workers, scheduler)
    count, request = workers or cores(), Request.of(None, rung, force, target_error)
    folder = _folder_of(out)
    try:
        with FileLock(folder / ".lock", timeout=0):
            remove_drafts(folder)
            listener("sweep", "planning")
            with executor_on(scheduler, count, folder) as executor:
                agenda = make_agenda(
                    given, folder, request, threads=partial(_threads, executor), report=report, neighbours=neighbours,
                    listener=listener,
                )  # fmt: skip
                _check_disk(agenda, folder)
                rows = _Rows(folder, given, agenda)
                with own_files.writing(folder, partial(_tables, folder), COMMAND):
                    at_once = executor.size if isinstance(executor, Cluster) else count
                    do_agenda(agenda, executor, partial(listener, "sweep"), rows.ended, at_once)
                    return rows.finish(figures=figures)
    except Timeout:
        raise SceneError(f"another sweep is writing to {folder}; wait for it or choose another --out") from None


def _check_workers(workers: int | None, scheduler: object) -> None:
    """Raise SceneError where ``workers`` are no number, or not of this machine."""
    check_workers(workers)
    if workers is not None and scheduler is not None:
        raise SceneError(f"workers = {workers}: of this machine; those of a scheduler are its own")


def _folder_of(out: Path | str) -> Path:
    """The folder of a sweep, made where there is none. Raises SceneError where it holds what no sweep wrote."""
    folder = path_of(out, "out")
    made_folder(folder)
    own_files.refuse_foreign(folder, _tables(folder), COMMAND)
    return folder


def _tables(folder: Path) -> list[Path]:
    return [folder / name for name in (TABLE, WIDE, PARQUET)]


def _variants(scenes: Scenes) -> list[Variant]:
    return read_sweep_file(scenes) if isinstance(scenes, Path | str) else of_scenes(scenes)


def executor_on(
    scheduler: str | distributed.Client | Executor | None, count: int, folder: Path
) -> AbstractContextManager[Executor]:
    """The caller's executor, left open, or processes of its own, here or on a cluster, that end with the ``with``; what
    these print goes to ``folder``/workers.

    Raises SceneError where no scheduler answers.
    """
    logs = folder / "workers"
    if scheduler is None:
        return Workers(count, logs)
    if isinstance(scheduler, Executor):
        return nullcontext(scheduler)
    logs.mkdir(parents=True, exist_ok=True)
    return Cluster.connect(scheduler, TaskPlace(Path.cwd(), logs.absolute(), cache_root()))


def _threads(executor: Executor, scenes: int) -> int:
    """Number of threads on which each of so many scenes is flown: more where they are fewer than the workers."""
    if isinstance(executor, Workers):
        return max(1, cores() // min(executor.count, max(1, scenes)))
    return executor.threads(scenes) if isinstance(executor, Cluster) else 1


def _check_disk(agenda: Agenda, folder: Path) -> None:
    """Raise SceneError where what is to be computed would not fit on the disk."""
    root = cache_root()
    root.mkdir(parents=True, exist_ok=True)
    free = min(shutil.disk_usage(place).free for place in (root, folder))
    if agenda.disk > free:
        raise SceneError(
            f"the sweep needs about {agenda.disk / 1e9:.1f} GB in {root}, where {free / 1e9:.1f} GB are free; "
            "make room (wakeflow clean --keep 10GB), choose another WAKEFLOW_CACHE, or sweep fewer airflows"
        )


@dataclass
class _Rows:
    """The table while it grows."""

    folder: Path
    variants: list[Variant]
    agenda: Agenda

    def __post_init__(self) -> None:
        self.rows, self.written = GrowingTable(), time.monotonic()
        self.by_name = {variant.name: variant for variant in self.variants}
        todo = {step.name for step in self.agenda.steps}
        for name, variant in self.by_name.items():
            if name in todo:
                self.rows.entries[name] = Entry(name, variant.inputs, OPEN)
            else:
                self._take(name, self.agenda.problems.get(name, ""))

    def ended(self, step: Step, problem: str) -> None:
        """Take in what a step has left."""
        if step.airflow:
            return
        self._take(step.name, problem)
        if time.monotonic() - self.written >= WRITE_EVERY:
            self.rows.table.tidy().write_csv(self.folder / TABLE)
            self.written = time.monotonic()

    def _take(self, name: str, problem: str) -> None:
        """What there is of a scene: its numbers, or the ``problem`` for which it has none."""
        inputs = self.by_name[name].inputs
        result = None if problem else finished(self.folder / name, self.agenda.stamps[name])
        if result is None:
            problem = problem or f"its result in {name} cannot be read"
            self.rows.entries[name] = Entry(name, inputs, FAILED, problem)
        else:
            self.rows.add(name, inputs, result)

    def finish(self, *, figures: bool) -> Sweep:
        """Write the tables and draw the ``figures``."""
        from ..show.many_figures import draw_table_figures

        table = self.rows.table
        known, drawn = own_files.listed(self.folder), [*(self.folder / "figures").glob("*.png")]
        table.tidy().write_csv(self.folder / TABLE)
        table.wide().write_csv(self.folder / WIDE)
        table.write_parquet(self.folder / PARQUET)
        if figures and (not drawn or known.get(TABLE) != digest_of(self.folder / TABLE)):
            draw_table_figures(self.folder, table)
        return Sweep(self.folder, table)
