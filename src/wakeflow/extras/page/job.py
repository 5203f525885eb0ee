"""The process of one run that a page asked for: computes, and prints how far it is as lines of JSON."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import WakeflowError
from ...core.files import toml_of
from ...runs import run
from ...runs.progress import DONE, ProgressListener
from ...runs.time_budget import quick_settings
from ...scene import Scene
from .queue import RUN
from .tasks import task_of

NARROWER = 0.9  # an interval that shrinks to that has learnt something
EVERY = 0.3  # s between lines of a stage


@dataclass
class _InJson(ProgressListener):
    """A line now and then: stage, text, at (its place), of, part (of the expected time), seconds_left."""

    reported: float = 0.0

    def tell(self, stage: str, text: str) -> None:
        now = time.monotonic()
        if text.startswith(DONE) or not self.progress.expected or now - self.reported >= EVERY:
            self.reported, progress = now, self.progress
            say(
                stage=stage, text=text, at=progress.number, of=len(progress.expected), part=progress.part,
                seconds_left=progress.left,
            )  # fmt: skip


def say(**known: object) -> None:
    """Print a line."""
    print(json.dumps(known), flush=True)


def compute(ask: dict[str, Any]) -> int:
    """Run the scene of ``ask``: text, name and base of its file, changes, options of run, folder; with ``measured``
    shares calibrate it. Returns the exit code of the command line.
    """
    name = f"{ask['name']}.toml"
    try:
        scene = Scene.parse(toml_of(ask["text"], name), name, Path(ask["base"]))
        scene = scene.replace(ask["changes"]) if ask["changes"] else scene
        listener = _InJson()
        if ask.get("measured"):
            say(done=_calibrated(scene, ask, listener))
            return 0
        if ask.get("kind", RUN) != RUN:
            say(done=_done(scene, ask, listener))
            return 0
        result = run(scene, ask["folder"], listener=listener, planned=listener.planned, **ask["options"])
    except WakeflowError as problem:
        say(failed=str(problem))
        return problem.exit_code
    say(done=repr(result).partition(": ")[2].removesuffix(">"))
    return 0


def _done(scene: Scene, ask: dict[str, Any], listener: _InJson) -> str:
    """What another kind of task has found; of many scenes a first look takes the settings of a quick answer."""
    how: dict[str, Any] = {}
    if ask["options"].get("quick"):
        scene, how = quick_settings(scene, how)
    work = task_of(ask["kind"], scene, ask["typed"], Path(ask["files"]))
    return work(Path(ask["folder"]), {"listener": listener, **how})


def _calibrated(scene: Scene, ask: dict[str, Any], listener: _InJson) -> str:
    """What measured shares say of a finished run: whether they agree, and which numbers became narrower."""
    from ..trays.calibration import calibrate

    how = {"listener": listener, "planned": listener.planned, **ask["options"]}
    posterior = calibrate(scene, ask["measured"], ask["folder"], **how)
    narrower = [
        f"{key} {input_.value:.3g} ({input_.low:.3g} to {input_.high:.3g})"
        for key, input_ in posterior.inputs.items()
        if input_.narrower < NARROWER
    ]
    return f"{posterior.agreement.sentence} {'; '.join(narrower) or 'No number of the scene became narrower'}."


if __name__ == "__main__":
    sys.exit(compute(json.loads(Path(sys.argv[1]).read_text())))
