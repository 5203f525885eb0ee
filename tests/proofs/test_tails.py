"""On which side intervals miss the truth: the closed form against the program, and the counting."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from proofs.coverage import tails
from proofs.coverage.closed_form import (
    AIR_DENSITY,
    AIR_VISCOSITY,
    GRAVITY,
    MEAN_FREE_PATH,
    Curtain,
    Granule,
    Slope,
    landed_on_floor,
    shares,
)
from proofs.coverage.tails import ONCE, Tail, apart, gates, nominal, quantities, row_of, run_tails, tail_of, truths_of
from proofs.coverage.thresholds import KINDS, threshold_scenes
from wakeflow.laws import constants, drag
from wakeflow.laws.collision import impact


def test_constants_are_those_of_the_program() -> None:
    assert (AIR_DENSITY, AIR_VISCOSITY) == constants.STANDARD_AIR
    assert (GRAVITY, MEAN_FREE_PATH) == (constants.GRAVITY, drag.MEAN_FREE_PATH)


@pytest.mark.parametrize(("restitution", "friction"), [(0.0, 0.3), (0.0, 0.0), (0.2, 0.0), (0.5, 0.0)])
def test_a_granule_slides_off_with_what_friction_leaves_it(restitution: float, friction: float) -> None:
    """Without friction bounces that die away change nothing of the motion along the face."""
    slope = Slope("prism", 4.0, math.pi / 4, -5.0)
    (x,) = landed_on_floor(slope, Curtain(1e-6, 0.1, 0.02), Granule(restitution, friction, 1e-9), 1)
    start = math.sqrt(2.0 * GRAVITY * 0.12) * math.cos(slope.angle) * (1.0 - friction)
    pull = GRAVITY * math.sin(slope.angle) * (1.0 - friction)
    speed = math.sqrt(start**2 + 2.0 * pull * (slope.length - 0.1 / math.cos(slope.angle)))
    fall = speed * math.sin(slope.angle)
    time = (math.sqrt(fall**2 + 2.0 * GRAVITY * (5.0 - 2.0 / 3.0)) - fall) / GRAVITY
    assert x == pytest.approx(2.0 + speed * math.cos(slope.angle) * time, rel=1e-6)


def test_one_blow_is_that_of_the_paper() -> None:
    """Where a granule leaves the face at once, by the program's eq. (1)-(2), in which the tests of laws trust."""
    slope, curtain = Slope("rhombus", 0.05, math.pi / 4, -0.1), Curtain(1e-6, 0.024, 0.1)
    (x,) = landed_on_floor(slope, curtain, Granule(0.5, 0.3, 1e-9), 1)
    vx, vy = impact(slope.angle, math.sqrt(2.0 * 9.81 * 0.124), 0.0, 0.5, 0.3).velocity
    assert x == pytest.approx(0.024 + vx * (vy + math.sqrt(vy**2 + 2.0 * 9.81 * 0.101)) / 9.81, rel=1e-6)


def test_shares_of_spread_granules_are_parts_of_the_curtain() -> None:
    found = shares((np.array([0.0, 0.1]), 0.1), {"a": (-0.2, 0.0), "b": (0.0, 0.1)})
    assert found == pytest.approx({"a": 0.25, "b": 0.5, "elsewhere": 0.25})


def test_purities_of_empty_bins_are_none() -> None:
    found = quantities({"a": {"x": 1.0, "y": 0.0}, "b": {"x": 0.5, "y": 0.0}}, {"a": 0.2, "b": 0.8}, {"a": ["x", "y"]})
    assert found["recovery.a"] == 1.0
    assert found["purity.x.a"] == pytest.approx(1.0 / 3.0)
    assert math.isnan(found["purity.y.a"])


def test_scenes_are_the_same_whatever_their_number_and_of_every_kind() -> None:
    found = list(threshold_scenes(12))
    assert [one.tables for one in found[:3]] == [one.tables for one in threshold_scenes(3)]
    assert [one.name.split(" ", 1)[1] for one in found[: len(KINDS)]] == list(KINDS)
    assert all(set(one.scene.uncertainty) >= set(one.inputs) for one in found)


def test_both_sides_are_counted_of_what_truths_can_miss() -> None:
    truths = np.linspace(0.1, 0.9, 1001)
    found = tail_of("shares", "one", "share.a.b", (0.5, 0.14, 0.88), truths)
    assert found is not None
    assert (found.below, found.above) == (pytest.approx(0.05, abs=2e-3), pytest.approx(0.025, abs=2e-3))
    assert (found.can_below, found.can_above) == (True, True)
    assert found.width == pytest.approx(0.74 / 0.76, rel=1e-3)
    stick = np.maximum(truths - 0.5, 0.0)  # half of all draws give nothing: none can lie below
    begins = tail_of("shares", "two", "share.a.b", (0.0, 0.0, 0.3), stick)
    assert begins is not None
    assert (begins.can_below, begins.can_above, begins.below) == (False, True, 0.0)
    row = row_of("shares", [found, begins])
    assert row is not None
    assert row["below"] == found.below
    assert row["above"] == pytest.approx(0.5 * (found.above + begins.above))
    assert row["worst_above"].endswith("(two share.a.b)")


def test_what_is_next_to_nothing_is_trivial() -> None:
    nothing = np.zeros(100)
    assert tail_of("shares", "one", "share.a.b", (0.0, 0.0, 0.1), nothing) is None
    assert tail_of("shares", "one", "share.a.b", (1.0, 0.9, 1.0), 1.0 - nothing) is None
    assert tail_of("differences", "one", "share.a.b", (1.0, 0.9, 1.0), 1.0 - nothing, whole=False) is not None
    assert tail_of("shares", "one", "share.a.b", (0.1, 0.0, 0.2), nothing) is not None


@pytest.mark.parametrize(
    ("kind", "scenes", "below", "above", "width", "missed"),
    [
        ("shares", tails.SCENES, 0.02, 0.03, 1.1, set()),
        ("shares", tails.SCENES, 0.0, 0.05, 1.2, {"truths below", "truths above", "width over the sharpest"}),
        ("shares", 4, 0.0, 0.05, 1.1, set()),
        (ONCE, tails.SCENES, 0.0, 0.05, 1.1, set()),
    ],
)
def test_gates(kind: str, scenes: int, below: float, above: float, width: float, missed: set[str]) -> None:
    row = row_of(kind, [Tail(kind, "one", "share.a.b", 500, below, above, True, True, width)])
    assert row is not None
    agreed = [{"scene": "one", "difference": 0.001, "chance": 0.01}] * scenes
    found = gates([row], agreed)
    assert {gate["what"].removeprefix(f"{kind}: ") for gate in found if not gate["met"]} == missed
    assert not gates([row], [*agreed, {"scene": "two", "difference": 0.02, "chance": 0.01}])[-1]["met"]


@pytest.mark.parametrize("number", [0, 5])
def test_closed_form_and_program_agree(number: int, tmp_path: Path) -> None:
    """Of a rhombus, and of air that moves; and the program draws the same inputs, as far as they are stated."""
    one = list(threshold_scenes(number + 1))[number]
    result = tails.asked(one, tmp_path / "own")
    difference, chance = nominal(one, result)
    assert difference < min(chance, 5e-3)
    drawn = one.drawn(np.random.default_rng(3))
    varied = wf.run(one.scene_at(drawn), tmp_path / "drawn", rung=one.rung, report=False)
    difference, chance = apart(one, varied, drawn)
    assert difference < max(chance, 2e-3)
    assert result.landings is not None
    assert set(result.landings.inputs or {}) == set(one.inputs)
    for key, (value, half) in one.inputs.items():
        drawn = (result.landings.inputs or {})[key]
        assert (drawn.low, drawn.high) == pytest.approx((value - half, value + half), rel=1e-9)


def test_trays_make_the_truth_that_they_are_of_likely() -> None:
    one = next(threshold_scenes(1))
    truths = truths_of(one, 200, 256)
    trays, weights = tails._measured(truths, 3, np.random.default_rng(1))
    assert len(set(zip(trays["fraction"], trays["bin"], strict=True))) == len(trays["share"]) <= tails.TRAYS
    assert weights[3] > np.quantile(weights, 0.9)
    narrow = tails._once(ONCE, one, "share.a.b", (0.5, 0.0, 1.0), np.arange(200.0) / 200.0, 3, np.ones(200))
    assert narrow.width == pytest.approx(1.0 / 0.95, rel=0.02)
    assert (narrow.below, narrow.above, narrow.truths) == (0.0, 0.0, 1)
    few = tails._once(ONCE, one, "share.a.b", (0.5, 0.2, 1.0), np.arange(200.0) / 200.0, 3, np.eye(200)[3])
    assert (few.width, few.below) == (None, 1.0)


def test_a_scene_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bins that are moved are read by the same names: here of a run that has them."""

    def moved(self: wf.Result, changes: Mapping[str, float]) -> wf.Result:
        scene = wf.Scene.parse(self.scene).replace(dict(changes))
        return wf.run(scene, tmp_path / "moved", rung="none", report=False)

    monkeypatch.setattr(wf.Result, "moved", moved, raising=False)
    found = run_tails(scenes=1, truths=60, posteriors=0)
    kinds = {row["label"]: row for row in found.facts["kinds"]}
    assert {"shares", "recoveries", "purities", "differences", "moved"} < set(kinds)
    assert kinds["shares"]["truths"] == 60 * kinds["shares"]["numbers"]
    assert kinds["moved"]["numbers"] > kinds["shares"]["numbers"]  # recoveries and purities too
    assert kinds["moved"]["width"] < 2.0
    assert sum(row["numbers"] == 0 for row in kinds.values()) == 4  # no posteriors were asked for
    assert found.facts["gates"][-1]["met"]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_intervals_miss_the_truth_on_both_sides_alike() -> None:
    assert run_tails(slow=True).missed == []
