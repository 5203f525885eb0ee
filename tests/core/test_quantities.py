"""Numbers with a unit: what is read means what it says, what may mean two things is refused, the unit comes back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
