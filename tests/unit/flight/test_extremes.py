"""Extremes: any slope, restitution, friction and strength of vibration, corners and simultaneous hits. Energy never
grows in the body's frame, nothing enters a body, nothing loops for ever.
Stiffness: relaxation times and flows of any time scale.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from proofs.problems.exact import DENSITY, VISCOSITY, Setting, box, field_on, fly
from proofs.problems.flights import taylor_green, two_modes
from proofs.problems.reference_all_terms import reference_end_states
from support import FLOOR, G, distance
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.flight import Body, Fate, Granules, Motion, Tracks, track
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.laws.drag import drag_laws
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

R = 1e-3
BELOW = np.array([[-9.0, -0.5], [9.0, -0.5]])
STRENGTHS = [0.0, 0.5, 1.0, 2.0, 10.0, 50.0]
INERTIAS = [np.inf, 0.4]


def grains(position: object, velocity: object, **more: object) -> Granules:
    return Granules(position, velocity, diameter=2 * R, density=1000.0, **more)  # type: ignore[arg-type]


def shaken(gamma: float, frequency: float = 30.0, direction: float = np.pi / 2) -> Motion | None:
    size = gamma * G / (2 * np.pi * frequency) ** 2
    return Motion((size * np.cos(direction), size * np.sin(direction)), frequency) if gamma > 0 else None


def never_inside(tracks: Tracks, bodies: list[Body]) -> None:
    for i in range(len(tracks)):
        t, x, _ = tracks.path(i)
        for body in bodies:
            at = x if body.motion is None else x - body.motion.at(t)[0]
            assert distance(body.outline, at).min() > R - 1e-11


def never_gains(tracks: Tracks, inertia: np.ndarray) -> None:
    """Energy of translation and height, in a frame at rest; spin can give back no more than it holds."""
    for i in range(len(tracks)):
        _, x, v = tracks.path(i)
        energy = 0.5 * np.sum(v**2, axis=1) + G * x[:, 1]
        assert np.all(
            np.diff(energy) < 1e-9 * (1 + abs(energy[0])) if np.isinf(inertia[i]) else energy < energy[0] + 1e-9
        )


def roof(angle: float) -> np.ndarray:
    """A body with an upper face inclined by ``angle`` through the origin, descending to +x, 0.2 m along."""
    down, out = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    return np.array([0.1 * down, -0.1 * down, -0.1 * down - 0.05 * out, 0.1 * down - 0.05 * out])


@pytest.mark.parametrize("angle", [0.0, 0.01, 1.0, 30.0, 60.0, 80.0, 89.0])
def test_any_slope_restitution_and_friction(angle: float) -> None:
    rows = [(e, f, k) for e in (0.0, 0.5, 1.0) for f in (0.0, 0.3, 10.0) for k in INERTIAS]
    e, f, k = np.array(rows).T
    b = np.radians(angle)
    start = 0.02 * np.array([np.sin(b), np.cos(b)])
    some = grains(
        np.tile(start, (len(rows), 1)), np.tile([0.0, -1.0], (len(rows), 1)), restitution=e, friction=f, inertia=k
    )
    body = Body(roof(b))
    tracks = track(None, some, until=20.0, bodies=[body], lines=[BELOW], length=0.1, record=True)
    never_inside(tracks, [body])
    never_gains(tracks, k)
    assert not np.any(tracks.fate == Fate.ESCAPED)
    assert np.all((tracks.fate != Fate.STOPPED) | (e == 1.0))  # elastic ones bounce on the flat top for good
    points = np.isinf(k) & (e == 0.0)
    assert np.all((tracks.fate == Fate.RESTING)[points] == (np.tan(b) <= f[points]) if angle < 80 else True)
    if angle == 0.0:
        rests = tracks.fate == Fate.RESTING
        assert np.all(rests | (e == 1.0))
        np.testing.assert_allclose(tracks.position[rests, 1], R, atol=1e-12)


@pytest.mark.parametrize("gamma", STRENGTHS)
def test_a_flat_top_at_any_strength(gamma: float) -> None:
    rows = [(e, f, k) for e in (0.0, 0.5, 1.0) for f in (0.0, 0.5, 10.0) for k in INERTIAS]
    e, f, k = np.array(rows).T
    some = grains(np.tile([0.0, 0.05], (len(rows), 1)), np.tile([0.1, 0.0], (len(rows), 1)), restitution=e, friction=f,
                  inertia=k)  # fmt: skip
    body = Body(FLOOR, motion=shaken(gamma))
    tracks = track(None, some, until=3.0, bodies=[body], length=0.1, record=True)
    never_inside(tracks, [body])
    assert tracks.impacts.max() <= 5000
    assert tracks.steps.max() < 100_000
    held = (e < 1) & (f > 0) & np.isinf(k)
    if gamma < 1:
        assert np.all(tracks.fate[held] == Fate.RESTING)
    elif gamma > 1:
        assert not np.any(tracks.fate == Fate.RESTING)
        assert np.all(tracks.fate[e < 1] == Fate.AIRBORNE)


def vee(opening: float, lean: float = 0.0) -> list[np.ndarray]:
    """Two bodies that make a corner of ``opening`` at the origin, its middle leaning by ``lean`` from upright."""
    sides = []
    for sign in (1.0, -1.0):
        a = np.pi / 2 - lean - sign * opening / 2  # direction of the wall from the corner
        along, back = np.array([np.cos(a), np.sin(a)]), np.array([np.sin(a), -np.cos(a)]) * sign
        sides.append(np.array([-0.01 * along, 0.05 * along, 0.05 * along + 0.01 * back, -0.01 * along + 0.01 * back]))
    return sides


def notch(opening: float) -> np.ndarray:
    """The same corner in one body."""
    a = opening / 2
    side = 0.03 * np.array([np.sin(a), np.cos(a)])
    return np.array(
        [[-0.04, -0.02], [0.04, -0.02], [0.04, side[1]], side, [0.0, 0.0], side * [-1, 1], [-0.04, side[1]]]
    )


CORNERS = {
    "notch of 90 deg": [notch(np.pi / 2)],
    "notch of 20 deg": [notch(np.radians(20))],
    "notch of 150 deg": [notch(np.radians(150))],
    "two bodies": vee(np.radians(70)),
    "two bodies, leaning": vee(np.radians(80), np.radians(15)),
    "floor and wall": vee(np.pi / 2, np.pi / 4),
}


def wedged(
    corner: list[np.ndarray], gamma: float, until: float, direction: float = np.pi / 2
) -> tuple[Tracks, list[Body], np.ndarray]:
    rows = [(e, f, k) for e in (0.0, 0.1, 0.5) for f in (0.0, 0.2, 0.6) for k in INERTIAS]
    e, f, k = np.array(rows).T
    some = grains(np.tile([0.0015, 0.022], (len(rows), 1)), np.tile([0.0, -0.3], (len(rows), 1)), restitution=e,
                  friction=f, inertia=k)  # fmt: skip
    bodies = [Body(outline, motion=shaken(gamma, direction=direction)) for outline in corner]
    tracks = track(None, some, until=until, bodies=bodies, lines=[BELOW], length=0.05, tolerance=1e-4, record=True)
    return tracks, bodies, k


@pytest.mark.parametrize("name", list(CORNERS))
def test_a_granule_in_a_corner_at_rest_comes_to_rest_there(name: str) -> None:
    tracks, bodies, k = wedged(CORNERS[name], 0.0, 60.0)
    assert np.all(tracks.fate == Fate.RESTING), tracks.counts()
    never_inside(tracks, bodies)
    never_gains(tracks, k)
    assert tracks.impacts.max() < 500
    if "notch" in name:
        flat = [np.abs(distance(outline, tracks.position) - R) for outline in CORNERS[name]]
        assert np.max(flat) < 1e-7


@pytest.mark.parametrize("name", list(CORNERS))
@pytest.mark.parametrize("direction", [90.0, 60.0, 0.0])
def test_a_gently_vibrating_corner_holds_it_for_good(name: str, direction: float) -> None:
    """Gamma = 0.1 keeps the free acceleration within both walls' normals: held as on a table that shakes below g.

    Shaken sideways a ball may also roll to and fro for good in a shallow notch, or be struck by an upright wall.
    """
    tracks, bodies, _ = wedged(CORNERS[name], 0.1, 5.0, np.radians(direction))
    assert np.all(tracks.fate != Fate.STOPPED)
    if direction == 90.0 or name not in ("floor and wall", "notch of 150 deg"):
        assert np.all(tracks.fate == Fate.RESTING), tracks.counts()
        assert tracks.impacts.max() < 300
    never_inside(tracks, bodies)


@pytest.mark.parametrize("name", ["notch of 20 deg", "notch of 150 deg", "two bodies, leaning"])
@pytest.mark.parametrize("direction", [90.0, 60.0, 0.0])
def test_a_granule_laid_in_a_vibrating_corner_stays(name: str, direction: float) -> None:
    """Without friction too: both walls press all the time."""
    motion = shaken(0.1, 30.0, np.radians(direction))
    still, _, _ = wedged(CORNERS[name], 0.0, 60.0)
    some = grains(still.position[:1] + 1e-10, motion.at(np.zeros(1))[1], restitution=0.2, friction=0.0, inertia=0.4)
    bodies = [Body(outline, motion=motion) for outline in CORNERS[name]]
    tracks = track(None, some, until=5.0, bodies=bodies, length=0.05, tolerance=1e-4)
    assert tracks.fate[0] == Fate.RESTING
    np.testing.assert_allclose(tracks.position[0] - motion.at(tracks.time[0])[0], still.position[0], atol=1e-8)


@pytest.mark.parametrize("name", list(CORNERS))
@pytest.mark.parametrize("gamma", [2.0, 10.0, 50.0])
def test_a_wildly_vibrating_corner_throws_it_out_and_nothing_loops(name: str, gamma: float) -> None:
    tracks, bodies, _ = wedged(CORNERS[name], gamma, 2.0)
    assert not np.any(tracks.fate == Fate.RESTING)
    assert np.all(tracks.fate != Fate.STOPPED), (tracks.counts(), tracks.impacts.max())
    never_inside(tracks, bodies)
    assert tracks.steps.max() < 100_000


def test_the_moment_a_wedge_lets_go_is_where_the_acceleration_points_out() -> None:
    """In a symmetric corner shaken upright both walls press as long as g + a(t) > 0, whatever the friction; sideways,
    until the free acceleration leaves the cone of the normals: tan = a / g at 45 degrees of slope.
    """
    corner, gamma, f = [notch(np.pi / 2)], 1.6, 10.0
    omega = 2 * np.pi * f
    height = R * np.sqrt(2)
    for direction, phase in ((np.pi / 2, np.arcsin(1 / gamma)), (0.0, np.arcsin(1 / gamma))):
        motion = shaken(gamma, f, direction)
        rubs = 0.9 if direction > 0 else 0.0  # friction at the other wall alone would hold it
        some = grains([[0.0, height + 1e-9]], motion.at(np.zeros(1))[1], restitution=0.0, friction=rubs)
        bodies = [Body(outline, motion=motion) for outline in corner]
        leaves = phase / omega
        for until, stays in ((leaves - 1e-6, True), (leaves + 2e-3, False)):
            tracks = track(None, some, until=until, bodies=bodies, length=0.05, tolerance=1e-4)
            off = tracks.position[0] - motion.at(until)[0] - [0.0, height]
            assert (np.hypot(*off) < 1e-7) == stays, (direction, stays, off)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_both_sides_of_a_corner_hit_at_once_send_it_straight_back(e: float) -> None:
    """A right-angled corner: one wall after the other turns each component round, in whatever order."""
    some = grains([[0.0, 0.02 + R * np.sqrt(2)]], [[0.0, -1.0]], restitution=e, friction=0.0)
    for corner in (CORNERS["notch of 90 deg"], vee(np.pi / 2)):
        tracks = track(None, some, until=0.03, bodies=corner, gravity=(0.0, 0.0), length=0.05)
        np.testing.assert_allclose(tracks.velocity, [[0.0, e]], atol=1e-9)
        assert tracks.impacts[0] == 2


def test_a_row_of_bodies_hit_at_once_is_one_floor() -> None:
    tiles = [np.array([[x, -0.1], [x + 0.01, -0.1], [x + 0.01, 0.0], [x, 0.0]]) for x in np.arange(-5, 5) * 0.01]
    x = np.concatenate([np.arange(-4, 5) * 0.01, np.arange(-4, 4) * 0.01 + 5e-4])  # on the joints and beside them
    some = grains(np.stack([x, np.full(len(x), 0.03)], axis=1), np.zeros((len(x), 2)), restitution=0.5, friction=0.3)
    tracks = track(None, some, until=20.0, bodies=tiles, length=0.01, record=True)
    assert np.all(tracks.fate == Fate.RESTING)
    np.testing.assert_allclose(tracks.position, np.stack([x, np.full(len(x), R)], axis=1), atol=1e-8)
    never_inside(tracks, [Body(tile) for tile in tiles])


@pytest.mark.parametrize("gamma", STRENGTHS)
@pytest.mark.parametrize("phase", [0.0, 0.5, np.pi / 2, np.pi, -1.0])
def test_a_granule_laid_on_a_body_without_relative_speed(gamma: float, phase: float) -> None:
    """It follows the table where that presses, and flies off where it falls away; no impact, no step into it."""
    base = shaken(gamma)
    motion = None if base is None else Motion(base.amplitude, base.frequency, phase)
    x, v, a = (np.zeros(2),) * 3 if motion is None else (part[0] for part in motion.at(np.zeros(1)))
    bodies = [Body(FLOOR, motion=motion)]
    some = grains([[0.0, x[1] + R]], [v], restitution=0.5, friction=0.5)
    soon = 1e-4
    tracks = track(None, some, until=soon, bodies=bodies, length=0.1, record=True)
    never_inside(tracks, bodies)
    if a[1] < -G - 1.0:
        assert tracks.velocity[0, 1] == pytest.approx(v[1] - G * soon, abs=1e-9)
    elif motion is not None and a[1] > -G + 1.0:
        assert tracks.velocity[0, 1] == pytest.approx(float(motion.at(soon)[1][1]), abs=1e-9)
    assert tracks.impacts[0] <= 1


@pytest.mark.parametrize("mode", ["injected", "resolved"])
@pytest.mark.parametrize("gamma", [0.1, 1.0, 10.0, 50.0])
def test_a_scene_at_any_strength(cases: Path, mode: str, gamma: float) -> None:
    tables = Scene.load(cases / "vacuum.toml").tables()
    tables["vibration"] = {"frequency": 50.0, "gamma": gamma}
    scene = Scene.parse(tables).replace({"feed.mode": mode, "feed.count": 512})
    plan = make_plan(scene)
    for name in scene.fraction:
        feed = feedstock(scene, plan, name, 0.0)
        tracks = Flight(scene, plan, Realisations(None), 1e-4).fly(name, feed.granules)
        assert np.all(tracks.fate == Fate.BINNED), tracks.counts()
        assert tracks.impacts.max() < 1000


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    angle=st.floats(0.0, 89.0), e=st.sampled_from([0.0, 0.3, 0.9, 1.0]) | st.floats(0, 1), friction=st.floats(0, 10),
    gamma=st.sampled_from([0.0, 1.0]) | st.floats(0, 50), direction=st.floats(0, np.pi),
    frequency=st.floats(5.0, 200.0), opening=st.floats(np.radians(10), np.radians(170)), seed=st.integers(0, 1000),
)  # fmt: skip
def test_anything_at_all(
    angle: float, e: float, friction: float, gamma: float, direction: float, frequency: float, opening: float, seed: int
) -> None:
    """A sloping roof and a corner below it, vibrating together, and whatever falls on them."""
    motion = shaken(gamma, frequency, direction)
    bodies = [
        Body(roof(np.radians(angle)) + np.array([0.0, 0.2]), motion=motion),
        *(Body(s, motion=motion) for s in vee(opening)),
    ]
    rng = np.random.default_rng(seed)
    some = grains(
        np.stack([rng.uniform(-0.05, 0.05, 6), rng.uniform(0.5, 0.6, 6)], axis=1), rng.normal([0, -1], 0.5, (6, 2)),
        restitution=e, friction=friction, inertia=rng.choice(INERTIAS, 6), spin=rng.normal(0, 200, 6),
    )  # fmt: skip
    tracks = track(None, some, until=2.0, bodies=bodies, lines=[BELOW], length=0.05, tolerance=1e-4, record=True)
    never_inside(tracks, bodies)
    assert np.all(np.isfinite(tracks.position))
    assert tracks.steps.max() < 200_000
    assert np.all((tracks.fate != Fate.STOPPED) | (tracks.impacts >= 5000))
    if motion is None:
        start = 0.5 * np.sum(some.velocity**2, axis=1) + G * some.position[:, 1]
        spin = np.where(np.isinf(some.inertia), 0.0, 0.5 * 0.4 * (R * some.spin) ** 2)
        assert np.all(0.5 * np.sum(tracks.velocity**2, axis=1) + G * tracks.position[:, 1] <= start + spin + 1e-9)


DECADES = 10.0 ** np.arange(-9.0, 4.0)
DIAMETER = 1e-3  # Re 67 at a slip of 1 m/s
STARTS = 8  # granules that a cost is averaged over


def of_size(tau: float | np.ndarray, position: object, velocity: object) -> Granules:
    """Granules of 1 mm, which stay in the nonlinear range of drag; their density gives the relaxation time."""
    density = 18 * VISCOSITY * np.asarray(tau) / DIAMETER**2
    return Granules(position, velocity, DIAMETER, density, drag_scale=1.0)  # type: ignore[arg-type]


def affine_case(kind: str, span: float, tau: np.ndarray) -> tuple[Setting, np.ndarray]:
    """Flight over ``span`` s through a flow that changes within it, granules with a slip of the flow's own size.

    The air is thin, since the drag table goes on with a constant coefficient above Re = 1e7.
    """
    rate, thin = 0.6 / span, 1e-12
    angle = 2 * np.pi * np.arange(STARTS) / STARTS
    x = 0.4 * np.exp(1j * angle)
    v = rate * (0.2 - 0.5j) * np.exp(1.3j * angle)
    lag, z, w = np.repeat(tau, STARTS), np.tile(x, len(tau)), np.tile(v, len(tau))
    if kind == "rotation":
        field = field_on(box(5), lambda p: rate * np.stack([-p[:, 1], p[:, 0]], axis=1), density=thin)
        end, _ = two_modes(1j * rate, lag, z, w, span)
    else:
        field = field_on(box(5), lambda p: p * [rate, -rate], density=thin)
        end = two_modes(rate, lag, z.real, w.real, span)[0] + 1j * two_modes(-rate, lag, z.imag, w.imag, span)[0]
    grains = of_size(lag, plane(z), plane(w))
    return Setting(field, grains, span, {"forces": ("drag",), "drag": "stokes"}), plane(end)


def plane(z: np.ndarray) -> np.ndarray:
    return np.stack([z.real, z.imag], axis=1)


@pytest.mark.parametrize("span", DECADES)
@pytest.mark.parametrize("kind", ["rotation", "strain"])
def test_any_relaxation_time_in_a_flow_of_any_time_scale(kind: str, span: float) -> None:
    """tau / span from 1e-12 to 1e12: error within the tolerance, cost at most 3 times that at tau = span."""
    setting, exact = affine_case(kind, span, DECADES)
    (alike,) = np.flatnonzero(span == DECADES)
    for tolerance in (1e-3, 1e-5, 1e-7):
        tracks = fly(setting, tolerance)
        assert np.all(tracks.fate == Fate.AIRBORNE)
        assert np.linalg.norm(tracks.position - exact, axis=1).max() < tolerance
        for each in costs(tracks):
            cost = each.reshape(-1, STARTS).mean(axis=1)
            assert cost.max() <= 3 * cost[alike], cost


def costs(tracks: object) -> list[np.ndarray]:
    """Steps, and stage evaluations where they are counted."""
    return [np.asarray(getattr(tracks, name)) for name in ("steps", "evaluations") if hasattr(tracks, name)]


SOME = [1e-9, 1e-4, 1e-2, 1e3]  # the others are slow


def nonlinear_case(kind: str, tau: float, terminal: float) -> Setting:
    """Three granules with an initial slip of about 1 m/s and the weight that gives the terminal velocity (m/s)."""
    reynolds = DENSITY * terminal * DIAMETER / VISCOSITY
    pull = terminal * float(drag_laws["brown-lawler"].factor(np.array(reynolds), 1.0)) / tau
    pull = min(pull, G) if terminal == 0.0 or tau > 1e-2 else pull
    flow = taylor_green if kind == "curved" else (lambda p: p @ np.array([[1.0, -3.0], [2.0, -1.0]]).T + [0.5, -1.0])
    start = np.array([[0.23, 0.61], [-0.31, 0.64], [0.6, 0.7]])
    speed = np.array([[1.5, -1.3], [1.0, 0.3], [-1.0, -0.6]])
    setting = field_on(box(8), flow), of_size(np.full(3, tau), start, speed), 0.15
    return Setting(*setting, {"gravity": (0.0, -pull)})


def check_nonlinear(kind: str, tau: float, terminal: float) -> None:
    setting = nonlinear_case(kind, tau, terminal)
    stiff = tau < 3e-3
    exact = reference_end_states(setting, stiff=stiff, rtol=1e-9 if stiff else 1e-12)[:, :2]
    for tolerance in (1e-3, 1e-5, 1e-7):
        tracks = fly(setting, tolerance)
        assert np.all(tracks.fate == Fate.AIRBORNE)
        error = np.linalg.norm(tracks.position - exact, axis=1)
        assert error.max() < tolerance, error


@pytest.mark.parametrize("tau", SOME)
@pytest.mark.parametrize("kind", ["affine", "curved"])
@pytest.mark.parametrize("terminal", [0.0, 1.0])
def test_nonlinear_drag_at_any_relaxation_time(kind: str, tau: float, terminal: float) -> None:
    """With terminal = 1 m/s the stiffest granules slip at Re 67 all the way: weight and drag of up to 1e10 m/s2."""
    check_nonlinear(kind, tau, terminal)


@pytest.mark.slow
@pytest.mark.parametrize("tau", [tau for tau in DECADES if tau not in SOME])
@pytest.mark.parametrize("kind", ["affine", "curved"])
@pytest.mark.parametrize("terminal", [0.0, 0.1, 1.0])
def test_nonlinear_drag_at_every_relaxation_time(kind: str, tau: float, terminal: float) -> None:
    check_nonlinear(kind, tau, terminal)


def stream(kind: str, cells: int = 20) -> FlowField:
    """Down through a box of 2 m at 3 m/s: what enters leaves, whatever its inertia."""
    if kind == "curved":
        return field_on(box(cells), lambda p: 0.5 * taylor_green(p) + np.array([0.0, -2.2]))
    return field_on(box(cells), lambda p: p @ np.array([[0.3, 0.8], [-0.6, -0.3]]).T + [0.0, -3.0])


TRANSIT = 2.0 / 3.0


# Known to cost more, up to 7 times, and meant to empty: where a step is a few relaxation times long (tau 1 to 10 ms
# here) the scheme loses part of its order, which tight tolerances pay for.
DEAR = [
    (1e-5, 1.0, "brown-lawler", "affine"),  # 3.3 times; confined steps alone 3.1
    (1e-5, 1.0, "brown-lawler", "curved"),
    *[(1e-7, slip, law, kind) for slip in (0.0, 1.0) for law, kind in (
        ("stokes", "curved"), ("brown-lawler", "affine"), ("brown-lawler", "curved"),
    )],
]  # fmt: skip
COSTS = [
    pytest.param(*case, marks=pytest.mark.xfail(strict=True, reason="order reduction")) if case in DEAR else case
    for case in product((1e-3, 1e-5, 1e-7), (0.0, 1.0), ("stokes", "brown-lawler"), ("affine", "curved"))
]


@pytest.mark.parametrize(("tolerance", "slip", "law", "kind"), COSTS)
def test_cost_is_at_most_three_times_that_of_a_transit(tolerance: float, slip: float, law: str, kind: str) -> None:
    field = stream(kind)
    x = np.stack([np.linspace(-0.55, 0.55, 40), np.full(40, 0.95)], axis=1)
    v = field.sample(x)[0] + slip * np.array([0.6, -0.8])

    def cost(tau: float, march: bool = True) -> list[float]:
        tracks = track(field, of_size(tau, x, v), until=2.0, drag=law, tolerance=tolerance, march=march)
        assert np.all(tracks.fate == Fate.ESCAPED)
        assert np.all(np.isfinite(tracks.position))
        return [float(np.mean(c)) for c in costs(tracks)]

    alike = cost(TRANSIT, march=False)  # marching makes heavy granules cheaper still, at loose tolerances dust too
    for tau in DECADES:
        for found, allowed in zip(cost(tau), alike, strict=True):
            assert found <= 3 * allowed, (tau, found, allowed)


def test_the_limit_of_dust_in_strain_is_reached_to_the_second_order() -> None:
    """x' = u + tau (g - Du/Dt) misses the granule's place by O(tau^2); plane strain, where Du/Dt = a^2 x."""
    a, t, x = 3.0, 0.2, np.array([0.2, 0.4])
    field = field_on(box(5), lambda p: p * [a, -a])
    exponent = np.array([a, -a])
    missed = []
    taus = 10.0 ** np.arange(-2.0, -5.5, -0.5)
    for tau in taus:
        drift = exponent - tau * a * a
        shift = np.array([0.0, -G * tau]) / drift
        tracks = track(
            field, of_size(tau, [x], [x * exponent + tau * (np.array([0.0, -G]) - a * a * x)]), until=t,
            drag="stokes", tolerance=1e-12,
        )  # fmt: skip
        missed.append(np.linalg.norm(tracks.position[0] - ((x + shift) * np.exp(drift * t) - shift)))
    scaled = np.array(missed) / taus**2
    assert np.all(scaled > 0.2 * scaled[-1])
    assert np.all(scaled < 5 * scaled[-1]), scaled


def test_the_limit_of_dust_across_kinks_is_reached_to_the_second_order() -> None:
    """Shear U(y) in a falling stream W: x' = U + tau W U', y' = -W - tau g, and U' jumps from row to row."""
    rows, fall, t = 8, 3.0, 0.5
    points, cells = box(rows, jitter=0.0)

    def profile(y: np.ndarray) -> np.ndarray:
        return np.interp(y, np.linspace(-1, 1, rows + 1), 2 * (1 - np.linspace(-1, 1, rows + 1) ** 2))

    field = field_on((points, cells), np.stack([profile(points[:, 1]), np.full(len(points), -fall)], axis=1))
    x, y = -0.6, 0.9
    missed = []
    taus = 10.0 ** np.arange(-2.0, -5.5, -0.5)
    for tau in taus:
        speed = fall + tau * G
        knots = np.unique(np.concatenate([[y, y - speed * t], field.points[:, 1]]).clip(y - speed * t, y))
        carried = np.trapezoid(profile(knots), knots) + tau * fall * (profile(y) - profile(y - speed * t))
        slope = (profile(np.array(y + 1e-6)) - profile(np.array(y - 1e-6))) / 2e-6
        start = [[float(profile(np.array(y)) + tau * fall * slope), -speed]]
        tracks = track(field, of_size(tau, [[x, y]], start), until=t, drag="stokes", tolerance=1e-12)
        missed.append(np.linalg.norm(tracks.position[0] - [x + carried / speed, y - speed * t]))
    scaled = np.array(missed) / taus**2
    assert np.all(scaled < 5 * scaled[-1]), scaled
    assert np.all(scaled > 0.2 * scaled[-1]), scaled


@pytest.mark.parametrize("tau", [1e3, 1e6, 1e9])
def test_the_first_trace_of_air_on_a_heavy_granule_is_right(tau: float) -> None:
    """v = v0 + g t + t (u - v0 - g t / 2) / tau + O(tau^-2) in uniform air: nothing is rounded away."""
    field, v, u, t = field_on(box(6), lambda p: np.tile([2.0, 1.0], (len(p), 1))), np.array([1.0, 0.5]), [2.0, 1.0], 0.3
    g = np.array([0.0, -G])
    tracks = track(field, of_size(tau, [[-0.5, 0.3]], [v]), until=t, drag="stokes")
    trace = tracks.position[0] - (np.array([-0.5, 0.3]) + v * t + 0.5 * g * t * t)
    expected = (t**2 / 2 * (np.array(u) - v) - t**3 / 6 * g) / tau
    np.testing.assert_allclose(trace, expected, rtol=2 * t / tau + 1e-15 * tau, atol=2e-16)


def test_the_ballistic_limit_is_exact() -> None:
    field = field_on(box(12), taylor_green)
    rng = np.random.default_rng(4)
    x, v, t = rng.uniform(-0.4, 0.4, (50, 2)), rng.uniform(-1.5, 1.5, (50, 2)), 0.2
    for law in ("stokes", "brown-lawler"):
        tracks = track(field, of_size(1e20, x, v), until=t, drag=law, tolerance=1e-3)
        np.testing.assert_allclose(tracks.position, x + v * t - 0.5 * t * t * np.array([0.0, G]), atol=1e-14)
        np.testing.assert_allclose(tracks.velocity, v - t * np.array([0.0, G]), atol=1e-13)


@pytest.mark.parametrize("air", [(1.2, 1.8e-5), (1000.0, 1e-3), (1e-6, 1e-12), (1e-3, 1e3)])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_every_size_and_density_gives_numbers(air: tuple[float, float], tolerance: float) -> None:
    density, viscosity = air
    field = field_on(box(6), taylor_green, density=density, viscosity=viscosity)
    d, rho = (grid.ravel() for grid in np.meshgrid(10.0 ** np.arange(-12.0, 4.0), 10.0 ** np.arange(-6.0, 10.0)))
    grains = Granules(np.tile([0.1, 0.2], (len(d), 1)), np.tile([1.0, -3.0], (len(d), 1)), d, rho)
    tracks = track(field, grains, until=1.0, tolerance=tolerance)
    for values in (tracks.position, tracks.velocity, tracks.time):
        assert np.all(np.isfinite(values))
    assert np.all(np.isin(tracks.fate, [Fate.ESCAPED, Fate.AIRBORNE]))
