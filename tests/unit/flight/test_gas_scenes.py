"""The gas and the gravity of a scene, from its keys to the granules' landings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from support import shipped
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.core.errors import SceneError, known
from wakeflow.flight.feed.feedstock import feedstock, granules_of
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.laws.drag import slip_correction, terminal_velocity
from wakeflow.planning.make import approaches
from wakeflow.planning.plan import Plan
from wakeflow.planning.uniform_fall import UniformFall
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

HOT, WATER = {"air.temperature": "400 C"}, {"air.density": 998.2, "air.viscosity": 1.002e-3}
DUST = {"fraction.dust.size": "1 um", "fraction.dust.density": 2500.0}


def dusty(changes: dict[str, Any]) -> Scene:
    tables = shipped("rhombus").tables()
    tables["fraction"] = {"dust": {"size": 1e-6, "density": 2500.0, "restitution": 0.3, "friction": 0.3}}
    return Scene.parse(tables).replace(changes)


def test_temperature_and_pressure_make_the_air() -> None:
    air = dusty({**HOT, "air.pressure": "0.5 bar"}).airstream
    assert (air.temperature, air.pressure) == (673.15, 5e4)
    assert air.density == pytest.approx(1.204 * 293.15 / 673.15 * 5e4 / 101325)
    assert air.viscosity == pytest.approx(3.27e-5, rel=1e-3)
    given = dusty({**HOT, "air.density": 0.7, "air.mean_free_path": "0.1 um"}).airstream
    assert (given.density, given.mean_free_path) == (0.7, 0.1e-6)
    with pytest.raises(SceneError, match=r"air\.temperature = 20"):
        dusty({"air.temperature": 20.0})
    assert dusty(HOT).replace({"air.speed": 3.0}).airstream.density == dusty(HOT).airstream.density


@pytest.mark.parametrize(
    ("changes", "about"),
    [
        ({}, 1.166),
        (HOT, 1.461),
        ({"air.pressure": "0.2 bar"}, 1.88),
        (WATER, 1.0),
        ({"air.density": 0.1664, "air.viscosity": 1.96e-5}, 1.486),
    ],
)
def test_plan_and_granules_slip_in_the_scenes_own_gas(changes: dict[str, Any], about: float) -> None:
    """``about``: Cc of 1 um with the mean free paths of handbooks: air, hot, thin, water, helium."""
    scene = dusty(changes)
    air, dust = scene.airstream, scene.fraction["dust"]
    slips = float(slip_correction(1e-6, air.mean_free_path))
    assert slips == pytest.approx(about, rel=0.01)
    plan = make_plan(scene)
    how = plan.fractions["dust"]
    expected = slips * float(terminal_velocity(1e-6, 2500.0, air.density, air.viscosity, law=how.drag))
    fall = UniformFall.of(scene, dust, how.drag, how.drag_scale, 1e-6)
    assert fall.granule.settling == pytest.approx(expected, rel=1e-3)
    assert how.terminal_velocity == pytest.approx(expected, rel=1e-3)
    grains = granules_of(scene, "dust", how, np.full(2, 1e-6))
    np.testing.assert_allclose(grains.drag_scale, 1.0 / slips, rtol=1e-12)


def test_a_measured_terminal_velocity_is_that_of_standard_air_with_its_slip() -> None:
    """In water the same granule has the drag factor that it has in air, slip aside, and does not slip."""
    speed = 9e-5
    changes = {"fraction.dust.terminal_velocity": speed}
    scene, sunk = dusty(changes), dusty({**changes, **WATER})
    how = make_plan(scene).fractions["dust"]
    own = granules_of(scene, "dust", how, np.full(1, 1e-6)).drag_scale[0]
    fall = terminal_velocity(1e-6, 2500.0, 1.204, 1.825e-5, law=how.drag, drag_scale=own)
    assert float(fall) == pytest.approx(speed, rel=1e-6)
    wet = granules_of(sunk, "dust", make_plan(sunk).fractions["dust"], np.full(1, 1e-6)).drag_scale[0]
    assert wet == pytest.approx(own * 1.1659, rel=1e-4)
    drawn = granules_of(sunk, "dust", make_plan(sunk).fractions["dust"], np.full(1, 1e-6), np.full(1, speed))
    assert drawn.drag_scale[0] == pytest.approx(wet, rel=1e-9)


def test_what_a_scene_falls_by_is_its_gravity() -> None:
    moon = dusty({"gravity": 1.62, "vibration.frequency": 30.0, "vibration.gamma": 2.0})
    assert moon.plumb.gravity == (0.0, -1.62)
    assert moon.feed.fall_speed == pytest.approx(math.sqrt(2 * 1.62 * 0.1))
    assert known_amplitude(moon) == pytest.approx(2.0 * 1.62 / (2 * math.pi * 30.0) ** 2)
    assert moon.vibration is not None
    assert moon.vibration.strength == pytest.approx(2.0)
    assert moon.replace({"feed.height": "0.2 m"}).feed.fall_speed == pytest.approx(math.sqrt(2 * 1.62 * 0.2))
    how = make_plan(moon).fractions["dust"]
    still = known(make_plan(dusty({})).fractions["dust"].terminal_velocity)
    assert how.terminal_velocity == pytest.approx(1.62 / 9.81 * still, rel=1e-4)


def known_amplitude(scene: Scene) -> float:
    return float(np.linalg.norm(scene.motion[0]))


def test_in_a_vacuum_landings_do_not_depend_on_gravity() -> None:
    """Speeds go with sqrt(g) and times with its inverse root: parabolas stay what they are."""
    at = {}
    for gravity in (9.81, 98.1):
        tables = shipped("vacuum", {"gravity": gravity, "feed.count": 64}).tables()
        del tables["vibration"]
        scene = Scene.parse(tables)
        at[gravity] = landed(scene, make_plan(scene))
    for name, places in at[9.81].items():
        np.testing.assert_allclose(at[98.1][name], places, atol=1e-6)


def landed(scene: Scene, plan: Plan) -> dict[str, np.ndarray]:
    flight = Flight(scene, plan, Realisations(None), 1e-6, 1)
    return {
        name: flight.fly(name, feedstock(scene, plan, name, 0.0, range(1)).granules).position for name in scene.fraction
    }


def test_flight_scales_know_gas_and_gravity() -> None:
    scene = dusty({**HOT, "gravity": 98.1})
    plan = make_plan(scene)
    (one, *_) = approaches(scene, plan.airflow)["dust"].scales
    assert (one.temperature, one.mean_free_path, one.gravity) == (673.15, scene.airstream.mean_free_path, 98.1)
