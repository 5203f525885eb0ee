"""Print what --target-error reaches on twenty varied scenes, and what it costs beside the best fixed setting:

.venv/bin/python cases/studies/target_error.py [--air] [--scenes N]

Each scene is run with a target error, then with fixed settings in a scan; the error is that of the bin shares against
an independent reference. --air adds three scenes whose air OpenFOAM solves on coarse meshes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from wakeflow.pipeline.compilation import compile_tracker
from wakeflow.verify.settings import TimedRun, best_fixed, reference_shares, to_target

CASES = Path(__file__).parents[1]
TARGETS = (0.03, 0.02, 0.015)  # half widths of every bin share, in turn
TOLERANCES = (1e-3, 1e-4)  # of the fixed settings
SEED = 14  # of the scenes' numbers
VACUUM, ANALYTIC, LABYRINTH = 8, 6, 6  # scenes of each kind


@dataclass(frozen=True)
class Row:
    """A scene, its target, the run that was led to it, its error, and the best fixed settings where they were tried:
    without a solver.
    """

    name: str
    target: float
    led: TimedRun
    error: float
    fixed: TimedRun | None

    @property
    def met(self) -> bool:
        """Whether the error against the reference is within the target."""
        return self.error <= self.target

    @property
    def times(self) -> float | None:
        """Processor time over that of the best fixed settings; None where none were tried."""
        return None if self.fixed is None else self.led.seconds / self.fixed.seconds


def scenes() -> Iterator[tuple[str, wf.Scene]]:
    """Twenty scenes that fly without a solver: shaken bodies in a vacuum, open air, bodies with their air left out."""
    chance = np.random.default_rng(SEED)

    def between(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    for number in range(VACUUM):
        yield f"vacuum {number + 1}", _changed("vacuum", {
            "feed.width": between(0.005, 0.03), "feed.height": between(0.05, 0.2), "feed.position": between(0.0, 0.015),
            "fraction.hard.restitution": between(0.2, 0.7), "fraction.soft.friction": between(0.1, 0.6),
            "vibration.frequency": between(10.0, 40.0), "bin.near.to": (edge := between(0.06, 0.16)),
            "bin.far.from": edge,
        })  # fmt: skip
    for number in range(ANALYTIC):
        yield f"open air {number + 1}", _open_air(between)
    for number in range(LABYRINTH):
        name = "prism" if number % 2 else "rhombus"
        yield f"{name} without air {number + 1}", _alone(_changed(name, {
            "numerics.rung": "none", "feed.width": between(0.01, 0.05), "feed.height": between(0.05, 0.2),
        }))  # fmt: skip


def solved() -> Iterator[tuple[str, wf.Scene]]:
    """Three scenes whose air is solved, steady, on coarse meshes."""
    for name, speed in (("prism", 4.0), ("rhombus", 5.0), ("rhombus", 3.0)):
        yield f"{name}, air {speed:g} m/s", _alone(_changed(name, {
            "numerics.rung": "draft", "numerics.mesh_scale": 2.5, "air.speed": speed,
        }))  # fmt: skip


def _changed(name: str, changes: dict[str, Any]) -> wf.Scene:
    return wf.Scene.load(CASES / f"{name}.toml", {**changes, "feed.count": 16384})


def _alone(scene: wf.Scene) -> wf.Scene:
    """The scene with its heaviest fraction alone, each granule by itself."""
    tables = scene.tables()
    name = max(scene.mass_shares(), key=lambda one: scene.mass_shares()[one])
    tables["fraction"] = {name: {**tables["fraction"][name], "mass_share": 1.0}}
    tables["feed"].pop("rate", None)
    return wf.Scene.parse(tables)


def _open_air(between: Any) -> wf.Scene:
    """A jet of granules across a channel of rising air, into three bins."""
    edges = -0.3, between(-0.1, -0.05), between(-0.02, 0.03), 0.3
    bins = {name: {"from": edges[i], "to": edges[i + 1]} for i, name in enumerate(("left", "middle", "right"))}
    return wf.Scene.parse({
        "channel": {"width": 0.6, "top": 0.3, "bottom": -0.3},
        "air": {"speed": between(0.5, 2.0), "direction": "up", "turbulence": 0.02},
        "feed": {
            "speed": between(0.2, 1.0), "level": 0.2, "width": between(0.02, 0.08), "position": -0.05, "count": 16384,
            "direction": between(-1.4, -0.8),
        },
        "fraction": {
            "light": {"size": {"distribution": "lognormal", "median": between(0.8e-3, 1.5e-3), "geometric_std": 1.2},
                      "density": 700.0, "restitution": 0.3, "friction": 0.4},
            "heavy": {"size": between(2e-3, 4e-3), "density": 1300.0, "restitution": 0.5, "friction": 0.3},
        },
        "bin": bins,
    })  # fmt: skip


def measured(name: str, scene: wf.Scene, target: float) -> Row:
    """One scene both ways."""
    led = to_target(scene, target)
    fixed = best_fixed(scene, target, TOLERANCES) if led.settings.mesh_scale is None else None
    return Row(name, target, led, led.error(reference_shares(scene, led.settings)), fixed)


def main(names: Sequence[tuple[str, wf.Scene]], targets: Sequence[float] = TARGETS) -> list[Row]:
    """Print the table, a row a scene, and what it comes to. Returns the rows."""
    compile_tracker()
    print("| scene | target, points | granules | tolerance | rounds | half width | error | s | best fixed, s | times |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    rows = []
    for number, (name, scene) in enumerate(names):
        row = measured(name, scene, targets[number % len(targets)])
        rows.append(row)
        led = row.led
        numbers = (
            f"{100 * row.target:.2g}", f"{led.settings.granules}", f"{led.settings.tolerance:.2g}", f"{led.rounds}",
            f"{100 * led.half:.2g}", f"{100 * row.error:.2g}", f"{led.seconds:.1f}",
            *(("–", "–") if row.fixed is None else (f"{row.fixed.seconds:.1f}", f"{row.times:.2f}")),
        )  # fmt: skip
        print(f"| {' | '.join((name, *numbers))} |", flush=True)
    met = sum(row.met for row in rows)
    times = [row.times for row in rows if row.times is not None]
    print(f"\nwithin the target against the reference: {met} of {len(rows)} scenes")
    if times:
        print(f"processor time over that of the best fixed one: median {np.median(times):.2f}, most {max(times):.2f}")
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--air", action="store_true", help="three scenes with solved air too")
    parser.add_argument("--scenes", type=int, default=VACUUM + ANALYTIC + LABYRINTH, help="the first so many")
    asked = parser.parse_args()
    main([*list(scenes())[: asked.scenes], *(solved() if asked.air else ())])
