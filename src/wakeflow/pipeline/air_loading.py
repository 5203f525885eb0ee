"""The air feels the granules: their force on it, gathered along tracks, is given to the airflow.

Pass after pass, granules fly through the steady airflow as it is known so far, one way; what they exert on the air is
gathered (``gather_force``), and OpenFOAM solves the steady airflow on under that force. Under the force of the last
pass every airflow of the scene is solved: the steady one on all grids, and from it the one in time.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..core.files import write_json
from ..core.geometry import Boxes, ForceDensity
from ..core.lazy import cached_property
from ..core.number import student
from ..core.record import JsonTable, load
from ..core.store import content_key
from ..core.tables import save_arrays
from ..field import FlowField
from ..injection.feed import feedstock
from ..laws.constants import GRAVITY
from ..planning.plan import COMPARED, GATHERED, REPLICATES, Plan
from ..scene import Scene
from ..tracking import Granules, Tracks
from ..tracking.momentum import force_on_the_air
from .airflow import Airflow, AirLoadingSummary
from .airflow_kinds import CaseAir
from .cache import StageCache, code_of, version_of
from .case_field import case_field
from .compilation import COMPILED, Compilation
from .realisations import Realisations
from .solved_air import SolvedAir
from .tracks import Flight

MAX_PASSES = 3  # solutions under a force
TOWARDS = 0.7  # of the way to the force gathered last. Chosen: slower air drags less, so that the whole way oversteps


@dataclass(frozen=True)
class Pass:
    """One pass: the ``force`` (N/m3) that the airflow was solved under, that airflow's ``key`` and ``folder``, what
    granules ``gathered`` in it, and the largest ``change`` of their shares from the pass before.
    """

    force: ForceDensity
    key: str
    folder: Path
    gathered: Gathered
    change: float


@dataclass
class AirLoading:
    """The granules' force on the airflow of a scene, gathered in the steady one; ``steady``: that one where it does not
    feel them yet.
    """

    scene: Scene
    plan: Plan  # of the steady airflow
    cache: StageCache
    steady: CaseAir
    compilation: Compilation
    workers: int | None = None

    @cached_property
    def passes(self) -> tuple[Pass, ...]:
        """Every pass, until the shares are within the accuracy asked for, or after MAX_PASSES."""
        return tuple(self._passes())

    @property
    def force(self) -> ForceDensity:
        """The force that the answer's air is solved under."""
        return self.passes[-1].force

    def solution_on(self, air: CaseAir) -> tuple[str, Path]:
        """Key and folder of the steady airflow under that force, on the grid of ``air``, which does not feel it."""
        last = self.passes[-1]
        return (last.key, last.folder) if air.grid == self.steady.grid else self._solved(air, last.force, *air.solution)

    @cached_property
    def first(self) -> Gathered:
        """What granules exert on the air that does not feel them."""
        key, field = known(self.steady.field)
        return self._gathered(key, lambda: field)

    @property
    def summary(self) -> AirLoadingSummary:
        """What the passes found."""
        from ..foam.momentum_source import SOURCE

        last, case = self.passes[-1], self.passes[-1].folder / "case"
        laid = json.loads((case / SOURCE).read_text())
        given, whole = (2.0 if self.steady.half else 1.0) * laid["force"][1], float(last.gathered.force.total[1])
        before, after = self.steady.measured, load(Airflow, case / "airflow.json")
        return AirLoadingSummary(
            passes=len(self.passes),
            change=last.change,
            force=tuple(last.gathered.force.total.tolist()),
            given=given,
            imbalance=last.gathered.imbalance,
            unanswered=abs(whole - given) / max(abs(whole), 1e-300),
            sampling=self.sampling,
            cd_without=before.cd,
            cd=after.cd,
            verdict=after.verdict,
            cells=laid["cells"],
            sources=laid["sources"],
        )

    @property
    def sampling(self) -> float:
        """Half of the 95 % interval of that force by the granules that it is gathered from, over it."""
        return self.passes[-1].gathered.sampling

    def last_change(self, name: str, place: int) -> float:
        """What the last pass changed of a fraction's share in bin number ``place``, in the steady airflow."""
        before = self.passes[-2].gathered if len(self.passes) > 1 else self.first
        return self.passes[-1].gathered.shares[name][place] - before.shares[name][place]

    def _passes(self) -> Iterator[Pass]:
        before = self.first
        force, start = before.force, self.steady.solution
        for number in range(MAX_PASSES):
            key, folder = self._solved(self.steady, force, *start)
            after = self._gathered(key, partial(self.field_in, folder))
            change = _farthest(before, after)
            yield Pass(force, key, folder, after, change)
            if change <= self.plan.target_error:
                return
            before, start, force = after, (key, folder), force.towards(after.force, TOWARDS)
            self.cache.tell("air-loading", f"pass {number + 1}: shares moved by up to {100 * change:.2g} points")

    def _gathered(self, key: str, field: Callable[[], FlowField]) -> Gathered:
        """What granules exert on the air of a field, made where its key does not have it, from the cache or now."""
        bins = [(name, repr(bin_)) for name, bin_ in self.scene.bin.items()]
        made = content_key("momentum", key, exerted_by(self.scene, self.plan), bins, code_of("momentum"))

        def work(part: Path) -> None:
            if COMPILED not in self.cache.seconds:
                self.compilation.finish(self.cache)
            tell = partial(self.cache.tell, "momentum")
            gather_force(self.scene, self.plan, field(), self.workers, tell, part)

        return gathered_in(self.cache.make("momentum", made, work))

    def _solved(self, air: CaseAir, force: ForceDensity, from_key: str, start: Path) -> tuple[str, Path]:
        """Key and folder of the steady ``air`` under ``force``, from the cache or solved on from another's."""
        from ..foam import solve_airflow
        from ..foam.fallback_settings import schemes_in

        assert isinstance(air, SolvedAir)
        spec, msh, before = air.solved_spec, air.mesh[1] / "mesh.msh", start / "case"
        key = content_key("loaded-airflow", from_key, force.digest, code_of("loaded-airflow"))

        def work(part: Path) -> None:
            solve_airflow(
                replace(spec, settings=schemes_in(before)),  # what served before
                msh,
                part / "case",
                start=before,
                force=force,
                listener=lambda now: air.cache.tell("loaded-airflow", str(now)),
            )

        return key, air.cache.make("loaded-airflow", key, work)

    def field_in(self, folder: Path) -> FlowField:
        """The steady airflow of the pass whose ``folder`` that is."""
        case = folder / "case"
        time = known(load(Airflow, case / "airflow.json").field_time)
        return case_field(case, time, self.scene.airstream.density, half=self.steady.half)


def exerted_by(scene: Scene, plan: Plan) -> JsonTable:
    """What the granules' force on an air depends on beside that air and where the bins stand."""
    tables: JsonTable = scene.model_dump(mode="json", by_alias=True)
    for name in ("numerics", "picture", "funnel", "collisions", "force", "uncertainty", "bin"):
        del tables[name]
    del tables["feed"]["count"]
    how = {name: row.tracked for name, row in resolved(plan).fractions.items()}
    versions = [version_of(package) for package in ("numpy", "scipy", "numba")]
    made = {"how": repr(how), "versions": versions, "symmetric": plan.airflow.symmetric}
    return {**tables, **made, "tolerance": scene.numerics.tolerance}


def _farthest(before: Gathered, after: Gathered) -> float:
    """The largest change of any share."""
    rows = ((before.shares[name], after.shares[name]) for name in after.shares)
    return max(abs(new - old) for olds, news in rows for old, new in zip(olds, news, strict=True))


# -- The granules' force on the air of one field -----------------------------------------------------------------------
Array = NDArray[np.float64]
POINTS = 512  # kept of a track
ACROSS = 16  # boxes across the first body
STREAM = 4 * REPLICATES  # of the random forces, apart from those of other calls


@dataclass(frozen=True)
class Gathered:
    """The ``force`` on the air; ``losses`` (r, 2) N/m: what the granules of each replicate lost to the air, from the
    ends of their tracks alone, as if all were like them; ``shares`` {fraction: share of its granules in every bin,
    elsewhere last}.
    """

    force: ForceDensity
    losses: Array
    shares: dict[str, list[float]]

    @property
    def imbalance(self) -> float:
        """How far the force in all boxes is from what the granules lost, over the latter."""
        lost = self.losses.mean(axis=0)
        return float(np.linalg.norm(self.force.total - lost) / max(float(np.linalg.norm(lost)), 1e-300))

    @property
    def sampling(self) -> float:
        """Half of the 95 % interval of the force by the granules that it is gathered from, over the force."""
        count, along = len(self.losses), self.losses[:, 1]
        half = student(count - 1) * float(along.std(ddof=1)) / count**0.5
        return float(half / max(abs(along.mean()), 1e-300))


def resolved(plan: Plan) -> Plan:
    """The plan with every fraction released above the body, where the curtain's force on the air begins."""
    return replace(plan, fractions={name: replace(how, mode="resolved") for name, how in plan.fractions.items()})


def gather_force(
    scene: Scene, plan: Plan, field: FlowField, workers: int | None, tell: Callable[[str], None], folder: Path
) -> None:
    """Fly GATHERED of each fraction through the steady ``field`` and keep what they exert on the air in ``folder``.

    In a scene that is its own mirror image the force is the mean of both images.
    """
    few = scene.replace({"feed.count": GATHERED * REPLICATES // COMPARED})
    flight = Flight(few, resolved(plan), Realisations(field), scene.numerics.tolerance, workers, tell)
    channel, shares = scene.channel, scene.mass_shares()
    boxes = Boxes.across(channel.width, channel.bottom, channel.top, scene.width / ACROSS)
    density, losses, landed = np.zeros((boxes.rows, boxes.columns, 2)), np.zeros((COMPARED, 2)), {}
    for name in scene.fraction:
        tell(f"{name}: {GATHERED} granules, for their force on the air")
        feed = feedstock(few, flight.plan, name, None, range(COMPARED))
        grains = feed.granules
        tracks = flight.fly(name, grains, record=POINTS, stream=STREAM)
        flow, forces = scene.feed.mass_flow / scene.feed.depth * shares[name], plan.fractions[name].forces
        how: dict[str, Any] = {"air_density": field.density, "forces": forces}
        density += force_on_the_air(tracks, grains, flow, boxes, **how).density
        lost = flow * _lost(tracks, grains, **how)
        losses += [lost[feed.replicate == number].mean(axis=0) for number in range(COMPARED)]
        bins = np.where((tracks.line >= 0) & (tracks.line < len(scene.bin)), tracks.line, len(scene.bin))
        landed[name] = (np.bincount(bins, minlength=len(scene.bin) + 1) / len(grains)).tolist()
    force = ForceDensity(boxes, density)
    if plan.airflow.symmetric:
        force, losses = force.mirrored(), losses * (0.0, 1.0)
    box = [boxes.left, boxes.bottom, boxes.pitch]
    save_arrays(folder / "force.npz", {"density": force.density, "losses": losses, "boxes": box})
    write_json(folder / "shares.json", landed)


def _lost(tracks: Tracks, grains: Granules, air_density: float, forces: tuple[str, ...]) -> Array:
    """Velocity (n, 2) m/s that each granule gave to the air on its whole way: what gravity gave it less what all but
    walls did, derived from the ends of the tracks alone.
    """
    gain = np.array([path[-1, 5:7] - path[0, 5:7] for path in known(tracks.recorded)])
    lasted = np.array([path[-1, 0] - path[0, 0] for path in known(tracks.recorded)])
    lift = air_density / grains.density if "buoyancy" in forces else 0.0
    fallen = -GRAVITY * (1.0 - lift) * lasted
    return np.stack([-gain[:, 0], fallen - gain[:, 1]], axis=1)


def gathered_in(folder: Path) -> Gathered:
    """What :func:`gather_force` kept in a folder."""
    with np.load(folder / "force.npz") as data:
        density, losses, (left, bottom, pitch) = data["density"], data["losses"], data["boxes"].tolist()
    boxes = Boxes(left, bottom, pitch, density.shape[1], density.shape[0])
    return Gathered(ForceDensity(boxes, density), losses, json.loads((folder / "shares.json").read_text()))
