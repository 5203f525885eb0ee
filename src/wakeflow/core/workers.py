"""Workers: an executor whose processes are fresh interpreters, one task at a time each, and of which one may die.

``concurrent.futures.ProcessPoolExecutor`` imports the caller's script again in every process, so that a script would
need a ``__main__`` guard, and it is broken for good once a process dies. Here a process that dies (out of memory, a
crash in a library) fails its own task alone, and another takes its place.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from threading import Thread, Timer
from types import FrameType, TracebackType
from typing import IO, Any, NamedTuple, ParamSpec, TypeVar

from .errors import ProgramError
from .process import end_group, start_in_group, tail

__all__ = ["Workers"]

Result = TypeVar("Result")
Given = ParamSpec("Given")
# One core each: libraries that multiply matrices must not start a thread for every core of the machine.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
TIDY = 20.0  # s that a worker that is asked to end has for ending its solver and letting go of its locks
ENDED = 128 + signal.SIGTERM  # exit code of one that did not manage


class _Task(NamedTuple):
    future: Future[Any]
    call: tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]


@dataclass
class Workers(Executor):
    """``count`` processes that work on what is submitted, first come first served; each is started when it is needed.

    A submitted function is known by its module and name, and its arguments and result are pickled. What a worker
    prints, the end of a crashed one included, goes to ``folder``/log.worker-N. Workers work in the folder ``cwd`` (the
    caller's) with ``env`` added to the caller's environment. They end with the process that started them, however that
    ends, and end the programs that they have started before they let go of their locks.
    """

    count: int
    folder: Path
    cwd: Path = field(default_factory=Path.cwd)
    env: Mapping[str, str] = field(default_factory=dict)
    _tasks: SimpleQueue[_Task | None] = field(default_factory=SimpleQueue, init=False, repr=False)
    _lines: list[_Line] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        logs = [self.folder / f"log.worker-{number}" for number in range(1, self.count + 1)]
        self._lines = [_Line(self._tasks, log, self.cwd, self.env) for log in logs]

    def submit(self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs) -> Future[Result]:
        """Have ``fn(*args, **kwargs)`` called by a worker.

        The future raises ProgramError, with what the worker said, where the call raised or the worker died.
        """
        future: Future[Result] = Future()
        self._tasks.put(_Task(future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers after what they do now; ``cancel_futures`` drops what was not begun."""
        if cancel_futures:
            self._drop()
        for _ in self._lines:
            self._tasks.put(None)
        if wait:
            for line in self._lines:
                line.thread.join()

    def end(self) -> None:
        """End the workers at once, whatever they do; stages that they interrupt go on the next time."""
        self._drop()
        for line in self._lines:
            line.end()
        self.shutdown()

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.end()

    def _drop(self) -> None:
        while not self._tasks.empty():
            task = self._tasks.get()
            if task is not None:
                task.future.cancel()


@dataclass
class _Line:
    """A thread that hands tasks to one process after the other; the process lives as long as the thread."""

    tasks: SimpleQueue[_Task | None]
    log: Path
    cwd: Path
    env: Mapping[str, str]
    thread: Thread = field(init=False)
    child: subprocess.Popen[bytes] | None = field(default=None, init=False)
    answers: IO[bytes] | None = field(default=None, init=False)
    over: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self.thread = Thread(target=self._work, daemon=True)
        self.thread.start()

    def end(self) -> None:
        """End the process at once."""
        self.over = True
        if self.child is not None and self.child.poll() is None:
            os.killpg(self.child.pid, signal.SIGTERM)

    def _work(self) -> None:
        while (task := self.tasks.get()) is not None:
            if not task.future.set_running_or_notify_cancel():
                continue
            try:
                task.future.set_result(self._ask(task.call))
            except BaseException as problem:  # belongs to whoever waits for the future
                task.future.set_exception(problem)
        self._close()

    def _ask(self, call: tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]) -> Any:
        question = pickle.dumps(call)
        if self.over:
            raise ProgramError("the workers were ended")
        if self.child is None:
            self._start()
        assert self.child is not None
        assert self.child.stdin is not None
        assert self.answers is not None
        try:
            self.child.stdin.write(question)
            self.child.stdin.flush()
            done, reply = pickle.load(self.answers)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise self._died() from None
        if done:
            return reply
        raise ProgramError(reply[0], log=self.log, tail=reply[1])

    def _start(self) -> None:
        told, tell = os.pipe()
        command = [sys.executable, "-P", "-m", "wakeflow.core.workers", str(tell)]
        with self.log.open("ab") as sink:
            env = {**os.environ, **ONE_THREAD, **self.env}
            self.child = start_in_group(command, self.cwd, env, sink, stdin=subprocess.PIPE, pass_fds=(tell,))
        os.close(tell)
        self.answers = os.fdopen(told, "rb")

    def _died(self) -> ProgramError:
        """What to say of the process, which is gone; the next task starts another."""
        child = self.child
        assert child is not None
        self._close()
        code = child.returncode
        ended = f"by signal {-code}" if code < 0 else f"with exit code {code}"
        return ProgramError(f"its worker process was ended {ended}", log=self.log, tail=tail(self.log))

    def _close(self) -> None:
        if self.child is None:
            return
        assert self.child.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended
            self.child.stdin.close()  # nothing more to do: it ends
        if self.answers is not None:
            self.answers.close()
        if not self.over:
            self.child.wait()
        end_group(self.child)
        self.child = None


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


def _serve(tell: int) -> None:
    """Answer calls from standard input, one after the other, until it is closed."""
    signal.signal(signal.SIGTERM, _end_tidily)
    with os.fdopen(tell, "wb") as answers:
        while True:
            try:
                function, arguments, options = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            except Exception as problem:
                reply: tuple[bool, Any] = False, (f"{type(problem).__name__}: {problem}", traceback.format_exc())
            else:
                reply = _called(function, arguments, options)
            answers.write(pickle.dumps(reply))
            answers.flush()


def _called(function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]) -> tuple[bool, Any]:
    """Whether the call returned, and what; else what it raised, with its traceback."""
    try:
        return True, function(*arguments, **options)
    except Exception as problem:  # raised again on the other side
        return False, (f"{type(problem).__name__}: {problem}", traceback.format_exc())


if __name__ == "__main__":
    _serve(int(sys.argv[1]))
