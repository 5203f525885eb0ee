"""Gravity at an angle to the channel: closed forms, mirror images, the feed that hangs with it, and what it costs."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import DOCS, G, shipped
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.core.errors import SceneError
from wakeflow.flight import Granules
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.feed.impact_loads import impact_loads
from wakeflow.flight.feed.stream import slab_stream
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.flight.stages.gathered_force import Gathered, Gatherer
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.scene_lines import lifting_line
from wakeflow.planning.uniform_fall import UniformFall
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.show.plan_words import feed_corners

EMPTY = """
[channel]
width = "0.5 m"
top = "0.4 m"
bottom = "-0.6 m"
[feed]
level = "0.2 m"
speed = "1 m/s"
width = "10 mm"
count = 256
rate = "2 g/s"
[fraction.beads]
size = "3 mm"
density = 2500
restitution = 0
friction = 1
mass_share = 1
[bin.floor]
from = "-250 mm"
to = "250 mm"
[bin.right]
on = "right"
from = "-600 mm"
to = "400 mm"
[bin.left]
on = "left"
from = "-600 mm"
to = "400 mm"
"""
CALM = {"collisions": False, "dispersion": False}


def empty(changes: dict[str, Any]) -> Scene:
    return Scene.parse(tomllib.loads(EMPTY)).replace(changes)


def flight(scene: Scene, field: FlowField | None = None, rung: str | None = None) -> Flight:
    force = CALM if scene.air else {"collisions": False}
    return Flight(scene, make_plan(scene, rung=rung, force=force), Realisations(field), 1e-7)


def in_air(scene: Scene) -> Flight:
    pipeline = Pipeline(scene, make_plan(scene, force={**CALM, "buoyancy": True}))
    return Flight(scene, pipeline.plan, Realisations(pipeline.field[1]), 1e-7)


@pytest.mark.parametrize("tilt", [0.0, 0.25, np.pi / 2, -0.25, -np.pi / 2])
@pytest.mark.parametrize("direction", [None, 0.5])
def test_in_a_vacuum_granules_fly_the_parabola_of_turned_gravity(tilt: float, direction: float | None) -> None:
    scene = empty({"channel.tilt": tilt, **({} if direction is None else {"feed.direction": direction})})
    fly = flight(scene)
    grains = feedstock(scene, fly.plan, "beads", 0.0).granules
    tracks = fly.fly("beads", grains)
    gravity, time = G * np.array([np.sin(tilt), -np.cos(tilt)]), tracks.time[:, None]
    start = gravity / G if direction is None else [np.cos(direction), np.sin(direction)]
    np.testing.assert_allclose(grains.velocity, np.tile(start, (len(grains), 1)), atol=1e-12)
    fallen = grains.position + time * (grains.velocity + 0.5 * time * gravity)
    np.testing.assert_allclose(tracks.position, fallen, atol=1e-6)
    ends = np.stack([0.25 - np.abs(tracks.position[:, 0]), tracks.position[:, 1] + 0.6], axis=1)
    np.testing.assert_allclose(ends.min(axis=1), 0.0, atol=1e-6)  # each ends at a wall or on the floor
    assert (tracks.line >= 0).all()


@pytest.mark.parametrize(("tilt", "direction"), [(0.4, "down"), (-1.2, "up"), (np.pi / 2, "down")])
def test_in_uniform_air_granules_sink_along_gravity(tilt: float, direction: str) -> None:
    air = {"air": {"speed": 0.1, "direction": direction, "turbulence": 0.01}}
    fine = {"fraction.beads.size": 5e-5, "fraction.beads.density": 1000.0, "feed.speed": 0.1}
    scene = empty({"channel.tilt": tilt, **air, **fine})
    fly = in_air(scene)
    grains = feedstock(scene, fly.plan, "beads", 0.0).granules
    tracks, sinks = fly.fly("beads", grains), float(fly.plan.fractions["beads"].terminal_velocity or 0.0)
    assert 0.05 < sinks < 0.1
    carried = np.array([0.0, -0.1 if direction == "down" else 0.1])
    final = carried + sinks * np.array([np.sin(tilt), -np.cos(tilt)])
    np.testing.assert_allclose(tracks.velocity, np.tile(final, (len(grains), 1)), rtol=1e-3, atol=1e-6)
    stopping = np.linalg.norm(grains.velocity[0] - final) * sinks / G  # of a response time
    away = tracks.position - grains.position - tracks.time[:, None] * final
    assert np.linalg.norm(away, axis=1).max() < 1.1 * stopping


@pytest.mark.parametrize(("tilt", "direction"), [(0.4, "down"), (-0.4, "down"), (1.2, "up"), (np.pi / 2, "down")])
@pytest.mark.parametrize("size", [5e-5, 3e-3])
def test_the_fall_that_a_plan_reckons_with_lasts_as_long_as_the_flight(
    tilt: float, direction: str, size: float
) -> None:
    air = {"speed": 1.0, "direction": direction}
    scene = empty({"channel.tilt": tilt, "feed.level": -0.2, "air": air, "fraction.beads.size": size})
    fly = in_air(scene)
    flown = float(np.median(fly.fly("beads", feedstock(scene, fly.plan, "beads", 0.0).granules).time))
    fall = UniformFall.of(scene, scene.fraction["beads"], fly.plan.fractions["beads"].drag, 1.0, size)
    assert fall.times().whole == pytest.approx(flown, rel=0.05)


def reflected(grains: Granules) -> Granules:
    return grains.replace(position=grains.position * (-1.0, 1.0), velocity=grains.velocity * (-1.0, 1.0), arrival=None)


def test_a_machine_and_its_mirror_image_throw_to_mirrored_places() -> None:
    here = shipped("vacuum", {"channel.tilt": 0.3, "feed.position": 0.004, "feed.count": 4096})
    there = here.replace({"channel.tilt": -0.3, "feed.position": -0.004})
    for name in here.fraction:
        one, other = flight(here), flight(there)
        assert one.plan.fractions[name].mode == "resolved"
        grains = feedstock(here, one.plan, name, 0.0).granules
        right, left = one.fly(name, grains), other.fly(name, reflected(grains))
        np.testing.assert_allclose(left.position * (-1.0, 1.0), right.position, atol=1e-6)
    shares = [
        np.mean(flown.fly(name, feedstock(flown.scene, flown.plan, name, 0.0).granules).position[:, 0] > 0.0)
        for flown in (one, other)
    ]
    assert shares[0] == pytest.approx(1.0 - shares[1], abs=0.03)
    assert shares[0] > 0.55  # it leans to the side to which gravity does


def test_the_feed_hangs_with_gravity_and_begins_in_the_channel() -> None:
    scene = shipped("vacuum", {"channel.tilt": 0.6, "feed.height": 0.05, "feed.count": 256})
    name = next(iter(scene.fraction))
    plan = make_plan(scene)
    upright = scene.replace({"channel.tilt": 0.0, "feed.mode": "resolved"})
    here, there = (feedstock(one, make_plan(one), name, 0.0).granules for one in (scene, upright))
    down = np.array([np.sin(0.6), -np.cos(0.6)])
    pivot = np.array([scene.feed.position, scene.level])
    away, straight = here.position - pivot, there.position - pivot
    np.testing.assert_allclose(away @ -down, straight[:, 1], atol=1e-12)  # as far above, against gravity
    np.testing.assert_allclose(away @ [np.cos(0.6), np.sin(0.6)], straight[:, 0], atol=1e-12)
    high = scene.replace({"feed.height": 1.0})
    grains = feedstock(high, plan, name, 0.0).granules
    assert (np.abs(grains.position[:, 0]) < scene.channel.width / 2).all()
    left = 1.0 - (grains.position - pivot) @ -down  # of the fall, which was outside the channel
    fast = left > 1e-6
    assert fast.any()
    np.testing.assert_allclose((grains.velocity @ down)[fast], np.sqrt(2.0 * G * left[fast]), rtol=1e-9)
    corners = feed_corners(scene)
    np.testing.assert_allclose(corners[:2].mean(axis=0) - pivot, -0.05 * down, atol=1e-12)


def test_no_tilt_is_the_upright_channel_to_the_last_bit() -> None:
    given, without = shipped("rhombus", {"channel.tilt": 0.0, "feed.count": 64}), shipped("rhombus", {"feed.count": 64})
    assert "tilt" not in without.tables()["channel"]
    plan = make_plan(without)
    assert make_plan(given).fractions == plan.fractions
    for name in given.fraction:
        one, other = (feedstock(scene, plan, name, 0.01).granules for scene in (given, without))
        assert one.position.tobytes() == other.position.tobytes()
        assert one.velocity.tobytes() == other.velocity.tobytes()
    assert given.plumb.gravity == (0.0, -G)


def test_granules_of_a_slab_come_down_the_turned_curtain() -> None:
    scene = shipped("vacuum", {"channel.tilt": 0.4, "feed.rate": 0.02, "feed.count": 64})
    plan = make_plan(scene, force={"collisions": True})
    assert plan.collisions is not None
    timing = {"begin": 0.0, "start_up": 0.05, "operation": 0.1, "depth": plan.collisions.depth}
    grains = slab_stream(scene, plan, None, 0, **timing).granules
    assert len(grains) > 20
    down = np.array([np.sin(0.4), -np.cos(0.4)])
    above = (grains.position - [scene.feed.position, scene.level]) @ -down
    aside = (grains.position - [scene.feed.position, scene.level]) @ [np.cos(0.4), np.sin(0.4)]
    assert np.abs(aside).max() <= 0.5 * scene.feed.width + 1e-9
    begin, speed = scene.release
    np.testing.assert_allclose(grains.velocity @ down, np.sqrt(speed**2 + 2.0 * G * (begin - above)), rtol=1e-9)
    np.testing.assert_allclose(grains.velocity @ [np.cos(0.4), np.sin(0.4)], 0.0, atol=1e-9)


def test_a_slab_lands_thin_feeds_where_granules_alone_land(tmp_path: Path) -> None:
    scene = empty({"channel.tilt": 0.9, "feed.rate": 1e-3, "feed.depth": 1.0, "feed.count": 256})
    alone, among = (
        wf.run(scene, tmp_path / str(met), force={"collisions": met}, report=False) for met in (False, True)
    )
    for place in ("floor", "right", "left"):
        one, other = (result.share("beads", place)[0] for result in (alone, among))
        assert one == pytest.approx(other, abs=0.02)
    assert alone.share("beads", "right")[0] > 0.9


def box(scene: Scene) -> FlowField:
    """Uniform air in the whole channel."""
    half, low, high = scene.channel.width / 2, scene.channel.bottom, scene.channel.top
    corners = np.array([(-half, low), (half, low), (half, high), (-half, high)])
    wind = np.tile([0.0, -scene.airstream.speed], (4, 1))
    return FlowField.from_arrays(corners, [(0, 1, 2), (0, 2, 3)], wind, np.zeros(4), density=1.2)


def test_the_air_gets_what_granules_lose_under_turned_gravity(tmp_path: Path) -> None:
    scene = shipped("rhombus", {"channel.tilt": 0.5, "feed.count": 64, "numerics.rung": "draft"})
    plan = make_plan(scene, force=CALM)
    assert plan.airflow.loaded
    Gatherer(scene, plan, box(scene), None, lambda _: None).alone(64, tmp_path)
    found = Gathered.load(tmp_path)
    assert found.imbalance < 1e-9
    assert abs(found.losses[:, 0].mean()) > 0.0
    assert found.before.total[0] != 0.0  # its force on the curtain's way leans as the curtain does


def test_under_load_a_tilted_machine_is_no_mirror_image_of_itself() -> None:
    scene = shipped("rhombus", {"numerics.rung": "draft"})
    upright, tilted = make_plan(scene), make_plan(scene.replace({"channel.tilt": 0.2}))
    assert upright.airflow.loaded
    assert upright.airflow.half
    assert tilted.airflow.loaded
    assert not tilted.airflow.half
    assert not tilted.airflow.symmetric
    aside = make_plan(scene.replace({"feed.position": "5 mm"})).airflow  # nor is one whose feed comes from one side
    assert (aside.loaded, aside.half, aside.symmetric) == (True, False, False)
    thin = scene.replace({"channel.tilt": 0.2, "feed.rate": 1e-7})
    assert make_plan(thin).airflow.half  # air that feels no granules feels no gravity
    assert scene.images
    assert not thin.images
    assert all(how.mode == "resolved" and how.impaction is None for how in tilted.fractions.values())
    assert impact_loads(thin, tilted) is None


def test_what_the_air_lifts_depends_on_the_angle() -> None:
    scene = shipped("aspirator")
    flat = scene.replace({"channel.tilt": 1.4, "feed.level": 0.0, "feed.position": 0.0})
    flat_plan = make_plan(flat)
    fallen, lifted = lifting_line(scene, make_plan(scene).fractions), lifting_line(flat, flat_plan.fractions)
    assert "falls" in fallen
    assert "falls" not in lifted
    assert any(
        line.startswith("gravity: 80.2 deg from the channel's axis, to the right") for line in make_plan(flat).used
    )


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("rhombus", {"channel.tilt": 0.1, "feed.mode": "injected"}, "feed.mode = 'injected' is for a channel that"),
        ("rhombus", {"channel.tilt": 2.0}, "channel.tilt"),
        ("vacuum", {"channel.tilt": np.pi / 2, "feed.position": 0.5}, "out of the channel; change feed.position"),
    ],
)
def test_what_cannot_be_tilted_is_refused(name: str, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        shipped(name, changes)


def test_a_feed_against_the_wall_that_it_falls_towards_is_refused() -> None:
    with pytest.raises(SceneError, match="gravity leads from there straight out of the channel"):
        empty({"channel.tilt": np.pi / 2, "feed.position": 0.2499})
    assert replace(empty({"channel.tilt": np.pi / 2}).plumb, tilt=0.0).upright


def test_the_winnower_of_the_documents_parts_grain_from_chaff(tmp_path: Path) -> None:
    text = (DOCS / "scenes.md").read_text()
    (written,) = (one for one in re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL) if "tilt" in one)
    winnower = Scene.parse(tomllib.loads(written)).replace({"feed.count": 256, "numerics.target_error": 0.05})
    result = wf.run(winnower, tmp_path, force={"collisions": False}, report=False)
    assert result.share("wheat", "grain")[0] > 0.95
    assert result.share("chaff", "grain")[0] < 0.3
