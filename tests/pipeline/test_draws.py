"""Draws of what is unknown: the same granules under other numbers, and what a regression on them says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.field.varied import varied
from wakeflow.laws.restitution import Restitution
from wakeflow.pipeline.draws import DrawStage
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import DRAWS, SAME_AIR
from wakeflow.planning.unknowns import FARTHEST, SIGMAS, unknown_kinds

EXACT = ("restitution", "friction", "size")


@pytest.fixture(scope="module")
def vacuum() -> wf.Scene:
    return wf.Scene.load(Path(__file__).parents[2] / "cases" / "vacuum.toml", {"feed.count": 1024})


def _pipeline(scene: wf.Scene) -> Pipeline:
    return Pipeline(scene, make_plan(scene))


def _only(scene: wf.Scene, key: str, half: float) -> wf.Scene:
    """The scene of which nothing but the number at ``key`` is unknown."""
    exact = {f"uncertainty.fraction.{name}.{number}": 0 for name in scene.fraction for number in EXACT}
    known = {**exact, "uncertainty.feed.width": 0, "uncertainty.feed.position": 0}
    return scene.replace({**known, f"uncertainty.{key}": half})


def test_nothing_is_flown_where_all_is_known(vacuum: wf.Scene) -> None:
    assert _pipeline(_only(vacuum, "feed.width", 0.0)).draws() is None


def test_the_range_is_that_of_the_scene_at_the_ends_of_the_interval(vacuum: wf.Scene) -> None:
    """One unknown: the regression's range is what whole runs at the ends of its interval give."""
    half = 0.04
    scene = _only(vacuum, "fraction.hard.restitution", half)
    draws = _pipeline(scene).draws()
    assert draws is not None
    assert [one.key for one in draws.unknowns] == ["fraction.hard.restitution"]
    varied_hits, own = draws.hits("hard", [0])
    moved = (varied_hits - own).mean(axis=1)
    slope = float(np.polyfit(draws.z[:, 0], moved, 1)[0]) * SIGMAS
    ends = []
    for sign in (-1.0, 1.0):
        own_value = vacuum.fraction["hard"].properties.restitution
        other = vacuum.replace({"fraction.hard.restitution": own_value + sign * half})
        ends.append(_pipeline(other).tracks().landings["hard"].counts(len(scene.bin)).mean(axis=0)[0])
    assert slope == pytest.approx(0.5 * (ends[1] - ends[0]), rel=0.2)
    assert abs(slope) > 0.02  # it matters
    soft, before = draws.hits("soft", [0])
    assert np.array_equal(soft, before)  # the other fraction flies as before


def test_draws_do_not_depend_on_the_number_of_threads(vacuum: wf.Scene) -> None:
    stages = [DrawStage(Pipeline(vacuum, make_plan(vacuum), workers=n)._track_stage) for n in (1, 2)]
    one, two = (stage.design for stage in stages)
    assert np.array_equal(one, two)


def test_the_air_has_fewer_draws_and_all_are_standard_normal() -> None:
    from support import shipped

    scene = shipped("rhombus", {"feed.count": 64})
    stage = DrawStage(Pipeline(scene, make_plan(scene))._track_stage)
    of_air = np.array([unknown_kinds[one.kind].of_air for one in stage.unknowns])
    air, rest = stage.design[:, of_air], stage.design[:, ~of_air]
    assert len(np.unique(air, axis=0)) == DRAWS // SAME_AIR
    assert len(np.unique(rest, axis=0)) == DRAWS
    np.testing.assert_allclose(stage.design.mean(axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(stage.design.std(axis=0), 1.0, atol=0.15)
    for part in (air, rest):  # by how much each slope's variance grows because the columns are not orthogonal
        assert np.linalg.inv(np.corrcoef(part, rowvar=False)).diagonal().max() < 2.0
    assert FARTHEST > 2.0


def test_a_faster_air_is_the_same_air_in_less_time() -> None:
    points = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    times, k = np.array([0.0, 0.5]), np.full((2, 4), 0.3)
    field = wf.FlowField.from_arrays(
        points, np.array([(0, 1, 2), (0, 2, 3)]), np.ones((2, 4, 2)), np.full((2, 4), 2.0), times, 1.0, k, 0.1 * k
    )
    faster = varied(field, speed=1.1)
    np.testing.assert_allclose(faster.velocity, 1.1)
    assert faster.pressure is not None
    np.testing.assert_allclose(faster.pressure, 2.0 * 1.21)
    assert faster.period == pytest.approx(1.0 / 1.1)
    assert faster.k is not None
    assert faster.dissipation is not None
    length = faster.k**1.5 / faster.dissipation
    np.testing.assert_allclose(length, 0.3**1.5 / 0.03)  # the eddies are as large
    longer = varied(field, lifetime=2.0, energy=4.0)
    assert longer.k is not None
    assert longer.dissipation is not None
    np.testing.assert_allclose(longer.k, 1.2)
    # eddies of one size turn over with k^1/2, and each lasts twice as long
    np.testing.assert_allclose(longer.k / longer.dissipation, 2.0 * (0.3 / 0.03) / 2.0)


@pytest.mark.parametrize(
    "law",
    [
        Restitution("constant", value=0.95),
        Restitution("power", value=0.5, at=1.0),
        Restitution("table", speeds=[0.1, 1.0], values=[0.9, 0.98]),
        Restitution("viscoelastic", value=0.9, at=0.5),
    ],
)
def test_a_law_of_restitution_shifts_by_what_was_measured(law: Restitution) -> None:
    speed = np.array([0.1, 1.0])
    lower, higher = law.shifted(-0.05)(speed), law.shifted(0.2)(speed)
    assert np.all(lower < law(speed))
    assert np.all(higher <= 1.0)
    assert np.all(higher >= law(speed))
