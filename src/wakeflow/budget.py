"""The budget: what each source of error contributes to an answer, and what knowing it cost in run time.

Measured here: sampling (spread of independent replicates) and integration (a companion run at a hundredth
of the tolerance). The rest is named and unknown, and so is the total: a sum that leaves parts out is no total.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .pipeline import Chain
from .separation import separate

if TYPE_CHECKING:
    from .flight import Tracked

__all__ = ["FINER", "make_budget"]

FINER = 0.01  # tolerance of the companion run over the scene's: a tenth may give the same steps, cut at the cells
UNKNOWN_IN_AIR = ("mesh", "airflow-model", "left-out-forces")  # named in every budget, measured by none yet


def _changed(bins: NDArray[np.int64], finer: NDArray[np.int64]) -> float:
    """Upper 95 % limit of the share of granules that the companion run puts into another bin."""
    from scipy.stats import binomtest

    limit = binomtest(int(np.sum(bins != finer)), len(bins)).proportion_ci(0.95, method="wilson")
    return float(limit.high)


def make_budget(chain: Chain, tracked: Tracked, separation: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows ``{quantity, parts, total}``: shares of every fraction and bin that got any, then landing places.

    Errors of shares are absolute; a row with a ``unit`` states its errors in that unit. The error of a landing place is
    the 95th percentile over the granules of how far the companion run moves them.
    """
    finer = chain.tracks(FINER * chain.scene.numerics.tolerance)
    companion = chain.seconds["companion"]["seconds"]
    other = separate(chain.scene, finer.landings)
    cost = chain.seconds["tracks"]["seconds"]
    changed = {name: _changed(row.bin, finer.landings[name].bin) for name, row in tracked.landings.items()}
    left_out = () if chain.scene.air is None else UNKNOWN_IN_AIR
    if chain.plan.rung == "standard":
        left_out = ("airflow-statistics", *left_out)
    rows = []
    for name, shares in separation["fractions"].items():
        for place, share in shares.items():
            if share["share"] == other["fractions"][name][place]["share"] == 0.0:
                continue
            half = 0.5 * (share["high"] - share["low"])
            parts = [
                {"source": "sampling", "error": half, "seconds": cost, "how": "measured"},
                {"source": "integration", "error": changed[name], "seconds": companion, "how": "companion"},
            ]
            parts += [
                {"source": source, "error": None, "seconds": 0.0, "how": "unknown"}
                for source in (*left_out, "impact-parameters")
            ]
            total = {"error": None, "seconds": cost + companion}
            rows.append({"quantity": f"share.{name}.{place}", "parts": parts, "total": total})
    for name, landing in tracked.landings.items():
        shift = np.linalg.norm(landing.position - finer.landings[name].position, axis=1) / chain.scene.width
        error = float(np.percentile(shift, 95))
        part = {"source": "integration", "error": error, "seconds": companion, "how": "companion"}
        total = {"error": None, "seconds": cost + companion}
        rows.append({"quantity": f"landing.{name}", "unit": "body widths", "parts": [part], "total": total})
    return rows
