"""Granules enter the field where, when and as fast as the model says; the slab's feed has the true rate and sizes."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import G, distance, shipped
from wakeflow import impact
from wakeflow.air.field.flow import FlowField
from wakeflow.core.errors import SceneError
from wakeflow.flight import Granules, Motion
from wakeflow.flight.feed import stream as streams
from wakeflow.flight.feed.feedstock import contact_points, feedstock
from wakeflow.flight.feed.first_contact import first_contact
from wakeflow.flight.feed.stream import FALLEN, SlabFeed, _overlapping, slab_stream
from wakeflow.laws.shape import shapes
from wakeflow.planning.collisions import number_rates
from wakeflow.planning.plan import REPLICATES, Plan
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene


@pytest.mark.parametrize("radius", [1e-6, 2e-3])
def test_a_granule_touches_the_outline_at_its_radius(radius: float) -> None:
    outline = shapes["rhombus"](width=0.05, slope_angle=math.radians(50))
    x = np.linspace(-0.025, 0.025, 101)
    height, normal = contact_points(outline, x, np.full(101, radius))
    np.testing.assert_allclose(distance(outline, np.stack([x, height], axis=1)), radius, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
    np.testing.assert_allclose(normal[50], [0.0, 1.0], atol=1e-12)  # on the corner
    np.testing.assert_allclose(normal * [-1, 1], normal[::-1], atol=1e-12)  # mirror image


def test_granules_beside_the_body_touch_nothing() -> None:
    outline = shapes["rhombus"](width=0.05, slope_angle=math.radians(45))
    height, _ = contact_points(outline, np.array([-0.027, 0.027, 0.0]), np.full(3, 1e-3))
    assert list(np.isfinite(height)) == [False, False, True]


@pytest.mark.parametrize("strength", [0.0, 0.5, 0.99, 1.5, 8.0])
def test_first_contact_is_a_contact_and_the_first(strength: float) -> None:
    omega, fall = 100.0, 1.4
    amplitude = np.array([0.0, strength * fall / omega])
    passing = (np.arange(500) + 0.5) / 500 * 2 * np.pi / omega
    normal = np.tile([math.sin(0.8), math.cos(0.8)], (500, 1))
    motion = Motion(tuple(amplitude), omega / (2 * np.pi))
    t, wall = first_contact(np.full(500, fall), normal, passing, motion)

    def gap(s: np.ndarray) -> np.ndarray:
        return -fall * normal[0, 1] * (s - passing) - normal[0, 1] * amplitude[1] * np.sin(omega * s)

    np.testing.assert_allclose(gap(t), 0, atol=1e-12)
    early = passing - amplitude[1] / fall
    for fraction in np.linspace(0, 0.999, 400):
        assert np.all(gap(early + fraction * (t - early)) > -1e-12)
    np.testing.assert_allclose(wall[:, 1], amplitude[1] * omega * np.cos(omega * t))
    assert np.all(fall + wall[:, 1] > -1e-9)  # it closes in at the first contact


@pytest.fixture
def vacuum(cases: Path) -> Scene:
    return Scene.load(cases / "vacuum.toml").replace({"feed.count": 1024})


def test_injected_velocities_are_the_impact_law(vacuum: Scene) -> None:
    plan = make_plan(vacuum)
    amplitude, omega = vacuum.motion
    for name, (restitution, friction) in {"soft": (0.1, 0.6), "hard": (0.5, 0.3)}.items():
        feed = feedstock(vacuum, plan, name, 0.0)
        assert feed.injected.all()
        eta = amplitude[1] * omega * np.cos(omega * feed.granules.time)
        top = vacuum.body["prism"].outline()[:, 1].max()
        fall = np.sqrt(2 * 9.81 * (0.1 + top - feed.granules.position[:, 1]))  # to where it meets the moving slope
        expected = impact(math.pi / 4, fall, eta, restitution, friction).velocity
        np.testing.assert_allclose(feed.granules.velocity, expected, rtol=1e-9, atol=1e-12)


def test_without_vibration_the_feed_is_symmetric(vacuum: Scene) -> None:
    tables = vacuum.tables()
    del tables["vibration"]
    still = Scene.parse(tables).replace({"feed.position": 0.0, "feed.width": 0.04})
    feed = feedstock(still, make_plan(still), "hard", 0.0)
    velocity = feed.granules.velocity
    assert np.all(np.sign(velocity[:, 0]) == np.sign(feed.granules.position[:, 0]))
    speed = np.linalg.norm(velocity, axis=1)
    right = feed.granules.position[:, 0] > 0
    assert speed[right].mean() == pytest.approx(speed[~right].mean(), rel=1e-2)


def test_replicates_are_equal_in_size_and_independent(vacuum: Scene) -> None:
    feed = feedstock(vacuum, make_plan(vacuum), "hard", 0.0)
    assert np.all(np.bincount(feed.replicate) == 1024 // REPLICATES)
    first = feed.granules.position[feed.replicate == 0, 0]
    second = feed.granules.position[feed.replicate == 1, 0]
    assert not np.intersect1d(first, second).size
    again = feedstock(vacuum, make_plan(vacuum), "hard", 0.0)
    np.testing.assert_array_equal(again.granules.velocity, feed.granules.velocity)
    other = vacuum.replace({"feed.seed": 1})
    assert np.any(feedstock(other, make_plan(other), "hard", 0.0).granules.velocity != feed.granules.velocity)


def test_each_fraction_arrives_with_its_own_speed(cases: Path) -> None:
    """In still-ish air light granules arrive near their terminal velocity, heavy ones near free fall."""
    calm = {"air.speed": 1e-3, "feed.height": 2.0, "feed.mode": "injected", "feed.count": 256}
    scene = Scene.load(cases / "rhombus.toml", {**calm, "fraction.*.impact": "paper"})
    tables = scene.tables()
    del tables["vibration"]
    still = Scene.parse(tables)
    plan = make_plan(still)
    expected = {"chaff": 1.75, "wheat": 7.8 * math.sqrt(1 - math.exp(-2 * 9.81 * 2.0 / 7.8**2))}
    for name, speed in expected.items():
        feed = feedstock(still, plan, name, 0.0)
        v = feed.granules.velocity
        b, restitution, friction = math.pi / 4, feed.granules.restitution[0], feed.granules.friction[0]
        flat = np.abs(feed.granules.position[:, 0]) > 3e-3  # away from the corner
        vx = max(0.0, math.sin(b) - friction * (1 + restitution) * math.cos(b))
        outgoing = speed * math.hypot(vx, restitution * math.cos(b))
        assert np.median(np.linalg.norm(v[flat], axis=1)) == pytest.approx(outgoing, rel=0.03)


def test_granules_draw_their_own_rebound_where_the_paper_s_are_alike(cases: Path) -> None:
    """The same places and times, with and without; a fraction of the same numbers and no material is the paper's."""
    scene = Scene.load(cases / "rhombus.toml").replace({"feed.count": 1024, "feed.mode": "injected"}).without_air()
    paper = scene.replace({"fraction.*.impact": "paper"})
    feeds = {kind: feedstock(one, make_plan(one), "wheat", 0.0) for kind, one in (("own", scene), ("paper", paper))}
    own, alike = (feeds[kind].granules for kind in ("own", "paper"))
    np.testing.assert_array_equal(own.diameter, alike.diameter)
    for name, mean, std in (("restitution", 0.5, 0.035), ("friction", 0.29, 0.02)):
        assert getattr(own, name).mean() == pytest.approx(mean, abs=1e-3)
        assert getattr(own, name).std() == pytest.approx(std, rel=0.02)
        assert abs(np.corrcoef(getattr(own, name), own.position[:, 0])[0, 1]) < 0.05
        assert np.ptp(getattr(alike, name)) == 0.0
    assert abs(np.corrcoef(own.restitution, own.friction)[0, 1]) < 0.05
    assert np.all(own.inertia == 0.4)  # of a kernel
    assert np.all(np.isinf(alike.inertia))
    numbers = {"density": 1300.0, "restitution": 0.5, "friction": 0.29, "terminal_velocity": 7.8}
    known = {**numbers, "size": paper.tables()["fraction"]["wheat"]["size"], "mass_share": 0.9}
    plain = paper.replace({"fraction.wheat": known})
    again = feedstock(plain, make_plan(plain), "wheat", 0.0).granules
    for name in ("position", "velocity", "time", "spin", "restitution", "friction"):
        np.testing.assert_array_equal(getattr(again, name), getattr(alike, name))
    direction = [np.arctan2(grains.velocity[:, 1], np.abs(grains.velocity[:, 0])) for grains in (own, alike)]
    assert direction[0].std() > 1.2 * direction[1].std()


def test_what_may_stay_at_a_wall_meets_it_in_the_tracker(vacuum: Scene) -> None:
    sticky = vacuum.replace({"fraction.soft.capture_speed": "0.4 m/s"})
    modes = {name: how.mode for name, how in make_plan(sticky, rung="none").fractions.items()}
    assert modes.pop("soft") == "resolved"
    assert set(modes.values()) == {"injected"}
    feed = feedstock(sticky, make_plan(sticky, rung="none"), "soft", 0.0, [0])
    assert not feed.injected.any()
    assert np.all(feed.granules.capture_speed == 0.4)
    lying = {"feed.start": "resting", "feed.height": None, "feed.speed": None}
    for change, why in (({"feed.mode": "injected"}, "lets all rebound"), (lying, "none would leave it")):
        with pytest.raises(SceneError, match=why):
            sticky.replace(change)


def test_carried_up_granules_are_not_injected(cases: Path) -> None:
    scene = Scene.load(cases / "prism.toml").replace({"feed.mode": "injected", "feed.count": 64})
    feed = feedstock(scene, make_plan(scene), "chaff", 0.0)
    assert not feed.injected.any()
    np.testing.assert_allclose(feed.granules.position[:, 1], feed.granules.position[0, 1])


def test_a_granule_that_the_air_brakes_on_its_way_still_meets_the_slope_in_finite_time() -> None:
    """Slower than the crest is high: it would stop before it came down to the lowest place of the slope."""
    motion = Motion((0.0, 5e-3), 30.0)
    passing = np.linspace(0.0, 1 / 30.0, 50, endpoint=False)
    time, wall = first_contact(np.full(50, 0.1), np.tile([0.0, 1.0], (50, 1)), passing, motion, -5.0)
    assert np.isfinite(time).all()
    assert np.isfinite(wall).all()


TIMING: dict[str, Any] = {"begin": 3.0, "start_up": 0.5, "operation": 2.0, "depth": 0.03}
SPREAD = {"distribution": "lognormal", "median": "2 mm", "geometric_std": 1.3}


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The shipped vacuum with a feed rate of its own."""
    return shipped("vacuum", {"feed.rate": 0.05, "feed.depth": 0.3, "fraction.hard.size": SPREAD})


@pytest.fixture(scope="module")
def plan(scene: Scene) -> Plan:
    return make_plan(scene)


@pytest.fixture(scope="module")
def stream(scene: Scene, plan: Plan) -> SlabFeed:
    return slab_stream(scene, plan, None, 0, **TIMING)


def test_it_brings_the_true_rate_in_the_order_of_time(scene: Scene, stream: SlabFeed) -> None:
    grains = stream.granules
    assert np.all(np.diff(grains.time) >= 0.0)
    assert grains.time.min() >= 3.0
    assert grains.time.max() <= 3.0 + 2.0 + 2 * 0.5
    np.testing.assert_array_equal(stream.counted, (grains.time >= 3.5) & (grains.time < 5.5))
    mass = np.pi / 6 * grains.density * grains.diameter**3
    flow, depth = scene.feed.mass_flow, 0.03 / 0.3
    for number, name in enumerate(scene.fraction):
        own = stream.fraction == number
        expected = 0.5 * flow * depth * 3.0  # both fractions are half of the feed
        assert mass[own].sum() == pytest.approx(expected, abs=4.0 * np.sqrt((mass[own] ** 2).sum()))
        count = number_rates(scene, name).sum() * depth * 3.0
        assert own.sum() == pytest.approx(count, abs=4.0 * np.sqrt(count))


def test_times_are_those_of_a_poisson_process(stream: SlabFeed) -> None:
    """Gaps are exponential: their deviation is their mean, and one says nothing of the next."""
    gaps = np.diff(stream.granules.time[stream.fraction == 0])
    assert gaps.std() == pytest.approx(gaps.mean(), rel=0.1)
    assert abs(np.corrcoef(gaps[1:], gaps[:-1])[0, 1]) < 4.0 / np.sqrt(len(gaps))


def test_sizes_are_drawn_by_number_and_weigh_by_mass(stream: SlabFeed) -> None:
    hard = stream.fraction == 1
    diameter, mass = stream.granules.diameter[hard], stream.mass[hard]
    assert np.median(diameter) == pytest.approx(2e-3 * np.exp(-3 * np.log(1.3) ** 2), rel=0.03)  # Hatch & Choate 1929
    order = np.argsort(diameter)
    below = np.cumsum(mass[order]) / mass.sum()
    assert np.interp(0.5, below, diameter[order]) == pytest.approx(2e-3, rel=0.05)


def test_nobody_is_born_inside_another(scene: Scene, plan: Plan) -> None:
    dense = scene.replace({"feed.rate": 0.5})
    stream = slab_stream(dense, make_plan(dense), None, 0, **(TIMING | {"operation": 0.2, "start_up": 0.1}))
    grains = stream.granules
    speed = -grains.velocity[:, 1]
    assert speed == pytest.approx(np.sqrt(2 * G * FALLEN * 0.1), rel=1e-9)
    assert len(grains) > 1000
    nearest = np.inf
    for i in range(len(grains)):
        later = slice(i + 1, np.searchsorted(grains.time, grains.time[i] + 0.02))
        since = grains.time[later] - grains.time[i]
        down = speed[i] * since + 0.5 * G * since**2  # when the later one is born
        x = grains.position[later, 0] - grains.position[i, 0]
        z = grains.depth[later] - grains.depth[i]
        z -= 0.03 * np.round(z / 0.03)
        radii = 0.5 * (grains.diameter[later] + grains.diameter[i])
        nearest = min(nearest, float(np.min(np.sqrt(x**2 + down**2 + z**2) / radii, initial=np.inf)))
    assert nearest >= 1.0


def test_what_is_too_fine_comes_as_tracers_of_equal_mass(scene: Scene) -> None:
    fine = scene.replace({"fraction.soft.size": "50 um"})
    plan = make_plan(fine)
    assert dict(plan.collisions.tracers) == {"soft": 1.0, "hard": 0.0}
    stream = slab_stream(fine, plan, None, 1, **(TIMING | {"operation": plan.collisions.operation}))
    assert stream.tracers == (2,)
    tracers = stream.granules.fraction == 2
    np.testing.assert_array_equal(tracers, stream.fraction == 0)
    assert (tracers & stream.counted).sum() == pytest.approx(plan.collisions.count / plan.collisions.replicates, abs=3)
    assert np.ptp(stream.mass[tracers]) == 0.0
    half = replace(plan, collisions=replace(plan.collisions, tracers={"soft": 0.25, "hard": 0.0}))
    mixed = slab_stream(fine.replace({"fraction.soft.size": "2 mm"}), half, None, 1, **TIMING)
    soft = mixed.fraction == 0
    assert mixed.mass[soft & (mixed.granules.fraction == 2)].sum() == pytest.approx(
        0.25 * mixed.mass[soft].sum(), rel=0.1
    )


def test_a_part_of_a_slab_is_fed_with_its_own_granules(scene: Scene, plan: Plan) -> None:
    """Those of the whole slab that come there, but for the few that would overlap others across the ends."""
    whole, half = (slab_stream(scene, plan, None, 0, **TIMING, part=part) for part in (1.0, 0.5))
    depth = TIMING["depth"]
    there = whole.granules.depth < 0.5 * depth
    np.testing.assert_array_equal(half.granules.time, whole.granules.time[there])
    np.testing.assert_array_equal(half.granules.diameter, whole.granules.diameter[there])
    np.testing.assert_array_equal(half.counted, whole.counted[there])
    np.testing.assert_allclose(half.mass.sum(), 0.5 * whole.mass.sum(), rtol=0.2)
    assert np.mean(half.granules.depth == whole.granules.depth[there]) > 0.95
    assert half.granules.depth.max() < 0.5 * depth
    solid = np.flatnonzero(half.granules.fraction < len(scene.fraction))
    width = half.granules.diameter[solid]
    ahead = np.abs(half.granules.velocity[solid, 1]).min() * half.granules.time[solid]
    places = np.stack([half.granules.position[solid, 0], ahead, half.granules.depth[solid]], axis=1)
    assert not len(_overlapping(places, width, 0.5 * depth))


def test_the_same_replicate_is_the_same_feed_and_another_is_another(scene: Scene, plan: Plan, stream: SlabFeed) -> None:
    again = slab_stream(scene, plan, None, 0, **TIMING)
    np.testing.assert_array_equal(again.granules.position, stream.granules.position)
    other = slab_stream(scene, plan, None, 1, **TIMING)
    assert not np.array_equal(other.granules.time[:10], stream.granules.time[:10])


def test_what_falls_from_above_the_channel_comes_into_the_slab_with_its_speed() -> None:
    scene = shipped("rhombus", {"channel.top": "100 mm", "feed.height": "150 mm", "air.speed": 0.5})
    half, top = scene.channel.width / 2, scene.channel.top
    corners = np.array([(-half, -0.3), (half, -0.3), (half, top), (-half, top)])
    still = FlowField.from_arrays(
        corners, [(0, 1, 2), (0, 2, 3)], np.zeros((4, 2)), np.zeros(4), k=np.zeros(4), dissipation=np.ones(4)
    )
    stream = slab_stream(scene, make_plan(scene), still, 0, **(TIMING | {"operation": 0.1, "start_up": 0.05}))
    wheat = stream.fraction == list(scene.fraction).index("wheat")
    fallen = 0.175 - stream.granules.position[wheat, 1]
    assert fallen.min() > 0.07
    speed = -stream.granules.velocity[wheat, 1]
    assert speed == pytest.approx(np.sqrt(2 * G * fallen), rel=0.03)


def test_how_often_places_at_birth_are_drawn_anew_hardly_depends_on_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over 20 seeds of a feed in which hundreds of 2000 granules overlap: how many are given another place."""
    drawn, overlapping = [0], streams._overlapping

    def counted(*how: Any) -> Any:
        later = overlapping(*how)
        drawn[-1] += len(later)
        return later

    monkeypatch.setattr(streams, "_overlapping", counted)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        place = np.column_stack([rng.uniform(-0.02, 0.02, 2000), np.full(2000, 0.3)])
        grains = Granules(
            place, np.tile([0.0, -1.0], (2000, 1)), 3e-3, 1200.0, time=np.sort(rng.random(2000)) * 0.6,
            depth=0.06 * rng.random(2000), fraction=np.zeros(2000, dtype=np.int64),
        )  # fmt: skip
        drawn.append(0)
        streams._apart(rng, grains, 1, 0.06, 9.81)
    assert min(drawn[1:]) > 100
    assert max(drawn) <= 1.5 * np.median(drawn[1:])
