"""Bin shares of the shipped scene beside those of OpenFOAM's own parcels: the same granules, air, forces and bins.

Three ways for the same granules: this tracker on the field that a run uses, this tracker on the interpolant that
OpenFOAM uses, and OpenFOAM's ``icoUncoupledKinematicParcelFoam``. The first two differ by the interpolation of one
airflow; the last two differ by the trackers and, where granules meet walls, by the laws of contact: OpenFOAM's parcels
are points at walls and lose the share mu of their tangential velocity, ours have a radius and dry friction.
"""

from __future__ import annotations

import datetime
import json
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files import write_json
from ...field import FlowField
from ...pipeline.pipeline import Pipeline
from ...results.separation import share_interval
from ...scene import RESERVED_BIN, Scene
from ...tracking import Tracks, track
from .benchmark_cases import BenchmarkCase, benchmark_case, shipped
from .foam_interpolant import FoamInterpolant, make_foam_interpolant
from .foam_parcels import FINE_PARCELS, fly_parcels

__all__ = [
    "FRACTIONS",
    "BinRow",
    "bins_of",
    "compare_shares",
    "flown_here",
    "landed_time",
    "run_shares",
]

Array = NDArray[np.float64]
Tell = Callable[[str], None]
FRACTIONS: dict[str, tuple[str, dict[str, Any]]] = {  # name: (fraction of the scene, changes of the scene)
    "wheat": ("wheat", {"feed.mode": "injected"}),  # heavy ones with their velocity after the impact
    "chaff": ("chaff", {"feed.mode": "injected"}),
    "dust": ("dust", {"feed.mode": "resolved"}),  # from above the body
    "dust, elastic": (  # both laws of contact are then the same, except for the radius
        "dust",
        {"feed.mode": "resolved", "fraction.dust.restitution": 1.0, "fraction.dust.friction": 0.0},
    ),
}
COUNT, SLOW = 2048, 16384  # granules a fraction
TOLERANCE = 1e-4  # body widths, as in the shipped scene


@dataclass(frozen=True)
class BinRow:
    """A bin's share of one fraction in percent, (value, low, high) with 95 % intervals over the replicates.

    ``difference``: OpenFOAM's less ours in the same air, paired by replicate; ``free``: the same over the granules that
    meet no wall after they entered.
    """

    fraction: str
    place: str
    own: tuple[float, float, float]  # ours, on the field of a run
    same: tuple[float, float, float]  # ours, on OpenFOAM's interpolant
    peer: tuple[float, float, float]
    difference: tuple[float, float, float]
    free: tuple[float, float, float] | None  # None where every granule meets a wall


def run_shares(folder: Path, *, slow: bool = False, tell: Tell = lambda _: None) -> dict[str, Any]:
    """Fly every fraction three ways, write ``shares.json`` into ``folder``, return the report.

    ``slow``: eight times as many granules. Raises FoamError when OpenFOAM is not installed.
    """
    scene, _, pipeline = shipped(lambda stage, text: tell(f"{stage}: {text}"))
    rows, met = compare_shares(scene, pipeline, SLOW if slow else COUNT, tell)
    report: dict[str, Any] = {
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "granules": SLOW if slow else COUNT,
        "rows": [asdict(row) for row in rows],
        "met_walls": met,
        "notes": [f"{name}: {100 * share:.2g} % of the granules meet a wall" for name, share in met.items()],
    }
    write_json(folder / "shares.json", json.loads(json.dumps(report)))
    return report


def compare_shares(
    scene: Scene, pipeline: Pipeline, count: int, tell: Tell = lambda _: None
) -> tuple[list[BinRow], dict[str, float]]:
    """Rows for every fraction and bin of ``scene`` in its steady airflow, and the share of each that meets walls."""
    rows: list[BinRow] = []
    met: dict[str, float] = {}
    own = pipeline.field[1]
    with tempfile.TemporaryDirectory(prefix="wakeflow-peer-") as room:
        tell("meshing the channel for OpenFOAM's parcels")
        foam = make_foam_interpolant(own, pipeline.mesh_spec, scene.channel.top, scene.channel.bottom, Path(room))
        for name, (fraction, changes) in FRACTIONS.items():
            tell(f"{name}: ours")
            case = benchmark_case(name, "steady", scene, foam.field, count, (fraction, changes))
            mine, same = (flown_here(case, scene, air) for air in (own, foam.field))
            tell(f"{name}: OpenFOAM's parcels")
            there = _theirs(case, foam, float(np.nanmax(landed_time(same))), Path(room, "run"))
            met[name] = float(np.mean(same.impacts > 0))
            rows += _rows(name, scene, case, [bins_of(case, x) for x in (_x(mine), _x(same), there)], same.impacts == 0)
    return rows, met


def flown_here(case: BenchmarkCase, scene: Scene, air: FlowField) -> Tracks:
    """The case's granules flown by this tracker through ``air`` down to the scene's floor."""
    p, half = case.problem, scene.channel.width
    floor = np.array([(-half, scene.channel.bottom), (half, scene.channel.bottom)])
    return track(
        air, case.grains, until=p.until, tolerance=TOLERANCE, length=p.length, forces=p.forces, drag=p.drag,
        bodies=p.bodies, lines=(floor,), gravity=p.gravity,
    )  # fmt: skip


def _x(tracks: Tracks) -> Array:
    """Where granules crossed the floor (n,) m, NaN where they did not."""
    return np.where(tracks.line == 0, tracks.position[:, 0], np.nan)


def landed_time(tracks: Tracks) -> Array:
    """When granules crossed the floor (n,) s, NaN where they did not."""
    return np.where(tracks.line == 0, tracks.time, np.nan)


def _theirs(case: BenchmarkCase, foam: FoamInterpolant, longest: float, folder: Path) -> Array:
    until = 1.05 * longest
    found = fly_parcels(foam, case.grains, **FINE_PARCELS, until=until, folder=folder)
    return found.position[:, 0]


def bins_of(case: BenchmarkCase, x: Array) -> NDArray[np.int64]:
    """The place of each granule among the bins from left to right; their number where it reached none."""
    place = np.searchsorted(case.bins, x, side="right") - 1
    last = len(case.bins) - 1
    return np.where(np.isfinite(x) & (place >= 0) & (place < last), place, last)


def _rows(
    name: str, scene: Scene, case: BenchmarkCase, found: list[NDArray[np.int64]], free: NDArray[np.bool_]
) -> list[BinRow]:
    """One row a bin that any of the three ways reaches."""
    names = [*sorted(scene.bin, key=lambda b: float(scene.bin[b].start or 0.0)), RESERVED_BIN]
    rows = []
    for number, place in enumerate(names):
        inside = [bins == number for bins in found]
        if not any(way.any() for way in inside):
            continue
        own, same, peer = (_share(case, way) for way in inside)
        lone = _paired(case, inside[2], inside[1], free) if free.any() else None
        every = np.ones(len(free), dtype=bool)
        rows.append(BinRow(name, place, own, same, peer, _paired(case, inside[2], inside[1], every), lone))
    return rows


def _by_replicate(case: BenchmarkCase, values: Array, chosen: NDArray[np.bool_]) -> Array:
    """Means (r,) over the chosen granules of each replicate that has any."""
    total = np.bincount(case.replicate[chosen], values[chosen])
    count = np.bincount(case.replicate[chosen])
    return np.asarray(total[count > 0] / count[count > 0])


def _share(case: BenchmarkCase, inside: NDArray[np.bool_]) -> tuple[float, float, float]:
    value, low, high = share_interval(
        _by_replicate(case, inside.astype(float), np.ones(len(inside), dtype=bool)), len(inside)
    )
    return 100 * value, 100 * low, 100 * high


def _paired(
    case: BenchmarkCase, theirs: NDArray[np.bool_], ours: NDArray[np.bool_], chosen: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Mean difference of shares (percent) over the replicates, Student's t; no narrower than half a granule in all."""
    from scipy.stats import t

    parts = _by_replicate(case, theirs.astype(float) - ours.astype(float), chosen)
    value, half = float(parts.mean()), 0.5 / max(int(chosen.sum()), 1)
    if len(parts) > 1:
        half = max(half, float(t.ppf(0.975, len(parts) - 1) * parts.std(ddof=1) / np.sqrt(len(parts))))
    return 100 * value, 100 * (value - half), 100 * (value + half)
