"""The machine in a vacuum by the slab and by LIGGGHTS: bin shares, their intervals and paired differences."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.crowd.kept import kept_flight
from proofs.crowd.liggghts import SoftSpheres, fly_liggghts
from proofs.crowd.machine import Flown, Machine, fed, fly_machine
from proofs.rows import mean_interval
from wakeflow.funnel.engine import liggghts_version
from wakeflow.results.separation import share_interval
from wakeflow.scene import RESERVED_BIN
from wakeflow.tracking import Granules

Array = NDArray[np.float64]
Tell = Callable[[str], None]
SOURCES = ("machine.py", "liggghts.py", "machine.liggghts")


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
                "ours": share_interval(own, total),
                "theirs": share_interval(other, total),
                "difference": difference,
                "agree": bool(difference[1] <= 0.0 <= difference[2]),
            })  # fmt: skip
    return found
