"""The tables of a scene: what their keys mean, their units and ranges. TOML in, SI numbers out."""

from .common import Table
from .funnel import Funnel
from .granules import Feed, Fraction, Profile, Rebound, Size, Speeds
from .pictures import Picture, picture_tables
from .surroundings import Air, Body, Channel, Inlet, Samples, Vibration
from .whole import Bin, Numerics, SceneTables

__all__ = [
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
    "SceneTables",
    "Size",
    "Speeds",
    "Table",
    "Vibration",
    "picture_tables",
]
