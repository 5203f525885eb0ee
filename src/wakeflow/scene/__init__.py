"""What can be asked: a scene and its tables, what their keys mean, their units and ranges. TOML in, SI numbers out.

Comes in: the text of a scene file and the user's files that it names. Goes out: a Scene, or a SceneError of one line.
May call it: every room after it. Names are loaded on first use: the command line reads the list of rungs and needs
nothing else of this package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..core.lazy import loaded

if TYPE_CHECKING:
    from .bins import Bin
    from .checks import OVER_THE_TOP
    from .feed import CollisionTable, Feed, Funnel, Profile
    from .fraction import Coefficient, Fraction, Rebound, Size, Speeds
    from .machine import Air, Body, Channel, Inlet, Samples, Vibration
    from .pictures import Picture, picture_tables
    from .scene import Scene, units_written
    from .scene_tables import Numerics, SceneTables
    from .table import RESERVED_BIN, Table

__all__ = [
    "OVER_THE_TOP", "RESERVED_BIN", "Air", "Bin", "Body", "Channel", "Coefficient", "CollisionTable", "Feed",
    "Fraction", "Funnel", "Inlet", "Numerics", "Picture", "Profile", "Rebound", "Samples", "Scene", "SceneTables",
    "Size", "Speeds", "Table", "Vibration", "picture_tables", "units_written",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    return loaded(__name__, name)
