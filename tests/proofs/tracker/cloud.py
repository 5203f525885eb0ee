"""OpenFOAM's own parcels inside its time-resolved solver: what they cost there, and how far their steps lead astray.

The solver goes on from the last state of the scene's airflow, with the function object ``icoUncoupledKinematicCloud``
after each of its time steps and without. The difference of processor time is the cloud's. Its parcels feel drag
(Putnam's law), gravity and the eddies of ``stochasticDispersionRAS``, touch walls with their centres, and see the air
of the end of each time step. The tracker is compared with the same forces; what all forces of the answer cost stands
next to it.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofs.report import Tell
from proofs.tracker.curves import as_spheres
from proofs.tracker.flights import REFERENCE, WANTED, FlownKind
from proofs.tracker.foam import CLOUD, FoamInterpolant, interpolant, write_cloud, write_gravity, write_properties
from proofs.tracker.rk4 import KNOWN_FORCES
from wakeflow.air.field import FlowField
from wakeflow.air.foam.case import write_parameters
from wakeflow.air.foam.polymesh import read_polymesh
from wakeflow.air.foam.programs import call
from wakeflow.air.foam.read import time_folders
from wakeflow.air.foam.solver import last_state, states
from wakeflow.core.record import JsonTable
from wakeflow.flight import Granules

Array = NDArray[np.float64]
SOLVER = "pimpleFoam"
SETTINGS = {
    0.3: 16384,
    0.03: 4096,
}  # maxCo, the share of a cell that a parcel flies at a time: parcels of a timed cloud
FINEST = 0.003  # maxCo of the parcels that the others are compared with
SCHEME, EDDIES = "analytical", "stochasticDispersionRAS"
FEW = 512  # parcels of a cloud whose error is measured
PATTERNS = (r"^Time = (\S+)$", r"^ExecutionTime = (\S+) s", r"Current number of parcels\s*= (\d+)")  # in the log
FUNCTION = """
writeFormat ascii;
functions
{
    granules
    {
        type icoUncoupledKinematicCloud;
        libs ("liblagrangianFunctionObjects.so" "liblagrangianTurbulence.so");
    }
}
"""
COLUMNS = {
    "granule": "{kind}", "wakeflow without eddies: median": "{own_median:.1e}", "95 %": "{own_p95:.1e}",
    "with eddies: CPU us": "{ours:.3g*1e6}", "with all forces: CPU us": "{all_forces:.3g*1e6}",
    "OpenFOAM's cloud: maxCo": "{courant:g}", "without eddies: median": "{median:.1e}", "95 % ": "{p95:.1e}",
    "with eddies: CPU us ": "{cpu:.3g*1e6}", "times faster": "{times:.3g}",
}  # fmt: skip
EQUAL = {
    "granule": "{kind}", "error, body widths": "{own_median:.1e}", "wakeflow: CPU us": "{ours:.3g*1e6}",
    "OpenFOAM's cloud: CPU us": "{cpu:.3g*1e6}", "times faster": "{times:.3g}", "the cloud's cost": "{how}",
}  # fmt: skip


@dataclass(frozen=True)
class SolvedCase:
    """A finished case of the time-resolved solver, its last state, and its mesh to place parcels in."""

    folder: Path
    state: Path
    foam: FoamInterpolant

    @classmethod
    def of(cls, folder: Path, air: FlowField) -> SolvedCase:
        """The case in a ``folder``, through which ``air`` flows."""
        mesh = read_polymesh(folder)
        plane = mesh.plane
        still = interpolant(plane, np.zeros_like(plane.centres), np.zeros_like(plane.points), air)
        return cls(folder, states(folder)[-1], FoamInterpolant(folder, still, 0.5 * mesh.thickness, mesh))

    def copy(self, folder: Path, span: float) -> Path:
        """A case in ``folder`` that goes on for ``span`` (s) on one rank, and its first time folder."""
        shutil.rmtree(folder, ignore_errors=True)
        for name in ("constant", "system", self.state.name):
            shutil.copytree(self.folder / name, folder / name)
        end = last_state(self.folder) + span
        write_parameters(folder, {
            "startFrom": "latestTime", "endTime": end, "writeControl": "adjustableRunTime", "writeInterval": span,
            "purgeWrite": 0, "ranks": 1,
        })  # fmt: skip
        return folder / self.state.name


@dataclass(frozen=True)
class SolverLog:
    """Of each time step but the last: flow ``time`` (s), processor time ``spent`` (s), and ``parcels`` after it."""

    time: Array
    spent: Array
    parcels: Array

    @classmethod
    def of(cls, folder: Path) -> SolverLog:
        """That of a run in a ``folder``: neither its start nor what it writes at the end counts."""
        text = (folder / f"log.{SOLVER}").read_text()
        time, spent, parcels = (np.array(re.findall(one, text, re.M), dtype=float)[:-1] for one in PATTERNS)
        return cls(time, spent - spent[0], parcels)

    @property
    def flown(self) -> float:
        """Parcels times the seconds that they flew."""
        return float(np.diff(self.time) @ self.parcels[:-1])


def fly_cloud(
    case: SolvedCase, grains: Granules, courant: float, span: float, folder: Path, dispersion: str = "none"
) -> SolverLog:
    """Run the solver with the cloud of ``grains`` for a ``span`` (s) in ``folder``; ``courant``: its maxCo.

    Raises FoamError as OpenFOAM does.
    """
    state = case.copy(folder, span)
    spheres = as_spheres(grains)
    write_properties(folder, spheres, SCHEME, courant, dispersion)
    write_cloud(case.foam, spheres, state)
    write_gravity(folder)
    with (folder / "constant" / "transportProperties").open("a") as stream:
        stream.write(f"\nrho {case.foam.field.density:.17g};\n")
    with (folder / "system" / "controlDict").open("a") as stream:
        stream.write(FUNCTION)
    call(folder, [SOLVER])
    return SolverLog.of(folder)


def cloud_rows(
    case: SolvedCase, kinds: Sequence[tuple[FlownKind, JsonTable]], folder: Path, tell: Tell
) -> Iterator[JsonTable]:
    """A row a kind of granule (with our own row of it, of all forces) and setting: processor seconds of a flight with
    eddies that is as long as ours in the mean. Errors (body widths) are of flights without eddies: of ours those of
    landings, of the parcels how far across the channel they are at the end from those of the finest setting.
    """
    tell(f"{SOLVER} alone")
    case.copy(folder, max(ours["flight"] for _, ours in kinds))
    call(folder, [SOLVER])
    alone = SolverLog.of(folder)
    for one, ours in kinds:
        span, width = ours["flight"], one.flight.scene.width
        calm, stirred = one.with_forces(KNOWN_FORCES), one.with_forces({*KNOWN_FORCES, "dispersion"})
        own, cost = calm.apart(calm.fly(WANTED), calm.fly(REFERENCE)), stirred.cost(WANTED)
        finest = _across(case, one, FINEST, span, folder, tell)
        for courant, parcels in SETTINGS.items():
            off = np.abs(_across(case, one, courant, span, folder, tell) - finest) / width
            tell(f"{one.kind}: {SOLVER} with the cloud, maxCo {courant:g}")
            many = one.grains[np.arange(parcels) % len(one.grains)]
            log = fly_cloud(case, many, courant, span, folder, EDDIES)
            spent = float(log.spent[-1] - np.interp(log.time[-1], alone.time, alone.spent))
            its = spent * span / log.flown
            yield {
                "kind": one.kind, "own_median": float(np.median(own)), "own_p95": float(np.percentile(own, 95)),
                "ours": cost, "all_forces": ours["cpu"], "courant": courant, "median": float(np.nanmedian(off)),
                "p95": float(np.nanpercentile(off, 95)), "cpu": its, "times": its / cost, "parcels": parcels,
                "spent": spent, "solver_step": float(np.diff(log.time).mean()),
            }  # fmt: skip


def at_equal_error(rows: Sequence[JsonTable]) -> Iterator[JsonTable]:
    """A row a kind: what the cloud costs at our median error, on the straight line through its settings in the
    logarithms of error and cost. Beyond them it is the cost of the nearest setting, which the row says.
    """
    for kind in dict.fromkeys(row["kind"] for row in rows):
        same = sorted((row for row in rows if row["kind"] == kind), key=lambda row: float(row["median"]))
        errors, costs = (np.log([row[name] for row in same]) for name in ("median", "cpu"))
        error, ours = same[0]["own_median"], same[0]["ours"]
        cpu = float(np.exp(np.interp(np.log(error), errors, costs)))
        how = "between its settings"
        if error < same[0]["median"]:
            how = f"at least: its error is {same[0]['median']:.1e}"
        elif error > same[-1]["median"]:
            how = f"at most: its error is {same[-1]['median']:.1e}"
        yield {"kind": kind, "own_median": error, "ours": ours, "cpu": cpu, "times": cpu / ours, "how": how}


def _across(case: SolvedCase, one: FlownKind, courant: float, span: float, folder: Path, tell: Tell) -> Array:
    """Where across the channel (m) a few granules are at the end of a ``span`` without eddies; NaN for those gone."""
    tell(f"{one.kind}: {SOLVER} with a few parcels, maxCo {courant:g}")
    some = one.grains[np.linspace(0, len(one.grains) - 1, min(FEW, len(one.grains))).astype(int)]
    fly_cloud(case, some, courant, span, folder)
    cloud = time_folders(folder)[-1] / "lagrangian" / CLOUD
    labels = re.findall(r"^(\d+)$", (cloud / "origId").read_text().split("(", 1)[1], re.M)
    places = re.findall(r"^\((\S+) \S+ \S+\) \d+", (cloud / "positions").read_text(), re.M)
    found = np.full(len(some), np.nan)
    found[np.array(labels, dtype=int)] = np.array(places, dtype=float)
    return found
