"""Sources of the budget are registered objects: what each of them owes, and one that is added from outside."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.answer.provenance import KnobSettings
from wakeflow.answer.shares import CALIBRATED, COMPANION, MEASURED, UNKNOWN, BudgetPart, BudgetRow, BudgetTotal
from wakeflow.budget.comparison import Comparison
from wakeflow.budget.model import MODEL
from wakeflow.budget.source import FractionResults, Parts, Source, add, budget_sources
from wakeflow.budget.total import remedies
from wakeflow.laws.best_estimate import WakeEstimate, best_estimate
from wakeflow.pipeline.cache import StageTime
from wakeflow.pipeline.landings import Tracked
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.track_stage import Companion
from wakeflow.planning.cost import flown_again
from wakeflow.planning.make import make_plan
from wakeflow.planning.stages import StageCost, Workload
from wakeflow.planning.wake import Wake
from wakeflow.runs.refine import told_unmet
from wakeflow.runs.settings import expected_half, expected_part, expected_seconds
from wakeflow.scene import Scene


class CoarserSteps(Source[Tracked]):
    """Granules flown again at ten times the tolerance: an example of a source, as docs/extending.md shows it."""

    name, how, place = "coarser-steps", COMPANION, 70
    if_unknown = "numerics.tolerance = 1e-3"
    if_large = "fly by hand"

    def costs(self, work: Workload) -> Iterable[StageCost]:
        return [flown_again(work, self.name, 0.5)]  # half as long as the granules of a comparison

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Tracked:
        return pipeline.tracks(Companion(self.name, tolerance=10 * pipeline.scene.numerics.tolerance))

    def shares(self, fraction: FractionResults) -> Parts:
        coarse, bins = fraction.flights.of(self), len(fraction.pipeline.scene.bin)
        moved = coarse.landings[fraction.name].counts(bins) - fraction.compared.counts(bins)
        errors, seconds = np.abs(moved.mean(axis=0)), fraction.pipeline.spent(self.name)
        return {place: [self.part(float(error), seconds)] for place, error in zip(fraction.shares, errors, strict=True)}

    def expected(self, part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float:
        return (part.error or 0.0) * then.tolerance / now.tolerance


@pytest.fixture
def coarser() -> Iterator[Source[Tracked]]:
    """The example, registered as any source is, and taken out again."""
    source = add(CoarserSteps())
    yield source
    budget_sources.remove(source.name)


def test_a_new_source_stands_in_the_budget_of_a_run(coarser: CoarserSteps, cases: Path, tmp_path: Path) -> None:
    result = wf.run(Scene.load(cases / "vacuum.toml", {"feed.count": 256}), tmp_path)
    shares = [row for row in result.budget if row.quantity.startswith("share.")]
    assert shares
    for row in shares:
        names = [part.source for part in row.parts]
        assert names.index("inputs") < names.index("integration") < names.index("coarser-steps")
        (part,) = [part for part in row.parts if part.source == coarser.name]
        assert part.error is not None
        assert part.seconds > 0.0
    assert "coarser-steps" in result.table["seconds"]
    assert "coarser-steps" in (tmp_path / "budget.csv").read_text()
    assert "coarser-steps" in (tmp_path / "report.html").read_text()


def test_a_new_source_that_flies_again_is_in_the_plans_cost(cases: Path, request: pytest.FixtureRequest) -> None:
    scene = Scene.load(cases / "vacuum.toml")
    before = make_plan(scene)
    request.getfixturevalue("coarser")
    after = make_plan(scene)
    (added,) = set(after.stages) - set(before.stages)
    assert (added.name, added.when, added.key.stage.work, added.key.heading) == (
        "coarser-steps", "after", "flights", "companions"
    )  # fmt: skip
    assert after.estimate["seconds"] == pytest.approx(before.estimate["seconds"] + added.seconds)


@pytest.mark.usefixtures("coarser")
def test_a_new_source_is_refined_and_has_a_remedy(cases: Path) -> None:
    now = KnobSettings(granules=1024, tolerance=1e-3, mesh_scale=None, averaging=None, slab=None)
    finer = replace(now, tolerance=1e-4)
    part = BudgetPart("coarser-steps", 0.2, 1.0, COMPANION)
    assert expected_part(part, now, finer) == pytest.approx(0.02)
    row = BudgetRow("share.wheat.left", None, (part,), BudgetTotal(0.2, 1.0, 0.0, 1.0, 0.2))
    assert expected_half(row, now, finer) == pytest.approx(0.02)
    spent = {"coarser-steps": StageTime(5.0, False)}
    assert expected_seconds(spent, now, replace(now, granules=4096)) == pytest.approx(0.4 + 4.0 * 4.6)
    assert remedies(["coarser-steps"]) == ["numerics.tolerance = 1e-3"]
    scene = Scene.load(cases / "vacuum.toml")
    (line,) = told_unmet([row], now, 1e-9, scene, make_plan(scene))
    assert line.startswith("wheat in left: coarser-steps stays at")
    assert line.endswith(": fly by hand")


@pytest.mark.parametrize("name", list(budget_sources))
def test_a_source_says_what_it_is(name: str) -> None:
    source: Source[Any] = budget_sources[name]
    assert source.name == name
    assert source.how in (MEASURED, COMPANION, CALIBRATED, UNKNOWN)
    assert type(source).__doc__


def test_every_source_that_flies_granules_again_is_in_the_plans_cost() -> None:
    flying = {name for name in budget_sources if type(budget_sources[name]).fly is not Source.fly}
    assert flying == {name for name in budget_sources if type(budget_sources[name]).costs is not Source.costs}
    assert {name for name in flying if budget_sources[name].how != COMPANION} == set()


def test_no_two_sources_share_a_place_in_a_row() -> None:
    assert budget_sources[MODEL.name] is MODEL
    places = [budget_sources[name].place for name in budget_sources]
    assert len(set(places)) == len(places)


def test_the_models_error_is_of_no_best_estimate_and_the_farthest_wake_of_another() -> None:
    """Shares of one bin by wake. The two numbers of a best estimate are drawn; its ends stand in the bracket alone."""
    share = {Wake.STEADY: 0.9, Wake.TIME_RESOLVED: 0.1, Wake.ANSWER: 0.5}
    wakes = Comparison({wake: {"dust": np.full((4, 1), value)} for wake, value in share.items()}, 7.0)
    estimate = best_estimate("rhombus", 0.125, 1.65e4)

    def parts(wake: WakeEstimate | None, found: Comparison[Wake]) -> Mapping[str, Sequence[BudgetPart]]:
        pipeline = SimpleNamespace(plan=SimpleNamespace(airflow=SimpleNamespace(wake=wake)))
        flights = SimpleNamespace(of=lambda source: found)
        asked = SimpleNamespace(name="dust", shares={"middle": None}, flights=flights, pipeline=pipeline)
        return MODEL.shares(asked)  # type: ignore[arg-type]

    assert parts(estimate, wakes) == {}
    laminar = Comparison({wake: wakes.shares[wake] for wake in (Wake.STEADY, Wake.ANSWER)}, 1.0)
    (part,) = parts(None, laminar)["middle"]
    assert (part.error, part.note) == (pytest.approx(0.4), "farthest: steady (+40 points)")
