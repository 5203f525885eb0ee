"""Arrays that say more than numbers: taken as they are meant, or refused, by every public call alike."""

import copy
import pickle
from collections.abc import Callable
from datetime import date, timedelta
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
import pint
import pytest

import wakeflow as wf
from wakeflow.core.arrays import as_written, number, numbers, truths, whole
from wakeflow.scene.measured import trays_of_columns

units = pint.application_registry
MASKED = np.ma.array([1.0, 1e20], mask=[False, True])
MEANT: dict[str, tuple[Any, str, Any]] = {
    "single precision": (np.array([1, 2], dtype=np.float32), "m", [1, 2]),
    "big-endian": (np.array([1, 2], dtype=">f8"), "m", [1, 2]),
    "integers": (np.array([1, 2], dtype=np.uint8), "m", [1, 2]),
    "nothing masked": (np.ma.array([1.0, 2.0], mask=[False, False]), "m", [1, 2]),
    "a quantity": ([1, 2] * units.mm, "m", [1e-3, 2e-3]),
    "quantities in a list": ([1 * units.mm, 2 * units.m], "m", [1e-3, 2.0]),
    "a composed unit": ([3.6] * units.Unit("km/hour"), "m/s", [1.0]),
    "a bare quantity": (units.Quantity(0.5), "1", 0.5),
    "percent": (units.Quantity(50, "percent"), "1", 0.5),
    "durations": (np.array([0, 1000], dtype="timedelta64[ms]"), "s", [0, 1]),
    "a duration": (timedelta(milliseconds=20), "s", 0.02),
    "durations in a list": ([timedelta(0), np.timedelta64(20, "ms")], "s", [0, 0.02]),
    "a frame's durations": (pd.Series(pd.to_timedelta([0, 1], unit="min")), "s", [0, 60]),
    "a frame's duration": (pd.Timedelta("20 ms"), "s", 0.02),
    "texts with units": (["1 mm", "2 mm"], "m", [1e-3, 2e-3]),
    "decimals": ([Decimal("0.1"), 2], "m", [0.1, 2]),
    "a frame's column": (pd.Series([1, 2], dtype="Int64"), "m", [1, 2]),
    "nothing known": ([1.0, None], "m", [1, np.nan]),
    "nothing known, in a frame": (pd.array([1, None], dtype="Int64"), "m", [1, np.nan]),
}
REFUSED: dict[str, tuple[Any, str]] = {
    "masked": (MASKED, "1 of 2 values are masked"),
    "masked, in a list": ([1.0, np.ma.masked], "are masked"),
    "a masked quantity": (units.Quantity(MASKED, "m"), "are masked"),
    "another kind": ([1, 2] * units.kg, "'kilogram' is not a unit like 'm'"),
    "durations": (np.array([0, 1000], dtype="timedelta64[ms]"), "is not a unit like 'm'"),
    "durations of no unit": (np.array([0, 1], dtype="timedelta64"), "real ones"),
    "dates": (np.array(["2026-01-01"], dtype="datetime64[D]"), "dates are no numbers"),
    "a date": (date(2026, 1, 1), "dates are no numbers"),
    "truth": ([True, False], "real ones"),
    "complex": (np.array([1 + 2j]), "real ones"),
    "text": (["1.5"], "needs a number in m or"),
    "ragged": ([[1.0], [1.0, 2.0]], "not an array of numbers"),
    "an object": (object(), "not an array of numbers"),
}


@pytest.mark.parametrize("kind", MEANT)
def test_what_an_array_says_of_itself_is_taken(kind: str) -> None:
    values, unit, right = MEANT[kind]
    found = numbers("x", values, unit)
    assert found.dtype == np.float64
    assert found.dtype.isnative
    assert found.flags.c_contiguous
    np.testing.assert_allclose(found, right, rtol=1e-14, atol=0)
    assert not np.shares_memory(found, np.asarray(getattr(values, "magnitude", 0.0)))


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_meant_is_refused_by_name(kind: str) -> None:
    values, said = REFUSED[kind]
    with pytest.raises(wf.SceneError, match=rf"^x: .*{said}"):
        numbers("x", values, "m")


def test_one_number_whole_numbers_and_truths() -> None:
    assert number("x", units.Quantity(2, "ms"), "s") == 0.002
    assert whole("x", np.array([1, 2], dtype=">i4")).tolist() == [1, 2]
    for call in (lambda: number("x", [1.0]), lambda: number("x", None), lambda: whole("x", [0.5])):
        with pytest.raises(wf.SceneError, match=r"^x"):
            call()
    with pytest.raises(wf.SceneError, match=r"^x: 1 of 2 values are masked"):
        truths("x", np.ma.array([True, False], mask=[False, True]))


def test_a_scene_takes_quantities_as_they_are_written() -> None:
    written = [as_written(one) for one in (40 * units.um, [1, 2] * units.mm, timedelta(seconds=2), np.float32(0.5))]
    assert written == ["40.0 micrometer", ["1.0 millimeter", "2.0 millimeter"], "2.0 s", 0.5]


SQUARE = np.array([(0.0, 0.0), (1, 0), (1, 1), (0, 1)])
TRIANGLES = [[0, 1, 2], [0, 2, 3]]
AIR = wf.FlowField.from_arrays(SQUARE, TRIANGLES, np.ones((4, 2)), np.ones(4))
GRAIN = {"position": [[0.5, 0.5]], "velocity": [[0.0, 0.0]], "diameter": 1e-3, "density": 1000.0}
CALLS: dict[str, Callable[[Any], object]] = {
    "points": lambda bad: wf.FlowField.from_arrays(bad, TRIANGLES, np.ones((4, 2))),
    "triangles": lambda bad: wf.FlowField.from_arrays(SQUARE, bad, np.ones((4, 2))),
    "velocity": lambda bad: wf.FlowField.from_arrays(SQUARE, TRIANGLES, bad),
    "pressure": lambda bad: wf.FlowField.from_arrays(SQUARE, TRIANGLES, np.ones((4, 2)), bad),
    "times": lambda bad: wf.FlowField.from_arrays(SQUARE, TRIANGLES, np.ones((2, 4, 2)), times=bad),
    "field density": lambda bad: wf.FlowField.from_arrays(SQUARE, TRIANGLES, np.ones((4, 2)), density=bad),
    "place": lambda bad: AIR.sample(bad),
    "instant": lambda bad: AIR.sample(SQUARE, bad),
    **{name: lambda bad, name=name: wf.Granules(**(GRAIN | {name: bad})) for name in (*GRAIN, "fraction", "flake")},
    "changed granules": lambda bad: wf.Granules(**GRAIN).replace(spin=bad),
    "outline": lambda bad: wf.Body(bad),
    "amplitude": lambda bad: wf.Motion(bad, 30.0),
    "frequency": lambda bad: wf.Motion((0.0, 1e-3), bad),
    "samples": lambda bad: wf.Motion.sampled(bad, bad),
    "collisions": lambda bad: wf.Collisions(depth=bad),
    "until": lambda bad: wf.track(AIR, wf.Granules(**GRAIN), until=bad),
    "gravity": lambda bad: wf.track(AIR, wf.Granules(**GRAIN), until=1.0, gravity=bad),
    "line": lambda bad: wf.track(AIR, wf.Granules(**GRAIN), until=1.0, lines=[bad]),
    "workers": lambda bad: wf.track(AIR, wf.Granules(**GRAIN), until=1.0, workers=bad),
    "impact": lambda bad: wf.impact(bad, 1.0, 0.0, 0.5, 0.3),
    "layer": lambda bad: wf.layer(0.5, 1.0, 0.0, bad, 1.0, 0.5, 0.3),
    "layers": lambda bad: wf.layers(0.5, 1.0, 0.0, [1.0, 2.0], bad, 1.0, [0.5, 0.5], [0.3, 0.3]),
    "restitution": lambda bad: wf.Restitution("table", speeds=bad, values=[0.5, 0.4]),
}  # fmt: skip


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("bad", [MASKED, np.array(["2026-01-01"], dtype="datetime64[D]"), [1, 2] * units.kelvin])
def test_every_public_call_refuses_alike(call: str, bad: Any) -> None:
    with pytest.raises(wf.WakeflowError):
        CALLS[call](bad)


def test_quantities_are_taken_by_the_tracker_and_the_field() -> None:
    grain = wf.Granules(**(GRAIN | {"diameter": units.Quantity(1, "mm"), "position": [[500.0, 500.0]] * units.mm}))
    assert (grain.diameter[0], grain.position.tolist()) == (1e-3, [[0.5, 0.5]])
    flown = [wf.track(None, wf.Granules(**GRAIN), until=until) for until in (0.02, timedelta(milliseconds=20))]
    assert flown[0].position.tolist() == flown[1].position.tolist()
    assert AIR.sample([[50.0, 50.0]] * units.cm)[0].tolist() == [[1.0, 1.0]]


def test_a_field_can_be_pickled_and_copied_after_use() -> None:
    field = wf.FlowField.from_arrays(SQUARE - 0.5, TRIANGLES, np.ones((4, 2)), np.ones(4))
    wf.track(field.image, wf.Granules(**GRAIN), until=0.01)
    for other in (pickle.loads(pickle.dumps(field.image)), copy.deepcopy(field.image)):
        np.testing.assert_array_equal(other.velocity, field.image.velocity)
        assert other.sample([[0.0, 0.1]])[0].tolist() == field.image.sample([[0.0, 0.1]])[0].tolist()


def test_a_result_can_be_pickled_and_copied_after_use(small_run: wf.Result) -> None:
    assert len(small_run.frame())
    assert small_run.joint is not None
    other = pickle.loads(pickle.dumps(small_run))
    assert other.to_json() == small_run.to_json() == copy.deepcopy(small_run).to_json()


def test_a_tray_that_was_not_weighed_is_refused() -> None:
    trays = {"fraction": ["chaff"] * 2, "bin": ["a", "b"], "mass": np.ma.array([40, 9999], mask=[0, 1])}
    with pytest.raises(wf.SceneError, match="measured: column mass: 1 of 2 values are masked"):
        trays_of_columns(trays | {"uncertainty": [1, 1]})
