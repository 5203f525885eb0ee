"""What a measurement would buy: of recoveries and purities of targets, said with the way to measure it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support import shipped
from wakeflow.answer.cells import LandingCells
from wakeflow.answer.draws import ErrorSource, columns
from wakeflow.answer.joint import JointAnswer
from wakeflow.answer.measurements import (
    GAIN,
    MAX_LISTED,
    METHODS,
    Purchase,
    method_of,
    purchases,
    target_number,
    worth_measuring,
)
from wakeflow.answer.result import Result
from wakeflow.answer.shares import InputPart, InputSummary
from wakeflow.planning.unknowns import SIGMAS, unknown_kinds
from wakeflow.show.words import measured_words

PAGE = Path(__file__).parents[3] / "docs" / "uncertainty.md"
RESTITUTION = "fraction.wheat.restitution"
KNOWN = {
    RESTITUTION: InputSummary(0.5, 0.4, 0.6, unit="1", why="default"),
    "fraction.wheat.inverse_inertia": InputSummary(2.0, 1.0, 3.0, unit="1", why="default"),
    "air.speed": InputSummary(5.0, 4.75, 5.25, unit="m/s", why="default"),
}


NAME = "recovery.wheat"


def answer(halves: Mapping[str, float], known: Mapping[str, InputSummary] = KNOWN, rest: float = 0.0) -> Result:
    """Of a fraction of which half lands in its target: what each input alone moves of that, and half of the interval
    that all else makes.
    """
    cells, z = LandingCells.of(shipped("vacuum"), 1), columns(halves)
    even = cells.parts() / cells.parts().sum(axis=0)
    base, way = even @ np.array([0.5, 0.5, 0.0]), even @ np.array([1.0, -1.0, 0.0])
    change = (z @ np.array(list(halves.values())) / SIGMAS)[:, None, None] * way
    roots = rest / SIGMAS * np.array([[[1.0], [-1.0], [0.0]]])
    joint = JointAnswer(
        ("wheat",), np.ones(1), {"wheat": ("near",)}, 1.0, cells, (), tuple(halves), z, base[None],
        change.astype(np.float32), (ErrorSource("sampling", roots),), "run",
    )  # fmt: skip
    return cast("Result", SimpleNamespace(joint=joint, landings=SimpleNamespace(inputs=known)))


def bought_of(result: Result, parts: Mapping[str, InputPart] | None = None) -> list[Purchase]:
    own = result.joint.own
    of = own.of_share("wheat", ["near"])
    return purchases(result, NAME, own.number(of), own.effects(of, "wheat") if parts is None else parts)


def test_an_interval_becomes_narrower_by_the_part_of_the_number_alone() -> None:
    """Known to 0.03 instead of 0.1 the restitution leaves 0.3 of its half: 0.2^2 - 0.15^2 (1 - 0.09)."""
    (bought,) = bought_of(answer({RESTITUTION: 0.15}, rest=math.sqrt(0.2**2 - 0.15**2)))
    left = math.sqrt(0.2**2 - 0.15**2 * (1.0 - 0.3**2))
    assert (bought.number.value, bought.half, bought.unit) == (pytest.approx(0.5), 0.03, "1")
    # The ends of 2048 draws are known to 3 % of the half
    assert (bought.number.low, bought.number.high) == pytest.approx((0.5 - left, 0.5 + left), abs=0.03 * left)
    assert measured_words(bought) == "the restitution of wheat to +- 0.03 (a drop test)"


def test_the_measurement_that_narrows_most_comes_first_and_what_nobody_measures_is_left_out() -> None:
    halves = {"air.speed": 0.08, RESTITUTION: 0.12, "fraction.wheat.inverse_inertia": 0.15}
    found = bought_of(answer(halves, rest=0.02))
    assert [one.key for one in found] == [RESTITUTION, "air.speed"]
    assert found[0].number.half < found[1].number.half


def test_what_is_known_better_already_and_what_may_be_chance_buys_nothing() -> None:
    sure = {RESTITUTION: InputSummary(0.5, 0.48, 0.52, unit="1", why="the scene")}
    assert not bought_of(answer({RESTITUTION: 0.15}, sure))
    one = answer({RESTITUTION: 0.15})
    assert bought_of(one)
    assert not bought_of(one, {RESTITUTION: InputPart(half=0.15, variance=0.2, error=0.3, rise=0.15)})


def test_no_measurement_leaves_less_than_what_computing_adds() -> None:
    """An input that does all there is beside the granules: it is known no better than these tell."""
    result = answer({RESTITUTION: 0.2}, {RESTITUTION: InputSummary(0.5, -2.5, 3.5, unit="1", why="default")}, rest=0.05)
    (bought,) = bought_of(result)
    numerical = result.joint.own.share("wheat", "near").numerical
    assert numerical is not None
    assert numerical <= bought.number.half <= 1.05 * numerical


def test_a_run_says_what_to_measure_of_its_own_numbers(small_run: Result) -> None:
    """Each with the number that the run's own joint answer then has, narrower by half a point or more."""
    found = list(worth_measuring(small_run))
    assert found
    for name, number, several in found:
        assert name.split(".")[0] in ("recovery", "purity")
        assert number == target_number(small_run.landings, name)
        halves = [one.number.half for one in several]
        assert halves == sorted(halves)
        assert len(halves) <= MAX_LISTED
        for one in several:
            assert one.number.half <= number.half - GAIN
            assert one.number.value == number.value
            known = small_run.landings.inputs[one.key]
            assert one.half < 0.5 * (known.high - known.low)


@pytest.mark.parametrize("key", list(METHODS))
def test_every_method_is_described_where_it_says(key: str) -> None:
    """Its section of docs/uncertainty.md is there, and the number is one that is drawn."""
    heads = [
        line.lstrip("# ").lower() for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("##")
    ]
    anchors = {re.sub(r"[^a-z0-9 -]", "", head).replace(" ", "-") for head in heads}
    assert METHODS[key].section in anchors
    known = {*unknown_kinds, *(name.replace("_", ".") for name in unknown_kinds), "feed.width", "feed.position"}
    assert key in known | {"feed.height", "air.speed", "air.turbulence"}
    assert method_of(f"fraction.wheat.{key}" if "." not in key else key) is METHODS[key]
