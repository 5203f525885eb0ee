"""Injected granules beside resolved ones, for every scene in cases: bin shares, their difference, and what makes it.

.venv/bin/python cases/studies/injection_or_resolved.py [COUNT] [SCENE.toml ...]

Prints the table of docs/validation.md. Every fraction is flown with the same granules in the steady airflow (rung
draft): *straight*, all by eq. (1)-(2) as if there were no air before the body; *weighed*, as feed.mode = "injected"
does it, with those that the air carries round the body released above it; *resolved*, the tracker doing all impacts.
*Calm*: without the random forces of the turbulence. Straight to weighed is what the granules carried round make; calm
weighed to calm resolved what the turning of the rest makes; what else lies between weighed and resolved is turbulence
before and at the slope. Some minutes of one core with the airflows.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import wakeflow as wf
from wakeflow.core.number import Number
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import Plan
from wakeflow.results.separation import separate

CASES = Path(__file__).parents[1]
BARE = {"air-loading": False}  # the same air for all ways


def straight(plan: Plan) -> Plan:
    """The plan with every granule injected that would fall on the body without air."""
    return replace(plan, fractions={n: replace(how, impaction=None) for n, how in plan.fractions.items()})


def calm(plan: Plan) -> Plan:
    """The plan without dispersion and Brownian motion."""
    return replace(plan, fractions={
        name: replace(how, forces=tuple(f for f in how.forces if f not in ("dispersion", "brownian")))
        for name, how in plan.fractions.items()
    })  # fmt: skip


def shares(scene: wf.Scene, plan: Plan) -> dict[str, dict[str, Number]]:
    """Shares of every fraction in every bin."""
    return separate(scene, Pipeline(scene, plan).tracks().landings).fractions


def rows(path: Path, count: int) -> Iterator[str]:
    """Lines of the table for one scene, flown with ``count`` granules of each fraction."""
    scene = wf.Scene.load(path)
    scene = scene.replace({"feed.count": count} | ({"numerics.rung": "draft"} if scene.air else {}))
    ways = {mode: scene.replace({"feed.mode": mode}) for mode in ("injected", "resolved")}
    chosen, injected = make_plan(scene, force=BARE), make_plan(ways["injected"], force=BARE)
    forces = {name: how.forces for name, how in make_plan(ways["resolved"], force=BARE).fractions.items()}
    same = {name: replace(how, forces=forces[name]) for name, how in injected.fractions.items()}
    weighed, resolved = replace(injected, fractions=same), make_plan(ways["resolved"], force=BARE)
    found = [
        shares(ways["injected"], straight(weighed)),
        shares(ways["injected"], weighed),
        shares(ways["injected"], calm(weighed)),
        shares(ways["resolved"], calm(resolved)),
        shares(ways["resolved"], resolved),
    ]
    for name, how in chosen.fractions.items():
        turned = how.impaction
        air = "–" if turned is None else f"{turned.efficiency:.2f}, {turned.missed:.2f}, {turned.shift:.2g}"
        for place in found[0][name]:
            cells = [f"{100 * one[name][place].value:.1f}" for one in found]
            last = found[-1][name][place]
            if max(float(cell) for cell in cells) < 0.05:
                continue
            spread = 50 * (last.high - last.low)
            yield f"| {path.stem} | {name} | {air} | {how.mode} | {place} | {' | '.join(cells)} ± {spread:.1f} |"


def main(count: int, scenes: list[Path]) -> None:
    """Print the table of all ``scenes``."""
    titles = "scene | fraction | efficiency, missed, shift | plan | bin"
    print(f"| {titles} | straight | weighed | weighed, calm | resolved, calm | resolved |\n{10 * '|---'}|")
    for path in scenes:
        for line in rows(path, count):
            print(line, flush=True)


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["4096"])[0]), [Path(p) for p in sys.argv[2:]] or sorted(CASES.glob("*.toml")))
