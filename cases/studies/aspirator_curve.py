"""Print the share that upward air carries over against its speed, beside what the measured terminal velocities say:

.venv/bin/python cases/studies/aspirator_curve.py [docs/pictures/aspirator-curve.png] [--quick]

A verification, not a validation: the terminal velocities go in, and come out again. Calm air carries over what falls
more slowly than it rises; beside it the same with the scene's turbulence, for speeds at which a fraction is divided.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.make import make_plan
from wakeflow.report.colours import fraction_colours
from wakeflow.results.separation import separate

SPEEDS = (3.0, 3.25, 3.5, 4.0, 4.5, 4.8, 4.9, 5.5, 6.0, 6.5, 7.0, 7.1, 7.2, 7.3, 7.4, 7.5, 7.6, 7.7, 7.8, 8.0, 9.0)
CASES = Path(__file__).parents[1]
CALM = {"dispersion": False}
FEWEST = 64  # granules a fraction when it is only tried out
FEWER = 1024  # granules a fraction in turbulence: one that hangs in the air takes thousands of steps of noise
Shares = dict[str, tuple[float, float, float]]


def carried(scene: wf.Scene, force: dict[str, bool]) -> Shares:
    """Share, low, high of each fraction in the bin ``light``."""
    plan = make_plan(scene, force=force)
    found = separate(scene, Pipeline(scene, plan).tracks().landings)
    return {name: found.share(name, "light") for name in found.fractions}


def expected(scene: wf.Scene, name: str, speed: float) -> float:
    """Share of a fraction's mass whose terminal velocity lies below ``speed`` (m/s)."""
    p = np.linspace(1e-6, 1.0 - 1e-6, 100_001)
    speeds = scene.fraction[name].settling(p)
    assert speeds is not None
    return float(np.mean(speeds < speed))


def main(picture: Path | None, quick: bool = False) -> None:
    """Print the table and draw ``picture``; ``quick``: at three speeds, of few granules."""
    base = wf.Scene.load(CASES / "aspirator.toml", {"feed.count": FEWEST} if quick else {})
    names, rows = list(base.fraction), []
    print("| air, m/s |" + "".join(f" {name}: exact | calm air | turbulence 5 % |" for name in names))
    print("|---|" + "---|" * (3 * len(names)))
    for speed in SPEEDS[::10] if quick else SPEEDS:
        scene = base.replace({"air.speed": speed})
        exact = {name: expected(scene, name, speed) for name in names}
        calm, cells = carried(scene, CALM), []
        divided = any(0.0 < share < 1.0 for share in exact.values())
        fewer = scene.replace({"feed.count": min(FEWER, base.feed.count)})
        rough: Shares = carried(fewer, {"dispersion": True}) if divided else {}
        for name in names:
            cells += [f"{100 * exact[name]:.1f}", _percent(calm[name])]
            cells += [_percent(rough[name]) if divided and 0.0 < exact[name] < 1.0 else "–"]
        rows.append((speed, exact, calm, rough))
        print(f"| {speed:g} | {' | '.join(cells)} |", flush=True)
    if picture is not None:
        draw(picture, names, rows, base)


def _percent(row: tuple[float, float, float]) -> str:
    return f"{100 * row[0]:.1f} ± {50 * (row[2] - row[1]):.1f}"


def draw(path: Path, names: list[str], rows: list[Any], base: wf.Scene) -> None:
    """The exact curves as lines, the tracker's shares as points."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8.4, 3.6))
    axes.axvspan(4.85, 7.04, color="#e6ebf1", label="published window, 4.85 to 7.04 m/s")
    speeds = np.linspace(2.4, 9.0, 400)
    for name, colour in fraction_colours(list(names)).items():
        axes.plot(speeds, [100 * expected(base, name, u) for u in speeds], color=colour, linewidth=1.2)
        axes.plot(
            [r[0] for r in rows], [100 * r[2][name][0] for r in rows], "o", color=colour, markersize=4, label=name
        )
        some = [(r[0], 100 * r[3][name][0]) for r in rows if r[3] and 0.0 < r[1][name] < 1.0]
        axes.plot(*zip(*some, strict=True), "x", color=colour, markersize=6)
    axes.set_xlabel("speed of the upward air (m/s)")
    axes.set_ylabel("carried over (% of mass)")
    axes.set_title("Verification: lines exact, dots calm air, crosses with turbulence of 5 %", fontsize=9, loc="left")
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--quick"]
    main(Path(given[0]) if given else None, "--quick" in sys.argv)
