"""Seconds that a run would take on an idle machine, read from its processor time while others use the cores too."""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Self

TICK = 0.25  # s
TASKS = Path("/proc/self/task")


class IdleClock:
    """Seconds that this process and those that it starts would have taken so far on so many idle ``cores``, and all
    their processor seconds, ``spent``: of each quarter of a second the processor time of the busiest thread, or that of
    all over the cores, whichever is longer. Waiting for a disk does not count. Read from /proc, which Linux alone has:
    elsewhere the seconds are those that pass, and ``spent`` is 0.
    """

    def __init__(self, cores: int) -> None:
        self.cores, self.now, self.spent = cores, 0.0, 0.0
        self._seen: dict[str, float] = {}
        self._began, self._ended = time.monotonic(), threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True)

    def __enter__(self) -> Self:
        self._began, self._seen = time.monotonic(), _processor_seconds()
        if TASKS.exists():
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()
        self.now = self()

    def __call__(self) -> float:
        return self.now if TASKS.exists() else time.monotonic() - self._began

    def _follow(self) -> None:
        while not self._ended.wait(TICK):
            now = _processor_seconds()
            took = [seconds - self._seen.get(task, 0.0) for task, seconds in now.items()]
            self.spent += sum(took)
            self.now += max(max(took), sum(took) / self.cores)
            self._seen = now


def _processor_seconds() -> dict[str, float]:
    """Of each thread of this process and of those below it, s."""
    found, waiting = dict[str, float](), [str(os.getpid())]
    while waiting:
        process = waiting.pop()
        for thread in Path("/proc", process, "task").glob("*"):
            with suppress(OSError):  # it has ended meanwhile
                found[thread.name] = int((thread / "schedstat").read_text().split()[0]) / 1e9
                waiting += (thread / "children").read_text().split()
    return found
