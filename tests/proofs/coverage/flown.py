"""One scene flown as the program flies it, at the numbers as they are given, and as it is in truth, at others."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofs.coverage.scenes import VariedScene, divided
from proofs.coverage.stored_air import StoredPipeline, plan_in
from support import as_computed
from wakeflow.air.field import FlowField
from wakeflow.air.field.combined import varied
from wakeflow.answer.budget.budget import fly_again, make_budget
from wakeflow.answer.budget.source import Flights
from wakeflow.answer.joint import JointAnswer
from wakeflow.answer.shares import BudgetRow, Separation
from wakeflow.core.files import write_json
from wakeflow.core.lazy import cached_property
from wakeflow.core.store import Store, content_key
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.flight.stages.input_samples import CODE
from wakeflow.laws.forces import forces
from wakeflow.planning.plan import Plan
from wakeflow.planning.stage_cache import code_of
from wakeflow.planning.unknowns import FARTHEST, Unknown, dependence, unknowns, variation_at
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.changes import AS_GIVEN, AirVariation, Variation

Array = NDArray[np.float64]
GRANULES_PER_FRACTION = 64  # granules a fraction that show where bins are wanted
FINE = 0.1  # of the scene's tolerance: that of the truth
FILE = "shares.json"


def chance_of(one: VariedScene, *apart: int) -> np.random.Generator:
    """Random numbers of a scene, of which the program's own know nothing."""
    return np.random.default_rng([*one.name.encode(), 20261122, *apart])


@dataclass(frozen=True)
class Predicted:
    """What the program says of a scene: what it flew (``flights``), the ``joint`` answer, its ``separation``, the
    ``budget``.
    """

    one: VariedScene
    pipeline: StoredPipeline
    flights: Flights
    joint: JointAnswer
    separation: Separation
    budget: tuple[BudgetRow, ...]

    @property
    def scene(self) -> Scene:
        return self.pipeline.scene

    @cached_property
    def unknowns(self) -> list[Unknown]:
        """What is drawn."""
        return unknowns(self.scene, self.pipeline.plan)

    def drawn(self, number: int) -> Array:
        """One draw of all unknowns (K,), in standard deviations, which move together as the program says."""
        ties = dependence(self.scene, self.pipeline.plan, self.unknowns)
        z = ties.joined(chance_of(self.one, number).standard_normal((1, len(self.unknowns))))[0]
        return np.clip(z, -FARTHEST, FARTHEST)

    @cached_property
    def truth(self) -> Truth:
        """What flies granules of the scene as they are in truth."""
        return Truth(self)


def pipeline_of(one: VariedScene, store: Store, workers: int | None = None) -> StoredPipeline:
    """What computes a scene. Raises SceneError as planning does."""
    plan = plan_in(one.air, as_computed(make_plan(one.scene)))
    return StoredPipeline(one.scene, plan, workers=workers, store=store, stored=one.air)


def with_bins(one: VariedScene, store: Store, workers: int | None = None) -> VariedScene:
    """The scene with bins where granules land: a few are flown to find where."""
    few = replace(one, scene=one.scene.replace({"feed.count": GRANULES_PER_FRACTION}))
    tracked = pipeline_of(few, store, workers).tracks()
    landings = {name: tracked.landings[name] for name in one.scene.fraction}
    return divided(one, {name: found.position[found.bin >= 0, 0] for name, found in landings.items()})


def predicted(one: VariedScene, store: Store, workers: int | None = None) -> Predicted:
    """The program's answer to a scene. Raises SceneError as planning does."""
    pipeline = pipeline_of(one, store, workers)
    flights = Flights(pipeline, pipeline.tracks())
    fly_again(flights)
    joint, budget = make_budget(flights)
    return Predicted(one, pipeline, flights, joint, joint.own.separation(), budget)


@dataclass(frozen=True)
class Truth:
    """Many granules of a scene, with random numbers of their own and steps a tenth as wrong."""

    told: Predicted

    @cached_property
    def whole_plan(self) -> Plan:
        """The plan with every term of the air that this version can compute, whatever its bound."""
        return self.with_terms({row.name for row in self.told.pipeline.plan.left_out})

    def with_terms(self, terms: Collection[str]) -> Plan:
        """The plan with those of ``terms`` too that are left out and can be computed, for each fraction."""
        plan = self.told.pipeline.plan
        fractions = {}
        for name, how in plan.fractions.items():
            used = {*how.forces, *self.switchable(name).intersection(terms)}
            fractions[name] = replace(how, forces=tuple(term for term in forces if term in used))
        return replace(plan, fractions=fractions)

    def switchable(self, fraction: str) -> frozenset[str]:
        """The terms of the air that are left out of a fraction's flight and that a switch could turn on."""
        told = self.told
        left_out = (row.name for row in told.pipeline.plan.left_out if row.fraction == fraction)
        air = told.pipeline.air.realisations.field
        known = {
            "laminar": air is None or not air.has("k"),
            "point_mass": bool(np.isinf(told.scene.fraction[fraction].inertia)),
        }
        return frozenset(
            term for term in left_out if term in forces and forces[term].computed and not forces[term].blocked(**known)
        )

    def drawn(self, number: int) -> Variation:
        """One draw of everything that is not known, each from its own distribution."""
        told = self.told
        return variation_at(told.scene, told.pipeline.plan, told.unknowns, told.drawn(number))

    def shares(
        self, count: int, made: Variation = AS_GIVEN, plan: Plan | None = None, seed: int = 1
    ) -> dict[str, Array]:
        """Share (bins + 1,) of each fraction in every bin and elsewhere, of ``count`` granules each, under a draw: from
        the cache or flown.
        """
        told, used = self.told, self.whole_plan if plan is None else plan
        forces_used = {name: how.forces for name, how in used.fractions.items()}
        varied_by = {name: repr(made.of(name)) for name in told.scene.fraction}
        air = repr((made.air, made.feed_width, made.feed_shift))
        key = content_key(
            told.pipeline.tracks_key,
            count,
            seed,
            FINE,
            forces_used,
            varied_by,
            air,
            code_of(*CODE),
        )

        def work(folder: Path) -> None:
            write_json(folder / FILE, {name: list(row) for name, row in self._flown(count, made, used, seed)})

        folder, _ = told.pipeline.store.make("truth", key, work)
        return {name: np.array(row) for name, row in json.loads((folder / FILE).read_text()).items()}

    def _flown(self, count: int, made: Variation, plan: Plan, seed: int) -> Iterator[tuple[str, Array]]:
        told = self.told
        more = told.scene.replace({"feed.count": count, "feed.seed": told.scene.feed.seed + 1000 * seed})
        airs = told.pipeline.air.realisations.mapped(partial(_changed, air=made.air))
        flight = Flight(made.fed(more), plan, airs, FINE * told.scene.numerics.tolerance, told.pipeline.workers)
        bins = len(told.scene.bin)
        for name in told.scene.fraction:
            feed = feedstock(flight.scene, plan, name, airs.period, variation=made.of(name))
            line = flight.fly(name, feed.granules).line
            place = np.where((line >= 0) & (line < bins), line, bins)
            yield name, np.bincount(place, minlength=bins + 1) / len(place)


def _changed(field: FlowField, air: AirVariation) -> FlowField:
    return varied(field, air.speed, air.energy, air.lifetime)
