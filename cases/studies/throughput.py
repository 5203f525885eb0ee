"""Print recovery and purity against the feed rate, of granules that meet in air that feels them, and draw them:

.venv/bin/python cases/studies/throughput.py [docs/pictures/throughput.png] [--scene NAME] [--rung RUNG] [--count N]

Scenes are those of cases/ that have a feed rate; without --scene the rhombus, the prism and the labyrinth. The first
row has each granule alone in air that does not feel it, by the forces of the slab: without history force. The slab
flies at every rate, even where the plan would leave collisions out; the air feels the granules where the plan wants it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from wakeflow.core.number import Number
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.bounds import COLLISIONS, LOADING
from wakeflow.planning.make import make_plan
from wakeflow.report.colours import fraction_colours
from wakeflow.report.words import percent
from wakeflow.results.landing_results import Separation
from wakeflow.results.separation import separate

CASES = Path(__file__).parents[1]
RATES = (10.0, 50.0, 125.0, 500.0, 1000.0)  # kg/h
HOUR = 3600.0
HISTORY = "basset-history"  # which granules that meet leave out
QUICK: dict[str, Any] = {"feed.count": 16, "numerics.target_error": 0.5, "collisions.depth": "20 mm"}


@dataclass(frozen=True)
class Point:
    """A scene at one feed ``rate`` (kg/h; 0: each granule alone): its separation, and what a granule meets, mean."""

    rate: float
    separation: Separation
    meetings: dict[str, float]

    def recovery(self, name: str) -> Number | None:
        """Share of a fraction in its target bins; None without any."""
        return self.separation.recovery[name]

    def purity(self, scene: wf.Scene, name: str) -> float | None:
        """Share of the fraction in the mass of its target bins together; None where they stay empty."""
        mass, inside = scene.mass_shares(), dict.fromkeys(scene.fraction, 0.0)
        for other, places in self.separation.fractions.items():
            inside[other] = mass[other] * sum(places[place].value for place in scene.fraction[name].targets)
        return inside[name] / sum(inside.values()) if sum(inside.values()) else None


def points(scene: wf.Scene, rates: Sequence[float], rung: str | None = None) -> list[Point]:
    """The separation of granules alone in air that does not feel them, then at each of the ``rates`` (kg/h)."""
    found: list[Point] = []
    alone = Pipeline(scene, make_plan(scene, rung=rung, force={COLLISIONS: False, LOADING: False, HISTORY: False}))
    found.append(Point(0.0, separate(scene, alone.tracks().landings), dict.fromkeys(scene.fraction, 0.0)))
    for rate in rates:
        fed = scene.replace({"feed.rate": rate / HOUR})
        pipeline = Pipeline(fed, make_plan(fed, rung=rung, force={COLLISIONS: True}))
        crowd = pipeline.crowd()
        assert crowd is not None
        meetings = {}
        for name, landing in crowd.landings.items():
            assert landing.meetings is not None
            meetings[name] = float(landing.meetings @ landing.mass_shares)
        found.append(Point(rate, separate(fed, crowd.landings), meetings))
    return found


def table(scene: wf.Scene, rows: Sequence[Point]) -> None:
    """Print a row a rate: recovery and purity of every fraction that has a target, and its meetings."""
    names = [name for name, fraction in scene.fraction.items() if fraction.targets]
    print("| kg/h |" + "".join(f" {name}: recovery, % | purity, % | meetings |" for name in names))
    print("|---|" + "---|" * (3 * len(names)))
    for row in rows:
        cells = [f"{row.rate:g}" if row.rate else "each alone"]
        for name in names:
            pure = row.purity(scene, name)
            cells += [percent(row.recovery(name)), "–" if pure is None else f"{100 * pure:.1f}"]
            cells += [f"{row.meetings[name]:.2g}"]
        print(f"| {' | '.join(cells)} |", flush=True)


def draw(path: Path, found: dict[str, tuple[wf.Scene, list[Point]]]) -> None:
    """Recovery (full) and purity (dashed) against the feed rate, a panel a scene; at the left edge each alone."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, len(found), figsize=(4.8 * len(found), 3.4), squeeze=False, sharey=True)
    for axes, (title, (scene, rows)) in zip(panels[0], found.items(), strict=True):
        met = rows[1:]
        left = 0.5 * met[0].rate
        for name, colour in fraction_colours(list(scene.fraction)).items():
            if not scene.fraction[name].targets:
                continue
            shares = [row.recovery(name) for row in rows]
            value = 100.0 * np.array([share.value for share in shares if share is not None])
            half = 100.0 * np.array([share.half for share in shares if share is not None])
            rate = [row.rate or left for row in rows]
            axes.errorbar(rate[1:], value[1:], half[1:], color=colour, marker="o", markersize=4, capsize=2, label=name)
            axes.plot(left, value[0], "<", color=colour, markersize=6)
            pure = [row.purity(scene, name) for row in met]
            axes.plot(rate[1:], [np.nan if p is None else 100.0 * p for p in pure], "--", color=colour, linewidth=1.0)
        axes.set(xscale="log", xlabel="feed (kg/h)", ylim=(0.0, 103.0))
        axes.set_title(title, fontsize=9, loc="left")
        axes.grid(alpha=0.25)
    panels[0][0].set_ylabel("recovery (full), purity (dashed), %")
    panels[0][-1].legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")


def main(words: Sequence[str] | None = None) -> dict[str, tuple[wf.Scene, list[Point]]]:
    """Print the tables and draw the picture; returns the points by scene."""
    parser = argparse.ArgumentParser()
    parser.add_argument("picture", nargs="?", type=Path)
    parser.add_argument("--scene", action="append")
    parser.add_argument("--rung")
    parser.add_argument("--count", type=int, help="granules of the fraction of most mass at each rate")
    parser.add_argument("--quick", action="store_true", help="two rates, few granules")
    asked = parser.parse_args(words)
    found = {}
    for name in asked.scene or ["rhombus", "prism", "labyrinth"]:
        changes = QUICK if asked.quick else {} if asked.count is None else {"feed.count": asked.count}
        scene = wf.Scene.load(CASES / f"{name}.toml", changes)
        rows = points(scene, RATES[1::2] if asked.quick else RATES, asked.rung)
        print(f"\n{name}\n")
        table(scene, rows)
        found[name] = scene, rows
    if asked.picture is not None:
        draw(asked.picture, found)
    return found


if __name__ == "__main__":
    main()
