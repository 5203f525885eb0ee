"""Injected granules next to resolved ones, for every scene in cases: bin shares, and what makes their difference.

Every fraction is flown with the same granules in the steady airflow (rung draft): *straight*, all by eq. (1)-(2) as if
there were no air before the body; *weighed*, as feed.mode = "injected" does it, with those that the air carries round
the body released above it; *resolved*, the tracker doing all impacts. *Calm*: without the random forces of the
turbulence. Straight to weighed is what the granules carried round make; calm weighed to calm resolved what the turning
of the rest makes; what else lies between weighed and resolved is turbulence before and at the slope. Some minutes of
one core with the airflows; docs/validation.md: injection_or_resolved 8192
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import wakeflow as wf
from support import CASES
from wakeflow.planning.plan import Plan

from .common import BARE, Pipeline, Row, make_plan, percent, separation, show

WAYS = ("straight", "weighed", "weighed, calm", "resolved, calm", "resolved")


def straight(plan: Plan) -> Plan:
    """The plan with every granule injected that would fall on the body without air."""
    return replace(plan, fractions={name: replace(how, impaction=None) for name, how in plan.fractions.items()})


def calm(plan: Plan) -> Plan:
    """The plan without dispersion and Brownian motion."""
    forces = {
        name: tuple(force for force in how.forces if force not in ("dispersion", "brownian"))
        for name, how in plan.fractions.items()
    }
    return replace(plan, fractions={n: replace(how, forces=forces[n]) for n, how in plan.fractions.items()})


def rows(path: Path, count: int) -> Iterator[Row]:
    """The rows of one scene, flown with ``count`` granules of each fraction."""
    scene = wf.Scene.load(path)
    scene = scene.replace({"feed.count": count} | ({"numerics.rung": "draft"} if scene.air else {}))
    injected, resolved = (scene.replace({"feed.mode": mode}) for mode in ("injected", "resolved"))
    chosen, plan, exact = (make_plan(one, force=BARE) for one in (scene, injected, resolved))
    forces = {name: how.forces for name, how in exact.fractions.items()}
    plan = replace(plan, fractions={n: replace(how, forces=forces[n]) for n, how in plan.fractions.items()})
    flights = (
        (injected, straight(plan)),
        (injected, plan),
        (injected, calm(plan)),
        (resolved, calm(exact)),
        (resolved, exact),
    )
    found = [separation(Pipeline(*flight)).fractions for flight in flights]
    for name, how in chosen.fractions.items():
        turned = how.impaction
        air = "–" if turned is None else f"{turned.efficiency:.2f}, {turned.missed:.2f}, {turned.shift:.2g}"
        for place, last in found[-1][name].items():
            cells = {way: f"{100 * one[name][place].value:.1f}" for way, one in zip(WAYS, found, strict=True)}
            if max(map(float, cells.values())) >= 0.05:
                yield {
                    "scene": path.stem, "fraction": name, "efficiency, missed, shift": air, "plan": how.mode,
                    "bin": place, **cells, "resolved": percent(last),
                }  # fmt: skip


def main(count: int = 4096, *scenes: Path) -> list[Row]:
    """Shares of injected and of resolved granules."""
    paths = scenes or sorted(CASES.glob("*.toml"))
    heads = ("scene", "fraction", "efficiency, missed, shift", "plan", "bin", *WAYS)
    return show(heads, (row for path in paths for row in rows(path, count)))
