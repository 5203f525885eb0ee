"""A film of the machine: granules of all fractions on their way through the moving wake, past the vibrating bodies.

A GIF that would be larger than allowed is drawn smaller.
"""

from __future__ import annotations

import base64
import io
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.files import atomic_write
from ...show import canvas
from ...show.canvas import BODY, COLOURS, INK, MM, STREAM, Window, fraction_colours
from ...show.html.rows import page_template
from ...show.moving import Path2D, body_displacement
from ...show.outcome import Outcome, PagePart
from .live import VorticityShades, tone

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox
    from PIL import Image

    from ...air.field import FlowField
    from ...scene import Scene
    from .film_stage import Film

Array = NDArray[np.float64]
FORMATS = {"gif": 12.5, "mp4": 30.0}  # frames a second; a GIF counts hundredths of a second
FILMS = tuple(f"figures/film.{suffix}" for suffix in FORMATS)  # where a run's own may be in its folder
VISIBLE = 0.008  # of the picture's longer side: diameter of the smallest granule drawn
AIMED_SIZE = 0.92  # of the bytes allowed, that a smaller GIF aims at
MIN_DOTS = 200  # dots of the longer side, below which nothing is seen
EDGE = 0.12  # inches around all that is drawn: letters are a little wider in some sizes
ON_PAGE = 5e6  # bytes of a film that the page holds, so that it stays below twice that
BEGIN, END = "<!-- film -->", "<!-- /film -->"


def write_film(
    path: Path, film: Film, scene: Scene, field: FlowField | None, *, seconds: float, size: int, most: float
) -> Path:
    """Write a film, GIF or MP4 by the suffix of ``path``, that plays for ``seconds``, of ``size`` dots on its longer
    side, or of fewer so that it has no more bytes than ``most``. Raises SceneError where nothing would be seen then,
    and for an MP4 without the extra that writes it.
    """
    rate = FORMATS[path.suffix[1:]]
    times = film.begin + np.arange(max(2, round(rate * seconds))) / rate * film.span / seconds
    dots = size
    while True:
        frames = _Set(film, scene, field, dots, seconds).frames(times)
        made = gif_of(frames, rate) if path.suffix == ".gif" else _mp4(frames, rate, path)
        if len(made) <= most:
            break
        dots = int(dots * min(0.9, (AIMED_SIZE * most / len(made)) ** 0.5))
        if dots < MIN_DOTS:
            raise SceneError(f"{path}: {most / 1e6:.2g} MB are too few; ask for fewer seconds, or allow more")
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path, "wb") as stream:
        stream.write(made)
    return path


def _mp4(frames: Iterator[Image.Image], rate: float, path: Path) -> bytes:
    """All frames in H.264, as every browser plays it."""
    try:
        from imageio_ffmpeg import write_frames
    except ModuleNotFoundError:
        raise SceneError("an MP4 needs an extra: pip install imageio-ffmpeg; or ask for --format gif") from None
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.{os.getpid()}.mp4")
    first = next(frames)
    try:
        writer = write_frames(str(draft), first.size, fps=rate, quality=7, macro_block_size=EVEN)
        writer.send(None)
        for frame in (first, *frames):
            writer.send(frame.tobytes())
        writer.close()
        return draft.read_bytes()
    finally:
        draft.unlink(missing_ok=True)


RIM = 0.4  # points of white around a granule


class MovingMachine:
    """The bodies of a scene and granules of ``diameters`` (n,) m in ``colours`` on axes, to be moved to any time."""

    def __init__(self, axes: Axes, scene: Scene, diameters: Sequence[float], colours: Sequence[str]) -> None:
        from matplotlib.collections import EllipseCollection

        self.scene, self.bodies = scene, canvas.solids(axes, scene)
        self.outlines = [body.outline() for body in scene.body.values()]
        size = MM * np.asarray(diameters)
        self.discs = EllipseCollection(
            size, size, np.zeros(len(size)), units="xy", offsets=np.zeros((len(size), 2)), facecolors=colours,
            offset_transform=axes.transData, edgecolors="white", linewidths=RIM, zorder=4.5,
        )  # fmt: skip
        axes.add_collection(self.discs)

    def move(self, time: float, places: Array) -> None:
        """The bodies to where they are at ``time`` (s), the granules to ``places`` (n, 2) m, of which those that are
        NaN are not seen.
        """
        for patch, outline in zip(self.bodies, self.outlines, strict=True):
            patch.set_xy(MM * (outline + body_displacement(self.scene, np.full(len(outline), time), outline)))
        self.discs.set_offsets(np.ma.masked_invalid(MM * places))


EVEN = 2  # dots, of both sides of a frame: an MP4 asks for it


def picture_of(figure: Figure, box: Bbox) -> Image.Image:
    """A figure as it was drawn last, cut to a ``box`` (inches)."""
    from PIL import Image

    dots = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
    left, right = (max(0, round(x * figure.dpi)) for x in (box.x0, box.x1))
    top, bottom = (max(0, len(dots) - round(y * figure.dpi)) for y in (box.y1, box.y0))
    inside = dots[top:bottom, left:right, :3]
    up, across = (EVEN * (length // EVEN) for length in inside.shape[:2])
    return Image.fromarray(inside[:up, :across])


LEVELS = 6  # shades of either turning: even ones take few bytes
TINTS, GREYS = 4, 16  # of each colour towards white, and of grey, in a GIF


def gif_of(frames: Iterable[Image.Image], rate: float) -> bytes:
    """All frames in the same few colours, ``rate`` of them a second, for ever."""
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette(_colours())
    first, *rest = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    stream = io.BytesIO()
    first.save(stream, "GIF", save_all=True, append_images=rest, duration=round(1000 / rate), loop=0, optimize=False)
    return stream.getvalue()


def _colours() -> list[int]:
    """Red, green, blue of all that is shown: greys, the air's shades, and each colour with its way to white."""
    solid = np.array([[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in (*COLOURS, STREAM, BODY)])
    tints = [255 - part * (255 - solid) for part in np.linspace(1.0, 0.0, TINTS, endpoint=False)]
    greys = np.repeat(np.linspace(0, 255, GREYS)[:, None], 3, axis=1)
    air = tone(np.linspace(-1.0, 1.0, 2 * LEVELS + 1))
    return [int(part) for part in np.rint(np.concatenate([greys, air, *tints])).ravel()]


class _Set:
    """The machine as one frame after the other; ``size``: dots of the longer side."""

    def __init__(self, film: Film, scene: Scene, field: FlowField | None, size: int, seconds: float) -> None:
        channel = scene.channel
        self.begin = film.begin
        window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
        self.figure, axes, self.clock = _still(film, scene, window, seconds)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # the same place for everything in all frames
        self.box = self.figure.get_tightbbox().padded(EDGE)
        self.figure.set_dpi(size / max(self.box.width, self.box.height))
        scale = axes.get_window_extent().width / channel.width  # dots per m
        colours, least = fraction_colours(list(scene.fraction)), VISIBLE * size / scale
        drawn = [(colours[name], Path2D.of(track)) for name, part in film.paths.items() for track in part]
        self.paths = [path for _, path in drawn]
        sizes = [max(least, path.diameter) for path in self.paths]
        self.machine = MovingMachine(axes, scene, sizes, [colour for colour, _ in drawn])
        self.air = None if field is None else _Air(axes, field, window, scale)
        inside = (*axes.images, *axes.lines, *axes.patches, *axes.collections, *axes.texts)
        self.axes, self.inside = axes, sorted(inside, key=lambda artist: artist.zorder)
        for artist in self.inside:
            artist.set_animated(True)  # drawn in every frame, on what is around the channel
        self.figure.canvas.draw()
        self.around = self.figure.canvas.copy_from_bbox(self.figure.bbox)  # type: ignore[attr-defined]

    def frames(self, times: Array) -> Iterator[Image.Image]:
        """The machine at ``times`` (k,) s on the airflow's clock."""
        return map(self._frame, times.tolist())

    def _frame(self, time: float) -> Image.Image:
        there = [path.time[0] <= time <= path.time[-1] for path in self.paths]
        places = np.array([path.at(np.array([time]))[0][0] for path in self.paths]).reshape(-1, 2)
        self.machine.move(time, np.where(np.reshape(there, (-1, 1)), places, np.nan))
        if self.air is not None:
            self.air.move(time)
        self.clock.set_text(f"{1e3 * (time - self.begin):.0f} ms")
        self.figure.canvas.restore_region(self.around)  # type: ignore[attr-defined]
        for artist in self.inside:
            self.axes.draw_artist(artist)
        return picture_of(self.figure, self.box)


class _Air:
    """The turning of the air behind the granules; ``scale``: dots per m."""

    def __init__(self, axes: Axes, field: FlowField, window: Window, scale: float) -> None:
        size = tuple(round(scale * length) for length in (window[1] - window[0], window[3] - window[2]))
        self.vorticity = VorticityShades(field, window, size)
        self.strongest = self.vorticity.strongest()
        left, right, low, high = (MM * end for end in window)
        self.image = axes.imshow(
            np.zeros((1, 1, 3)), extent=(left, right, low, high), interpolation="nearest", zorder=0
        )

    def move(self, time: float) -> None:
        """Show it as it is at ``time`` (s)."""
        self.image.set_data(self.vorticity.shaded(time, self.strongest, LEVELS))


def _still(film: Film, scene: Scene, window: Window, seconds: float) -> tuple[Figure, Axes, Text]:
    """Walls, bins, the air's direction, who is who, how the film was made; and the text that is its clock."""
    from matplotlib.lines import Line2D

    figure, axes, scale = canvas.canvas(window)
    for wall in window[:2]:
        axes.plot([MM * wall] * 2, [MM * end for end in window[2:]], color=INK, linewidth=1.3)
    canvas.frame(axes, window, canvas.draw_bins(axes, scene, scale))
    canvas.air_arrow(axes, scene, window)
    canvas.streams(axes, scene)
    colours = fraction_colours(list(scene.fraction))
    handles = [
        Line2D([], [], marker="o", linewidth=0, color=colours[name], label=_named(name, film.one_in[name]))
        for name in canvas.foremost(scene, list(film.paths))
    ]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, fontsize=9)
    lines = [
        f"slowed {seconds / film.span:.3g} times",
        f"a slice of {MM * film.depth:.2g} mm",
        "granules meet" if film.met else "each flies alone",
    ]
    text = axes.text(1.06, 0.02, "\n".join(lines), transform=axes.transAxes, fontsize=8, va="bottom")
    clock = axes.annotate("0 ms", (0, 1), xycoords=text, xytext=(0, 6), textcoords="offset points", fontsize=11)
    return figure.figure, axes, clock


def _named(name: str, one_in: float) -> str:
    return name if one_in <= 1.0 else f"{name},\none in {one_in:.0f}"


# -- on the page of its run --------------------------------------------------------------------------------------------


def film_part(folder: Path, _: Outcome) -> PagePart:
    """The section of the page of a run in ``folder`` with the newest film among its figures; empty without any."""
    films = sorted((path for file in FILMS if (path := folder / file).exists()), key=lambda path: path.stat().st_mtime)
    return PagePart(film_section(films[-1]) if films else f"{BEGIN}{END}")


def film_section(film: Path) -> str:
    """The section of the page between its marks; a film that is too large, or damaged, is named, not shown."""
    size = film.stat().st_size
    data = None if size > ON_PAGE else base64.b64encode(film.read_bytes()).decode("ascii")
    try:
        still = base64.b64encode(still_of(film)).decode("ascii")
    except (OSError, ValueError, RuntimeError, ImportError):  # cut short; no program that reads it
        data = still = None
    section = page_template("film.html.j2", Path(__file__).parent).render(film=film, size=size, data=data, still=still)
    return f"{BEGIN}{section}{END}"


def still_of(film: Path) -> bytes:
    """The frame in the middle of a film, as a PNG: what paper shows of it."""
    from PIL import Image

    if film.suffix == ".mp4":
        from imageio_ffmpeg import count_frames_and_secs, read_frames

        middle = count_frames_and_secs(str(film))[1] / 2.0
        frames = read_frames(str(film), input_params=["-ss", f"{middle:.3f}"])
        size = next(frames)["size"]
        still = Image.frombytes("RGB", size, next(frames))
        frames.close()
    else:
        with Image.open(film) as moving:
            moving.seek(getattr(moving, "n_frames", 1) // 2)
            still = moving.convert("RGB")
    made = io.BytesIO()
    still.save(made, "PNG", optimize=True)
    return made.getvalue()


def show_film(folder: Path, film: Path) -> None:
    """Put a film on the page of a run that has one, in place of an earlier film; a page without room for it stays."""
    page = folder / "report.html"
    if not page.exists():
        return
    text = page.read_text(encoding="utf-8", errors="surrogateescape")
    section = film_section(film)
    shown = re.sub(f"{BEGIN}.*?{END}", lambda _: section, text, count=1, flags=re.DOTALL)
    with atomic_write(page, "wb") as stream:
        stream.write(shown.encode(errors="surrogateescape"))
