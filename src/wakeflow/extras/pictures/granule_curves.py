"""kind = "curves": one quantity of each granule over another, as the paper's Figs. 2-4 after the separation point."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.record import JsonTable
from ...flight.feed.first_contact import motion_of
from ...scene.pictures import Curves
from ...show.asked_pictures import PictureFiles, View
from ...show.canvas import MM, fraction_colours, new_figure, save
from ...show.moving import Path2D

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
CURVE_POINTS = 41  # of a curve
COLUMNS = ("fraction", "granule", "time (s)", "x (m)", "y (m)", "vx (m/s)", "vy (m/s)", "speed (m/s)")
LABELS = {  # quantity: place in COLUMNS, factor, name and unit
    "time": (2, MM, "time (ms)"),
    "x": (3, MM, "horizontal displacement x (mm)"),
    "y": (4, MM, "vertical displacement y (mm)"),
    "vx": (5, 1.0, "horizontal velocity (m/s)"),
    "vy": (6, 1.0, "vertical velocity (m/s)"),
    "speed": (7, 1.0, "speed (m/s)"),
}


@dataclass(frozen=True)
class _Curve:
    """One granule: rows (k, 6) of time, x, y, vx, vy and speed; where it ``ended``: time, x, vx at the drop."""

    fraction: str
    chosen: bool  # the granule that met the body at the speed asked for
    rows: Array
    met: float  # m/s: upward speed of the body where the curve begins; nan where that is no separation
    ended: tuple[float, ...]  # empty where it never falls so far


def draw_curves(view: View) -> PictureFiles:
    """Curves of all recorded granules, thin, and with ``body_speed`` that of one granule a fraction, thick."""
    picture = view.picture
    assert isinstance(picture, Curves)
    curves = [c for name, part in view.paths.items() for c in _curves(view, picture, name, part)]
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    _plot(axes, picture, curves, fraction_colours(list(view.scene.fraction)))
    numbers = _numbers(picture, curves)
    save(figure, view.file(".png"))
    data = view.write_csv(COLUMNS, _rows(curves))
    return PictureFiles([view.file(".png"), data], _text(picture, numbers), numbers)


def _curves(view: View, picture: Curves, name: str, paths: list[Path2D]) -> Iterator[_Curve]:
    """What there is of each granule of one fraction; none of those that never met a body, from the separation on."""
    scene, motion = view.scene, motion_of(view.scene)
    for i, path in enumerate(paths):
        first, origin, met, ended = 0, np.zeros(2), math.nan, tuple[float, ...]()
        if picture.origin == "separation":
            if not len(touches := path.touches(scene)):
                continue
            first = int(touches[-1])
            origin = path.position[first]
            met = float(motion.at(path.time[first], origin)[1][1])
        start, end = path.time[first], path.time[-1]
        if picture.drop and (down := path.falls_to(origin[1] - picture.drop, first)) < math.inf:
            end = down
            position, velocity = path.at(np.array([end]))
            ended = (float(end - start), float(position[0, 0] - origin[0]), float(velocity[0, 0]))
        times = np.linspace(start, end, CURVE_POINTS)
        position, velocity = path.at(times)
        columns = [times - path.time[first], position - origin, velocity, np.hypot(*velocity.T)]
        yield _Curve(name, picture.body_speed is not None and i == 0, np.column_stack(columns), met, ended)


def _plot(axes: Axes, picture: Curves, curves: list[_Curve], colours: dict[str, str]) -> None:
    (i, along, x_label), (j, up, y_label) = LABELS[picture.x], LABELS[picture.y]
    all_equal = picture.body_speed is None
    for curve in curves:
        thick = curve.chosen or (all_equal and sum(c.fraction == curve.fraction for c in curves) == 1)
        axes.plot(
            along * curve.rows[:, i - 2], up * curve.rows[:, j - 2], color=colours[curve.fraction],
            linewidth=2.4 if thick else 0.6, alpha=1.0 if thick else 0.35, zorder=4 if thick else 3,
        )  # fmt: skip
    for fraction in dict.fromkeys(curve.fraction for curve in curves):
        met = [curve.met for curve in curves if curve.chosen and curve.fraction == fraction]
        note = f", met at {met[0]:.3g} m/s" if met and math.isfinite(met[0]) else ""
        axes.plot([], [], color=colours[fraction], linewidth=2.4, label=f"{fraction}{note}")
    if picture.body_speed is not None:
        axes.plot([], [], color="#555555", linewidth=0.6, label="other phases of the vibration")
    if picture.y == "y" and picture.x == "x":
        axes.set_aspect("equal")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.legend(frameon=False, fontsize=8)
    axes.tick_params(labelsize=8)
    where = "after the separation point" if picture.origin == "separation" else ""
    if picture.drop:
        where += f", down to {MM * picture.drop:g} mm below it"
    axes.set_title(f"Granules {where}".strip(), fontsize=9, loc="left")


def _rows(curves: list[_Curve]) -> Iterator[tuple[object, ...]]:
    count: dict[str, int] = {}
    for curve in curves:
        number = count[curve.fraction] = count.get(curve.fraction, 0) + 1
        for row in curve.rows:
            yield curve.fraction, "chosen" if curve.chosen else str(number), *map(float, row)


def _numbers(picture: Curves, curves: list[_Curve]) -> dict[str, object]:
    """Numbers at the drop: time, x, vx of each fraction's chosen granule, the range of x over all; the ratio of x."""
    if not picture.drop:
        return {}
    table: JsonTable = {"drop": picture.drop, "fractions": {}}
    for name in dict.fromkeys(curve.fraction for curve in curves):
        here = [curve for curve in curves if curve.fraction == name]
        reached = [abs(curve.ended[1]) for curve in here if curve.ended and not curve.chosen]
        row: JsonTable = {"granules": len(reached)}
        if reached:
            row["x"] = {"low": min(reached), "mean": float(np.mean(reached)), "high": max(reached)}
        for curve in here:
            if curve.chosen and curve.ended:
                time, x, vx = curve.ended
                speed = None if math.isnan(curve.met) else curve.met
                row["chosen"] = {"body_speed": speed, "time": time, "x": x, "vx": vx}
        table["fractions"][name] = row
    table["ratio"] = _ratio([abs(row["chosen"]["x"]) for row in table["fractions"].values() if "chosen" in row])
    table["ratio_of_means"] = _ratio([row["x"]["mean"] for row in table["fractions"].values() if "x" in row])
    return table


def _ratio(values: list[float]) -> float | None:
    """The largest over the smallest of at least two."""
    return max(values) / min(values) if len(values) > 1 and min(values) > 0 else None


def _text(picture: Curves, numbers: JsonTable) -> str:
    if not numbers:
        return ""
    rows = numbers["fractions"]
    parts = [f"{MM * numbers['drop']:g} mm below the separation point"]
    chosen = [f"{name} {MM * abs(row['chosen']['x']):.1f} mm" for name, row in rows.items() if "chosen" in row]
    if chosen:
        parts.append(f"met at {picture.body_speed:g} m/s: {', '.join(chosen)}{_times(numbers['ratio'])}")
    spread = [
        f"{name} {MM * row['x']['low']:.0f} to {MM * row['x']['high']:.0f} mm"
        for name, row in rows.items()
        if "x" in row
    ]
    parts.append(f"over all phases: {', '.join(spread)}{_times(numbers['ratio_of_means'], 'their means ')}")
    return "; ".join(parts) + "."


def _times(ratio: float | None, what: str = "") -> str:
    return "" if ratio is None else f" ({what}{ratio:.2f} to 1)"
