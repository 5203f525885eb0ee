"""Recovery and purity against the feed rate, of granules that meet in air that feels them, printed and drawn.

Scenes are those of cases/ that have a feed rate. The first row has each granule alone in air that does not feel it, by
the forces of the slab: without history force. The slab flies at every rate, even where the plan would leave collisions
out; the air feels the granules where the plan wants it. The tables and the picture of docs/throughput.md:
throughput docs/pictures/throughput.png
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.answer.shares import Separation
from wakeflow.planning.terms import COLLISIONS, LOADING
from wakeflow.report.canvas import fraction_colours
from wakeflow.statistics.separation import separate

from .common import HOUR, Row, collisions_of, percent, picture, piped, separation, show

RATES = (10.0, 50.0, 125.0, 500.0, 1000.0)  # kg/h
ALONE = {COLLISIONS: False, LOADING: False, "basset-history": False}  # granules that meet leave out the last
QUICK = {"feed.count": 16, "numerics.target_error": 0.5, "collisions.depth": "20 mm"}


def purity(scene: wf.Scene, found: Separation, name: str) -> float | None:
    """Share of the fraction in the mass of its target bins together; None where they stay empty."""
    shares, targets = scene.mass_shares(), scene.fraction[name].targets
    inside = {one: shares[one] * sum(found.fractions[one][place].value for place in targets) for one in scene.fraction}
    return inside[name] / sum(inside.values()) if sum(inside.values()) else None


def _row(scene: wf.Scene, rate: float, found: Separation, meetings: dict[str, float]) -> Row:
    numbers: dict[str, object] = {"rate": rate, "what": f"{rate:g}" if rate else "each alone"}
    for name, fraction in scene.fraction.items():
        if fraction.targets:
            recovery = found.recovery[name]
            part = {"recovery": percent(recovery), "value": recovery.value, "half": recovery.half}
            numbers[name] = {**part, "purity": purity(scene, found, name), "meetings": meetings.get(name, 0.0)}
    return numbers


def rows(scene: wf.Scene, rates: Sequence[float], rung: str | None = None) -> Iterator[Row]:
    """Granules alone in air that does not feel them, then at each of the ``rates`` (kg/h)."""
    yield _row(scene, 0.0, separation(piped(scene, rung, ALONE)), {})
    for rate in rates:
        fed = scene.replace({"feed.rate": rate / HOUR})
        landings = piped(fed, rung, {COLLISIONS: True}).crowd().landings
        met = {name: collisions_of(landing) for name, landing in landings.items()}
        yield _row(fed, rate, separate(fed, landings), met)


def draw(path: Path, found: dict[str, list[Row]]) -> None:
    """Recovery (full) and purity (dashed) against the feed rate, a panel a scene; at the left edge each alone."""
    with picture(path, len(found), 4.8, 3.4) as panels:
        for axes, (title, (alone, *met)) in zip(panels, found.items(), strict=True):
            rates = [row["rate"] for row in met]
            names = list(shipped(title).fraction)
            for name, colour in fraction_colours(names).items():
                if name not in alone:
                    continue
                value, error = (100.0 * np.array([row[name][key] for row in met]) for key in ("value", "half"))
                pure = 100.0 * np.array([row[name]["purity"] for row in met], dtype=float)
                axes.errorbar(rates, value, error, color=colour, marker="o", markersize=4, capsize=2, label=name)
                axes.plot(0.5 * rates[0], 100.0 * alone[name]["value"], "<", color=colour, markersize=6)
                axes.plot(rates, pure, "--", color=colour, linewidth=1.0)
            axes.set(xscale="log", xlabel="feed (kg/h)", ylim=(0.0, 103.0))
            axes.set_title(title, fontsize=9, loc="left")
            axes.grid(alpha=0.25)
        panels[0].set_ylabel("recovery (full), purity (dashed), %")
        panels[-1].legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))


def main(
    image: Path | None = None, *, scene: tuple[str, ...] = ("rhombus", "prism", "labyrinth"), rung: str | None = None,
    count: int | None = None, quick: bool = False,
) -> dict[str, list[Row]]:  # fmt: skip
    """Recovery and purity against the feed rate; ``count``: granules of the fraction of most mass at each rate."""
    found = {}
    for name in scene:
        made = shipped(name, QUICK if quick else {} if count is None else {"feed.count": count})
        columns = {"kg/h": "{what}"}
        for one in (one for one, fraction in made.fraction.items() if fraction.targets):
            columns[f"{one}: recovery, %"] = f"{{{one}[recovery]}}"
            columns[f"{one}: purity, %"] = f"{{{one}[purity]:.1f*100}}"
            columns[f"{one}: meetings"] = f"{{{one}[meetings]:.2g}}"
        found[name] = show(columns, rows(made, RATES[1::2] if quick else RATES, rung), name)
    if image is not None:
        draw(image, found)
    return found
