"""Channels in which nothing stands: the air is known, and what it carries over follows from terminal velocities."""

import json
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.injection.feed import feedstock
from wakeflow.laws.drag import drag_laws, terminal_velocity
from wakeflow.pipeline.analytic import decaying, duct_field
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene
from wakeflow.statistics.separation import separate
from wakeflow.tracking import Fate

CALM = {"dispersion": False}
SPEED = "fraction.wheat.terminal_velocity"
LIGHT, HEAVY = 0, 1  # the scene's bins


@pytest.fixture(scope="module")
def aspirator() -> Scene:
    return shipped("aspirator", {"feed.count": 1024})


def flown(scene: Scene, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terminal velocity in the scene's air (n,), bin (n,) and fate (n,) of a fraction's granules in calm air."""
    plan = make_plan(scene, force=CALM)
    feed, pipeline = feedstock(scene, plan, name, None), Pipeline(scene, plan)
    tracks = Flight(scene, plan, pipeline.kind.realisations, 1e-4).fly(name, feed.granules)
    air, grains = scene.air, feed.granules
    settling = terminal_velocity(
        grains.diameter, grains.density, air.density, air.viscosity, drag_scale=grains.drag_scale
    )
    return settling, tracks.line, tracks.fate


@pytest.mark.parametrize(("name", "speed"), [("wheat", 7.3), ("straw", 3.5), ("internodes", 3.4)])
def test_a_granule_is_carried_over_where_its_terminal_velocity_is_below_the_air_speed(
    aspirator: Scene, name: str, speed: float
) -> None:
    settling, line, fate = flown(aspirator.replace({"air.speed": speed}), name)
    slack = 2e-3 if "buoyancy" not in make_plan(aspirator, force=CALM).fractions[name].forces else 1e-12
    decided = np.abs(settling / speed - 1.0) > max(slack, 1e-4)  # the others may hang in the air to the end
    assert decided.mean() > 0.95
    assert np.array_equal(line[decided] == LIGHT, settling[decided] < speed)
    assert np.array_equal(line[decided] == HEAVY, settling[decided] > speed)
    assert 0.1 < np.mean(settling < speed) < 0.9
    assert set(np.unique(fate)) <= {Fate.BINNED, Fate.AIRBORNE}


@pytest.mark.parametrize("share", [0.99, 0.999, 1.001, 1.01])
def test_granules_of_almost_the_airs_speed_still_end_where_they_belong(aspirator: Scene, share: float) -> None:
    """Within 1 % they need seconds; what differs by less than a ten thousandth may hang in the air."""
    scene = aspirator.replace({"fraction.wheat.terminal_velocity": share * 6.0})
    settling, line, _ = flown(scene, "wheat")
    np.testing.assert_allclose(settling, share * 6.0, rtol=1e-9)
    assert np.all(line == (LIGHT if share < 1.0 else HEAVY))


def test_the_momentum_of_the_fall_carries_light_grain_into_a_short_leg(aspirator: Scene) -> None:
    """A granule of the air's speed sinks by int v dv / (g (F(U + v) / F(U) - 1)), F the drag, before it turns: some
    8 % more than (U^2 / g) ln(1 + v0 / 2U), since the drag law's F grows a little less than with the square.
    """
    v = np.linspace(0.0, np.sqrt(2 * 9.81 * 0.1), 20_001)
    v = 0.5 * (v[1:] + v[:-1])
    factor, scale = drag_laws["brown-lawler"].factor, 1.204 * 3.88e-3 / 1.825e-5
    drag = factor((7.3 + v) * scale, 1.0) * (7.3 + v) / (factor(np.array([7.3 * scale]), 1.0) * 7.3)
    depth = float(np.sum(v / (9.81 * (drag - 1.0))) * (v[1] - v[0]))
    assert depth == pytest.approx(7.3**2 / 9.81 * np.log1p(1.4 / (2 * 7.3)), rel=0.1)
    for leg, place in ((0.985 * depth, HEAVY), (1.005 * depth, LIGHT)):
        changes = {"feed.height": 0.1, "air.speed": 7.3, SPEED: 7.3 * 0.9998, "channel.bottom": -leg}
        line = flown(aspirator.replace(changes), "wheat")[1]
        assert np.all(line == place), leg


def test_what_hangs_in_the_air_is_counted_elsewhere_and_said(aspirator: Scene, tmp_path: Path) -> None:
    hanging = aspirator.replace({"fraction.wheat.terminal_velocity": 6.0 * (1.0 + 1e-9), "feed.count": 256})
    result = wf.run(hanging, tmp_path, force=CALM, until="tracks")
    assert result.table["fates"]["wheat"]["airborne"] == 256
    assert any("they count as elsewhere" in line for line in result.table["warnings"])
    assert any("still in the air" in line for line in result.table["warnings"])


def test_the_shipped_scene_runs_whole_and_solves_nothing(aspirator: Scene, tmp_path: Path) -> None:
    result = wf.run(aspirator.replace({"feed.count": 256}), tmp_path)  # as it is, but for a short slab
    table = json.loads((tmp_path / "result.json").read_text())
    assert "NaN" not in json.dumps(table)
    assert table["airflow"]["verdict"] == "uniform"
    assert table["airflow"]["flow_rate"] == pytest.approx(6.0 * 0.2)
    assert table["airflow"]["cd"] is None
    assert {"mesh", "airflow"}.isdisjoint(table["seconds"])
    assert table["plan"]["unit"] == "channel widths"
    assert (tmp_path / "report.html").exists()
    assert not (tmp_path / "figures" / "pressure.png").exists()
    assert result.share("wheat", "heavy")[0] == 1.0  # 6 m/s lies in the published window of 4.85 to 7.04 m/s
    assert result.share("straw", "light")[0] > 0.99
    unknown = {part["source"] for row in table["budget"] for part in row["parts"] if part["how"] == "unknown"}
    assert unknown == {"airflow-model"}
    assert table["slab"]["replicates"] >= 4  # a dense curtain: granules meet
    assert table["slab"]["meetings"]["straw"] > 0.1
    assert not [p for row in table["budget"] for p in row["parts"] if p["source"].startswith("collisions")]


@pytest.mark.parametrize(
    ("spread", "cdf"),
    [
        ({"distribution": "uniform", "low": 7.04, "high": 7.74}, lambda u: (u - 7.04) / 0.70),
        ({"distribution": "normal", "mean": 7.3, "std": 0.25}, lambda _: 0.5),
        ({"distribution": "lognormal", "median": 7.3, "geometric_std": 1.04}, lambda _: 0.5),
    ],
)
def test_the_distribution_that_goes_in_comes_out(aspirator: Scene, spread: dict, cdf) -> None:  # type: ignore[no-untyped-def]
    """Whatever the sizes: each granule's own terminal velocity is the one drawn, and independent of its size."""
    sizes = {"distribution": "normal", "mean": "3.88 mm", "std": "0.3 mm"}
    scene = aspirator.replace(
        {"fraction.wheat.terminal_velocity": spread, "fraction.wheat.size": sizes, "air.speed": 7.3}
    )
    plan = make_plan(scene, force=CALM)
    shares = separate(scene, Pipeline(scene, plan).tracks().landings).fractions["wheat"]
    assert shares["light"].low - 2e-3 <= cdf(7.3) <= shares["light"].high + 2e-3
    grains = feedstock(scene, plan, "wheat", None).granules
    settling = terminal_velocity(grains.diameter, grains.density, 1.204, 1.825e-5, drag_scale=grains.drag_scale)
    p = (np.arange(1024) + 0.5) / 1024
    wanted = scene.fraction["wheat"].settling(p)
    assert wanted is not None
    np.testing.assert_allclose(np.interp(np.sort(settling), wanted, p), p, atol=0.01)
    assert abs(np.corrcoef(settling, grains.diameter)[0, 1]) < 0.05
    assert plan.fractions["wheat"].terminal_velocity == pytest.approx(float(np.median(wanted)), rel=1e-4)


def test_other_fractions_keep_their_granules_when_one_gets_a_spread(aspirator: Scene) -> None:
    one = aspirator.replace({"fraction.wheat.terminal_velocity": 7.3})
    grains = [feedstock(s, make_plan(s), "straw", None).granules for s in (aspirator, one)]
    assert np.array_equal(grains[0].drag_scale, grains[1].drag_scale)


def test_parabolic_air_is_plane_poiseuille_flow(aspirator: Scene) -> None:
    scene = aspirator.replace({"channel.walls": "no-slip", "air.profile": "parabolic", "air.direction": "down"})
    field, air = duct_field(scene, turbulent=False), scene.air
    x = np.linspace(-0.0999, 0.0999, 301)
    velocity = field.sample(np.stack([x, np.full(301, 0.1)], axis=1))[0]
    np.testing.assert_allclose(velocity[:, 1], -1.5 * 6.0 * (1 - (x / 0.1) ** 2), atol=6.0 * 1.5 / 64**2)
    assert np.mean(velocity[:, 1]) == pytest.approx(-6.0, rel=5e-3)
    drop = Pipeline(scene, make_plan(scene)).airflow.pressure_drop
    assert drop == pytest.approx(2 * air.viscosity * (6.0 * 6.0 / 0.2) * 1.0 / 0.2)  # wall shear 6 mu U / W, two walls
    assert any("turbulent" in line for line in make_plan(scene).warnings)


def test_a_streams_turbulence_decays_as_its_equations_say() -> None:
    """dk/dt = -epsilon by finite differences, and t^-1.087 far downstream."""
    t = np.linspace(0.0, 0.5, 2001)
    k, epsilon = decaying(0.135, 48.0, t)
    np.testing.assert_allclose(np.gradient(k, t)[1:-1], -epsilon[1:-1], rtol=2e-4)
    far = decaying(0.135, 48.0, np.array([1e3, 1e4]))[0]
    assert np.log10(far[1] / far[0]) == pytest.approx(-0.09 / 0.0828, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"channel.walls": "no-slip"}, "parabolic"),
        ({"air.profile": "parabolic"}, "no-slip"),
        ({"feed.mode": "injected"}, "no body to meet"),
        ({"feed.level": "2 m"}, "feed.level"),
        ({"vibration.frequency": 30.0, "vibration.gamma": 2.0}, "vibrate"),
        ({"numerics.rung": "draft"}, "nothing to solve"),
        ({"feed.direction": "-80 deg"}, "direction goes with speed"),
        ({SPEED: -1.0}, r"fraction.wheat.terminal_velocity = -1.0: .* \(allowed: >= 1e-06 m/s and <= 100 m/s\)"),
        ({"fraction.wheat.terminal_velocity.high": 7.0}, "low = 7.04 must be below high = 7"),
        ({SPEED: {"distribution": "unifrom", "low": 1, "high": 2}}, "did you mean 'uniform'"),
        ({SPEED: {"distribution": "uniform", "mean": 7.0}}, "lacks low, high and has no mean"),
        ({SPEED: {"distribution": "normal", "mean": 25.0, "std": 1}}, "times a sphere's"),
    ],
)  # fmt: skip
def test_what_does_not_go_without_a_body_is_refused_in_one_line(aspirator: Scene, changes: dict, words: str) -> None:
    with pytest.raises(SceneError, match=words) as refused:
        make_plan(aspirator.replace(changes))
    assert "\n" not in str(refused.value)


def test_level_and_direction_are_for_channels_without_a_body(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(cases / "rhombus.toml"), "--set", "feed.level=0.1"]) == 2
    assert "feed.level: for a channel without a body" in capsys.readouterr().err


def test_granules_slid_in_fly_as_projectiles(aspirator: Scene) -> None:
    """In a vacuum: from the level with the speed and direction given, onto the floor where the parabola says."""
    tables = aspirator.tables()
    del tables["air"], tables["feed"]["height"]
    tables["feed"] |= {"speed": 0.5, "direction": 0.0, "width": 0.02, "position": -0.05}
    scene = Scene.parse(tables)
    feed = feedstock(scene, make_plan(scene), "wheat", None)
    tracks = Flight(scene, make_plan(scene), Realisations(None), 1e-6).fly("wheat", feed.granules[:64])
    fall = np.sqrt(2 * 0.4 / 9.81)
    free = tracks.impacts == 0
    assert free.any()
    np.testing.assert_allclose(tracks.position[free, 0], feed.granules.position[:64][free, 0] + 0.5 * fall, atol=1e-6)
