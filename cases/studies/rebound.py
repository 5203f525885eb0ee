"""What each part of a real rebound moves: shares of the shipped rhombus with one part after the other.

.venv/bin/python cases/studies/rebound.py [--count 4096] [--rung none]

The first row is the paper's granule: a point mass, all of a fraction alike. Each of the next ones adds one part alone
(the same granules, released at the same places and times), the last one is what the materials say, all parts together.
On rung none in a vacuum and without OpenFOAM; another rung flies in its airflow. The tables of docs/rebound.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import wakeflow as wf
from wakeflow.laws.material import materials
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.results.separation import separate
from wakeflow.scene import Scene

SCENE = Path(__file__).parents[1] / "rhombus.toml"
PLACES = {  # columns of the table: fraction, bins that count together
    "wheat, outer": ("wheat", ("outer-left", "outer-right")),
    "chaff, middle": ("chaff", ("middle",)),
    "chaff, inner": ("chaff", ("inner-left", "inner-right")),
    "dust, middle": ("dust", ("middle",)),
}


def of_material(part: str) -> Callable[[str], dict[str, Any]]:
    """The key that gives a paper's granule this part of its material's rebound."""

    def keys(name: str) -> dict[str, Any]:
        known = materials[name]
        if part in ("restitution", "friction"):
            return {part: {"mean": getattr(known, part), "std": getattr(known, f"{part}_std")}}
        if part == "spin":
            return {} if known.impact == "paper" else {"impact": known.impact, **alike(name)}
        if part == "terminal_velocity":
            if not known.terminal_velocity_std:
                return {}
            spread = {"distribution": "normal", "mean": known.terminal_velocity, "std": known.terminal_velocity_std}
            return {part: spread}
        return {part: getattr(known, part)}

    return keys


def alike(name: str) -> dict[str, Any]:
    """Granules of a material that turn, and are alike otherwise."""
    known = materials[name]
    own = {"restitution": known.restitution, "friction": known.friction, "rebound_scatter": 0.0}
    return own if known.impact == "paper" else {**own, "tangential_restitution": 0.0}


ROWS: dict[str, Callable[[str], dict[str, Any]] | None] = {
    "the paper's point mass": lambda _: {},
    "restitution spreads": of_material("restitution"),
    "friction spreads": of_material("friction"),
    "scatter by shape": of_material("rebound_scatter"),
    "spin": of_material("spin"),
    "terminal velocity spreads": of_material("terminal_velocity"),
    "all, by material": None,
}


def scene_of(scene: Scene, keys: Callable[[str], dict[str, Any]] | None) -> Scene:
    """The scene with the paper's granules and one part of the rebound; None: with the materials' own."""
    if keys is None:
        return scene
    changes: dict[str, Any] = {}
    for name, fraction in scene.fraction.items():
        own = {"impact": "paper", **keys(str(fraction.material))}
        changes.update({f"fraction.{name}.{key}": value for key, value in own.items()})
    return scene.replace(changes)


def shares(scene: Scene, rung: str) -> dict[str, tuple[float, float]]:
    """Share and half of its 95 % interval, in percent, of every column."""
    if rung == "none":
        found = wf.chain(scene).shares
    else:
        found = separate(scene, Pipeline(scene, wf.plan(scene, rung=rung)).tracks().landings)
    row = {}
    for column, (fraction, places) in PLACES.items():
        parts = [found.share(fraction, place) for place in places]
        row[column] = (
            100 * sum(value for value, _, _ in parts), 50 * sum((high - low) ** 2 for _, low, high in parts) ** 0.5,
        )  # fmt: skip
    return row


def main(count: int, rung: str) -> None:
    scene = Scene.load(SCENE, {"feed.count": count})
    print(f"| {' | '.join(['percent', *PLACES])} |\n|{'---|' * (1 + len(PLACES))}")
    for name, keys in ROWS.items():
        row = shares(scene_of(scene, keys), rung)
        print(f"| {' | '.join([name, *(f'{value:.1f} +- {half:.1f}' for value, half in row.values())])} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=4096, help="granules of each fraction")
    parser.add_argument("--rung", default="none", help="none (in a vacuum), draft, standard, ...")
    options = parser.parse_args()
    main(options.count, options.rung)
