"""Crowds at their limits: alone, too thin a slab, a heap, a jam, a million; and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.tracking import Fate

TOP = np.array([[-0.008, -0.02], [0.008, -0.02], [0.008, 0.0], [-0.008, 0.0]])
BELOW = [np.array([[-1.0, -0.1], [1.0, -0.1]])]


def _poured(count: int, rate: float, width: float, height: float, **more: Any) -> wf.Granules:
    rng = np.random.default_rng(11)
    position = np.column_stack([rng.uniform(-width, width, count), np.full(count, height)])
    return wf.Granules(position, np.zeros((count, 2)), 4e-3, 1000.0, **{"time": np.arange(count) / rate} | more)


@pytest.mark.parametrize(
    ("law", "says"),
    [
        ({"depth": 3e-3}, "depth = 0.003 m is less than the largest granule, 0.004 m"),
        ({"depth": -1.0}, "depth = -1 must be positive"),
        ({"restitution": 1.2}, "restitution = 1.2: allowed 0 to 1"),
        ({"friction": -0.1}, "friction = -0.1: allowed"),
        ({"restitution": [[0.5, 0.2], [0.3, 0.5]]}, "not symmetric"),
        ({"restitution": np.ones((2, 2)) * 0.5}, "a table of 2 fractions, the granules have 3"),
        ({"step": 0.0}, "step = 0 must be positive"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(law: dict[str, Any], says: str) -> None:
    grains = _poured(3, 10.0, 0.0, 0.05, fraction=np.arange(3))
    with pytest.raises(wf.SceneError, match=says) as caught:
        wf.track(None, grains, until=0.1, collisions=wf.Collisions(**{"depth": 0.06} | law))
    assert "\n" not in str(caught.value)


def test_nobody_and_one() -> None:
    none = wf.track(None, _poured(0, 1.0, 0.0, 0.05), until=0.1, collisions=wf.Collisions(0.06))
    assert none.meetings is not None
    assert len(none) == len(none.meetings) == 0
    one = _poured(1, 1.0, 0.0, 0.05)
    crowd = wf.track(None, one, until=1.0, bodies=[TOP], lines=BELOW, collisions=wf.Collisions(0.06), tolerance=1e-4)
    alone = wf.track(None, one, until=1.0, bodies=[TOP], lines=BELOW, tolerance=1e-4)
    assert crowd.fate[0] == alone.fate[0] == Fate.RESTING
    np.testing.assert_allclose(crowd.position, alone.position, atol=1e-6)
    assert crowd.time[0] == pytest.approx(alone.time[0], abs=5e-3)


def test_a_heap_comes_to_rest_on_a_flat_top_under_load_and_is_counted() -> None:
    grains = _poured(60, 200.0, 4e-3, 0.02, friction=0.5)
    law = wf.Collisions(0.016, 0.3, 0.5, step=5e-4)
    tracks = wf.track(None, grains, until=4.0, bodies=[TOP], lines=BELOW, tolerance=1e-3, collisions=law)
    assert set(tracks.fate) <= {Fate.RESTING, Fate.BINNED}
    resting = tracks.position[tracks.fate == Fate.RESTING]
    assert 25 <= len(resting) <= 55
    assert resting[:, 1].max() > 0.004  # on others, not only on the top
    assert np.all(resting[:, 1] > 0.00178)  # on the top's corners friction of 0.5 holds up to 2 mm cos(atan 0.5)
    assert np.all(np.abs(resting[:, 0]) < 0.011)
    assert np.all(np.abs(tracks.velocity[tracks.fate == Fate.RESTING]) < 0.02)
    assert tracks.crowd is not None
    assert tracks.crowd.steps < 8000


def _through_a_gap(half: float, rate: float, width: float) -> wf.Tracks:
    """60 granules of 4 mm, ``rate`` a second, poured ``width`` to both sides into a funnel with a gap of twice ``half``
    (m).
    """
    left = np.array([[-0.03 - half, 0.03], [-half, 0.0], [-half, -0.01], [-0.03 - half, -0.01]])
    right = left[::-1] * [-1.0, 1.0]
    grains = _poured(60, rate, width, 0.06, friction=0.5)
    law = wf.Collisions(0.012, 0.3, 0.5, step=5e-4)
    return wf.track(None, grains, until=0.8, bodies=[left, right], lines=BELOW, tolerance=1e-3, collisions=law)


def test_a_dense_feed_that_finds_its_way_through_does_not_jam() -> None:
    """More in less time, down both faces and through a gap of three granules: they meet, slow down, and leave."""
    tracks = _through_a_gap(6e-3, 600.0, 0.02)
    assert np.all(tracks.fate == Fate.BINNED)
    assert tracks.meetings is not None
    assert tracks.meetings.mean() > 1.0
    assert tracks.crowd is not None
    assert not tracks.crowd.jammed
    assert tracks.crowd.advice == ""


def test_a_feed_that_jams_between_body_and_wall_is_recognised_and_said() -> None:
    """A funnel whose gap is narrower than a granule: what comes stays, and the tracks say so."""
    tracks = _through_a_gap(1e-3, 150.0, 3e-3)
    assert np.all(tracks.fate != Fate.BINNED)
    assert np.all(tracks.position[:, 1] > 0.0)
    assert tracks.crowd is not None
    assert tracks.crowd.jammed
    assert "jam" in tracks.crowd.advice


@pytest.mark.slow
def test_a_million_granules_go_through_the_slab() -> None:
    """Memory is that of the granules that fly at once, and of the results."""
    count, rate = 1_000_000, 2e5
    rng = np.random.default_rng(1)
    position = np.column_stack([rng.uniform(-0.1, 0.1, count), np.full(count, 0.05)])
    grains = wf.Granules(position, np.tile([0.0, -1.0], (count, 1)), 5e-4, 1000.0, time=np.arange(count) / rate)
    seen: list[int] = []
    tracks = wf.track(
        None, grains, until=10.0, lines=[np.array([[-1.0, 0.0], [1.0, 0.0]])], length=0.1, tolerance=1e-3,
        collisions=wf.Collisions(0.06, step=5e-4), progress=lambda done, _: seen.append(done),
    )  # fmt: skip
    assert np.all(tracks.fate == Fate.BINNED)
    assert seen[-1] == count
    assert np.all(np.diff(seen) >= 0)
