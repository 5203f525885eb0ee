"""Draws of numbers that belong together: their correlation, their orders, and what stays as it was."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import ALONE, shipped
from wakeflow.core.errors import SceneError
from wakeflow.flight.stages.input_samples import DrawStage, Ensemble, Joined
from wakeflow.flight.stages.pipeline import InputRerun, Pipeline
from wakeflow.laws.size import normal_points
from wakeflow.planning.plan import INPUT_SAMPLES, SAME_AIR
from wakeflow.planning.unknowns import FARTHEST, Dependence, dependence, unknowns
from wakeflow.runs.planned import make_plan

HARD, SOFT = "fraction.hard.restitution", "fraction.soft.restitution"
WHEAT, CHAFF, AIR = "fraction.wheat.restitution", "fraction.chaff.restitution", "air.speed"
FEW = {"feed.count": 64}
DUST = "fraction.dust.restitution"
GRANULES = {"rhombus": ("dust", "chaff", "wheat"), "vacuum": ("hard", "soft")}


def _tied(correlation: float, *inputs: str) -> dict[str, Any]:
    return {"inputs": list(inputs), "correlation": correlation}


def _apart(name: str, coefficient: str) -> dict[str, Any]:
    """A coefficient of all fractions of a shipped scene said to have nothing in common."""
    return _tied(0.0, *(f"fraction.{one}.{coefficient}" for one in GRANULES[name]))


def _dependence(scene: wf.Scene) -> Dependence:
    plan = make_plan(scene, force=ALONE)
    return dependence(scene, plan, unknowns(scene, plan))


def _columns(found: Dependence, *keys: str) -> list[int]:
    known = [one.key for one in found.unknowns]
    return [known.index(key) for key in keys]


def _stage(scene: wf.Scene, joined: Joined = Dependence.joined) -> DrawStage:
    return InputRerun(joined=joined).stage(Pipeline(scene, make_plan(scene)))


def _untied_design(stage: DrawStage, shared: Sequence[bool]) -> np.ndarray:
    """Of independent numbers: one Sobol set of granules and feed, and one of the air, each for several draws."""
    air, seed = np.array(shared), stage.scene.feed.seed
    z = np.zeros((INPUT_SAMPLES, len(air)))
    z[:, ~air] = normal_points(int((~air).sum()), INPUT_SAMPLES, seed, 0)
    z[:, air] = np.repeat(normal_points(int(air.sum()), INPUT_SAMPLES // SAME_AIR, seed, 1), SAME_AIR, axis=0)
    return z


def test_draws_are_correlated_as_the_scene_says() -> None:
    ties = [_tied(0.8, WHEAT, CHAFF), _tied(-0.4, WHEAT, "fraction.wheat.moisture"), _tied(0.3, CHAFF, AIR)]
    found = _dependence(shipped("rhombus", {"uncertainty.together": ties}))
    z = found.joined(np.random.default_rng(1).normal(size=(200_000, len(found.unknowns))))
    np.testing.assert_allclose(np.corrcoef(z, rowvar=False), found.correlation, atol=0.01)
    np.testing.assert_allclose(z.std(axis=0), 1.0, atol=0.01)
    wheat, chaff, water, air = _columns(found, WHEAT, CHAFF, "fraction.wheat.moisture", AIR)
    assert found.correlation[wheat, [chaff, water]].tolist() == [0.8, -0.4]
    assert found.correlation[chaff, air] == 0.3


def test_numbers_that_are_exact_or_do_not_act_move_with_nothing() -> None:
    ties = [_tied(0.8, HARD, SOFT), _tied(0.5, HARD, AIR)]
    changes = {
        "uncertainty.together": ties,
        f"uncertainty.{SOFT}": 0,
        "uncertainty.fraction.soft.friction": 0,
        "uncertainty.never_above": [[HARD, "wake.theta"]],
    }
    found = _dependence(shipped("vacuum", changes))
    np.testing.assert_array_equal(found.correlation, np.eye(len(found.unknowns)))
    assert found.orders == ()


def test_fractions_share_the_plate_and_the_lot() -> None:
    """One plate moves the restitutions and frictions of all, by its part of each interval; one lot all that is its
    material's.
    """
    found = _dependence(shipped("rhombus", {"fraction.dust.material": "chaff"}))
    wheat, chaff, dust = _columns(found, WHEAT, CHAFF, DUST)
    halves = [found.unknowns[i].high for i in (wheat, chaff)]
    assert found.correlation[wheat, chaff] == pytest.approx(0.05**2 / (halves[0] * halves[1]))
    slides = _columns(found, "fraction.wheat.friction", "fraction.chaff.friction")
    ranges = [0.14 * found.unknowns[i].value / found.unknowns[i].high for i in slides]
    assert found.correlation[slides[0], slides[1]] == pytest.approx(ranges[0] * ranges[1])
    assert found.correlation[chaff, dust] == pytest.approx(0.95)
    settle = _columns(found, "fraction.chaff.terminal_velocity", "fraction.dust.terminal_velocity")
    assert found.correlation[settle[0], settle[1]] == pytest.approx(0.95)
    assert found.correlation[_columns(found, "fraction.wheat.terminal_velocity")[0], settle[0]] == 0.0
    z = found.joined(np.random.default_rng(3).normal(size=(100_000, len(found.unknowns))))
    np.testing.assert_allclose(np.corrcoef(z, rowvar=False), found.correlation, atol=0.015)


def test_a_material_whose_number_is_as_wheats_shares_that() -> None:
    """Triticale's restitution is wheat's, to 0.1, and by how much it is off that: 0.15 in all; plate by plate, and two
    thirds of the lot's.
    """
    found = _dependence(shipped("rhombus", {"fraction.dust.material": "triticale"}))
    wheat, dust = _columns(found, WHEAT, DUST)
    assert [found.unknowns[i].high for i in (wheat, dust)] == pytest.approx([0.1, 0.15])
    plates, lots = 0.5 * 0.05 / 0.15, np.sqrt((0.95 - 0.5**2) * (0.95 - (0.05 / 0.15) ** 2)) * 0.1 / 0.15
    assert found.correlation[wheat, dust] == pytest.approx(plates + lots)


@pytest.mark.parametrize(
    ("changes", "apart"),
    [
        ({"uncertainty.together": [_tied(-0.5, WHEAT, CHAFF)]}, {WHEAT, CHAFF}),
        ({f"uncertainty.{WHEAT}": 0.1}, {WHEAT}),
        ({WHEAT: 0.5, "fraction.dust.material": "wheat"}, set()),
    ],
)
def test_what_the_scene_says_of_a_number_goes_before_what_it_shares(changes: dict[str, Any], apart: set[str]) -> None:
    """A tie and an uncertainty of its own take a number out; a value of its own out of the lot, not off the plate."""
    found = _dependence(shipped("rhombus", changes))
    places = dict(zip((WHEAT, CHAFF, DUST), _columns(found, WHEAT, CHAFF, DUST), strict=True))
    for one in (WHEAT, CHAFF):
        assert (found.correlation[places[one], places[DUST]] == 0.0) == (one in apart)
        assert found.correlation[places[one], places[DUST]] < 0.3


def test_a_material_says_itself_how_well_its_number_is_known() -> None:
    """In proportion to the number, which the scene's air or a size of its own may have changed."""
    scene = shipped("rhombus", {"fraction.chaff.material": "plumed-seeds", "fraction.dust.material": "plumed-seeds"})
    found = {one.key: one for one in _dependence(scene).unknowns}
    for one in (found[f"fraction.{name}.terminal_velocity"] for name in ("chaff", "dust")):
        assert one.high / one.value == pytest.approx(0.5 / 0.65)


def test_without_ties_the_draws_are_those_of_independent_numbers_bit_for_bit() -> None:
    for name in ("vacuum", "rhombus"):
        ties = [_apart(name, coefficient) for coefficient in ("restitution", "friction")]
        stage = _stage(shipped(name, {**FEW, "uncertainty.together": ties}))
        found = _dependence(stage.scene)
        xi = np.random.default_rng(2).normal(size=(8, len(found.unknowns)))
        assert found.joined(xi) is xi
        assert found.kept(xi).all()
        np.testing.assert_array_equal(stage.design, _untied_design(stage, found.of_air))


def test_flown_draws_that_are_tied_still_share_their_air() -> None:
    """Numbers that move with nothing are drawn as before."""
    ties = [_tied(0.8, WHEAT, AIR), _tied(0.4, AIR, "dispersion"), _apart("rhombus", "restitution")]
    scene = shipped("rhombus", {**FEW, "uncertainty.together": [*ties, _apart("rhombus", "friction")]})
    stage, found = _stage(scene), _dependence(scene)
    air = stage.design[:, found.of_air].reshape(-1, SAME_AIR, int(found.of_air.sum()))
    np.testing.assert_allclose(air[:, 0], air[:, 1], rtol=0, atol=1e-12)
    wheat, speed, eddies = _columns(found, WHEAT, AIR, "dispersion")
    assert np.corrcoef(stage.design[:, [wheat, speed]], rowvar=False)[0, 1] == pytest.approx(0.8, abs=0.08)
    assert np.corrcoef(stage.design[:, [speed, eddies]], rowvar=False)[0, 1] == pytest.approx(0.4, abs=0.15)
    others = np.delete(np.arange(len(found.unknowns)), [wheat, speed, eddies])
    before = _untied_design(stage, found.of_air)
    np.testing.assert_allclose(stage.design[:, others], before[:, others], rtol=0, atol=1e-12)


@pytest.mark.parametrize("ensemble", [False, True])
def test_flown_draws_keep_to_their_orders(ensemble: bool) -> None:
    """Both are 0.5 at first: every second draw breaks the order."""
    order = {
        "uncertainty.never_above": [[CHAFF, WHEAT], ["wake.theta", "wake.strength"]],
        "uncertainty.together": [_apart("rhombus", "restitution")],
    }
    scene = shipped("rhombus", {**FEW, WHEAT: 0.5, CHAFF: 0.5, **order})
    found = _dependence(scene)
    near = Ensemble(np.full(len(found.unknowns), 0.1), 0.25 * np.eye(len(found.unknowns)))
    some = near.joined if ensemble else Dependence.joined
    stage = _stage(scene, some)
    assert stage.design.shape == (INPUT_SAMPLES, len(found.unknowns))
    assert found.kept(stage.design).all()
    np.testing.assert_array_equal(stage.design, _stage(scene, some).design)
    chaff, wheat = _columns(found, CHAFF, WHEAT)
    if not ensemble:  # as two independent normal numbers of which the one happens to be larger
        middle, spread = 0.5642, 0.4669  # 1 / sqrt(pi), and the correlation (1 - v) / (1 + v) with v = 1 - 2 / pi
        pair = stage.design[:, [chaff, wheat]]
        assert found.unknowns[chaff].high == found.unknowns[wheat].high
        np.testing.assert_allclose(pair.mean(axis=0), [-middle, middle], atol=0.15)
        assert np.corrcoef(pair, rowvar=False)[0, 1] == pytest.approx(spread, abs=0.2)
    assert len(np.unique(stage.design[:, found.of_air], axis=0)) == INPUT_SAMPLES // SAME_AIR
    free = scene.replace({"uncertainty.never_above": []})
    assert 0.3 < _dependence(scene).kept(_stage(free, some).design).mean() < 0.7


def test_a_number_that_is_exact_is_a_limit() -> None:
    order = {"uncertainty.never_above": [[SOFT, HARD]], f"uncertainty.{HARD}": 0}
    found = _dependence(shipped("vacuum", order))
    assert HARD not in [one.key for one in found.unknowns]
    z = np.zeros((3, len(found.unknowns)))
    z[:, _columns(found, SOFT)[0]] = [-FARTHEST, 0.0, 1e9]
    soft = found.unknowns[_columns(found, SOFT)[0]]
    hard = shipped("vacuum").fraction["hard"].properties.restitution
    assert found.kept(z).tolist() == [True, True, soft.at(FARTHEST) <= hard]
    assert soft.all_at(z[:, 0]).shape == (3,)


def test_an_order_that_the_scene_s_own_numbers_break_is_one_line_of_the_plan() -> None:
    scene = shipped("rhombus", {"uncertainty.never_above": [[WHEAT, CHAFF]]})
    words = r"never_above: fraction.wheat.restitution = 0.5 is above fraction.chaff.restitution = 0.2; change one"
    with pytest.raises(SceneError, match=words):
        make_plan(scene)


def test_orders_that_hardly_any_draw_keeps_are_one_line() -> None:
    scene = shipped("vacuum", {**FEW, "uncertainty.never_above": [[SOFT, HARD]]})
    count = len(unknowns(scene, make_plan(scene)))
    away = np.zeros(count)
    place = [one.key for one in unknowns(scene, make_plan(scene))].index(HARD)
    away[place] = -1e9
    with pytest.raises(SceneError, match="hardly any draw keeps to these orders"):
        _ = _stage(scene.replace({SOFT: 0.5, HARD: 0.5}), Ensemble(away, 1e-9 * np.eye(count)).joined).design
