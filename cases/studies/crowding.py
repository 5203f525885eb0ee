"""Print the plan's estimate of meetings and its bound on collisions beside slabs that were flown:

.venv/bin/python cases/studies/crowding.py [SCENE ...]     # rhombus prism labyrinth aspirator vacuum

Meetings are those with granules of any mass that are simulated one by one; the change is that of the share, in any bin,
which changes most between granules that meet and granules alone, with its sampling error.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import wakeflow as wf
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.bounds import COLLISIONS
from wakeflow.planning.make import make_plan
from wakeflow.planning.meetings import encounters
from wakeflow.planning.terms import limit_of
from wakeflow.results.separation import separate

CASES = Path(__file__).parents[1]
FORCE = {COLLISIONS: True, "basset-history": False, "air-loading": False}
SCENES: dict[str, dict[str, Any]] = {
    "rhombus": {"numerics.rung": "draft", "numerics.mesh_scale": 2.0},
    "prism": {"numerics.mesh_scale": 2.0},
    "labyrinth": {"numerics.mesh_scale": 2.5},
    "aspirator": {},
    "vacuum": {},
}
RATES = (20.0, 100.0, 500.0)  # kg/h
HOUR = 3600.0
COUNT = 1024  # granules of the fraction of most mass


class Row(NamedTuple):
    """One fraction at one ``rate`` (kg/h): meetings a granule ``counted`` and ``estimated``; the ``change`` of a share
    by collisions with its sampling ``error`` (95 %), and the largest that the plan's bound allows.
    """

    scene: str
    rate: float
    fraction: str
    counted: float
    estimated: float
    change: float
    error: float
    bound: float

    @property
    def holds(self) -> bool:
        """Whether neither estimate nor bound is exceeded, by more than sampling explains."""
        return self.change - self.error <= self.bound


def rows(which: str, rates: Sequence[float] = RATES, count: int = COUNT) -> Iterator[Row]:
    """A row for every fraction and rate of one of SCENES."""
    for rate in rates:
        changes = {"feed.count": count, "feed.rate": rate / HOUR, **SCENES[which]}
        scene = wf.Scene.load(CASES / f"{which}.toml", changes)
        plan = make_plan(scene, force=FORCE)
        pipeline = Pipeline(scene, plan)
        crowd = pipeline.crowd()
        assert crowd is not None
        assert plan.crowd is not None
        met, alone = separate(scene, crowd.landings), separate(scene, pipeline.tracks().landings)
        one_by_one = [name for name in scene.fraction if not plan.crowd.tracers[name]]
        found = encounters(scene, {name: (how.drag, how.drag_scale) for name, how in plan.fractions.items()})
        for name, landing in crowd.landings.items():
            assert landing.meetings is not None
            pairs = [(met.fractions[name][place], alone.fractions[name][place]) for place in met.bins]
            moved = [(abs(a.value - b.value), 0.5 * ((a.high - a.low) ** 2 + (b.high - b.low) ** 2) ** 0.5)
                     for a, b in pairs]  # fmt: skip
            change, error = max(moved)
            allowed = plan.fractions[name].bounds[COLLISIONS] / limit_of(scene, 1.0)
            counted = float(landing.meetings @ landing.mass_shares)
            with_these = sum(found[name].by[other] for other in one_by_one)
            yield Row(which, rate, name, counted, with_these, change, error, min(1.0, allowed))


def main(chosen: Sequence[str], rates: Sequence[float] = RATES, count: int = COUNT) -> list[Row]:
    """Print a table of the ``chosen`` scenes; returns its rows."""
    print("| scene | kg/h | fraction | meetings counted | estimated | largest change of a share, points | bound |")
    print("|---|---|---|---|---|---|---|")
    found = []
    for which in chosen:
        for row in rows(which, rates, count):
            found.append(row)
            said = "" if row.holds else " **exceeded**"
            print(
                f"| {row.scene} | {row.rate:g} | {row.fraction} | {row.counted:.2g} | {row.estimated:.2g} | "
                f"{100 * row.change:.1f} ± {100 * row.error:.1f} | {100 * row.bound:.2g}{said} |", flush=True,
            )  # fmt: skip
    return found


if __name__ == "__main__":
    main(sys.argv[1:] or list(SCENES))
