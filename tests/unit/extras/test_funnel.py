"""The feed funnel: laws, geometry, rates from curves; with LIGGGHTS also the vibrating wall and a small discharge."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from proofs import funnel
from proofs.funnel import bounce_phase, lift_off_phase, on_plate
from wakeflow.cli import main
from wakeflow.core.errors import ProgramError, SceneError
from wakeflow.core.store import Store, cache_root
from wakeflow.extras.doctor import examination as doctor
from wakeflow.extras.funnel import engine
from wakeflow.extras.funnel.engine import (
    SIDES,
    Curve,
    cone_of,
    loose_heap,
    rate_of,
    read_dump,
    time_to_empty,
    write_stl,
)
from wakeflow.extras.funnel.pour import Liggghts, packing_fraction, read_bed
from wakeflow.laws.collision import contact_time
from wakeflow.laws.constants import GRAVITY
from wakeflow.laws.streams import beverloo, cone_factor
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Funnel, Scene

SMALL: dict[str, Any] = {"count": 150, "orifice": 0.0072, "rolling_friction": 0.01, "frequency": 35.0, "gamma": 3.0}


@pytest.mark.parametrize(("orifice", "grams"), [(0.006, 3.34), (0.008, 8.65), (0.010, 17.2), (0.012, 29.5)])
def test_beverloo_gives_the_usual_rates(orifice: float, grams: float) -> None:
    """Worked by hand for beads of 1.2 mm in a bed of 1500 kg/m3."""
    assert 1e3 * beverloo(orifice, 1.2e-3, 1500.0) == pytest.approx(grams, rel=0.01)


def test_beverloo_scales_and_ends() -> None:
    wide = beverloo(1.0, 1e-9, 1500.0)
    assert beverloo(2.0, 1e-9, 1500.0) / wide == pytest.approx(2**2.5, rel=1e-6)
    assert beverloo(0.0016, 1.2e-3, 1500.0) == 0.0
    assert cone_factor(math.radians(30)) == pytest.approx(math.tan(math.radians(30)) ** -0.35)
    assert cone_factor(math.radians(45)) == cone_factor(math.radians(70)) == 1.0  # flat, and continuous there


def test_hertz_is_the_collision_it_says() -> None:
    """Its duration against the equation of motion m x'' = -4/3 E sqrt(R) x^1.5, integrated."""
    from scipy.integrate import solve_ivp

    d, rho, modulus, speed, nu = 1.2e-3, 2500.0, 5e6, 0.5, 0.25
    mass, stiff = rho * math.pi / 12 * d**3, 4 / 3 * modulus / (2 * (1 - nu**2)) * math.sqrt(d / 4)

    def out(t: float, y: Any) -> float:
        return float(y[0])

    out.terminal, out.direction = True, -1  # type: ignore[attr-defined]
    found = solve_ivp(
        lambda t, y: [y[1], -stiff / mass * max(y[0], 0.0) ** 1.5], (0, 1), [1e-15, speed], events=out, rtol=1e-10,
        atol=1e-14,
    )  # fmt: skip
    assert contact_time(d, rho, modulus, speed, nu) == pytest.approx(found.t[-1], rel=1e-3)


def test_the_papers_beads() -> None:
    paper = Funnel()
    assert paper.beads == pytest.approx(15_470, rel=0.01)  # 35 g of 1.2 mm; <d^3> of 1.1 to 1.3 mm is 0.7 % more
    assert paper.total_mass == pytest.approx(0.035, rel=1e-4)
    shaken = Funnel(frequency=5.0, gamma=1.0)
    assert shaken.amplitude == pytest.approx(9.94e-3, rel=1e-3)
    assert Funnel(frequency=5.0).amplitude == 0.0


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"funnel.gamma": 1.0}, "needs a frequency"),
        ({"funnel.orifice": "2 mm"}, "side by side"),
        ({"funnel.low": "2 mm"}, "must not be above high"),
        ({"funnel.mass": "1 g", "funnel.count": 100}, "either mass or count"),
        ({"funnel.mass": "1 kg"}, "allowed: 10 to 50000"),
        ({"funnel.width": "12 mm"}, "1.5 times orifice"),
        ({"funnel.restitution": 0.05}, r"restitution = 0.05: too small \(allowed: > 0.05"),
        ({"funnel.engine": 1}, "unknown key"),
    ],
)
def test_wrong_tables_say_why(cases: Path, changes: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError, match=told):
        Scene.load(cases / "vacuum.toml").replace(changes)


def test_the_feed_takes_the_funnels_rate(cases: Path) -> None:
    scene = Scene.load(cases / "funnel.toml")
    assert not scene.feed.rate
    assert scene.fed(0.02).feed.mass_flow == 0.02
    assert scene.fed().feed.mass_flow == scene.funnel.expected_rate  # type: ignore[union-attr]
    own = scene.replace({"feed.rate": 0.2})
    assert own.fed(0.02) is own
    assert any("LIGGGHTS" in line for line in make_plan(scene).used)


def test_beads_that_are_not_computed_leave_the_funnel_by_beverloos_law(cases: Path, tmp_path: Path) -> None:
    """The answer says so."""
    scene = wf.Scene.load(cases / "funnel.toml", {"funnel.computed": False, "feed.count": 64})
    result = wf.run(scene, out=tmp_path, rung="none", force={"collisions": False}, report=False)
    assert result.funnel is None
    assert not {"bed", "funnel"} & set(result.seconds)
    assert any("Beverloo's law" in line for line in result.warnings)
    assert scene.funnel is not None
    flow = sum(result.table["separation"]["throughput"].values())
    assert flow == pytest.approx(3600.0 * scene.funnel.expected_rate, rel=1e-6)
    with pytest.raises(SceneError, match="beads are not computed"):
        wf.run(scene, out=tmp_path, until="funnel")


@pytest.mark.parametrize("changes", [{}, {"half_angle": 1.2}, {"width": 0.02}, {"low": 1.0e-3, "high": 2.0e-3}])
def test_the_loose_heap_touches_nothing(changes: dict[str, Any]) -> None:
    from scipy.spatial import cKDTree

    funnel = Funnel(count=800, **changes)
    cone = cone_of(funnel)
    centres, diameters, _ = loose_heap(funnel)
    assert len(centres) == 800
    pairs = cKDTree(centres).query_pairs(funnel.high, output_type="ndarray")
    assert (
        len(pairs) == 0
        or (np.linalg.norm(np.diff(centres[pairs], axis=1)[:, 0], axis=1) > diameters[pairs].mean(axis=1)).all()
    )
    assert (centres[:, 2] > diameters / 2).all()
    assert centres[:, 2].max() < cone.brim
    assert (cone.room(centres) > 0.999 * diameters / 2).all()
    assert diameters.min() >= funnel.low
    assert diameters.max() <= funnel.high


def test_the_walls_are_whole(tmp_path: Path) -> None:
    """The lid has the circle's area, the cone its surface; no gap in the wall but its two ends."""
    funnel = Funnel(count=500)
    cone = cone_of(funnel)
    write_stl(tmp_path, cone)

    def triangles(name: str) -> Any:
        words = [line.split() for line in (tmp_path / name).read_text().splitlines()]
        return np.array([row[1:] for row in words if row[0] == "vertex"], dtype=float).reshape(-1, 3, 3)

    def area(corners: Any) -> float:
        return float(np.linalg.norm(np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), axis=1).sum() / 2)

    assert area(triangles("lid.stl")) == pytest.approx(math.pi * cone.outlet**2, rel=1e-6)
    slanted = math.pi * (cone.widest**2 - cone.outlet**2) / math.sin(funnel.half_angle)
    straight = 2 * math.pi * cone.widest * (cone.brim - cone.top)
    wall = triangles("cone.stl")
    assert area(wall) == pytest.approx(slanted + straight, rel=0.01)
    edges = np.sort(np.unique(wall.reshape(-1, 3).round(9), axis=0, return_inverse=True)[1].reshape(-1, 3), axis=1)
    pairs = np.concatenate([edges[:, [0, 1]], edges[:, [1, 2]], edges[:, [0, 2]]])
    _, count = np.unique(pairs, axis=0, return_counts=True)
    assert sorted(np.unique(count)) == [1, 2]
    assert (count == 1).sum() == 2 * SIDES  # outlet and brim


def _curve(rate: float, pulse: float = 0.0, period: float = 0.05, noise: float = 0.0, seed: int = 0) -> Curve:
    """1 g that leaves at ``rate`` (g/s), pulsating, with white noise in the flow."""
    time = np.arange(0.0, 1.2 / rate, 5e-4)
    wave = pulse * period / (2 * math.pi) * (1 - np.cos(2 * math.pi * time / period))
    walk = noise * np.cumsum(np.random.default_rng(seed).normal(0, math.sqrt(5e-4), len(time)))
    mass = np.maximum(0.0, 1.0 - rate * (time + wave) - walk)
    return Curve(time, mass, np.ceil(1000 * mass))


def test_the_rate_of_a_steady_and_of_a_pulsating_flow() -> None:
    steady = rate_of(_curve(2.0), 1.0, 0.0)
    assert steady.value == pytest.approx(2.0, rel=1e-6)
    assert time_to_empty(_curve(2.0), 1.0) == pytest.approx(0.495, abs=1e-3)
    pulsating = rate_of(_curve(1.0, pulse=0.9, period=0.07), 1.0, 0.07)
    assert pulsating.value == pytest.approx(1.0, rel=0.01)  # whole periods: the pulse drops out
    assert pulsating.high - pulsating.value < 0.02


def test_the_interval_of_the_rate_covers_it() -> None:
    found = [rate_of(_curve(1.0, noise=0.05, seed=seed), 1.0, 0.0) for seed in range(300)]
    covered = np.mean([rate.low <= 1.0 <= rate.high for rate in found if rate and rate.known])
    assert 0.91 < covered < 0.98


def test_a_short_or_stopped_flow_claims_nothing() -> None:
    short = rate_of(_curve(1.0, pulse=0.5, period=0.3), 1.0, 0.3)
    assert not short.known
    stopped = Curve(np.linspace(0, 1, 100), np.linspace(1.0, 0.6, 100), np.full(100, 60.0))
    assert not rate_of(stopped, 1.0, 0.0)
    assert math.isnan(time_to_empty(stopped, 1.0))


def test_without_the_engine_one_line_says_what_to_install(
    cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.liggghts_version.cache_clear()
    monkeypatch.setattr(engine, "PROGRAM", "liggghts-that-is-not-there")
    try:
        assert main(["run", str(cases / "funnel.toml"), "--out", str(tmp_path), "--until", "funnel", "--quiet"]) == 3
        line = capsys.readouterr().err.splitlines()[0]
        assert "apt-get install --no-install-recommends liggghts" in line
        finding = doctor._tried("liggghts")
        assert (finding.ok, finding.optional, finding.mend) == (False, True, engine.INSTALL)
    finally:
        engine.liggghts_version.cache_clear()


@pytest.mark.liggghts
def test_a_lying_bead_leaves_the_plate_at_its_phase(tmp_path: Path) -> None:
    """While it lies the plate presses with m (g + z''); it leaves at sin(phase) = 1 / Gamma, the nearer the stiffer."""
    errors = []
    for modulus in (5e6, 5e7):
        funnel = Funnel(count=10, frequency=30.0, gamma=1.3, restitution=0.5, youngs_modulus=modulus)
        found = on_plate(funnel, tmp_path / f"{modulus:g}", 4)
        lying = (found.end - found.start) > 0.3 / 30
        phases = found.phase(found.pressed[lying])
        assert len(phases) >= 2
        errors.append(np.abs(phases - lift_off_phase(1.3)).max())
        i = np.flatnonzero((found.time > found.end[lying][0]) & (found.time < found.pressed[lying][1]))
        last = i[(found.phase(found.time[i]) < 0.7) & (found.time[i] > found.pressed[lying][1] - 0.005)]
        assert found.force[last] == pytest.approx(1 - 1.3 * np.sin(found.omega * found.time[last]), abs=0.003)
    assert errors[0] < 0.02  # rad; softened contacts let go late, by E^(-2/7)
    assert errors[1] < 0.65 * errors[0]


@pytest.mark.liggghts
def test_a_bead_bounces_once_a_period_as_it_should(tmp_path: Path) -> None:
    gamma, e, f = 1.3, 0.5, 30.0
    funnel = Funnel(count=10, frequency=f, gamma=gamma, restitution=e, steps_per_contact=100)
    phase, omega = bounce_phase(gamma, e), 2 * math.pi * f
    since = 1 / f - phase / omega  # s since the bounce before the start
    up = GRAVITY / (2 * f)
    height = funnel.amplitude * math.sin(phase) + up * since - GRAVITY * since**2 / 2
    found = on_plate(funnel, tmp_path, 20, height=height, speed=up - GRAVITY * since)
    assert len(found.start) == 20
    assert np.mean(found.phase(found.middle)) == pytest.approx(phase, abs=0.012)
    flight = 1 / f - (lasting := np.mean(found.end - found.start))  # it ends lower than it began: the plate rises
    down = GRAVITY * flight / 2 + found.speed * math.cos(phase) * lasting / flight
    assert np.mean(found.before) == pytest.approx(-down, rel=1e-3)
    assert found.before == pytest.approx(np.full(20, -up), rel=0.01)
    assert found.restitution == pytest.approx(np.full(20, e), abs=0.003)


@pytest.mark.liggghts
def test_a_small_bed_runs_out(cases: Path, tmp_path: Path) -> None:
    """Every bead is accounted for, none passes the wall, the rate is near Beverloo's and feeds the scene's bins."""
    changes = {f"funnel.{key}": value for key, value in SMALL.items()}
    scene = Scene.load(cases / "vacuum.toml").replace({**changes, "feed.count": 64})
    scene = Scene.parse({**scene.tables(), "feed": {k: v for k, v in scene.tables()["feed"].items() if k != "rate"}})
    result = wf.run(scene, tmp_path / "run")
    table = result.table["funnel"]
    assert (table["verdict"], table["left"], table["beads"]) == ("emptied", 0, 150)
    assert table["mass"] == pytest.approx(scene.funnel.total_mass, rel=0.05)  # type: ignore[union-attr]
    assert table["curve"]["mass"][0] == pytest.approx(table["mass"], rel=1e-6)
    assert 0.5 < table["packing"] < 0.70
    assert table["overlap"] < 0.05
    assert 0.6 < table["rate"]["value"] / table["beverloo_cone"] < 1.4
    throughput = sum(result.table["separation"]["throughput"].values())
    assert throughput == pytest.approx(3600 * table["rate"]["value"], rel=1e-9)
    assert (tmp_path / "run" / "figures" / "discharge.png").stat().st_size > 5000
    assert "Feed funnel" in (tmp_path / "run" / "report.html").read_text()
    again = wf.run(scene, tmp_path / "run", until="funnel")
    assert again.table["funnel"] == table
    assert again.table["seconds"]["funnel"]["cached"]


@pytest.mark.liggghts
def test_a_narrow_outlet_jams_and_the_run_says_so(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    narrow = ["funnel.count=40", 'funnel.orifice="2.65 mm"', "funnel.gamma=0", "funnel.friction=0.8"]
    text = (cases / "funnel.toml").read_text().replace('mass = "5 g"', "")
    (tmp_path / "narrow.toml").write_text(text)
    command = ["run", str(tmp_path / "narrow.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    command += [word for change in narrow for word in ("--set", change)]
    assert main([*command, "--until", "funnel"]) == 0
    table = json.loads((tmp_path / "out" / "result.json").read_text())
    assert (table["funnel"]["verdict"], table["funnel"]["rate"]) == ("stopped", None)
    assert any("flow stopped" in line for line in table["warnings"])
    assert main(command) == 2
    assert "widen funnel.orifice" in capsys.readouterr().err


@pytest.mark.liggghts
def test_no_bead_passes_the_wall() -> None:
    """Neither poured nor shaken hard: at whole periods, when the wall is in its middle, every bead lies inside."""
    funnel, folders = Funnel(**SMALL), {}

    def make(stage: str, key: str, work: Any) -> Path:
        folders[stage] = Store(cache_root()).make(stage, key, work)[0]
        return folders[stage]

    Liggghts().compute(funnel, make, lambda text: None)
    cone, bed = cone_of(funnel), read_bed(folders["bed"])
    assert 0.5 < packing_fraction(bed, cone) < 0.7
    shots = [np.column_stack([bed.diameters / 2, bed.centres])]
    shots += [rows[:, 1:] for _, rows in read_dump(folders["funnel"] / "beads.dump")]
    for rows in shots:
        inside = rows[rows[:, 3] > rows[:, 0]]  # those lower lie at the outlet's edge or are out
        assert (cone.room(inside[:, 1:]) > 0.9 * inside[:, 0]).all()
    assert len(shots) > 3


@pytest.mark.liggghts
def test_asking_for_the_version_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    engine.liggghts_version.cache_clear()
    assert engine.liggghts_version().split(".")[0] == "3"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.liggghts
def test_what_the_engine_complains_of_is_told(tmp_path: Path) -> None:
    (tmp_path / "settings.liggghts").write_text("variable dt string 0\n")
    with pytest.raises(ProgramError, match=r"ERROR.*beads\.data.*log\.plate") as caught:
        engine.run_script(tmp_path, Path(funnel.__file__).with_name("plate.liggghts"))
    assert caught.value.tail
