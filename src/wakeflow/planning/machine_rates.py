"""What this machine makes of the seconds that a plan expects: learned from its own earlier runs, kept in the cache.

A plan's own seconds are those of two idle cores of 2020s hardware, so that a plan depends on its scene alone. Here they
are brought to the machine and its usual load: each finished run notes, by kind of work, how its stages' run times
compare with what was expected of them.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

from ..core.errors import SceneError
from ..core.files import read_json, write_json
from ..core.sources import kernel_folder
from .cost import COMPILE, PROGRAM
from .plan import Plan
from .stages import OWN, StageCost, StageKey

FILE = "machine-rates.json"  # by kind of work: (seconds, those expected), of the last runs
KEPT = 9  # runs that a rate is the median of, weighted by the seconds that were expected of each
STARTS = 20.0  # s added to both: a run of seconds tells how long programs take to start, not how fast they compute
MAX_SECONDS = 1e8  # three years: no stage took them
COMPILED = 45.0  # s: the tracker's compilation
COMPILING = 7.8e8  # bytes: a run that compiles in its own process, one kernel after the other
# Bytes of the other processes that compile the tracker and the slab's kernel while OpenFOAM runs
IN_CHILDREN = 6.7e8, 5.5e8


def learn(root: Path, expected: Sequence[StageCost], spent: Mapping[str, float]) -> None:
    """Note in the cache's ``root`` how the run times ``spent`` (s, by stage, those that were computed now) compare with
    the ``expected`` ones. Two runs that end at once may lose one's note.
    """
    both: dict[str, list[tuple[float, float]]] = {}
    for stage in expected:
        if stage.name in spent:
            both.setdefault(stage.key.stage.work, []).append((spent[stage.name], stage.seconds))
    if not both:
        return
    known = _read(root)
    for work, pairs in both.items():
        took, meant = (round(sum(column), 2) for column in zip(*pairs, strict=True))
        known[work] = [*known.get(work, []), (took, meant)][-KEPT:]
    root.mkdir(parents=True, exist_ok=True)
    write_json(root / FILE, known)


def on_this_machine(plan: Plan, root: Path) -> tuple[tuple[StageCost, ...], int]:
    """The stages of a plan with the seconds that this machine needs, as its runs in the cache's ``root`` say, and of
    how many runs the best known kind of work was learned; a kind that none has done keeps its seconds.

    The tracker's compilation is one of them where it is still to be done, at the same time as the airflow where there
    is one.
    """
    known = _read(root)
    rates = {work: _rate(runs) for work, runs in known.items()}
    here = [replace(one, seconds=one.seconds * rates.get(one.key.stage.work, 1.0)) for one in plan.stages]
    if not is_compiled():
        waits = any(one.when == "answer" for one in here)
        held = PROGRAM + sum(IN_CHILDREN[: 1 if plan.crowd is None else 2]) if waits else COMPILING
        when = "beside" if waits else "first"
        here.insert(0, StageCost(StageKey(OWN, COMPILE.name), COMPILED, when, memory=held))
    return tuple(here), max(map(len, known.values()), default=0)


def _rate(runs: Sequence[tuple[float, float]]) -> float:
    """Seconds over expected ones: long runs outweigh short ones, and one that the machine slept through counts once."""
    rates = sorted(((took + STARTS) / (meant + STARTS), meant) for took, meant in runs)
    below = list(accumulate(weight for _, weight in rates))
    return rates[bisect_left(below, 0.5 * below[-1])][0]


def is_compiled() -> bool:
    """Whether the tracker of these sources has been compiled on this machine."""
    return any(kernel_folder("wakeflow.tracking.kernel.loop").glob("**/*.nbi"))


def _read(root: Path) -> dict[str, list[tuple[float, float]]]:
    """What is known; nothing where no run has noted any, and where the file is not whole or of another version."""
    try:
        found = read_json(root / FILE)
        known = {work: [(float(took), float(meant)) for took, meant in runs] for work, runs in found.items() if runs}
    except (OSError, SceneError, TypeError, ValueError, AttributeError, OverflowError):
        return {}
    pairs = [pair for runs in known.values() for pair in runs]
    return known if all(0.0 <= seconds < MAX_SECONDS for pair in pairs for seconds in pair) else {}
