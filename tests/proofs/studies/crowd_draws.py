"""How far the unknown numbers of a scene move the shares of granules that meet, next to those of granules alone.

An answer's draws fly alone, and what they move is taken for what they would move among granules that meet. Here the
slab flies under some of the draws, each in air of its own while there are such. The slope is that of the slab's changes
of all bin shares over those of granules alone: 1 where the assumption holds. Changes alone are of two halves of the
granules, one the other's instrument, so that their sampling does not lower the slope; its interval is a jackknife's
over the draws. *Taken* is the factor that an answer takes for it, from how many granules land near the ends of bins
among others and alone (src/wakeflow/budget/comparison.py). Ten minutes a scene; docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import wakeflow as wf
from support import shipped
from wakeflow.budget.comparison import AmongOthers
from wakeflow.core.number import student
from wakeflow.planning.plan import DRAWS, SAME_AIR

from .common import COARSE, HOUR, MEET, Row, piped, show

SCENES = ("rhombus", "labyrinth", "vacuum")
ALONE = 4  # replicates that fly alone under a draw, two in each half
COLUMNS = {
    "scene": "{scene}", "kg/h": "{rate:g}", "fraction": "{fraction}", "moved alone, points": "{alone:.1f}",
    "moved among others": "{meet:.1f}", "slope": "{slope:.2f} ± {half:.2f}", "taken": "{taken}",
}  # fmt: skip
Array = NDArray[np.float64]


class Moved(NamedTuple):
    """Changes (draws, bins + 1) of one fraction's shares: among granules that ``meet``, and alone in two halves."""

    meet: Array
    first: Array
    second: Array

    @property
    def alone(self) -> Array:
        """The mean over both halves."""
        return np.asarray(0.5 * (self.first + self.second))


def moved(scene: wf.Scene, draws: Sequence[int]) -> Iterator[tuple[str, Moved, float]]:
    """What the numbered ``draws`` change of each fraction's shares, and the factor that is taken for it."""
    pipeline = piped(scene, force=MEET)
    crowd, tracked, stage, bins = pipeline.crowd(), pipeline.tracks(), pipeline.draw_stage, len(scene.bin)
    meet: dict[str, list[Array]] = {name: [] for name in scene.fraction}
    alone: dict[str, list[Array]] = {name: [] for name in scene.fraction}
    for number in draws:
        drawn, made = pipeline.crowd_drawn(number), stage.variation(number)
        airs = stage.air(made.air)
        flown = [stage.fly_under(made, airs, tracked, replicate, slice(None)) for replicate in range(ALONE)]
        for name in scene.fraction:
            one, other = (landings[name].counts(bins).mean(axis=0) for landings in (drawn, crowd.landings))
            meet[name].append(one - other)
            alone[name].append(np.array([_change(part, name, bins) for part in flown]))
    among = AmongOthers(scene, tracked.landings, crowd.landings)
    for name in scene.fraction:
        each = np.array(alone[name])
        halves = each[:, ::2].mean(axis=1), each[:, 1::2].mean(axis=1)
        yield name, Moved(np.array(meet[name]), *halves), among.factor(name)


def chosen_draws(count: int) -> list[int]:
    """Numbers of ``count`` draws at random, each in an air of its own while there are such; every so many of Sobol's
    points would lie on one side of some unknowns.
    """
    chance = np.random.default_rng(0)
    first = SAME_AIR * chance.permutation(DRAWS // SAME_AIR) + chance.integers(SAME_AIR, size=DRAWS // SAME_AIR)
    return [*first.tolist(), *sorted(set(range(DRAWS)) - set(first.tolist()))][:count]


def _change(part: dict[str, NDArray[Any]], name: str, bins: int) -> Array:
    shares = [np.bincount(part[f"{which}.{name}"], minlength=bins + 1) for which in ("varied", "own")]
    return np.asarray((shares[0] - shares[1]) / len(part[f"own.{name}"]))


def slope(rows: Sequence[Moved]) -> float:
    """Of the changes among granules that meet, over those of granules alone; NaN where these change nothing."""
    above = below = 0.0
    for row in rows:
        meet, first, second = (part - part.mean(axis=0) for part in row)
        above += float(np.sum(meet * (first + second)) / 2.0)
        below += float(np.sum(first * second))
    return above / below if below else float("nan")


def with_interval(rows: Sequence[Moved]) -> tuple[float, float]:
    """The slope and half of its 95 % interval."""
    draws = len(rows[0].meet)
    left = np.array([
        slope([Moved(*(np.delete(part, draw, axis=0) for part in row)) for row in rows]) for draw in range(draws)
    ])  # fmt: skip
    spread = np.sqrt((draws - 1) / draws * np.sum((left - left.mean()) ** 2))
    return slope(rows), float(student(draws - 1) * spread)


def _rms(changes: Sequence[Array]) -> float:
    """Of changes about their mean over the draws, in points."""
    about = np.concatenate([(change - change.mean(axis=0)).ravel() for change in changes])
    return float(100.0 * np.sqrt(np.mean(about**2)))


def rows(which: str, draws: int, count: int, rate: float | None) -> Iterator[Row]:
    """A row for every fraction of a scene, and one for all."""
    fed = {} if rate is None else {"feed.rate": rate / HOUR}
    scene = shipped(which, {"feed.count": count, **COARSE[which], **fed})
    found = list(moved(scene, chosen_draws(draws)))
    parts = [(name, [row], f"{taken:.2f}") for name, row, taken in found]
    for name, some, taken in (*parts, ("all", [row for _, row, _ in found], "")):
        value, half = with_interval(some)
        yield {
            "scene": which, "rate": HOUR * (scene.feed.rate or 0.0), "fraction": name, "taken": taken, "slope": value,
            "half": half, "alone": _rms([row.alone for row in some]), "meet": _rms([row.meet for row in some]),
        }  # fmt: skip


def main(*scenes: str, draws: int = 32, count: int = 1024, rate: float | None = None) -> list[Row]:
    """Draws among granules that meet, at the scenes' own feed rate or at another (kg/h): rhombus, labyrinth, vacuum."""
    return show(COLUMNS, (row for which in scenes or SCENES for row in rows(which, draws, count, rate)))
