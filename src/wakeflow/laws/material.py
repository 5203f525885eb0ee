"""Granule materials with their sources; what is measured (terminal velocity) is stored, what is derived is not.

The equivalent diameter is that of the sphere of equal volume. Where a terminal velocity is stored, drag is calibrated to
it: shape correlations with the "sphericity" that agricultural papers quote (it is d_g / length, not the surface ratio) give
terminal velocities 35 to 45 % too low for wheat and barley.

``confidence`` says how far to trust the row: ``measured`` (numbers from the named paper), ``typical`` (inside published
ranges, no single source) or ``low`` (no primary source found; measure your own material).
"""

from __future__ import annotations

from dataclasses import dataclass

from ..registry import Registry

__all__ = ["Material", "materials"]


@dataclass(frozen=True)
class Material:
    """Properties of one granule material against steel, in SI units; ``terminal_velocity`` in air at 20 C."""

    diameter: float  # m, volume-equivalent
    density: float  # kg/m3, of the particle itself, not bulk
    terminal_velocity: float | None  # m/s; None: a sphere, drag from the law
    restitution: float  # normal, against steel
    friction: float  # sliding, against steel
    confidence: str
    source: str


materials: Registry[Material] = Registry("material")

materials.add("wheat", Material(3.88e-3, 1300.0, 7.8, 0.50, 0.35, "measured",
    "kernel 6.18 x 2.80 x 2.21 mm, d_g 3.88 mm, v_t 7.80-8.53 m/s (Sakha 93); v_t 6.81-8.63 m/s (Khoshtaghaza & Mehdizadeh 2006); "
    "true density 847-1240 kg/m3, friction 0.28-0.45 (Int. Agrophys. 17, 207, 2003); restitution 0.4-0.6 typical"))  # fmt: skip
materials.add("barley", Material(4.42e-3, 1250.0, 7.4, 0.45, 0.35, "measured",
    "kernel 9.85 x 3.52 x 2.49 mm, d_g 4.42 mm, v_t 6.98-7.80 m/s (Giza 130); density, restitution 0.4-0.5 and friction typical"))  # fmt: skip
materials.add("rapeseed", Material(1.80e-3, 1230.0, 6.5, 0.60, 0.35, "typical",
    "d_g 1.62-2.02 mm, true density 1156-1302 kg/m3 (Razavi et al. 2009); friction on steel 0.25-0.50 (Chen 2019); "
    "v_t 5.6-7.5 m/s computed for sphericity 0.9 to 1; restitution 0.5-0.7 typical"))  # fmt: skip
materials.add("straw", Material(6.37e-3, 128.0, 3.35, 0.20, 0.40, "measured",
    "wheat stem internodes 3.62-3.76 mm x 12.5-12.8 mm, 113-144 kg/m3, v_t 3.13-3.58 m/s (Womac et al., doi 10.13031/ja.15580); "
    "restitution and friction typical"))  # fmt: skip
materials.add("chaff", Material(1.30e-3, 200.0, 1.75, 0.20, 0.40, "low",
    "glumes and husks 3-10 x 1-3 x 0.1 mm, 100-300 kg/m3, v_t 0.7-3.5 m/s, typically 1.5-2.0; no primary source found"))  # fmt: skip
materials.add("dust", Material(50e-6, 1500.0, None, 0.10, 0.50, "typical",
    "grain dust 5-100 um, 1400-1500 kg/m3; sphere drag; restitution and friction low confidence"))  # fmt: skip
materials.add("glass-beads", Material(1.2e-3, 2500.0, None, 0.90, 0.20, "measured",
    "beads of 1.1-1.3 mm, 2500 kg/m3 (Spade, Vaicis, Vutukuru & Irbe 2020); sphere drag (v_t 7.85 m/s by Brown & Lawler); "
    "restitution on steel 0.9-0.97, friction typical"))  # fmt: skip
