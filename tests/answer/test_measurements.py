"""What a measurement would buy: of recoveries and purities of targets, said with the way to measure it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from wakeflow.answer.measurements import METHODS, method_of, purchases
from wakeflow.answer.shares import InputPart, InputSummary
from wakeflow.core.number import Number
from wakeflow.planning.unknowns import unknown_kinds
from wakeflow.report.words import measured_words

PAGE = Path(__file__).parents[2] / "docs" / "measuring.md"
RESTITUTION = "fraction.wheat.restitution"
KNOWN = {
    RESTITUTION: InputSummary(0.5, 0.4, 0.6, unit="1", why="default"),
    "fraction.wheat.inverse_inertia": InputSummary(2.0, 1.0, 3.0, unit="1", why="default"),
    "air.speed": InputSummary(5.0, 4.75, 5.25, unit="m/s", why="default"),
}


def _part(half: float, variance: float) -> InputPart:
    return InputPart(half=half, variance=variance, error=0.05 * variance, rise=half)


def test_an_interval_becomes_narrower_by_the_part_of_the_number_alone() -> None:
    """Known to 0.03 instead of 0.1 the restitution leaves 0.3 of its half: 0.2^2 - 0.15^2 (1 - 0.09)."""
    (bought,) = purchases(Number(0.76, 0.56, 0.96), {RESTITUTION: _part(0.15, 0.6)}, KNOWN)
    left = math.sqrt(0.2**2 - 0.15**2 * (1.0 - 0.3**2))
    assert (bought.number.low, bought.number.high) == pytest.approx((0.76 - left, 0.76 + left))
    assert measured_words(bought) == "the restitution of wheat to +- 0.03 (a drop test)"


def test_the_measurement_that_narrows_most_comes_first_and_what_nobody_measures_is_left_out() -> None:
    parts = {
        "air.speed": _part(0.05, 0.1),
        RESTITUTION: _part(0.12, 0.4),
        "fraction.wheat.inverse_inertia": _part(0.15, 0.5),
    }
    found = purchases(Number(0.76, 0.56, 0.96), parts, KNOWN)
    assert [one.key for one in found] == [RESTITUTION, "air.speed"]


def test_what_is_known_better_already_and_what_may_be_chance_buys_nothing() -> None:
    sure = {RESTITUTION: InputSummary(0.5, 0.48, 0.52, unit="1", why="the scene")}
    assert not purchases(Number(0.76, 0.56, 0.96), {RESTITUTION: _part(0.15, 0.6)}, sure)
    vague = InputPart(half=0.15, variance=0.2, error=0.3, rise=0.15)
    assert not purchases(Number(0.76, 0.56, 0.96), {RESTITUTION: vague}, KNOWN)


@pytest.mark.parametrize("key", list(METHODS))
def test_every_method_is_described_where_it_says(key: str) -> None:
    """Its section of docs/measuring.md is there, and the number is one that is drawn."""
    heads = [
        line.lstrip("# ").lower() for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("##")
    ]
    anchors = {re.sub(r"[^a-z0-9 -]", "", head).replace(" ", "-") for head in heads}
    assert METHODS[key].section in anchors
    known = {*unknown_kinds, *(name.replace("_", ".") for name in unknown_kinds), "feed.width", "feed.position"}
    assert key in known | {"feed.height", "air.speed", "air.turbulence"}
    assert method_of(f"fraction.wheat.{key}" if "." not in key else key) is METHODS[key]
