"""kind = "levels": how fast granules of each fraction pass given heights, how far apart, and how much mass passes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import halved_all
from ...core.number import Number, student
from ...core.record import JsonTable
from ...scene.pictures import Levels
from ...show.asked_pictures import PictureFiles, View
from ...show.canvas import MM, fraction_colours, new_figure, save
from ...show.moving import Path2D, along

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
HALVINGS = 60  # of the time between two points: to its last digit
GROUPS = 16  # of granules, each of every 16th, whose means part by chance: what the intervals are made of


class Passages(NamedTuple):
    """Every passage of a level: the granule's number, where it passed (m), and its velocity (n, 2) m/s there."""

    granule: NDArray[np.int64]
    x: Array
    velocity: Array


# By name: the unit, and what it is of some passages, of which each granule brings so much mass in a second
QUANTITIES: dict[str, tuple[str, Callable[[Passages, float], float]]] = {
    "down": ("kg/s", lambda p, flow: flow * int((p.velocity[:, 1] < 0.0).sum())),
    "up": ("kg/s", lambda p, flow: flow * int((p.velocity[:, 1] >= 0.0).sum())),
    "vx": ("m/s", lambda p, _: _mean(p.velocity[:, 0])),
    "vy": ("m/s", lambda p, _: _mean(p.velocity[:, 1])),
    "x": ("m", lambda p, _: _mean(p.x)),
    "spread": ("m", lambda p, _: float(np.std(p.x)) if len(p.x) > 1 else math.nan),
}
DRAWN = {  # with the titles of their panels
    "down": "mass that passes\ndownward (kg/s)", "vy": "mean velocity\nupward (m/s)",
    "spread": "spread: standard\ndeviation of x (mm)",
}  # fmt: skip


def _mean(values: Array) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def passages(paths: Sequence[Path2D], level: float) -> Passages:
    """Where and how fast tracks pass y = ``level`` (m), upward or downward, as often as they do."""
    at = [np.flatnonzero(np.diff(path.position[:, 1] > level)) for path in paths]
    pieces = list(zip(paths, at, strict=True))
    cubics = np.concatenate([np.zeros((4, 0, 2)), *(path.cubics(i) for path, i in pieces)], axis=1)
    span = np.concatenate([np.zeros(0), *(np.diff(path.time)[i] for path, i in pieces)])
    begins_over = np.concatenate([np.zeros(0, dtype=bool), *(path.position[i, 1] > level for path, i in pieces)])

    def before(part: Array) -> NDArray[np.bool_]:
        return np.asarray((along(cubics, part, span)[0][:, 1] > level) == begins_over)

    _, part = halved_all(before, np.zeros(len(span)), np.ones(len(span)), HALVINGS)
    position, velocity = along(cubics, part, span)
    granule = np.repeat(np.arange(len(paths)), [len(i) for i in at])
    return Passages(granule, position[:, 0], velocity)


def level_numbers(paths: Sequence[Path2D], level: float, flow: float) -> dict[str, Number]:
    """The QUANTITIES of tracks that pass y = ``level`` (m), of which all together bring ``flow`` (kg/s), with their
    intervals by the granules' number; NaN where nobody passes.

    An interval is Student's, of the same quantity in GROUPS groups of the granules.
    """
    every = passages(paths, level)
    groups = min(GROUPS, max(1, len(paths)))
    parts = [Passages(*(column[every.granule % groups == group] for column in every)) for group in range(groups)]
    numbers = {}
    for name, (_, of) in QUANTITIES.items():
        value = of(every, flow / max(len(paths), 1))
        sizes = [len(range(group, len(paths), groups)) for group in range(groups)]
        spread = np.array([of(part, flow / max(size, 1)) for part, size in zip(parts, sizes, strict=True)])
        known = spread[np.isfinite(spread)]
        half = math.inf
        if len(known) > 2:
            half = student(len(known) - 1) * float(known.std(ddof=1)) / math.sqrt(len(known))
        numbers[name] = Number(value, value - half, value + half)
    return numbers


def draw_levels(view: View) -> PictureFiles:
    """Three panels over height, a line a fraction with its intervals: mass flow downward, mean velocity, spread."""
    picture, scene = view.picture, view.scene
    assert isinstance(picture, Levels)
    shares, levels = scene.mass_shares(), sorted(picture.levels)
    by_fraction = {
        name: [level_numbers(paths, y, scene.feed.mass_flow * shares[name]) for y in levels]
        for name, paths in view.paths.items()
    }
    figure = new_figure(9.0, 4.4)
    panels = figure.subplots(1, len(DRAWN), sharey=True)
    colours = fraction_colours(list(scene.fraction))
    for axes, quantity in zip(panels, DRAWN, strict=True):
        _panel(axes, quantity, levels, by_fraction, colours)
    panels[0].set_ylabel("y (mm)")
    panels[0].legend(frameon=False, fontsize=8)
    save(figure, view.file(".png"))
    data = view.write_csv(_columns(), _rows(levels, by_fraction))
    numbers: JsonTable = {
        "levels": levels,
        "fractions": {
            name: [{key: [_known(end) for end in number] for key, number in row.items()} for row in rows]
            for name, rows in by_fraction.items()
        },
    }
    return PictureFiles([view.file(".png"), data], _text(levels, by_fraction), numbers)


def _panel(
    axes: Axes, quantity: str, levels: Sequence[float], by_fraction: dict[str, list[dict[str, Number]]],
    colours: dict[str, str],
) -> None:  # fmt: skip
    factor = MM if QUANTITIES[quantity][0] == "m" else 1.0
    for name, rows in by_fraction.items():
        value, low, high = factor * np.array([[*row[quantity]] for row in rows]).T
        half = np.where(np.isfinite(high - low), 0.5 * (high - low), 0.0)
        axes.errorbar(
            value, MM * np.array(levels), xerr=half, color=colours[name], marker="o", markersize=3, linewidth=1.0,
            capsize=2, label=name,
        )  # fmt: skip
    axes.set_xlabel(DRAWN[quantity], fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(color="#dddddd", linewidth=0.5)


def _columns() -> tuple[str, ...]:
    ends = ("", " low", " high")
    return "fraction", "y (m)", *(f"{name}{end} ({unit})" for name, (unit, _) in QUANTITIES.items() for end in ends)


def _rows(levels: Sequence[float], numbers: dict[str, list[dict[str, Number]]]) -> Iterator[tuple[object, ...]]:
    for name, rows in numbers.items():
        for level, row in zip(levels, rows, strict=True):
            yield name, level, *(_known(end) for number in row.values() for end in number)


def _known(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _text(levels: Sequence[float], numbers: dict[str, list[dict[str, Number]]]) -> str:
    """How wide each fraction is at the highest and at the lowest level that it passes."""
    parts = []
    for name, rows in numbers.items():
        wide = [(y, row["spread"]) for y, row in zip(levels, rows, strict=True) if math.isfinite(row["spread"].value)]
        if len(wide) > 1:
            (low, below), (high, above) = wide[0], wide[-1]
            at = f"{MM * above.value:.3g} mm at y = {MM * high:.4g} mm, {MM * below.value:.3g} mm at {MM * low:.4g} mm"
            parts.append(f"{name} {at}")
    return f"Spread: {'; '.join(parts)}. Intervals: 95 %, by the number of granules." if parts else ""
