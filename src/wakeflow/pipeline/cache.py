"""The cached stages of a run: what computes them, where they are kept, how long they took, who hears of them.

A stage's key is made of the scene's fields that it reads, the key of the stage before, the sources of the code that
computes it and the versions of outside programs; a change of anything else answers from what is there.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from ..core.beside import heed
from ..core.files import write_json
from ..core.sources import code_key
from ..core.store import Store, content_key
from ..planning.stages import OWN, AirLabel, StageKey, stages
from .stages import StageTime

__all__ = ["Listener", "StageCache", "code_of", "in_turn", "silent", "version_of"]

Work = Callable[[Path], Any]  # makes what belongs into a folder
LOOK = 0.2  # s between looks at what others are at
SECONDS = "seconds.json"  # in a stage's folder: what it took
Listener = Callable[[str, str], None]  # (stage, text): hears of progress


def silent(stage: str, text: str) -> None:
    """The listener that hears nothing."""


def in_turn(listener: Listener) -> Listener:
    """The listener for several threads: it is called by one at a time."""
    lock = Lock()

    def tell(stage: str, text: str) -> None:
        with lock:
            listener(stage, text)

    return tell


def code_of(stage: str) -> str:
    """sha256 (hex) of all sources that compute a registered stage."""
    return code_key(*stages[stage].code)


def version_of(package: str) -> str:
    """The version of an installed Python package."""
    from importlib.metadata import version

    return version(package)


@dataclass(frozen=True)
class StageCache:
    """The stages of one airflow of a run; ``seconds`` is shared by all airflows of the run.

    ``label`` tells the stages of another airflow of the same scene apart in ``seconds`` and to the listener.
    ``crew``: how many processes compute the scene side by side.
    """

    store: Store
    listener: Listener
    seconds: dict[str, StageTime]
    label: AirLabel = OWN
    crew: int = 1

    def tell(self, stage: str, text: str) -> None:
        """Let the listener hear of a stage; ends here where what runs beside has failed."""
        heed()
        self.listener(StageKey(self.label, stage), text)

    def make(
        self, stage: str, key: str, work: Callable[[Path], Any], *, already: Callable[[], float] = lambda: 0.0
    ) -> Path:
        """The folder of a stage, from the cache or by ``work(folder)``; the seconds it took to compute are noted, with
        those of work that was done ``already``, asked for at the end.
        """

        def timed(part: Path) -> None:
            spent, started = part / SECONDS, time.monotonic()
            before = json.loads(spent.read_text()) if spent.exists() else 0.0
            try:
                work(part)
            finally:  # an interrupted stage goes on later; its time counts
                write_json(spent, before + already() + time.monotonic() - started)

        folder, cached = self.store.make(
            stage, key, timed, on_wait=lambda: self.tell(stage, "being computed beside this; waiting for it")
        )
        seconds = json.loads((folder / SECONDS).read_text())
        name = StageKey(self.label, stage)
        computed_before = name in self.seconds and not self.seconds[name].cached
        self.seconds[name] = StageTime(seconds, cached and not computed_before)
        self.tell(stage, f"done ({'from the cache' if cached else f'{seconds:.1f} s'})")
        return folder

    def make_together(
        self, stage: str, key: str, pieces: Mapping[str, Work], join: Callable[[Mapping[str, Path], Path], Any]
    ) -> Path:
        """The folder of a stage that the processes of the crew make side by side: each of its ``pieces`` by the first
        that is free for it, then ``join(folders of the pieces, folder)`` by one of them.
        """
        self._fly_apart(stage, key, pieces)
        kept: dict[str, Path] = {}

        def joined(part: Path) -> None:
            for name, work in pieces.items():
                kept[name] = self.store.make(f"{stage}-pieces", content_key(key, name), _timed(work))[0]
            join(kept, part)

        def spent() -> float:
            return float(sum(json.loads((folder / SECONDS).read_text()) for folder in kept.values()))

        folder = self.make(stage, key, joined, already=spent)
        for piece in kept.values():  # none where another joined them
            shutil.rmtree(piece)
        return folder

    def _fly_apart(self, stage: str, key: str, pieces: Mapping[str, Work]) -> None:
        """Make the pieces that no other process is at, until all are there or the whole stage is."""
        left, whole = dict(pieces), self.store.root / stage / key
        while left and not whole.exists():
            before = list(left)
            for name in before:
                if self._made_here(stage, content_key(key, name), left[name], whole):
                    del left[name]
            if len(left) == len(before):
                time.sleep(LOOK)

    def _made_here(self, stage: str, key: str, work: Work, whole: Path) -> bool:
        """Whether a piece is there, now; False where another process is at it, or has joined it to the others."""

        def elsewhere() -> None:
            raise _Elsewhere

        def unless_joined(part: Path) -> None:
            if whole.exists():
                raise _Elsewhere
            self.tell(stage, "one of several processes")
            _timed(work)(part)

        try:
            self.store.make(f"{stage}-pieces", key, unless_joined, on_wait=elsewhere)
        except _Elsewhere:
            return False
        return True


class _Elsewhere(Exception):
    """Another process makes it, or has made it."""


def _timed(work: Work) -> Work:
    def timed(part: Path) -> None:
        started = time.monotonic()
        work(part)
        write_json(part / SECONDS, time.monotonic() - started)

    return timed
