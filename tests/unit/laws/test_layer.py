"""The layer on a slope: closed forms, balances of momentum and energy, superposition; the impact table of a scene."""

import math
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.core.errors import SceneError
from wakeflow.flight.feed.feedstock import arrival, feedstock
from wakeflow.flight.feed.impact_loads import impact_loads
from wakeflow.laws.collision import ImpactModel, impact_models
from wakeflow.laws.momentum import momentum_pressure
from wakeflow.laws.shape import shapes
from wakeflow.laws.streams import load_on_wall
from wakeflow.planning.uniform_fall import fall_speeds
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

B = math.radians(50)
every_model = pytest.mark.parametrize("model", [impact_models[name] for name in impact_models], ids=list(impact_models))


@every_model
def test_forces_of_a_layer_are_the_closed_forms(model: ImpactModel) -> None:
    w, rho, area, e, k = 1.7, 2.0, 0.03, 0.4, 1.0 / model.inertia
    sin, cos = math.sin(B), math.cos(B)
    slips, grips = wf.layer(B, 1.4, 0.3, rho, area, e, np.array([0.1, 5.0]), model.inertia).tangential
    got = wf.layer(B, 1.4, 0.3, rho, area, e, 0.1, model.inertia)
    assert got.mass_flow == pytest.approx(w * cos * area * rho)
    assert got.normal == pytest.approx((1 + e) * rho * area * (w * cos) ** 2)
    assert slips == pytest.approx(0.1 * got.normal)
    assert grips == pytest.approx(rho * area * w**2 * sin * cos / (1 + k))  # what brings the contact point to rest
    assert got.power == pytest.approx((got.normal * cos + got.tangential * sin) * 0.3)
    gone = wf.layer(B, 0.2, -0.3, rho, area, e, 0.1, model.inertia)  # the slope runs away
    assert gone.mass_flow == gone.normal == gone.power == 0.0


@pytest.mark.parametrize("shape", ["rhombus", "prism"])
def test_without_rebound_and_friction_it_is_the_momentum_model(shape: str) -> None:
    outline = shapes[shape](width=0.05, slope_angle=B)
    cp = momentum_pressure(outline).cp
    got = wf.layer(B, 6.0, 0.0, 1.2, 1.0, 0.0, 0.0)
    assert float(got.normal) / (0.5 * 1.2 * 36.0) == pytest.approx(float(cp.max()))
    assert got.tangential == 0.0


@every_model
def test_means_over_a_vibration_balance_momentum_and_energy(model: ImpactModel) -> None:
    """Equal steps of time weighted by W / V0 are equal masses; what the body gives is what leaves and what is lost."""
    v0, peak, e, f = 1.4, 1.1, 0.5, 0.15
    up = peak * np.cos(2 * np.pi * (np.arange(400) + 0.5) / 400)
    got = wf.layer(B, v0, up, 2.0, 0.03, e, f, model.inertia)
    hit = wf.impact(B, v0, up, e, f, model.inertia, 1e-3)
    flow, mass = got.mass_flow.mean(), got.mass_flow / got.mass_flow.sum()
    assert flow == pytest.approx(v0 * math.cos(B) * 0.03 * 2.0)
    change = hit.velocity - [0.0, -v0]
    force = -flow * (mass[:, None] * change).sum(axis=0)
    into, down = np.array([-math.sin(B), -math.cos(B)]), np.array([math.cos(B), -math.sin(B)])
    np.testing.assert_allclose(into * got.normal.mean() + down * got.tangential.mean(), force)
    turning = 0.0 if np.isinf(model.inertia) else model.inertia * (1e-3 * hit.spin) ** 2
    gained = 0.5 * ((hit.velocity**2).sum(axis=1) + turning - v0**2)
    seen = np.stack([np.zeros(400), -v0 - up], axis=1) ** 2, (hit.velocity - np.stack([0 * up, up], axis=1)) ** 2
    lost = 0.5 * (seen[0].sum(axis=1) - seen[1].sum(axis=1) - turning)
    assert np.all(lost >= 0.0)
    assert got.power.mean() == pytest.approx(flow * (mass * (gained + lost)).sum())
    n = np.tile([math.sin(B), math.cos(B)], (400, 1))  # the same by samples: masses of the phases they are met in
    phases = np.repeat(up, np.round(mass * 1e6).astype(int))
    wall = np.stack([np.zeros(len(phases)), phases], axis=1)
    sampled = load_on_wall(
        flow, np.full(len(phases), v0), np.repeat(n[:1], len(phases), axis=0), wall, e, f, 1.0 / model.inertia
    )
    assert sampled.power == pytest.approx(got.power.mean(), rel=1e-3)
    assert (sampled.normal, sampled.tangential) == pytest.approx((got.normal.mean(), got.tangential.mean()), rel=1e-3)


def test_a_harmonic_stream_has_the_closed_means() -> None:
    v0, peak, e, f = 1.4, 1.1, 0.5, 0.3
    got = wf.layer(B, v0, peak * np.cos(2 * np.pi * np.arange(16) / 16), 2.0, 0.03, e, f)
    flow = 2.0 * 0.03 * v0 * math.cos(B)
    assert got.normal.mean() == pytest.approx((1 + e) * flow * math.cos(B) * (v0 + peak**2 / (2 * v0)))
    power = (1 + e) * flow * peak**2 * math.cos(B) * (math.cos(B) + f * math.sin(B))
    assert got.power.mean() == pytest.approx(power)


def test_layers_add_up_and_their_centre_of_mass_falls_freely() -> None:
    law = wf.Restitution("power", value=0.1, at=1.0)
    up = np.array([-2.0, 0.0, 0.3])  # the first: nothing arrives
    stream = wf.layers(B, 1.4, up, [2.0, 0.5], [1.0, 3.0], 0.03, [0.5, law], [0.3, 0.6], [None, 0.4])
    for i, (rho, e, f, k) in enumerate([(2.0 / 4, 0.5, 0.3, None), (0.5 * 3 / 4, law, 0.6, 0.4)]):
        one = wf.layer(B, 1.4, up, rho, 0.03, e, f, k)
        for name in ("mass_flow", "normal", "tangential", "power", "velocity"):
            np.testing.assert_array_equal(getattr(stream.parts, name)[i], getattr(one, name))
    assert stream.normal == pytest.approx(stream.parts.normal.sum(axis=0))
    assert stream.mass_flow[1] == pytest.approx((2.0 / 4 + 1.5 / 4) * 0.03 * 1.4 * math.cos(B))
    shares = np.array([2.0, 1.5]) / 3.5
    np.testing.assert_allclose(stream.velocity, np.tensordot(shares, stream.parts.velocity, 1))
    centre, places = stream.centre(0.2), stream.places(0.2)
    np.testing.assert_allclose(centre, np.tensordot(shares, places, 1))  # the centre of mass of where the layers are
    np.testing.assert_allclose(centre, stream.velocity * 0.2 - [0.0, 0.5 * 9.81 * 0.04])
    np.testing.assert_allclose(places[0] - places[1], 0.2 * (stream.parts.velocity[0] - stream.parts.velocity[1]))


def test_wrong_layers_are_refused() -> None:
    with pytest.raises(SceneError, match="of 2, 1, 2, 2, 2 layers"):
        wf.layers(B, 1.4, 0.3, [1.0, 2.0], [1.0], 1.0, [0.5, 0.5], [0.3, 0.3])
    with pytest.raises(SceneError, match="thickness"):
        wf.layers(B, 1.4, 0.3, [1.0, 2.0], [0.0, 0.0], 1.0, [0.5, 0.5], [0.3, 0.3])
    with pytest.raises(SceneError, match="density"):
        wf.layer(B, 1.4, 0.3, -1.0, 1.0, 0.5, 0.3)


@pytest.fixture
def fast(cases: Path) -> Scene:
    """10 m/s onto a prism in a vacuum: gravity hardly matters over the slope."""
    scene = Scene.load(cases / "vacuum.toml").tables()
    scene["feed"].pop("height")
    scene["feed"] |= {"speed": 10.0, "width": 0.04, "position": 0.0, "count": 4096, "rate": 2.0}
    scene["vibration"] = {"frequency": 200.0, "amplitude": 5.0 / (2 * math.pi * 200.0)}
    return Scene.parse(scene)


def test_the_table_has_the_closed_means(fast: Scene) -> None:
    table = impact_loads(fast, make_plan(fast))
    b, peak, v0 = math.pi / 4, 5.0, 10.0
    for name, (e, f, share) in {"soft": (0.1, 0.6, 0.5), "hard": (0.5, 0.3, 0.5)}.items():
        row, flow = table.fractions[name].slopes["left"], 2.0 * share / 2
        assert row.mass_flow == pytest.approx(flow)
        assert row.fall_speed == pytest.approx(v0, rel=3e-3)
        assert row.normal == pytest.approx((1 + e) * flow * math.cos(b) * (v0 + peak**2 / (2 * v0)), rel=0.02)
        assert row.tangential == pytest.approx(f * row.normal, rel=0.05)  # less where a corner is met
        power = (1 + e) * flow * peak**2 * math.cos(b) * (math.cos(b) + f * math.sin(b))
        assert row.power == pytest.approx(power, rel=0.05)
    assert table.slopes["left"].power == pytest.approx(table.slopes["right"].power)
    assert table.total.force[0] == pytest.approx(0.0, abs=1e-9)
    assert table.total.mass_flow == pytest.approx(2.0)


@pytest.mark.parametrize(("strength", "accuracy"), [(1.0, 1e-3), (6.0, 2e-3)])
def test_the_table_is_what_injected_granules_take_from_the_body(fast: Scene, strength: float, accuracy: float) -> None:
    """Also where the body is faster than the stream, and crests cast shadows; by a law of the speed, and with spin."""
    scene = fast.replace(
        {
            "vibration.amplitude": strength * 5.0 / (2 * math.pi * 200.0),
            "fraction.hard.restitution": {"law": "power", "value": 0.5, "at": 5.0},
            "fraction.hard.impact": "sphere",
        }
    )
    plan = make_plan(scene)
    table = impact_loads(scene, plan)
    for name in scene.fraction:
        grains, total = feedstock(scene, plan, name, 0.0).granules, table.fractions[name].total
        right = grains.velocity[grains.position[:, 0] > 0].mean(axis=0)
        seen = table.fractions[name].slopes["right"].velocity
        np.testing.assert_allclose(seen, right, atol=accuracy * np.linalg.norm(right))
        change = total.velocity[1] + total.fall_speed
        assert total.force[1] == pytest.approx(-total.mass_flow * change, rel=1e-3)


def test_fall_speeds_are_those_of_the_tracker(cases: Path) -> None:
    scene = Scene.load(cases / "rhombus.toml")
    plan, drop = make_plan(scene), np.array([0.02, 0.1, 0.12])
    for name, how in plan.fractions.items():
        grains = feedstock(scene.replace({"feed.count": 16}), plan, name, 0.0, [0]).granules[[0, 0, 0]]
        speeds = fall_speeds(scene, name, how.drag, grains.drag_scale[0], float(grains.diameter[0]), drop)
        np.testing.assert_allclose(speeds, arrival(scene, how, grains, drop, np.zeros(3)), rtol=0.02)


def test_what_the_air_carries_up_presses_on_nothing_and_many_slopes_add_up(cases: Path) -> None:
    prism = Scene.load(cases / "prism.toml")
    table = impact_loads(prism, make_plan(prism))
    assert table.fractions["dust"].slopes == {}
    assert table.fractions["dust"].total.mass_flow == 0.0
    assert set(table.fractions["wheat"].slopes) == {"left", "right"}
    tables = Scene.load(cases / "vacuum.toml").tables()
    tables["body"] = {"ball": {"shape": "circle", "width": 0.05, "corners": 24}}
    ball = Scene.parse(tables)
    round_ = impact_loads(ball, make_plan(ball))
    assert len(round_.slopes) > 3
    assert sum(row.mass_flow for row in round_.slopes.values()) == pytest.approx(1.0)
