"""What can be asked: a scene and its tables, what their keys mean, their units and ranges. TOML in, SI numbers out.

Names are loaded on first use: the command line reads the list of rungs and needs nothing else of this package.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bins import Bin
    from .consistency import RESERVED_BIN
    from .crowding import Crowding
    from .distributions import Size, Speeds
    from .feed import Feed, Profile
    from .fraction import Fraction
    from .funnel import Funnel
    from .pictures import Picture, picture_tables
    from .rebound import Coefficient, Rebound
    from .scene import Scene, units_written
    from .surroundings import Air, Body, Channel, Inlet, Samples, Vibration
    from .table import Table
    from .whole import Numerics, SceneTables

_HOMES = {
    "RESERVED_BIN": "consistency",
    "Air": "surroundings",
    "Bin": "bins",
    "Body": "surroundings",
    "Channel": "surroundings",
    "Crowding": "crowding",
    "Coefficient": "rebound",
    "Feed": "feed",
    "Fraction": "fraction",
    "Funnel": "funnel",
    "Inlet": "surroundings",
    "Numerics": "whole",
    "Picture": "pictures",
    "Profile": "feed",
    "Rebound": "rebound",
    "Samples": "surroundings",
    "Scene": "scene",
    "SceneTables": "whole",
    "Size": "distributions",
    "Speeds": "distributions",
    "Table": "table",
    "Vibration": "surroundings",
    "picture_tables": "pictures",
    "units_written": "scene",
}
__all__ = [
    "RESERVED_BIN",
    "Air",
    "Bin",
    "Body",
    "Channel",
    "Coefficient",
    "Crowding",
    "Feed",
    "Fraction",
    "Funnel",
    "Inlet",
    "Numerics",
    "Picture",
    "Profile",
    "Rebound",
    "Samples",
    "Scene",
    "SceneTables",
    "Size",
    "Speeds",
    "Table",
    "Vibration",
    "picture_tables",
    "units_written",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
