"""Workers on other machines: an executor over a Dask cluster, whose tasks run as those of :mod:`.workers` do.

A Dask worker hands each task to a process of its own and waits for it, so that a task has one thread of its libraries,
the caller's working folder and cache, and a crash that harms nobody else. Where a Dask worker is lost, the scheduler
gives its tasks to another one.
"""

from __future__ import annotations

import os
import socket
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar
from uuid import uuid4

from .errors import ProgramError, SceneError, WakeflowError
from .workers import Workers

if TYPE_CHECKING:
    import distributed

Result = TypeVar("Result")
Given = ParamSpec("Given")
RANKS = "ranks"  # Dask's abstract resource: the MPI processes that a worker has cores for
PATIENCE = 20.0  # s for a scheduler to answer


@dataclass(frozen=True)
class TaskPlace:
    """Where tasks work, on whichever machine: the working folder ``cwd``, the folder ``logs``, the ``cache``; all of
    them on a file system that every worker sees.
    """

    cwd: Path
    logs: Path
    cache: Path


@dataclass(frozen=True)
class Cluster(Executor):
    """An executor over the workers of a Dask ``client``. ``needs``: resources that a worker must offer for a task.

    A future raises ProgramError where the call raised, its process died, or one Dask worker after the other was lost
    with it; WakeflowError where the scheduler itself is gone.
    """

    client: distributed.Client
    place: TaskPlace
    needs: Mapping[str, int] = field(default_factory=dict)
    _own: bool = False
    _sent: dict[Future[Any], distributed.Future[Any]] = field(default_factory=dict)

    @classmethod
    def connect(cls, scheduler: str | distributed.Client, place: TaskPlace) -> Cluster:
        """The cluster behind a scheduler's address such as tcp://host:8786, or behind a client of the caller's own.

        Raises SceneError where Dask is not installed or no scheduler answers.
        """
        try:
            import distributed
        except ModuleNotFoundError:
            raise SceneError("a cluster needs Dask: pip install 'wakeflow[cluster]', on its workers too") from None
        if isinstance(scheduler, distributed.Client):
            return cls(scheduler, place)
        try:
            client = distributed.Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as problem:
            raise SceneError(
                f"no Dask scheduler answers at {scheduler!r} ({problem}); start one with: dask scheduler"
            ) from None
        return cls(client, place, _own=True)

    @property
    def size(self) -> int:
        """Tasks that can run at once on the workers that are there now."""
        return sum(worker["nthreads"] for worker in self._workers.values())

    def threads(self, tasks: int) -> int:
        """How many threads each of so many tasks can have: those of one machine at most."""
        machines: Counter[str] = Counter()
        for worker in self._workers.values():
            machines[worker["host"]] += worker["nthreads"]
        return max(1, min(self.size // max(1, tasks), max(machines.values(), default=1)))

    @property
    def _workers(self) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self.client.scheduler_info(n_workers=-1)["workers"]
        return found

    def on(self, ranks: int) -> Cluster:
        """The same cluster for a task of so many MPI processes; one that needs only one may run on any worker.

        Raises SceneError where there are workers and none of them may run it: it would wait forever.
        """
        if ranks == 1:
            return self
        offered = [worker["resources"].get(RANKS, 0) for worker in self._workers.values()]
        if offered and max(offered) < ranks:
            raise SceneError(
                f"an airflow on {ranks} MPI ranks needs a worker with so many cores: dask worker "
                f"{self.client.scheduler_info()['address']} --nthreads 1 --resources {RANKS}={ranks}"
            )
        return replace(self, needs={RANKS: ranks})

    def submit(self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs) -> Future[Result]:
        """Have ``fn(*args, **kwargs)`` called on one of the workers."""
        mine: Future[Result] = Future()
        mine.set_running_or_notify_cancel()
        theirs = self.client.submit(
            _call_here, self.place, fn, args, kwargs, key=f"{fn.__name__}-{uuid4()}", pure=False,
            resources=dict(self.needs) or None,
        )  # fmt: skip
        self._sent[mine] = theirs
        theirs.add_done_callback(partial(self._hand_on, mine))
        return mine

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Wait for what was submitted, and end the processes of the Dask workers; the cluster itself goes on."""
        if cancel_futures:
            self.client.cancel(list(self._sent.values()), reason="the sweep has ended")
        elif wait:
            for future in list(self._sent):
                future.exception()
        self.client.run(_end_here, self.place)
        if self._own:
            self.client.close()

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not isinstance(problem, _Lost):
            self.shutdown(cancel_futures=kind is not None)
        elif self._own:
            self.client.close()

    def _hand_on(self, mine: Future[Any], theirs: distributed.Future[Any]) -> None:
        """Called by Dask's own thread when a task has ended, one way or another."""
        del self._sent[mine]
        if theirs.status == "finished":
            mine.set_result(theirs.result())
        elif theirs.status == "error":
            problem = theirs.exception()
            known = isinstance(problem, WakeflowError)
            mine.set_exception(problem if known else ProgramError(f"{type(problem).__name__}: {problem}"))
        else:
            mine.set_exception(_Lost("the Dask scheduler is gone; start it again, and the same command goes on"))


class _Lost(WakeflowError):
    """Nobody knows what becomes of the tasks. No ProgramError: it is not the task that failed."""


_here: dict[TaskPlace, Workers] = {}  # the processes of this Dask worker, by where they work


def _call_here(
    place: TaskPlace, function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]
) -> Any:
    """On a Dask worker: call ``function`` in a process of its own that works in ``place``; such processes are kept.

    Raises ProgramError where this machine does not see the place, and as :class:`Workers` does.
    """
    from distributed import get_worker

    for folder in (place.cwd, place.logs):
        if not folder.is_dir():
            raise ProgramError(
                f"{socket.gethostname()} sees no folder {folder}: the sweep's folder and its cache must lie on a file "
                "system that all workers share"
            )
    log, env = place.logs / f"{socket.gethostname()}-{os.getpid()}", {"WAKEFLOW_CACHE": str(place.cache)}
    own = _here.setdefault(place, Workers(get_worker().state.nthreads, log, place.cwd, env))
    return own.submit(function, *arguments, **options).result()


def _end_here(place: TaskPlace) -> None:
    """On a Dask worker: end the processes that work in ``place``, whatever they do."""
    if own := _here.pop(place, None):
        own.end()
