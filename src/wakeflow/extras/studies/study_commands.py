"""The commands of what many runs tell: sensitivity, map, capacity."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...cli.options import GATE, PACE, Folder, Gate, Pace, Processes, Quiet, Settings, Threads, scene_and_folder
from ...core.errors import SceneError
from ...core.quantities import say, speaking
from ...scene.overrides import setting
from ...show.screen import print_lines, print_table, screen_table

if TYPE_CHECKING:
    from rich.table import Table

    from ...answer.measurements import InputMove, Remaining
    from ...answer.result import Result
    from ...many.compute import Sweep
    from ...scene import Scene
    from .sensitivity import Sensitivity

MAX_INPUTS = 8  # told of a quantity; all are in the file
SOME_FAILED = 1  # exit code of a sweep with scenes that failed

BothEnds = Annotated[
    tuple[str, ...],
    Parameter(
        negative="",
        help="Fly the scene again with a key at both ends: air.speed='4 m/s,6 m/s', or the key alone for the ends of "
        "its own interval. Repeatable.",
    ),
]
Known = Annotated[
    tuple[str, ...],
    Parameter(
        negative="",
        help="Say what knowing an input to so much leaves of the recoveries' intervals, instead of each exactly: "
        "fraction.wheat.restitution=0.03, half of a 95 % interval. Repeatable.",
    ),
]
Shown = Annotated[
    tuple[str, ...], Parameter(negative="", help="Quantities to show: recovery.wheat, share.dust.middle. Repeatable.")
]


@Parameter(name="*")
@dataclass(frozen=True)
class Turned:
    """What a map and a curve over what an operator turns are asked with."""

    out: Folder = None
    settings: Settings = ()
    pace: Pace = PACE
    workers: Processes = None
    quiet: Quiet = False


TURNED = Turned()


def sensitivity(
    scene: Path,
    *,
    over: BothEnds = (),
    of: Shown = (),
    known: Known = (),
    out: Folder = None,
    settings: Settings = (),
    gate: Gate = GATE,
    workers: Annotated[Threads, Parameter(help="Threads of a run, processes of a sweep; default all cores.")] = None,
    quiet: Quiet = False,
) -> None:
    """Say which input of a scene moves which number by how much: a table, sensitivity.csv and a tornado plot.

    Every number that is not known exactly is drawn with all others, from the scene's interval or a default one; how
    the landings follow them tells what each does, and flies nothing more. What is named with --over, geometry and
    vibration too, is flown again at both ends, one at a time.

    Parameters
    ----------
    scene
        A scene file, run where it has not been, or the folder of a finished run.
    """
    from ...runs.progress import live
    from .sensitivity import sensitivity as find

    subject: Scene | Path = scene
    if not scene.is_dir():
        subject, out = scene_and_folder(scene, settings, gate, out)
    elif settings:
        raise SceneError("a finished run has its numbers; give its scene file to change them with --set")
    with live(enabled=not quiet) as listener:
        result = find(subject, out, over=over, workers=workers, listener=listener, planned=listener.planned, **gate.how)
    figure, left = result.plot(of), result.remaining(dict(setting(pair, "--known", "KEY=HALF") for pair in known))
    if not quiet:
        show_moves(result, of)
        show_remaining(result.result, left)
        print(f"{figure}\n{result.folder / 'sensitivity.csv'}")


def show_moves(result: Sensitivity, quantities: Sequence[str] = ()) -> None:
    """Print what each input alone does to ``quantities``, by default to each fraction's share that is moved most, and
    the part that it has of the variance; what failed, and where the draws do not tell enough.
    """
    from rich.console import Console

    console, shown = Console(), result.of(quantities)
    for name, moves in shown.items():
        sure = [move for move in moves if move.error is None or move.error < move.reach]
        if sure:
            console.print(_moves_table(name, sure[:MAX_INPUTS]))
        if rest := len(moves) - len(sure):
            which = f"{rest} other input{'s' if rest > 1 else ''}" if sure else "any input"
            console.print(f"{name}: what {which} may change is within its own error", soft_wrap=True)
    lines = [f"! {name}: {reason}" for name, reason in result.failed.items()]
    lines += [_advice(name, left, shown[name]) for name in shown if (left := result.unexplained(name)) is not None]
    print_lines(lines)


def show_remaining(result: Result, left: Mapping[str, Sequence[Remaining]]) -> None:
    """Print what measuring inputs would leave of the interval of each recovery."""
    from ...show.words import percent

    for name, rows in left.items():
        now = f"recovery.{name}, {percent(result.recovery(name))} %"
        title = f"{now}; half of its 95 % interval, points, with inputs known better"
        heads = ("input", "now ±", "known to ±", "alone", "with those above")
        if rows:
            print_table(heads, map(_left, rows[:MAX_INPUTS]), title)


def _left(left: Remaining) -> list[str]:
    from ...show.plan_words import UNITS

    with speaking(UNITS):
        halves = [say(half, left.unit or "1", 2) for half in (left.now, left.measured)]
    return [left.key, *halves, *(f"{100 * half:.1f}" for half in (left.alone, left.together))]


def _moves_table(name: str, moves: Sequence[InputMove]) -> Table:
    first = moves[0]
    title = f"{name}, {_number(first, first.value)} {'%' if first.is_part else first.measure}; changes"
    title += f" in {'percentage points' if first.is_part else first.measure}"
    return screen_table(("input", "from", "to", "at from", "at to", "±", "part"), map(_row, moves), title)


def _row(move: InputMove) -> list[str]:
    from ...show.plan_words import UNITS
    from ...show.words import NO_VALUE

    with speaking(UNITS):
        ends = [say(end, move.unit or "1", 3) for end in (move.low, move.high)]
    changes = (
        NO_VALUE if change is None else f"{_number(move, change):+.2g}" for change in (move.at_low, move.at_high)
    )
    error = NO_VALUE if move.error is None else f"{_number(move, move.error):.2g}"
    index = NO_VALUE if move.index is None else f"{100 * move.index:.0f} %"
    return [move.key, *ends, *changes, error, index]


def _number(move: InputMove, number: float) -> float:
    return float(f"{(100.0 if move.is_part else 1.0) * number:.3g}")


def _advice(name: str, left: float, moves: Sequence[InputMove]) -> str:
    """How to know more of a share of which what each input does alone explains too little."""
    keys = " ".join(f"--over {move.key}" for move in moves[:2])
    part = f"{100 * left:.0f} % of its uncertainty (of the variance)"
    return f"{name}: {part} is no single input's; runs at both ends of the largest tell more: {keys}"


def map_(
    scene: Path,
    *,
    air: Annotated[
        str | None, Parameter(help="Air speeds: '3:7:5 m/s' or 4,5,6; of a fan its speed_ratio; default 0.8 to 1.2.")
    ] = None,
    feed: Annotated[str | None, Parameter(help="Feed rates: '200:800:4 kg/hour'; default likewise.")] = None,
    options: Turned = TURNED,
) -> int:
    """Draw recovery, purity, loss and dirt of every target over air speed and feed rate, with their intervals.

    Each air speed's airflow is solved once, and kept for the next map and the next run. --quick computes coarsely.

    Parameters
    ----------
    scene
        A scene file with an air.speed, a feed.rate and targets.
    """
    from .operating import operating_map

    return _operated(partial(operating_map, air=_values("air.speed", air)), "map", scene, feed, options)


def capacity(
    scene: Path,
    *,
    feed: Annotated[
        str | None, Parameter(help="Feed rates: '200:800:4 kg/hour'; default a quarter to twice its own.")
    ] = None,
    options: Turned = TURNED,
) -> int:
    """Draw the capacity curve: what is lost of every fraction and what dirt is left over the feed rate, with intervals.

    With prices also what it earns. The airflow is solved once, and kept. --quick computes coarsely.

    Parameters
    ----------
    scene
        A scene file with a feed.rate and targets.
    """
    from .operating import capacity as curve

    return _operated(curve, "capacity", scene, feed, options)


def _operated(
    made: Callable[..., tuple[Sweep, Path]], name: str, scene: Path, feed: str | None, options: Turned
) -> int:
    """A map or a curve of a scene over what an operator turns, drawn and printed."""
    from ...runs.progress import live
    from ...runs.time_budget import quick_settings
    from ...show.terminal import show_sweep
    from .operating import counted_lines, met_at, met_lines, met_up_to

    machine, folder = scene_and_folder(scene, options.settings, options.pace, None)
    how = options.pace.how
    if options.pace.quick:
        machine, how = quick_settings(machine, how)
    rates, target = _values("feed.rate", feed), options.out or folder.with_name(f"{folder.name}+{name}")
    with live(enabled=not options.quiet) as listener:
        sweep, figure = made(machine, target, feed=rates, workers=options.workers, listener=listener, **how)
    if not options.quiet:
        show_sweep(sweep.table, sweep.folder)
        limits = machine.limit.by_name
        if name == "capacity":
            print_lines(met_lines(met_up_to(sweep.table, limits), limits))
        else:
            print_lines(counted_lines(met_at(sweep.table, limits), limits))
        print(figure)
    return SOME_FAILED if sweep.failed else 0


def _values(key: str, text: str | None) -> Sequence[object]:
    from ...many.axis import axis_of_text

    return () if text is None else axis_of_text(f"{key}={text}").values
