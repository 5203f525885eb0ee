"""Whether the intervals hold the truth: the counting, airs whose answer is known, and a few scenes of every command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from proofs import commands
from proofs.coverage import report
from proofs.coverage.counted import Bounded, Counted, bounded, left_out_wakes, tally_of
from proofs.coverage.flown import predicted, with_bins
from proofs.coverage.laminar import NAMES, references
from proofs.coverage.scenes import GROUPS, VariedScene, varied_scenes
from proofs.coverage.stored_air import StoredFlow, field_of, oval, stream
from support import shipped
from wakeflow.core.geometry import area
from wakeflow.core.store import Store, cache_root
from wakeflow.scene.changes import AirVariation, Variation


def number(value: float, low: float, high: float, truth: float, scene: str = "one") -> Counted:
    return Counted(scene, "group", "share.a.b", value, low, high, truth)


def test_what_is_next_to_nothing_in_value_and_truth_is_counted_apart() -> None:
    rows = [
        number(0.5, 0.4, 0.6, 0.45),
        number(0.5, 0.4, 0.6, 0.65),
        number(0.3, 0.2, 0.4, 0.1, "two"),
        number(0.0, 0.0, 0.01, 0.0005),
        number(1.0, 0.99, 1.0, 1.0),
        number(0.0, 0.0, 0.01, 0.3),
    ]
    found = tally_of("all", rows)
    assert (found.scenes, found.many) == (2, 4)
    assert found.coverage == pytest.approx(1 / 4)
    assert found.every == pytest.approx(3 / 6)
    assert (found.above, found.below) == (pytest.approx(2 / 4), pytest.approx(1 / 4))
    assert found.half == pytest.approx(0.1)
    assert found.error == pytest.approx(0.175)
    assert tally_of("none", rows[3:5]).coverage is None


@pytest.mark.parametrize(
    ("coverage", "half", "missed"),
    [
        (0.95, 0.03, set()),
        (0.99, 0.03, {"shares held overall"}),
        (0.85, 0.03, {"shares held overall", "shares held in the worst group", "shares above their intervals"}),
        (0.95, 0.06, {f"{report.WIDTH}, without the {report.DOUBTED}"}),
    ],
)
def test_gates(coverage: float, half: float, missed: set[str]) -> None:
    many = 400
    truths = np.where(np.arange(many) < coverage * many, 0.51, 0.8)
    rows = [number(0.5, 0.5 - half, 0.5 + half, float(x)) for x in truths]
    tally = tally_of("all", rows)
    assert {gate["what"] for gate in report.gates(tally, [tally], tally, []) if not gate["met"]} == missed
    sides = {gate["what"]: gate["wanted"] for gate in report.gates(tally, [tally], tally, [])}
    assert sides["shares above their intervals"] == sides["shares below their intervals"] == "0 to 8 %"
    broken = Bounded("one", "lift", "share.a.b", 0.01, 0.02, 1e-4)
    assert not report.gates(tally, [tally], tally, [broken])[-1]["met"]
    by_chance = Bounded("one", "lift", "share.a.b", 0.01, 0.02, 0.015)
    assert (broken.tested, by_chance.tested) == (True, False)
    (row,) = report._bounds([broken, by_chance])
    assert (row["many"], row["tested"], row["untested"], row["held"]) == (2, 1, 1, 0)
    assert (
        report.gates(tally, [tally], tally, [by_chance])[-1]["found"]
        == "0 of 0 tested; 1 untested, 0 of them beyond their noise"
    )


def test_an_oval_is_a_streamline_that_no_air_crosses() -> None:
    """The corners lie on psi = 0; between the walls flows what comes in."""
    one = next(one for one in varied_scenes(len(GROUPS)) if one.group == "potential flow")
    assert one.air is not None
    scene, outline = one.scene, oval(one.air.amount, 0.4)
    assert area(outline) > 0.0
    psi = stream(one.air, scene)
    assert scene.air is not None
    np.testing.assert_allclose(psi(outline), 0.0, atol=1e-9 * scene.air.speed)
    walls = np.array([(-0.2, 0.03), (0.2, 0.03)])
    np.testing.assert_allclose(np.diff(psi(walls)), 0.4 * scene.air.speed, rtol=1e-6)
    far = field_of(one.air, scene)
    above = far.points[:, 1] > 0.149
    np.testing.assert_allclose(far.velocity[above, 1], -scene.air.speed, rtol=0.1)


@pytest.mark.parametrize("flow", ["potential", "wake", "cells"])
def test_stored_airs_keep_volume(flow: str) -> None:
    """What enters the channel at one end leaves it at the other, and is the scene's speed times its width."""
    group = {"potential": "potential flow", "wake": "made wake", "cells": "cells"}[flow]
    one = next(one for one in varied_scenes(len(GROUPS)) if one.group == group)
    field, scene = field_of(one.air or StoredFlow(flow), one.scene), one.scene
    assert scene.air is not None
    flows = []
    for level in (field.points[:, 1].min(), field.points[:, 1].max()):
        end = np.flatnonzero(np.isclose(field.points[:, 1], level, atol=1e-9))
        end = end[np.argsort(field.points[end, 0])]
        flows.append(abs(float(np.trapezoid(field.velocity[end, 1], field.points[end, 0]))))
    assert flows == pytest.approx([scene.air.speed * scene.channel.width] * 2, rel=0.01)
    assert not field.has("k")


def test_the_truth_is_that_of_the_scene_with_the_other_numbers_in_its_tables() -> None:
    """A draw of restitution, friction, size and curtain: flown as a draw, and as a scene of its own."""
    scene = shipped("vacuum", {"feed.count": 1024})
    made = Variation(feed_width=1.1, feed_shift=1e-3, air=AirVariation())
    for name in scene.fraction:
        made = made.with_granules(name, restitution=0.05, friction=0.8, size=1.05)
    other = scene.replace({"feed.width": 1.1 * scene.feed.width, "feed.position": scene.feed.position + 1e-3})
    for name, fraction in scene.fraction.items():
        own = fraction.properties
        other = other.replace({
            f"fraction.{name}.restitution": own.restitution + 0.05,
            f"fraction.{name}.friction": 0.8 * own.friction,
            f"fraction.{name}.size": 1.05 * own.diameter,
        })  # fmt: skip
    store = Store(cache_root())
    drawn, plain = (
        predicted(VariedScene(name, "vacuum", one), store) for name, one in (("drawn", scene), ("plain", other))
    )
    found, expected = drawn.truth.shares(2048, made), plain.truth.shares(2048)
    for name in scene.fraction:
        np.testing.assert_allclose(found[name], expected[name], atol=1e-3)
        assert 0.05 < found[name].max() < 0.999 or name == "soft"


def test_terms_that_are_switched_on_stay_within_their_bounds() -> None:
    one = next(one for one in varied_scenes(len(GROUPS)) if one.group == "duct")
    store = Store(cache_root())
    found = list(bounded(predicted(with_bins(one, store), store), 512))
    assert {"added-mass", "buoyancy"} & {row.term for row in found}
    assert all(row.held for row in found)


def test_the_command_counts_and_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(report, "QUICK", 3)  # the scenes in a vacuum
    monkeypatch.setattr(report, "ENSEMBLE", 8)
    monkeypatch.setattr(commands, "FOLDER", tmp_path)
    found = commands.prove("coverage", slow=False, tell=lambda _: None)
    told = json.loads((tmp_path / "coverage.json").read_text())
    assert told["scenes"] == 3
    many = sum(row["many"] for row in told["groups"])
    assert many == told["kinds"][0]["many"] >= 12
    assert told["kinds"][0]["coverage"] > 0.8
    assert [row["label"] for row in told["parts"] if row["many"]] == ["granules", "granules and steps", "inputs"]
    inputs = told["parts"][2]
    assert inputs["many"] > 8 * 9  # most of the three scenes' shares, in each of eight draws
    assert 0.85 < inputs["coverage"] <= 1.0
    commands.show(found)
    shown = capsys.readouterr().out
    assert "vacuum, rhombus" in shown
    assert "shares held overall" in shown
    assert "half / error" in shown


MISSES = {"volvo"}  # sources outside the range that all others give for them: a duct whose walls are near


def test_each_measured_wake_is_predicted_from_all_others() -> None:
    rows = left_out_wakes()
    assert {row["number"] for row in rows} == {"theta", "strength", "lift"}
    assert {row["name"] for row in rows if not row["held"]} == MISSES


def test_references_are_shares() -> None:
    known = references()
    assert set(known) <= set(NAMES)
    for row in known.values():
        for shares in row["shares"].values():
            assert sum(shares.values()) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_intervals_hold_the_truth(tmp_path: Path) -> None:
    """All gates but those that are known to fail; one that is met again fails this test as well."""
    found = report.run_coverage(slow=True).data()
    assert {gate["what"] for gate in found["gates"] if not gate["met"]} == set(report.FAILING)
