"""Rungs and kinds of airflow: each listed once, and a new one is added with one record and one class."""

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import FlownAir, Realisations, airflow_kinds
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.core.errors import SceneError
from wakeflow.core.store import Store, content_key
from wakeflow.flight.stages import airs
from wakeflow.flight.stages.airs import ROUGH
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.airflow_choice import choose_airflow
from wakeflow.planning.cost import typical_cells
from wakeflow.planning.plan import Plan
from wakeflow.planning.terms import LOADING
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.rungs import Rung, rungs

OFF = {"basset-history": False, "collisions": False}


class UniformAir(FlownAir):
    """A uniform stream through the whole channel, as if nothing stood in it."""

    at_once = True

    @property
    def key(self) -> str:
        channel = self.scene.channel
        return content_key("uniform", repr(self.scene.air), channel.width, channel.top, channel.bottom)

    def make_field(self) -> FlowField:
        air, channel = self.scene.air, self.scene.channel
        half, low, high = 0.501 * channel.width, channel.bottom - 1e-3, channel.top + 1e-3
        corners = np.array([(-half, low), (half, low), (half, high), (-half, high)])
        velocity = np.tile([0.0, air.speed if air.direction == "up" else -air.speed], (4, 1))
        return FlowField.from_arrays(
            corners, [(0, 1, 2), (0, 2, 3)], velocity, np.zeros(4), density=air.density, viscosity=air.viscosity
        )

    def make_numbers(self) -> Airflow:
        rate = self.scene.air.speed * self.scene.channel.width
        known = {"turbulence": "laminar", "verdict": "uniform", "reynolds": self.scene.reynolds}
        return Airflow(**known, pressure_drop=0.0, flow_rate=rate)

    @property
    def unknown(self) -> tuple[str, ...]:
        return ("airflow-model",)


class GustyAir(UniformAir):
    """Uniform streams that lean by four angles, each as likely as the others."""

    @property
    def realisations(self) -> Realisations:
        return Realisations(self.field, tuple(partial(self._leaning, angle) for angle in (0.1, 0.2, 0.3)))

    def _leaning(self, angle: float) -> FlowField:
        turn = np.array([(math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))])
        return replace(self.field, velocity=self.field.velocity @ turn)


@pytest.fixture
def extended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rungs and a kind of airflow more, for one test."""
    monkeypatch.setattr(rungs, "_entries", dict(rungs._entries))
    monkeypatch.setattr(airflow_kinds, "_entries", dict(airflow_kinds._entries))
    rungs.add("coarse", Rung("the draft at twice the cell size", "steady", scales=(2.0,), resolves="standard"))
    rungs.add("uniform", Rung("a uniform stream, as if no body stood in it", "uniform"))
    rungs.add("gusts", Rung("uniform streams that lean", "gusts"))
    airflow_kinds.add("uniform", UniformAir)
    airflow_kinds.add("gusts", GustyAir)


@pytest.fixture
def rhombus(cases: Path) -> Scene:
    return Scene.load(cases / "rhombus.toml", {"feed.count": 64})


@pytest.mark.usefixtures("extended")
def test_a_new_rung_is_a_record(rhombus: Scene, tmp_path: Path) -> None:
    coarse, draft = (make_plan(rhombus, rung=rung, force=OFF) for rung in ("coarse", "draft"))
    assert any("rung coarse, steady, kOmegaSST" in line for line in coarse.used)
    assert any(line.startswith("coarse airflow: a steady wake is too long") for line in coarse.warnings)
    assert typical_cells(rhombus, coarse.airflow) == typical_cells(rhombus, draft.airflow) / 4
    wide, fine = (Pipeline(rhombus, plan, store=Store(tmp_path)) for plan in (coarse, draft))
    assert wide.air.in_case.mesh_spec.h_body == pytest.approx(2 * fine.air.in_case.mesh_spec.h_body)
    assert wide.air.mesh_quality.cells < 0.5 * fine.air.mesh_quality.cells
    with pytest.raises(SceneError, match="known: auto, none, draft, standard, reference, 3d, coarse"):
        choose_airflow(rhombus, "coarce", 0.01)


@pytest.mark.usefixtures("extended")
def test_a_scene_runs_to_its_shares_in_a_new_kind_of_airflow(rhombus: Scene, tmp_path: Path) -> None:
    result = wf.run(rhombus, tmp_path, rung="uniform", force=OFF)
    table = json.loads((tmp_path / "result.json").read_text())
    assert (table["airflow"]["rung"], table["airflow"]["verdict"]) == ("uniform", "uniform")
    assert {"mesh", "airflow", "field"}.isdisjoint(table["seconds"])
    for name in rhombus.fraction:
        assert sum(result.share(name, place)[0] for place in [*rhombus.bin, "elsewhere"]) == pytest.approx(1.0)
    parts = {part["source"]: part for part in table["budget"][0]["parts"]}
    assert parts["airflow-model"]["how"] == "unknown"
    assert "mesh" not in parts
    assert (tmp_path / "report.html").stat().st_size > 10_000


@pytest.mark.usefixtures("extended")
def test_realisations_of_an_airflow_are_flown_in_turn_and_stand_in_the_budget(rhombus: Scene, tmp_path: Path) -> None:
    result = wf.run(rhombus, tmp_path, rung="gusts", force=OFF, report=False)
    landings = Pipeline(rhombus, make_plan(rhombus, rung="gusts", force=OFF)).tracks().landings["chaff"]
    np.testing.assert_array_equal(landings.realisation, landings.replicate % 4)
    drift = [landings.position[landings.realisation == number, 0].mean() for number in range(4)]
    assert np.all(np.diff(drift) > 0) or np.all(np.diff(drift) < 0)
    others = tuple(one for one in result.joint.sources if one.name != "airflow-statistics")
    assert len(others) == len(result.joint.sources) - 1
    steady = replace(result.joint, sources=others)
    for row in result.budget:
        if row.quantity.startswith("share.chaff."):
            parts = {part.source: part for part in row.parts}
            assert parts["airflow-statistics"].note == "from 4 states of the airflow"
            errors = [part.error or 0.0 for part in row.parts if not part.kind and part.source != "inputs"]
            place = row.quantity.removeprefix("share.chaff.")
            share, alone = result.share("chaff", place), steady.own.share("chaff", place)
            assert row.total.numerical == share.numerical
            assert 0.4 * max(errors) < share.numerical <= 1.02 * math.hypot(*errors)  # shares end at 0 and 1
            drift = parts["airflow-statistics"].error
            assert (alone.numerical < 0.95 * share.numerical) == (drift > 0.5 * share.numerical)
            assert share.high - share.low >= share.numerical  # inputs and bounds beside it


@pytest.mark.usefixtures("extended")
def test_tracks_follow_the_air_of_a_new_kind(rhombus: Scene) -> None:
    plan = make_plan(rhombus, rung="uniform", force=OFF)
    keys = {Pipeline(scene, plan).tracks_key for scene in (rhombus, rhombus.replace({"air.speed": 6.0}))}
    assert len(keys) == 2


@pytest.mark.parametrize("name", list(rungs))
def test_every_rung_names_a_kind_of_airflow(name: str) -> None:
    rung = rungs[name]
    assert rung.meaning
    assert rung.kind in ("", *airflow_kinds)
    assert rung.kind_below_shedding in ("", *airflow_kinds)
    assert rung.resolves in ("", *rungs)


@pytest.mark.parametrize(
    ("case", "rung", "kind", "unknown"),
    [
        ("vacuum", None, "none", ()),
        ("labyrinth", "none", "none", ()),
        ("aspirator", None, "analytic", ("airflow-model",)),
    ],
)
def test_what_needs_no_solver_tells_what_it_leaves_unknown(
    cases: Path, case: str, rung: str | None, kind: str, unknown: tuple[str, ...]
) -> None:
    scene = Scene.load(cases / f"{case}.toml")
    plan = make_plan(scene, rung=rung)
    pipeline = Pipeline(plan.airflow.flown(scene), plan)
    assert plan.airflow.kind == kind
    assert pipeline.air.at_once
    assert pipeline.air.unknown == unknown
    assert not pipeline.air.mesh_quality
    with pytest.raises(SceneError, match="neither mesh nor OpenFOAM case"):
        _ = pipeline.air.in_case.solution


def test_a_vacuum_has_no_airflow(cases: Path) -> None:
    scene = Scene.load(cases / "vacuum.toml")
    pipeline = Pipeline(scene, make_plan(scene))
    with pytest.raises(SceneError, match="vacuum"):
        _ = pipeline.field
    with pytest.raises(SceneError, match="vacuum"):
        _ = pipeline.airflow


def test_every_grid_starts_from_one_draft_that_is_planned_once(rhombus: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rhombus.replace({"air.speed": 0.03})  # Re 100
    planned: list[str | None] = []
    own = airs.make_plan

    def counted(scene: Scene, *, rung: str | None = None, **options: Any) -> Plan:
        planned.append(rung)
        return own(scene, rung=rung, **options)

    monkeypatch.setattr(airs, "make_plan", counted)
    pipeline = Pipeline(scene, make_plan(scene, rung="reference", force=OFF))
    steady, resolved = pipeline.airs.steady, pipeline.airs.resolved
    assert [air.plan.airflow.stepping for air in (*steady, *resolved)] == 3 * ["steady"] + 3 * ["time-resolved"]
    assert all(air.bare.start is pipeline.airs.early for air in resolved)
    assert pipeline.airs.early.bare.start is pipeline.airs.bare_steady[2]
    assert planned == ["draft"]


def test_a_wake_in_time_starts_from_the_neighbours_or_the_next_coarser_one(rhombus: Scene) -> None:
    """A steady one from the neighbour's steady one; where that has no wake in time, the own ones are left."""
    scenes = [rhombus.replace({"air.speed": speed}) for speed in (0.03, 0.033)]  # Re 100 and 110
    near, steady = (
        Pipeline(scenes[0], make_plan(scenes[0], rung=rung, force=OFF | {LOADING: False}))
        for rung in ("reference", "draft")
    )
    plan = make_plan(scenes[1], rung="reference", force=OFF | {LOADING: False})
    for neighbour in (None, near, steady):
        own = Pipeline(scenes[1], plan, near=None if neighbour is None else neighbour.airs).airs
        starts = near.airs.resolved if neighbour is near else (*own.resolved[1:], own.steady[2])
        assert all(one.start is other for one, other in zip(own.resolved, starts, strict=True))
        assert own.steady[0].start is (None if neighbour is None else neighbour.airs.steady[0])


def test_wakes_that_feel_the_granules_start_from_one_on_the_coarsest_grid(rhombus: Scene) -> None:
    """Under the force that is known first: it neither waits for the passes nor starts from what feels more."""
    own = Pipeline(rhombus, make_plan(rhombus))
    early, (fine, coarse) = own.airs.early, own.airs.resolved
    assert fine.bare.start is coarse.bare.start is early
    assert (early.grid, early.bare.made_as) == (1, "early-airflow")
    assert early.plan.airflow.accuracy == ROUGH > own.plan.airflow.accuracy
    assert early.bare.start is own.airs.bare_steady[1]
    vars(own.loading).update(_way=SimpleNamespace(force="last"), first=SimpleNamespace(force="known first"))
    assert (fine.force(), coarse.force(), early.force()) == ("last", "last", "known first")
