"""The tracker's compilation, which a run waits for at most once."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread

from ..core.errors import ProgramError
from ..core.process import call_in_child, cores
from ..planning.stages import OWN, StageKey
from .cache import StageCache
from .stages import StageTime

__all__ = ["COMPILED", "Compilation"]

COMPILED = StageKey(OWN, "compile")  # the tracker is compiled once a run, whatever airflow it flies in
_here, _slab_here = Event(), Event()  # this process has the tracker; and the slab's kernel


@dataclass
class Compilation:
    """The tracker's compilation, which a run waits for at most once: beside OpenFOAM, or before the first tracks."""

    children: list[Thread] = field(default_factory=list)
    of_the_slab: list[Thread] = field(default_factory=list)

    def begin(self, log: Path, *, slab: bool) -> None:
        """Have the tracker, and the ``slab``'s own kernel, compiled into their cache by other processes, where a core
        is free for them and this process has not got it yet.
        """
        if not self.children and cores() > 1 and not (_slab_here if slab else _here).is_set():
            self.children.append(_in_child("tracks:compile_tracker", log))
            if slab:
                self.of_the_slab.append(_in_child("crowd_flight:compile_slab", log.with_name(f"{log.name}-slab")))

    def finish_slab(self) -> None:
        """Wait for the slab's kernel, where another process compiles it."""
        for child in self.of_the_slab:
            child.join()
        _slab_here.set()

    def finish(self, cache: StageCache) -> None:
        """Have it compiled here, or read from the cache, before the time of the tracks is taken."""
        from .tracks import compile_tracker

        started = time.monotonic()
        cache.tell("compile", "the tracker is compiled, once for each version of it")
        for child in self.children:
            child.join()
        compile_tracker()
        _here.set()
        spent = time.monotonic() - started
        cache.seconds[COMPILED] = StageTime(spent, cached=False)
        cache.tell("compile", f"done ({spent:.1f} s)")


def _in_child(function: str, log: Path) -> Thread:
    """A thread that waits for another process to call a ``function`` of this package."""

    def wait() -> None:
        log.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(ProgramError):  # only time is lost: a kernel compiles where it is first used
            call_in_child(f"wakeflow.pipeline.{function}", None, log=log)

    thread = Thread(target=wait, daemon=True)
    thread.start()
    return thread
