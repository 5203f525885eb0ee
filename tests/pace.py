"""How long answers take on two idle cores: quick ones, those within a budget, and whole ones; and whether these agree.

    python tests/pace.py                               wakeflow run --quick of every shipped scene
    python tests/pace.py rhombus --budget '1 min'      wakeflow run --budget of some
    python tests/pace.py rhombus --own                 the scene's own settings; again with its airflows in the cache
    python tests/pace.py rhombus --own --before HEAD~9 the same by the sources of another commit first
    python tests/pace.py --whole runs                  beside the whole answers in runs/SCENE, which wakeflow run left

Every run starts from an empty cache, with the tracker compiled. The machine may be busy: the time on two idle cores is
made of the processor time of every thread and program of the run, read four times a second. In each quarter of a second
it is that of the busiest thread, or half of all, whichever is longer; waiting for a disk does not count. (Linux)
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import wakeflow as wf
from support import CASES
from wakeflow.answer.result import Result
from wakeflow.runs import effort, one_run
from wakeflow.verify.scene_curves import forget_all_but_air, one_cache

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


def measured(name: str, how: Mapping[str, Any], out: Path, times: int) -> Iterator[tuple[Result, IdleClock]]:
    """A shipped scene computed as is said ``how``, from an empty cache, and at further ``times`` with its airflows in
    the cache.
    """
    with ExitStack() as stack:
        stack.enter_context(one_cache(Path(stack.enter_context(tempfile.TemporaryDirectory()))))
        stack.enter_context(patch.object(one_run, "learn", lambda *_: None))  # the pace of a busy machine
        for number in range(times):
            with IdleClock() as clock, patch.object(effort, "Within", partial(effort.Within, clock=clock)):
                result = wf.run(CASES / f"{name}.toml", out / f"{name}-{number}", listener=lambda *_: None, **how)
            yield result, clock
            forget_all_but_air()


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


def print_before(commit: str, arguments: Sequence[str]) -> None:
    """The same rows by the sources of another ``commit``, whose kernels are compiled first."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "before")
        subprocess.run(
            ["git", "worktree", "add", "--detach", place, commit], check=True, capture_output=True, cwd=CASES
        )
        env = {**os.environ, "PYTHONPATH": f"{place / 'src'}:{place / 'tests'}"}
        try:
            compiled = "from wakeflow.pipeline.compilation import compile_ahead; compile_ahead()"
            subprocess.run([sys.executable, "-c", compiled], check=True, env=env)
            print(f"{commit}:", flush=True)
            subprocess.run([sys.executable, "-P", __file__, *arguments], check=True, env=env)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", place], check=True, cwd=CASES)
    print("these sources:", flush=True)


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--budget", help="as of wakeflow run; without it: --quick")
    parser.add_argument("--own", action="store_true", help="with the scene's own settings")
    parser.add_argument("--whole", type=Path, help="folder of whole answers")
    parser.add_argument("--before", metavar="COMMIT", help="measured first, beside this one")
    asked = parser.parse_args()
    if asked.before:
        at = sys.argv.index("--before")
        print_before(asked.before, [*sys.argv[1:at], *sys.argv[at + 2 :]])
    print(f"| scene | processor s | s on {CORES} idle cores | granules, mesh | of the whole answer |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out:
        how = {} if asked.own else {"quick": True} if asked.budget is None else {"budget": asked.budget}
        for name in asked.scenes or SCENES:
            for result, clock in measured(name, how, Path(out), 1 + asked.own):
                scene = wf.Scene.parse(result.scene)
                settings = f"{scene.feed.count}, {scene.numerics.mesh_scale:g}"
                known = asked.whole is not None and (asked.whole / name / "result.json").exists()
                held = agreement(result, Result.load(asked.whole / name)) if known else "–"
                print(f"| {name} | {clock.spent:.0f} | {clock.now:.0f} | {settings} | {held} |")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
