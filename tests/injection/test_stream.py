"""The feed of a slab: the true rate, sizes by number, nobody born inside another, tracers for what is too fine."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support import G, shipped
from wakeflow.injection.stream import FALLEN, SlabFeed, slab_stream
from wakeflow.planning.crowd import number_rates
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import Plan
from wakeflow.scene import Scene

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
    assert plan.crowd is not None
    assert dict(plan.crowd.tracers) == {"soft": 1.0, "hard": 0.0}
    stream = slab_stream(fine, plan, None, 1, **(TIMING | {"operation": plan.crowd.operation}))
    assert stream.tracers == (2,)
    tracers = stream.granules.fraction == 2
    np.testing.assert_array_equal(tracers, stream.fraction == 0)
    assert (tracers & stream.counted).sum() == pytest.approx(plan.crowd.count / plan.crowd.replicates, abs=3)
    assert np.ptp(stream.mass[tracers]) == 0.0
    half = replace(plan, crowd=replace(plan.crowd, tracers={"soft": 0.25, "hard": 0.0}))
    mixed = slab_stream(fine.replace({"fraction.soft.size": "2 mm"}), half, None, 1, **TIMING)
    soft = mixed.fraction == 0
    assert mixed.mass[soft & (mixed.granules.fraction == 2)].sum() == pytest.approx(
        0.25 * mixed.mass[soft].sum(), rel=0.1
    )


def test_the_same_replicate_is_the_same_feed_and_another_is_another(scene: Scene, plan: Plan, stream: SlabFeed) -> None:
    again = slab_stream(scene, plan, None, 0, **TIMING)
    np.testing.assert_array_equal(again.granules.position, stream.granules.position)
    other = slab_stream(scene, plan, None, 1, **TIMING)
    assert not np.array_equal(other.granules.time[:10], stream.granules.time[:10])
