"""A film of the machine: granules of all fractions on their way through the moving wake, past the vibrating bodies.

What stands still is drawn once; of each frame the air's vorticity, the bodies and the granules by Pillow, at twice the
size and brought down, so that edges are smooth. A GIF that would be larger than allowed is drawn smaller.
"""

from __future__ import annotations

import base64
import io
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.files import atomic_write
from .air import Turning, tone
from .canvas import (
    BODY,
    COLOURS,
    INK,
    MM,
    STREAM,
    Window,
    air_arrow,
    canvas,
    draw_bins,
    fraction_colours,
    frame,
    streams,
)
from .pictures.view import Path2D, body_displacement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from PIL import Image

    from ..field import FlowField
    from ..pipeline.film_stage import Film
    from ..scene import Scene

Array = NDArray[np.float64]
FORMATS = {"gif": 12.5, "mp4": 30.0}  # frames a second; a GIF counts hundredths of a second
TWICE = 2  # as large, before it is brought down
LEVELS = 6  # shades of either turning: even ones take few bytes
TINTS, GREYS = 4, 16  # of each colour towards white, and of grey, in a GIF
VISIBLE = 0.004  # of the picture's longer side: radius of the smallest granule drawn
ROOM = 0.92  # of the bytes allowed, that a smaller GIF aims at
LEAST = 200  # dots of the longer side, below which nothing is seen
EVEN = 2  # dots, of a frame of an MP4
SPARE = 1.0  # inches; what nothing is drawn on is cut off
CLOCK, EDGE = 11.0, 0.05  # points; inches
ON_PAGE = 5e6  # bytes of a film that the page holds, so that it stays below twice that
BEGIN, END = "<!-- film -->", "<!-- /film -->"
ALT = "Granules of the fractions on their way past the bodies, through the turning air"
CAPTION = (
    "Granules as they come, on their way past the bodies. Colour behind them: the air's vorticity, blue clockwise, red "
    "counter-clockwise."
)


def write_film(
    path: Path, film: Film, scene: Scene, field: FlowField | None, *, seconds: float, size: int, most: float
) -> Path:
    """Write a film, GIF or MP4 by the suffix of ``path``, that plays for ``seconds``, of ``size`` dots on its longer
    side, or of fewer so that it has no more bytes than ``most``. Raises SceneError where nothing would be seen then,
    and for an MP4 without the extra that writes it.
    """
    rate = FORMATS[path.suffix[1:]]
    times = film.begin + np.arange(max(2, round(rate * seconds))) / rate * film.span / seconds
    encode = _gif if path.suffix == ".gif" else _mp4
    dots = size
    while True:
        made = encode(_Set(film, scene, field, dots, seconds).frames(times), rate, path)
        if len(made) <= most:
            break
        dots = int(dots * min(0.9, (ROOM * most / len(made)) ** 0.5))
        if dots < LEAST:
            raise SceneError(f"{path}: {most / 1e6:.2g} MB are too few; ask for fewer seconds, or allow more")
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path, "wb") as stream:
        stream.write(made)
    return path


def _gif(frames: Iterator[Image.Image], rate: float, _: Path) -> bytes:
    """All frames in the same few colours, for ever."""
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette(_colours())
    first, *rest = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in frames)
    stream = io.BytesIO()
    first.save(stream, "GIF", save_all=True, append_images=rest, duration=round(1000 / rate), loop=0, optimize=False)
    return stream.getvalue()


def _colours() -> list[int]:
    """Red, green, blue of all that a film shows: greys, the air's shades, and each colour with its way to white."""
    solid = np.array([[int(one[i : i + 2], 16) for i in (1, 3, 5)] for one in (*COLOURS, STREAM, BODY)])
    tints = [255 - part * (255 - solid) for part in np.linspace(1.0, 0.0, TINTS, endpoint=False)]
    greys = np.repeat(np.linspace(0, 255, GREYS)[:, None], 3, axis=1)
    air = tone(np.linspace(-1.0, 1.0, 2 * LEVELS + 1))
    return [int(part) for part in np.rint(np.concatenate([greys, air, *tints])).ravel()]


def _mp4(frames: Iterator[Image.Image], rate: float, path: Path) -> bytes:
    """All frames in H.264, as every browser plays it."""
    try:
        from imageio_ffmpeg import write_frames
    except ModuleNotFoundError:
        raise SceneError("an MP4 needs an extra: pip install 'wakeflow[mp4]'; or ask for --format gif") from None
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.{os.getpid()}.mp4")
    first = next(frames)
    try:
        writer = write_frames(str(draft), first.size, fps=rate, quality=7, macro_block_size=EVEN)
        writer.send(None)
        for one in (first, *frames):
            writer.send(one.tobytes())
        writer.close()
        return draft.read_bytes()
    finally:
        draft.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Actor:
    """A granule: its path, colour and radius (dots)."""

    path: Path2D
    colour: str
    radius: float


class _Set:
    """The machine as one frame after the other; ``size``: dots of the longer side."""

    def __init__(self, film: Film, scene: Scene, field: FlowField | None, size: int, seconds: float) -> None:
        self.film, self.scene = film, scene
        channel = scene.channel
        self.window: Window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
        self.still = _furniture(film, scene, self.window, size, seconds)
        across = (self.window[1] - self.window[0], self.window[3] - self.window[2])
        self.inner = (round(self.still.scale * across[0]), round(self.still.scale * across[1]))
        shown = tuple(length // TWICE for length in self.inner)  # shades need no smooth edges
        self.turning = None if field is None else Turning(field, self.window, shown)
        self.strongest = 1.0 if self.turning is None else self.turning.strongest()
        colours, least = fraction_colours(list(scene.fraction)), VISIBLE * TWICE * size
        self.actors = [
            _Actor(Path2D.of(one), colours[name], max(least, 0.5 * self.still.scale * float(one["diameter"])))
            for name, part in film.paths.items()
            for one in part
        ]

    def frames(self, times: Array) -> Iterator[Image.Image]:
        """The machine at ``times`` (k,) s on the airflow's clock."""
        return map(self._frame, times.tolist())

    def _frame(self, time: float) -> Image.Image:
        from PIL import Image, ImageDraw

        picture = Image.new("RGB", self.still.front.size, "white")
        if self.turning is not None:
            shades = Image.fromarray(self.turning.shaded(time, self.strongest, LEVELS))
            place = self._dots(self.window[0], self.window[3])
            picture.paste(shades.resize(self.inner, Image.Resampling.NEAREST), place)
        pen = ImageDraw.Draw(picture)
        shift = body_displacement(self.scene, np.array([time]))[0]
        for body in self.scene.body.values():
            corners = [self._dots(x, y) for x, y in body.outline() + shift]
            pen.polygon(corners, fill=BODY, outline=INK, width=TWICE)
        for actor in self.actors:
            if actor.path.time[0] <= time <= actor.path.time[-1]:
                x, y = self._dots(*actor.path.at(np.array([time]))[0][0])
                r = actor.radius
                pen.ellipse((x - r, y - r, x + r, y + r), fill=actor.colour, outline="white")
        picture.paste(self.still.front, (0, 0), self.still.front)
        pen.text(self.still.clock, f"{1e3 * (time - self.film.begin):.0f} ms", fill=INK, font=self.still.font)
        return picture.reduce(TWICE)

    def _dots(self, x: float, y: float) -> tuple[int, int]:
        """A place (m) in dots from the upper left."""
        left, top = self.still.origin
        return round(left + self.still.scale * x), round(top - self.still.scale * y)


class _Furniture(NamedTuple):
    """What stands still: a picture that is clear where the air and the granules go; dots per m; the dots of the origin
    and of the clock's upper left; the clock's font.
    """

    front: Image.Image
    scale: float
    origin: tuple[float, float]
    clock: tuple[float, float]
    font: Any


def _furniture(film: Film, scene: Scene, window: Window, size: int, seconds: float) -> _Furniture:
    """``size``: dots of the longer side."""
    from PIL import Image, ImageFont

    figure, axes, told = _still(film, scene, window, seconds)
    _widen(figure, axes)
    box = figure.get_tightbbox().padded(EDGE)
    figure.set_dpi(TWICE * size / max(box.width, box.height))
    figure.canvas.draw()
    high = figure.canvas.get_width_height()[1]
    drawn = Image.frombytes(
        "RGBA",
        figure.canvas.get_width_height(),
        bytes(figure.canvas.buffer_rgba()),  # type: ignore[attr-defined]
    )
    left, top = round(box.x0 * figure.dpi), high - round(box.y1 * figure.dpi)
    across, up = (EVEN * TWICE * int(length * figure.dpi / (EVEN * TWICE)) for length in (box.width, box.height))
    (x, y), (right, _) = axes.transData.transform([(0.0, 0.0), (MM, 0.0)])
    letters = round(CLOCK * figure.dpi / 72)
    font = ImageFont.truetype(_font_file(), letters)
    lines = told.get_window_extent()
    return _Furniture(
        drawn.crop((left, top, left + across, top + up)), float(right - x), (float(x) - left, high - float(y) - top),
        (float(lines.x0) - left, high - float(lines.y1) - top - 1.6 * letters), font,
    )  # fmt: skip


def _widen(figure: Figure, axes: Axes) -> None:
    """Lay the figure out, then put SPARE round it: names beside a channel may need more than they were given."""
    figure.canvas.draw()
    figure.set_layout_engine("none")
    inches, place = np.array(figure.get_size_inches()), axes.get_position()
    wider = inches + 2.0 * SPARE
    low, high = ((np.array(corner) * inches + SPARE) / wider for corner in (place.min, place.max))
    figure.set_size_inches(*wider)
    axes.set_position((*low, *(high - low)))


def _font_file() -> str:
    """Matplotlib's own letters, as those of the furniture."""
    from matplotlib import get_data_path

    return str(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"))


def _still(film: Film, scene: Scene, window: Window, seconds: float) -> tuple[Figure, Axes, Text]:
    """Walls, bins, the air's direction, who is who, and how the film was made, the last as a text of its own."""
    from matplotlib.lines import Line2D

    figure, axes, scale = canvas(window)
    for patch in (figure.patch, axes.patch):
        patch.set_alpha(0.0)
    for wall in window[:2]:
        axes.plot([MM * wall] * 2, [MM * end for end in window[2:]], color=INK, linewidth=1.3)
    frame(axes, window, draw_bins(axes, scene, scale))
    air_arrow(axes, scene, window)
    streams(axes, scene)
    colours = fraction_colours(list(scene.fraction))
    handles = [
        Line2D([], [], marker="o", linewidth=0, color=colours[name], label=_named(name, film.one_in[name]))
        for name in film.paths
    ]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, fontsize=9)
    told = [
        f"slowed {seconds / film.span:.3g} times",
        f"a slice of {MM * film.depth:.2g} mm",
        "granules meet" if film.met else "each flies alone",
    ]
    text = axes.text(1.06, 0.02, "\n".join(told), transform=axes.transAxes, fontsize=8, va="bottom")
    return figure, axes, text


def _named(name: str, one_in: float) -> str:
    return name if one_in <= 1.0 else f"{name}, one in {one_in:.0f}"


# -- on the page of its run --------------------------------------------------------------------------------------------


def film_in(folder: Path) -> Path | None:
    """The film among the figures of a run, the newest of its formats; None without one."""
    found = [path for suffix in FORMATS if (path := folder / "figures" / f"film.{suffix}").exists()]
    return max(found, key=lambda path: path.stat().st_mtime, default=None)


def film_section(film: Path | None) -> str:
    """The section of the page between its marks, empty without a film; one that is too large is named, not shown."""
    if film is None:
        return f"{BEGIN}{END}"
    size = film.stat().st_size
    if size > ON_PAGE:
        shown = f"<p>figures/{film.name}, {size / 1e6:.3g} MB: too large for the page.</p>"
    else:
        data = base64.b64encode(film.read_bytes()).decode("ascii")
        shown = f"<figure>{_player(film.suffix, data)}<figcaption>{CAPTION}</figcaption></figure>"
    head = '<section id="film">\n<h2>Film</h2>\n<details open><summary>Close this to stop it</summary>\n'
    return f"{BEGIN}{head}{shown}\n</details>\n</section>{END}"


def _player(suffix: str, data: str) -> str:
    if suffix == ".mp4":
        return f'<video controls loop muted playsinline aria-label="{ALT}" src="data:video/mp4;base64,{data}"></video>'
    return f'<img alt="{ALT}" src="data:image/gif;base64,{data}">'


def show_film(folder: Path, film: Path) -> None:
    """Put a film on the page of a run that has one, in place of an earlier film; a page without room for it stays."""
    page = folder / "report.html"
    if not page.exists():
        return
    text = page.read_text(encoding="utf-8")
    section = film_section(film)
    with atomic_write(page) as stream:
        stream.write(re.sub(f"{BEGIN}.*?{END}", lambda _: section, text, count=1, flags=re.DOTALL))
