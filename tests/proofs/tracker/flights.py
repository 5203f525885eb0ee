"""The tracker as the answer flies it: with all forces of the plan, eddies too, at several tolerances.

Every tolerance flies the same granules through the same noise: their landings differ by errors of integration alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from proofs.report import Tell
from proofs.tracker.curves import timed
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.core.record import JsonTable
from wakeflow.flight import Granules, Tracks
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.planning.plan import REPLICATES
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
REFERENCE = 1e-7  # the tolerance that landings are compared with
ASIDE = 1e-9  # body widths: how far aside of its release a granule is released again, to see what no tolerance mends
WANTED = 1e-2  # the tolerance that scenes ask for
FEW, MANY = 256, 4096  # granules of a kind, in the quick comparison and in the slow one
REPEATS = 3  # of a timed flight
FLOWN = {  # name: (fraction of the scene, changes of the scene)
    "wheat": ("wheat", {}),
    "chaff": ("chaff", {}),
    "dust 20 um": ("dust", {"fraction.dust.size": "20 um"}),
    "dust 1 um": ("dust", {"fraction.dust.size": "1 um"}),
}
COLUMNS = {
    "granule": "{kind}", "air": "{air}", "tolerance": "{tolerance:.0e}", "median": "{median:.1e}", "95 %": "{p95:.1e}",
    "aside, 95 %": "{aside:.1e}", "in another bin, %": "{moved:.2f*100}",
    "largest change, points": "{change:+.2f*100} ± {sampling:.2f*100}", "CPU us": "{cpu:.3g*1e6}",
    "steps": "{steps:.0f}", "evaluations": "{evaluations:.0f}",
}  # fmt: skip


@dataclass(frozen=True)
class FlownKind:
    """Granules of one kind, as they are released, and their flight through one airflow."""

    kind: str
    air: str
    fraction: str
    flight: Flight
    grains: Granules

    def fly(self, tolerance: float, workers: int | None = None, aside: float = 0.0) -> Tracks:
        """All granules, with the same noise at any tolerance, released ``aside`` (body widths) of where they are."""
        flight = replace(self.flight, tolerance=tolerance, workers=workers)
        moved = self.grains.position + np.array([aside * self.flight.scene.width, 0.0])
        return flight.fly(self.fraction, self.grains.replace(position=moved))

    def apart(self, tracks: Tracks, other: Tracks) -> NDArray[np.float64]:
        """How far apart (body widths) each granule ends in two flights."""
        return np.asarray(np.linalg.norm(tracks.position - other.position, axis=1) / self.flight.scene.width)

    def with_forces(self, known: Collection[str]) -> FlownKind:
        """The same granules with those of their forces that are ``known``."""
        plan = self.flight.plan
        own = plan.fractions[self.fraction]
        fewer = replace(own, forces=tuple(force for force in own.forces if force in known))
        plan = replace(plan, fractions={**plan.fractions, self.fraction: fewer})
        return replace(self, flight=replace(self.flight, plan=plan))

    def cost(self, tolerance: float) -> float:
        """Processor seconds of a flight on one thread."""
        return timed(lambda: self.fly(tolerance, 1), REPEATS)[1] / len(self.grains)


def flown_kinds(scene: Scene, airs: Mapping[str, FlowField], granules: int) -> Iterator[FlownKind]:
    """About so many ``granules`` of every kind in every airflow, with the forces that the scene's plan chooses."""
    for kind, (fraction, changes) in FLOWN.items():
        changed = scene.replace({**changes, "feed.count": granules})
        plan = make_plan(changed)
        for air, field in airs.items():
            grains = feedstock(changed, plan, fraction, field.period, range(REPLICATES)).granules
            yield FlownKind(kind, air, fraction, Flight(changed, plan, Realisations(field), REFERENCE), grains)


def flight_rows(one: FlownKind, tell: Tell) -> Iterator[JsonTable]:
    """A row a tolerance: how far landings lie from those of the reference (body widths), which granules change their
    bin, processor seconds, steps and evaluations of a granule, and the mean time of a flight (s).
    """
    tell(f"{one.kind}, {one.air}, all forces: tolerance {REFERENCE:.0e}")
    scene, grains = one.flight.scene, one.grains
    reference = one.fly(REFERENCE)
    for tolerance in TOLERANCES:
        tell(f"{one.kind}, {one.air}, all forces: tolerance {tolerance:.0e}")
        tracks = one.fly(tolerance, 1)
        off, aside = one.apart(tracks, reference), one.apart(tracks, one.fly(tolerance, aside=ASIDE))
        yield {
            "kind": one.kind, "air": one.air, "tolerance": tolerance, "count": len(grains),
            "median": float(np.median(off)), "p95": float(np.percentile(off, 95)),
            "aside": float(np.percentile(aside, 95)), **exchanged(tracks, reference, len(scene.bin)),
            "cpu": one.cost(tolerance), "steps": float(tracks.steps.mean()),
            "evaluations": float(tracks.evaluations.mean()), "flight": float((reference.time - grains.time).mean()),
        }  # fmt: skip


def exchanged(tracks: Tracks, reference: Tracks, bins: int) -> JsonTable:
    """The share of granules that ended in another bin, the largest change of a bin's share, and its standard error:
    that of the mean over the granules' own differences.
    """
    here, there = tracks.ends(bins)[0], reference.ends(bins)[0]
    places = np.arange(-1, bins)[:, None]
    own = (here == places).astype(float) - (there == places)
    change = own.mean(axis=1)
    worst = int(np.argmax(np.abs(change)))
    error = float(own[worst].std() / np.sqrt(len(here)))
    return {"moved": float((here != there).mean()), "change": float(change[worst]), "sampling": error}
