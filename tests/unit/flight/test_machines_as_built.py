"""Scenes of machines as they are built: bodies that rock about a pivot, walls that keep a part of what meets them."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import G, shipped
from wakeflow.core.errors import SceneError
from wakeflow.flight.stages.fraction_flights import bodies_and_walls
from wakeflow.planning.airflow_choice import vibration_of_scene
from wakeflow.scene import Scene

SIZE = 2e-3  # m, of the granules
BALL = {"size": SIZE, "density": 1000.0, "restitution": 0.0, "friction": 0.0, "target": "coat"}


def chute(**changes: Any) -> Scene:
    """Granules that fall straight down onto a wide roof at rest, without air; the roof has a bin."""
    tables = {
        "body": {"roof": {"shape": "prism", "width": 0.06, "slope_angle": math.radians(40)}},
        "channel": {"width": 0.3, "top": 0.2, "bottom": -0.2},
        "feed": {"height": 0.05, "width": 0.04, "count": 1024, "rate": 1e-4, "depth": 0.3},
        "fraction": {"ball": BALL | {"target": "roof"}},
        "bin": {"roof": {"on": "roof", "keeps": 0.0}, "floor": {"from": -0.15, "to": 0.15}},
        "force": {"collisions": "off"},
    }
    return Scene.parse(tables).replace(changes) if changes else Scene.parse(tables)


def shares(scene: Scene, folder: Path, fraction: str = "ball") -> dict[str, Any]:
    return dict(wf.run(scene, folder, report=False).landings.separation.fractions[fraction])


@pytest.mark.parametrize("whose", ["wall", "fraction"])
def test_what_a_body_keeps_is_in_its_bin_with_an_interval(whose: str, tmp_path: Path) -> None:
    """All meet the roof once, at e = 0: the part stays, by a binomial and within its interval; the rest falls."""
    key = "bin.roof.keeps" if whose == "wall" else "fraction.ball.sticks"
    found = shares(chute(**{key: 0.3}), tmp_path)
    assert found["roof"].value == pytest.approx(0.3, abs=3 * math.sqrt(0.21 / 1024))
    assert found["roof"].low < 0.3 < found["roof"].high
    assert found["roof"].value + found["floor"].value == pytest.approx(1.0, abs=1e-12)


def test_by_speed_it_is_all_or_nothing(tmp_path: Path) -> None:
    """On the right-hand slope they arrive V cos 40 deg normal to it, V from sqrt(2 g h) at 10 mm beside the top, where
    h = 0.05 + 0.01 tan 40 deg - r / cos 40 deg, to that at 20 mm.
    """
    angle, radius = math.radians(40), SIZE / 2
    ends = [math.sqrt(2 * G * (0.05 + x * math.tan(angle) - radius / math.cos(angle))) for x in (0.01, 0.02)]
    slow, fast = (speed * math.cos(angle) for speed in ends)
    beside = chute(**{"feed.position": 0.015, "feed.width": 0.01})
    for limit, kept in ((0.999 * slow, 0.0), (1.001 * fast, 1.0)):
        found = shares(beside.replace({"fraction.ball.capture_speed": limit}), tmp_path / str(kept))
        assert found["roof"].value == kept


def test_a_stretch_of_a_side_is_a_wall_that_keeps(tmp_path: Path) -> None:
    """Granules thrown along a level line at the wall meet it once at e = 1: those it keeps are on the coat."""
    scene = chute(**{
        "fraction.ball.restitution": 1.0, "channel.width": 0.1, "bin.floor.from": -0.05, "bin.floor.to": 0.05,
        "bin.coat": {"on": "right", "from": -0.2, "to": 0.2, "keeps": 0.4},
    })  # fmt: skip
    open_, whole = bodies_and_walls(scene), bodies_and_walls(scene.replace({"bin.coat.keeps": 1.0}))
    assert [body.line for body in open_ if body.capture == 0.4] == [2]
    assert sum(np.ptp(body.outline[:, 1]) for body in whole if body.outline[0, 0] > 0.04) >= 0.4
    kept = {part: shares(scene.replace({"bin.coat.keeps": part}), tmp_path / str(part)) for part in (0.0, 0.4, 1.0)}
    met = kept[1.0]["coat"].value
    assert kept[0.0]["coat"].value == 0.0
    assert met > 0.3
    assert 0.4 * met - 0.05 < kept[0.4]["coat"].value < met
    for found in kept.values():
        assert sum(number.value for number in found.values()) == pytest.approx(1.0, abs=1e-12)


def test_the_shipped_scenes_run_and_tell_their_bounds(tmp_path: Path) -> None:
    rocking = shipped("rocking", {"feed.count": 64})
    plan = wf.plan(rocking)
    peak = math.radians(1.5) * 2 * math.pi * 7.0 * 0.15  # m/s about, at the lip
    assert np.linalg.norm(rocking.shaking) == pytest.approx(peak, rel=0.1)
    assert all(fraction.mode == "resolved" for fraction in plan.fractions.values())
    assert any("farthest from the pivot" in line for line in plan.used)
    assert all(fraction.bounds["vibration-of-the-air"] > 0.0 for fraction in plan.fractions.values())
    chain = wf.run(
        rocking.replace({"numerics.rung": "none", "force.collisions": "off"}), tmp_path / "rocking", report=False
    )
    still = {key: value for key, value in rocking.tables().items() if key != "vibration"}
    at_rest = wf.run(
        Scene.parse(still).replace({"numerics.rung": "none", "force.collisions": "off"}), tmp_path / "r", report=False
    )
    assert (
        chain.landings.separation.fractions["wheat"]["far"].value
        != at_rest.landings.separation.fractions["wheat"]["far"].value
    )
    sticky = shipped("sticky", {"feed.count": 64, "force.collisions": "off"})
    assert any("walls keep 0.5 of the impacts below 2 m/s" in line for line in wf.plan(sticky).used)
    found = wf.run(sticky, tmp_path / "sticky", report=False).landings.separation.fractions["chaff"]
    assert found["roof"].value > 0.3
    assert found["roof"].low < found["roof"].value < found["roof"].high


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"vibration.amplitude": "2 mm"},
            "amplitude is of a motion along a line; about a pivot give frequency and angle",
        ),
        ({"vibration.angle": "2 mm"}, "vibration.angle"),
        ({"vibration.angle": "40 deg"}, "vibration.angle = "),
        ({"vibration.angle": None}, "pivot and angle go together"),
        ({"vibration.pivot": None}, "pivot and angle go together"),
        ({"vibration.gamma": 2.0}, "gamma is of a motion along a line"),
        ({"vibration.direction": "0 deg"}, "direction is of a motion along a line"),
        ({"vibration.pivot": [0.0]}, "vibration.pivot"),
        ({"feed.mode": "injected"}, "vibration.pivot: feed.mode = 'injected'"),
        ({"bin.far.keeps": 1.5}, "bin.far.keeps"),
        ({"bin.far": {"points": [[0.2, -0.2], [0.25, -0.2]], "keeps": 0.5}}, "keeps is of a wall"),
        ({"fraction.wheat.sticks": -0.1}, "fraction.wheat.sticks"),
        ({"fraction.wheat.sticks": 0.2, "feed.mode": "injected"}, "fraction.wheat.sticks: feed.mode = 'injected'"),
    ],
)
def test_what_cannot_be_is_one_line(change: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError) as caught:
        shipped("rocking").replace(change)
    assert told in str(caught.value)


def test_a_rocking_body_that_would_lock_its_wake_is_refused() -> None:
    fast = shipped("rocking", {"vibration.frequency": "40 Hz", "vibration.angle": "6 deg"})
    with pytest.raises(SceneError, match=r"vibration\.pivot"):
        vibration_of_scene(fast)
    assert vibration_of_scene(fast, switched=False).bound > 0.1
