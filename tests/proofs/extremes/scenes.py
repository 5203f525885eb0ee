"""Rows of whole scenes in a vacuum: the chain of impacts as the answer, and a feed of 50 t/h."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from functools import partial

from wakeflow.core.graded import Grade
from wakeflow.labyrinth import chain
from wakeflow.results.crowd_sources import SlabStep
from wakeflow.verify.extreme_scenes import DENSE, Options, happened_in, run_in, shipped_scene
from wakeflow.verify.extremes import Happened, add_row


def _beside_the_chain(name: str, changes: Options) -> Happened:
    """The tracker's shares beside those of ballistic flights from impact to impact, of the same granules."""
    scene = shipped_scene("vacuum").replace({"feed.count": 1024, **changes})
    result, alone = run_in(name, scene), chain(scene)
    errors = [abs(result.share(f, b)[0] - alone.share(f, b)[0]) for f in scene.fraction for b in scene.bin]
    return happened_in(scene, result, max(errors))


CHAIN = "the chain: parabolas from impact to impact, without the tracker"
for _group, _value, _name, _changes in (
    ("Gamma", "50, the scene `vacuum`", "gamma-50", {"vibration.amplitude": None, "vibration.gamma": 50.0}),
    ("restitution", "0 and 1, the scene `vacuum`", "restitution",
     {"fraction.soft.restitution": 0.0, "fraction.hard.restitution": 1.0}),
    ("feed", "1 g/h, the scene `vacuum`", "one-gram", {"feed.rate": "1 g/hour"}),
):  # fmt: skip
    add_row(_group, _value, partial(_beside_the_chain, _name, _changes), CHAIN, unit="share", allowed=1e-3)


def _dense_feed() -> Happened:
    """More than can be simulated one by one: collisions are left out, and the run says what that voids."""
    scene = shipped_scene("vacuum").replace({"feed.count": 1024, **DENSE})
    result, alone = run_in("fifty-tonnes", scene), chain(scene)
    errors = [abs(result.share(f, b)[0] - alone.share(f, b)[0]) for f in scene.fraction for b in scene.bin]
    voids = (grade == Grade.VOID.value for grade in result.grades)
    told = [text for text, void in zip(result.warnings, voids, strict=True) if void]
    return happened_in(scene, result, max(errors) if told else math.inf, "; ".join(told))


def _dense_slab() -> Happened:
    """Over a machine of 5 m, where a slab of five diameters can be simulated; beside itself in steps twice as long."""
    changes = {"feed.count": 16, **DENSE, "feed.depth": "5 m", "collisions.depth": "10 mm"}
    scene = shipped_scene("vacuum").replace(changes)
    result = run_in("fifty-tonnes-slab", scene)
    parts = [part for row in result.budget if row.quantity.startswith("share.") for part in row.parts]
    errors = [part.error for part in parts if part.source == SlabStep.name and part.error is not None]
    assert result.landings is not None
    assert result.landings.slab is not None
    slab = result.landings.slab
    met = ", ".join(f"{name} {number:.0f}" for name, number in slab.meetings.items())
    note = "; ".join([f"meetings of a granule: {met}", *result.warnings])
    ended: Counter[str] = sum((Counter(counted) for counted in slab.fates.values()), Counter())
    return replace(happened_in(scene, result, max(errors), note), injected=sum(slab.granules.values()), fates=ended)


add_row("feed", "50 t/h, the scene `vacuum`", _dense_feed, f"{CHAIN}; and a warning that it voids the shares",
     unit="share", allowed=1e-3)  # fmt: skip
add_row("feed", "50 t/h over 5 m, a slab of 10 mm", _dense_slab, "the run's budget: steps twice as long", unit="share",
     allowed=0.03, slow=True)  # fmt: skip
