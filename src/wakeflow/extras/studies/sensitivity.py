"""sensitivity(): which input moves which number by how much, by the draws of a run and by a sweep of its inputs.

The draws of a run cost nothing more, and know every number that the scene does not say exactly. They tell of shares,
and of recoveries and purities of targets, and know nothing of what the machine is built like. The sweep takes one input
after the other to both of its ends and flies again: every quantity, geometry, vibration, dividers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...answer.measurements import SWEPT, InputMove, Remaining, drawn_moves, grouped, least_sure, remaining
from ...answer.result import Result
from ...answer.result_table import differences_of
from ...answer.shares import InputSummary
from ...core import own_files
from ...core.errors import SceneError
from ...core.files import made_folder, path_of
from ...core.lazy import cached_property
from ...core.quantities import quantity, split_quantity
from ...core.registry import did_you_mean
from ...core.tables import CellTable
from ...many.axis import Axis, axes_of, axis_of_text
from ...many.compute import Sweep, sweep
from ...many.variant import Variant, variants
from ...planning.stage_cache import Listener
from ...runs import run
from ...scene import Scene
from ...scene.messages import unit_of
from ...scene.scene_tables import States

if TYPE_CHECKING:
    import distributed

    from ...planning.plan import Plan


COMMAND, TORNADO = "sensitivity", "tornado"
TABLE, FIGURE, FLOWN = "sensitivity.csv", "figures/sensitivity.png", "sensitivity"
COLUMNS = {  # heads of the table, and what each is of a move
    "quantity": "quantity", "value": "value", "input": "key", "input low": "low", "input high": "high",
    "unit of input": "unit", "change at low": "at_low", "change at high": "at_high", "error of change": "error",
    "unit": "measure", "index": "index", "error of index": "index_error", "how": "how",
}  # fmt: skip
PASSED_OVER = ("seconds", "without_collisions.")  # no numbers of the answer
EXPLAINED = 0.7  # of a share's variance, from which its inputs alone tell the whole


End = tuple[float, str]  # of an input: its value there, and the scene of the sweep


@dataclass(frozen=True)
class Sensitivity:
    """Which input moves which number of an answer by how much: a row for each in ``moves``, also in sensitivity.csv of
    ``folder``; the ``result`` that they are about; why scenes of the sweep ``failed``, by their names.
    """

    folder: Path
    result: Result
    moves: tuple[InputMove, ...]
    failed: Mapping[str, str]

    @cached_property
    def by_quantity(self) -> dict[str, list[InputMove]]:
        """The moves of each quantity, the largest first."""
        return grouped(self.moves)

    @property
    def main(self) -> list[str]:
        """Name of each fraction's recovery; without one that of the share that the inputs move most."""
        return least_sure(self.by_quantity)

    def of(self, quantities: Sequence[str]) -> dict[str, list[InputMove]]:
        """The moves of ``quantities``, by default :attr:`main`, without inputs that do nothing where others do.

        Raises SceneError for a name that is not in the table.
        """
        for name in quantities:
            if name not in self.by_quantity:
                raise SceneError(f"no quantity {name!r} in this table{did_you_mean(name, list(self.by_quantity))}")
        every = {name: self.by_quantity[name] for name in quantities or self.main}
        return {name: [move for move in moves if move.reach > 0.0] or moves for name, moves in every.items()}

    def unexplained(self, quantity: str) -> float | None:
        """The part of a share's variance that no input has alone, where that is much: inputs act together, or the share
        is bent over them. None where it is not, or where no draws tell.
        """
        indices = [move.index for move in self.by_quantity[quantity] if move.index is not None]
        return 1.0 - sum(indices) if indices and sum(indices) < EXPLAINED else None

    def remaining(self, known: Mapping[str, float | str] | None = None) -> dict[str, list[Remaining]]:
        """What measuring inputs would leave of the interval of each fraction's recovery, the largest first: each
        exactly, or, of ``known``, each to half of a 95 % interval (a number in SI units, or a text with its unit).

        Raises SceneError for a key that is no unknown of the run, or a half that is none.
        """
        landings, inputs = self.result.landings, {} if self.result.landings is None else self.result.landings.inputs
        halves = {key: _half(key, half, inputs) for key, half in (known or {}).items()}
        if landings is None:
            return {}
        names = [name for name in landings.separation.fractions if self.result.targets(name)]
        return {name: remaining(self.result, name, halves) for name in names}

    def frame(self) -> Any:
        """A row a move: a pandas DataFrame where pandas is installed, else a dict of numpy arrays, by column."""
        return CellTable.of(self.moves, COLUMNS).frame()

    def plot(self, quantities: Sequence[str] = (), path: Path | str | None = None) -> Path:
        """Draw the tornado of ``quantities``, by default :attr:`main`; returns the PNG, an SVG lies beside it.

        Raises SceneError for a name that no input moves.
        """
        from ...show.canvas import saved
        from ...show.figures.budget_figures import draw_tornado

        target = self.folder / FIGURE if path is None else Path(path)
        if path is not None:
            draw_tornado(target, self.of(quantities))
            return target
        own_files.claim(self.folder, saved(target), TORNADO)
        with own_files.writing(self.folder, lambda: saved(target), TORNADO):
            draw_tornado(target, self.of(quantities))
        return target


def sensitivity(
    scene: Scene | Result | Path | str,
    out: Path | str | None = None,
    *,
    over: Mapping[str, object] | Sequence[str] = (),
    rung: str | None = None,
    force: States | None = None,
    scheduler: str | distributed.Client | Executor | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
) -> Sensitivity:
    """Say which input of a scene, of a scene file or of a finished run (or its folder) moves which number.

    Every number that the scene does not say exactly is judged by the run's draws; the scene is run
    where it has not been. What is named in ``over`` goes to both of its ends, one at a time, and is flown again in the
    folder ``sensitivity`` below the results: KEY=LOW,HIGH, or KEY alone for the ends of its own 95 % interval; or a
    mapping of keys to values, or to {"from": ..., "to": ...}, as of :func:`wakeflow.variants`. Keys tied by = move
    together. ``out``, ``rung``, ``force``, ``listener`` and ``planned`` as of :func:`wakeflow.run`, ``scheduler`` and
    ``workers`` as of :func:`wakeflow.sweep`.

    Raises SceneError where nothing is unknown and nothing named, or a key is wrong.
    """
    if not isinstance(scene, Result) and not (isinstance(scene, Path | str) and Path(scene).is_dir()):
        _ends(_axes(over), Scene.of(scene))  # what is wrong with a key is said before anything is computed
    how = {"rung": rung, "force": force}
    result = _finished(scene, how, partial(run, out=out, workers=workers, listener=listener, planned=planned))
    folder = result.folder if out is None else path_of(out, "out")
    _claim(folder)
    moves, axes, failed = drawn_moves(result.landings), _axes(over, result), {}
    if axes:
        made_folder(folder)
        ends, pairs = _ends(axes, Scene.parse(result.scene))
        done = sweep(
            ends, folder / FLOWN, rung=result.options.rung, force=result.options.force, scheduler=scheduler,
            workers=workers, figures=False, listener=listener,
        )  # fmt: skip
        moves, failed = _joined(_swept_moves(pairs, done), moves), done.failed
    if not moves:
        raise SceneError(
            f"{result.folder}: no share depends on what is unknown; name what to change with --over KEY=LOW,HIGH, "
            "give [uncertainty], or run it anew and to its end"
        )
    answer = Sensitivity(folder, result, tuple(moves), failed)
    with own_files.writing(made_folder(folder), lambda: [folder / TABLE], COMMAND):
        CellTable.of(answer.moves, COLUMNS).write_csv(folder / TABLE)
    return answer


def _claim(folder: Path) -> None:
    """Raise SceneError where the table or its figure would replace what the program did not write."""
    from ...show.canvas import saved

    own_files.refuse_foreign(folder, [folder / TABLE], COMMAND)
    own_files.refuse_foreign(folder, saved(folder / FIGURE), TORNADO)


def _finished(scene: Scene | Result | Path | str, how: Mapping[str, object], run_it: Callable[..., Result]) -> Result:
    """The run that is asked about, computed where it has not been."""
    if not isinstance(scene, Result) and (isinstance(scene, Scene) or not Path(scene).is_dir()):
        return run_it(scene, **how)
    if any(how.values()):
        raise SceneError("a finished run has its rung and its terms; give its scene to change them")
    return scene if isinstance(scene, Result) else Result.load(scene)


def _axes(over: Mapping[str, object] | Sequence[str], result: Result | None = None) -> list[Axis]:
    """What is to be changed. A key without values goes to the ends of its own interval in the run, and is passed over
    before there is one.
    """
    alone = [] if isinstance(over, Mapping) else [text for text in over if "=" not in text]
    if isinstance(over, Mapping):
        axes = axes_of(over, "sensitivity")
    else:
        axes = [axis_of_text(text, "--over") for text in over if "=" in text]
    keys = [*(key for axis in axes for key in axis.keys), *alone]
    if twice := next((key for key in keys if keys.count(key) > 1), None):
        raise SceneError(f"--over {twice} is given twice; give its two ends once, as in --over {twice}=LOW,HIGH")
    if result is not None:
        axes += [_own_interval(key, result) for key in alone]
    if single := [axis.key for axis in axes if len(axis.values) < 2]:
        raise SceneError(f"{single[0]}: give its two ends, as in --over {single[0]}=LOW,HIGH")
    return axes


def _own_interval(key: str, result: Result) -> Axis:
    known = {} if result.landings is None else result.landings.inputs
    if key not in known:
        raise SceneError(
            f"--over {key}: no number of this run with an interval of its own; of any other key of the scene give its "
            f"ends, --over KEY=LOW,HIGH{did_you_mean(key, list(known))}"
        )
    return Axis(key, (known[key].low, known[key].high))


def _half(key: str, half: float | str, known: Mapping[str, InputSummary]) -> float:
    """Half of the interval (SI) to which an input is to be known."""
    if key not in known:
        raise SceneError(f"--known {key}: no number that this run draws{did_you_mean(key, list(known))}")
    try:
        plain = split_quantity(half) if isinstance(half, str) else (half, "")
        unit = known[key].unit
        value = plain[0] if plain and not plain[1] else quantity(str(half), unit, f"0.03 {unit}".removesuffix(" 1"))
    except ValueError as problem:
        raise SceneError(f"--known {key}={half}: {problem}") from None
    if not 0.0 <= value < math.inf:
        raise SceneError(f"--known {key}={half}: half of a 95 % interval is not negative")
    return value


def _ends(axes: Sequence[Axis], scene: Scene) -> tuple[list[Variant], dict[str, tuple[End, End]]]:
    """The scene as it is, then with each input at both of its ends; and which these are, by the input's key."""
    if not axes:
        return [], {}
    ends = {axis.key: [axis.values[0], axis.values[-1]] for axis in axes}
    made = variants(scene, ends, design="one-at-a-time")
    return made, {axis.key: _pair(axis, made[1 + 2 * i : 3 + 2 * i]) for i, axis in enumerate(axes)}


def _pair(axis: Axis, ends: Sequence[Variant]) -> tuple[End, End]:
    """The scenes in which an input lies at its lower and at its upper end. Raises SceneError where it is no number."""
    pair = []
    for variant in ends:
        value = variant.inputs.get(axis.keys[0])
        if variant.scene is None:
            raise SceneError(f"{axis.key}: {variant.problem}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SceneError(f"{axis.key} = {value!r}: a sensitivity is that of a number")
        pair.append((float(value), variant.name))
    return min(pair), max(pair)


def _swept_moves(pairs: Mapping[str, tuple[End, End]], done: Sweep) -> list[InputMove]:
    """What each input does to every number, from a sweep whose first scene is the one as it is."""
    base, changes = done.table.entries[0], differences_of(done.table.entries)
    if not base.quantities:
        raise SceneError(f"the scene as it is cannot be computed: {base.reason}")
    by_name = {(change.scene, change.quantity): change for change in changes}
    moves = []
    for key, ((low, at_low), (high, at_high)) in pairs.items():
        unit = unit_of(key.partition("=")[0].strip().removeprefix("-"))
        for number in base.quantities:
            there = [by_name.get((scene, number.name)) for scene in (at_low, at_high)]
            known = [change for change in there if change is not None]
            if number.name.startswith(PASSED_OVER) or not known:
                continue
            error = max(change.half for change in known) if all(change.known for change in known) else None
            change_low, change_high = (None if change is None else change.value for change in there)
            what = number.name, number.value, number.unit
            moves.append(InputMove(*what, key, low, high, unit, change_low, change_high, error, None, None, SWEPT))
    return moves


def _joined(swept: Sequence[InputMove], of_draws: Sequence[InputMove]) -> list[InputMove]:
    """What was swept, with the index that the draws gave it, and what was not."""
    drawn = {(move.quantity, move.key): move for move in of_draws}
    moves = []
    for move in swept:
        before = drawn.pop((move.quantity, move.key), None)
        moves.append(move if before is None else replace(move, index=before.index, index_error=before.index_error))
    return [*moves, *drawn.values()]
