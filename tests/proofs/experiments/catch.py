"""Clouds of drops of measured sizes that air carries against a cylinder: what it keeps of them, and where.

Each table of catch.toml is a cloud. What air takes from the share that straight flight would bring is told in parts:
the drag (potential flow, drops that begin far ahead: Stokes' drag, then the sphere's), the feed (the same, from where
the scene lets them go), the mean air (the solved airflow in place of potential flow, without dispersion) and its
turbulence (as flown). What is left to the measurement is the miss.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.experiments.ideal import kept_between, on_a_cylinder
from proofs.report import Report, Row, Table, Tell
from wakeflow.core.number import Number
from wakeflow.runs import run
from wakeflow.scene import Scene

Array = NDArray[np.float64]
NARROW = 1e-6  # relative: a size of the table of sizes is that wide
STRIP = 0.01  # m along the surface, in which the local catch is averaged, both sides together
FLOWN = {"the air's mean": {"dispersion": False}, "its turbulence": {}}
COLUMNS = {
    "cloud": "{cloud}", "up to": "{upto}", "kept": "{kept:.3f}", "low": "{low:.3f}", "high": "{high:.3f}",
    "takes": "{takes:+.3f}", "less than measured": "{short:+.3f}", "gate": "{gate}", "met": "{met:yes|NO}",
}  # fmt: skip
BY_SIZE = {
    "cloud": "{cloud}", "um": "{size:.1f}", "part": "{part:g}", "potential flow, Stokes": "{stokes:.3f}",
    "sphere's drag": "{sphere:.3f}", "without dispersion": "{mean:.3f}", "flown": "{flown:.3f}",
}  # fmt: skip
LOCAL = {
    "cloud": "{cloud}", "cm from the foremost line": "{strip}", "measured": "{low:.3f} to {high:.3f}",
    "potential flow": "{ideal:.3f}", "flown": "{flown:.3f}", "gate": "{gate}", "met": "{met:yes|NO}",
}  # fmt: skip


@dataclass(frozen=True)
class Cloud:
    """A table of catch.toml; SI units."""

    name: str
    title: str
    width: float
    speed: float
    turbulence: float
    gas: tuple[float, float]
    liquid: float
    sizes: tuple[float, ...]
    parts: tuple[float, ...]
    tunnel: tuple[float, float, float]
    feed: tuple[float, float]
    kept: float
    within: float
    repeats: float
    source: str
    catch: Mapping[str, list[list[float]]] = field(default_factory=dict)

    @property
    def ends(self) -> Array:
        """Ends (m) of the strips, to where no curve has any catch left."""
        last = max(abs(s) for curve in self.catch.values() for s, _ in curve)
        return STRIP * np.arange(1 + np.ceil(0.01 * last / STRIP))

    @property
    def measured(self) -> Array:
        """Local catch in each strip, (curves, strips)."""
        found = []
        for curve in self.catch.values():
            s, beta = 0.01 * np.array(curve)[:, 0], np.array(curve)[:, 1]
            fine = np.linspace(-self.ends[-1], self.ends[-1], 4001)
            values = np.interp(fine, s, beta, left=0.0, right=0.0)
            strip = np.minimum((np.abs(fine) / STRIP).astype(int), len(self.ends) - 2)
            found.append([values[strip == one].mean() for one in range(len(self.ends) - 1)])
        return np.array(found)


@cache
def clouds() -> tuple[Cloud, ...]:
    """Every cloud of catch.toml, in its sequence."""
    return read_clouds(tomllib.loads((Path(__file__).parent / "catch.toml").read_text(encoding="utf-8")))


def read_clouds(tables: Mapping[str, Mapping[str, Any]]) -> tuple[Cloud, ...]:
    """The clouds in plain tables."""
    return tuple(Cloud(name=name, **table) for name, table in tables.items())


def scene_of(cloud: Cloud, count: int, scale: float) -> Scene:
    """The drops, each alone, of all sizes in one fraction, let go at rest so high that air brings them to its speed."""
    (width, top, bottom), (height, curtain) = cloud.tunnel, cloud.feed
    around = np.array([1.0 - NARROW, 1.0 + NARROW])
    ends = np.concatenate([[0.0], np.cumsum(cloud.parts) / np.sum(cloud.parts)])
    size = {
        "distribution": "table", "diameters": np.outer(cloud.sizes, around).ravel().tolist(),
        "passing": [*np.repeat(ends, 2)[1:-2].tolist(), 1.0],
    }  # fmt: skip
    return Scene.parse({
        "body": {"cylinder": {"shape": "circle", "width": cloud.width}},
        "channel": {"width": width, "top": top, "bottom": bottom, "walls": "slip"},
        "air": dict(zip(("density", "viscosity"), cloud.gas, strict=True)) | {
            "speed": cloud.speed, "turbulence": cloud.turbulence,
        },
        "feed": {"height": height, "width": curtain, "mode": "resolved", "count": count},
        "fraction": {"drops": {
            "size": size, "density": cloud.liquid, "restitution": 0.0, "friction": 1.0, "impact": "sphere",
        }},
        "bin": {"cylinder": {"on": "cylinder"}, "floor": {"from": -0.5 * width, "to": 0.5 * width}},
        "uncertainty": {"air.turbulence": 0.0, "feed.width": 0.0, "air.speed": 0.0},
        "numerics": {"mesh_scale": scale, "keep": count},
    })  # fmt: skip


def run_catch(
    folder: Path, tell: Tell = lambda _: None, count: int = 2048, scale: float = 1.0, rung: str = "draft"
) -> Report:
    """Of all clouds, in the airflow of a ``rung``."""
    tables: dict[str, list[Row]] = {"parts": [], "sizes": [], "strips": []}
    for cloud in clouds():
        for name, rows in one_cloud(cloud, folder, tell, count, scale, rung).items():
            tables[name] += rows
    missed = [
        f"{row['cloud']}, {row.get('upto', row.get('strip'))}" for rows in tables.values() for row in rows
        if row.get("met") is False
    ]  # fmt: skip
    shown = [
        Table("drops kept by a cylinder: what takes how much", COLUMNS, tables["parts"]),
        Table("the same by size", BY_SIZE, tables["sizes"]), Table("local catch", LOCAL, tables["strips"]),
    ]  # fmt: skip
    sources = list(dict.fromkeys(cloud.source for cloud in clouds()))
    return Report("catch", shown, {"rows": tables["parts"], **tables}, sources, missed)


def one_cloud(cloud: Cloud, folder: Path, tell: Tell, count: int, scale: float, rung: str) -> dict[str, list[Row]]:
    """Rows of the parts, the sizes and the strips of one cloud."""
    scene, half, wider = scene_of(cloud, count, scale), 0.5 * cloud.width, cloud.feed[1] / cloud.width
    sizes, parts = np.array(cloud.sizes), np.array(cloud.parts) / np.sum(cloud.parts)
    law = scene.fraction["drops"].drag_law
    theory = [
        on_a_cylinder(cloud.width, cloud.speed, sizes, cloud.liquid, cloud.gas, *way)
        for way in (("stokes",), (law,), (law, scene.release))
    ]
    by_size = [one.reach / half for one in theory]
    kept = [Number(float(parts @ one)) for one in by_size]
    for number, force in enumerate(FLOWN.values()):
        tell(f"{cloud.title}: {[*FLOWN][number]}, rung {rung}")
        where = folder / f"catch-{cloud.name}-{rung}-{number}"
        result = run(scene, where, rung=rung, force={"collisions": False, **force}, report=False)
        kept.append(result.share("drops", "cylinder").times(wider))
        flown = result.granules()
        on = np.array(flown["bin"]) == "cylinder"
        which = np.argmin(np.abs(np.array(flown["diameter"])[:, None] - sizes), axis=1)
        by_size.append(wider * np.bincount(which, on, len(sizes)) / np.maximum(np.bincount(which, None, len(sizes)), 1))
    strips: list[Row] = []
    if cloud.catch:
        top = scene.body["cylinder"].outline()[:, 1].max()
        along = half * np.arctan2(np.abs(np.array(flown["x"]))[on], half - top + np.array(flown["y"])[on])
        local = wider * half * np.histogram(along, cloud.ends)[0] / len(on) / STRIP
        strips = strips_of(cloud, parts @ kept_between(theory[1], half, cloud.ends), local)
    return {
        "parts": parts_of(cloud, kept),
        "sizes": [
            {"cloud": cloud.name, "size": 1e6 * size, "part": part, "stokes": one[0], "sphere": one[1],
             "mean": one[3], "flown": one[4]}
            for size, part, one in zip(sizes, parts, np.transpose(by_size), strict=True)
        ],
        "strips": strips,
    }  # fmt: skip


def parts_of(cloud: Cloud, kept: list[Number]) -> list[Row]:
    """What is kept, part by part; the last is judged."""
    rows: list[Row] = []
    for name, one in zip(("Stokes' drag", "a sphere's drag", "the feed", *FLOWN), kept, strict=True):
        low, high = one.ends
        rows.append({
            "case": "catch", "cloud": cloud.name, "title": cloud.title, "upto": name, "kept": one.value, "low": low,
            "high": high, "takes": one.value - rows[-1]["kept"] if rows else None, "short": cloud.kept - one.value,
            "gate": None, "met": None, "source": cloud.source,
        })  # fmt: skip
    rows[-1] |= {
        "gate": f"{cloud.kept:g} within {cloud.within:g}", "met": abs(rows[-1]["short"]) <= cloud.within
    }  # fmt: skip
    return rows


def strips_of(cloud: Cloud, ideal: Array, flown: Array) -> list[Row]:
    """Local catch: within the curves and what the largest repeats to."""
    measured = cloud.measured
    off, rows = cloud.repeats * float(measured.mean(axis=0).max()), []
    for number, (low, high) in enumerate(zip(measured.min(axis=0), measured.max(axis=0), strict=True)):
        begin, end = 100.0 * cloud.ends[number : number + 2]
        rows.append({
            "cloud": cloud.name, "strip": f"{begin:g} to {end:g}", "low": low, "high": high, "ideal": ideal[number],
            "flown": flown[number], "gate": f"within {off:.3f} of these",
            "met": bool(low - off <= flown[number] <= high + off), "source": cloud.source,
        })  # fmt: skip
    return rows
