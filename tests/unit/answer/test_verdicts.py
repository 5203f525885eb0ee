"""Limits of a scene: met, not met or open, and what would decide."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

import wakeflow as wf
from support import shipped
from wakeflow.answer.budget import agreement
from wakeflow.answer.budget.agreement import verdicts_of
from wakeflow.answer.result import Result
from wakeflow.answer.shares import MET, NOT_MET, OPEN, BudgetPart
from wakeflow.core.graded import Grade
from wakeflow.show.words import NO_VALUE, SUMMED, bins_in_words, percent, rate_words, verdict_lines


def held_to(run: Result, limits: dict[str, dict[str, float]], **changed: object) -> Result:
    """A run with other limits, and a verdict on each."""
    other = replace(run, scene={**run.scene, "limit": limits}, **changed).with_joint(run.joint)
    return replace(other, limits=tuple(verdicts_of(other)))


def test_a_limit_is_met_below_it_not_met_above_it_and_open_between(small_run: Result) -> None:
    loss, dirt = small_run.loss("hard"), small_run.dirt("near")
    for kind, name, one in (("loss", "hard", loss), ("dirt", "near", dirt)):
        for most, verdict in ((one.high, MET), (0.5 * (one.low + one.value), OPEN), (0.9 * one.low, NOT_MET)):
            (found,) = held_to(small_run, {kind: {name: most}}).limits
            assert (found.limit, found.most, found.value, found.verdict) == (f"{kind}.{name}", most, one, verdict)
            assert bool(found.decides) == (verdict == OPEN)
    assert small_run.limits == ()


def test_what_decides_of_an_open_limit_is_the_measurement_that_leaves_it_out(small_run: Result) -> None:
    """The restitution of the hard granules does nearly all; a limit within what computing leaves needs finer
    computing, one that the measurement would still hold is decided by none.
    """
    loss = small_run.loss("hard")
    (far,) = held_to(small_run, {"loss": {"hard": loss.low + 0.02 * (loss.value - loss.low)}}).limits
    assert far.decides == "measuring the restitution of hard to +- 0.03 (a drop test)"
    (near,) = held_to(small_run, {"loss": {"hard": loss.value}}).limits
    assert near.decides.startswith("finer computing, which alone leaves +- ")
    assert loss.numerical is not None
    between = loss.value - 1.2 * loss.numerical
    (held,) = held_to(small_run, {"loss": {"hard": between}}).limits
    assert held.decides == "no measurement alone; first the restitution of hard to +- 0.03 (a drop test)"
    told = held_to(small_run, {"loss": {"hard": between}})
    assert verdict_lines(told)[0].startswith(f"loss.hard at most {100 * between:.4g} %: open, ")


def test_nothing_is_met_by_an_answer_that_is_void_or_lacks_something(small_run: Result) -> None:
    void = {"grades": (Grade.VOID.value,), "warnings": ("the feed is too dense",)}
    (found,) = held_to(small_run, {"loss": {"hard": 1.0}}, **void).limits
    assert (found.verdict, found.decides) == (OPEN, "an answer that is not void: the feed is too dense")
    assert small_run.landings is not None
    part = BudgetPart("airflow-model")
    budget = [replace(row, parts=(*row.parts, part)) for row in small_run.landings.budget]
    lacking = replace(small_run.landings, budget=tuple(budget))
    (found,) = held_to(small_run, {"loss": {"hard": 1.0}}, landings=lacking).limits
    assert found.verdict == OPEN
    assert found.decides.startswith("the size of airflow-model, which the interval lacks: numerics.rung = 'standard'")


def test_a_product_in_which_nothing_lands_is_open(small_run: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    assert small_run.landings is not None
    empty = replace(small_run.landings.separation, dirt={"near": None})
    other = replace(small_run, landings=replace(small_run.landings, separation=empty))
    monkeypatch.setattr(agreement, "purchases", SimpleNamespace())  # nothing is measured of no number
    (found,) = held_to(other.with_joint(small_run.joint), {"dirt": {"near": 0.1}}).limits
    assert (found.value, found.verdict, found.decides) == (None, OPEN, "a design in which something lands there")


def test_limits_of_what_no_answer_has_are_refused() -> None:
    for key, message in (
        ("loss.hrad", "no fraction with a target; did you mean 'hard'?"),
        ("dirt.nar", "no bin that is a fraction's target; did you mean 'near'?"),
    ):
        with pytest.raises(wf.SceneError, match=message):
            shipped("vacuum", {f"limit.{key}": "1 %"})
    with pytest.raises(wf.SceneError, match=r"limit.loss.hard = 5: too large .* Write '5 %'"):
        shipped("vacuum", {"limit.loss.hard": 5})


def test_a_limit_moves_no_granule_and_a_plan_tells_of_one_that_is_finer_than_its_accuracy() -> None:
    plain, held = shipped("vacuum"), shipped("vacuum", {"limit.loss.hard": "0.5 %"})
    from wakeflow.flight.stages.pipeline import unweighed

    assert unweighed(plain) == unweighed(held)
    told = [line for line in wf.plan(held).warnings if "limit.loss.hard" in line]
    assert len(told) == 1
    assert "numerics.target_error = '0.25 %'" in told[0]
    assert not any("limit." in line for line in wf.plan(shipped("vacuum", {"limit.loss.hard": "5 %"})).warnings)


def test_loss_and_dirt_are_on_the_page_and_in_the_table_and_a_void_answer_shows_no_rate(small_run: Result) -> None:
    assert small_run.landings is not None
    page = (small_run.folder / "report.html").read_text()
    assert "lost, kg/h" in page
    assert "dirt (%)" in page
    assert rate_words(small_run.landings.separation.lost["hard"]).removesuffix(" kg/h") in page
    rows = {row.place: row for row in bins_in_words(small_run, small_run.landings.separation)}
    assert [*rows][-SUMMED:] == ["recovery", "loss", "loss, kg/h"]
    assert rows["near"].purities[-1] == ("dirt", percent(small_run.dirt("near")))
    void = replace(small_run, grades=(Grade.VOID.value,), warnings=("the feed is too dense",))
    told = [*bins_in_words(void, small_run.landings.separation)]
    cells = [text for row in told for text in (row.flow, *(share for share, _ in row.shares))]
    assert set(cells) <= {"void", "", NO_VALUE}
