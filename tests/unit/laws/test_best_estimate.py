"""The best estimate: what an entry gives, how entries are weighed, how wide the range is, what the data file holds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from proofs.studies.laws import left_one_out
from wakeflow.core.errors import SceneError
from wakeflow.laws.best_estimate import (
    BETWEEN_SOURCES,
    ERROR_PER_BLOCKAGE,
    WAKE_FAMILIES,
    WakeEntry,
    best_estimate,
    blocked,
    by_source,
    read_wakes,
    wakes,
)

PLAIN = {
    "family": "rhombus", "body": "b", "blockage": 0.1, "reynolds": [1e4, 1e6], "quantity": "cd", "value": [1.9, 2.1],
    "steady": 1.5, "resolved": 2.5, "source": "s", "status": "measured", "checked": "read",
}  # fmt: skip
ACROSS = {**PLAIN, "quantity": "v_rms", "value": [0.5, 0.7], "resolved": 1.0}
LIFT = {**ACROSS, "quantity": "cl_rms"}
AIR = {"across": ACROSS, "lift": LIFT}  # one source each of the two numbers beside theta


def entry(**changes: object) -> WakeEntry:
    return read_wakes({"one": {**PLAIN, **changes}})[0]


def test_a_number_between_the_ends_says_theta_and_a_fluctuation_the_strength() -> None:
    found = entry().given
    assert (found.value, found.low, found.high) == pytest.approx((0.5, 0.4, 0.6))
    across, lift = read_wakes(AIR)
    assert (across.number, lift.number) == ("strength", "lift")
    assert (across.given.value, across.given.low, across.given.high) == pytest.approx((0.6, 0.5, 0.7))


def test_the_lift_is_no_strength_of_the_velocity() -> None:
    """Whatever a body's lift is, the air behind it fluctuates by what moves across."""
    one, other = (
        best_estimate("rhombus", 0.1, 2e4, read_wakes({"a": PLAIN, "across": ACROSS, "lift": {**LIFT, "value": value}}))
        for value in ([0.1, 0.2], [0.8, 0.9])
    )
    assert one.strength == other.strength
    assert (one.lift.value, other.lift.value) == pytest.approx((0.15, 0.85))


def test_a_coarser_mesh_is_an_error_and_no_measurement() -> None:
    found = entry(coarse=[2.2, 2.4]).given
    assert found.value == pytest.approx(0.5)
    assert found.high - found.value == pytest.approx(math.hypot(0.1, 0.3))


def test_one_source_has_one_vote_however_many_numbers_it_gives() -> None:
    """Three numbers of one run beside one of another: as if the run had given their mean alone."""
    run = {f"run-{i}": {**PLAIN, "datum": "run", "value": [1.8, 2.0]} for i in range(3)}
    other = {**PLAIN, "value": [2.2, 2.4]}
    many, one = (
        best_estimate("rhombus", 0.1, 2e4, read_wakes({**known, "other": other, **AIR}))
        for known in (run, {"run": {**PLAIN, "value": [1.8, 2.0]}})
    )
    assert many.theta == pytest.approx(one.theta)
    assert many.theta.value == pytest.approx(0.6)
    assert "2 sources of the shape" in many.why
    (found,) = by_source(read_wakes({"a": {**PLAIN, "datum": "run"}, "b": {**other, "datum": "run"}})).values()
    assert (found.low, found.high) == pytest.approx((0.5, 0.8))  # and it knows no more than what they differ by


def test_uncertain_ends_widen_what_an_entry_says() -> None:
    wide = entry(resolved_within=0.3, steady_within=0.1).given
    assert wide.value == pytest.approx(0.5)
    assert wide.high - wide.value == pytest.approx((0.1**2 + 0.15**2 + 0.05**2) ** 0.5)
    sharp = entry(value=[2.0, 2.0]).given
    assert sharp.high - sharp.low == pytest.approx(0.06)  # nobody measures better


def test_a_quantity_that_is_not_linear_goes_through_what_the_blend_gave() -> None:
    length = entry(quantity="reversal_length", value=[1.0, 1.0], steady=4.0, resolved=0.6, between=[[0.5, 1.0]])
    assert length.given.value == pytest.approx(0.5)
    assert replace(length, between=()).given.value == pytest.approx(3.0 / 3.4)


def test_maskells_rule_by_hand_and_between_its_own_two_sides() -> None:
    drag, base = blocked(1.5, -1.2, 0.125)
    assert drag == pytest.approx(1.778, abs=5e-4)
    assert base == pytest.approx(-1.607, abs=5e-4)
    assert blocked(1.5, -1.2, 0.0) == (1.5, pytest.approx(-1.2))
    factor = (1.0 - base) / (1.0 + 1.2)  # k^2 over k_c^2
    assert drag == pytest.approx(1.5 * factor)
    assert factor == pytest.approx(1.0 + drag * 0.125 / 1.2)


def test_entries_weigh_by_their_errors_and_their_scatter_is_the_least_range() -> None:
    known = read_wakes({"a": {**PLAIN, "value": [1.8, 1.9]}, "b": {**PLAIN, "value": [2.1, 2.3]}, **AIR})
    found = best_estimate("rhombus", 0.1, 2e4, known).theta
    assert found.value == pytest.approx((0.35 / 0.05**2 + 0.7 / 0.1**2) / (1 / 0.05**2 + 1 / 0.1**2))
    assert found.low == pytest.approx(0.35)
    assert found.high == pytest.approx(0.7)
    alike = read_wakes({"a": PLAIN, "b": PLAIN, **AIR})
    same = best_estimate("rhombus", 0.1, 2e4, alike).theta
    assert (same.low, same.high) == pytest.approx((0.4, 0.6))  # agreement does not shrink what each does not know


def test_the_nearest_blockage_counts() -> None:
    known = read_wakes({
        "a": PLAIN, "b": {**PLAIN, "value": [1.8, 2.0]},
        "far": {**PLAIN, "blockage": 0.4, "value": [2.4, 2.45]}, **AIR,
    })  # fmt: skip
    near, between = best_estimate("rhombus", 0.12, 2e4, known), best_estimate("rhombus", 0.25, 2e4, known)
    assert near.theta.value == pytest.approx(0.45, abs=0.01)
    assert near.theta.high < 0.6
    assert "near this blockage" in near.why
    assert between.theta.value > near.theta.value
    assert between.theta.high >= 0.92
    assert "at other blockages" in between.why
    assert ERROR_PER_BLOCKAGE > 0


def test_without_a_source_or_below_their_reynolds_numbers_the_range_is_the_widest() -> None:
    known = read_wakes({
        "a": {**PLAIN, "value": [1.6, 1.7]}, "b": {**PLAIN, "value": [1.7, 1.8]},
        "square": {**PLAIN, "family": "square", "value": [2.3, 2.4]}, **AIR,
    })  # fmt: skip
    widest = (0.1, 0.9)
    for family, reynolds, why in (
        ("", 2e4, "several bodies or a shape without data"),
        ("plate", 2e4, "no measurement of the shape (plate)"),
        ("rhombus", 5e3, "below the data's 1e"),
    ):
        found = best_estimate(family, 0.1, reynolds, known)
        assert (found.theta.low, found.theta.high) == pytest.approx(widest)
        assert why in found.why
    alone = best_estimate("square", 0.1, 2e4, known)
    assert alone.theta.value == pytest.approx(0.85)
    assert alone.theta.low == pytest.approx(0.85 - math.hypot(0.05, BETWEEN_SOURCES))
    assert "one source of the shape (square)" in alone.why


def test_a_strength_that_nobody_measured_goes_with_theta() -> None:
    """The others have 0.6 of strength at theta 0.5; a shape of half their theta has half their strength."""
    known = read_wakes({
        "a": PLAIN, "b": PLAIN, **AIR, "c": {**PLAIN, "family": "plate", "value": [1.7, 1.8]},
        "d": {**PLAIN, "family": "plate", "value": [1.7, 1.8]},
    })  # fmt: skip
    found = best_estimate("plate", 0.1, 2e4, known)
    assert found.theta.value == pytest.approx(0.25)
    assert found.strength.value == pytest.approx(0.6 / 0.5 * 0.25)
    assert found.strength.low == pytest.approx(1.2 * found.theta.low)
    assert "theta times 1.20" in found.why
    assert "theta times 1.20" in best_estimate("", 0.1, 2e4, known).why


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"family": "sphere"}, "unknown family 'sphere'"),
        ({"quantity": "lift"}, "unknown quantity 'lift'"),
        ({"value": None}, "needs value, or unconfined and base"),
        ({"value": [2.0, 1.0]}, "low before high"),
        ({"status": "guess"}, "status 'guess'"),
        ({"checked": "no"}, "checked 'no'"),
        ({"resolved": 1.5}, "its ends are equal"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_an_entry_that_breaks_the_rules_is_named(changes: dict[str, object], said: str) -> None:
    table = {key: value for key, value in {**PLAIN, **changes}.items() if value is not None}
    with pytest.raises(SceneError, match=f"wakes.toml: wrong: .*{said}"):
        read_wakes({"wrong": table})


def test_the_shipped_data_say_something_for_every_shape_and_hold_their_own_entries() -> None:
    assert {one.family for one in wakes()} == set(WAKE_FAMILIES)
    for family in (*WAKE_FAMILIES, ""):
        found = best_estimate(family, 0.125, 1.65e4)
        for number in (found.theta, found.strength):
            assert 0.0 <= number.low < number.value < number.high <= 1.0
    rhombus = best_estimate("rhombus", 0.125, 1.65e4).theta
    assert 0.3 < rhombus.value < 0.75
    assert rhombus.high - rhombus.low > 0.15  # what drags, base pressure and a run in three dimensions are good to
    assert len({one.datum for one in wakes()}) == 13


def test_sources_of_one_shape_differ_by_what_one_alone_is_given() -> None:
    groups = [
        [one.value for one in by_source([e for e in wakes() if e.family == family and e.number == "theta"]).values()]
        for family in WAKE_FAMILIES
    ]
    several = [[x for x in group if x < 0.9] for group in groups if len(group) > 1]  # the duct: walls that are near
    assert sum(map(len, several)) == 10
    spread = sum(len(group) * np.var(group) for group in several) / sum(len(group) - 1 for group in several)
    assert pytest.approx(2.0 * math.sqrt(spread), abs=0.005) == BETWEEN_SOURCES


def test_what_is_left_out_is_told_by_the_others_but_for_what_the_documentation_names() -> None:
    missed = {row["datum"] for row in left_one_out() if not row["held"]}
    assert missed == {"volvo"}  # a duct whose walls hold the wake two-dimensional
