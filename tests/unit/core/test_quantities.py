"""Numbers with a unit mean what they say, or are refused; boxes, brackets of roots, grades of messages."""

import math
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakeflow.core import quantities
from wakeflow.core.geometry import Boxes, ForceDensity, halved, halved_all
from wakeflow.core.graded import gravest_first, information, less_sure, void
from wakeflow.core.quantities import converted, quantity, say, speaking


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("1800 rpm", "Hz", 30.0),
        ("1800/min", "Hz", 30.0),
        ("1800 1/min", "Hz", 30.0),
        ("360 deg/s", "Hz", 1.0),
        ("60 rad/s", "Hz", 30 / math.pi),
        ("0.03 kHz", "Hz", 30.0),
        ("90 %", "1", 0.9),
        ("5 permille", "1", 0.005),
        ("60°", "rad", math.pi / 3),
        ("50 gon", "rad", math.pi / 4),
        ("1300 kg/m3", "kg/m^3", 1300.0),
        ("1.3 g/cm^3", "kg/m^3", 1300.0),
        ("500 kg/h", "kg/s", 500 / 3600),
        ("18 km/h", "m/s", 5.0),
        ("40 µm", "m", 4e-5),
        ("−120 mm", "m", -0.12),
        ("5e1mm", "m", 0.05),
        ("18.25 uPa s", "Pa*s", 1.825e-5),
    ],
)
def test_a_text_means_what_it_says(text: str, unit: str, value: float) -> None:
    assert quantity(text, unit, "") == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("1,5 m/s", "m/s", "a decimal point is written '.', and thousands without a mark: '1.5 m/s'"),
        ("1,500 mm", "m", "'1.500 mm' or '1500 mm'"),
        ("1,500,000 mm", "m", "without a mark: '1500000 mm'"),
        ("1 500 kg/h", "kg/s", "without a mark: '1500 kg/h'"),
        ("1'500 mm", "m", "'1500 mm'"),
        ("60", "rad", "needs a number in rad or a string such as 'EXAMPLE'"),
        ("60", "m", "needs a number in m"),
        ("50 %", "rad", "needs a number in rad"),
        ("5 deg m", "m", "needs a number in m"),
        ("0.9", "1", "needs a number or a string such as 'EXAMPLE'"),
        ("0.9 rad", "1", "needs a number or"),
        ("5 kg", "m/s", "needs a number in m/s"),
        ("45 grad", "rad", "needs deg or gon"),
        ("45 Grad/s", "Hz", "needs deg or gon"),
        ("30 Bq", "m", "needs a number in m"),
        ("2*3 mm", "m", "needs a number in m"),
        ("5 mm 3", "m", "needs a number in m"),
        ("5 m/0 m", "m", "needs a number in m"),
        ("5 parsnips", "m", "needs a number in m"),
        ("mm", "m", "needs a number in m"),
        ("", "m", "needs a number in m"),
        ("nan mm", "m", "needs a number in m"),
        ("five mm", "m", "needs a number in m"),
    ],
)
def test_what_could_mean_something_else_is_refused(text: str, unit: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"^(needs|a decimal point)") as caught:
        quantity(text, unit, "EXAMPLE")
    assert message in str(caught.value)


@given(st.floats(-1e6, 1e6), st.sampled_from(["mm", "cm", "m", "km", "um", "inch", "ft"]))
def test_a_length_comes_back_in_the_unit_it_was_written_in(number: float, unit: str) -> None:
    metres = quantity(f"{number!r} {unit}", "m", "")
    assert converted(metres, "m", unit) == pytest.approx(number, rel=1e-12, abs=1e-300)


@given(st.integers(1, 999), st.sampled_from(",' _’"), st.integers(0, 999), st.sampled_from(["mm", " rpm", " kg/h", ""]))
def test_marks_between_digits_are_never_passed_over(whole: int, mark: str, rest: int, unit: str) -> None:
    for wanted in ("m", "Hz", "kg/s", "1", "rad"):
        with pytest.raises(ValueError, match="without a mark"):
            quantity(f"{whole}{mark}{rest:03d}{unit}", wanted, "")


@pytest.mark.parametrize("unit", ["(Hz", "Hz)", "{Hz", "Hz;", "$Hz", "Hz !", 'Hz"', "Hz \\", "Hz*" * 3000 + "Hz"])
def test_a_unit_that_is_not_whole_or_has_other_letters_is_none(unit: str) -> None:
    with pytest.raises(ValueError, match="is not a unit like 'Hz'"):
        quantities.converted(20.0, unit, "Hz")


def test_numbers_are_said_in_the_users_unit() -> None:
    assert say(0.05, "m") == "0.05 m"
    with speaking({"m": "mm", "rad": "deg", "Hz": "rpm", "1": "%"}):
        assert [say(0.05, "m"), say(math.radians(80) + 1e-9, "rad"), say(30.0, "Hz"), say(0.5, "1")] == [
            "50 mm",
            "80 deg",
            "1800 rpm",
            "50 %",
        ]
        assert say(0.1375, "m", 2) == "140 mm"
        with speaking({}):
            assert say(0.5, "1") == "0.5"
    assert say(1.0, "rad") == "1 rad"


def test_a_length_is_said_in_a_unit_that_a_person_would_choose() -> None:
    with speaking({"m": "um"}):
        assert [say(x, "m") for x in (2e-5, 0.0, 5e-3, 0.102, 2.7, -2.7)] == [
            "20 um", "0 um", "5000 um", "102 mm", "2.7 m", "-2.7 m"
        ]  # fmt: skip
    with speaking({"m": "mm"}):
        assert [say(x, "m") for x in (5e-6, 2e-5, 2.7, 12.0)] == ["5 um", "0.02 mm", "2700 mm", "12 m"]
    assert say(5e-4, "m") == "0.0005 m"  # where no unit is written, numbers are of the SI


@pytest.mark.parametrize(
    ("text", "kelvin"), [("20 C", 293.15), ("68 F", 293.15), ("20 degC", 293.15), ("-5 C", 268.15)]
)
def test_a_temperature_may_be_in_degrees(text: str, kelvin: float) -> None:
    assert quantity(text, "K", "20 degC") == pytest.approx(kelvin)


def test_the_gravest_come_first_each_once_and_in_order() -> None:
    told = [information("a"), less_sure("b"), void("c"), less_sure("d"), less_sure("b")]
    assert [notice.text for notice in gravest_first(told)] == ["c", "b", "d", "a"]


def test_boxes_fill_the_channel_and_none_lies_astride_the_axis() -> None:
    boxes = Boxes.across(0.4, -0.2, 0.2, 0.05 / 16)
    assert boxes.columns % 2 == 0
    assert boxes.columns * boxes.pitch == pytest.approx(0.4)
    assert boxes.bottom + boxes.rows * boxes.pitch >= 0.2 - 1e-12
    np.testing.assert_allclose(boxes.centres[0, :, 0], -boxes.centres[0, ::-1, 0], atol=1e-15)


def test_every_centre_lies_in_its_own_box_and_a_point_outside_in_the_nearest() -> None:
    boxes = Boxes(-0.3, 0.1, 0.1, 6, 3)
    np.testing.assert_array_equal(boxes.holding(boxes.centres.reshape(-1, 2)), np.arange(18))
    np.testing.assert_array_equal(boxes.holding(np.array([[-9.0, 0.15], [9.0, 9.0]])), [0, 17])


def test_a_mirrored_force_is_its_own_image_and_as_strong_along() -> None:
    boxes = Boxes(-0.2, 0.0, 0.1, 4, 2)
    force = ForceDensity(boxes, np.random.default_rng(1).normal(size=(2, 4, 2)))
    made = force.mirrored()
    np.testing.assert_allclose(made.density, made.density[:, ::-1] * (-1.0, 1.0))
    assert made.total == pytest.approx([0.0, force.total[1]], abs=1e-15)
    np.testing.assert_allclose(made.mirrored().density, made.density)


def test_the_part_of_a_way() -> None:
    boxes = Boxes(0.0, 0.0, 0.5, 2, 1)
    weak, strong = (ForceDensity(boxes, np.array([[[0.0, a], [3.0, 4.0]]])) for a in (0.1, 0.3))
    assert weak.towards(strong, 0.5).density[0, 0, 1] == pytest.approx(0.2)
    assert weak.digest == replace(weak, density=weak.density.copy()).digest
    assert len({weak.digest, strong.digest, replace(weak, boxes=replace(boxes, pitch=0.4)).digest}) == 3


@pytest.mark.parametrize("halvings", [0, 1, 7, 200])
def test_the_bracket_keeps_the_change_and_shrinks_by_two_each_time(halvings: int) -> None:
    low, high = halved(lambda x: x < math.pi, 3.0, 4.0, halvings)
    assert low < math.pi <= high
    assert high - low == max(0.5**halvings, math.ulp(math.pi))


def _cube_below(value: float, x: float) -> bool:
    return x**3 < value


def test_many_brackets_at_once_give_what_each_gives_alone() -> None:
    rng = np.random.default_rng(4)
    at = rng.uniform(-5.0, 5.0, 50)
    low, high = halved_all(lambda x: x**3 < at, np.full(50, -2.0), np.full(50, 2.0), 45)
    for i, value in enumerate(at):
        assert (low[i], high[i]) == halved(partial(_cube_below, float(value)), -2.0, 2.0, 45)
    assert np.all((low**3 < at) & (at <= high**3))


def test_a_condition_that_never_changes_ends_at_the_end_it_points_to() -> None:
    assert halved(lambda _: True, 0.0, 1.0, 100)[1] == 1.0
    assert halved(lambda _: False, 0.0, 1.0, 100)[0] == 0.0


def test_nothing_to_search_is_no_error() -> None:
    low, high = halved_all(lambda x: x < 0.0, np.zeros(0), np.zeros(0), 60)
    assert low.shape == high.shape == (0,)


MONEY = [pair for pair in quantities.FACTORS if pair[1].startswith("EUR") or pair[0].startswith("EUR")]


def test_prices_are_converted_and_back() -> None:
    """pint knows no money."""
    assert converted(0.3, "EUR/kg", "EUR/t") == pytest.approx(300.0)
    assert converted(30.0, "ct/kWh", "EUR/kWh") == pytest.approx(0.3)
    assert [pair for pair in MONEY if converted(converted(7.0, *pair), *pair[::-1]) != pytest.approx(7.0)] == []


@pytest.mark.parametrize("pair", [pair for pair in quantities.FACTORS if pair not in MONEY], ids=" in ".join)
def test_factors_are_pints_to_the_last_bit(pair: tuple[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    values = [1.0, 60.0, 1e-9, *np.random.default_rng(3).uniform(-1e3, 1e3, 200)]
    known = [converted(value, *pair) for value in values]
    monkeypatch.setattr(quantities, "FACTORS", {})
    assert [converted(value, *pair) for value in values] == known


def test_two_threads_may_ask_for_the_first_unit_at_once() -> None:
    code = (
        "import sys, concurrent.futures as f; sys.setswitchinterval(1e-6)\n"
        "from wakeflow.core.quantities import converted\n"
        "with f.ThreadPoolExecutor(4) as pool:\n"
        "    print({round(x) for x in pool.map(lambda _: converted(1.0, 'kg/s', 'kg/h'), range(4))})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "{3600}"


@pytest.mark.parametrize(
    ("text", "unit", "meant"),
    [
        ("1,5 m/s", "m/s", [1.5]), ("1,500 mm", "m", [1.5e-3, 1.5]), ("1.500,5 mm", "m", [1.5005]),
        ("1,234.5 mm", "m", [1.2345]), ("1 500 mm", "m", [1.5]), ("12,5 %", "1", [0.125]), ("1 1/2 in", "m", []),
        ("1,5", "m", []), ("1.2.3,4 mm", "m", [0.1234]),
    ],
)  # fmt: skip
def test_every_cure_that_a_message_names_is_taken(text: str, unit: str, meant: list[float]) -> None:
    with pytest.raises(ValueError, match=r"without a mark: ") as caught:
        quantity(text, unit, f"1 {unit}")
    said = str(caught.value)
    cures = re.findall("'([^']+)'", said.partition("without a mark: ")[2].partition("needs")[0])
    assert [quantity(cure, unit, f"1 {unit}") for cure in cures] == pytest.approx(meant)
