"""Measured vibration: samples are integrated exactly, move the bodies, and meet the stream with the right phases."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ks_2samp

from support import FLOOR, G
from wakeflow.core.errors import SceneError
from wakeflow.flight import Body, Fate, Granules, Motion, track
from wakeflow.flight.feed.first_contact import first_contact, motion_of
from wakeflow.laws.vibration import integrated
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

RNG = np.random.default_rng(3)
RAGGED = np.concatenate([[0.0], np.cumsum(RNG.uniform(0.2, 1.0, 40))])
RAGGED *= 0.05 / RAGGED[-1]
SHAKEN = RNG.normal(0.0, 15.0, 41)  # m/s2: Gamma about 3 to 4, nothing harmonic about it


def of_a_sine(count: int, gamma: float = 2.0, frequency: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, 1.0 / frequency, count)
    return t, -gamma * G * np.sin(2 * np.pi * frequency * t)


def test_samples_at_any_spacing_are_integrated_exactly() -> None:
    """Finite differences of the displacement give back the acceleration as it was given, less its mean."""
    record = integrated(RAGGED + 7.0, SHAKEN)
    h = np.diff(RAGGED)
    mean = np.sum(0.5 * (SHAKEN[1:] + SHAKEN[:-1]) * h) / 0.05
    np.testing.assert_allclose(record.at(RAGGED[:-1])[2], SHAKEN[:-1] - mean, atol=1e-12)
    middle = RAGGED[:-1] + 0.5 * h
    np.testing.assert_allclose(record.at(middle)[2], 0.5 * (SHAKEN[1:] + SHAKEN[:-1]) - mean, atol=1e-10)
    e = 0.2 * h  # third differences of a cubic are exact
    x = [record.at(middle + k * e)[0] for k in (-2, -1, 0, 1, 2)]
    np.testing.assert_allclose((x[1] - 2 * x[2] + x[3]) / e**2, record.at(middle)[2], atol=1e-6)
    v = (x[0] - 8 * x[1] + 8 * x[3] - x[4]) / (12 * e)
    np.testing.assert_allclose(v, record.at(middle)[1], atol=1e-10)
    just = 0.05 * np.nextafter(1.0, 0.0)
    for part in (0, 1):  # periodic: the end is the beginning
        assert record.at(just)[part] == pytest.approx(float(record.at(0.0)[part]), abs=1e-13)
    points, weights = np.polynomial.legendre.leggauss(3)
    for part in (0, 1):
        sampled = [record.at(RAGGED[:-1] + 0.5 * h * (1 + p))[part] for p in points]
        assert abs(sum(w * np.sum(0.5 * h * s) for w, s in zip(weights, sampled, strict=True))) < 1e-15
    fine = record.at(np.linspace(0, 0.05, 100_001))
    assert record.reach == pytest.approx(np.abs(fine[0]).max(), rel=1e-7)
    assert record.reach >= np.abs(fine[0]).max() * (1 - 1e-12)
    assert record.peak_speed == pytest.approx(np.abs(fine[1]).max(), rel=1e-7)
    assert record.peak_speed >= np.abs(fine[1]).max() * (1 - 1e-12)


def test_samples_of_a_harmonic_give_its_motion_at_second_order() -> None:
    omega, errors = 40 * np.pi, []
    for count in (17, 33, 65):
        motion = Motion.sampled(*of_a_sine(count), direction=(3.0, 4.0))
        t = np.linspace(-0.1, 0.1, 999)
        expected = 2 * G / omega**2 * np.sin(omega * t)[:, None] * [0.6, 0.8]
        errors.append(np.abs(motion.at(t)[0] - expected).max() * omega**2 / (2 * G))
    assert errors[-1] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize(
    ("time", "acceleration", "message"),
    [
        ([0, 1, 2], [0, 1, 0], "3 of them, allowed 4"),
        ([0, 1, 2, 2], [0, 1, 0, 1], "must increase"),
        ([0, 1, 2, 3], [0, 1, 0], "4 times and 3"),
        ([0, 1, 2, 3], [5, 5, 5, 5], "does not change"),
        ([0, 1, 2, float("nan")], [5, 5, 5, 5], "finite"),
    ],
)
def test_bad_samples_are_named(time: list[float], acceleration: list[float], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Motion.sampled(time, acceleration)


def test_a_granule_rides_and_leaves_a_sampled_table_where_the_acceleration_says() -> None:
    """It rests on the table until the table's acceleration, linear between samples, falls below -g; then it flies a
    parabola. A trapezoidal record: the moment is known to round-off.
    """
    t = np.array([0.0, 0.02, 0.04, 0.06, 0.08, 0.1])
    a = np.array([0.0, 1.5, 0.0, -1.5, 0.0, 0.0]) * G  # mean zero: nothing is taken off
    motion = Motion.sampled(t, a)
    start = float(motion.at(0.0)[0][1]) + 1e-3
    grains = Granules([[0.0, start]], motion.at(np.zeros(1))[1], 2e-3, 1000.0, restitution=0.0, friction=0.5)
    leaves = 0.04 + 0.02 / 1.5
    for until in (0.03, leaves - 1e-9):
        rides = track(None, grains, until=until, bodies=[Body(FLOOR, motion=motion)], length=0.1)
        assert rides.position[0, 1] == pytest.approx(float(motion.at(until)[0][1]) + 1e-3, abs=1e-15)
    x, v, _ = (part[1] for part in motion.at(leaves))
    flies = track(None, grains, until=leaves + 0.01, bodies=[Body(FLOOR, motion=motion)], length=0.1)
    assert flies.position[0, 1] == pytest.approx(x + 1e-3 + 0.01 * v - 0.5 * G * 1e-4, abs=1e-13)
    assert flies.velocity[0, 1] == pytest.approx(v - G * 0.01, abs=1e-11)


def test_sliding_on_a_sampled_slope_is_exact_from_sample_to_sample() -> None:
    """Along a frictional table shaken up and down weakly: the wall presses with g + a, so dv = -f (g t + v_wall)."""
    motion = Motion.sampled(RAGGED, 0.3 * G * np.sin(2 * np.pi * RAGGED / 0.05) ** 3)
    f, v0, until = 0.2, 1.0, 0.11
    grains = Granules([[-0.5, float(motion.at(0.0)[0][1]) + 1e-3]], [[v0, float(motion.at(0.0)[1][1])]], 2e-3, 1000.0,
                      restitution=0.0, friction=f)  # fmt: skip
    tracks = track(None, grains, until=until, bodies=[Body(FLOOR, motion=motion)], length=0.1, tolerance=1e-3)
    begin, end = motion.at(0.0), motion.at(until)
    gained = end[1][1] - begin[1][1]
    assert tracks.velocity[0, 0] == pytest.approx(v0 - f * (G * until + gained), abs=1e-12)
    way = v0 * until - f * (0.5 * G * until**2 + end[0][1] - begin[0][1] - begin[1][1] * until)
    assert tracks.position[0, 0] == pytest.approx(-0.5 + way, abs=1e-12)


def test_bounces_on_samples_of_a_harmonic_converge_to_those_on_the_harmonic() -> None:
    f, gamma = 20.0, 2.0
    grains = Granules([[0.0, 0.03]], [[0.0, -0.5]], 2e-3, 1000.0, restitution=0.6, friction=0.0)
    exact = Motion((0.0, gamma * G / (2 * np.pi * f) ** 2), f)
    height = track(None, grains, until=0.2, bodies=[Body(FLOOR, motion=exact)], length=0.1).position[0, 1]
    errors = []
    for count in (33, 65, 129):
        motion = Motion.sampled(*of_a_sine(count, gamma, f))
        tracks = track(None, grains, until=0.2, bodies=[Body(FLOOR, motion=motion)], length=0.1)
        errors.append(abs(tracks.position[0, 1] - height))
    assert errors[-1] < 2e-5
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.4)


def test_nothing_enters_a_body_shaken_by_noise_and_nothing_is_lost() -> None:
    motion = Motion.sampled(RAGGED, SHAKEN, (0.5, 1.0))
    rhombus = 0.025 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    n, rng = 400, np.random.default_rng(2)
    grains = Granules(
        np.stack([rng.uniform(-0.03, 0.03, n), rng.uniform(0.05, 0.1, n)], axis=1), rng.normal([0, -1.0], 0.3, (n, 2)),
        2e-3, 1000.0, restitution=rng.uniform(0, 1, n), friction=rng.uniform(0, 0.9, n),
        inertia=rng.choice([np.inf, 0.4], n), time=rng.uniform(0, 0.1, n),
    )  # fmt: skip
    floor = np.array([[-9.0, -0.3], [9.0, -0.3]])
    tracks = track(None, grains, until=9.0, bodies=[Body(rhombus, motion=motion)], lines=[floor], record=True)
    assert np.all(tracks.fate == Fate.BINNED)
    assert tracks.impacts.max() > 1
    for i in range(n):
        t, x, _ = tracks.path(i)
        seen = np.abs(x - motion.at(t)[0])
        assert np.all(seen.sum(axis=1) > 0.025 + 1e-3 - 1e-12)  # faces of the diamond |x| + |y| = const, and corners


def test_a_field_that_swings_refuses_samples() -> None:
    from wakeflow.air.field import MeshOscillation
    from wakeflow.flight.pack import relative

    with pytest.raises(SceneError, match="by samples"):
        relative(Body(FLOOR, motion=Motion.sampled(*of_a_sine(9))), MeshOscillation(0.0, 1e-3, 100.0, 0.0))
    with pytest.raises(SceneError, match="about a pivot"):
        relative(Body(FLOOR, motion=Motion(0.1, 9.0, pivot=(0.0, 1.0))), MeshOscillation(0.0, 1e-3, 100.0, 0.0))


def contacts_by_tracking(
    passing: np.ndarray, normal: np.ndarray, fall: float, pull: float, motion: Motion, until: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times of first contact with a wide slope through the origin, and the granules' downward speeds then, by the
    tracker: released above all crests, caught by the slope.
    """
    angle = np.arctan2(normal[0], normal[1])
    along, out = np.array([np.cos(angle), -np.sin(angle)]), np.asarray(normal)
    wedge = np.array([9 * along, -9 * along, -9 * along - 5 * out, 9 * along - 5 * out])
    before = 1.3 * np.hypot(*motion.amplitude) / fall / normal[1] + 1e-3
    height, speed = fall * before - 0.5 * pull * before**2, fall - pull * before
    grains = Granules(
        np.stack([0 * passing, height + 0 * passing], axis=1) + 1e-9 * out / normal[1] * [0, 1],
        np.tile([0.0, -speed], (len(passing), 1)), 2e-9, 1000.0, time=passing - before,
    )  # fmt: skip
    tracks = track(None, grains, until=until, bodies=[Body(wedge, motion=motion, capture=True)], length=0.1,
                   gravity=(0.0, -pull))  # fmt: skip
    assert np.all(tracks.fate == Fate.CAPTURED)
    return tracks.time, -tracks.velocity[:, 1]


MOTIONS = {
    "harmonic": lambda speed: Motion((0.0, speed / (2 * np.pi * 40)), 40.0),
    "harmonic askew": lambda speed: Motion((0.6 * speed / (2 * np.pi * 40), 0.8 * speed / (2 * np.pi * 40)), 40.0),
    "samples": lambda speed: Motion.sampled(RAGGED, SHAKEN * speed / integrated(RAGGED, SHAKEN).peak_speed),
}


@pytest.mark.parametrize("name", list(MOTIONS))
@pytest.mark.parametrize("ratio", [0.3, 1.5, 5.0])
def test_injected_phases_are_those_of_resolved_tracks(name: str, ratio: float) -> None:
    """Of a stream uniform in time, at a w / V0 = 0.3, 1.5, 5, under gravity: granule by granule the same contact, so
    the same statistics; and an independent stream that the tracker resolves cannot be told from it.
    """
    fall, n = 1.4, 1500
    motion = MOTIONS[name](ratio * fall)
    period, normal = 1.0 / motion.frequency, (np.sin(0.7), np.cos(0.7))
    passing = 1.0 + (np.arange(n) + 0.5) / n * period
    t, wall = first_contact(np.full(n, fall), np.tile(normal, (n, 1)), passing, motion, G)
    resolved, _ = contacts_by_tracking(passing, np.array(normal), fall, G, motion, 3.0)
    np.testing.assert_allclose(t, resolved, atol=1e-9)
    closing = wall @ normal + (fall + G * (t - passing)) * normal[1]
    assert np.all(closing > -1e-9)
    other = 1.0 + np.random.default_rng(5).uniform(0, period, n)
    phases, _ = contacts_by_tracking(other, np.array(normal), fall, G, motion, 3.0)
    assert ks_2samp(t % period, phases % period).pvalue > 1e-3
    if ratio > 1:  # it is not the weight 1 + V_eta / V_0 any more: part of the period is never met
        met = np.histogram(t % period, bins=40, range=(0, period))[0]
        assert np.sum(met == 0) >= 3


@pytest.fixture
def sampled(cases: Path, tmp_path: Path) -> Scene:
    """The vacuum scene with a vibration by a file beside it."""
    time, acceleration = of_a_sine(41, 2.0, 25.0)
    rows = "".join(f"{t:.9g},{a:.9g}\n" for t, a in zip(time, acceleration, strict=True))
    (tmp_path / "shaker.csv").write_text("time (s),acceleration (m/s2)\n" + rows)
    tables = Scene.load(cases / "vacuum.toml").tables()
    tables["vibration"] = {"samples": "shaker.csv"}
    return Scene.parse(tables, base=tmp_path).replace({"feed.count": 256})


def test_a_scene_takes_samples_from_a_file_and_tells_what_they_are(sampled: Scene, tmp_path: Path) -> None:
    assert sampled.vibration.period == pytest.approx(0.04, rel=1e-6)
    assert sampled.vibration.strength == pytest.approx(2.0, rel=1e-3)
    assert sampled.shaking[1] == pytest.approx(2.0 * G / (50 * np.pi), rel=5e-3)
    sampled.save(tmp_path / "kept.toml")  # the samples go with the scene, not the file's name
    assert Scene.load(tmp_path / "kept.toml") == sampled
    line = next(line for line in make_plan(sampled).used if line.startswith("vibration"))
    assert "25 Hz, Gamma = 2," in line
    motion = motion_of(sampled)
    np.testing.assert_allclose(motion.amplitude, sampled.motion[0])


def test_what_does_not_go_with_samples_is_refused_in_one_line(sampled: Scene, cases: Path, tmp_path: Path) -> None:
    for changes, message in (
        ({"vibration.gamma": 2.0}, "leave out frequency, amplitude and gamma"),
        ({"vibration.samples": "nowhere.csv"}, "cannot read"),
        ({"vibration.samples.acceleration": [0.0, 1.0]}, "give as many of both"),
        ({"vibration.samples.acceleration": [3e5 * (-1) ** i for i in range(41)]}, "allowed 50 g"),
    ):
        with pytest.raises(SceneError, match=message) as caught:
            sampled.replace(changes)
        assert "\n" not in str(caught.value)
    (tmp_path / "bad.csv").write_text("0,1\n0.1,2\nhm,3\n")
    with pytest.raises(SceneError, match=r"bad\.csv, line 3"):
        sampled.replace({"vibration.samples": str(tmp_path / "bad.csv")})
    for text in ("t,a\n0,x\n0.1,2\n", f"0,{'1' * 140_000}\n0,1\n"):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(SceneError, match=r"bad\.csv, line \d( is .*two numbers|: field larger)"):
            sampled.replace({"vibration.samples": str(tmp_path / "bad.csv")})
    tables = Scene.load(cases / "rhombus.toml").tables()
    tables["vibration"] = sampled.tables()["vibration"]
    weak = Scene.parse(tables).replace({"air.speed": 20.0})
    assert not make_plan(weak, rung="standard").airflow.moving  # 1.3 a w / U below 5 %
    strong = weak.replace({"air.speed": 3.0})
    with pytest.raises(SceneError, match=r"follows harmonic vibration only"):
        make_plan(strong, rung="standard")
    assert not make_plan(strong, rung="standard", force={"vibration-of-the-air": False}).airflow.moving


def test_the_plan_warns_of_faces_that_hold_granules(cases: Path) -> None:
    scene = Scene.load(cases / "vacuum.toml")
    assert not [line for line in make_plan(scene).warnings if "face" in line]
    tables = scene.tables()
    tables["body"] = {"box": {"shape": "polygon", "points": [[-0.02, -0.01], [0.02, -0.01], [0.02, 0.0], [0.0, 0.008],
                                                             [-0.02, 0.008]]}}  # fmt: skip
    warnings = make_plan(Scene.parse(tables)).warnings
    assert any("body.box has a level face" in line for line in warnings)
    assert any("friction 0.6 holds soft on its faces of up to 21.8 deg" in line for line in warnings)
    assert not any("holds hard" in line for line in warnings)
