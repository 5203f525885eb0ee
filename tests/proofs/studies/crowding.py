"""The plan's estimate of collisions and its bound on what they change, next to slabs that were flown.

Collisions are those with granules of any mass that are simulated one by one; the change is that of the share, in any
bin, which changes most between granules that meet and granules alone, with its sampling error. The bound holds where
the change does not exceed it by more than sampling explains. Some minutes a scene; docs/validation.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from support import shipped
from wakeflow.planning.meetings import encounters
from wakeflow.planning.terms import COLLISIONS, limit_of
from wakeflow.statistics.separation import separate

from .common import COARSE, HOUR, MEET, Row, collisions_of, piped, separation, show

RATES = (20.0, 100.0, 500.0)  # kg/h
COUNT = 1024  # granules of the fraction of most mass
COLUMNS = {
    "scene": "{scene}", "kg/h": "{rate:g}", "fraction": "{fraction}", "collisions counted": "{counted:.2g}",
    "estimated": "{estimated:.2g}",
    "largest change of a share, points": "{change:.1f*100} ± {error:.1f*100}",
    "bound": "{bound:.2g*100}{holds:| **exceeded**}",
}  # fmt: skip


def rows(which: str, rates: Sequence[float] = RATES, count: int = COUNT) -> Iterator[Row]:
    """A row for every fraction and rate of one of the COARSE scenes."""
    for rate in rates:
        scene = shipped(which, {"feed.count": count, "feed.rate": rate / HOUR, **COARSE[which]})
        pipeline = piped(scene, force=MEET)
        plan, crowd = pipeline.plan, pipeline.crowd()
        met, alone = separate(scene, crowd.landings), separation(pipeline)
        one_by_one = [name for name in scene.fraction if not plan.crowd.tracers[name]]
        found = encounters(scene, {name: (how.drag, how.drag_scale) for name, how in plan.fractions.items()})
        for name, landing in crowd.landings.items():
            pairs = [(met.fractions[name][place], alone.fractions[name][place]) for place in met.bins]
            change, error = max((abs(a.value - b.value), (a.half**2 + b.half**2) ** 0.5) for a, b in pairs)
            bound = min(1.0, plan.fractions[name].bounds[COLLISIONS] / limit_of(scene, 1.0))
            yield {
                "scene": which, "rate": rate, "fraction": name, "counted": collisions_of(landing),
                "estimated": sum(found[name].by[other] for other in one_by_one), "change": change, "error": error,
                "bound": bound, "holds": change - error <= bound,
            }  # fmt: skip


def main(*scenes: str, count: int = COUNT) -> list[Row]:
    """Collisions estimated and flown: rhombus, prism, labyrinth, aspirator, vacuum."""
    return show(COLUMNS, (row for which in scenes or COARSE for row in rows(which, count=count)))
