"""What this machine makes of the seconds that a plan expects: learned from its own earlier runs, kept in the cache.

A plan's own seconds are those of two idle cores of 2020s hardware, so that a plan depends on its scene alone. Here they
are brought to the machine and its usual load: each finished run notes, by kind of work, how its stages' run times
compare with what was expected of them.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

from ...core.code_key import kernel_folder
from ...core.errors import SceneError
from ...core.files import kernel_root, read_json, write_json
from ...planning.cost import COMPILE, PROGRAM
from ...planning.plan import Plan
from ...planning.stages import OWN, StageCost, StageKey

Seconds = TypeVar("Seconds")
FILE = "machine-rates.json"  # by kind of work: (seconds, those expected), of the last runs
KEPT = 9  # runs that a rate is the median of, weighted by the seconds that were expected of each
STARTS = 20.0  # s added to both: a run of seconds tells how long programs take to start, not how fast they compute
MAX_SECONDS = 1e8  # three years: no stage took them
COMPILED = "compile-seconds.json"  # by kernel: seconds of its last compilation on this machine, of whatever version
# Kernels: the module of each, and the seconds that its compilation takes where none is known; measured on a core
KERNELS = {"tracker": ("wakeflow.flight.kernel.loop", 45.0), "slab": ("wakeflow.flight.collisions.slab", 27.0)}
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
            both.setdefault(stage.key.stage.work, []).append((spent[stage.name], stage.whole))
    if not both:
        return
    known = _runs(root)
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
    known = _runs(root)
    rates = {work: _rate(runs) for work, runs in known.items()}
    here = [replace(stage, seconds=stage.seconds * rates.get(stage.key.stage.work, 1.0)) for stage in plan.stages]
    if seconds := to_compile(slab=plan.collisions is not None):
        waits = any(stage.when == "answer" for stage in here)
        held = PROGRAM + sum(IN_CHILDREN[: len(seconds)]) if waits else COMPILING
        when, whole = ("beside", max(seconds.values())) if waits else ("first", sum(seconds.values()))
        here.insert(0, StageCost(StageKey(OWN, COMPILE.name), whole, when, memory=held))
    return tuple(here), max(map(len, known.values()), default=0)


def _rate(runs: Sequence[tuple[float, float]]) -> float:
    """Seconds over expected ones: long runs outweigh short ones, and one that the machine slept through counts once."""
    rates = sorted(((took + STARTS) / (meant + STARTS), meant) for took, meant in runs)
    below = list(accumulate(weight for _, weight in rates))
    return rates[bisect_left(below, 0.5 * below[-1])][0]


def to_compile(*, slab: bool = True) -> dict[str, float]:
    """The kernels of these sources that are not compiled yet on this machine, with the seconds that each will take."""
    taken = _compile_seconds()
    return {
        kernel: taken.get(kernel, usual)
        for kernel, (module, usual) in KERNELS.items()
        if (slab or kernel != "slab") and not any(kernel_folder(module).glob("**/*.nbi"))
    }


def note_compiled(kernel: str, seconds: float) -> None:
    """Keep how long the compilation of a ``kernel`` took: the next version's will take about as long."""
    write_json(kernel_root() / COMPILED, _compile_seconds() | {kernel: round(seconds, 1)})


def _compile_seconds() -> dict[str, float]:
    """Seconds of the compilations that are known."""
    known = _read(kernel_root() / COMPILED, lambda kept: {name: float(kept[name]) for name in KERNELS if name in kept})
    return {kernel: seconds for kernel, seconds in known.items() if 0.0 < seconds < MAX_SECONDS}


def _runs(root: Path) -> dict[str, list[tuple[float, float]]]:
    """Seconds of the last runs by kind of work, and those expected."""
    known = _read(root / FILE, lambda kept: {
        work: [(float(took), float(meant)) for took, meant in runs] for work, runs in kept.items() if runs
    })  # fmt: skip
    pairs = [pair for runs in known.values() for pair in runs]
    return known if all(0.0 <= seconds < MAX_SECONDS for pair in pairs for seconds in pair) else {}


def _read(file: Path, parse: Callable[[Any], dict[str, Seconds]]) -> dict[str, Seconds]:
    """What was noted in a file; nothing where there is none, and where it is not whole or of another version."""
    try:
        return parse(read_json(file))
    except (OSError, SceneError, TypeError, ValueError, AttributeError, OverflowError):
        return {}
