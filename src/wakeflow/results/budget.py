"""The budget: what each source of error contributes to an answer, and what knowing it cost in run time.

Measured: sampling (spread of independent replicates). By companions, the same granules flown again: integration (at a
hundredth of the tolerance), the airflow's model (in the steady wake and with less of the fluctuation) and the mesh
(on other grids). Calibrated: each term that is left out, by the plan's bound on its landing shift times the landing
density found at a bin's ends; the airflow's statistics, by what the fluctuation changes. The rest is named and unknown,
and so is the total: a sum that leaves parts out is no total.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..pipeline.landings import Landings
from ..pipeline.pipeline import Pipeline
from ..planning.airflow import SHEDDING_ABOVE
from ..planning.plan import Plan
from ..planning.terms import TYPICAL, LeftOut
from ..scene import RESERVED_BIN, Scene
from .companions import HALVED, Comparison, airflows, compared, differences, finer_steps, grids, mesh_error

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

__all__ = [
    "Companions",
    "crossing_share",
    "fly_companions",
    "free_ends",
    "left_out_terms",
    "make_budget",
    "together",
]

Array = NDArray[np.float64]
WINDOW = 0.1  # body widths to each side of a bin's end over which the landing density is taken, or the shift if more


def _changed(bins: NDArray[Any], finer: NDArray[Any]) -> float:
    """Upper 95 % limit of the share of granules that the companion run puts into another bin."""
    return _upper(int(np.sum(bins != finer)), len(bins))


def _upper(count: int, total: int) -> float:
    """Upper 95 % limit (Wilson) of a share of which ``count`` of ``total`` were found."""
    from scipy.stats import binomtest

    return float(binomtest(count, total).proportion_ci(0.95, method="wilson").high)


@dataclass(frozen=True)
class Companions:
    """Every comparison that the plan pays for, and what the integration of the steps and the tracks took (s)."""

    finer: Tracked
    seconds: float
    tracks: float
    airflows: Comparison | None
    grids: Comparison | None


def fly_companions(pipeline: Pipeline, tracked: Tracked) -> Companions:
    """Run the comparisons, or read them from the cache."""
    finer, seconds = finer_steps(pipeline)
    spent = pipeline.seconds["tracks"]["seconds"]
    return Companions(finer, seconds, spent, airflows(pipeline, tracked), grids(pipeline, tracked))


def make_budget(
    pipeline: Pipeline, tracked: Tracked, separation: dict[str, Any], others: Companions
) -> list[dict[str, Any]]:
    """Rows ``{quantity, parts, total}``: shares of every fraction and bin that got any, then landing places.

    Errors of shares are absolute; a row with a ``unit`` states its errors in that unit. The error of a landing place is
    the 95th percentile over the granules of how far the companion run moves them. A part that stands for a left-out
    term has a ``note`` and a ``kind``: left-out (small enough for the accuracy asked for) or not-computed.
    """
    total = {"error": None, "seconds": sum(spent["seconds"] for spent in pipeline.seconds.values())}
    rows, places = [], []
    for name, shares in separation["fractions"].items():
        landing, same, fine = tracked.landings[name], compared(tracked.landings[name]), others.finer.landings[name]
        integration = {"source": "integration", "seconds": others.seconds, "how": "companion"}
        changed = {**integration, "error": _changed(same.bin, fine.bin)}
        terms = left_out_terms(pipeline.scene, pipeline.plan, name, landing)
        for number, (place, share) in enumerate(shares.items()):
            parts = list(_airflow_parts(pipeline, others, name, number))
            if share["share"] == 0.0 and not any(part["error"] for part in parts):
                continue
            half = 0.5 * (share["high"] - share["low"])
            sampling = {"source": "sampling", "error": half, "seconds": others.tracks, "how": "measured"}
            parts = [sampling, changed, *terms[place], *parts, _unknown("impact-parameters")]
            rows.append({"quantity": f"share.{name}.{place}", "parts": parts, "total": dict(total)})
        shift = np.linalg.norm(same.position - fine.position, axis=1) / pipeline.scene.width
        parts = [{**integration, "error": float(np.percentile(shift, 95))}]
        cost = {"error": None, "seconds": others.tracks + others.seconds}
        places.append({"quantity": f"landing.{name}", "unit": pipeline.scene.unit, "parts": parts, "total": cost})
    return rows + places


def _unknown(source: str) -> dict[str, Any]:
    return {"source": source, "error": None, "seconds": 0.0, "how": "unknown"}


def _airflow_parts(pipeline: Pipeline, others: Companions, name: str, place: int) -> Iterator[dict[str, Any]]:
    """What the airflow contributes to the error of a share: its mesh, its model, its finite sample of the shedding."""
    if pipeline.scene.air is None:
        return
    if pipeline.plan.rung == "analytic":  # nothing is solved; how far a real duct's air is from it nobody says
        yield _unknown("airflow-model")
        return
    if others.grids is None:
        yield _unknown("mesh")
    else:
        found = mesh_error(others.grids, name, place)
        half = max(found.high - found.value, found.value - found.low)
        yield {"source": "mesh", "error": half, "seconds": others.grids.seconds, "how": "companion", "note": found.why}
    how = pipeline.plan.airflow
    if others.airflows is not None:
        yield from _model_parts(pipeline, others.airflows, name, place)
    elif how.rung == "given" or (how.stepping == "steady" and (pipeline.scene.reynolds or 0.0) >= SHEDDING_ABOVE):
        yield _unknown("airflow-model")
    if others.airflows is None and pipeline.airflow["period"] is not None:
        yield _unknown("airflow-statistics")


def _model_parts(pipeline: Pipeline, compared_: Comparison, name: str, place: int) -> Iterator[dict[str, Any]]:
    """The airflow's model: the farthest of the steady wake, the mean wake and half of the fluctuation. Its statistics:
    what the whole fluctuation changes more than half of it, per relative error of its strength.
    """
    moved = dict(differences(compared_, name, place))
    which = max(moved, key=lambda key: abs(moved[key]))
    note = f"farthest: {which} ({100 * moved[which]:+.2g} points)"
    yield {
        "source": "airflow-model", "error": abs(moved[which]), "seconds": compared_.seconds, "how": "companion",
        "note": note,
    }  # fmt: skip
    strength = pipeline.airflow["cl_rms"]
    relative = 0.5 * (strength["high"] - strength["low"]) / max(strength["value"], 1e-12)
    note = f"strength of the fluctuation (Cl rms) known within {100 * relative:.2g} %"
    yield {
        "source": "airflow-statistics", "error": min(1.0, 2.0 * abs(moved[HALVED]) * relative), "seconds": 0.0,
        "how": "calibrated", "note": note,
    }  # fmt: skip


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
    """Parts of the budget for every bin of fraction ``name``: what each left-out term could change its share by.

    The bound times the landing density at the bin's ends; without a body, where whole floor and top are bins and no end
    is near, a term that could matter counts by its bound, as of granules spread over one channel width.
    """
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
            kind = "left-out" if row.bound <= limit else "not-computed"
            if kind == "not-computed" and not scene.body:  # it may turn back a granule on its way to either end
                error = max(error, min(1.0, row.bound))
            found.append(_part(row, error, kind, scene.unit))
    return parts


def _part(row: LeftOut, error: float, kind: str, unit: str) -> dict[str, Any]:
    note = f"a landing shift of at most {row.bound:.2g} {unit} times the landing density at the bin's ends"
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
