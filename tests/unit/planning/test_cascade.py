"""Bodies one below the other: a chain of impacts by hand, and what the plan says of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import wakeflow as wf
from support import shipped
from wakeflow.laws.best_estimate import DEFICIT, DRAG, slower_behind
from wakeflow.planning.scene_lines import _thrown, cascade_lines

G, RADIUS = 9.81, 1e-3
SLOPE, REBOUND = math.pi / 4, 0.3
Array = NDArray[np.float64]


def cascade(changes: dict[str, Any] | None = None) -> wf.Scene:
    return shipped("cascade", changes)


def face(middle: tuple[float, float], side: float) -> tuple[Array, Array]:
    """A point and the normal of the line on which centres touch a plate's upper face; it falls to the ``side``."""
    normal = np.array([side * math.sin(SLOPE), math.cos(SLOPE)])
    return np.array(middle) + normal * (0.0025 + RADIUS), normal


def until(position: Array, velocity: Array, point: Array, normal: Array) -> float:
    """The time (s) after which a parabola comes down to a line."""
    half, speed, off = 0.5 * G * normal[1], float(velocity @ normal), float((position - point) @ normal)
    return (speed + math.sqrt(speed**2 + 4.0 * half * off)) / (2.0 * half)


def flown(position: Array, velocity: Array, time: float) -> tuple[Array, Array]:
    fall = np.array([0.0, -G * time])
    return position + (velocity + 0.5 * fall) * time, velocity + fall


def rebound(velocity: Array, normal: Array) -> Array:
    return velocity - (1.0 + REBOUND) * float(velocity @ normal) * normal


@pytest.mark.parametrize("start", [-0.045, -0.04, -0.035])
def test_two_plates_without_air_are_two_parabolas_by_hand(start: float) -> None:
    """Free fall onto the upper plate, a parabola to the lower one, and another to the floor; no friction."""
    upper, lower, floor = (
        face((-0.04, 0.0), 1.0),
        face((0.06, -0.09), -1.0),
        (np.array([0.0, -0.25]), np.array([0.0, 1.0])),
    )
    top = (0.03 + 0.0025) * math.sin(SLOPE)  # of the upper plate's highest corner
    position, velocity = np.array([start, top + 0.06]), np.zeros(2)
    for point, normal in (upper, lower):
        position, velocity = flown(position, velocity, until(position, velocity, point, normal))
        velocity = rebound(velocity, normal)
    by_hand, _ = flown(position, velocity, until(position, velocity, *floor))
    tables = cascade({"feed.position": start, "feed.width": 1e-7, "feed.count": 16, "feed.rate": 1e-9}).tables()
    del tables["air"], tables["fraction"], tables["feed"]["rate"], tables["bin"]["light"], tables["force"]
    tables["numerics"] = {"tolerance": 1e-5}
    tables["fraction"] = {"ball": {"size": 2.0 * RADIUS, "density": 1300.0, "restitution": REBOUND, "friction": 0.0,
                                   "target": "grain"}}  # fmt: skip
    found = wf.chain(wf.Scene.parse(tables)).landings["ball"].position
    assert found[:, 0] == pytest.approx(by_hand[0], abs=2e-6)
    assert by_hand[0] < start - 0.01  # thrown to the right, then back to the left


def test_the_plan_says_which_body_feeds_which_and_where_a_wake_reaches() -> None:
    lines = wf.plan(cascade()).used
    (fed,) = [line for line in lines if line.startswith("cascade: ")]
    assert fed.startswith("cascade: lower is met by what leaves upper, thrown up to (wheat ")
    (wake,) = [line for line in lines if line.startswith("wake: that of")]
    assert wake.startswith("wake: that of lower reaches upper, with air up to ")
    down = cascade({"air.direction": "down", "bin": {"light": {"on": "top", "from": -0.12, "to": 0.12}}})
    assert any("that of upper reaches lower" in line for line in cascade_lines(down, blown=True))
    assert not any("wake" in line for line in cascade_lines(down, blown=False))
    far = cascade({"body.lower.at": [0.06, -0.2], "body.lower.length": "20 mm", "channel.width": "4 m"})
    far = far.replace({"body.lower.at": [1.5, -0.2]})
    assert not [*cascade_lines(far, blown=True)]
    assert not [line for line in wf.plan(shipped("prism")).used if line.startswith(("cascade: ", "wake: that"))]


def test_hardly_a_granule_comes_farther_than_the_plan_says_it_is_thrown() -> None:
    """Off the upper plate alone, down to where the lower one ends; 1 % for what a shape turns by more than twice."""
    scene = cascade({"numerics.rung": "none", "feed.count": 256})
    upper, lower = (body.outline() for body in scene.body.values())
    tables = scene.tables()
    del tables["body"]["lower"], tables["bin"]["light"], tables["force"]
    tables["channel"] |= {"bottom": float(lower[:, 1].min()), "width": 1.0}
    tables["bin"]["grain"] = {"from": -0.5, "to": 0.5}
    del tables["fraction"]["chaff"], tables["fraction"]["wheat"]["mass_share"], tables["feed"]["rate"]
    landed = wf.chain(wf.Scene.parse(tables)).landings["wheat"].position[:, 0]
    reach = _thrown(scene, "wheat", upper, lower)
    assert np.quantile(landed, 0.99) < upper[:, 0].max() + reach
    assert landed.max() > upper[:, 0].max() + 0.2 * reach


def test_a_far_wake_fades_with_the_root_of_the_distance() -> None:
    front = np.array([[-0.01, 0.0], [0.01, 0.0], [0.01, 0.001], [-0.01, 0.001]])
    near, far = (slower_behind(front, front - np.array([0.0, way]), -1.0) for way in (0.5, 2.0))
    assert near == pytest.approx(DEFICIT * math.sqrt(DRAG * 0.02 / 0.5))
    assert far == pytest.approx(0.5 * near)
    assert slower_behind(front, front + np.array([0.0, 0.5]), -1.0) == 0.0
    assert slower_behind(front, front - np.array([1.0, 0.5]), -1.0) == 0.0
