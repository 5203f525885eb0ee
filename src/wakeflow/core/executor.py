"""Executors: processes of this machine, and the workers of a Dask cluster, one task at a time each.

``concurrent.futures.ProcessPoolExecutor`` imports the caller's script again in every process, so that a script would
need a ``__main__`` guard, and it is broken for good once a process dies. Here a process that dies (out of memory, a
crash in a library) fails its own task alone, and another takes its place.

A Dask worker hands each task to a process of its own and waits for it, so that a task has one thread of its libraries,
the caller's working folder and cache, and a crash that harms nobody else. Where a Dask worker is lost, the scheduler
gives its tasks to another one.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count as numbers_from
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from threading import Timer, local
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar
from uuid import uuid4

from .errors import ProgramError, SceneError, WakeflowError
from .process import end_group, start_in_group, tail

if TYPE_CHECKING:
    import distributed


# -- Workers -----------------------------------------------------------------------------------------------------------
Result = TypeVar("Result")
Given = ParamSpec("Given")
# One core each: libraries that multiply matrices must not start a thread for every core of the machine.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
NO_CHANGE: Mapping[str, str] = MappingProxyType({})  # of the environment
TIDY = 20.0  # s that a worker that is asked to end has for ending its solver and letting go of its locks
ENDED = 128 + signal.SIGTERM  # exit code of one that did not manage


class Workers(Executor):
    """``count`` processes that work on what is submitted, first come first served; each is started when it is needed.

    A submitted function is known by its module and name, and its arguments and result are pickled. What a worker
    prints, the end of a crashed one included, goes to ``folder``/log.worker-N. Workers work in the folder ``cwd`` (the
    caller's) with ``env`` added to the caller's environment. They end with the process that started them, however that
    ends, and end the programs that they have started before they let go of their locks.
    """

    def __init__(self, count: int, folder: Path, cwd: Path = Path(), env: Mapping[str, str] = NO_CHANGE) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.count, self.folder, self.cwd, self.env = count, folder, cwd.absolute(), env
        self._threads = ThreadPoolExecutor(count, initializer=self._begin)  # a process each
        self._numbers, self._local, self._over = numbers_from(1), local(), False
        self._alive: dict[subprocess.Popen[bytes], Connection] = {}

    def submit(self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs) -> Future[Result]:
        """Have ``fn(*args, **kwargs)`` called by a worker.

        The future raises ProgramError, with what the worker said, where the call raised or the worker died.
        """
        return self._threads.submit(self._ask, (fn, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers after what they do now; ``cancel_futures`` drops what was not begun."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            for child in list(self._alive):
                self._close(child)

    def end(self) -> None:
        """End the workers at once, whatever they do; stages that they interrupt go on the next time."""
        self._over = True
        for child in list(self._alive):
            if child.poll() is None:
                with suppress(ProcessLookupError):  # it has ended by itself since
                    os.killpg(child.pid, signal.SIGTERM)
        self.shutdown(cancel_futures=True)

    def __exit__(self, kind: object, problem: object, trace: object) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.end()

    def _begin(self) -> None:
        self._local.log, self._local.child = self.folder / f"log.worker-{next(self._numbers)}", None

    def _ask(self, call: tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]) -> Any:
        question = pickle.dumps(call)
        self._local.child = child = self._local.child or self._start()
        if self._over:  # asked for once the process is among those that are ended
            raise ProgramError("the workers were ended")
        try:
            self._alive[child].send_bytes(question)
            done, reply = self._alive[child].recv()
        except (EOFError, OSError):
            self._local.child, code = None, self._close(child)
            ended = f"by signal {-code}" if code < 0 else f"with exit code {code}"
            log = self._local.log
            raise ProgramError(f"its worker process was ended {ended}", log=log, tail=tail(log)) from None
        if done:
            return reply
        raise ProgramError(reply[0], log=self._local.log, tail=reply[1])

    def _start(self) -> subprocess.Popen[bytes]:
        ours, theirs = Pipe()
        command = [sys.executable, "-P", "-m", "wakeflow.core.executor", str(theirs.fileno())]
        env = {**os.environ, **ONE_THREAD, **self.env}
        if self._local.log.is_symlink():
            self._local.log.unlink()
        with self._local.log.open("ab") as sink, theirs:
            child = start_in_group(command, self.cwd, env, sink, pass_fds=(theirs.fileno(),))
        self._alive[child] = ours
        return child

    def _close(self, child: subprocess.Popen[bytes]) -> int:
        """Let a process end, which has nothing more to do; its exit code."""
        self._alive.pop(child).close()
        if not self._over:
            child.wait()
        end_group(child)
        return child.returncode


def _end_tidily(number: int, frame: object) -> None:
    """Unwind what is done at this moment, as for Ctrl-C: the solver is ended first, then its folder is unlocked, so
    that no other process finds the one without the other. What cannot be unwound in time is cut short.
    """
    del frame
    signal.signal(number, signal.SIG_IGN)
    last = Timer(TIDY, os._exit, [ENDED])
    last.daemon = True
    last.start()
    raise SystemExit(ENDED)


def _serve(descriptor: int) -> None:
    """Answer calls, one after the other, until the other side is closed."""
    signal.signal(signal.SIGTERM, _end_tidily)
    with Connection(descriptor) as caller, suppress(EOFError):
        while True:
            caller.send(_answer(caller.recv_bytes()))


def _answer(question: bytes) -> tuple[bool, Any]:
    """Whether the call returned, and what; else what it raised, with its traceback."""
    try:
        function, arguments, options = pickle.loads(question)
        return True, function(*arguments, **options)
    except Exception as problem:  # raised again on the other side
        return False, (f"{type(problem).__name__}: {problem}", traceback.format_exc())


# -- Workers on other machines -----------------------------------------------------------------------------------------
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
    _connected: bool = False
    _sent: dict[Future[Any], distributed.Future[Any]] = field(default_factory=dict)

    @classmethod
    def connect(cls, scheduler: str | distributed.Client, place: TaskPlace) -> Cluster:
        """The cluster behind a scheduler's address such as tcp://host:8786, or behind a client of the caller's own.

        Raises SceneError where Dask is not installed or no scheduler answers.
        """
        try:
            import distributed
        except ModuleNotFoundError:
            raise SceneError("a cluster needs Dask: pip install dask distributed, on its workers too") from None
        if isinstance(scheduler, distributed.Client):
            return cls(scheduler, place)
        try:
            client = distributed.Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as problem:
            raise SceneError(
                f"no Dask scheduler answers at {scheduler!r} ({problem}); start one with: dask scheduler"
            ) from None
        return cls(client, place, _connected=True)

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
        result: Mapping[str, Any] = self.client.scheduler_info(n_workers=-1)["workers"]
        return result

    def on(self, ranks: int) -> Cluster:
        """This cluster for a task of so many MPI processes; one that needs only one may run on any worker.

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
        if self._connected:
            self.client.close()

    def __exit__(self, kind: object, problem: object, trace: object) -> None:
        if not isinstance(problem, _Lost):
            self.shutdown(cancel_futures=kind is not None)
        elif self._connected:
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
    """The tasks are lost: nobody knows what becomes of them. No ProgramError: it is not the task that failed."""


_here: dict[TaskPlace, Workers] = {}  # the processes of this Dask worker, by where they work


def _call_here(
    place: TaskPlace, function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]
) -> Any:
    """Call ``function`` on a Dask worker, in a process of its own that works in ``place``; such processes are kept.

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
    workers = _here.setdefault(place, Workers(get_worker().state.nthreads, log, place.cwd, env))
    return workers.submit(function, *arguments, **options).result()


def _end_here(place: TaskPlace) -> None:
    """End the processes of a Dask worker that work in ``place``, whatever they do."""
    if workers := _here.pop(place, None):
        workers.end()


if __name__ == "__main__":
    try:
        _serve(int(sys.argv[1]))
    except SystemExit:  # all is unwound: taking libraries down as well takes seconds on a busy machine
        sys.stdout.flush()
        os._exit(ENDED)
