"""Granules that meet each other in the slab, and granules that the air feels."""

import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import wakeflow as wf
from support import landings_in, loaded_scene, shipped
from wakeflow import flight as tracking
from wakeflow.air.foam.momentum_source import LEVELS, SOURCE
from wakeflow.air.kinds.airflow_kinds import FlownAir, Realisations
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.answer.budget.slab_sources import BetweenGranulesRestitution, shows
from wakeflow.answer.notices import _step_not_reached, air_notices
from wakeflow.answer.separation import separate
from wakeflow.answer.shares import collisions_of
from wakeflow.answer.spread import Tally
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import Boxes, ForceDensity
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.air_loading import SHARES, CaseLoading, Pass, exerted_by, secant
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.flight.stages.gathered_force import Gathered
from wakeflow.flight.stages.pipeline import CollisionRerun, Pipeline, SlabRerun
from wakeflow.flight.stages.slab_stage import SlabFlight, SlabFound, _grouped, step_of
from wakeflow.planning.coupling import COUPLING
from wakeflow.planning.plan import GATHERED, PASSING
from wakeflow.planning.terms import COLLISIONS, LOADING
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

CALM = {"basset-history": False, "collisions": False}  # history of chaff would refuse the accuracy


@pytest.mark.parametrize("name", ["rhombus", "prism", "labyrinth"])
def test_the_shipped_machines_at_their_feed_load_their_air(name: str) -> None:
    plan = make_plan(shipped(name))
    assert plan.airflow.loaded
    assert any("the air feels the granules" in line for line in plan.used)
    assert not [row for row in plan.left_out if row.name == LOADING]
    assert not [line for line in plan.warnings if COUPLING in line]
    assert all(how.mode == "resolved" for how in plan.fractions.values())  # air before the body is not uniform


def test_a_thousandth_of_the_feed_is_left_out_with_its_bound() -> None:
    plan = make_plan(shipped("rhombus", {"feed.rate": "0.5 kg/hour"}))
    assert not plan.airflow.loaded
    rows = {row.fraction: row for row in plan.left_out if row.name == LOADING}
    assert set(rows) == set(plan.fractions)
    for name, row in rows.items():
        assert 0.0 < row.bound <= plan.fractions[name].limit
    whole = make_plan(shipped("rhombus"))
    for name, row in rows.items():  # nearly proportional where it is small
        assert whole.fractions[name].bounds[LOADING] > 1e3 * (row.bound or 0.0)


def test_switches() -> None:
    tame, full = shipped("rhombus", {"feed.rate": "0.5 kg/hour"}), shipped("rhombus")
    assert make_plan(tame, force={LOADING: True}).airflow.loaded
    off = make_plan(full, force={LOADING: False})
    assert not off.airflow.loaded
    left = [row for row in off.left_out if row.name == LOADING]
    assert len(left) == len(full.fraction)
    assert all(row.why.endswith("switched off by --force") for row in left)
    assert any(f"too dense for {COUPLING}" in line for line in off.warnings)


@pytest.mark.parametrize(
    ("name", "changes", "rung", "message"),
    [
        ("aspirator", {}, None, "rung analytic has no steady airflow"),
        ("vacuum", {}, None, r"a term of the air; add an \[air\] table"),
    ],
)
def test_where_it_cannot_be_had_it_says_so(name: str, changes: dict[str, Any], rung: str | None, message: str) -> None:
    asked = shipped(name, changes)
    with pytest.raises(SceneError, match=f"--force {LOADING}=on: {message}"):
        make_plan(asked, rung=rung, force={**CALM, LOADING: True})


def test_without_a_feed_rate_nobody_knows_how_dense_the_curtain_is() -> None:
    tables = shipped("rhombus").tables()
    del tables["feed"]["rate"]
    plan = make_plan(Scene.parse(tables))
    assert not plan.airflow.loaded
    assert all(how.bounds[LOADING] == 0.0 for how in plan.fractions.values())
    with pytest.raises(SceneError, match=r"has no feed.rate"):
        make_plan(Scene.parse(tables), force={LOADING: True})


def test_air_that_cannot_be_solved_on_keeps_its_bound_and_a_warning() -> None:
    plan = make_plan(shipped("aspirator"))
    assert any(line.startswith(f"{LOADING}, left out, could move wheat") for line in plan.warnings)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> wf.Result:
    return wf.run(loaded_scene(), tmp_path_factory.mktemp("loaded"), force=CALM)


def loaded_pipeline(rung: str = "draft", force: dict[str, bool] | None = None, passes: int = 3) -> Any:
    asked = loaded_scene().replace({"numerics.rung": rung, "numerics.loading_passes": passes})
    return Pipeline(asked, make_plan(asked, force={**CALM, **(force or {})}))


def test_the_force_goes_on_to_where_a_proportional_answer_meets_it() -> None:
    """Air that answers a force f by asking for a - b f instead: the second force is the one that it asks for."""
    a, b = np.array([[[0.0, -40.0], [1.0, -20.0]]]), 3.0
    share = secant(1.0, a, -b * a)
    np.testing.assert_allclose(a + share * (-b * a), a / (1.0 + b), rtol=1e-14)
    assert secant(1.0, a, a) == SHARES[0]  # air that answers nothing: there is no such force


class _Answering(CaseLoading):
    """Passes in air that answers a force f by asking for (a - b f), known to a part ``noise`` in each of 64 boxes."""

    start = cast(FlownAir, SimpleNamespace(key="air"))

    def __init__(self, seed: int, b: float, noise: float) -> None:
        self.rng = np.random.default_rng(seed)
        self.scene = SimpleNamespace(numerics=SimpleNamespace(loading_passes=12))  # type: ignore[assignment]
        self.plan = SimpleNamespace(target_error=0.03, collisions=None)  # type: ignore[assignment]
        self.cache = SimpleNamespace(tell=lambda *told: None)  # type: ignore[assignment]
        self.a, self.b, self.noise = np.array([0.0, -40.0]) * self.rng.random((8, 8, 1)), b, noise
        self.given = np.zeros((8, 8, 2))

    @property
    def first(self) -> Gathered:  # type: ignore[override]
        return self._alone(self.start, GATHERED)

    def under(self, force: ForceDensity, before: Any, *, last: bool) -> Any:
        self.given = force.density
        return before

    def _alone(self, air: Any, most: int) -> Gathered:
        asked = (self.a - self.b * self.given) * (1.0 + self.noise * self.rng.normal(size=self.a.shape))
        force = ForceDensity(Boxes(0.0, 0.0, 0.01, 8, 8), asked)
        moved = 0.2 * float(np.linalg.norm(asked) / np.linalg.norm(self.a))
        return Gathered(force, np.zeros((4, 2)), force, {"dust": [0.5 + moved, 0.5 - moved]})


@pytest.mark.parametrize("noise", [0.005, 0.05])
@pytest.mark.parametrize("b", [0.1, 0.5, 1.0, 3.0])
def test_how_many_passes_a_force_takes_hardly_depends_on_the_seed(b: float, noise: float) -> None:
    """Over 20 seeds, of air that hardly answers and of air that oversteps three times, by forces known as those of 2048
    granules are, and ten times worse.
    """
    passes = [len(_Answering(seed, b, noise).passes) - 1 for seed in range(20)]  # but the last, which every force has
    assert max(passes) <= min(4, 1.5 * np.median(passes))


@pytest.mark.openfoam
def test_the_force_of_a_dense_curtain_settles() -> None:
    """Its granules slow the air down to their own speed, where it drags no more: the whole way would overstep."""

    def air_of(pipeline: Pipeline) -> Airflow:
        loading = pipeline.loading
        assert loading is not None
        return replace(pipeline.airflow, loading=loading.summary)

    def piped(passes: int) -> Pipeline:
        asked = loaded_scene().replace({"feed.rate": "1500 kg/hour", "numerics.loading_passes": passes})
        return Pipeline(asked, make_plan(asked, force=CALM))

    few, enough = piped(3), piped(10)
    few_told, told = ([notice.text for notice in air_notices(one.scene, one, air_of(one))] for one in (few, enough))
    off = r"the granules' force on the air has not settled, it is \d+ % off; numerics.loading_passes above 3 goes on"
    assert [line for line in few_told if re.fullmatch(off, line)]
    assert not [line for line in told if "force on the air" in line]
    loading = enough.loading
    assert loading is not None
    assert 3 < len(loading.passes) <= 10
    assert loading.settled(loading.passes[-1])
    assert loading.summary.unanswered < CaseLoading.answered
    assert loading.summary.force[1] < 0.6 * loading.first.force.total[1]


@pytest.mark.openfoam
def test_the_result_says_what_it_does(loaded: wf.Result) -> None:
    found, effects = loaded.airflow.loading, loaded.landings.air_loading
    assert found.passes in (1, 2, 3)
    assert found.imbalance < 1e-9  # what all boxes feel is what the granules lost
    assert found.force[1] > 0.0  # against the air, which flows down
    assert found.force[0] == pytest.approx(0.0, abs=1e-12 * found.force[1])
    assert 0.7 * found.force[1] < found.given < 1.3 * found.force[1]
    assert (found.cd.value or 0.0) < 0.97 * (found.cd_without.value or 0.0)
    for name, places in effects.items():
        for which in ("without", "loaded"):
            assert sum(getattr(row, which) for row in places.values()) == pytest.approx(1.0)
            assert set(places) == {*loaded.landings.separation.bins}, name
    parts = {part.source: part for row in loaded.budget for part in row.parts if row.quantity.startswith("share.")}
    assert parts[LOADING].how == "measured"
    assert "the force moves the share by" in parts[LOADING].note
    assert 0.0 < found.sampling < 0.02
    assert 'id="air-loading"' in (loaded.folder / "report.html").read_text()


@pytest.mark.openfoam
def test_left_out_it_is_the_air_without(loaded: wf.Result, tmp_path: Path) -> None:
    off = wf.run(loaded_scene(), tmp_path, force={**CALM, LOADING: False, "pressure-gradient": True}, until="airflow")
    assert loaded.airflow.loading.cd_without.value == off.airflow.cd.value
    assert off.airflow.loading is None
    on = wf.run(loaded_scene(), tmp_path, force=CALM, until="airflow")
    assert on.airflow.loading == loaded.airflow.loading
    assert on.airflow.cd.value == loaded.airflow.cd.value == on.airflow.loading.cd.value


@pytest.mark.openfoam
def test_nothing_of_the_force_is_left_out(loaded: wf.Result) -> None:
    """What is unanswered is what the last air changed of the whole force."""
    loading, found = loaded_pipeline().loading, loaded.airflow.loading
    first, second = (json.loads((one.air.case / SOURCE).read_text())["force"][1] for one in loading.passes[:2])
    assert 2.0 * first == pytest.approx(loading.first.force.total[1], rel=1e-9)  # of half a channel
    assert second < first  # slower air drags less
    assert found.unanswered == pytest.approx(abs(found.force[1] - found.given) / found.force[1])
    assert found.unanswered < 0.1
    assert found.sources <= 2 * LEVELS


@pytest.mark.parametrize("tilt", [0.0, 0.5, np.pi / 2, np.pi])
def test_what_is_unanswered_does_not_depend_on_where_gravity_points(tilt: float) -> None:
    """2 N/m of 2.5 are answered, and 0.3 N/m across them that nobody exerts."""
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    given = ForceDensity(Boxes(0.0, 0.0, 0.5, 1, 1), 4.0 * (turn @ [0.3, -2.0]).reshape(1, 1, 2))
    alone = Gathered(given, np.zeros((1, 2)), given)
    made = Pass(given, cast(FlownAir, None), alone, 0.0, alone, turn @ [0.0, -2.5])
    assert made.unanswered == pytest.approx(np.hypot(0.3, 0.5) / 2.5)


@pytest.mark.openfoam
def test_the_loaded_air_is_slower_above_the_body_and_its_own_mirror_image(loaded: wf.Result) -> None:
    pipeline = loaded_pipeline()
    bare, field = pipeline.loading.steady.field, pipeline.field[1]
    axis = np.array([[1e-4, 0.06], [1e-4, 0.1]])
    assert np.all(field.sample(axis)[0][:, 1] > bare.sample(axis)[0][:, 1] + 0.1)  # downward: less negative
    places = np.array([[0.013, 0.05], [0.04, 0.02], [0.07, -0.06]])
    right, left = field.sample(places)[0], field.sample(places * (-1.0, 1.0))[0]
    np.testing.assert_allclose(left, right * (-1.0, 1.0), atol=1e-9)
    density = pipeline.loading.force.density
    np.testing.assert_array_equal(density, density[:, ::-1] * (-1.0, 1.0))
    assert field.divergence().rms < 1.5 * bare.divergence().rms + 1e-3


@pytest.mark.openfoam
def test_it_comes_from_the_cache_and_its_keys_follow_the_feed(loaded: wf.Result) -> None:
    again = wf.run(loaded_scene(), loaded.folder, force=CALM)
    assert all(stage.cached for stage in again.seconds.values())
    assert again.table["separation"] == loaded.table["separation"]
    pipeline = loaded_pipeline()
    keys = {path.name for path in (pipeline.store.root / "loaded-airflow").iterdir() if path.is_dir()}
    assert {one.air.key for one in pipeline.loading.passes} <= keys
    case = pipeline.loading.passes[-1].air.case
    assert pipeline.air.case == case
    assert json.loads((case / "airflow.json").read_text())["verdict"] == "steady"
    scene, plan = pipeline.scene, pipeline.plan
    fed = exerted_by(scene, plan)
    assert exerted_by(scene.replace({"feed.rate": 0.03}), plan) != fed
    assert exerted_by(scene.replace({"feed.count": 64}), plan) != fed
    assert exerted_by(scene.replace({"bin.middle.to": 0.07}), plan) == fed


@pytest.mark.openfoam
def test_both_ends_of_the_wake_are_solved_under_the_force_on_every_grid(loaded: wf.Result) -> None:
    """The time-resolved end on the same mesh with it and without: slower before the body, less drag, less lift."""
    pipeline, bare = loaded_pipeline("standard"), loaded_pipeline("standard", {LOADING: False})
    force = pipeline.loading.force.total[1]
    for grid in range(len(pipeline.plan.airflow.scales)):
        ends = pipeline.airs.answers[grid], pipeline.airs.steady[grid]
        laid = [json.loads((air.case / SOURCE).read_text())["force"][1] for air in ends]
        assert laid == pytest.approx([force, force / 2], rel=1e-9)  # of the whole channel, and of its half
        assert ends[1].grid == grid
    ends, without = pipeline.airflow.ends, bare.airflow.ends
    for end in ("steady", "time_resolved"):
        assert getattr(ends, end).cd.value < 0.97 * getattr(without, end).cd.value
    assert ends.time_resolved.cl_rms.value < 0.97 * without.time_resolved.cl_rms.value
    above = np.array([[1e-4, 0.06], [1e-4, 0.1]])
    slower = pipeline.field[1].mean().sample(above)[0] - bare.field[1].mean().sample(above)[0]
    assert np.all(slower[:, 1] > 0.1)
    assert (
        pipeline.loading.passes[-1].air.key == loaded_pipeline().loading.passes[-1].air.key
    )  # the same steady airflow


@pytest.mark.openfoam
def test_where_granules_meet_the_last_pass_is_under_the_force_of_those(loaded: wf.Result) -> None:
    """Which is that of granules alone as far as the slab's beginning, of more of them than in the passes before. Chaff
    that meets chaff gives the air 2 % less.
    """
    alone = loaded_pipeline().loading.passes
    loading = loaded_pipeline(force={COLLISIONS: True}).loading
    *before, last = loading.passes
    assert len(before) == len(alone) - 1  # whose last one is under the force of granules alone again
    among = last.source
    np.testing.assert_array_equal(last.force.density, among.force.density)
    assert among.imbalance < 1e-9  # what all boxes feel is what the granules lost to the air, whomever they met
    assert 0.0 < among.sampling < 0.03
    assert among.force.total[1] == pytest.approx(before[-1].gathered.force.total[1], rel=0.05)
    settled = before[-1]
    many, few = (loading._alone(settled.air, most) for most in (GATHERED, PASSING))
    np.testing.assert_array_equal(among.before.density, many.before.density)
    np.testing.assert_array_equal(settled.gathered.force.density, few.force.density)
    assert 0.0 < few.sampling < 0.3 * CaseLoading.answered
    assert 0.2 < among.before.total[1] / among.force.total[1] < 0.5
    assert loading.summary.passes == len(alone)
    assert loading.force is last.force
    assert loading.last_change("chaff", 0) == last.gathered.shares["chaff"][0] - before[-1].gathered.shares["chaff"][0]


@pytest.mark.openfoam
def test_a_single_pass_is_under_the_force_of_granules_alone_and_all_that_it_moves_is_its_error(
    loaded: wf.Result,
) -> None:
    once = loaded_pipeline(force={COLLISIONS: True}, passes=1).loading
    assert once.summary.passes == 1
    assert once.force.digest == loaded_pipeline().loading.passes[0].force.digest
    moved = once.passes[0].gathered.shares["chaff"][0] - once.first.shares["chaff"][0]
    assert once.last_change("chaff", 0) == moved != 0.0


@pytest.mark.openfoam
def test_the_bound_holds_and_is_not_idle(loaded: wf.Result) -> None:
    """As tests/unit/planning/test_plan_gate.py has it of the other terms, without random forces."""
    asked, pipeline = loaded_scene(), loaded_pipeline()
    plan, bare = pipeline.plan, pipeline.loading.steady.field
    calm = plan.with_forces(("drag", "gravity", "buoyancy", "pressure-gradient"))
    grains = feedstock(asked, calm, "chaff", 0.0).granules
    ends = [
        Flight(asked, calm, Realisations(air), 1e-6).fly("chaff", grains).position for air in (bare, pipeline.field[1])
    ]
    shift = np.percentile(np.linalg.norm(ends[1] - ends[0], axis=1) / asked.width, 95)
    bound = plan.fractions["chaff"].bounds[LOADING]
    assert shift <= bound <= 30.0 * shift


DENSE, TRICKLE = 0.2, 1e-3  # kg/s and metre of depth


def fed(rate: float, **more: Any) -> Scene:
    """Two granules of equal size that collide in a vacuum."""
    return shipped("vacuum", {"feed.rate": rate, "feed.count": 512, **more})


@cache
def pipeline(rate: float) -> Pipeline:
    scene = fed(rate)
    return Pipeline(scene, make_plan(scene, force={COLLISIONS: True}))


def collisions(rate: float) -> SlabFound:
    return pipeline(rate).collisions()


def test_every_granule_of_steady_operation_lands_once_and_weighs_by_its_mass() -> None:
    scene, found = pipeline(DENSE).scene, collisions(DENSE)
    for name, landing in found.landings.items():
        assert landing.weight is not None
        assert landing.meetings is not None
        shares = landing.counts(len(scene.bin))
        np.testing.assert_allclose(shares.sum(axis=1), 1.0)
        assert landing.size == pytest.approx(len(landing.bin))  # all of one size
        assert set(landing.replicate) == set(range(found.replicates))
        assert landing.mass_shares.sum() == pytest.approx(1.0), name


def test_a_trickle_lands_as_granules_alone_do_and_a_dense_feed_does_not() -> None:
    scene = pipeline(DENSE).scene
    alone = separate(scene, pipeline(DENSE).tracks().landings).share("hard", "far")
    few = separate(scene, collisions(TRICKLE).landings).share("hard", "far")
    many = separate(scene, collisions(DENSE).landings).share("hard", "far")
    assert few[1] <= alone[2]
    assert alone[1] <= few[2]
    assert many[2] < alone[1]  # crowding costs
    meetings = {rate: collisions(rate).landings["hard"].meetings.mean() for rate in (TRICKLE, DENSE)}  # type: ignore[union-attr]
    assert meetings[TRICKLE] < 0.1 * meetings[DENSE]


def test_it_goes_on_where_it_stopped_and_all_fly_with_the_step_that_the_first_has_found(tmp_path: Path) -> None:
    scene = fed(TRICKLE)
    flight = SlabFlight(scene, make_plan(scene, force={COLLISIONS: True}), Realisations(None), 0.03, 0.2, 0.3, 1e-3)
    flight.fly_all(tmp_path, 2)
    stopped, given = tmp_path / "stopped", tmp_path / "given"
    stopped.mkdir()
    given.mkdir()
    shutil.copy(tmp_path / "replicate-0.npz", stopped)
    told: list[str] = []
    replace(flight, tell=told.append).fly_all(stopped, 2)
    assert told == ["replicate 2", "2 of 2 replicates"]
    replace(flight, step=step_of(tmp_path)).fly_all(given, 2)
    one = flight.load(tmp_path, 2)
    assert one.clock.step_error < 1e-3
    for other in (flight.load(folder, 2) for folder in (stopped, given)):
        assert one.clock.step == other.clock.step
        for name in scene.fraction:
            np.testing.assert_array_equal(one.landings[name].position, other.landings[name].position)


def test_more_replicates_go_on_from_those_that_were_enough_before() -> None:
    """The first are the same ones, and the time of all is counted."""
    plan = pipeline(DENSE).plan
    stages = Pipeline(fed(DENSE), replace(plan, collisions=replace(plan.collisions, replicates=6)))
    few = stages.collisions()
    before = stages.seconds["slab"].seconds
    more = stages.run(SlabRerun(beside=(few,)))
    assert (few.replicates, more.replicates) == (4, 6)
    assert stages.seconds["slab"].seconds > before
    for number in range(4):
        name = f"replicate-{number}.npz"
        assert (few.folder / name).read_bytes() == (more.folder / name).read_bytes()
    for landing in more.landings.values():
        assert set(landing.replicate) == set(range(6))


def test_a_first_replicate_that_fails_before_its_step_is_known_says_why(tmp_path: Path) -> None:
    scene = fed(DENSE)
    flight = SlabFlight(scene, make_plan(scene, force={COLLISIONS: True}), Realisations(None), 1.5e-3, 0.2, 0.3, 1e-3)
    with pytest.raises(wf.SceneError, match="less than the largest granule"):
        flight.fly_all(tmp_path, 2)
    assert not list(tmp_path.iterdir())


def test_a_weight_counts_as_so_many_granules() -> None:
    landing = landings_in([0, 0, 1, 0], replicate=np.array([0, 0, 1, 1]), weight=np.array([3.0, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(landing.counts(2), [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0]])
    tally = Tally.of_bins(landing, 2, 1)[0]
    np.testing.assert_allclose(tally.samples, [1.0, 0.5])
    assert landing.size == 6.0
    np.testing.assert_allclose(landing.mass_shares, [0.5, 1 / 6, 1 / 6, 1 / 6])


def test_a_run_shows_shares_with_collisions_and_without(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from wakeflow.show.terminal import show_result

    scene = pipeline(DENSE).scene
    result = wf.run(scene, tmp_path)
    assert result.landings.slab is not None
    assert result.landings.without_collisions is not None
    met = separate(scene, collisions(DENSE).landings)
    alone = separate(scene, pipeline(DENSE).tracks().landings)
    for found, counted in ((result.landings.separation, met), (result.landings.without_collisions, alone)):
        (value, low, high), (share, least, most) = found.share("hard", "far"), counted.share("hard", "far")
        assert value == pytest.approx(share, rel=1e-12)  # sums of other cells
        assert low < least < most < high  # the total holds what the samples leave
    assert wf.Result.load(tmp_path).to_json() == result.table
    assert json.loads((tmp_path / "result.json").read_text())["slab"]["replicates"] == collisions(DENSE).replicates
    sources = {part.source for row in result.budget for part in row.parts}
    assert {"sampling", "slab-time-step", "slab-depth", "collisions.restitution", "collisions.friction"} <= sources
    assert COLLISIONS not in sources
    for key, upper, lower in (
        ("restitution", "livelier meetings", "duller meetings"), ("friction", "rougher meetings", "smoother meetings"),
    ):  # fmt: skip
        assert upper in result.seconds
        part = next(part for row in result.budget for part in row.parts if part.source == f"collisions.{key}")
        assert part.note
        assert part.note.startswith("half of a difference" if lower in result.seconds else "a difference")
    assert "share without collisions (%)" in (tmp_path / "separation.csv").read_text().splitlines()[0]
    assert "What collisions cost" in (tmp_path / "report.html").read_text()
    show_result(result)
    out = capsys.readouterr().out
    assert "granules colliding" in out
    assert "without collisions" in out
    off = wf.run(scene, tmp_path / "off", force={COLLISIONS: False}, report=False)
    assert off.landings.slab is None
    assert "slab" not in off.table
    (value, low, high), (share, least, most) = off.share("hard", "far"), alone.share("hard", "far")
    assert value == share
    assert low <= least < most <= high  # not known for meetings left out of so dense a feed: it may be all
    assert COLLISIONS in {part.source for row in off.budget for part in row.parts}


def test_both_ends_of_a_number_fly_where_one_of_them_shows() -> None:
    """Independent samples of 400 granules do not show a change of 2 %; they show one of 20 %."""
    own = collisions(DENSE)

    def moved(share: float) -> SlabFound:
        landings = landings_in((np.arange(400) >= 400 * share).astype(int), replicate=np.arange(400) % 2)
        return replace(own, landings={"hard": landings})

    assert not shows(moved(0.5), moved(0.52), 2)
    assert shows(moved(0.5), moved(0.7), 2)
    assert not shows(moved(0.0), moved(0.0), 2)


def test_both_ends_of_a_number_fly_where_one_is_cut_off() -> None:
    """A restitution of 0.95 has hardly an upper end: what the lower one moves would not be seen."""
    own, flown = collisions(DENSE), list[float]()

    def again(rerun: CollisionRerun) -> SlabFound:
        flown.append(rerun.restitution)
        return own

    for value, ends in ((0.5, 1), (0.95, 2)):
        asked = pipeline(DENSE).scene.replace({"collisions.restitution": value})
        piped: Any = SimpleNamespace(scene=asked, collisions=lambda: own, run=again, plan=pipeline(DENSE).plan)
        found = list(BetweenGranulesRestitution().fly(piped, None))  # type: ignore[arg-type]
        assert len(found) == ends
        assert [end > 0.0 for end in flown] == [True, False][:ends]
        flown.clear()


def test_each_fraction_flies_in_the_slab_under_its_own_forces() -> None:
    """Two like fractions, one with the history force: the slab makes of each what its own flights alone do."""
    light = {"size": 2e-3, "density": 30.0, "restitution": 0.3, "friction": 0.4}
    scene = Scene.parse({
        "channel": {"width": 0.3, "top": 0.3, "bottom": -0.3},
        "air": {"speed": 0.2, "direction": "down", "turbulence": 0.02},
        "feed": {"speed": 3.0, "level": 0.2, "width": 0.05, "direction": -0.3, "count": 256, "rate": 1e-6,
                 "depth": 1.0},
        "fraction": {"plain": light, "slow": light},
        "bin": {"left": {"from": -0.15, "to": 0.02}, "right": {"from": 0.02, "to": 0.15}},
        "numerics": {"target_error": 0.01},
    })  # fmt: skip
    force = {COLLISIONS: True, "plain.basset-history": False, "slow.basset-history": True, "dispersion": False}
    piped = Pipeline(scene, make_plan(scene, force=force))
    among, alone = piped.collisions(), piped.tracks().landings
    for landings in (among.landings, alone):
        times = {name: float(landings[name].time.mean()) for name in ("plain", "slow")}
        assert 1.004 < times["slow"] / times["plain"] < 1.01


def test_replicates_without_a_fraction_are_taken_together() -> None:
    fraction, replicate = np.array([0, 0, 0, 0, 1, 1]), np.array([0, 1, 2, 3, 0, 3])
    one = np.zeros(6, dtype=int)
    assert _grouped(fraction, replicate, one, 2).tolist() == [0, 1, 0, 1, 0, 1]
    assert _grouped(fraction, replicate, np.array([0, 1, 2, 3, 0, 3]), 2).tolist() == replicate.tolist()
    every = np.array([0, 0, 0, 0, 1, 1, 1, 1]), np.array([0, 1, 2, 3, 0, 1, 2, 3])
    assert _grouped(*every, np.zeros(8, dtype=int), 2).tolist() == every[1].tolist()


def test_a_clock_that_is_not_as_exact_as_asked_is_a_warning_with_what_it_may_move() -> None:
    plan = pipeline(TRICKLE).plan
    clock = tracking.ClockStep(1e-4, 0.03, 0.01, 3)
    (told,) = _step_not_reached(collisions_of(plan.collisions, replace(collisions(TRICKLE), clock=clock)), plan.unit)
    assert "after 3 trials" in told.text
    assert "0.03 body widths (0.01 asked), which moves a share by up to 1.5 points" in told.text
    for fine in (clock._replace(step_error=0.01), tracking.ClockStep(1e-4)):
        assert not list(
            _step_not_reached(collisions_of(plan.collisions, replace(collisions(TRICKLE), clock=fine)), plan.unit)
        )
