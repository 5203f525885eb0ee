"""kind = "animation": granules on the moving body in time, a GIF and a strip of stills, as the paper's Figs. 5-6."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.files import atomic_write
from ...core.geometry import distance_to
from ...core.record import JsonTable
from ...scene.pictures import Animation
from ..canvas import INK, MM, Window, fraction_colours, new_figure, save
from ..moving import MovingMachine, Path2D, body_displacement, gif_of, picture_of
from .view import PictureFiles, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL import Image

    from ...scene import Scene

Array = NDArray[np.float64]
TALL, WIDEST = 2.9, 11.0  # inches: height of a frame of the GIF, width of the strip
STILL = 5.0  # square inches of a still
PLAYED = 15.0  # frames a second of the GIF
SCREEN = 100  # dots an inch of the GIF
TRAIL = 600  # points of a granule's trail
VISIBLE = 0.012  # of the window's width: radius of the smallest disc drawn
COLUMNS = ("time (s)", "fraction", "granule", "x (m)", "y (m)", "vx (m/s)", "vy (m/s)", "body x (m)", "body y (m)")


@dataclass(frozen=True)
class _Actor:
    """One granule: its fraction and path; ``late`` (s) later on its own clock than on the picture's; when it left the
    body for good (s on the picture's clock, None: never), and how far off the body it hopped before (m).
    """

    fraction: str
    number: int
    path: Path2D
    late: float
    rides: bool  # it ends its track on the body and goes on with it
    leaves: float | None
    hop: float

    def at(self, scene: Scene, time: Array) -> tuple[Array, Array]:
        """Positions (k, 2) and velocities (k, 2) on the picture's clock; after its track it stays where it ended."""
        position, velocity = self.path.at(time + self.late)
        over = time + self.late > self.path.time[-1]
        velocity[over] = 0.0
        if self.rides:
            end = body_displacement(scene, self.path.time[-1:])
            position[over] += body_displacement(scene, time[over] + self.late) - end
        return position, velocity


def draw_animation(view: View) -> PictureFiles:
    """Granules on the bodies: PNG strip of stills, GIF of all frames, CSV of what they show."""
    picture, scene = view.picture, view.scene
    assert isinstance(picture, Animation)
    actors = [
        _actor(scene, name, i + 1, path)
        for name, part in _spread(view.paths, picture.granules).items()
        for i, path in enumerate(part)
    ]
    start = min(actor.path.time[0] - actor.late for actor in actors)
    end = max(actor.path.time[-1] - actor.late for actor in actors)
    end = end if picture.duration is None else start + picture.duration
    frames = np.linspace(start, end, picture.frames)
    stills = frames[np.linspace(0, len(frames) - 1, picture.stills).round().astype(int)]
    window = _window(scene, actors, frames)
    _strip(view, actors, window, stills, start)
    _gif(view.file(".gif"), view, actors, window, frames, start)
    data = view.write_csv(COLUMNS, _rows(scene, actors, frames, start))
    numbers = _numbers(actors, start)
    return PictureFiles([view.file(".png"), view.file(".gif"), data], _text(numbers), numbers)


def _spread(paths: dict[str, list[Path2D]], count: int) -> dict[str, list[Path2D]]:
    """``count`` granules of each fraction, those that begin nearest to evenly spread places, fractions in turn."""
    found: dict[str, list[Path2D]] = {}
    starts = {name: np.array([path.position[0, 0] for path in part]) for name, part in paths.items()}
    low, high = (f(np.concatenate(list(starts.values()))) for f in (np.min, np.max))
    for k, (name, part) in enumerate(paths.items()):
        places = low + (high - low) * (np.arange(count) * len(paths) + k + 0.5) / (count * len(paths))
        chosen = dict.fromkeys(int(np.argmin(np.abs(starts[name] - place))) for place in places)
        found[name] = [part[i] for i in chosen]
    return found


def _actor(scene: Scene, fraction: str, number: int, path: Path2D) -> _Actor:
    """Its clock set back by whole periods of the vibration, so that all begin within the first one."""
    period = 0.0 if scene.vibration is None else scene.vibration.period
    late = period * np.floor(path.time[0] / period + 1e-9) if period else float(path.time[0])
    last, rides = path.separation(scene), bool(path.touches(scene)[-1])
    if last is None:
        return _Actor(fraction, number, path, late, rides, None, 0.0)
    first = int(np.flatnonzero(path.touches(scene))[0])
    times = np.linspace(path.time[first], path.time[last], 4000)
    relative = path.at(times)[0] - body_displacement(scene, times)
    gap = np.min([distance_to(relative, body.outline()) for body in scene.body.values()], axis=0)
    leaves = None if rides else float(path.time[last] - late)
    return _Actor(fraction, number, path, late, rides, leaves, max(0.0, float(gap.max()) - path.diameter / 2))


def _window(scene: Scene, actors: list[_Actor], frames: Array) -> Window:
    """Round all that moves, clipped to the channel."""
    swing = np.abs(scene.motion[0])
    parts = [actor.at(scene, frames)[0] for actor in actors]
    parts += [body.outline() + side * swing for body in scene.body.values() for side in (-1.0, 1.0)]
    points = np.concatenate(parts)
    margin = 0.06 * float(np.ptp(points, axis=0).max())
    (left, low), (right, high) = points.min(axis=0) - margin, points.max(axis=0) + margin
    half = scene.channel.width / 2
    return max(left, -half), min(right, half), max(low, scene.channel.bottom), min(high, scene.channel.top)


class _Panel:
    """The bodies and granules on one pair of axes with the granules' trails, set to any time by ``show``."""

    def __init__(self, axes: Axes, view: View, actors: list[_Actor], window: Window, start: float) -> None:
        self.axes, self.scene, self.actors, self.start = axes, view.scene, actors, start
        own = fraction_colours(list(self.scene.fraction))
        colours, least = [own[actor.fraction] for actor in actors], VISIBLE * (window[1] - window[0])
        self.trails = [axes.plot([], [], color=colour, linewidth=0.7, zorder=4.2)[0] for colour in colours]
        self.machine = MovingMachine(axes, self.scene, [max(actor.path.diameter, least) for actor in actors], colours)
        outlines = [body.outline() for body in self.scene.body.values()]
        ends = [outline[np.argmax(side * outline[:, 0])] for outline in outlines for side in (-1, 1)]
        self.ends = np.reshape(ends, (-1, 2))
        (self.edges,) = axes.plot([], [], "v", color=INK, markersize=4, zorder=4.1)
        axes.set_aspect("equal")
        axes.set_xlim(MM * window[0], MM * window[1])
        axes.set_ylim(MM * window[2], MM * window[3])
        axes.tick_params(labelsize=7)
        _actuator(axes, self.scene)

    def show(self, time: float) -> None:
        """Everything where it is at ``time`` (s on the picture's clock)."""
        moments = np.linspace(self.start, max(time, self.start), TRAIL)
        paths = [actor.at(self.scene, moments)[0] for actor in self.actors]
        for trail, path in zip(self.trails, paths, strict=True):
            trail.set_data(*(MM * path).T)
        shift = self.machine.move(time, np.array([path[-1] for path in paths]))
        self.edges.set_data(*(MM * (self.ends + shift)).T)
        self.axes.set_title(f"{MM * (time - self.start):.0f} ms", fontsize=8, loc="left")


def _actuator(axes: Axes, scene: Scene) -> None:
    """The direction of the vibration, an arrow below the first body."""
    if scene.vibration is None:
        return
    outline = next(iter(scene.body.values())).outline()
    along = scene.vibration.along
    foot = np.array([outline[:, 0].mean(), outline[:, 1].min()])
    size = 0.2 * float(np.ptp(outline[:, 0]))
    near, far = (tuple(MM * (foot - part * size * along)) for part in (0.15, 1.15))
    axes.annotate(
        "", xy=near, xytext=far, zorder=3,
        arrowprops={"arrowstyle": "<|-|>", "color": INK, "linewidth": 1.2, "mutation_scale": 9},
    )  # fmt: skip


def _strip(view: View, actors: list[_Actor], window: Window, times: Array, start: float) -> None:
    """The stills side by side, as many rows as they need; the fractions named below."""
    shape = (window[1] - window[0]) / (window[3] - window[2])
    wide = min(max((STILL * shape) ** 0.5, 1.1), WIDEST)
    columns = min(len(times), max(1, int(WIDEST / wide)))
    columns = -(-len(times) // -(-len(times) // columns))  # the same number in every row, as far as it goes
    rows = -(-len(times) // columns)
    figure = new_figure((wide + 0.15) * columns + 0.4, (wide / shape + 0.3) * rows + 0.7).figure
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, time in zip(panels.ravel(), times, strict=False):
        _Panel(axes, view, actors, window, start).show(float(time))
    for axes in panels.ravel()[len(times) :]:
        axes.set_axis_off()
    for axes in panels[-1]:
        axes.set_xlabel("x (mm)", fontsize=8)
    for row in panels:
        row[0].set_ylabel("y (mm)", fontsize=8)
    _name_actors(figure, view.scene, actors)
    save(figure, view.file(".png"))


def _name_actors(figure: Figure, scene: Scene, actors: list[_Actor]) -> None:
    from matplotlib.lines import Line2D

    colours = fraction_colours(list(scene.fraction))
    names = dict.fromkeys(actor.fraction for actor in actors)
    handles = [Line2D([], [], marker="o", linewidth=0.7, color=colours[name], label=name) for name in names]
    handles.append(Line2D([], [], marker="v", linewidth=0, color=INK, markersize=4, label="separation point"))
    if scene.vibration is not None:
        peak = np.linalg.norm(scene.shaking)
        text = f"vibration: {1.0 / scene.vibration.period:.3g} Hz, peak speed {peak:.2g} m/s"
        handles.append(Line2D([], [], linewidth=0, marker="$\\updownarrow$", color=INK, markersize=8, label=text))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)


def _gif(path: Path, view: View, actors: list[_Actor], window: Window, frames: Array, start: float) -> None:
    wide = max(1.6, TALL * (window[1] - window[0]) / (window[3] - window[2])) + 0.7
    figure = new_figure(wide, TALL + 1.1).figure
    figure.set_dpi(SCREEN)
    panel = _Panel(figure.add_subplot(), view, actors, window, start)
    named = dict(zip((actor.fraction for actor in actors), panel.trails, strict=True))
    panel.axes.legend(named.values(), named.keys(), fontsize=7, frameon=False, loc="upper right")
    slower = len(frames) / PLAYED / float(frames[-1] - frames[0])
    figure.supxlabel(f"x, y (mm); slowed {slower:.2g} times", fontsize=7)
    panel.show(float(frames[0]))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # the same place for everything in all frames
    with atomic_write(path, "wb") as stream:
        stream.write(gif_of((_frame(figure, panel, time) for time in frames.tolist()), PLAYED))


def _frame(figure: Figure, panel: _Panel, time: float) -> Image.Image:
    panel.show(time)
    figure.canvas.draw()
    return picture_of(figure, figure.bbox_inches)


def _rows(scene: Scene, actors: list[_Actor], frames: Array, start: float) -> list[tuple[object, ...]]:
    shift = body_displacement(scene, frames)
    found = []
    for actor in actors:
        position, velocity = actor.at(scene, frames)
        for k, time in enumerate(frames):
            values = (*position[k], *velocity[k], *shift[k])
            found.append((float(time - start), actor.fraction, actor.number, *map(float, values)))
    return found


def _numbers(actors: list[_Actor], start: float) -> JsonTable:
    """By fraction, of each granule drawn: seconds until it leaves the body for good, highest hop before that (m)."""
    table: JsonTable = {}
    for actor in actors:
        row = table.setdefault(actor.fraction, {"leaves": [], "hop": []})
        row["leaves"].append(None if actor.leaves is None else actor.leaves - start)
        row["hop"].append(actor.hop)
    return table


def _text(numbers: JsonTable) -> str:
    parts = []
    for name, row in numbers.items():
        hop = f"hops up to {MM * max(row['hop']):.2g} mm off the body" if max(row["hop"]) > 1e-6 else "never lifts off"
        left = [time for time in row["leaves"] if time is not None]
        gone = f"leaves it after {min(left):.3g} s" if left else "is still on it at the end"
        parts.append(f"{name} {hop} and {gone}")
    return "; ".join(parts) + "."
