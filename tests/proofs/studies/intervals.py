"""How long an interval of noise may be: granules of a scene's answer alone in its airflow, at shorter intervals.

One table a fraction: processor time and steps of a granule, its share in each bin, and by how many points the largest
change of a share is off the first row's, with its standard error. All rows fly the same granules with other noise.
intervals rhombus --repeats 16
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.flight import driver
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.planning.plan import REPLICATES

from .common import COARSE, Row, piped, show

NOISE = (driver.NOISE_STEP, 0.05, 0.02)
COLUMNS = {
    "fraction": "{name}", "interval": "{noise:g}", "us a granule": "{spent:.0f}", "steps": "{steps:.0f}",
    "shares, %": "{shares}", "largest change, points": "{change}",
}  # fmt: skip


def flown(flight: Flight, name: str, noise: float, repeats: int) -> Row:
    """All granules of a fraction, flown ``repeats`` times."""
    bins, streams = len(flight.scene.bin), range(repeats)
    feed = feedstock(flight.scene, flight.plan, name, flight.airs.period, range(REPLICATES))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "NOISE_STEP", noise)
        flight.fly(name, feed.granules[:2])  # compiles
        begun = time.process_time()
        tracks = [flight.fly(name, feed.granules, stream=int(1e6 * noise) + stream) for stream in streams]
        spent = time.process_time() - begun
    ended = np.concatenate([one.ends(bins)[0] for one in tracks])
    shares = np.bincount(ended[ended >= 0], minlength=bins) / len(ended)
    steps = np.mean([one.steps.mean() for one in tracks])
    return {"name": name, "noise": noise, "spent": 1e6 * spent / len(ended), "steps": steps, "found": shares,
            "error": np.sqrt(shares * (1.0 - shares) / len(ended))}  # fmt: skip


def rows(scene: wf.Scene, repeats: int) -> Iterator[Row]:
    """A row a fraction and length of the intervals."""
    pipeline = piped(scene)
    flight = Flight(scene, pipeline.plan, pipeline.air.realisations, scene.numerics.tolerance, workers=1)
    for name in scene.fraction:
        first: Row = {}
        for noise in NOISE:
            row = flown(flight, name, noise, repeats)
            first = first or row
            off = row["found"] - first["found"]
            worst = int(np.argmax(np.abs(off)))
            row["shares"] = " ".join(f"{100 * share:.2f}" for share in row["found"])
            error = 100 * np.hypot(row["error"][worst], first["error"][worst])
            row["change"] = "-" if row is first else f"{100 * off[worst]:+.2f} ± {error:.2f}"
            yield row


def main(scene: str = "rhombus", *, repeats: int = 16, coarse: bool = False) -> list[Row]:
    """Shares and cost at shorter intervals of noise; --coarse: on a coarse mesh."""
    loaded = shipped(scene)
    return show(COLUMNS, rows(loaded.replace(COARSE[scene]) if coarse else loaded, repeats))
