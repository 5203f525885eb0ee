"""Print how far the unknown numbers of a scene move the shares of granules that meet, beside those of granules alone:

.venv/bin/python cases/studies/crowd_draws.py [SCENE ...] [--rate KG/H] [--draws N] [--count N]

Scenes: rhombus, labyrinth, vacuum. An answer's draws fly alone, and what they move is taken for what they would move
among granules that meet. Here the slab flies under some of the same draws, each in air of its own while there are such.
The slope is that of the slab's changes of all bin shares over those of granules alone: 1 where the assumption holds.
Changes alone are of two halves of the granules, one the other's instrument, so that their sampling does not lower the
slope; its interval is a jackknife's over the draws. Beside it the factor that an answer takes for it, from how many
granules land near the ends of bins among others and alone (src/wakeflow/budget/bin_ends.py).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import wakeflow as wf
from wakeflow.budget.bin_ends import AmongOthers
from wakeflow.foam.statistics import student
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.bounds import COLLISIONS
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import DRAWS, SAME_AIR

CASES = Path(__file__).parents[1]
SCENES: dict[str, dict[str, Any]] = {
    "rhombus": {"numerics.rung": "draft", "numerics.mesh_scale": 2.0},
    "labyrinth": {"numerics.mesh_scale": 2.5},
    "vacuum": {},
}
HOUR = 3600.0
ALONE = 4  # replicates that fly alone under a draw, two in each half
FORCE = {COLLISIONS: True, "basset-history": False, "air-loading": False}
Array = NDArray[np.float64]


class Moved(NamedTuple):
    """Changes (draws, bins + 1) of one fraction's shares: among granules that ``meet``, and alone in two ``halves``;
    the factor that is ``taken`` for what lies between.
    """

    meet: Array
    halves: tuple[Array, Array]
    taken: float

    def without(self, draw: int) -> Moved:
        """The same without one draw."""
        first, second = (np.delete(half, draw, axis=0) for half in self.halves)
        return Moved(np.delete(self.meet, draw, axis=0), (first, second), self.taken)


def moved(scene: wf.Scene, draws: Sequence[int]) -> dict[str, Moved]:
    """What the numbered ``draws`` change of each fraction's shares."""
    pipeline = Pipeline(scene, make_plan(scene, force=FORCE))
    crowd, tracked, stage = pipeline.crowd(), pipeline.tracks(), pipeline.draw_stage
    assert crowd is not None
    bins, among = len(scene.bin), AmongOthers(scene, tracked.landings, crowd.landings)
    still = {name: landing.counts(bins).mean(axis=0) for name, landing in crowd.landings.items()}
    meet: dict[str, list[Array]] = {name: [] for name in scene.fraction}
    alone: dict[str, list[Array]] = {name: [] for name in scene.fraction}
    for number in draws:
        for name, landing in pipeline.crowd_drawn(number).items():
            meet[name].append(landing.counts(bins).mean(axis=0) - still[name])
        made = stage.variation(number)
        airs = stage.air(made.air)
        flown = [stage.fly_under(made, airs, tracked, replicate, slice(None)) for replicate in range(ALONE)]
        for name in scene.fraction:
            alone[name].append(np.array([_change(part, name, bins) for part in flown]))
    found = {}
    for name in scene.fraction:
        each = np.array(alone[name])
        halves = each[:, ::2].mean(axis=1), each[:, 1::2].mean(axis=1)
        found[name] = Moved(np.array(meet[name]), halves, among.factor(name))
    return found


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
        meet, first, second = (part - part.mean(axis=0) for part in (row.meet, *row.halves))
        above += float(np.sum(meet * (first + second)) / 2.0)
        below += float(np.sum(first * second))
    return above / below if below else float("nan")


def with_interval(rows: Sequence[Moved]) -> tuple[float, float]:
    """The slope and half of its 95 % interval."""
    draws = len(rows[0].meet)
    left = np.array([slope([row.without(i) for row in rows]) for i in range(draws)])
    spread = np.sqrt((draws - 1) / draws * np.sum((left - left.mean()) ** 2))
    return slope(rows), float(student(draws - 1) * spread)


def main(chosen: Sequence[str], draws: int, count: int, rate: float | None = None) -> dict[str, tuple[float, float]]:
    """Print a table of the ``chosen`` scenes at their own feed rate or at another (kg/h); returns the slope over all
    fractions of each.
    """
    fed = {} if rate is None else {"feed.rate": rate / HOUR}
    print("| scene | kg/h | fraction | moved alone, points | moved among others | slope | taken |\n" + 7 * "|---" + "|")
    found = {}
    for which in chosen:
        scene = wf.Scene.load(CASES / f"{which}.toml", {"feed.count": count, **SCENES[which], **fed})
        rate_here = HOUR * (scene.feed.rate or 0.0)
        rows = moved(scene, chosen_draws(draws))
        found[which] = with_interval(list(rows.values()))
        for name, row in (*rows.items(), ("all", None)):
            some = list(rows.values()) if row is None else [row]
            alone, meet = (_rms([part(one) for one in some]) for part in (_alone, lambda one: one.meet))
            value, half = with_interval(some)
            taken = "" if row is None else f"{row.taken:.2f}"
            numbers = f"{alone:.1f} | {meet:.1f} | {value:.2f} ± {half:.2f} | {taken}"
            print(f"| {which} | {rate_here:g} | {name} | {numbers} |", flush=True)
    return found


def _alone(row: Moved) -> Array:
    return np.asarray(0.5 * (row.halves[0] + row.halves[1]))


def _rms(changes: Sequence[Array]) -> float:
    """Of changes about their mean over the draws, in points."""
    about = np.concatenate([(change - change.mean(axis=0)).ravel() for change in changes])
    return float(100.0 * np.sqrt(np.mean(about**2)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--draws", type=int, default=32)
    parser.add_argument("--count", type=int, default=1024)
    parser.add_argument("--rate", type=float)
    asked = parser.parse_args()
    main(asked.scenes, asked.draws, asked.count, asked.rate)
