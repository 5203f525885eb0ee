"""What is not known of a scene: which numbers, how far off by default, and what a draw of them changes."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.laws.material import default_margins, materials
from wakeflow.planning.make import make_plan
from wakeflow.planning.unknowns import SIGMAS, Unknown, unknown_kinds, unknowns, variation_at

OFF = {"collisions": False, "air-loading": False}


@cache
def _shipped() -> dict[str, Unknown]:
    return _unknowns(shipped("rhombus"))


def _unknowns(scene: wf.Scene, rung: str | None = None) -> dict[str, Unknown]:
    return {one.key: one for one in unknowns(scene, make_plan(scene, rung=rung, force=OFF))}


def test_every_input_of_the_shipped_rhombus_that_can_be_off_is_drawn() -> None:
    found = _shipped()
    shared = {"feed.width", "feed.position", "air.speed", "air.turbulence", "dispersion", "wake.theta", "wake.strength"}
    assert shared <= set(found)
    wheat = {key.rpartition(".")[2] for key in found if key.startswith("fraction.wheat.")}
    assert wheat == {"restitution", "friction", "rebound_scatter", "terminal_velocity", "size", "turning"}
    assert {found[key].kind for key in found} == set(unknown_kinds)  # a kind that is registered is tested
    assert "fraction.dust.rebound_scatter" not in found  # dust has none: nothing to be off


def test_a_vacuum_has_no_unknown_air(cases: Path) -> None:
    found = _unknowns(wf.Scene.load(cases / "vacuum.toml"))
    assert not any(key.startswith(("air", "wake", "dispersion")) or "terminal" in key for key in found)


def test_the_steady_wake_has_no_theta() -> None:
    assert not any(key.startswith("wake.") for key in _unknowns(shipped("rhombus"), "draft"))


@pytest.mark.parametrize(
    ("said", "half"),
    [({"value": 0.5, "uncertainty": 0.02}, 0.02), ({"value": 0.5, "uncertainty": "10 %"}, 0.05), (0.5, 0.1)],
)
def test_the_scene_says_how_well_a_number_is_known(said: object, half: float) -> None:
    scene = shipped("rhombus", {"fraction.wheat.restitution": said})
    found = _unknowns(scene)["fraction.wheat.restitution"]
    assert (found.low, found.high, found.value) == (pytest.approx(half), pytest.approx(half), 0.5)
    assert scene.fraction["wheat"].restitution == 0.5


def test_an_interval_ends_where_the_number_cannot_go_on() -> None:
    found = _shipped()
    dust, position = found["fraction.dust.restitution"], found["feed.position"]
    assert dust.low > dust.value
    assert dust.ends == (0.0, pytest.approx(dust.value + dust.high))
    assert position.ends == (pytest.approx(-position.low), pytest.approx(position.high))
    assert found["wake.theta"].ends[1] <= 1.0
    for one in found.values():
        assert one.ends[0] <= one.value <= one.ends[1]


def test_nothing_is_drawn_of_what_is_exact() -> None:
    scene = shipped("rhombus", {"uncertainty.fraction.wheat.restitution": 0, "uncertainty.wake.theta": 0})
    found = _unknowns(scene)
    assert "fraction.wheat.restitution" not in found
    assert "wake.theta" not in found


def test_defaults_go_by_the_confidence_of_the_materials_number() -> None:
    found = _shipped()
    margin = default_margins()["restitution"]
    for name in ("wheat", "chaff"):
        confidence = materials[name].evidence["restitution"].confidence
        assert found[f"fraction.{name}.restitution"].high == margin.absolute[confidence]
    assert found["fraction.chaff.restitution"].high > found["fraction.wheat.restitution"].high


@pytest.mark.parametrize("name", list(default_margins()))
def test_a_default_has_a_source_and_grows_as_confidence_falls(name: str) -> None:
    margin = default_margins()[name]
    assert margin.source
    assert margin.status in ("read", "derived", "chosen")
    halves = [margin.half(1.0, confidence, 1.0) for confidence in ("measured", "typical", "low")]
    assert 0.0 < halves[0] <= halves[1] <= halves[2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"uncertainty.feed.widht": 0.1}, "did you mean 'feed.width'"),
        ({"uncertainty.air.speed": "-3 %"}, "needs a number in m/s"),
        ({"uncertainty.fraction.wheat.restitution": -0.1}, "not negative"),
        ({"uncertainty.fraction.wheet.restitution": 0.1}, "did you mean"),
    ],
)
def test_a_wrong_uncertainty_is_one_line(changes: dict[str, object], words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        shipped("rhombus", changes)
    assert "\n" not in str(caught.value)


def test_an_uncertainty_survives_saving(tmp_path: Path) -> None:
    scene = shipped(
        "rhombus", {"air.speed": {"value": 5.0, "uncertainty": "0.1 m/s"}, "uncertainty.feed.width": "2 mm"}
    )
    scene.save(tmp_path / "scene.toml")
    again = wf.Scene.load(tmp_path / "scene.toml")
    assert again == scene
    assert again.uncertainty == {"air.speed": pytest.approx(0.1), "feed.width": pytest.approx(0.002)}


def test_the_middle_draw_is_the_scene_itself() -> None:
    scene = shipped("rhombus")
    plan = make_plan(scene, force=OFF)
    known = unknowns(scene, plan)
    made = variation_at(scene, plan, known, np.zeros(len(known)))
    assert made.fed(scene) == scene
    assert made.air.theta == pytest.approx(plan.airflow.wake.theta.value)
    assert (made.air.speed, made.air.energy, made.air.lifetime) == (1.0, 1.0, 1.0)
    for name in scene.fraction:
        own = made.of(name)
        assert (own.restitution, own.friction, own.size) == (0.0, 1.0, 1.0)
        assert own.drag == pytest.approx(1.0)


def test_each_unknown_moves_its_own_number() -> None:
    """One standard deviation up: every kind varies one thing, by what it says."""
    scene = shipped("rhombus")
    plan = make_plan(scene, force=OFF)
    known = unknowns(scene, plan)
    still = variation_at(scene, plan, known, np.zeros(len(known)))
    for i, one in enumerate(known):
        z = np.zeros(len(known))
        z[i] = 1.0
        made = variation_at(scene, plan, known, z)
        changed = [name for name in ("feed_width", "feed_shift") if getattr(made, name) != getattr(still, name)]
        changed += [name for name in vars(made.air) if getattr(made.air, name) != getattr(still.air, name)]
        for name in scene.fraction:
            changed += [
                key for key in vars(made.of(name)) if getattr(made.of(name), key) != getattr(still.of(name), key)
            ]
        assert len(changed) == 1, one.key
    wheat = next(one for one in known if one.key == "fraction.wheat.terminal_velocity")
    assert wheat.at(1.0) - wheat.value == pytest.approx(wheat.high / SIGMAS)


def test_a_faster_fall_is_less_drag() -> None:
    scene = shipped("rhombus")
    plan = make_plan(scene, force=OFF)
    known = [one for one in unknowns(scene, plan) if one.key == "fraction.wheat.terminal_velocity"]
    made = variation_at(scene, plan, known, np.array([1.0]))
    ratio = known[0].at(1.0) / known[0].value
    assert made.of("wheat").drag == pytest.approx(ratio**-2, rel=0.05)  # a grain's drag goes with the square
