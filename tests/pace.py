"""How long answers take on idle cores: quick ones, those within a budget, and whole ones; and whether these agree.

    python tests/pace.py                               wakeflow run --quick of every shipped scene
    python tests/pace.py rhombus --budget '1 min'      wakeflow run --budget of some
    python tests/pace.py rhombus --own                 the scene's own settings; again with its airflows in the cache
    python tests/pace.py rhombus --own --before HEAD~9 the same by the sources of another commit first
    python tests/pace.py rhombus --feeds 8             a scene of a sweep over feeds, its airflow in the cache
    python tests/pace.py --whole runs                  beside the whole answers in runs/SCENE, which wakeflow run left

Every run starts from an empty cache, with the tracker compiled. The machine may be busy: the time on idle cores is
that of tests/proofs/idle_clock.py. (Linux)
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from proofs.idle_clock import IdleClock
from proofs.scene_curves import forget_all_but_air, one_cache, timed_run
from support import ALONE, CASES
from wakeflow.answer.result import Result
from wakeflow.core.process import cores

SCENES = ("vacuum", "aspirator", "prism", "rhombus", "wheat-straw-dust", "labyrinth", "funnel")
CHANCE = 2e-3  # of a share: what 256 granules cannot tell from nothing


def measured(name: str, how: Mapping[str, Any], out: Path, times: int) -> Iterator[tuple[Result, IdleClock]]:
    """A shipped scene computed as is said ``how``, from an empty cache, and at further ``times`` with its airflows in
    the cache.
    """
    with tempfile.TemporaryDirectory() as cache, one_cache(Path(cache)):
        for number in range(times):
            yield timed_run(wf.Scene.load(CASES / f"{name}.toml"), out / f"{name}-{number}", **how)
            forget_all_but_air()


def swept(name: str, feeds: int, out: Path) -> IdleClock:
    """A sweep over so many widths of a shipped scene's feed on one airflow: without force on the air and collisions."""
    scene = wf.Scene.load(CASES / f"{name}.toml")
    widths = np.linspace(0.8, 1.2, feeds) * scene.feed.width
    with tempfile.TemporaryDirectory() as folder, one_cache(Path(folder)):
        wf.run(scene, out / "first", until="airflow", force=ALONE, listener=lambda *_: None)
        with IdleClock(cores()) as clock:
            scenes = [scene.replace({"feed.width": float(width)}) for width in widths]
            wf.sweep(scenes, out / "swept", force=ALONE, figures=False, listener=lambda *_: None)
    return clock


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
    """The same rows by another ``commit``, whose kernels are compiled first."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "before")
        subprocess.run(
            ["git", "worktree", "add", "--detach", place, commit], check=True, capture_output=True, cwd=CASES
        )
        env = {**os.environ, "PYTHONPATH": f"{place / 'src'}:{place / 'tests'}"}
        try:
            compiled = "from wakeflow.flight.stages.compilation import compile_ahead; compile_ahead()"
            subprocess.run([sys.executable, "-c", compiled], check=True, env=env)
            print(f"{commit}:", flush=True)
            subprocess.run([sys.executable, place / "tests" / "pace.py", *arguments], check=True, env=env)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", place], check=True, cwd=CASES)
    print("these sources:", flush=True)


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--budget", help="as of wakeflow run; without it: --quick")
    parser.add_argument("--own", action="store_true", help="with the scene's own settings")
    parser.add_argument("--feeds", type=int, metavar="N", help="of a sweep: seconds a scene")
    parser.add_argument("--whole", type=Path, help="folder of whole answers")
    parser.add_argument("--before", metavar="COMMIT", help="measured first, beside this one")
    asked = parser.parse_args()
    if asked.before:
        at = sys.argv.index("--before")
        print_before(asked.before, [*sys.argv[1:at], *sys.argv[at + 2 :]])
    print(f"| scene | processor s | s on {cores()} idle cores | granules, mesh | of the whole answer |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out:
        how = {} if asked.own else {"quick": True} if asked.budget is None else {"budget": asked.budget}
        for name in asked.scenes or SCENES:
            if asked.feeds:
                clock = swept(name, asked.feeds, Path(out))
                print(f"| {name} | {clock.spent / asked.feeds:.1f} | {clock.now / asked.feeds:.1f} | – | – |")
                continue
            for result, clock in measured(name, how, Path(out), 1 + asked.own):
                scene = wf.Scene.parse(result.scene)
                settings = f"{scene.feed.count}, {scene.numerics.mesh_scale:g}"
                known = asked.whole is not None and (asked.whole / name / "result.json").exists()
                held = agreement(result, Result.load(asked.whole / name)) if known else "–"
                print(f"| {name} | {clock.spent:.0f} | {clock.now:.0f} | {settings} | {held} |")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
