"""The ends of bins over which granules can pass."""

from __future__ import annotations

from collections.abc import Iterator

from ..scene import RESERVED_BIN, Scene

__all__ = ["BinEnds", "free_ends", "points_of"]

BinEnds = dict[str, list[tuple[float, float]]]  # m: the ends of every bin
SAME_PLACE = 1e-9  # channel widths: an end of a bin so near to a corner of the channel is in it
DIGITS = 9  # of a place in m: ends that agree in them are one end


def free_ends(scene: Scene) -> BinEnds:
    """The ends (m) of every bin over which granules can pass, and for ``elsewhere`` the ends that no two bins share.

    An end in a corner of the channel is closed by the wall, unless a bin stands on that wall.
    """
    channel, slack = scene.channel, SAME_PLACE * scene.channel.width
    walls = {b.on for b in scene.bin.values() if b.points is None} & {"left", "right"}
    ends: BinEnds = {}
    for place, collector in scene.bin.items():
        line = collector.line(channel)
        ends[place] = []
        for x, y in (line[0], line[-1]):
            side = "right" if x > 0 else "left"
            closed = collector.points is None and abs(x) >= channel.width / 2 - slack and side not in walls
            if not closed:
                ends[place].append((round(float(x), DIGITS), round(float(y), DIGITS)))
    every = list(points_of(ends, repeated=True))
    ends[RESERVED_BIN] = [point for point in dict.fromkeys(every) if every.count(point) == 1]
    return ends


def points_of(ends: BinEnds, *, repeated: bool = False) -> Iterator[tuple[float, float]]:
    """All ends, those that bins share once, or ``repeated`` as often as they are shared."""
    points = [point for found in ends.values() for point in found]
    yield from points if repeated else dict.fromkeys(points)
