"""The budget: what each source of error contributes to an answer, and what knowing it cost in run time.

Measured here: sampling (spread of independent replicates) and integration (a companion run at a tenth of the
tolerance). The rest is named and unknown, and so is the total: a sum that leaves parts out is no total.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .pipeline import Chain, Tracked
from .separation import separate

__all__ = ["FINER", "make_budget"]

FINER = 0.1  # tolerance of the companion run over the scene's
UNKNOWN = {
    "mesh": "airflow on one mesh only",
    "airflow-model": "turbulence model and two-dimensional wake",
    "left-out-forces": "bounds are in the plan",
    "impact-parameters": "restitution and friction as given",
}


def make_budget(chain: Chain, tracked: Tracked, separation: dict[str, Any]) -> list[dict[str, Any]]:
    """One row a fraction and bin with a noticeable share: ``{quantity, parts, total}``; errors are absolute shares."""
    finer = chain.tracks(FINER * chain.scene.numerics.tolerance)
    companion = chain.seconds["companion"]["seconds"]
    other = separate(chain.scene, finer.landings)
    cost = chain.seconds["tracks"]["seconds"]
    rows = []
    for name, shares in separation["fractions"].items():
        for place, share in shares.items():
            value = share["share"]
            change = abs(other["fractions"][name][place]["share"] - value)
            if value == 0.0 and change == 0.0:
                continue
            half = 0.5 * (share["high"] - share["low"])
            parts = [
                {"source": "sampling", "error": half, "seconds": cost, "how": "measured"},
                {"source": "integration", "error": change, "seconds": companion, "how": "companion"},
            ]
            skipped = ("mesh", "airflow-model") if chain.scene.air is None else ()
            parts += [
                {"source": source, "error": None, "seconds": 0.0, "how": "unknown"}
                for source in UNKNOWN
                if source not in skipped
            ]
            total = {"error": None, "seconds": cost + companion}
            rows.append({"quantity": f"share.{name}.{place}", "parts": parts, "total": total})
    return rows


def landing_shift(tracked: Tracked, finer: Tracked, width: float) -> dict[str, dict[str, float]]:
    """Median and 95th percentile of the landing shift between two runs of the same granules, in body widths."""
    rows = {}
    for name, landing in tracked.landings.items():
        shift = np.linalg.norm(landing.position - finer.landings[name].position, axis=1) / width
        rows[name] = {"median": float(np.median(shift)), "p95": float(np.percentile(shift, 95))}
    return rows
