"""The tracker: inertial granules through a field on triangles, past walls that may vibrate, each with its own clock.

Comes in: a FlowField, Granules, bodies. Goes out: Tracks; of a scene's stages (``stages``) Landings. Its folders are
rooms: kernel, collisions, feed, stages.
May call it: a user (``wf.track``), every room after it. ``track`` and its compiler are loaded on first use, so that
granules and bodies cost nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..core.lazy import loaded
from .bodies import Body, Collisions, Motion
from .granules import Granules
from .tracks import ClockStep, Fate, Tracks

if TYPE_CHECKING:
    from .driver import track

__all__ = ["Body", "ClockStep", "Collisions", "Fate", "Granules", "Motion", "Tracks", "track"]


def __getattr__(name: str) -> Any:
    return loaded(__name__, name)
