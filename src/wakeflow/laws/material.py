"""Granule materials with their sources; what is measured (terminal velocity) is stored, what is derived is not.

The equivalent diameter is that of the sphere of equal volume. Where a terminal velocity is stored, drag is calibrated
to it: shape correlations with the "sphericity" that agricultural papers quote (it is d_g / length, not the surface
ratio) give terminal velocities 35 to 45 % too low for wheat and barley.

``confidence`` says how far to trust the row: ``measured`` (numbers from the named paper), ``typical`` (inside published
ranges, no single source) or ``low`` (no primary source found; measure your own material).
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.registry import Registry
from .restitution import Restitution

__all__ = ["Material", "materials"]


@dataclass(frozen=True)
class Material:
    """Properties of one granule material against steel, in SI units; ``terminal_velocity`` in air at 20 C."""

    diameter: float  # m, volume-equivalent
    density: float  # kg/m3, of the particle itself, not bulk
    terminal_velocity: float | None  # m/s; None: a sphere, drag from the law
    restitution: float | Restitution  # normal, against steel; a scene may give a law of the approach speed
    friction: float  # sliding, against steel
    confidence: str
    source: str


materials: Registry[Material] = Registry("material")

materials.add("wheat", Material(
    diameter=3.88e-3, density=1300.0, terminal_velocity=7.8, restitution=0.50, friction=0.35, confidence="measured",
    source="kernel 6.18 x 2.80 x 2.21 mm, d_g 3.88 mm, v_t 7.80-8.53 m/s (Sakha 93); v_t 6.81-8.63 m/s at 7-20 % "
    "moisture (Khoshtaghaza & Mehdizadeh 2006); friction on steel 0.28-0.45 (Int. Agrophysics 17, 207, 2003); density "
    "and restitution (0.4-0.6 on steel) typical",
))  # fmt: skip
materials.add("barley", Material(
    diameter=4.42e-3, density=1250.0, terminal_velocity=7.4, restitution=0.45, friction=0.35, confidence="measured",
    source="kernel 9.85 x 3.52 x 2.49 mm, d_g 4.42 mm, v_t 6.98-7.80 m/s (variety Giza 130); density, restitution "
    "(0.4-0.5 on steel) and friction typical",
))  # fmt: skip
materials.add("rapeseed", Material(
    diameter=1.80e-3, density=1230.0, terminal_velocity=6.5, restitution=0.60, friction=0.35, confidence="typical",
    source="d_g 1.62-2.02 mm, true density 1156-1302 kg/m3 (Razavi 2009); friction on steel 0.25-0.50 (Chen 2019); "
    "v_t 5.6-7.5 m/s computed for sphericity 0.9 to 1; restitution 0.5-0.7 typical",
))  # fmt: skip
materials.add("straw", Material(
    diameter=6.37e-3, density=128.0, terminal_velocity=3.35, restitution=0.20, friction=0.40, confidence="measured",
    source="wheat stem internodes 3.62-3.76 mm x 12.5-12.8 mm, 113-144 kg/m3, v_t 3.13-3.58 m/s (Womac et al., doi "
    "10.13031/ja.15580); restitution and friction typical",
))  # fmt: skip
materials.add("chaff", Material(
    diameter=1.30e-3, density=200.0, terminal_velocity=1.75, restitution=0.20, friction=0.40, confidence="low",
    source="glumes and husks 3-10 x 1-3 x 0.1 mm, 100-300 kg/m3, v_t 0.7-3.5 m/s, often 1.5-2; no primary source found",
))  # fmt: skip
materials.add("dust", Material(
    diameter=50e-6, density=1500.0, terminal_velocity=None, restitution=0.10, friction=0.50, confidence="typical",
    source="grain dust 5-100 um, 1400-1500 kg/m3, drag of a sphere; restitution and friction are guesses",
))  # fmt: skip
materials.add("glass-beads", Material(
    diameter=1.2e-3, density=2500.0, terminal_velocity=None, restitution=0.90, friction=0.20, confidence="measured",
    source="beads of 1.1-1.3 mm, 2500 kg/m3 (Spade et al. 2020, doi 10.22616/ERDev.2020.19.TF365), drag "
    "of a sphere (v_t 7.85 m/s by Brown & Lawler 2003); restitution on steel 0.9-0.97 and friction typical",
))  # fmt: skip
