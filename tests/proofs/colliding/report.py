"""``wakeflow verify collisions``: the slab next to LIGGGHTS, OpenFOAM's clouds and kinetic theory, as one report.

The machine in a vacuum by the slab and by LIGGGHTS: bin shares, their intervals and paired differences. What other
programs flew is kept in the cache.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.colliding.clouds import CASE, CloudFlight, fly_clouds, fly_foam_clouds, two_clouds
from proofs.colliding.cooling import Gas, cooling_row
from proofs.colliding.liggghts import Flown, Machine, SoftSpheres, fed, fly_liggghts, fly_machine, the_machine
from proofs.report import Column, Interval, Report, Row, Table, Tell, cell, mean_interval, plus_minus
from wakeflow.air.foam.programs import openfoam_version
from wakeflow.answer.spread import share_interval
from wakeflow.core.store import Store, cache_root, content_key, digest_files
from wakeflow.extras.funnel.engine import liggghts_version
from wakeflow.flight import Granules
from wakeflow.planning.unknowns import SIGMAS
from wakeflow.scene import RESERVED_BIN

FILE = "found.npz"
HERE = Path(__file__).parent


def kept_flight(
    peer: str,
    sources: Sequence[str],
    grains: Granules,
    settings: Any,
    work: Callable[[Path], tuple[NDArray[Any], float]],
) -> tuple[NDArray[Any], float]:
    """What ``work(folder)`` found for each granule, and processor seconds: from the cache, or computed.

    Kept by the ``peer``'s name, its ``sources`` in this folder, the granules, and JSON-able ``settings``.
    """

    def make(folder: Path) -> None:
        found, seconds = work(folder)
        np.savez(folder / FILE, found=found, seconds=np.array(seconds))

    key = content_key(peer, settings, _fingerprint(grains), digest_files([HERE / name for name in sources]))
    folder, _ = Store(cache_root()).make("verify-collisions", key, make)
    with np.load(folder / FILE) as data:
        return data["found"], float(data["seconds"])


def _fingerprint(grains: Granules) -> str:
    total = hashlib.sha256()
    for name in ("position", "velocity", "time", "depth", "diameter", "density", "restitution", "friction"):
        total.update(np.ascontiguousarray(getattr(grains, name), dtype=float).tobytes())
    return total.hexdigest()


Array = NDArray[np.float64]
SOURCES = ("liggghts.py", "machine.liggghts")


def compare_machine(
    machine: Machine, replicates: int, soft: Mapping[str, SoftSpheres], tell: Tell = lambda _: None
) -> dict[str, Any]:
    """Fly ``replicates`` of the machine's feed by the slab and by LIGGGHTS' ``soft`` spheres, the first of which is
    the one compared and the others its variants. Raises ProgramError as LIGGGHTS does.

    The report's ``rows``: a bin's share by both and the paired difference, (value, low, high) with 95 % intervals over
    the replicates. ``variants``: the same differences from the first kind of soft spheres, and the seconds of each.
    """
    ways: dict[str, list[Flown]] = {name: [] for name in ("slab", *soft)}
    counted, step = [], None
    for replicate in range(replicates):
        grains, steady = fed(machine, replicate)
        counted.append(steady)
        tell(f"replicate {replicate + 1} of {replicates}: the slab")
        flown, step = fly_machine(machine, grains, replicate, step)
        ways["slab"].append(flown)
        for name, spheres in soft.items():
            tell(f"replicate {replicate + 1} of {replicates}: LIGGGHTS, {name}")
            ways[name].append(_by_liggghts(machine, grains, spheres))
    shares = {name: _shares(flights, counted, len(machine.scene.bin)) for name, flights in ways.items()}
    total = int(sum(steady.sum() for steady in counted))
    first, *others = soft
    names = [*machine.scene.bin, RESERVED_BIN]
    return {
        "granules": total,
        "replicates": replicates,
        "step": step,
        "rows": _rows(names, shares["slab"], shares[first], total),
        "variants": [{"name": name, "rows": _rows(names, shares[first], shares[name], total)} for name in others],
        "seconds": {name: sum(flown.seconds for flown in flights) for name, flights in ways.items()},
    }


def _by_liggghts(machine: Machine, grains: Granules, spheres: SoftSpheres) -> Flown:
    def work(folder: Path) -> tuple[NDArray[np.int64], float]:
        flown = fly_liggghts(machine, grains, spheres, folder)
        return flown.place, flown.seconds

    how = asdict(spheres) | {"restitution": machine.restitution, "friction": machine.friction}
    settings = [how, machine.scene.model_dump(mode="json"), machine.depth, liggghts_version()]
    return Flown(*kept_flight("liggghts", SOURCES, grains, settings, work))


def _shares(flights: list[Flown], counted: list[NDArray[np.bool_]], bins: int) -> Array:
    """Shares (replicates, bins + 1) of what came in steady operation; the last: elsewhere."""
    found = [
        np.bincount(flown.place[steady] % (bins + 1), minlength=bins + 1) / steady.sum()
        for flown, steady in zip(flights, counted, strict=True)
    ]
    return np.stack(found)


def _rows(names: list[str], ours: Array, theirs: Array, total: int) -> list[dict[str, Any]]:
    found = []
    for number, name in enumerate(names):
        own, other = ours[:, number], theirs[:, number]
        if own.any() or other.any():
            difference = mean_interval(other - own, 0.5 / total)
            found.append({
                "bin": name,
                "ours": tuple(share_interval(own, total)),
                "theirs": tuple(share_interval(other, total)),
                "difference": difference,
                "agree": bool(difference[1] <= 0.0 <= difference[2]),
            })  # fmt: skip
    return found


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


def run_collisions(*, slow: bool, tell: Tell) -> Report:
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
    return Report("collisions", collision_tables(facts), facts, _notes(facts["vacuum"]))


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


def collision_tables(facts: Row) -> list[Table]:
    """The machine by bins, the variants of LIGGGHTS, the clouds, and the gas."""
    machine = facts["vacuum"]
    tables = [Table("machine in a vacuum, 500 kg/h: shares in %", MACHINE, machine["rows"])]
    if machine["variants"]:
        tables.append(_variant_table(machine))
    clouds = f"two clouds of {CLOUD} granules meet in rising air, 95 %"
    gas = "a gas of smooth spheres cools: measured over kinetic theory, 95 %"
    return [*tables, Table(clouds, CLOUDS, facts["clouds"]), Table(gas, GAS, facts["gas"])]


def _variant_table(machine: Row) -> Table:
    none = {row["bin"]: None for row in machine["rows"]}
    rows = [
        {"name": one["name"], "seconds": machine["seconds"][one["name"]], **none}
        | {row["bin"]: cell(plus_minus("difference", factor=100), row) for row in one["rows"]}
        for one in machine["variants"]
    ]
    columns = {"variant": "{name}", **{name: f"{{{name}}}" for name in none}, "seconds": "{seconds:.0f}"}
    return Table("LIGGGHTS varied: its shares less those above, points of %", columns, rows)
