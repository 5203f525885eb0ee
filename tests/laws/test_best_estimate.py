"""The best estimate: what an entry gives, how entries are weighed, how wide the range is, what the data file holds."""

from dataclasses import replace

import pytest

from proofs.studies.laws import left_one_out
from wakeflow.core.errors import SceneError
from wakeflow.laws.best_estimate import (
    ERROR_PER_BLOCKAGE,
    WAKE_FAMILIES,
    WakeEntry,
    best_estimate,
    blocked,
    read_wakes,
    wakes,
)

PLAIN = {
    "family": "rhombus", "body": "b", "blockage": 0.1, "reynolds": [1e4, 1e6], "quantity": "cd", "value": [1.9, 2.1],
    "steady": 1.5, "resolved": 2.5, "source": "s", "status": "measured", "checked": "read",
}  # fmt: skip
LIFT = {**PLAIN, "quantity": "cl_rms", "value": [0.5, 0.7], "resolved": 1.0}


def entry(**changes: object) -> WakeEntry:
    return read_wakes({"one": {**PLAIN, **changes}})[0]


def test_a_number_between_the_ends_says_theta_and_a_fluctuation_the_strength() -> None:
    found = entry().given
    assert (found.value, found.low, found.high) == pytest.approx((0.5, 0.4, 0.6))
    lift = read_wakes({"lift": LIFT})[0].given
    assert (lift.value, lift.low, lift.high) == pytest.approx((0.6, 0.5, 0.7))


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
    known = read_wakes({"a": {**PLAIN, "value": [1.8, 1.9]}, "b": {**PLAIN, "value": [2.1, 2.3]}, "lift": LIFT})
    found = best_estimate("rhombus", 0.1, 2e4, known).theta
    assert found.value == pytest.approx((0.35 / 0.05**2 + 0.7 / 0.1**2) / (1 / 0.05**2 + 1 / 0.1**2))
    assert found.low == pytest.approx(0.35)
    assert found.high == pytest.approx(0.7)
    alike = read_wakes({"a": PLAIN, "b": PLAIN, "lift": LIFT})
    same = best_estimate("rhombus", 0.1, 2e4, alike).theta
    assert (same.low, same.high) == pytest.approx((0.4, 0.6))  # agreement does not shrink what each does not know


def test_the_nearest_blockage_counts() -> None:
    known = read_wakes({
        "a": PLAIN, "b": {**PLAIN, "value": [1.8, 2.0]},
        "far": {**PLAIN, "blockage": 0.4, "value": [2.4, 2.45]}, "lift": LIFT,
    })  # fmt: skip
    near, between = best_estimate("rhombus", 0.12, 2e4, known), best_estimate("rhombus", 0.25, 2e4, known)
    assert near.theta.value == pytest.approx(0.45, abs=0.01)
    assert near.theta.high < 0.6
    assert "near this blockage" in near.why
    assert between.theta.value > near.theta.value
    assert between.theta.high >= 0.92
    assert "at other blockages" in between.why
    assert ERROR_PER_BLOCKAGE > 0


def test_without_two_measurements_or_below_their_reynolds_numbers_the_range_is_the_widest() -> None:
    known = read_wakes({
        "a": {**PLAIN, "value": [1.6, 1.7]}, "b": {**PLAIN, "value": [1.7, 1.8]},
        "square": {**PLAIN, "family": "square", "value": [2.3, 2.4]}, "lift": LIFT,
    })  # fmt: skip
    widest = (0.1, 0.9)
    for family, reynolds, why in (
        (None, 2e4, "several bodies or a shape without data"),
        ("plate", 2e4, "no measurement of the shape (plate)"),
        ("square", 2e4, "one measurement of the shape"),
        ("rhombus", 5e3, "below the data's 1e"),
    ):
        found = best_estimate(family, 0.1, reynolds, known)
        assert (found.theta.low, found.theta.high) == pytest.approx(widest)
        assert why in found.why
    assert best_estimate("square", 0.1, 2e4, known).theta.value == pytest.approx(0.85)  # its own one, all the same


def test_a_strength_that_nobody_measured_goes_with_theta() -> None:
    """The others have 0.6 of strength at theta 0.5; a shape of half their theta has half their strength."""
    known = read_wakes({
        "a": PLAIN, "b": PLAIN, "lift": LIFT, "c": {**PLAIN, "family": "plate", "value": [1.7, 1.8]},
        "d": {**PLAIN, "family": "plate", "value": [1.7, 1.8]},
    })  # fmt: skip
    found = best_estimate("plate", 0.1, 2e4, known)
    assert found.theta.value == pytest.approx(0.25)
    assert found.strength.value == pytest.approx(0.6 / 0.5 * 0.25)
    assert found.strength.low == pytest.approx(1.2 * found.theta.low)
    assert "theta times 1.20" in found.why
    assert "theta times" not in best_estimate(None, 0.1, 2e4, known).why


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
    for family in (*WAKE_FAMILIES, None):
        found = best_estimate(family, 0.125, 1.65e4)
        for number in (found.theta, found.strength):
            assert 0.0 <= number.low < number.value < number.high <= 1.0
    rhombus = best_estimate("rhombus", 0.125, 1.65e4).theta
    assert 0.3 < rhombus.value < 0.75
    assert rhombus.high - rhombus.low > 0.2  # what drags, base pressure and a run in three dimensions differ by


def test_what_is_left_out_is_told_by_the_others_but_for_what_the_documentation_names() -> None:
    missed = {one.name for one, own, others in left_one_out() if own.low > others.high or own.high < others.low}
    # a lift that asks for a third of what moves across on the axis; a duct whose walls hold the wake two-dimensional
    assert missed == {"rhombus-3d-lift", "volvo-length"}
