"""Error against run time of one scene, a line a knob: picture and table."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..core.files import atomic_write
from .canvas import new_figure, save
from .colours import COLOURS

__all__ = ["draw_knobs", "write_knobs"]

HEADS = ("knob", "setting", "error", "half", "seconds")
MARKERS = "os^Dv*"
LEAST = 1e-5  # of a share: an error that is drawn no smaller


def draw_knobs(path: Path, rows: Sequence[Mapping[str, Any]], title: str) -> None:
    """Write ``path`` as PNG and beside it as SVG: the error of each setting of a knob full, from the coarsest setting
    to the finest, what the run says of itself dotted, in percentage points over seconds.
    """
    figure = new_figure(7.0, 4.0)
    axes = figure.add_subplot(xlabel="run time, s", ylabel="largest error of a bin share, points", title=title)
    for number, knob in enumerate(dict.fromkeys(row["knob"] for row in rows)):
        mine = [row for row in rows if row["knob"] == knob]
        seconds = [row["seconds"] for row in mine]
        look: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            "marker": MARKERS[number % len(MARKERS)],
            "ms": 4.0,
        }
        axes.plot(seconds, [100 * max(row["error"], LEAST) for row in mine], "-", label=knob, **look)
        if all(row["half"] is not None for row in mine):
            axes.plot(seconds, [100 * max(row["half"], LEAST) for row in mine], ":", alpha=0.7, **look)
    for style, told in (("-", "error, against the reference"), (":", "half of its own interval")):
        axes.plot([], [], style, color="0.4", label=told)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7.5, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    save(figure, path)


def write_knobs(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the same as CSV: errors and half widths as shares, seconds."""
    with atomic_write(path) as stream:
        writer = csv.DictWriter(stream, HEADS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
