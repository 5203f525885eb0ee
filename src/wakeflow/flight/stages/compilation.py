"""The compilation of the tracker's two kernels: by set-up, in the background of a run, or where granules first fly."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread

import numpy as np

from ... import flight as tracking
from ...core.code_key import kernel_folder
from ...core.errors import ProgramError
from ...core.files import kernel_root
from ...core.process import call_in_child, cores
from ...core.quantities import duration
from ...planning.stage_cache import StageCache, StageTime
from ...planning.stages import OWN, StageKey
from .machine_rates import KERNELS, note_compiled, to_compile

COMPILED = StageKey(OWN, "compile")  # the tracker is compiled once a run, whatever airflow it flies in
_ready = set[str]()  # the kernels that this process has


def compile_tracker(_: None = None) -> None:
    """Have the tracker compiled, or read from its cache, before time is taken; by one process for all that ask."""
    _fly_once("tracker", None)


def compile_slab(_: None = None) -> None:
    """Have the slab's kernel compiled, or read from its cache, before it is needed; by one process for all that ask."""
    _fly_once("slab", tracking.Collisions(depth=0.1, step=1e-4))


def compile_ahead() -> None:
    """Have both kernels compiled side by side, where the cache has not got them yet: for set-up."""
    if to_compile():
        for child in [_in_child(kernel, kernel_root() / f"log.compile_{kernel}") for kernel in KERNELS]:
            child.join()


def _fly_once(kernel: str, collisions: tracking.Collisions | None) -> None:
    """Fly two granules for a moment; other processes that compile this ``kernel`` of these sources are waited for."""
    from filelock import FileLock

    place, speed = np.array([[0.0, 0.0], [0.0, 1.0]]), np.zeros((2, 2))
    still = tracking.Granules(position=place, velocity=speed, diameter=1e-3, density=1e3)
    root = kernel_folder("wakeflow.flight.kernel.loop")  # not above: another version's compilation is none of these
    root.mkdir(parents=True, exist_ok=True)
    with FileLock(root / f"compile-{kernel}.lock"):
        anew, started = kernel in to_compile(), time.monotonic()
        tracking.track(None, still, until=1e-3, length=1.0, forces=("gravity",), collisions=collisions)
        if anew:
            note_compiled(kernel, time.monotonic() - started)


@dataclass
class Compilation:
    """The tracker's compilation, which a run waits for at most once: beside OpenFOAM, or before the first tracks."""

    children: dict[str, Thread] = field(default_factory=dict)

    def begin(self, log: Path, *, slab: bool) -> None:
        """Have the tracker, and the ``slab``'s own kernel, compiled into their cache by other processes, where a core
        is free for them and this process has not got it yet.
        """
        logs = {"tracker": log} | ({"slab": log.with_name(f"{log.name}-slab")} if slab else {})
        if not self.children and cores() > 1 and not _ready.issuperset(logs):
            self.children |= {kernel: _in_child(kernel, log) for kernel, log in logs.items()}

    def make(
        self, cache: StageCache, name: str, key: str, work: Callable[[Path], object], begun: Sequence[Path] = (), *,
        slab: bool = False,
    ) -> Path:  # fmt: skip
        """The folder of a stage in which granules fly, as :meth:`StageCache.make`; where they must fly now the kernels
        are waited for before time is taken, the ``slab``'s own where they meet.
        """
        if not cache.store.holds(name, key):
            if COMPILED not in cache.seconds:
                self.finish(cache)
            if slab:
                if seconds := to_compile().get("slab"):
                    words = f"the slab's kernel is compiled: about {duration(seconds)}, once for each version"
                    cache.tell("compile", words)
                self._join("slab")
        return cache.make(name, key, work, begun)

    def _join(self, kernel: str) -> None:
        if kernel in self.children:
            self.children[kernel].join()
        _ready.add(kernel)

    def finish(self, cache: StageCache) -> None:
        """Have the tracker compiled here, or read from the cache."""
        started = time.monotonic()
        seconds = to_compile().get("tracker")
        known = f"compiled: about {duration(seconds)}, once for each version" if seconds else "read from the cache"
        cache.tell("compile", f"the tracker is {known}")
        self._join("tracker")
        compile_tracker()
        spent = time.monotonic() - started
        cache.seconds[COMPILED] = StageTime(spent, cached=False)
        cache.tell("compile", f"done ({spent:.1f} s)")


def _in_child(kernel: str, log: Path) -> Thread:
    """A thread that waits for another process to compile a ``kernel``."""

    def wait() -> None:
        log.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(ProgramError):  # only time is lost: a kernel compiles where it is first used
            call_in_child(f"{__name__}:compile_{kernel}", None, log=log)

    thread = Thread(target=wait, daemon=True)
    thread.start()
    return thread
