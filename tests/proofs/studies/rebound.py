"""What each part of a real rebound moves: shares of the shipped rhombus with one part after the other.

The first row is the paper's granule: a point mass, all of a fraction alike. Each of the next ones adds one part alone
(the same granules, released at the same places and times), the last one is what the materials say, all parts together.
On rung none in a vacuum and without OpenFOAM; another rung flies in its airflow. docs/rebound.md: rebound --count 2048
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import wakeflow as wf
from support import shipped
from wakeflow.laws.material import materials

from .common import Row, piped, separation, show

PLACES = {  # columns of the table: fraction, bins that count together
    "wheat, outer": ("wheat", ("outer-left", "outer-right")),
    "chaff, middle": ("chaff", ("middle",)),
    "chaff, inner": ("chaff", ("inner-left", "inner-right")),
    "dust, middle": ("dust", ("middle",)),
}
Keys = dict[str, Any]


def spreads(part: str) -> Callable[[str], Keys]:
    """A number of the material, and how it spreads."""
    return lambda name: {part: {"mean": getattr(materials[name], part), "std": getattr(materials[name], f"{part}_std")}}


def terminal_velocity(name: str) -> Keys:
    """How it spreads, where it does."""
    known = materials[name]
    spread = {"distribution": "normal", "mean": known.terminal_velocity, "std": known.terminal_velocity_std}
    return {"terminal_velocity": spread} if known.terminal_velocity_std else {}


def spin(name: str) -> Keys:
    """Granules of a material that turn, and are alike otherwise."""
    known = materials[name]
    alike = {"restitution": known.restitution, "friction": known.friction, "rebound_scatter": 0.0}
    return {} if known.impact == "paper" else {"impact": known.impact, **alike, "tangential_restitution": 0.0}


ROWS: dict[str, Callable[[str], Keys] | None] = {
    "the paper's point mass": lambda _: {},
    "restitution spreads": spreads("restitution"),
    "friction spreads": spreads("friction"),
    "scatter by shape": lambda name: {"rebound_scatter": materials[name].rebound_scatter},
    "spin": spin,
    "terminal velocity spreads": terminal_velocity,
    "all, by material": None,
}


def scene_of(scene: wf.Scene, keys: Callable[[str], Keys] | None) -> wf.Scene:
    """The scene with the paper's granules and one part of the rebound; None: with the materials' own."""
    if keys is None:
        return scene
    changes: Keys = {}
    for name, fraction in scene.fraction.items():
        own = {"impact": "paper", **keys(str(fraction.material))}
        changes.update({f"fraction.{name}.{key}": value for key, value in own.items()})
    return scene.replace(changes)


def row(title: str, scene: wf.Scene, rung: str) -> Row:
    """Share and half of its 95 % interval, in percent, of every column."""
    found = wf.chain(scene).shares if rung == "none" else separation(piped(scene, rung))
    cells = {}
    for column, (fraction, places) in PLACES.items():
        parts = [found.fractions[fraction][place] for place in places]
        error = sum(part.half**2 for part in parts) ** 0.5
        cells[column] = f"{100 * sum(part.value for part in parts):.1f} +- {100 * error:.1f}"
    return {"percent": title, **cells}


def main(*, count: int = 4096, rung: str = "none") -> list[Row]:
    """What each part of a real rebound moves."""
    scene = shipped("rhombus", {"feed.count": count})
    return show(("percent", *PLACES), (row(title, scene_of(scene, keys), rung) for title, keys in ROWS.items()))
