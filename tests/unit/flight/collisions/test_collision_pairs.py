"""Two granules meet exactly as the law of pairs says, collisions keep what they must; heaps, jams, what is refused."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import wakeflow as wf
from wakeflow.flight import Fate
from wakeflow.laws.collision import collide_pair

Array = NDArray[np.float64]
DEPTH = 0.06


def _granules(position: Any, velocity: Any, diameter: Any = 4e-3, density: Any = 1000.0, **more: Any) -> wf.Granules:
    return wf.Granules(np.array(position, dtype=float), np.array(velocity, dtype=float), diameter, density, **more)


def _fly(grains: wf.Granules, until: float, collisions: wf.Collisions | None = None, **more: Any) -> wf.Tracks:
    collisions = wf.Collisions(DEPTH, 0.5, 0.3) if collisions is None else collisions
    return wf.track(None, grains, until=until, collisions=collisions, **{"gravity": (0.0, 0.0)} | more)


CASES = {
    "head-on": {"offset": 0.0, "across": 0.0},
    "oblique": {"offset": 2e-3, "across": 1e-3},
    "unequal": {"offset": 1e-3, "across": 2e-3, "diameter": [4e-3, 1.5e-3], "density": [1300.0, 400.0]},
    "spinning": {"offset": 1e-3, "across": -1e-3, "spin": [900.0, -250.0], "inertia": 0.4},
    "gliding": {"offset": 3.9999e-3, "across": 0.0, "inertia": 0.4},
    "a thousand to one": {"offset": 1e-3, "across": 5e-4, "diameter": [4e-3, 4e-6], "inertia": 0.4},
    "nothing comes back": {"offset": 1e-3, "across": 1e-3, "e": 0.0},
    "all comes back": {"offset": 1e-3, "across": 1e-3, "e": 1.0, "f": 0.0},
    "rough and elastic": {"offset": 1e-3, "across": 1e-3, "e": 0.7, "f": np.inf, "back": 0.44, "inertia": 0.4},
    "in free fall": {"offset": 1e-3, "across": 1e-3, "gravity": (0.0, -9.81), "inertia": 0.4},
}


@pytest.mark.parametrize("case", CASES.values(), ids=list(CASES))
def test_two_granules_meet_as_the_law_says(case: dict[str, Any]) -> None:
    """Time and place of the impact, velocities and spins after it, in a plane tilted across the slab."""
    own = {
        "diameter": 4e-3,
        "density": 1000.0,
        "spin": 0.0,
        "e": 0.5,
        "f": 0.3,
        "back": 0.0,
        "gravity": (0.0, 0.0),
    } | case
    grains = _granules(
        [[0.0, 0.0], [0.0203, own["offset"]]], [[0.9, 0.1], [-1.1, 0.1]], own["diameter"], own["density"],
        spin=own["spin"], inertia=own.get("inertia"), depth=np.array([DEPTH - 4e-4, own["across"] - 4e-4]),
    )  # fmt: skip
    until, g = 0.0177, np.asarray(own["gravity"])
    laws = wf.Collisions(DEPTH, own["e"], own["f"], own["back"])
    tracks = _fly(grains, until, laws, gravity=own["gravity"])
    np.testing.assert_array_equal(tracks.meetings, [1, 1])

    d = np.array([*(grains.position[0] - grains.position[1]), -own["across"]])
    u = np.array([2.0, 0.0, 0.0])
    r = grains.diameter / 2
    b, c = d @ u, d @ d - r.sum() ** 2
    when = c / (-b + np.sqrt(b * b - u @ u * c))
    n = (d + u * when) / r.sum()
    light = 1 / (np.pi / 6 * grains.density * grains.diameter**3)
    q = 1 / grains.inertia
    s = np.array([0.0, 0.0, (r * grains.spin * np.sign(q)).sum()])
    impulse = np.array(collide_pair(*u, *s, *n, *light, *q, own["e"], own["f"], own["back"])[:3])
    for i, sign in enumerate((1.0, -1.0)):
        v = grains.velocity[i] + g * when
        after = v + sign * light[i] * impulse[:2]
        rest = until - when
        place = grains.position[i] + grains.velocity[i] * when + 0.5 * g * when**2 + after * rest + 0.5 * g * rest**2
        size = max(1.0, float(np.abs(after).max()))
        np.testing.assert_allclose(tracks.velocity[i], after + g * rest, atol=1e-12 * size)
        np.testing.assert_allclose(tracks.position[i], place, atol=1e-13 * size)
        turned = grains.spin[i] - q[i] * light[i] / r[i] * np.cross(n, impulse)[2]
        np.testing.assert_allclose(tracks.spin[i], turned, rtol=1e-11, atol=1e-9)


def test_granules_that_pass_by_do_not_meet() -> None:
    tracks = _fly(_granules([[0.0, 0.0], [0.02, 4.00001e-3]], [[1.0, 0.0], [-1.0, 0.0]], depth=0.01), 0.02)
    np.testing.assert_array_equal(tracks.meetings, [0, 0])
    np.testing.assert_array_equal(tracks.velocity, [[1.0, 0.0], [-1.0, 0.0]])


def test_the_slab_is_periodic() -> None:
    """Two granules on the two sides of the slab meet through them; half a slab apart they do not."""
    for across, meets in ((0.0595, 1), (0.03, 0)):
        grains = _granules([[0.0, 0.0], [0.02, 0.0]], [[1.0, 0.0], [-1.0, 0.0]], depth=np.array([0.0005, across]))
        np.testing.assert_array_equal(_fly(grains, 0.02).meetings, [meets, meets])


def _gas(count: int, seed: int, inertia: float | None = 0.4) -> wf.Granules:
    rng = np.random.default_rng(seed)
    return _granules(
        rng.uniform(0.0, 0.03, (count, 2)), rng.normal(size=(count, 2)), rng.uniform(1e-3, 4e-3, count),
        rng.uniform(300.0, 2000.0, count), inertia=inertia, spin=rng.normal(size=count) * 300.0,
    )  # fmt: skip


@pytest.mark.parametrize("restitution", [0.0, 0.6, 1.0])
def test_a_gas_keeps_momentum_and_its_energy_never_grows(restitution: float) -> None:
    """Hundreds of meetings, overlaps at birth included, and several in a step."""
    grains, depth = _gas(400, 5), 0.03
    mass = np.pi / 6 * grains.density * grains.diameter**3
    before = mass @ grains.velocity
    energy = (
        0.5 * mass @ (grains.velocity**2).sum(axis=1) + 0.5 * (mass * (grains.diameter / 2) ** 2 / 2.5) @ grains.spin**2
    )
    for until in (0.004, 0.008, 0.016):
        tracks = _fly(grains, until, wf.Collisions(depth, restitution, 0.3))
        np.testing.assert_allclose(mass @ tracks.velocity, before, atol=1e-14 * mass.sum())
        left = 0.5 * mass @ (tracks.velocity**2).sum(axis=1)
        assert left <= energy * (1 + 1e-12)
    assert tracks.meetings.sum() > 200


def test_results_do_not_depend_on_the_number_of_threads_nor_on_the_time_of_day() -> None:
    grains = _gas(400, 6)
    first = _fly(grains, 0.01, workers=1)
    for workers in (1, 2, 3):
        again = _fly(grains, 0.01, workers=workers)
        np.testing.assert_array_equal(again.position, first.position)
        np.testing.assert_array_equal(again.meetings, first.meetings)


GLUME = (4.0, 1.4, 0.1)  # over the diameter


@pytest.mark.parametrize(("d", "shape"), [(1e-3, 1.0), (0.45e-3, GLUME)])
def test_two_streams_meet_at_the_rate_of_kinetic_theory(d: float, shape: Any) -> None:
    """n1 n2 sigma v for two dilute streams that cross, sigma the mean section: meetings are counted, and they pass
    through each other (no mass is lost by it: the friction and restitution of the pair do not matter to who meets whom
    next at this density).
    """
    rng = np.random.default_rng(7)
    count, side, v, until = 3000, 0.2, 4.0, 0.01
    position = np.concatenate([
        np.column_stack([rng.uniform(-v * until / 2, side, count), rng.uniform(0, side, count)]),
        np.column_stack([rng.uniform(0.0, side + v * until / 2, count), rng.uniform(0, side, count)]),
    ])  # fmt: skip
    velocity = np.repeat([[v / 2, 0.0], [-v / 2, 0.0]], count, axis=0)
    kind = np.repeat([0, 1], count)
    own = np.where(kind[:, None] == 0, shape, 1.0)
    grains = _granules(position, velocity, d, 1000.0, fraction=kind, shape=own, flake=own[:, 0] > 1.0)
    tracks = _fly(grains, until, wf.Collisions(DEPTH, 1.0, 0.0), seed=3)
    # of stream 1 those that are always inside the other stream
    n2 = count / ((side + v * until / 2) * side * DEPTH)
    always = (kind == 0) & (position[:, 0] > v * until / 2) & (position[:, 0] < side - v * until / 2)
    always &= (position[:, 1] > d) & (position[:, 1] < side - d)
    sigma = np.pi * d**2
    if shape != 1.0:  # a box and a ball: a quarter of the surface, a half of the sum of the sides
        a, b, c = d * np.array(shape)
        sigma = (a * b + b * c + c * a) / 2.0 + np.pi * d**2 / 4.0 + np.pi * (a + b + c) * d / 4.0
    expected = always.sum() * n2 * sigma * v * until
    found = tracks.meetings[always].sum()
    assert expected > 100
    assert abs(found - expected) < 3.0 * np.sqrt(expected) + 0.02 * expected


def test_a_wall_of_a_heavy_granule_agrees_with_a_mirror() -> None:
    """A granule of a million times the size and no motion of its own stands in for a flat wall."""
    big, small = 40.0, 1e-3
    grains = _granules([[0.0, -big / 2], [0.0, 0.02]], [[0.0, 0.0], [0.4, -1.3]], [big, small], [1e6, 1000.0],
                       inertia=0.4, spin=[0.0, 50.0], depth=20.0)  # fmt: skip
    ball = wf.track(None, grains, until=0.03, gravity=(0.0, 0.0), collisions=wf.Collisions(big, 0.5, 0.3))
    floor = wf.Body(np.array([[1.0, 0.0], [-1.0, 0.0]]), open=True, restitution=0.5, friction=0.3)
    wall = wf.track(None, grains[np.array([1])], until=0.03, gravity=(0.0, 0.0), bodies=[floor])
    assert wall.impacts[0] == 1
    np.testing.assert_allclose(ball.velocity[1], wall.velocity[0], atol=1e-3)
    np.testing.assert_allclose(ball.spin[1], wall.spin[0], rtol=1e-3)
    flat = _fly(grains[np.array([1])], 0.03, bodies=[floor])
    np.testing.assert_allclose(flat.velocity, wall.velocity, atol=1e-14)
    np.testing.assert_allclose(flat.position, wall.position, atol=1e-14)


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
    together = wf.track(None, one, until=1.0, bodies=[TOP], lines=BELOW, collisions=wf.Collisions(0.06), tolerance=1e-4)
    alone = wf.track(None, one, until=1.0, bodies=[TOP], lines=BELOW, tolerance=1e-4)
    assert together.fate[0] == alone.fate[0] == Fate.RESTING
    np.testing.assert_allclose(together.position, alone.position, atol=1e-6)
    assert together.collisions is not None
    assert together.time[0] == pytest.approx(alone.time[0], abs=2.0 * together.collisions.clock.step)


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
    assert tracks.collisions.steps < 8000


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
    assert tracks.meetings.mean() > 1.0
    assert not tracks.collisions.jammed
    assert tracks.collisions.advice == ""


def test_a_feed_that_jams_between_body_and_wall_is_recognised_and_said() -> None:
    """A funnel whose gap is narrower than a granule: what comes stays, and the tracks say so."""
    tracks = _through_a_gap(1e-3, 150.0, 3e-3)
    assert np.all(tracks.fate != Fate.BINNED)
    assert np.all(tracks.position[:, 1] > 0.0)
    assert tracks.collisions.jammed
    assert "jam" in tracks.collisions.advice


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
