"""The tables of a scene: what their keys mean, their units and ranges. TOML in, SI numbers out."""

from .common import GRAVITY, STANDARD_AIR, Table
from .granules import Feed, Fraction, Profile, Rebound, Size, Speeds
from .surroundings import Air, Body, Channel, Inlet, Vibration
from .whole import Bin, Numerics, SceneTables

__all__ = [
    "GRAVITY",
    "STANDARD_AIR",
    "Air",
    "Bin",
    "Body",
    "Channel",
    "Feed",
    "Fraction",
    "Inlet",
    "Numerics",
    "Profile",
    "Rebound",
    "SceneTables",
    "Size",
    "Speeds",
    "Table",
    "Vibration",
]
