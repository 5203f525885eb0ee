"""Flight without air: exact answers of one body, closed forms for many, nothing entered, no energy made."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from closed_forms import follow
from support import G
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import contains, distance_to
from wakeflow.flight import Body, Fate, Granules, Motion, Tracks
from wakeflow.laws.restitution import Restitution
from wakeflow.laws.shape import shapes

D = 0.05  # m, width of the first body
FLOOR = Body(np.array([(-2.0, -1.0), (2.0, -1.0), (2.0, 0.0), (-2.0, 0.0)]))


def fly(grains: Granules, **how: Any) -> Tracks:
    """Where granules end that the tracker flies without air."""
    return wf.track(None, grains, forces=("gravity",), **how)


def one(x: float, y: float, vx: float = 0.0, vy: float = 0.0, **properties: object) -> Granules:
    """One granule of 2 mm."""
    given = {"diameter": 2e-3, "density": 1000.0, "restitution": 0.0, "friction": 0.0, **properties}
    return Granules(position=np.array([(x, y)]), velocity=np.array([(vx, vy)]), **given)


def slope(angle: float, length: float = 1.0) -> Body:
    """A slope that descends towards +x from the origin."""
    end = length * np.array([math.cos(angle), -math.sin(angle)])
    return Body(np.array([(0.0, 0.0), (0.0, end[1] - 1.0), (end[0], end[1] - 1.0), tuple(end)]))


def on_slope(angle: float, along: float, speed: float, **properties: object) -> Granules:
    """A granule that touches the slope ``along`` (m) from its upper end and moves down it at ``speed``."""
    t, n = np.array([math.cos(angle), -math.sin(angle)]), np.array([math.sin(angle), math.cos(angle)])
    (x, y), (vx, vy) = along * t + 1e-3 * n, speed * t
    return one(x, y, vx, vy, **properties)


def test_granules_born_inside_or_touching() -> None:
    box = Body(np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    assert fly(one(0.0, 0.5), until=1.0, bodies=[box]).fate[0] == Fate.STOPPED
    assert fly(one(0.0, 1.0005, 0.0, -1.0), until=1.0, bodies=[box]).fate[0] == Fate.RESTING
    caught = fly(one(0.0, 2.0), until=9.0, bodies=[Body(box.outline, capture=True)])
    assert caught.fate[0] == Fate.CAPTURED
    assert caught.position[0, 1] == pytest.approx(1.001)


@pytest.mark.parametrize("slab", [None, wf.Collisions(0.1, tracers=(0,))], ids=["alone", "in a slab"])
@pytest.mark.parametrize("bounces", [0, 1, 3])
def test_a_granule_stays_at_the_first_bounce_below_its_capture_speed(bounces: int, slab: wf.Collisions | None) -> None:
    """It meets the floor at sqrt(2 g h), and after n bounces at e^n of it; a height 0.1 % larger gives one more."""
    e, limit = 0.6, 1.5
    height = (limit / e**bounces) ** 2 / (2 * G)
    for part, impacts in ((0.999, bounces), (1.001, bounces + 1)):
        ball = one(0.0, part * height + 1e-3, restitution=e, capture_speed=limit)
        ended = fly(ball, until=9.0, bodies=[FLOOR], collisions=slab)
        assert ended.fate[0] == Fate.CAPTURED
        assert ended.impacts[0] == impacts
        assert ended.position[0] == pytest.approx((0.0, 1e-3), abs=1e-6)


def test_only_the_normal_speed_over_the_wall_counts() -> None:
    """On a steep slope v cos b; on a table that comes towards it or goes away, what the two close in with."""
    drop = one(0.5 * math.cos(STEEP) + 1e-3 * OUT[0], 0.0, 0.0, -1.0, capture_speed=0.7)
    touch = -0.5 * math.sin(STEEP) + 1e-3 * OUT[1] + 1e-9
    drop = drop.replace(position=np.array([(drop.position[0, 0], touch)]))
    assert fly(drop, until=0.01, bodies=[slope(STEEP)]).fate[0] == Fate.CAPTURED  # cos 50 deg = 0.64
    assert fly(drop.replace(capture_speed=0.6), until=0.01, bodies=[slope(STEEP)]).fate[0] != Fate.CAPTURED
    speed = 0.5 * G / (2 * math.pi * 15.0)  # of the table, upwards at time 0
    ball = one(0.0, 1e-3 + 1e-9, 0.0, -0.5, capture_speed=0.5 + speed)
    for limit, stays in ((1.02, True), (0.98, False)):
        ended = fly(ball.replace(capture_speed=limit * (0.5 + speed)), until=0.01, bodies=[shaken(FLOOR, 0.5)])
        assert bool(ended.fate[0] == Fate.CAPTURED) is stays


def maze(motion: Motion | None) -> tuple[list[Body], list[np.ndarray]]:
    """A rhombus, two prisms, a plate, walls, and two bins below."""
    bodies = [Body(shapes["rhombus"](width=D, slope_angle=math.pi / 4), motion=motion)]
    prism = shapes["prism"](width=D, slope_angle=math.pi / 3)
    bodies += [Body(prism + np.array(at), motion=motion) for at in ((-0.06, -0.08), (0.06, -0.08))]
    plate = shapes["plate"](length=0.1, thickness=3e-3, slope_angle=math.radians(27))
    plate = plate + np.array((-0.14, -0.17))
    bodies += [Body(plate), Body(plate * np.array((-1.0, 1.0)))]
    wall = np.array([(0.2, -1.0), (0.25, -1.0), (0.25, 1.0), (0.2, 1.0)])
    bodies += [Body(wall), Body(wall * [-1, 1])]
    return bodies, [np.array([(-0.3, -0.3), (0.0, -0.3)]), np.array([(0.0, -0.3), (0.3, -0.3)])]


def curtain(count: int, **properties: object) -> Granules:
    rng = np.random.default_rng(1)
    given = {
        "diameter": rng.uniform(1e-3, 4e-3, count), "density": 1000.0, "restitution": rng.uniform(0, 0.9, count),
        "friction": 0.3, "time": rng.uniform(0, 0.2, count), **properties,
    }  # fmt: skip
    position = np.stack([rng.uniform(-0.02, 0.02, count), np.full(count, 0.1)], axis=1)
    return Granules(position=position, velocity=np.zeros((count, 2)), **given)


def shaken(body: Body, strength: float, direction: Any = (0.0, 1.0), frequency: float = 15.0) -> Body:
    """The body, vibrating with so many g at most."""
    size = strength * G / (2 * math.pi * frequency) ** 2
    return Body(body.outline, motion=Motion(tuple(size * np.asarray(direction)), frequency))


STEEP, FLAT, LOW = math.radians(50), math.radians(20), np.array([(-9.0, -2.0), (9.0, -2.0)])
DOWN, OUT = (math.cos(FLAT), -math.sin(FLAT)), (math.sin(STEEP), math.cos(STEEP))
TABLE = Body(np.array([(-1.0, -0.5), (0.0, -0.5), (0.0, 0.0), (-1.0, 0.0)]))
BALL = {"inertia": 0.4, "friction": 0.2}
STAYS: dict[str, tuple[Body, Granules, float]] = {  # what a granule is on, the granule, until when (s)
    "slides down and leaves": (slope(STEEP), on_slope(STEEP, 0.2, 0.0, friction=0.3), 2.0),
    "slides up and turns": (slope(STEEP), on_slope(STEEP, 0.9, -1.5, friction=0.2), 2.0),
    "is held below the angle of friction": (slope(FLAT), on_slope(FLAT, 0.5, 0.0, friction=0.37), 2.0),
    "is not above it": (slope(FLAT), on_slope(FLAT, 0.5, 0.0, friction=0.36), 2.0),
    "stops uphill": (slope(FLAT), on_slope(FLAT, 0.8, -1.0, friction=0.5), 2.0),
    "slips and spins up": (slope(STEEP), on_slope(STEEP, 0.1, 0.0, **BALL), 0.3),
    "rolls": (slope(FLAT), on_slope(FLAT, 0.1, 0.0, **{**BALL, "inertia": 0.5}), 0.4),
    "rolls over an edge": (TABLE, one(-1e-3, 1e-3, 0.05, **BALL, spin=-50.0), 2.0),
    "rides a gentle table": (shaken(FLOOR, 0.9), one(0.0, 1e-3, 0.0, 0.9 * G / (30 * math.pi), friction=0.5), 2.0),
    "is thrown by a hard one": (shaken(FLOOR, 1.3), one(0.0, 1e-3, 0.0, 1.3 * G / (30 * math.pi), friction=0.5), 0.33),
    "is held sideways": (shaken(FLOOR, 0.45, (1, 0)), one(0.0, 1e-3, 0.45 * G / (30 * math.pi), friction=0.5), 2.0),
    "sticks and slips": (shaken(FLOOR, 0.6, (1, 0)), one(0.0, 1e-3, 0.6 * G / (30 * math.pi), friction=0.3), 0.4),
    "slides on a slope that presses more and less":
        (shaken(slope(STEEP), 0.45, OUT), on_slope(STEEP, 0.1, 0.0, friction=0.2), 0.5),
    "rolls on one that is shaken along": (shaken(slope(FLAT), 0.5, DOWN), on_slope(FLAT, 0.1, 0.0, **BALL), 0.4),
}  # fmt: skip


@pytest.mark.parametrize("name", list(STAYS))
def test_what_stays_on_a_wall_moves_as_closed_forms_say(name: str) -> None:
    """It slides, rolls, sticks, turns round corners and leaves, on walls at rest and on such as vibrate."""
    body, grains, until = STAYS[name]
    if body.motion is not None:  # born with the wall's velocity
        grains = grains.replace(velocity=body.motion.at(np.zeros(1))[1])
    how: dict[str, Any] = {"until": until, "bodies": [body], "lines": [LOW], "length": 0.1, "tolerance": 1e-8}
    ours, theirs = fly(grains, **how), follow(grains, **how)
    assert (ours.fate[0], ours.line[0]) == (theirs.fate[0], theirs.line[0])
    ends = [[one.position, one.velocity] for one in (ours, theirs)]
    if ours.fate[0] == Fate.RESTING and body.motion is not None:  # seen at different times: to the wall
        walls = [body.motion.at(one.time)[:2] for one in (ours, theirs)]
        ends = [[end[i] - wall[i] for i in range(2)] for end, wall in zip(ends, walls, strict=True)]
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-8)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-6)
    np.testing.assert_allclose(ours.spin, theirs.spin, atol=1e-3)


@pytest.mark.parametrize("inertia", [None, 0.4])
def test_it_meets_what_closed_forms_meet(inertia: float | None) -> None:
    """Two programs with nothing in common but the law of impact; bodies vibrate, granules bounce, slide, roll."""
    bodies, lines = maze(Motion((0.3e-3, 2e-3), 30.0, 0.3))
    agree(curtain(24, inertia=inertia), until=3.0, bodies=bodies, lines=lines, length=D)


def agree(grains: Granules, **how: Any) -> None:
    """Hold the tracker's answer against that of the closed forms, granule by granule."""
    ours, theirs = fly(grains, **how), follow(grains, **how)
    off = np.linalg.norm(ours.position - theirs.position, axis=1) / D
    assert np.sum(off > 1e-6) <= 1  # a grazed corner or a hop more or less makes another path
    assert np.sum(ours.impacts != theirs.impacts) <= 1
    assert np.median(off) < 1e-10
    assert np.sum(ours.fate != theirs.fate) <= 1


def test_scatter_is_numbered_by_granule_and_impact_whatever_the_threads_and_steps() -> None:
    """Angles are numbered by seed, granule and impact: closed forms draw them too, and so does any thread."""
    bodies, lines = maze(Motion((0.3e-3, 2e-3), 30.0, 0.3))
    grains = curtain(300, inertia=0.5, scatter=0.15, tangential_restitution=0.3)
    how = {"until": 3.0, "bodies": bodies, "lines": lines, "length": D, "seed": 11}
    agree(grains[:24], **how)
    tracks = fly(grains, **how)
    np.testing.assert_array_equal(fly(grains, workers=1, **how).position, tracks.position)
    smooth = fly(grains.replace(scatter=0.0), **how)
    assert np.mean(np.linalg.norm(smooth.position - tracks.position, axis=1) > 0.1 * D) > 0.5
    other = fly(grains, **{**how, "seed": 12})
    assert np.mean(other.position[:, 0] != tracks.position[:, 0]) > 0.9
    assert np.all(tracks.fate != Fate.STOPPED)


def test_scatter_does_not_shake_what_slides() -> None:
    """Granules bounce ever lower on a slope, with scatter, and slide in the end: on from there as without scatter."""
    angle, friction = math.radians(40), 0.3
    t, n = np.array([math.cos(angle), -math.sin(angle)]), np.array([math.sin(angle), math.cos(angle)])
    start = 0.2 * t + 3e-3 * n
    grains = Granules(
        np.tile(start, (200, 1)), np.zeros((200, 2)), 2e-3, 1000.0, restitution=0.3, friction=friction, scatter=0.2
    )
    how = {"until": 0.25, "tolerance": 1e-9, "length": 1.0, "bodies": [slope(angle)]}
    end = fly(grains, **how)
    assert end.impacts.max() < 60
    np.testing.assert_allclose((end.position @ n), 1e-3, atol=1e-9)
    np.testing.assert_allclose((end.velocity @ n), 0.0, atol=1e-9)
    assert np.std(end.velocity @ t) > 1e-3
    sliding = grains.replace(position=np.tile(0.2 * t + 1e-3 * n, (200, 1)))
    way = 0.5 * G * (math.sin(angle) - friction * math.cos(angle)) * 0.25**2
    np.testing.assert_allclose(fly(sliding, **how).position @ t, 0.2 + way, atol=1e-9)


def test_a_restitution_law_is_looked_up_at_each_impact() -> None:
    """Bounces of e = 0.6 v^-1/4: each rises by its own speed, 0.6 v^3/4."""
    law = Restitution("power", value=0.6, at=1.0)
    grain, line = one(0.0, 0.5 + 1e-3, restitution=law), np.array([(-1.0, 0.3), (1.0, 0.3)])
    speed, time = math.sqrt(2 * G * 0.5), math.sqrt(2 * 0.5 / G)
    for _ in range(3):
        speed *= float(law(np.array([speed]))[0])
        time += 2 * speed / G
    end = fly(grain, until=time, tolerance=1e-12, length=1.0, bodies=[FLOOR], lines=[line + 1.0])
    assert end.fate[0] == Fate.AIRBORNE
    assert end.position[0, 1] == pytest.approx(1e-3, abs=1e-11)  # at the floor a fourth time, to the tracker's skin
    assert abs(end.velocity[0, 1]) == pytest.approx(speed, rel=1e-7) or end.impacts[0] == 4  # of the table


@pytest.mark.parametrize("friction", [0.0, 0.3, 10.0])
def test_nothing_is_entered_and_no_energy_is_made(friction: float) -> None:
    bodies, lines = maze(None)
    rng = np.random.default_rng(2)
    grains = curtain(48, friction=friction, restitution=rng.choice([0.0, 0.5, 1.0], 48), spin=rng.normal(0, 100, 48))
    grains = grains.replace(inertia=np.where(np.arange(48) % 2, 0.4, np.inf))
    end = fly(grains, until=20.0, tolerance=1e-5, bodies=bodies, lines=lines, record=True)
    assert np.all(end.fate != Fate.STOPPED)
    for i in range(len(grains)):
        _, x, v = end.path(i)
        turning = 0.5 * grains.diameter[i] ** 2 / 4 * (0.4 if i % 2 else 0.0)
        energy = G * x[:, 1] + 0.5 * (v**2).sum(axis=1)
        most = energy[0] + turning * grains.spin[i] ** 2
        assert energy.max() <= most * (1 + 1e-12)
        if not i % 2:
            assert np.all(np.diff(energy) <= 1e-8)
        for body in bodies:
            assert not contains(body.outline, x).any()
            assert distance_to(x, body.outline).min() >= 0.5 * grains.diameter[i] * (1 - 1e-9) - 1e-10


def test_the_labyrinth_without_its_air(cases: Path) -> None:
    """Of the paper's granules: kernels that scatter and roll leave their way more often."""
    scene = wf.Scene.load(cases / "labyrinth.toml", {"fraction.*.impact": "paper"})
    found = wf.chain(scene, count=512)
    for name, row in found.separation["fractions"].items():
        assert sum(entry["value"] for entry in row.values()) == pytest.approx(1.0, abs=1e-12)
        (left, *_), (right, *_) = found.share(name, "left"), found.share(name, "right")
        assert abs(left - right) <= 2 * (row["left"]["high"] - row["left"]["low"])
    assert found.share("wheat", "middle")[0] > 0.95
    assert found.share("chaff", "middle")[0] < 0.05
    assert found.landings["wheat"].impacts.mean() > 2.0  # the rhombus, then a plate
    rows = {row.fraction: row.bound for row in found.plan.left_out if row.name == "air"}
    assert set(rows) == set(scene.fraction)
    assert rows["chaff"] > rows["straw"] > rows["wheat"] > 0.1
    warned = [line for line in found.plan.warnings if "leaves the air out" in line]
    assert len(warned) == 3


def test_upward_air_that_carries_a_fraction_is_said_to_be_missing(cases: Path) -> None:
    plan = wf.plan(wf.Scene.load(cases / "prism.toml"), rung="none")
    carried = {row.fraction for row in plan.left_out if "carry it up" in row.why}
    assert carried == {"dust", "chaff"}
    assert plan.airflow.kind == "none"
    assert not plan.airflow.stepping
    assert {how.forces for how in plan.fractions.values()} == {("gravity",)}


def test_rung_none_needs_no_mesher_and_says_what_it_waits_for(cases: Path, tmp_path: Path) -> None:
    code = (
        "import sys, json; from wakeflow.cli import main\n"
        f"code = main(['run', {str(cases / 'labyrinth.toml')!r}, '--rung', 'none', '--set',"
        f" 'feed.count=64', '--until', 'tracks', '--out', {str(tmp_path / 'run')!r}])\n"
        f"table = json.load(open({str(tmp_path / 'run' / 'result.json')!r}))\n"
        "assert code == 0 and table['airflow'] is None and table['scene']['air']['speed'] == 3.0\n"
        "assert 'air' in [one['name'] for one in table['plan']['left_out']]\n"
        "assert not {'gmsh', 'foamlib'} & set(sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert "from the cache" in ended.stderr  # the tracker, or with an earlier suite's cache the tracks


def test_a_plate_lies_as_it_says() -> None:
    right = shapes["plate"](length=2.0, thickness=0.2, slope_angle=math.radians(30))
    left = shapes["plate"](length=2.0, thickness=0.2, slope_angle=math.radians(30), descends="left")
    np.testing.assert_allclose(
        np.ptp(right, axis=0), [2 * math.cos(math.pi / 6) + 0.1, 1.0 + 0.2 * math.cos(math.pi / 6)]
    )
    assert right[np.argmax(right[:, 0]), 1] < 0 < left[np.argmax(left[:, 0]), 1]
    assert {tuple(p) for p in (left * [-1, 1]).round(12)} == {tuple(p) for p in right.round(12)}
    with pytest.raises(SceneError, match=r"thickness = 3 m is more than length"):
        shapes["plate"](length=2.0, thickness=3.0, slope_angle=0.5)


def test_a_plate_keeps_clear_of_the_wall(cases: Path) -> None:
    scene = wf.Scene.load(cases / "labyrinth.toml")
    with pytest.raises(SceneError, match=r"body.left-plate .*leave a gap"):
        scene.replace({"body.left-plate.at": [-0.131, -0.14]})
    with pytest.raises(SceneError, match=r"plate.* lacks thickness"):
        scene.replace({"body.left-plate": {"shape": "plate", "length": 0.06, "slope_angle": 0.9}})
