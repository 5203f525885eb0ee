"""What can be asked: a scene and its tables, what their keys mean, their units and ranges. TOML in, SI numbers out."""

from .bins import Bin
from .consistency import RESERVED_BIN
from .feed import Feed, Profile
from .fraction import Fraction, Rebound, Size, Speeds
from .funnel import Funnel
from .pictures import Picture, picture_tables
from .scene import Scene
from .surroundings import Air, Body, Channel, Inlet, Samples, Vibration
from .table import Table
from .whole import Numerics, SceneTables

__all__ = [
    "RESERVED_BIN",
    "Air",
    "Bin",
    "Body",
    "Channel",
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
]
