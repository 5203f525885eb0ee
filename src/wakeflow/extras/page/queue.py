"""The runs that a page has asked for: one after the other, each in a process of its own, stopped and gone on with."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...core.errors import ProgramError, SceneError
from ...core.process import run_program

RUN = "run"  # the kind of task that computes the scene once
WAITS, GOES, DONE, STOPPED, FAILED = "waits", "is computed", "done", "stopped", "failed"


class _Stop(Exception):
    """A person asked for the end of the run that is computed."""


@dataclass
class Run:
    """A run that was asked for, and how far it is; ``text``: its scene as it was then."""

    number: int
    name: str
    folder: Path
    text: str
    base: Path
    scene: str  # name of its file, without the suffix
    changes: Mapping[str, object] = field(default_factory=dict)
    options: Mapping[str, object] = field(default_factory=dict)
    kind: str = RUN
    typed: str = ""  # for another kind of task
    files: Path = field(default_factory=Path)  # where the files are that it names
    measured: Mapping[str, object] = field(default_factory=dict)  # shares to calibrate with: columns by name
    state: str = WAITS
    told: str = ""
    progress: Mapping[str, Any] = field(default_factory=dict)

    def table(self) -> dict[str, object]:
        """Table of the run for the page."""
        return {
            **self.progress, "number": self.number, "name": self.name, "folder": self.folder.name, "kind": self.kind,
            "state": self.state, "told": self.told,
        }  # fmt: skip


class RunQueue:
    """Computes runs in a thread of its own; ``changed`` is called, there, whenever anything is new."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self.runs: list[Run] = []
        self._changed = changed
        self._wake = threading.Condition()
        self._stop: set[int] = set()
        self._over = False
        self._thread = threading.Thread(target=self._work, name="runs", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a run is computed or waits."""
        return any(run.state in (WAITS, GOES) for run in self.runs)

    def add(self, **how: Any) -> Run:
        """Put a run at the end. Raises SceneError where one that is not over writes to the same folder."""
        with self._wake:
            folder = how["folder"]
            if any(run.folder == folder and run.state in (WAITS, GOES) for run in self.runs):
                raise SceneError(f"a run into {folder} is on its way; choose another name")
            self.runs = [run for run in self.runs if run.folder != folder]
            made = Run(1 + max((run.number for run in self.runs), default=0), **how)
            self.runs.append(made)
            self._wake.notify_all()
        self._changed()
        return made

    def stop(self, number: int) -> None:
        """End a run; what is finished is kept, and it goes on from there."""
        with self._wake:
            run = self._find(number)
            if run.state == WAITS:
                run.state = STOPPED
            elif run.state == GOES:
                self._stop.add(number)
        self._changed()

    def go_on(self, number: int) -> None:
        """Compute a run that was stopped, or has failed, from where it ended."""
        with self._wake:
            run = self._find(number)
            if run.state in (STOPPED, FAILED):
                run.state, run.told, run.progress = WAITS, "", {}
                self._wake.notify_all()
        self._changed()

    def drop(self, number: int) -> None:
        """Take a run that is not computed off the list; what it has left stays."""
        with self._wake:
            run = self._find(number)
            if run.state == GOES:
                raise SceneError(f"{run.name} is computed; stop it first")
            self.runs.remove(run)
        self._changed()

    def close(self) -> None:
        """End what is computed, and the thread."""
        with self._wake:
            self._over = True
            self._stop |= {run.number for run in self.runs if run.state == GOES}
            self._wake.notify_all()
        self._thread.join()

    def _find(self, number: int) -> Run:
        match = next((run for run in self.runs if run.number == number), None)
        if match is None:
            raise SceneError(f"no run {number} in the list")
        return match

    def _waiting(self) -> Iterator[Run]:
        """Yield each run that waits, as soon as there is one, until the end of the thread."""
        while not self._over:
            with self._wake:
                self._wake.wait_for(lambda: self._over or any(run.state == WAITS for run in self.runs))
                ready = [] if self._over else [run for run in self.runs if run.state == WAITS][:1]
                for run in ready:
                    run.state = GOES
            yield from ready

    def _work(self) -> None:
        for run in self._waiting():
            self._changed()
            try:
                state, outcome = self._compute(run)
            except (OSError, ValueError) as problem:  # as of a full /tmp: the next run may go better
                state, outcome = FAILED, str(problem)
            with self._wake:
                self._stop.discard(run.number)
                run.state, run.told = state, outcome
            self._changed()

    def _compute(self, run: Run) -> tuple[str, str]:
        """How a run ended, and what there is to say of it."""
        last: dict[str, Any] = {}

        def hear(line: str) -> None:
            self._check(run)
            if line.startswith("{"):
                last.clear()
                last.update(json.loads(line))
                if "stage" in last:
                    run.progress = dict(last)
                    self._changed()

        with TemporaryDirectory(prefix="wakeflow-") as place:
            ask, log = Path(place, "ask.json"), Path(place, "log")
            request = {"text": run.text, "name": run.scene, "base": str(run.base.absolute()), "changes": run.changes,
                     "options": run.options, "folder": str(run.folder), "measured": run.measured, "kind": run.kind,
                     "typed": run.typed, "files": str(run.files.absolute())}  # fmt: skip
            ask.write_text(json.dumps(request))
            command = [sys.executable, "-P", "-m", "wakeflow.extras.page.job", str(ask)]
            try:
                run_program(command, cwd=Path.cwd(), log=log, on_line=hear, on_idle=lambda _: self._check(run))
            except _Stop:
                return STOPPED, "what is finished is kept; it goes on from there"
            except ProgramError as problem:
                return FAILED, str(last.get("failed") or problem.tail.strip().rpartition("\n")[2] or problem)
        return DONE, str(last.get("done", ""))

    def _check(self, run: Run) -> None:
        if run.number in self._stop:
            raise _Stop
