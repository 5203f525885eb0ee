"""The tracker: inertial granules through a field on triangles, past walls that may vibrate, each with its own clock."""

from __future__ import annotations

from .driver import track
from .granules import Body, Fate, Granules, Motion, Tracks

__all__ = ["Body", "Fate", "Granules", "Motion", "Tracks", "track"]
