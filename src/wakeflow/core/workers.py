"""Workers: an executor whose processes are fresh interpreters, one task at a time each, and of which one may die.

``concurrent.futures.ProcessPoolExecutor`` imports the caller's script again in every process, so that a script would
need a ``__main__`` guard, and it is broken for good once a process dies. Here a process that dies (out of memory, a
crash in a library) fails its own task alone, and another takes its place.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from itertools import count as numbers_from
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from threading import Timer, local
from types import FrameType, TracebackType
from typing import Any, ParamSpec, TypeVar

from .errors import ProgramError
from .process import end_group, start_in_group, tail

Result = TypeVar("Result")
Given = ParamSpec("Given")
# One core each: libraries that multiply matrices must not start a thread for every core of the machine.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
TIDY = 20.0  # s that a worker that is asked to end has for ending its solver and letting go of its locks
ENDED = 128 + signal.SIGTERM  # exit code of one that did not manage


class Workers(Executor):
    """``count`` processes that work on what is submitted, first come first served; each is started when it is needed.

    A submitted function is known by its module and name, and its arguments and result are pickled. What a worker
    prints, the end of a crashed one included, goes to ``folder``/log.worker-N. Workers work in the folder ``cwd`` (the
    caller's) with ``env`` added to the caller's environment. They end with the process that started them, however that
    ends, and end the programs that they have started before they let go of their locks.
    """

    def __init__(self, count: int, folder: Path, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.count, self.folder, self.cwd, self.env = count, folder, cwd or Path.cwd(), env or {}
        self._threads = ThreadPoolExecutor(count, initializer=self._begin)  # a process each
        self._numbers, self._own, self._over = numbers_from(1), local(), False
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
                os.killpg(child.pid, signal.SIGTERM)
        self.shutdown(cancel_futures=True)

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.end()

    def _begin(self) -> None:
        self._own.log, self._own.child = self.folder / f"log.worker-{next(self._numbers)}", None

    def _ask(self, call: tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]) -> Any:
        question = pickle.dumps(call)
        self._own.child = child = self._own.child or self._start()
        if self._over:  # asked for once the process is among those that are ended
            raise ProgramError("the workers were ended")
        try:
            self._alive[child].send_bytes(question)
            done, reply = self._alive[child].recv()
        except (EOFError, OSError):
            self._own.child, code = None, self._close(child)
            ended = f"by signal {-code}" if code < 0 else f"with exit code {code}"
            log = self._own.log
            raise ProgramError(f"its worker process was ended {ended}", log=log, tail=tail(log)) from None
        if done:
            return reply
        raise ProgramError(reply[0], log=self._own.log, tail=reply[1])

    def _start(self) -> subprocess.Popen[bytes]:
        ours, theirs = Pipe()
        command = [sys.executable, "-P", "-m", "wakeflow.core.workers", str(theirs.fileno())]
        env = {**os.environ, **ONE_THREAD, **self.env}
        with self._own.log.open("ab") as sink, theirs:
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


def _end_tidily(number: int, frame: FrameType | None) -> None:
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


if __name__ == "__main__":
    _serve(int(sys.argv[1]))
