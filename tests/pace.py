"""How long quick answers and answers within a budget take on two idle cores, and whether the whole answer agrees.

    python tests/pace.py                               wakeflow run --quick of every shipped scene
    python tests/pace.py rhombus --budget '1 min'      wakeflow run --budget of some
    python tests/pace.py --whole runs                  beside the whole answers in runs/SCENE, which wakeflow run left

Every run starts from an empty cache, with the tracker compiled. The machine may be busy: the time on two idle cores is
made of the processor time of every thread and program of the run, read four times a second. In each quarter of a second
it is that of the busiest thread, or half of all, whichever is longer; waiting for a disk does not count. (Linux)
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from unittest.mock import patch

import wakeflow as wf
from support import CASES
from wakeflow.answer.result import Result
from wakeflow.runs import effort, one_run

SCENES = ("vacuum", "aspirator", "prism", "rhombus", "wheat-straw-dust", "labyrinth", "funnel")
TICK = 0.25  # s
CORES = 2
CHANCE = 2e-3  # of a share: what 256 granules cannot tell from nothing


class IdleClock:
    """Seconds that this process and its children would have taken so far on CORES idle cores; also all their
    processor seconds, ``spent``.
    """

    def __init__(self) -> None:
        self.now, self.spent, self._seen = 0.0, 0.0, dict[str, float]()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True)

    def __enter__(self) -> IdleClock:
        self._seen = _processor_seconds()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def __call__(self) -> float:
        return self.now

    def _follow(self) -> None:
        while not self._ended.wait(TICK):
            now = _processor_seconds()
            took = [seconds - self._seen.get(task, 0.0) for task, seconds in now.items()]
            self.spent += sum(took)
            self.now += max(max(took), sum(took) / CORES)
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


def measured(name: str, budget: str | None, out: Path) -> tuple[Result, IdleClock]:
    """A shipped scene computed quickly, or within a ``budget``, from an empty cache."""
    with ExitStack() as stack:
        cache = stack.enter_context(tempfile.TemporaryDirectory())
        stack.enter_context(patch.dict(os.environ, {"WAKEFLOW_CACHE": cache}))
        stack.enter_context(patch.object(one_run, "learn", lambda *_: None))  # the pace of a busy machine
        clock = stack.enter_context(IdleClock())
        stack.enter_context(patch.object(effort, "Within", partial(effort.Within, clock=clock)))
        result = wf.run(
            CASES / f"{name}.toml", out / name, quick=budget is None, budget=budget, listener=lambda *_: None
        )
    return result, clock


def agreement(quick: Result, whole: Result) -> str:
    """How many bin shares of the whole answer lie in the quick intervals, and by how many points the others miss."""
    inside, misses = 0, []
    for fraction in whole.scene["fraction"]:
        for place in [*whole.scene["bin"], "elsewhere"]:
            value, (_, low, high) = whole.share(fraction, place)[0], quick.share(fraction, place)
            miss = max(low - value, value - high, 0.0)
            inside += miss <= CHANCE
            if miss > CHANCE:
                misses.append(f"{fraction}.{place} by {100.0 * miss:.1f}")
    return f"{inside} of {inside + len(misses)}" + (f" ({', '.join(misses)})" if misses else "")


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--budget", help="as of wakeflow run; without it: --quick")
    parser.add_argument("--whole", type=Path, help="folder of whole answers")
    asked = parser.parse_args()
    print(f"| scene | processor s | s on {CORES} idle cores | granules, mesh | of the whole answer |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out:
        for name in asked.scenes or SCENES:
            result, clock = measured(name, asked.budget, Path(out))
            scene = wf.Scene.parse(result.scene)
            settings = f"{scene.feed.count}, {scene.numerics.mesh_scale:g}"
            known = asked.whole is not None and (asked.whole / name / "result.json").exists()
            held = agreement(result, Result.load(asked.whole / name)) if known else "–"
            print(f"| {name} | {clock.spent:.0f} | {clock.now:.0f} | {settings} | {held} |")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
