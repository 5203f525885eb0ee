"""``wakeflow verify crowd``: the slab beside LIGGGHTS, OpenFOAM's clouds and kinetic theory, as one report."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.files import write_json
from ...foam.version import openfoam_version
from ...funnel.engine import liggghts_version
from ...planning.unknowns import SIGMAS
from ...results.spread import student
from ...tracking import Granules
from .beside import compare_machine
from .clouds import CASE, CloudFlight, fly_clouds, fly_foam_clouds, two_clouds
from .cooling import Gas, cooling_row
from .kept import kept_flight
from .liggghts import SoftSpheres
from .machine import the_machine

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["crowd_tables", "run_crowd"]

Tell = Callable[[str], None]
Row = dict[str, Any]
BASE = SoftSpheres()
VARIANTS = {  # of LIGGGHTS
    "half the stiffness": replace(BASE, modulus=0.5 * BASE.modulus),
    "half the time step": replace(BASE, steps=2.0 * BASE.steps),
    "tangential springs": replace(BASE, tangential="history"),
}
CLOUD = 300  # granules each of the two
FOAM = ("DPMFoam", "MPPICFoam")
MEASURES = ("crossed", "middle", "spread")


@dataclass(frozen=True)
class _Effort:
    """Replicates of the machine, each of an ``operation`` (s); of the clouds; of a gas of each of ``restitutions``."""

    replicates: int
    operation: float
    clouds: int
    gas: int
    restitutions: tuple[float, ...]


QUICK = _Effort(3, 0.5, 2, 3, (0.9,))
SLOW = _Effort(8, 1.0, 3, 4, (0.9, 0.8, 0.6))


def run_crowd(folder: Path, *, slow: bool, tell: Tell) -> dict[str, Any]:
    """Compute every row; ``crowd.json`` in ``folder`` holds the report. ``slow``: more replicates, the variants of
    LIGGGHTS, more restitutions of the gas; a quarter of an hour of one core. Raises ProgramError without LIGGGHTS,
    FoamError without OpenFOAM.
    """
    how = SLOW if slow else QUICK
    versions = {"liggghts": liggghts_version(), "openfoam": openfoam_version()}
    soft = {"LIGGGHTS": BASE} | (VARIANTS if slow else {})
    fly_clouds(two_clouds(2, 0))  # compiled kernels are loaded before anything is timed
    machine = the_machine(how.operation)
    report: dict[str, Any] = {
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "versions": versions,
        "machine": compare_machine(machine, how.replicates, soft, tell),
        "clouds": _clouds(how.clouds, tell),
        "gas": [],
    }
    for restitution in how.restitutions:
        tell(f"a gas of restitution {restitution:g} cools")
        report["gas"].append(cooling_row(Gas(restitution=restitution), how.gas))
    report["notes"] = _notes(report)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "crowd.json", json.loads(json.dumps(report)))
    return report


def _clouds(replicates: int, tell: Tell) -> list[Row]:
    flown: dict[str, list[CloudFlight]] = {name: [] for name in ("each alone", "slab", *FOAM)}
    for seed in range(replicates):
        grains = two_clouds(CLOUD, seed)
        flown["each alone"].append(fly_clouds(grains, collide=False))
        flown["slab"].append(fly_clouds(grains))
        for solver in FOAM:
            tell(f"clouds {seed + 1} of {replicates}: {solver}")
            flown[solver].append(_by_openfoam(solver, grains))
    found = {name: np.array([landed.shares() for landed in several]) for name, several in flown.items()}
    return [
        {"way": name, "seconds": sum(landed.seconds for landed in flown[name]) / replicates}
        | {key: _interval(values[:, i]) for i, key in enumerate(MEASURES)}
        | {f"{key}_more": _paired(flown[name], flown["slab"], i) for i, key in enumerate(MEASURES[:2])}
        for name, values in found.items()
    ]


def _by_openfoam(solver: str, grains: Granules) -> CloudFlight:
    def work(folder: Path) -> tuple[NDArray[np.float64], float]:
        landed = fly_foam_clouds(solver, grains, folder)
        return landed.x, landed.seconds

    return CloudFlight(*kept_flight(solver, ("clouds.py", CASE.name), grains, openfoam_version(), work))


def _interval(values: Any) -> tuple[float, float, float]:
    """Mean and Student's 95 % interval of values (n,), n > 1."""
    value, count = float(np.mean(values)), len(values)
    half = student(count - 1) * float(np.std(values, ddof=1)) / count**0.5
    return value, value - half, value + half


def _paired(theirs: Sequence[CloudFlight], ours: Sequence[CloudFlight], which: int) -> tuple[float, float, float]:
    """Mean difference of a share and its 95 % interval over the pairs of clouds; no narrower than by McNemar's test,
    from the granules that fared differently.
    """
    one, other = (np.array([flight.outcomes()[which] for flight in flights]) for flights in (theirs, ours))
    value, low, high = _interval(one.mean(axis=1) - other.mean(axis=1))
    half = max(0.5 * (high - low), SIGMAS * float(np.sqrt((one != other).sum())) / one.size)
    return value, value - half, value + half


def _notes(report: dict[str, Any]) -> list[str]:
    machine = report["machine"]
    seconds = machine["seconds"]
    slower = seconds["LIGGGHTS"] / seconds["slab"]
    return [
        f"intervals: Student's from {machine['replicates']} replicates of the feed, {machine['granules']} granules in "
        "all; differences are paired, each replicate's feed is the same for both",
        f"processor seconds of all replicates: slab {seconds['slab']:.1f}, step search included; LIGGGHTS "
        f"{seconds['LIGGGHTS']:.1f}, {slower:.0f} times as many, the starts of its runs included",
    ]


def crowd_tables(report: dict[str, Any]) -> list[Table]:
    """The machine by bins, the variants of LIGGGHTS, the clouds, and the gas."""
    machine = report["machine"]
    found = [_machine_table(machine)]
    if machine["variants"]:
        found.append(_variant_table(machine))
    return [*found, _cloud_table(report["clouds"]), _gas_table(report["gas"])]


def _table(title: str, *columns: str) -> Table:
    from rich.table import Table

    made = Table(*columns, title=title, title_justify="left", pad_edge=False, box=None)
    for column in made.columns[1:]:
        column.justify = "right"
    return made


def _percent(row: Sequence[float]) -> str:
    return f"{100 * row[0]:.2f} ± {50 * (row[2] - row[1]):.2f}"


def _machine_table(machine: dict[str, Any]) -> Table:
    made = _table(
        "machine in a vacuum, 500 kg/h: shares in %",
        "bin",
        "slab",
        "LIGGGHTS",
        "difference",
        "agree",
    )
    for row in machine["rows"]:
        shares = (_percent(row[key]) for key in ("ours", "theirs", "difference"))
        made.add_row(row["bin"], *shares, "yes" if row["agree"] else "no")
    return made


def _variant_table(machine: dict[str, Any]) -> Table:
    names = [row["bin"] for row in machine["rows"]]
    made = _table("LIGGGHTS varied: its shares less those above, points of %", "variant", *names, "seconds")
    for variant in machine["variants"]:
        rows = {row["bin"]: _percent(row["difference"]) for row in variant["rows"]}
        cells = [rows.get(name, "–") for name in names]
        made.add_row(variant["name"], *cells, f"{machine['seconds'][variant['name']]:.0f}")
    return made


def _cloud_table(rows: Sequence[Row]) -> Table:
    made = _table(
        f"two clouds of {CLOUD} granules meet in rising air, 95 %",
        "way", "crossed %", "less the slab's", "in the middle %", "less the slab's", "rms of x mm", "seconds",
    )  # fmt: skip
    for row in rows:
        shares = (_percent(row[key]) for key in ("crossed", "crossed_more", "middle", "middle_more"))
        low, high = row["spread"][1:]
        spread = f"{1e3 * row['spread'][0]:.1f} ± {500 * (high - low):.1f}"
        made.add_row(row["way"], *shares, spread, f"{row['seconds']:.2f}")
    return made


def _gas_table(rows: Sequence[Row]) -> Table:
    made = _table(
        "a gas of smooth spheres cools: measured over kinetic theory, 95 %",
        "restitution", "granules", "volume fraction", "collision frequency", "cooling rate", "seconds",
    )  # fmt: skip
    for row in rows:
        ratios = (f"{row[key][0]:.3f} ± {0.5 * (row[key][2] - row[key][1]):.3f}" for key in ("frequency", "cooling"))
        filled = f"{row['filled']:.2f}"
        made.add_row(f"{row['restitution']:g}", str(row["granules"]), filled, *ratios, f"{row['seconds']:.0f}")
    return made
