"""The tracker's compilation, which a run waits for at most once."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread

from ..core.errors import ProgramError
from ..core.process import call_in_child, cores
from .cache import StageCache
from .stages import StageKey, StageTime

__all__ = ["COMPILED", "Compilation"]

COMPILED = StageKey("", "compile")  # the tracker is compiled once a run, whatever airflow it flies in


@dataclass
class Compilation:
    """The tracker's compilation, which a run waits for at most once: beside OpenFOAM, or before the first tracks."""

    children: list[Thread] = field(default_factory=list)

    def begin(self, log: Path) -> None:
        """Have the tracker compiled into its cache by another process, where a core is free for it."""
        if not self.children and cores() > 1:
            self.children.append(Thread(target=_compile_in_child, args=(log,), daemon=True))
            self.children[0].start()

    def finish(self, cache: StageCache) -> None:
        """Have it compiled here, or read from the cache, before the time of the tracks is taken."""
        from .tracks import compile_tracker

        started = time.monotonic()
        cache.tell("compile", "the tracker is compiled, once for each version of it")
        for child in self.children:
            child.join()
        compile_tracker()
        cache.seconds[COMPILED] = StageTime(time.monotonic() - started, cached=False)


def _compile_in_child(log: Path) -> None:
    log.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(ProgramError):  # only time is lost: the tracker compiles where it is first used
        call_in_child("wakeflow.pipeline.tracks:compile_tracker", None, log=log)
