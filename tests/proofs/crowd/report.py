"""``wakeflow verify crowd``: the slab beside LIGGGHTS, OpenFOAM's clouds and kinetic theory, as one report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.crowd.beside import compare_machine
from proofs.crowd.clouds import CASE, CloudFlight, fly_clouds, fly_foam_clouds, two_clouds
from proofs.crowd.cooling import Gas, cooling_row
from proofs.crowd.kept import kept_flight
from proofs.crowd.liggghts import SoftSpheres
from proofs.crowd.machine import the_machine
from proofs.report import NOTHING, Column, Report, Row, Table, Tell
from proofs.rows import Interval, mean_interval, plus_minus
from wakeflow.foam.version import openfoam_version
from wakeflow.funnel.engine import liggghts_version
from wakeflow.planning.unknowns import SIGMAS
from wakeflow.tracking import Granules

BASE = SoftSpheres()
VARIANTS = {  # of LIGGGHTS
    "half the stiffness": replace(BASE, modulus=0.5 * BASE.modulus),
    "half the time step": replace(BASE, steps=2.0 * BASE.steps),
    "tangential springs": replace(BASE, tangential="history"),
}
CLOUD = 300  # granules each of the two
FOAM = ("DPMFoam", "MPPICFoam")
MACHINE: dict[str, Column] = {
    "bin": "{bin}", "slab": plus_minus("ours", factor=100), "LIGGGHTS": plus_minus("theirs", factor=100),
    "difference": plus_minus("difference", factor=100), "agree": "{agree:yes|no}",
}  # fmt: skip
CLOUDS: dict[str, Column] = {
    "way": "{way}", "crossed %": plus_minus("crossed", factor=100),
    "crossed, less the slab's": plus_minus("crossed_more", factor=100),
    "in the middle %": plus_minus("middle", factor=100),
    "in the middle, less the slab's": plus_minus("middle_more", factor=100),
    "rms of x mm": plus_minus("spread", 1, 1e3), "seconds": "{seconds:.2f}",
}  # fmt: skip
GAS: dict[str, Column] = {
    "restitution": "{restitution:g}", "granules": "{granules}", "volume fraction": "{filled:.2f}",
    "collision frequency": plus_minus("frequency", 3), "cooling rate": plus_minus("cooling", 3),
    "seconds": "{seconds:.0f}",
}  # fmt: skip
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


def run_crowd(*, slow: bool, tell: Tell) -> Report:
    """Compute every row; ``slow``: more replicates, the variants of
    LIGGGHTS, more restitutions of the gas; a quarter of an hour of one core. Raises ProgramError without LIGGGHTS,
    FoamError without OpenFOAM.
    """
    how = SLOW if slow else QUICK
    versions = {"liggghts": liggghts_version(), "openfoam": openfoam_version()}
    soft = {"LIGGGHTS": BASE} | (VARIANTS if slow else {})
    fly_clouds(two_clouds(2, 0))  # compiled kernels are loaded before anything is timed
    machine = the_machine(how.operation)
    facts: dict[str, Any] = {
        "versions": versions,
        "vacuum": compare_machine(machine, how.replicates, soft, tell),
        "clouds": _clouds(how.clouds, tell),
        "gas": [],
    }
    for restitution in how.restitutions:
        tell(f"a gas of restitution {restitution:g} cools")
        facts["gas"].append(cooling_row(Gas(restitution=restitution), how.gas))
    return Report("crowd", crowd_tables(facts), facts, _notes(facts["vacuum"]))


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
        | {key: mean_interval(values[:, i]) for i, key in enumerate(MEASURES)}
        | {f"{key}_more": _paired(flown[name], flown["slab"], i) for i, key in enumerate(MEASURES[:2])}
        for name, values in found.items()
    ]


def _by_openfoam(solver: str, grains: Granules) -> CloudFlight:
    def work(folder: Path) -> tuple[NDArray[np.float64], float]:
        landed = fly_foam_clouds(solver, grains, folder)
        return landed.x, landed.seconds

    return CloudFlight(*kept_flight(solver, ("clouds.py", CASE.name), grains, openfoam_version(), work))


def _paired(theirs: Sequence[CloudFlight], ours: Sequence[CloudFlight], which: int) -> Interval:
    """Mean difference of a share and its 95 % interval over the pairs of clouds; no narrower than by McNemar's test,
    from the granules that fared differently.
    """
    one, other = (np.array([flight.outcomes()[which] for flight in flights]) for flights in (theirs, ours))
    least = SIGMAS * float(np.sqrt((one != other).sum())) / one.size
    return mean_interval(one.mean(axis=1) - other.mean(axis=1), least)


def _notes(machine: Row) -> list[str]:
    seconds = machine["seconds"]
    slower = seconds["LIGGGHTS"] / seconds["slab"]
    return [
        f"intervals: Student's from {machine['replicates']} replicates of the feed, {machine['granules']} granules in "
        "all; differences are paired, each replicate's feed is the same for both",
        f"processor seconds of all replicates: slab {seconds['slab']:.1f}, step search included; LIGGGHTS "
        f"{seconds['LIGGGHTS']:.1f}, {slower:.0f} times as many, the starts of its runs included",
    ]


def crowd_tables(facts: Row) -> list[Table]:
    """The machine by bins, the variants of LIGGGHTS, the clouds, and the gas."""
    machine = facts["vacuum"]
    tables = [Table("machine in a vacuum, 500 kg/h: shares in %", MACHINE, machine["rows"])]
    if machine["variants"]:
        tables.append(_variant_table(machine))
    clouds = f"two clouds of {CLOUD} granules meet in rising air, 95 %"
    gas = "a gas of smooth spheres cools: measured over kinetic theory, 95 %"
    return [*tables, Table(clouds, CLOUDS, facts["clouds"]), Table(gas, GAS, facts["gas"])]


def _variant_table(machine: Row) -> Table:
    rows = [
        {"name": one["name"], "seconds": machine["seconds"][one["name"]]}
        | {row["bin"]: plus_minus("difference", factor=100)(row) for row in one["rows"]}
        for one in machine["variants"]
    ]
    bins: dict[str, Column] = {row["bin"]: lambda r, bin=row["bin"]: r.get(bin, NOTHING) for row in machine["rows"]}
    columns: dict[str, Column] = {"variant": "{name}", **bins, "seconds": "{seconds:.0f}"}
    return Table("LIGGGHTS varied: its shares less those above, points of %", columns, rows)
