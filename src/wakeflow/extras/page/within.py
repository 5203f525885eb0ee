"""What happens within the machine of a finished run, for its drawing: tracks of granules, and the air on a grid."""

from __future__ import annotations

import math

import numpy as np

from ...answer.result import Result
from ...show.moving import Path2D
from ...show.plot import outcome_of

TRACKS, CORNERS = 25, 150  # of a fraction that are drawn; of a track
ACROSS = 24  # arrows over the width of the channel


def within(result: Result) -> dict[str, object]:
    """By fraction the places (m) of some tracks; the mean ``air`` as rows x, y (m), u, v (m/s), none without air.
    Raises SceneError where the run left no report to draw from.
    """
    found = outcome_of(result)
    channel = found.scene.channel
    step = (channel.top - channel.bottom) / CORNERS
    tracks = {
        name: [np.round(_thinned(path.at(path.moments(step))[0]), 5).tolist() for path in map(Path2D.of, own[:TRACKS])]
        for name, own in found.tracks.items()
    }
    if found.field is None:
        return {"tracks": tracks, "air": []}
    step = channel.width / ACROSS
    x = np.arange(-channel.width / 2 + step / 2, channel.width / 2, step)
    y = np.arange(channel.bottom + step / 2, channel.top, step)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    velocity = found.field.mean().sample(points)[0]
    rows = np.hstack([points, velocity])[np.isfinite(velocity).all(axis=1)]
    return {"tracks": tracks, "air": np.round(rows, 5).tolist()}


def _thinned(places: np.ndarray) -> np.ndarray:
    """Every so many of the places of a track, its end among them."""
    every = max(1, math.ceil(len(places) / CORNERS))
    return np.concatenate([places[:-1:every], places[-1:]])
