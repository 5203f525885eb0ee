"""Granule materials: size, density, terminal velocity and rebound, each with its source and how far to trust it.

The data stand in materials.toml, with the words for ``confidence`` at its head. What one granule has and another has
not is a standard deviation from granule to granule; a fraction draws for each of its own (scene/fraction.py).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..core.registry import Registry
from .restitution import Restitution

__all__ = ["Evidence", "Material", "materials"]

SPREAD = ("restitution", "friction", "terminal_velocity")  # quantities with a mean and a standard deviation


@dataclass(frozen=True)
class Evidence:
    """How far to trust a number: ``confidence`` measured, typical or low, and its ``source``."""

    confidence: str
    source: str


@dataclass(frozen=True)
class Material:
    """Properties of one granule material against steel, in SI units; ``terminal_velocity`` in air at 20 C.

    ``restitution_std``, ``friction_std`` and ``terminal_velocity_std``: from granule to granule.
    """

    diameter: float  # m, volume-equivalent
    density: float  # kg/m3, of the particle itself, not bulk
    terminal_velocity: float | None  # m/s; None: a sphere, drag from the law
    restitution: float | Restitution  # normal, against steel; a scene may give a law of the approach speed
    friction: float  # sliding, against steel
    confidence: str  # of size and terminal velocity
    source: str
    restitution_std: float = 0.0
    friction_std: float = 0.0
    terminal_velocity_std: float = 0.0  # m/s
    rebound_scatter: float = 0.0  # rad, rms angle by which its shape turns the wall's normal at an impact
    tangential_restitution: float = 0.0  # of a contact that sticks
    impact: str = "paper"  # name of its impact model: how a blow turns it
    evidence: Mapping[str, Evidence] = field(default_factory=dict)  # of each of the quantities, by name

    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))


materials: Registry[Material] = Registry("material")


def _read(table: dict[str, Any]) -> Material:
    """A material of materials.toml."""
    own = {key: value for key, value in table.items() if not isinstance(value, dict)}
    parts = {key: value for key, value in table.items() if isinstance(value, dict)}
    own.setdefault("terminal_velocity", None)
    for name, part in parts.items():
        own[name] = part["model"] if name == "impact" else part["value"]
        if name in SPREAD:
            own[f"{name}_std"] = part["std"]
    evidence = {name: Evidence(part["confidence"], part["source"]) for name, part in parts.items()}
    return Material(**own, evidence=evidence)


for _name, _table in tomllib.loads(Path(__file__).with_name("materials.toml").read_text(encoding="utf-8")).items():
    materials.add(_name, _read(_table))
