"""What the page's own script draws: the machine, granules on their way and the wake they flew in, as plain numbers.

A frame is the air's vorticity at one moment of the stored loop, as a small JPEG. A granule released at any time met the
loop at that phase, so that all granules whose own time is at that phase, whole loops apart, are in the frame together.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...air.field.flow import vorticity
from ...show.air_pictures import moments_of
from ...show.canvas import MM, Window, bins_across, fraction_colours
from ...show.html.rows import page_template
from ...show.moving import Path2D
from ...show.outcome import Outcome, PagePart, Track
from ...show.words import part_text

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...answer.result import Result
    from ...scene import Scene

Array = NDArray[np.float64]
FRAMES = 32  # of a loop
SIDE = 900  # dots of the longer side of the canvas
LONGER = 420  # dots of the longer side of a frame
QUALITY = 72  # of the JPEG
MAX_TRACK_POINTS = 160  # of a track
PLAYED = 1.0 / 30.0  # of real time
TRACKS = 1024  # on a page, of all fractions: those of 300 made it 30 MB larger


def watch_part(_: Path, outcome: Outcome) -> PagePart:
    """The section that the script fills, and the script with all that it draws."""
    scene, data, home = outcome.scene, live_data(outcome), Path(__file__).parent
    section = page_template("live.html.j2", home).render(
        live=data, colours=fraction_colours(list(scene.fraction)), canvas=_canvas(scene)
    )
    numbers = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    script = (home / "live.js").read_text(encoding="utf-8").removesuffix("\n")
    return PagePart(
        section, '<li><a href="#watch">Watch it</a></li>',
        f'<script type="application/json" id="live-data">{numbers}</script>\n<script>\n{script}</script>\n',
    )  # fmt: skip


def _canvas(scene: Scene) -> tuple[int, int]:
    """Width and height (dots) of the script's canvas, in the proportions of the channel."""
    across, up = scene.channel.width, scene.channel.top - scene.channel.bottom
    return max(240, round(SIDE * across / max(across, up))), max(240, round(SIDE * up / max(across, up)))


def live_data(outcome: Outcome) -> dict[str, object]:
    """Lengths in mm, times in s, shares in percent."""
    scene, result, channel = outcome.scene, outcome.result, outcome.scene.channel
    window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
    field, colours, shares = outcome.field, fraction_colours(list(scene.fraction)), scene.mass_shares()
    loop = None if field is None else field.period or None
    frames = [] if field is None else _frames(field, window)
    each = max(1, TRACKS // len(scene.fraction))
    return {
        "window": [MM * end for end in window],
        "bodies": [_flat(body.outline()) for body in scene.body.values()],
        "bins": [_bin(scene, result, name) for name in bins_across(scene)],
        "fractions": [
            {
                "name": name,
                "colour": colours[name],
                "feed": shares[name],
                "tracks": _tracks(outcome.tracks.get(name, []), each),
            }
            for name in scene.fraction
        ],
        "loop": loop,
        "start": float(field.times[0]) if field is not None and field.in_time else None,
        "played": PLAYED,
        "frames": frames,
        "wakes": _wakes(result),
    }


def _flat(line: Array) -> list[float]:
    return [round(float(MM * x), 2) for x in line.ravel()]


def _bin(scene: Scene, result: Result, name: str) -> dict[str, object]:
    """A bin's line, and what lands in it in words."""
    separation = None if result.landings is None else result.landings.separation
    void = result.void
    shares = {} if separation is None else {
        fraction: part_text(places[name], void=void) for fraction, places in separation.fractions.items()
    }  # fmt: skip
    flow = None if separation is None or void else separation.throughput[name]
    pure = {} if separation is None else {
        fraction: part_text(row, void=void) for fraction, row in (separation.purity[name] or {}).items()
    }  # fmt: skip
    return {
        "name": name, "line": _flat(scene.bin[name].line(scene)), "shares": shares, "purity": pure, "flow": flow
    }  # fmt: skip


def _tracks(tracks: Sequence[Track], count: int) -> list[dict[str, object]]:
    """At most ``count`` tracks at even times: when each begins (s), its step (s), and its x and y in tenths of a
    millimetre.
    """
    shown = []
    for number in np.linspace(0, len(tracks) - 1, min(count, len(tracks))).astype(int):
        track = tracks[number]
        time = track["time"]
        if len(time) < 2 or time[-1] <= time[0]:
            continue
        even = np.linspace(time[0], time[-1], MAX_TRACK_POINTS)
        points = np.rint(10 * MM * Path2D.of(track).at(even)[0]).astype(int)
        shown.append({"from": float(time[0]), "step": float(even[1] - even[0]), "at": points.ravel().tolist()})
    return shown


def _wakes(result: Result) -> dict[str, object]:
    """Shares (%) by wake, fraction and bin: the answer first, with its interval; then other wakes."""
    landings = result.landings
    if landings is None:
        return {"answer": {}, "interval": {}, "others": {}}
    fractions, others = landings.separation.fractions, dict[str, dict[str, dict[str, float]]]()
    for name, places in landings.bracket.items():
        for place, shares in places.items():
            for wake, share in shares.items():
                others.setdefault(wake, {}).setdefault(name, {})[place] = 100 * share
    return {
        "answer": {name: {place: 100 * part.value for place, part in row.items()} for name, row in fractions.items()},
        "interval": {
            name: {place: [100 * part.low, 100 * part.high] for place, part in row.items()}
            for name, row in fractions.items()
        },
        "others": others,
    }


def _frames(field: FlowField, window: tuple[float, float, float, float]) -> list[str]:
    """JPEGs of the vorticity over the loop, or one of a steady field, as data URLs."""
    from PIL import Image

    across, up = window[1] - window[0], window[3] - window[2]
    vorticity = VorticityShades(
        field, window, tuple(max(16, round(LONGER * length / max(across, up))) for length in (across, up))
    )
    times = moments_of(field, FRAMES if field.period else 1).tolist() if field.in_time else [0.0]
    strongest = vorticity.strongest()
    images = []
    for time in times:
        stream = io.BytesIO()
        Image.fromarray(vorticity.shaded(time, strongest)).save(stream, "JPEG", quality=QUALITY, optimize=True)
        images.append("data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii"))
    return images


STRONGEST = 97.0  # percentile of |vorticity| at which its colour is full
CLOCKWISE, COUNTER = (0.30, 0.55, 0.85), (0.88, 0.42, 0.35)  # blue, red
PALE = 0.75  # of the full colour


class VorticityShades:
    """The vorticity of a ``field`` on ``size`` (across, up) dots of a ``window``, the upper left first."""

    def __init__(self, field: FlowField, window: Window, size: tuple[int, ...]) -> None:
        self.field, self.size = field, size
        x = window[0] + (np.arange(size[0]) + 0.5) / size[0] * (window[1] - window[0])
        y = window[3] - (np.arange(size[1]) + 0.5) / size[1] * (window[3] - window[2])
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        triangle = field.locate(points)
        self.inside = triangle >= 0
        self.weight = field.barycentric(triangle[self.inside], points[self.inside])
        self.corner = field.triangles[triangle[self.inside]]
        self.parts = vorticity(field).reshape(-1, len(field.points))

    def _nodal(self, time: float) -> Array:
        return np.asarray(self.field.weights(time) @ self.parts) if self.field.in_time else self.parts[0]

    def strongest(self) -> float:
        """What the colour is full at: few nodes at the first moment have more (1/s)."""
        first = float(self.field.times[0]) if self.field.in_time else 0.0
        return float(np.percentile(np.abs(self._nodal(first)), STRONGEST)) or 1.0

    def shaded(self, time: float, strongest: float, levels: int = 0) -> NDArray[np.uint8]:
        """Colours (up, across, 3) at ``time`` (s): blue turns clockwise, red counter-clockwise, white does not or is
        outside; in so many ``levels`` either way, 0: smooth.
        """
        values = np.zeros(len(self.inside))
        values[self.inside] = np.einsum("nk,nk->n", self.weight, self._nodal(time)[self.corner]) / strongest
        signed = np.tanh(values)
        if levels:
            signed = np.round(signed * levels) / levels
        return np.rint(tone(signed)).astype(np.uint8).reshape(self.size[1], self.size[0], 3)


def tone(signed: Array) -> Array:
    """Colours (n, 3), 0 to 255, of vorticity (n,) between -1 and 1: pale, so that granules stand out."""
    colour = np.where((signed < 0.0)[:, None], CLOCKWISE, COUNTER)
    return 255.0 * (1.0 - PALE * np.abs(signed)[:, None] * (1.0 - colour))
