"""Straw in a leg of upward air: stem nodes and internodes part fully, as their measured terminal velocities say.

Read in abstracts: internodes of wheat straw are suspended at 3.13 to 3.58 m/s, nodes at 4.62 to 5.14 m/s, no overlap
(Womac et al., doi 10.13031/ja.15580); wheat at 7.04 to 7.74 m/s (Khoshtaghaza & Mehdizadeh 2006, Agric. Eng. Int. CIGR
8). The speeds are inputs: what is tested is that a leg of the scene's size, where they
enter by their momentum and spread in the air's turbulence, parts what a still column parts.
"""

from __future__ import annotations

from pathlib import Path

from proofs.report import Report, Row, Table, Tell
from wakeflow.core.files import scene_templates
from wakeflow.runs import run
from wakeflow.scene import Scene

SOURCE = "Womac et al., doi 10.13031/ja.15580; Khoshtaghaza & Mehdizadeh 2006 (abstracts read)"
SPEEDS = (3.0, 4.1, 6.0, 7.9)  # m/s, of the air: between the ranges; within one granules hover, and take long to part
RANGES = {  # m/s: terminal velocities as they were measured
    "internodes": (3.13, 3.58), "nodes": (4.62, 5.14), "wheat": (7.04, 7.74),
}  # fmt: skip
MATERIALS = {"internodes": "straw", "nodes": "straw-nodes", "wheat": "wheat"}
WHOLE = 0.98  # share that counts as all: the abstract's "no overlap"
COLUMNS = {
    "air, m/s": "{speed:.1f}", **{f"{name} carried over, %": f"{{{name}:.1f*100}}" for name in RANGES},
    "measured": "{gate}", "met": "{met:yes|NO}",
}  # fmt: skip


def leg(speed: float, count: int) -> Scene:
    """`cases/aspirator.toml` with the three fractions and so much air, no granule in another's way."""
    tables = Scene.load(scene_templates()["aspirator"]).tables()
    tables["air"]["speed"] = speed
    tables["feed"] = {**{k: v for k, v in tables["feed"].items() if k not in ("rate", "depth")}, "count": count}
    tables["fraction"] = {
        name: {
            "material": MATERIALS[name], "mass_share": 1.0 / len(RANGES), "target": "light",
            "terminal_velocity": {"distribution": "uniform", "low": low, "high": high},
        }
        for name, (low, high) in RANGES.items()
    }  # fmt: skip
    tables["uncertainty"] = {"air.turbulence": 0.0}
    return Scene.parse(tables)


def expected(speed: float) -> dict[str, bool]:
    """What is carried over (True) or falls (False) in a still column."""
    return {name: speed > high for name, (_, high) in RANGES.items()}


def run_suspension(folder: Path, tell: Tell = lambda _: None, count: int = 256) -> Report:
    """Of all speeds."""
    rows: list[Row] = []
    for speed in SPEEDS:
        tell(f"straw in {speed} m/s")
        found = run(leg(speed, count), folder / f"leg-{speed}", force={"collisions": False}, report=False)
        over = {name: found.share(name, "light").value for name in RANGES}
        wanted = expected(speed)
        met = all(over[name] >= WHOLE if up else over[name] <= 1.0 - WHOLE for name, up in wanted.items())
        gate = "; ".join(f"{name} {'rises' if up else 'falls'}" for name, up in wanted.items())
        rows.append({"case": "suspension", "speed": speed, **over, "gate": gate, "met": met, "source": SOURCE})
    missed = [f"suspension at {row['speed']} m/s" for row in rows if not row["met"]]
    table = Table("straw and wheat in a leg of upward air", COLUMNS, rows)
    return Report("suspension", [table], {"rows": rows}, [SOURCE], missed)
