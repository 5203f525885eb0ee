"""What the page's own script draws: the machine, granules on their way and the wake they flew in, as plain numbers.

A frame is the air's vorticity at one moment of the stored loop, as a small JPEG. A granule released at any time met the
loop at that phase, so that all granules whose own time is at that phase, whole loops apart, are in the frame together.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..air_pictures import VorticityShades, moments_of
from ..canvas import MM, bins_across, fraction_colours
from ..moving import Path2D
from ..words import part_text

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...answer.result import Result
    from ...scene import Scene
    from ..outcome import Outcome, Track

Array = NDArray[np.float64]
FRAMES = 32  # of a loop
LONGER = 420  # dots of the longer side of a frame
QUALITY = 72  # of the JPEG
POINTS = 160  # of a track
PLAYED = 1.0 / 30.0  # of real time
TRACKS = 1024  # on a page, of all fractions: those of 300 made it 30 MB larger


def live_data(outcome: Outcome) -> dict[str, object]:
    """Lengths in mm, times in s, shares in percent."""
    scene, result, channel = outcome.scene, outcome.result, outcome.scene.channel
    window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
    field, colours, shares = outcome.field, fraction_colours(list(scene.fraction)), scene.mass_shares()
    loop = None if field is None else field.period
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
        "start": None if field is None or field.times is None else float(field.times[0]),
        "played": PLAYED,
        "frames": frames,
        "wakes": _wakes(result),
    }


def _flat(line: Array) -> list[float]:
    return [round(float(MM * x), 2) for x in line.ravel()]


def _bin(scene: Scene, result: Result, name: str) -> dict[str, object]:
    """A bin's line, and what lands in it in words."""
    found = None if result.landings is None else result.landings.separation
    void = result.void
    shares = {} if found is None else {
        one: part_text(places[name], void=void) for one, places in found.fractions.items()
    }  # fmt: skip
    flow = None if found is None or void else found.throughput[name]
    pure = {} if found is None else {
        one: part_text(row, void=void) for one, row in (found.purity[name] or {}).items()
    }  # fmt: skip
    return {
        "name": name, "line": _flat(scene.bin[name].line(scene)), "shares": shares, "purity": pure, "flow": flow
    }  # fmt: skip


def _tracks(tracks: Sequence[Track], count: int) -> list[dict[str, object]]:
    """At most ``count`` tracks at even times: when each begins (s), its step (s), and its x and y in tenths of a
    millimetre.
    """
    found = []
    for number in np.linspace(0, len(tracks) - 1, min(count, len(tracks))).astype(int):
        track = tracks[number]
        time = track["time"]
        if len(time) < 2 or time[-1] <= time[0]:
            continue
        even = np.linspace(time[0], time[-1], POINTS)
        points = np.rint(10 * MM * Path2D.of(track).at(even)[0]).astype(int)
        found.append({"from": float(time[0]), "step": float(even[1] - even[0]), "at": points.ravel().tolist()})
    return found


def _wakes(result: Result) -> dict[str, object]:
    """Shares (%) by wake, fraction and bin: the answer first, with its interval; then other wakes."""
    landings = result.landings
    if landings is None:
        return {"answer": {}, "interval": {}, "others": {}}
    fractions, others = landings.separation.fractions, dict[str, dict[str, dict[str, float]]]()
    for name, places in (landings.bracket or {}).items():
        for place, found in places.items():
            for wake, share in found.items():
                others.setdefault(wake, {}).setdefault(name, {})[place] = 100 * share
    return {
        "answer": {name: {place: 100 * one.value for place, one in row.items()} for name, row in fractions.items()},
        "interval": {
            name: {place: [100 * one.low, 100 * one.high] for place, one in row.items()}
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
    times = [0.0] if field.times is None else moments_of(field, FRAMES if field.period else 1).tolist()
    strongest = vorticity.strongest()
    found = []
    for time in times:
        stream = io.BytesIO()
        Image.fromarray(vorticity.shaded(time, strongest)).save(stream, "JPEG", quality=QUALITY, optimize=True)
        found.append("data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii"))
    return found
