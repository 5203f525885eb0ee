"""A body that rocks about a pivot: impacts and slides that are known, the limit of a far pivot, the mirror."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import wakeflow as wf
from support import G
from wakeflow.core.errors import SceneError
from wakeflow.flight import Body, Fate, Granules, Motion, Tracks
from wakeflow.laws.shape import shapes

Array = np.ndarray
R = 1e-3  # m, radius of the granules
PIVOT, PACE, TILT = np.array([0.02, -0.05]), 2 * math.pi * 20.0, math.radians(6.0)
TOP = 0.0  # m, level of the table's face at rest
TABLE = np.array([(-0.5, -0.1), (0.5, -0.1), (0.5, TOP), (-0.5, TOP)])


def turned(angle: float, vector: Array) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]]) @ vector


def rocking(phase: float, pivot: Array = PIVOT, tilt: float = TILT, outline: Array = TABLE, **kept: float) -> Body:
    return Body(outline, motion=Motion(tilt, PACE / (2 * math.pi), phase, pivot=tuple(pivot)), **kept)


def one(position: Array, velocity: Array, **properties: object) -> Granules:
    given = {"diameter": 2 * R, "density": 1000.0, "restitution": 0.6, "friction": 0.0, **properties}
    return Granules(position=np.array([position]), velocity=np.array([velocity]), **given)


def fly(grains: Granules, body: Body, until: float, gravity: float = 0.0, **how: object) -> Tracks:
    return wf.track(
        None, grains, forces=("gravity",), bodies=[body], until=until, gravity=(0.0, -gravity), length=0.1, **how
    )


@pytest.mark.parametrize("slab", [None, wf.Collisions(0.1, tracers=(0,))], ids=["alone", "in a slab"])
@pytest.mark.parametrize("turns", [False, True], ids=["smooth", "rough ball"])
@pytest.mark.parametrize("phase", [0.0, 0.7, 2.5, 4.0])
@pytest.mark.parametrize("along", [-0.15, 0.3])
def test_an_impact_on_a_rocking_face(phase: float, along: float, turns: bool, slab: wf.Collisions | None) -> None:
    """The face is at theta = A sin(phase), turns with theta' = A w cos(phase), and moves with theta' x r where it is
    met: by hand, with e = 0.6; a rough ball that grips keeps 2/7 of its slip in the spin's place.
    """
    e, speed, when = 0.6, 4.0, 0.01
    theta, rate = TILT * math.sin(phase), TILT * PACE * math.cos(phase)
    normal = turned(theta, np.array([0.0, 1.0]))
    tangent = np.array([normal[1], -normal[0]])
    touch = PIVOT + turned(theta, np.array([along, TOP]) - PIVOT)
    wall = rate * np.array([-(touch - PIVOT)[1], (touch - PIVOT)[0]])
    velocity = np.array([0.5, -speed])
    ball = {"friction": 50.0, "inertia": 0.4} if turns else {}
    grains = one(touch + R * normal - when * velocity, velocity, **ball)
    ended = fly(grains, rocking(phase - PACE * when), when + 1e-4, collisions=slab)
    seen = velocity - wall
    after = velocity - (1 + e) * (seen @ normal) * normal
    if turns:  # the slip seen @ tangent is brought to zero: 2/7 of it taken from the velocity, 5/7 made by the spin
        after = after - (seen @ tangent) * tangent / 3.5
    assert ended.impacts[0] == 1
    assert ended.velocity[0] == pytest.approx(after, abs=2e-8 if slab is None else 1e-4)


def test_a_far_pivot_is_a_translation() -> None:
    """With A R fixed the body moves as one that is displaced, the better the farther the pivot is."""
    size, outline = 2e-3, shapes["rhombus"](width=0.1, slope_angle=math.radians(50))
    x = np.linspace(-0.04, 0.04, 9)
    grains = Granules(
        position=np.stack([x, np.full(9, 0.1)], axis=1), velocity=np.tile([0.1, -1.0], (9, 1)), diameter=2 * R,
        density=1000.0, restitution=0.5, friction=0.3, inertia=0.4, time=np.linspace(0.0, 0.04, 9),
    )  # fmt: skip
    straight = fly(grains, Body(outline, motion=Motion((0.0, size), 20.0)), 0.3, G)
    for far in (1e9, 1e11):
        # about a pivot at the left, upwards first
        turned_round = fly(grains, rocking(0.0, np.array([-far, 0.0]), size / far, outline), 0.3, G)
        assert np.array_equal(straight.impacts, turned_round.impacts)
        assert np.abs(turned_round.position - straight.position).max() < 1e-9
    assert np.all(straight.impacts >= 1)


def test_the_mirror_image_rocks_the_other_way() -> None:
    outline = shapes["rhombus"](width=0.1, slope_angle=math.radians(40))
    x = np.linspace(-0.04, 0.04, 8)
    grains = Granules(
        position=np.stack([x, np.full(8, 0.08)], axis=1), velocity=np.tile([0.2, -1.0], (8, 1)), diameter=2 * R,
        density=1000.0, restitution=0.4, friction=0.2, inertia=0.4, time=np.linspace(0.0, 0.05, 8),
    )  # fmt: skip
    image = grains.replace(position=grains.position * (-1, 1), velocity=grains.velocity * (-1, 1))
    ended = fly(grains, rocking(0.3, outline=outline), 0.25, G)
    other = fly(image, rocking(0.3, PIVOT * (-1, 1), -TILT, outline=outline), 0.25, G)
    assert ended.impacts.sum() >= 8
    assert other.position * (-1, 1) == pytest.approx(ended.position, abs=1e-7)
    assert -other.spin == pytest.approx(ended.spin, abs=1e-4)


def test_what_friction_holds_turns_with_the_body() -> None:
    """A granule that lies on a rough table stays where it is on it: a turn about the pivot."""
    start = np.array([0.1, TOP + R])
    tilt, until = math.radians(2.0), 0.33
    slow = Body(TABLE, motion=Motion(tilt, 2.0, pivot=tuple(PIVOT)))
    lying = one(start, tilt * 4 * math.pi * np.array([-(start - PIVOT)[1], (start - PIVOT)[0]]), friction=2.0,
                restitution=0.0)  # fmt: skip
    ended = fly(lying, slow, until, G)
    place = PIVOT + turned(tilt * math.sin(4 * math.pi * until), start - PIVOT)
    assert ended.fate[0] == Fate.AIRBORNE
    assert ended.position[0] == pytest.approx(place, abs=1e-8)


def _slid(along: float, until: float, friction: float, mobility: float, tilt: float, pace: float) -> Array:
    """Place (2,) m of a granule that lies on the table at x = ``along`` at first, at rest on it, and slides or rolls:
    the equation of motion in the frame that turns, by scipy. In it a place q from the pivot feels g, -theta'' x q,
    theta'^2 q and -2 theta' x q'; a ball that rolls on it has s'' = (f + r theta'') / (1 + r^2 m / I) less r theta''.
    """
    height = TOP + R - PIVOT[1]

    def rate(t: float, state: Array) -> list[float]:
        s, v = state
        angle, turn = tilt * math.sin(pace * t), tilt * pace * math.cos(pace * t)
        growth = -(pace**2) * angle
        pull = turned(-angle, np.array([0.0, -G]))
        free = pull[0] + growth * height + turn**2 * s
        press = -(pull[1] - growth * s + turn**2 * height - 2 * turn * v)
        assert press > 0.0
        if mobility > 0.0:
            return [v, free - (free - R * growth) / (1.0 + mobility)]
        return [v, free - friction * press * np.sign(v if v != 0.0 else free)]

    found = solve_ivp(rate, (0.0, until), [along - PIVOT[0], 0.0], method="DOP853", rtol=1e-11, atol=1e-13)
    return PIVOT + turned(tilt * math.sin(pace * until), np.array([found.y[0, -1], height]))


@pytest.mark.parametrize("kind", ["smooth", "rolls"])
def test_what_slides_or_rolls_on_a_rocking_face(kind: str) -> None:
    tilt, pace, until = math.radians(5.0), 2 * math.pi * 3.0, 0.25
    start = np.array([0.05, TOP + R])
    turn = tilt * pace
    velocity = turn * np.array([-(start - PIVOT)[1], (start - PIVOT)[0]])
    ball = {"friction": 5.0, "inertia": 0.4, "spin": turn} if kind == "rolls" else {}
    grains = one(start, velocity, restitution=0.0, **ball)
    ended = fly(grains, Body(TABLE, motion=Motion(tilt, pace / (2 * math.pi), pivot=tuple(PIVOT))), until, G,
                tolerance=1e-8)  # fmt: skip
    exact = _slid(0.05, until, 0.0, 2.5 if kind == "rolls" else 0.0, tilt, pace)
    assert np.linalg.norm(ended.position[0] - start) > 2e-3
    assert ended.position[0] == pytest.approx(exact, abs=2e-8)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"amplitude": (0.0, 0.1), "pivot": (0.0, 0.0)}, "one finite number"),
        ({"amplitude": 0.1, "pivot": (0.0,)}, "pivot"),
        ({"amplitude": 0.1, "pivot": (0.0, math.nan)}, "pivot"),
        ({"amplitude": 0.6, "pivot": (0.0, 0.0)}, "allowed up to"),
        ({"amplitude": 0.1}, "two finite numbers"),
    ],
)
def test_a_motion_about_a_pivot_is_checked(given: dict[str, object], told: str) -> None:
    with pytest.raises(SceneError, match=told):
        Motion(frequency=10.0, **given)


# -- Walls that keep a part --------------------------------------------------------------------------------------------
def _between_plates(part: float, count: int, until: float, **properties: object) -> Tracks:
    """Elastic granules that fly to and fro between two plates 0.1 m apart at 1 m/s, without gravity."""
    plates = [np.array([(-9.0, low), (9.0, low), (9.0, low + 1.0), (-9.0, low + 1.0)]) for low in (-1.0, 0.1 + 2 * R)]
    start = np.stack([np.zeros(count), np.full(count, 0.05 + R)], axis=1)
    grains = Granules(
        position=start, velocity=np.tile([0.0, -1.0], (count, 1)), diameter=2 * R, density=1000.0, restitution=1.0,
        friction=0.0, **properties,
    )  # fmt: skip
    bodies = [Body(plate, capture=part) for plate in plates]
    return wf.track(None, grains, forces=("gravity",), bodies=bodies, until=until, gravity=(0.0, 0.0), length=0.1)


@pytest.mark.parametrize("whose", ["wall", "granule"])
def test_the_share_kept_after_n_impacts(whose: str) -> None:
    """1 - (1 - p)^n, to three standard errors of a binomial; the n-th impact keeps p of what came to it."""
    p, count = 0.3, 4000
    kept = {"capture_speed": math.inf, "sticks": p} if whose == "granule" else {}
    ended = _between_plates(p if whose == "wall" else 0.0, count, 0.6, **kept)
    stays = ended.fate == Fate.CAPTURED
    for n in range(1, 7):
        share, exact = np.mean(stays & (ended.impacts < n)), 1.0 - (1.0 - p) ** n
        assert share == pytest.approx(exact, abs=3.0 * math.sqrt(exact * (1.0 - exact) / count))
    assert np.all(ended.impacts[~stays] == 6)


def test_a_draw_is_the_granules_own() -> None:
    """It depends on the granule's number, not on the others, the order or the threads; all and nothing are exact."""
    whole, part = _between_plates(0.3, 200, 0.6), _between_plates(0.3, 50, 0.6)
    assert np.array_equal(whole.impacts[:50], part.impacts)
    assert np.array_equal(whole.fate[:50], part.fate)
    assert np.all(_between_plates(1.0, 20, 0.6).impacts == 0)
    assert not np.any(_between_plates(0.0, 20, 0.6).fate == Fate.CAPTURED)


def test_a_part_of_what_is_slow_enough() -> None:
    """Between plates at 1 m/s: below the capture speed the part sticks, above it nothing does."""
    slow = _between_plates(0.0, 2000, 0.1, capture_speed=1.01, sticks=0.4)
    assert np.mean(slow.fate == Fate.CAPTURED) == pytest.approx(0.4, abs=3 * math.sqrt(0.24 / 2000))
    assert not np.any(_between_plates(0.0, 100, 0.1, capture_speed=0.99, sticks=0.4).fate == Fate.CAPTURED)
