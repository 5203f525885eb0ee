"""The budget: what each source of error contributes to an answer, and what knowing it cost in run time.

Measured here: sampling (spread of independent replicates) and integration (a companion run at a hundredth of the
tolerance). Each term that is left out is calibrated: the plan's bound on its landing shift times the landing density
that was found at a bin's ends. The rest is named and unknown, and so is the total: a sum that leaves parts out is no
total.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .gate import TYPICAL
from .pipeline import Chain
from .planning import LeftOut, Plan
from .scene import RESERVED_BIN, Scene
from .separation import Landings, separate

if TYPE_CHECKING:
    from .flight import Tracked

__all__ = ["FINER", "crossing_share", "free_ends", "left_out_terms", "make_budget", "together"]

Array = NDArray[np.float64]
FINER = 0.01  # tolerance of the companion run over the scene's: a tenth may give the same steps, cut at the cells
UNKNOWN_IN_AIR = ("mesh", "airflow-model")  # named in every budget, measured by none yet
WINDOW = 0.1  # body widths to each side of a bin's end over which the landing density is taken, or the shift if more


def _changed(bins: NDArray[Any], finer: NDArray[Any]) -> float:
    """Upper 95 % limit of the share of granules that the companion run puts into another bin."""
    return _upper(int(np.sum(bins != finer)), len(bins))


def _upper(count: int, total: int) -> float:
    """Upper 95 % limit (Wilson) of a share of which ``count`` of ``total`` were found."""
    from scipy.stats import binomtest

    return float(binomtest(count, total).proportion_ci(0.95, method="wilson").high)


def make_budget(chain: Chain, tracked: Tracked, separation: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows ``{quantity, parts, total}``: shares of every fraction and bin that got any, then landing places.

    Errors of shares are absolute; a row with a ``unit`` states its errors in that unit. The error of a landing place is
    the 95th percentile over the granules of how far the companion run moves them. A part that stands for a left-out
    term has a ``note`` and a ``kind``: left-out (small enough for the accuracy asked for) or not-computed.
    """
    finer = chain.tracks(FINER * chain.scene.numerics.tolerance)
    companion, cost = (chain.seconds[stage]["seconds"] for stage in ("companion", "tracks"))
    other = separate(chain.scene, finer.landings)
    unknown = () if chain.scene.air is None else UNKNOWN_IN_AIR
    if chain.plan.rung == "standard":
        unknown = ("airflow-statistics", *unknown)
    rest = [{"source": s, "error": None, "seconds": 0.0, "how": "unknown"} for s in (*unknown, "impact-parameters")]
    total = {"error": None, "seconds": cost + companion}
    rows, places = [], []
    for name, shares in separation["fractions"].items():
        landing, fine = tracked.landings[name], finer.landings[name]
        integration = {"source": "integration", "seconds": companion, "how": "companion"}
        changed = {**integration, "error": _changed(landing.bin, fine.bin)}
        terms = left_out_terms(chain.scene, chain.plan, name, landing)
        for place, share in shares.items():
            if share["share"] == other["fractions"][name][place]["share"] == 0.0:
                continue
            half = 0.5 * (share["high"] - share["low"])
            sampling = {"source": "sampling", "error": half, "seconds": cost, "how": "measured"}
            parts = [sampling, changed, *terms[place], *rest]
            rows.append({"quantity": f"share.{name}.{place}", "parts": parts, "total": dict(total)})
        shift = np.linalg.norm(landing.position - fine.position, axis=1) / chain.scene.width
        parts = [{**integration, "error": float(np.percentile(shift, 95))}]
        places.append({"quantity": f"landing.{name}", "unit": "body widths", "parts": parts, "total": dict(total)})
    return rows + places


def together(rows: Sequence[Mapping[str, Any]], target: float) -> list[str]:
    """A line for each fraction whose small terms, left out one by one, add up to more than the accuracy asked for."""
    worst: dict[str, tuple[float, str, str]] = {}
    for row in rows:
        small = [part for part in row["parts"] if part.get("kind") == "left-out"]
        error = TYPICAL * sum(part["error"] for part in small)
        name, _, place = row["quantity"].removeprefix("share.").partition(".")
        if error > max(target, worst[name][0] if name in worst else 0.0):
            worst[name] = error, place, max(small, key=lambda part: part["error"])["source"]
    return [
        f"{name}: the terms left out could change its share in {place} by {100 * error:.2g} points together, more than "
        f"the {100 * target:.2g} asked for; most by {most}"
        for name, (error, place, most) in worst.items()
    ]


# -- terms left out ----------------------------------------------------------------------------------------------------


def left_out_terms(scene: Scene, plan: Plan, name: str, landing: Landings) -> dict[str, list[dict[str, Any]]]:
    """Parts of the budget for every bin of fraction ``name``: what each left-out term could change its share by."""
    rows = [row for row in plan.left_out if row.fraction == name and row.bound is not None]
    ends = free_ends(scene)
    parts: dict[str, list[dict[str, Any]]] = {place: [] for place in [*scene.bin, RESERVED_BIN]}
    if not rows or not len(landing.bin):
        return parts
    limit = plan.fractions[name].limit or 0.0
    distance = {point: np.linalg.norm(landing.position - point, axis=1) / scene.width for point in _all(ends)}
    for row in rows:
        assert row.bound is not None
        moved = {point: crossing_share(away, row.bound) for point, away in distance.items()}
        for place, found in parts.items():
            error = min(1.0, sum(moved[point] for point in ends[place]))
            found.append(_part(row, error, "left-out" if row.bound <= limit else "not-computed"))
    return parts


def _part(row: LeftOut, error: float, kind: str) -> dict[str, Any]:
    note = f"a landing shift of at most {row.bound:.2g} body widths times the landing density at the bin's ends"
    return {"source": row.name, "error": error, "seconds": 0.0, "how": "calibrated", "kind": kind, "note": note}


def crossing_share(distance: Array, shift: float) -> float:
    """Share of granules that a landing ``shift`` (body widths) can carry over a bin's end ``distance`` (n,) from them.

    The shift times the density of landings there: granules within WINDOW on both sides, or within the shift where that
    is more (upper 95 % limit of their share), over that length.
    """
    window = max(WINDOW, shift)
    return shift * _upper(int(np.count_nonzero(distance <= window)), len(distance)) / (2.0 * window)


def free_ends(scene: Scene) -> dict[str, list[tuple[float, float]]]:
    """The ends (m) of every bin over which granules can pass: not those in the channel's corners at its walls, unless
    a bin stands on the wall beside; for ``elsewhere`` the ends that no two bins share.
    """
    channel, slack = scene.channel, 1e-9 * scene.channel.width
    walls = {b.on for b in scene.bin.values() if b.points is None} & {"left", "right"}
    ends: dict[str, list[tuple[float, float]]] = {}
    for place, collector in scene.bin.items():
        line = collector.line(channel)
        ends[place] = []
        for x, y in (line[0], line[-1]):
            side = "right" if x > 0 else "left"
            closed = collector.points is None and abs(x) >= channel.width / 2 - slack and side not in walls
            if not closed:
                ends[place].append((round(float(x), 9), round(float(y), 9)))
    every = list(_all(ends, repeated=True))
    ends[RESERVED_BIN] = [point for point in dict.fromkeys(every) if every.count(point) == 1]
    return ends


def _all(ends: Mapping[str, Sequence[tuple[float, float]]], *, repeated: bool = False) -> Iterator[tuple[float, float]]:
    points = [point for found in ends.values() for point in found]
    yield from points if repeated else dict.fromkeys(points)
