"""Terms that are left out: what each could change a share by.

The plan bounds how far each term could move a landing. That bound times the landing density found at a bin's ends is
what it could change the bin's share by.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..pipeline.landings import Landings
from ..planning.plan import Plan
from ..planning.terms import LeftOut
from ..scene import RESERVED_BIN, Scene
from .landing_results import CALIBRATED, LEFT_OUT, NOT_COMPUTED, BudgetPart
from .separation import upper_limit

__all__ = ["crossing_share", "free_ends", "left_out_terms"]

Array = NDArray[np.float64]
Ends = dict[str, list[tuple[float, float]]]  # m: the ends of every bin
WINDOW = 0.1  # body widths to each side of a bin's end over which the landing density is taken, or the shift if more
SAME_PLACE = 1e-9  # channel widths: an end of a bin so near to a corner of the channel is in it
DIGITS = 9  # of a place in m: ends that agree in them are one end


def left_out_terms(scene: Scene, plan: Plan, name: str, landing: Landings) -> dict[str, list[BudgetPart]]:
    """Parts of the budget for every bin of fraction ``name``: what each left-out term could change its share by.

    It is the bound times the landing density at the bin's ends. Without a body the whole floor and top are bins and no
    end is near; there a term that could matter counts by its bound, as for granules spread over one channel width.
    """
    rows = [row for row in plan.left_out if row.fraction == name and row.bound is not None]
    ends = free_ends(scene)
    parts: dict[str, list[BudgetPart]] = {place: [] for place in [*scene.bin, RESERVED_BIN]}
    if not rows or not len(landing.bin):
        return parts
    limit = plan.fractions[name].limit or 0.0
    distance = {point: np.linalg.norm(landing.position - point, axis=1) / scene.width for point in _all(ends)}
    for row in rows:
        assert row.bound is not None
        moved = {point: crossing_share(away, row.bound, landing.weight) for point, away in distance.items()}
        for place, found in parts.items():
            error = min(1.0, sum(moved[point] for point in ends[place]))
            kind = LEFT_OUT if row.bound <= limit else NOT_COMPUTED
            if kind == NOT_COMPUTED and not scene.body:  # it may turn back a granule on its way to either end
                error = max(error, min(1.0, row.bound))
            found.append(_part(row, error, kind, scene.unit))
    return parts


def _part(row: LeftOut, error: float, kind: str, unit: str) -> BudgetPart:
    note = f"a landing shift of at most {row.bound:.2g} {unit} times the landing density at the bin's ends"
    return BudgetPart(row.name, error, 0.0, CALIBRATED, kind, note)


def crossing_share(distance: Array, shift: float, weight: Array | None = None) -> float:
    """Share of granules that a landing ``shift`` (body widths) can carry over a bin's end ``distance`` (n,) from them.

    The shift times the density of landings there: granules within WINDOW on both sides, or within the shift where that
    is more (upper 95 % limit of their share), over that length. ``weight`` (n,) of each, by default 1.
    """
    window = max(WINDOW, shift)
    each = np.ones(len(distance)) if weight is None else weight
    near, total = round(float(each[distance <= window].sum())), round(float(each.sum()))
    return shift * upper_limit(near, total) / (2.0 * window)


def free_ends(scene: Scene) -> Ends:
    """The ends (m) of every bin over which granules can pass, and for ``elsewhere`` the ends that no two bins share.

    An end in a corner of the channel is closed by the wall, unless a bin stands on that wall.
    """
    channel, slack = scene.channel, SAME_PLACE * scene.channel.width
    walls = {b.on for b in scene.bin.values() if b.points is None} & {"left", "right"}
    ends: Ends = {}
    for place, collector in scene.bin.items():
        line = collector.line(channel)
        ends[place] = []
        for x, y in (line[0], line[-1]):
            side = "right" if x > 0 else "left"
            closed = collector.points is None and abs(x) >= channel.width / 2 - slack and side not in walls
            if not closed:
                ends[place].append((round(float(x), DIGITS), round(float(y), DIGITS)))
    every = list(_all(ends, repeated=True))
    ends[RESERVED_BIN] = [point for point in dict.fromkeys(every) if every.count(point) == 1]
    return ends


def _all(ends: Mapping[str, Sequence[tuple[float, float]]], *, repeated: bool = False) -> Iterator[tuple[float, float]]:
    points = [point for found in ends.values() for point in found]
    yield from points if repeated else dict.fromkeys(points)
