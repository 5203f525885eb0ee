"""The picture of the compared trackers: error against run time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wakeflow.show.canvas import fraction_colours, new_figure, save

MARKERS = "os^Dv"


def draw(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write a PNG of ``rows`` (kind, air, method, cpu in s, median and p95 in body widths): median full, 95 % dotted.

    Processor time over all cores: what else the machine does disturbs it least. Settings are joined in their order.
    """
    groups = list(dict.fromkeys((row["kind"], row["air"]) for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    colours = fraction_colours(methods)
    across = min(4, max(1, len(groups)))
    down = -(-len(groups) // across)
    figure = new_figure(3.4 * across, 3.1 * down + 0.6)
    grid = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[len(groups) :]:
        axes.set_visible(False)
    for axes, (kind, air) in zip(grid.flat, groups, strict=False):
        for method, marker in zip(methods, MARKERS, strict=False):
            mine = [r for r in rows if (r["kind"], r["air"], r["method"]) == (kind, air, method)]
            for name, style in (("median", "-"), ("p95", ":")):
                points = np.array([(1e6 * r["cpu"], r[name]) for r in mine if r[name]])
                if len(points):
                    label = method if name == "median" else None
                    look = {"marker": marker, "ms": 3.5, "lw": 1.1, "color": colours[method]}
                    axes.plot(points[:, 0], points[:, 1], style, label=label, **look)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_title(f"{kind}, {air}", fontsize=9)
        axes.grid(alpha=0.3)
    for axes in grid[-1]:
        axes.set_xlabel("processor time of a granule, µs")
    for row in grid:
        row[0].set_ylabel("landing error, body widths")
    grid.flat[0].legend(fontsize=7)
    save(figure, path)
