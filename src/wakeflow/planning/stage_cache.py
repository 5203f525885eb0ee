"""The cached stages of a run: what computes them, where they are kept, how long they took, who hears of them.

A stage's key is made of the scene's fields that it reads, the key of the stage before, the sources of the code that
computes it and the versions of outside programs; a change of anything else answers from what is there.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from ..core.code_key import code_key
from ..core.errors import SceneError
from ..core.files import atomic_write, read_json, write_json
from ..core.process import check_cancelled
from ..core.record import column
from ..core.store import MANIFEST, Store
from .stages import OWN, AirLabel, StageKey


# -- The run time that a stage took ------------------------------------------------------------------------------------
@dataclass(frozen=True)
class StageTime:
    """What a stage took when it was computed."""

    seconds: float = column("s", "run time of the stage, when it was computed; of all its passes together")
    cached: bool = column("", "whether it came from the cache now")


class StageTimes(dict[str, StageTime]):
    """What each stage of a run took; one that is made several times, for other airs, counts with all of them."""

    def __init__(self) -> None:
        super().__init__()
        self._counted = set[tuple[str, str]]()
        self._lock = Lock()

    def __reduce__(self) -> tuple[type, tuple[object]]:
        """A copy and another process get what was counted: a lock is of one process."""
        return dict, (dict(self),)

    def note(self, stage: str, key: str, seconds: float, *, cached: bool) -> None:
        """Count what a ``stage`` with a ``key`` took, once: two threads may ask for it."""
        with self._lock:
            known = self.get(stage, StageTime(0.0, True))
            more = 0.0 if (stage, key) in self._counted else seconds
            self[stage] = StageTime(known.seconds + more, known.cached and cached)
            self._counted.add((stage, key))


# -- The cached stages of a run ----------------------------------------------------------------------------------------
SECONDS = "seconds.json"  # in a stage's folder: what it took
Listener = Callable[[str, str], None]  # (stage, text): hears of progress


def null_listener(stage: str, text: str) -> None:
    """The listener that hears nothing."""


def thread_safe(listener: Listener) -> Listener:
    """The listener for several threads: it is called by one at a time."""
    lock = Lock()

    def tell(stage: str, text: str) -> None:
        with lock:
            listener(stage, text)

    return tell


def code_of(*modules: str) -> str:
    """sha256 (hex) of all sources that compute a stage: of these ``modules`` of the package, and what they import."""
    return code_key(*(f"{__name__.partition('.')[0]}.{module}" for module in modules))


def version_of(package: str) -> str:
    """The version of an installed Python package."""
    from importlib.metadata import version

    return version(package)


@dataclass(frozen=True)
class StageCache:
    """The stages of one airflow of a run; ``seconds`` is shared by all airflows of the run.

    ``label`` tells the stages of another airflow of the same scene apart in ``seconds`` and to the listener.
    """

    store: Store
    listener: Listener
    seconds: StageTimes
    label: AirLabel = OWN

    def tell(self, stage: str, text: str) -> None:
        """Let the listener hear of a stage; ends here where what runs beside has failed."""
        check_cancelled()
        self.listener(StageKey(self.label, stage), text)

    def make(self, stage: str, key: str, work: Callable[[Path], Any], begun: Sequence[Path] = ()) -> Path:
        """The folder of a stage, from the cache or by ``work(folder)``; the seconds it took to compute are noted. It
        goes on from the files, and the seconds, of finished stages that have ``begun`` it.
        """

        def timed(part: Path) -> None:
            for path in sorted(file for folder in begun for file in folder.iterdir()):
                if path.name != MANIFEST and not (part / path.name).exists():
                    with atomic_write(part / path.name, "wb") as stream:
                        stream.write(path.read_bytes())
            spent, started = part / SECONDS, time.monotonic()
            before = _spent_before(spent)
            try:
                work(part)
            finally:  # an interrupted stage goes on later; its time counts
                write_json(spent, before + time.monotonic() - started)

        folder, cached = self.store.make(
            stage, key, timed, on_wait=lambda: self.tell(stage, "being computed beside this; waiting for it")
        )
        seconds = json.loads((folder / SECONDS).read_text())
        counted = sum(_spent_before(folder / SECONDS) for folder in begun)
        self.seconds.note(StageKey(self.label, stage), key, seconds - counted, cached=cached)
        self.tell(stage, f"done ({'from the cache' if cached else f'{seconds:.1f} s'})")
        return folder


def _spent_before(noted: Path) -> float:
    """What an interrupted stage took so far (s); 0 where nobody noted it, or a damaged disk did."""
    try:
        spent = read_json(noted)
    except (OSError, SceneError):
        return 0.0
    return float(spent) if isinstance(spent, int | float) and 0.0 <= spent <= sys.float_info.max else 0.0
