"""The tracker at walls: bounces, sliding, corners, vibration; nothing passes through, nothing is lost, no energy
appears.
"""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from support import FLOOR, RHOMBUS, WIDTH, G, distance
from wakeflow import impact
from wakeflow.air.field import FlowField
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import contains
from wakeflow.flight import Body, Fate, Granules, Motion, Tracks, pack_surroundings, track


def one(position: object, velocity: object, radius: float = 1e-3, **more: object) -> Granules:
    return Granules([position], [velocity], diameter=2 * radius, density=1000.0, **more)  # type: ignore[arg-type]


def slope(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A wedge whose face descends to the origin along +x, length 1; its downward tangent and outward normal."""
    down, out = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    return np.array([[0.0, 0.0], [-np.cos(angle), np.sin(angle)], [-np.cos(angle), 0.0]]), down, out


@pytest.mark.parametrize("inertia", [None, 0.4, 0.5])
@pytest.mark.parametrize("x", [0.006, -0.011])
def test_an_impact_on_a_slope_is_eq_1_and_2(inertia: float | None, x: float) -> None:
    r, height = 1e-3, 0.1
    contact_y = 0.5 * WIDTH - abs(x) + r * np.sqrt(2)
    grains = one([x, contact_y + height], [0.0, 0.0], r, restitution=0.5, friction=0.3, inertia=inertia)
    fall = np.sqrt(2 * G * height)
    start = np.sqrt(2 * height / G)
    tracks = track(None, grains, until=start + 0.01, bodies=[RHOMBUS])
    expected = impact(np.pi / 4, fall, 0.0, 0.5, 0.3, inertia, r)
    velocity = expected.velocity * [np.sign(x), 1.0] + [0.0, -G * 0.01]
    np.testing.assert_allclose(tracks.velocity[0], velocity, atol=1e-12)
    assert tracks.impacts[0] == 1
    if inertia is not None:
        assert tracks.spin[0] == pytest.approx(float(expected.spin) * np.sign(x))


def test_an_impact_on_a_moving_slope_is_that_of_the_formula_at_that_phase() -> None:
    motion = Motion((0.0, 2e-3), 25.0, 0.4)
    grains = one([0.008, 0.12], [0.0, -0.5], 1e-3, restitution=0.4, friction=0.2)
    tracks = track(None, grains, until=0.12, bodies=[Body(RHOMBUS, motion=motion)], record=True)
    t, x, v = tracks.path(0)
    hit = int(np.flatnonzero(np.diff(v[:, 0]) != 0)[0]) + 1
    omega = 2 * np.pi * 25
    moved, speed = 2e-3 * np.sin(omega * t[hit] + 0.4), 2e-3 * omega * np.cos(omega * t[hit] + 0.4)
    assert distance(RHOMBUS + np.array([0.0, moved]), x[hit : hit + 1])[0] == pytest.approx(1e-3, abs=1e-14)
    expected = impact(np.pi / 4, 0.5 + G * t[hit], speed, 0.4, 0.2)
    np.testing.assert_allclose(v[hit], expected.velocity, atol=1e-11)


def test_a_corner_is_met_as_a_circle() -> None:
    """A granule that falls on the upper corner off its axis bounces along the line between the centres."""
    r, offset = 2e-3, 0.7e-3
    up = np.sqrt(r**2 - offset**2)
    grains = one([offset, 0.5 * WIDTH + up + 0.05], [0.0, 0.0], r, restitution=1.0, friction=0.0)
    start = np.sqrt(0.1 / G)
    tracks = track(None, grains, until=start + 1e-3, bodies=[RHOMBUS])
    n, fall = np.array([offset, up]) / r, np.array([0.0, -G * start])
    expected = fall - 2 * (fall @ n) * n + [0.0, -G * 1e-3]
    np.testing.assert_allclose(tracks.velocity[0], expected, atol=1e-12)


@pytest.mark.parametrize("gap", [1e-3, 1e-9, 1e-13])
def test_grazing_hits_are_hits_and_near_misses_are_misses(gap: float) -> None:
    r = 1e-3
    for side, hits in ((-1, 1), (1, 0)):
        grains = one([0.5 * WIDTH + r + side * gap, 0.2], [0.0, -1.0], r, restitution=0.5, friction=0.0)
        tracks = track(None, grains, until=0.3, bodies=[RHOMBUS], gravity=(0.0, 0.0))
        assert tracks.impacts[0] == hits


def test_the_exact_tip_sends_granules_straight_back() -> None:
    tracks = track(None, one([0.0, 0.2], [0.0, -1.0], restitution=0.5), until=0.3, bodies=[RHOMBUS], gravity=(0, 0))
    np.testing.assert_allclose(tracks.velocity, [[0.0, 0.5]], atol=1e-14)
    tip = np.array([[0.0, 0.0], [1e-4, 0.1], [-1e-4, 0.1]])
    tracks = track(None, one([0.0, -0.1], [0.0, 1.0], 1e-6), until=0.3, bodies=[tip], gravity=(0, 0))
    np.testing.assert_allclose(tracks.velocity, [[0.0, -0.5]], atol=1e-14)


def test_fast_granules_do_not_tunnel_through_thin_plates() -> None:
    plate = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1e-6], [-1.0, 1e-6]])
    rng = np.random.default_rng(0)
    n = 500
    x = np.stack([rng.uniform(-0.4, 0.4, n), rng.uniform(0.1, 0.5, n)], axis=1)
    v = np.stack([rng.uniform(-50, 50, n), -rng.uniform(100, 1000, n)], axis=1)
    grains = Granules(x, v, diameter=1e-7, density=1000, restitution=1.0, friction=0.0)
    tracks = track(None, grains, until=0.006, bodies=[plate], gravity=(0.0, 0.0))
    late = x[:, 1] + v[:, 1] * 0.006 < -1e-5
    assert late.any()
    assert np.all(tracks.position[late, 1] > 0)
    np.testing.assert_allclose(tracks.position[late, 1], 1e-7 + 2e-6 - (x + v * 0.006)[late, 1], atol=1e-9)


def test_capture_ends_a_track_at_first_contact() -> None:
    tracks = track(None, one([0.003, 0.1], [0.0, 0.0]), until=9.0, bodies=[Body(RHOMBUS, capture=True)])
    assert tracks.fate[0] == Fate.CAPTURED
    assert distance(RHOMBUS, tracks.position)[0] == pytest.approx(1e-3, abs=1e-14)


def test_a_body_may_replace_restitution_and_friction() -> None:
    body = Body(FLOOR, restitution=1.0, friction=0.0)
    grains = one([0.0, 0.1], [0.3, 0.0], restitution=0.1, friction=0.9)
    tracks = track(None, grains, until=3 * np.sqrt(2 * 0.099 / G), bodies=[body])
    assert tracks.velocity[0, 0] == 0.3
    assert tracks.velocity[0, 1] == pytest.approx(0.0, abs=np.sqrt(2 * G * 0.099) + 1e-9)
    assert 0.5 * tracks.velocity[0, 1] ** 2 + G * tracks.position[0, 1] == pytest.approx(G * 0.1, rel=1e-12)


def test_a_slow_granule_rolls_over_an_edge_and_falls_off_where_the_circle_lets_it_go() -> None:
    """Frictionless point mass over a corner of radius r: it leaves at cos(theta) = 2/3 + w^2 / (3 g r)."""
    r, w0 = 0.01, 0.05
    table = np.array([[-1.0, -0.5], [0.0, -0.5], [0.0, 0.0], [-1.0, 0.0]])
    grains = one([-0.01, r], [w0, 0.0], r, restitution=0.0, friction=0.0)
    tracks = track(
        None, grains, until=9.0, bodies=[table], lines=[np.array([[-3.0, -0.1], [3.0, -0.1]])], tolerance=1e-9,
        length=0.1, record=True,
    )  # fmt: skip
    _, x, v = tracks.path(0)
    c = 2 / 3 + w0**2 / (3 * G * r)
    speed, n = np.sqrt(w0**2 + 2 * G * r * (1 - c)), np.array([np.sqrt(1 - c * c), c])
    fall = speed * n[0]  # it leaves along the tangent (n_y, -n_x)
    time = (-fall + np.sqrt(fall**2 + 2 * G * (r * c + 0.1))) / G
    assert tracks.position[0, 0] == pytest.approx(r * n[0] + speed * c * time, abs=1e-8)
    energy = 0.5 * np.sum(v**2, axis=1) + G * x[:, 1]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)


def test_an_open_polyline_is_a_wall_from_one_side() -> None:
    wall = Body(np.array([[1.0, 0.0], [-1.0, 0.0]]), open=True)  # solid on the left of its direction: below
    above = track(None, one([0.0, 0.5], [0.0, -1.0]), until=1.0, bodies=[wall], gravity=(0, 0))
    below = track(None, one([0.0, -0.5], [0.0, 1.0]), until=1.0, bodies=[wall], gravity=(0, 0))
    assert (above.impacts[0], below.impacts[0]) == (1, 0)


@pytest.mark.parametrize("strength", [1.1, 1.4])
def test_a_ball_on_a_vibrating_table_locks_to_its_period(strength: float) -> None:
    """e = 0.5: a period-one orbit exists from Gamma = 1.0472 to 1.5268 (exact map of the bouncing ball)."""
    f, e = 20.0, 0.5
    omega = 2 * np.pi * f
    a = strength * G / omega**2
    phase = np.arccos(np.pi * (1 - e) / (1 + e) / strength)  # a w cos = g T (1 - e) / (2 (1 + e))
    assert np.sin(phase) > 0
    t0 = phase / omega
    grains = one([0.0, a * np.sin(phase) + 1e-3], [0.0, 0.5 * G / f], restitution=e, friction=0.0, time=t0 + 1e-12)
    motion = Motion((0.0, a), f)
    tracks = track(None, grains, until=t0 + 40.5 / f, bodies=[Body(FLOOR, motion=motion)], length=0.1)
    assert tracks.impacts[0] == 40
    height = a * np.sin(phase) + 1e-3 + 0.5 * G / f * (0.5 / f) - 0.5 * G * (0.5 / f) ** 2
    assert tracks.position[0, 1] == pytest.approx(height, abs=1e-7)


MOTIONS = {"at rest": None, "vibrating": Motion((1e-3, 3e-3), 40.0, 0.3)}


def shower(n: int, radius: float) -> Granules:
    rng = np.random.default_rng(1)
    return Granules(
        np.stack([rng.uniform(-0.04, 0.04, n), rng.uniform(0.05, 0.1, n)], axis=1),
        rng.normal([0.0, -1.0], 0.5, (n, 2)),
        diameter=2 * radius,
        density=1000,
        restitution=rng.uniform(0, 1, n),
        friction=rng.uniform(0, 0.9, n),
        inertia=rng.choice([np.inf, 0.4, 0.5], n),
        time=rng.uniform(0, 0.1, n),
    )


@pytest.mark.parametrize("inertia", [0.4, 0.5, 1.0])
@pytest.mark.parametrize("angle", [10.0, 30.0, 60.0])
def test_rolling_down_a_slope_takes_the_share_of_the_spin(inertia: float, angle: float) -> None:
    """a = g sin b / (1 + k), spin v / r clockwise, for friction of at least tan b k / (1 + k) (Routh 1897, ch. 4)."""
    b, r = np.radians(angle), 1e-3
    wedge, down, out = slope(b)
    friction = 1.01 * np.tan(b) * inertia / (1 + inertia)
    grains = one(wedge[1] + 0.1 * down + r * out, [0.0, 0.0], r, restitution=0.3, friction=friction, inertia=inertia)
    tracks = track(None, grains, until=0.3, bodies=[wedge])
    a = G * np.sin(b) / (1 + inertia)
    np.testing.assert_allclose(tracks.velocity[0], 0.3 * a * down, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(tracks.position[0] - grains.position[0], 0.045 * a * down, rtol=1e-9, atol=1e-12)
    assert tracks.spin[0] == pytest.approx(-0.3 * a / r, rel=1e-9)


@pytest.mark.parametrize("spin", [0.0, 300.0, -2000.0])
def test_a_thrown_ball_slips_until_it_rolls(spin: float) -> None:
    """The bowling ball: v = (v0 - k r w0) / (1 + k) once friction has brought its contact point to rest."""
    k, r, f, v0 = 0.4, 1e-3, 0.2, 1.0
    grains = one([-0.8, r], [v0, 0.0], r, restitution=0.0, friction=f, inertia=k, spin=spin)
    end = (v0 - k * r * spin) / (1 + k)
    change = abs(v0 - end) / (f * G)
    early = track(None, grains, until=0.5 * change, bodies=[FLOOR])
    push = -np.sign(v0 - end) * f * G
    assert early.velocity[0, 0] == pytest.approx(v0 + 0.5 * push * change, rel=1e-9)
    assert early.spin[0] == pytest.approx(spin + 0.5 * push * change / (k * r), rel=1e-9)
    late = track(None, grains, until=1.5 * change, bodies=[FLOOR])
    assert late.velocity[0, 0] == pytest.approx(end, rel=1e-9)
    assert late.spin[0] == pytest.approx(-end / r, rel=1e-9)
    x = -0.8 + 0.5 * (v0 + end) * change + 0.5 * end * change
    assert late.position[0, 0] == pytest.approx(x, abs=1e-9)


@pytest.mark.parametrize("name", list(MOTIONS))
@pytest.mark.parametrize("radius", [5e-10, 5e-4, 4e-3])
def test_every_granule_gets_past_the_body_and_none_is_lost(name: str, radius: float) -> None:
    n = 20000
    body = Body(RHOMBUS, motion=MOTIONS[name])
    grains = shower(n, radius)
    tracks = track(None, grains, until=5.0, bodies=[body], lines=[np.array([[-9.0, -0.3], [9.0, -0.3]])])
    assert sum(tracks.counts().values()) == n
    held = tracks.fate == Fate.RESTING  # a point mass may stand on the apex, where friction bears it
    assert tracks.counts()[Fate.BINNED] + held.sum() == n
    assert tracks.impacts.max() > 1
    assert held.sum() < 0.002 * n
    x, y = (tracks.position[held] - RHOMBUS[1]).T
    assert np.all(np.hypot(x, y) == pytest.approx(radius, rel=1e-6))
    assert np.all(np.abs(x) <= grains.friction[held] * y)
    assert MOTIONS[name] is None or not held.any()


@pytest.mark.parametrize("name", list(MOTIONS))
@pytest.mark.parametrize("radius", [1e-6, 2e-3])
def test_no_point_of_any_path_lies_in_the_wall(name: str, radius: float) -> None:
    motion = MOTIONS[name]
    tracks = track(None, shower(600, radius), until=0.4, bodies=[Body(RHOMBUS, motion=motion)], record=True)
    for i in range(600):
        t, x, _ = tracks.path(i)
        if motion is not None:
            x = x - np.sin(2 * np.pi * motion.frequency * t + motion.phase)[:, None] * np.array(motion.amplitude)
        assert not contains(RHOMBUS, x).any()
        assert np.all(distance(RHOMBUS, x) > radius - 1e-12)


def test_rounded_bodies_with_many_edges_are_met_the_same() -> None:
    angle = np.linspace(0, 2 * np.pi, 181)[:-1]
    disc = 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grains = shower(3000, 1e-3)
    line = np.array([[-9.0, -0.3], [9.0, -0.3]])
    tracks = track(None, grains, until=9.0, bodies=[disc], lines=[line])
    rests = tracks.fate == Fate.RESTING  # near the top, where friction holds
    assert np.all(rests | (tracks.fate == Fate.BINNED))
    lean = np.abs(np.arctan2(tracks.position[rests, 0], tracks.position[rests, 1]))
    assert np.all(np.tan(lean - np.pi / 180) <= grains.friction[rests])
    other = track(None, grains, until=9.0, bodies=[disc[::-1]], lines=[line])
    np.testing.assert_allclose(other.position, tracks.position, atol=1e-6)


def channel(n: int = 40, speed: float = -3.0, jitter: float = 0.2) -> FlowField:
    """A duct of 0.2 x 0.4 m with the rhombus cut out, air straight through; zero on the rhombus."""
    rng = np.random.default_rng(4)
    line = np.linspace(-1, 1, n + 1)
    points = np.stack(np.meshgrid(0.1 * line, 0.2 * line), axis=-1).reshape(-1, 2)
    inner = np.all(np.abs(points) < [0.0999, 0.1999], axis=1)
    points[inner] += rng.uniform(-jitter, jitter, (int(inner.sum()), 2)) * 0.2 / n
    size = np.abs(points).sum(axis=1)
    points = points[size > 0.5 * WIDTH + 2e-3]
    face = np.linspace(0, 1, 12)[:-1, None]
    outline = np.concatenate(
        [(1 - face) * a + face * b for a, b in zip(RHOMBUS, np.roll(RHOMBUS, -1, axis=0), strict=True)]
    )
    points = np.concatenate([points, outline])
    cells = Delaunay(points).simplices
    centre = np.abs(points[cells].mean(axis=1)).sum(axis=1)
    cells = cells[centre > 0.5 * WIDTH]
    velocity = np.tile([0.0, speed], (len(points), 1))
    velocity[-len(outline) :] = 0.0
    return FlowField.from_arrays(points, cells, velocity)


WALLS = [
    Body(np.array([[0.1, -0.3], [0.11, -0.3], [0.11, 0.3], [0.1, 0.3]])),
    Body(np.array([[-0.11, -0.3], [-0.1, -0.3], [-0.1, 0.3], [-0.11, 0.3]])),
]
BIN = np.array([[-0.1, -0.2], [0.1, -0.2]])


@pytest.mark.parametrize("name", list(MOTIONS))
@pytest.mark.parametrize("diameter", [1e-6, 3e-5, 1e-3, 4e-3])
def test_in_a_meshed_channel_all_granules_end_on_the_floor_and_none_in_the_body(name: str, diameter: float) -> None:
    n = 500 if diameter == 1e-6 and MOTIONS[name] else 1500  # they take ten times the steps of the others
    rng = np.random.default_rng(6)
    x = np.stack([rng.uniform(-0.09, 0.09, n), rng.uniform(0.1, 0.18, n)], axis=1)
    motion = MOTIONS[name]
    grains = Granules(x, np.tile([0.0, -1.0], (n, 1)), diameter=diameter, density=1000, time=rng.uniform(0, 0.1, n))
    tracks = track(
        channel(), grains, until=5.0, bodies=[Body(RHOMBUS, motion=motion), *WALLS], lines=[BIN], tolerance=1e-4
    )
    counts = tracks.counts()
    assert counts[Fate.STOPPED] == 0
    escaped = tracks.fate == Fate.ESCAPED
    np.testing.assert_allclose(tracks.position[escaped, 1], 0.2, atol=1e-12)  # thrown out at the top
    if diameter >= 1e-3:
        assert counts[Fate.BINNED] >= n - 3
    else:  # this field blows dust into the still layer at the wall, where it creeps
        assert counts[Fate.BINNED] > 0.6 * n
    moved = tracks.position
    if motion is not None:
        moved = moved - np.sin(2 * np.pi * 40 * tracks.time + 0.3)[:, None] * np.array(motion.amplitude)
    assert not contains(0.999999 * RHOMBUS, moved).any()
    np.testing.assert_allclose(tracks.position[tracks.fate == Fate.BINNED, 1], -0.2, atol=1e-12)


def test_air_from_below_lifts_a_light_granule_off_a_slope_but_not_a_heavy_one() -> None:
    field = channel(speed=6.0)
    start = np.array([[0.0125, 0.0125]]) + 2e-3 / np.sqrt(2)
    for density, lifted in ((5.0, True), (2500.0, False)):
        grains = Granules(start, [[0.0, 0.0]], diameter=4e-3, density=density, restitution=0.0, friction=0.2)
        tracks = track(field, grains, until=2.0, bodies=[RHOMBUS, *WALLS], tolerance=1e-5)
        assert (tracks.position[0, 1] > 0.1) == lifted


def test_a_spinning_flake_that_friction_holds_on_a_vibrating_slope_lets_go_once() -> None:
    """What holds it and what lets it go weigh the same forces: its spin's lift had a part in the first alone, and one
    flake in some thousand took a million steps of no length.
    """
    rng, n = np.random.default_rng(0), 30
    points = np.array([[x, y] for y in (-0.2, 0.0, 0.2) for x in (-0.2, 0.0, 0.2)])
    sheared = np.column_stack([20.0 * points[:, 1], np.full(len(points), -1.5)])
    field = FlowField(points, Delaunay(points).simplices, sheared, density=1.2, viscosity=1.8e-5)
    flakes = Granules(
        np.column_stack([rng.uniform(-0.01, 0.01, n), np.full(n, 0.06)]), np.zeros((n, 2)), diameter=1.5e-3,
        density=1000.0, restitution=0.0, friction=rng.uniform(0.2, 1.5, n), spin=rng.uniform(-600.0, 600.0, n),
        sphericity=0.4, flake=True, shape=np.tile([3.6, 1.2, 0.12], (n, 1)),
    )  # fmt: skip
    shaken = Body(RHOMBUS, motion=Motion((0.0, 2e-3), 12.0))
    tracks = track(field, flakes, until=0.5, tolerance=1e-3, bodies=[shaken], forces=("drag", "gravity", "magnus"))
    assert tracks.steps.max() < 10_000
    assert np.sum(tracks.fate == Fate.STOPPED) == 0


def test_a_granule_in_the_room_a_lowered_body_has_left_is_not_lost() -> None:
    motion = Motion((0.0, 4e-3), 20.0, -np.pi / 2)  # at its lowest at t = 0
    start = np.array([[0.010, 0.0125]])  # inside the meshed rhombus, outside the lowered one
    assert contains(RHOMBUS, start)[0]
    grains = Granules(start, [[0.0, 0.0]], diameter=1e-4, density=1000)
    tracks = track(channel(), grains, until=5.0, bodies=[Body(RHOMBUS, motion=motion), *WALLS], lines=[BIN])
    assert tracks.fate[0] == Fate.BINNED
    assert tracks.impacts[0] >= 1


@pytest.mark.parametrize("depth", [1e-12, 1e-4, 0.99e-3])
def test_born_reaching_into_a_wall_is_pushed_out_along_the_normal(depth: float) -> None:
    r = 1e-3
    tracks = track(None, one([0.0, r - depth], [0.2, 0.0], r, restitution=0.5, friction=0.0), until=0.1, bodies=[FLOOR])
    np.testing.assert_allclose(tracks.position, [[0.02, r]], atol=1e-9)


def test_bad_bodies_are_named() -> None:
    for outline, message in (
        ([[0, 0], [1, 0]], "at least 3"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "follow each other"),
        ([[0, 0], [1, 1], [2, 2]], "encloses no area"),
    ):
        with pytest.raises(SceneError, match=message):
            Body(np.array(outline, dtype=float))
    with pytest.raises(SceneError, match="restitution = 2"):
        Body(RHOMBUS, restitution=2.0)
    with pytest.raises(SceneError, match="frequency"):
        Motion((0.0, 1.0), -1.0)
    with pytest.raises(SceneError, match="amplitude"):
        Motion((0.0,), 1.0)


def test_rattling_in_a_notch_of_a_vibrating_body_ends_and_is_counted() -> None:
    notch = np.array([(-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (0.0, 0.0), (-0.02, 0.02)])
    body = Body(notch, motion=Motion((0.0, 2e-3), 20.0))
    grains = Granules(
        position=np.stack([np.linspace(0.004, 0.018, 8), np.full(8, 0.1)], axis=1),
        velocity=np.zeros((8, 2)),
        diameter=2e-3,
        density=1e3,
        restitution=0.1,
        friction=0.6,
    )
    floor = np.array([(-1.0, -0.1), (1.0, -0.1)])
    tracks = track(None, grains, until=5.0, tolerance=1e-4, bodies=[body], lines=[floor])
    assert tracks.impacts.max() <= 5000
    assert set(tracks.fate) <= {Fate.BINNED, Fate.RESTING, Fate.AIRBORNE, Fate.STOPPED}
    assert np.any(tracks.fate != Fate.BINNED)  # some stay in the notch: said, not lost


def rained(outline: np.ndarray, motion: Motion | None = None, *, is_open: bool = False) -> Tracks:
    """Granules of all sizes that fall on a body, bounce, slide and roll."""
    x = np.linspace(-0.03, 0.03, 96)
    grains = Granules(
        np.stack([x, np.full(96, 0.06)], axis=1), np.zeros((96, 2)), diameter=np.geomspace(2e-5, 4e-3, 96),
        density=1e3, restitution=0.4, friction=0.1, inertia=0.4,
    )  # fmt: skip
    return track(None, grains, until=0.5, tolerance=1e-4, bodies=[Body(outline, motion, open=is_open)], length=0.05)


def same(one: Tracks, other: Tracks) -> None:
    """Bit by bit."""
    for name in ("position", "velocity", "time", "spin", "fate", "steps", "impacts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def lobed(edges: int) -> np.ndarray:
    """An outline with notches, in which every edge has another direction."""
    turn = np.linspace(0.0, 2 * np.pi, edges, endpoint=False)
    return 0.025 * (1.0 + 0.3 * np.cos(5 * turn))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


@pytest.mark.parametrize("motion", [None, Motion((0.0, 1e-3), 25.0)])
@pytest.mark.parametrize(("edges", "is_open"), [(7, False), (9, False), (100, True), (257, False)])
def test_a_body_is_met_as_when_every_edge_is_looked_at(
    monkeypatch: pytest.MonkeyPatch, edges: int, is_open: bool, motion: Motion | None
) -> None:
    """The halves of an outline only save looks."""
    found = rained(lobed(edges), motion, is_open=is_open)
    assert found.impacts.sum() > 96
    monkeypatch.setattr(pack_surroundings, "FEW", edges)
    same(found, rained(lobed(edges), motion, is_open=is_open))


@pytest.mark.parametrize("pieces", [2, 64])
def test_sides_that_are_cut_in_pieces_are_the_same_sides(pieces: int) -> None:
    """What slides over a cut is not thrown off as by a corner, and strikes no oftener."""
    share = np.arange(pieces)[:, None] / pieces
    cut = np.concatenate([a + share * (b - a) for a, b in zip(RHOMBUS, np.roll(RHOMBUS, -1, axis=0), strict=True)])
    same(rained(cut), rained(RHOMBUS))
    same(rained(cut[: 2 * pieces + 1], is_open=True), rained(RHOMBUS[:3], is_open=True))
