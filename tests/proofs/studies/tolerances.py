"""What the tracker's tolerance buys: a scene's granules alone in its airflow, at several tolerances.

One table a fraction: processor time, steps and evaluations of a granule, the median and the 95 % quantile of how far
landings lie from those at a tolerance of 1e-6, and the largest change of a share, with the standard error that the
granules which changed their bin leave it. All rows fly the same granules through the same noise.
tolerances rhombus --granules 4096
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.injection.feed import feedstock
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.plan import REPLICATES
from wakeflow.tracking import Granules, Tracks

from .common import COARSE, Row, piped, show

TOLERANCES = (1e-2, 3e-3, 1e-3, 1e-4, 1e-5)
REFERENCE = 1e-6
COLUMNS = {
    "fraction": "{name}", "tolerance": "{tolerance:.0e}", "us a granule": "{spent:.0f}", "steps": "{steps:.0f}",
    "evaluations": "{looks:.0f}", "error, median": "{off[0]:.1e}", "95 %": "{off[1]:.1e}", "shares, %": "{shares}",
    "largest change, points": "{change:+.2f} ± {error:.2f}",
}  # fmt: skip


def flown(scene: wf.Scene, flight: Flight, name: str, grains: Granules, tolerance: float) -> tuple[Tracks, float]:
    """All granules, in one thread, and the processor time (s)."""
    one = Flight(scene, flight.plan, flight.airs, tolerance, workers=1)
    one.fly(name, grains[:2])  # compiles
    begun = time.process_time()
    tracks = one.fly(name, grains)
    return tracks, time.process_time() - begun


def rows(scene: wf.Scene, granules: int) -> Iterator[Row]:
    """A row a fraction and tolerance."""
    pipeline = piped(scene)
    flight = Flight(scene, pipeline.plan, pipeline.kind.realisations, REFERENCE)
    bins = len(scene.bin)
    for name in scene.fraction:
        whole = feedstock(scene, flight.plan, name, flight.airs.period, range(REPLICATES)).granules
        grains = whole[:: max(1, len(whole) // granules)]
        reference, _ = flown(scene, flight, name, grains, REFERENCE)
        known = np.bincount(reference.ends(bins)[0] % (bins + 1), minlength=bins + 1) / len(grains)
        for tolerance in TOLERANCES:
            tracks, spent = flown(scene, flight, name, grains, tolerance)
            moved = int(np.sum(tracks.ends(bins)[0] != reference.ends(bins)[0]))
            off = np.linalg.norm(tracks.position - reference.position, axis=1) / scene.width
            shares = np.bincount(tracks.ends(bins)[0] % (bins + 1), minlength=bins + 1) / len(grains)
            worst = int(np.argmax(np.abs(shares - known)))
            yield {
                "name": name, "tolerance": tolerance, "spent": 1e6 * spent / len(grains),
                "steps": tracks.steps.mean(), "looks": tracks.evaluations.mean(), "off": np.quantile(off, [0.5, 0.95]),
                "shares": " ".join(f"{100 * share:.2f}" for share in shares[:bins]),
                "change": 100 * (shares - known)[worst], "error": 100 * np.sqrt(moved) / len(grains),
            }  # fmt: skip


def main(scene: str = "rhombus", *, granules: int = 4096, coarse: bool = False) -> list[Row]:
    """Cost and error at several tolerances; --coarse: on a coarse mesh."""
    loaded = shipped(scene)
    return show(COLUMNS, rows(loaded.replace(COARSE[scene]) if coarse else loaded, granules))
