"""Bin shares of the shipped scene beside those of OpenFOAM's own parcels: the same granules, air, forces and bins.

Three ways for the same granules: this tracker on the field that a run uses, this tracker on the interpolant that
OpenFOAM uses, and OpenFOAM's ``icoUncoupledKinematicParcelFoam``. The first two differ by the interpolation of one
airflow; the last two differ by the trackers and, where granules meet walls, by the laws of contact: OpenFOAM's parcels
are points at walls and lose the share mu of their tangential velocity, ours have a radius and dry friction.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.report import Column, Interval, Report, Row, Table, Tell, mean_interval, plus_minus
from proofs.tracker.curves import BenchmarkCase, benchmark_case, shipped
from proofs.tracker.foam import FINE_PARCELS, FoamInterpolant, fly_parcels, make_foam_interpolant
from proofs.tracker.peer import bins_of, flown_here, landed_time
from wakeflow.answer.spread import share_interval
from wakeflow.flight import Tracks
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.scene import RESERVED_BIN, Scene

Array = NDArray[np.float64]
FRACTIONS: dict[str, tuple[str, dict[str, Any]]] = {  # name: (fraction of the scene, changes of the scene)
    "wheat": ("wheat", {"feed.mode": "injected"}),  # heavy ones with their velocity after the impact
    "chaff": ("chaff", {"feed.mode": "injected"}),
    "dust": ("dust", {"feed.mode": "resolved"}),  # from above the body
    "dust, elastic": (  # both laws of contact are then the same, except for the radius
        "dust",
        {"feed.mode": "resolved", "fraction.dust.restitution": 1.0, "fraction.dust.friction": 0.0},
    ),
}
COLUMNS: dict[str, Column] = {
    "fraction": "{fraction}", "bin": "{place}", "ours, a run's field": plus_minus("own"),
    "ours, OpenFOAM's interpolant": plus_minus("same"), "OpenFOAM": plus_minus("peer"),
    "difference": plus_minus("difference"), "without contacts": plus_minus("free"),
}  # fmt: skip
COUNT, SLOW = 2048, 16384  # granules a fraction
TOLERANCE = 1e-4  # body widths, as in the shipped scene


def run_shares(*, slow: bool = False, tell: Tell = lambda _: None) -> Report:
    """Fly every fraction three ways.

    ``slow``: eight times as many granules. Raises FoamError when OpenFOAM is not installed.
    """
    scene, _, pipeline = shipped(lambda stage, text: tell(f"{stage}: {text}"))
    count = SLOW if slow else COUNT
    rows, met = compare_shares(scene, pipeline, count, tell)
    title = f"bin shares of {count} granules a fraction, %, with 95 % intervals"
    notes = [f"{name}: {100 * share:.2g} % of the granules meet a wall" for name, share in met.items()]
    facts = {"granules": count, "rows": rows, "met_walls": met}
    return Report("shares", [Table(title, COLUMNS, rows)], facts, notes)


def compare_shares(
    scene: Scene, pipeline: Pipeline, count: int, tell: Tell = lambda _: None
) -> tuple[list[Row], dict[str, float]]:
    """Rows for every fraction and bin of ``scene`` in its steady airflow, and the share of each that meets walls."""
    rows: list[Row] = []
    met: dict[str, float] = {}
    own = pipeline.field[1]
    with tempfile.TemporaryDirectory(prefix="wakeflow-peer-") as room:
        tell("meshing the channel for OpenFOAM's parcels")
        foam = make_foam_interpolant(
            own, pipeline.air.in_case.mesh_spec, scene.channel.top, scene.channel.bottom, Path(room)
        )
        for name, (fraction, changes) in FRACTIONS.items():
            tell(f"{name}: ours")
            case = benchmark_case(name, "steady", scene, foam.field, count, (fraction, changes))
            mine, same = (flown_here(case, scene, air) for air in (own, foam.field))
            tell(f"{name}: OpenFOAM's parcels")
            there = _theirs(case, foam, float(np.nanmax(landed_time(same))), Path(room, "run"))
            met[name] = float(np.mean(same.impacts > 0))
            rows += _rows(name, scene, case, [bins_of(case, x) for x in (_x(mine), _x(same), there)], same.impacts == 0)
    return rows, met


def _x(tracks: Tracks) -> Array:
    """Where granules crossed the floor (n,) m, NaN where they did not."""
    return np.where(tracks.line == 0, tracks.position[:, 0], np.nan)


def _theirs(case: BenchmarkCase, foam: FoamInterpolant, longest: float, folder: Path) -> Array:
    until = 1.05 * longest
    found, _ = fly_parcels(foam, case.grains, **FINE_PARCELS, until=until, folder=folder)
    return found.position[:, 0]


def _rows(
    name: str, scene: Scene, case: BenchmarkCase, found: list[NDArray[np.int64]], free: NDArray[np.bool_]
) -> list[Row]:
    """One row a bin that any of the three ways reaches: shares in percent, (value, low, high) with 95 % intervals over
    the replicates, ``own`` on the field of a run, ``same`` on OpenFOAM's interpolant. ``difference``: OpenFOAM's less
    ours in the same air, paired by replicate; ``free``: the same over the granules that meet no wall, None without any.
    """
    names = [*sorted(scene.bin, key=lambda b: float(scene.bin[b].start or 0.0)), RESERVED_BIN]
    rows = []
    for number, place in enumerate(names):
        inside = [bins == number for bins in found]
        if not any(way.any() for way in inside):
            continue
        own, same, peer = (_share(case, way) for way in inside)
        lone = _paired(case, inside[2], inside[1], free) if free.any() else None
        every = np.ones(len(free), dtype=bool)
        difference = _paired(case, inside[2], inside[1], every)
        means = {"own": own, "same": same, "peer": peer, "difference": difference, "free": lone}
        rows.append({"fraction": name, "place": place, **means})
    return rows


def _by_replicate(case: BenchmarkCase, values: Array, chosen: NDArray[np.bool_]) -> Array:
    """Means (r,) over the chosen granules of each replicate that has any."""
    total = np.bincount(case.replicate[chosen], values[chosen])
    count = np.bincount(case.replicate[chosen])
    return np.asarray(total[count > 0] / count[count > 0])


def _share(case: BenchmarkCase, inside: NDArray[np.bool_]) -> Interval:
    value, low, high = share_interval(
        _by_replicate(case, inside.astype(float), np.ones(len(inside), dtype=bool)), len(inside)
    )
    return 100 * value, 100 * low, 100 * high


def _paired(
    case: BenchmarkCase, theirs: NDArray[np.bool_], ours: NDArray[np.bool_], chosen: NDArray[np.bool_]
) -> Interval:
    """Mean difference of shares (percent) over the replicates, Student's t; no narrower than half a granule in all."""
    parts = _by_replicate(case, theirs.astype(float) - ours.astype(float), chosen)
    return mean_interval(100 * parts, 100 * 0.5 / max(int(chosen.sum()), 1))
