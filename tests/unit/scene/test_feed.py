"""The curtain and what its density strains: profiles, speeds on arrival, and the feed rates that limits stand for."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from support import CASES, shipped
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.laws.drag import drag_laws
from wakeflow.laws.material import materials
from wakeflow.laws.profile import crowding, profiles
from wakeflow.planning.coupling import COUPLING, INDEPENDENT, LOADED, MODULATING
from wakeflow.planning.plan import Plan
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

WIDTH = 0.04
TABLE = {"positions": [-0.02, 0.0, 0.01], "weights": [0.0, 2.0, 1.0]}
PARAMETERS: dict[str, dict[str, Any]] = {"table": TABLE, "normal": {"std": 0.008}}
EVENLY = (np.arange(100_000) + 0.5) / 100_000


@pytest.fixture(scope="module")
def vacuum() -> Scene:
    return shipped("vacuum")


@pytest.mark.parametrize("name", list(profiles))
def test_places_increase_within_the_curtain(name: str) -> None:
    x = profiles[name](np.linspace(1e-12, 1.0 - 1e-12, 2001), WIDTH, **PARAMETERS.get(name, {}))
    assert np.all(np.diff(x) > 0)
    assert np.abs(x).max() <= 0.5 * WIDTH * (1 + 1e-9)
    if name != "table":
        np.testing.assert_allclose(x, -x[::-1], atol=1e-9)


@pytest.mark.parametrize(("name", "variance"), [("uniform", 1 / 12), ("triangular", 1 / 24), ("parabolic", 1 / 20)])
def test_variances_are_those_of_their_densities(name: str, variance: float) -> None:
    assert np.var(profiles[name](EVENLY, WIDTH)) == pytest.approx(variance * WIDTH**2, rel=1e-4)


def test_the_normal_profile_is_cut_off_and_otherwise_normal() -> None:
    narrow = profiles["normal"](EVENLY, WIDTH, std=0.004)
    assert narrow.std() == pytest.approx(0.004, rel=1e-3)
    ratio = profiles["normal"](EVENLY, WIDTH).std() / (WIDTH / 4)
    assert ratio == pytest.approx(math.sqrt(1 - 2 * 2 * 0.0539910 / 0.9544997), rel=1e-3)  # truncated at two deviations


def test_a_table_gives_its_own_density_back() -> None:
    x = profiles["table"](EVENLY, WIDTH, **TABLE)
    density, edges = np.histogram(x, bins=60, range=(-0.02, 0.01), density=True)
    middle = 0.5 * (edges[1:] + edges[:-1])
    np.testing.assert_allclose(density, np.interp(middle, TABLE["positions"], TABLE["weights"]) / 0.035, atol=0.5)
    tent = profiles["table"](EVENLY, WIDTH, positions=[-0.02, 0.0, 0.02], weights=[0, 5, 0])
    np.testing.assert_allclose(tent, profiles["triangular"](EVENLY, WIDTH), atol=1e-9)


@pytest.mark.parametrize(("name", "dense"), [("uniform", 1.0), ("triangular", 4 / 3), ("parabolic", 6 / 5)])
def test_crowding_is_the_mean_density_that_granules_are_in(name: str, dense: float) -> None:
    assert crowding(lambda p: profiles[name](p, WIDTH), WIDTH) == pytest.approx(dense, rel=5e-3)


def test_the_feed_falls_by_its_profile_and_each_granule_stands_for_the_same_mass(vacuum: Scene) -> None:
    spread = {}
    for profile in ("uniform", {"distribution": "normal", "std": "2 mm"}):
        scene = vacuum.replace({"feed.profile": profile, "feed.count": 4096})
        feed = feedstock(scene, make_plan(scene), "hard", 0.0)
        spread[str(profile)] = feed.granules.position[:, 0].std()
        assert feed.granules.position[:, 0].mean() == pytest.approx(0.0125, abs=1e-4)
        assert np.ptp(feed.granules.weight) == 0.0
    assert list(spread.values()) == pytest.approx([0.02 / math.sqrt(12), 0.002], rel=1e-2)


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        ("triangel", "unknown curtain profile 'triangel'; did you mean 'triangular'"),
        ({"distribution": "table", "positions": [0, 0.01]}, "'table' lacks weights"),
        ({"distribution": "uniform", "std": 0.01}, "'uniform' has no std"),
        ({"distribution": "table", "positions": [-0.1, 0.1], "weights": [1, 1]}, "beyond half of width = 0.02 m"),
        ({"distribution": "table", "positions": [0.0, -0.005], "weights": [1, 1]}, "positions must increase"),
        ({"distribution": "table", "positions": [-0.01, 0.01], "weights": [0, 0]}, "not all zero"),
        ({"distribution": "normal", "deviation": 0.01}, "feed.profile.deviation: unknown key"),
    ],
)
def test_a_wrong_profile_is_one_line(vacuum: Scene, profile: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        vacuum.replace({"feed.profile": profile})
    assert "\n" not in str(caught.value)


def test_a_scene_with_a_profile_saves_and_loads(vacuum: Scene, tmp_path: Path) -> None:
    for profile in ("parabolic", {"distribution": "table", "positions": ["-5 mm", "5 mm"], "weights": [1, 3]}):
        scene = vacuum.replace({"feed.profile": profile})
        scene.save(tmp_path / "scene.toml")
        assert Scene.load(tmp_path / "scene.toml") == scene


def test_each_fraction_arrives_with_its_own_speed_and_the_plan_says_so(draft: Scene) -> None:
    draft = draft.replace({"fraction.*.impact": "paper"})
    speeds = {name: how.arrival_speed for name, how in make_plan(draft).fractions.items()}
    assert speeds["dust"] == pytest.approx(5.0, rel=0.02)  # with the air
    assert math.sqrt(2 * 9.81 * 0.1) < speeds["wheat"] < speeds["chaff"] < speeds["dust"]
    calm = make_plan(draft.replace({"air.speed": 1e-3, "feed.height": 2.0})).fractions
    assert calm["chaff"].arrival_speed == pytest.approx(1.75, rel=0.01)  # its terminal velocity
    expected = 7.8 * math.sqrt(1 - math.exp(-2 * 9.81 * 2.0 / 7.8**2))
    assert calm["wheat"].arrival_speed == pytest.approx(expected, rel=0.02)
    upward = make_plan(shipped("prism")).fractions
    assert upward["chaff"].arrival_speed < 0 < upward["wheat"].arrival_speed


def rows(plan: Plan) -> dict[str, Any]:
    return {row.name: row for row in plan.validity}


@pytest.mark.parametrize("name", ["rhombus", "prism", "vacuum"])
def test_at_the_feed_rate_of_a_limit_the_limit_is_reached(name: str) -> None:
    scene = shipped(name)
    if scene.feed.rate:
        scene = scene.replace({"feed.rate": 0.7 * scene.feed.mass_flow})  # at no limit by chance
    for row in make_plan(scene).validity:
        if row.limit == math.inf:
            continue
        again = rows(make_plan(scene.replace({"feed.rate": row.feed_rate / 3600.0})))[row.name]
        assert again.value == pytest.approx(row.limit, rel=1e-6)
        assert again.value != pytest.approx(row.value, rel=1e-3)


def test_below_its_feed_rate_meetings_are_within_the_accuracy_and_above_not(draft: Scene) -> None:
    """The row is the gate's bound on collisions turned round: at that rate the worst fraction is at its limit."""
    row = rows(make_plan(draft))["meetings"]
    plan = make_plan(draft.replace({"feed.rate": row.feed_rate / 3600.0}))
    bounds = {name: how.bounds["collisions"] for name, how in plan.fractions.items()}
    assert max(bounds.values()) == pytest.approx(plan.fractions["chaff"].limit, rel=1e-6)
    assert max(bounds, key=lambda name: bounds[name]) in row.why
    least = min(r.feed_rate for r in plan.validity if r.about == INDEPENDENT and r.feed_rate)
    below = make_plan(draft.replace({"feed.rate": 0.9 * least / 3600.0}))
    assert not any(line.startswith(INDEPENDENT) for line in below.warnings)


def _given(scene: Scene, plan: Plan, name: str) -> float:
    """Velocity (m/s) that the air of 5 m/s gives a granule in its fall of 0.1 m from rest: of w' = g + a, the integral
    of a, which is g at the terminal velocity and goes with the law of drag.
    """
    fraction, g = scene.fraction[name], 9.81
    settling, law = plan.fractions[name].terminal_velocity, drag_laws[fraction.drag_law].factor

    def rates(_: float, y: np.ndarray) -> list[float]:
        slip = 5.0 - y[1]
        reynolds = np.abs([slip, settling]) * 1.204 * fraction.properties.diameter / 1.81e-5
        here, there = law(reynolds, fraction.roundness)
        pull = g * here * slip / (there * settling)
        return [y[1], g + pull, pull]

    def fallen(_: float, y: np.ndarray) -> float:
        return float(y[0] - 0.1)

    fallen.terminal = True  # type: ignore[attr-defined]
    return float(solve_ivp(rates, (0.0, 5.0), [0.0] * 3, "LSODA", events=fallen, rtol=1e-8, atol=1e-10).y[2, -1])


def test_densities_of_curtain_and_air_are_by_hand(draft: Scene) -> None:
    plan = make_plan(draft)
    found = rows(plan)
    density = {name: materials[name].density for name in ("dust", "chaff", "wheat")}
    area, flow = 0.04 * 0.3, 500.0 / 3600.0
    solid = sum(
        flow * share / density[name] / (area * plan.fractions[name].arrival_speed)
        for name, share in {"dust": 0.02, "chaff": 0.08, "wheat": 0.9}.items()
    )
    assert found["curtain"].value == pytest.approx(solid, rel=1e-6)
    assert found["turbulence"].value == found["curtain"].value
    assert found["turbulence"].limit == MODULATING
    assert found["mass-loading"].value == pytest.approx(flow / (1.204 * 5.0 * area), rel=1e-6)
    assert found["mass-loading"].value == pytest.approx(1.92, abs=0.005)  # in the curtain; 0.19 over the channel
    given = sum(
        share * _given(draft, plan, name) for name, share in {"dust": 0.02, "chaff": 0.08, "wheat": 0.9}.items()
    )
    momentum = flow / (1.204 * area) * given / 25.0
    assert found["air-momentum"].value == pytest.approx(momentum, rel=0.01)
    tent = rows(make_plan(draft.replace({"feed.profile": "triangular"})))
    assert tent["curtain"].value == pytest.approx(4 / 3 * solid, rel=5e-3)
    assert tent["mass-loading"].value == pytest.approx(4 / 3 * found["mass-loading"].value, rel=5e-3)


def test_granules_take_the_airs_speed_from_it_at_most_once(draft: Scene) -> None:
    tables = draft.tables()
    tables["fraction"] = {"dust": {**tables["fraction"]["dust"], "mass_share": 1.0}}
    tables["feed"] |= {"speed": 5.0}
    del tables["feed"]["height"]
    dust = rows(make_plan(Scene.parse(tables)))["air-momentum"].value
    wheat = rows(make_plan(draft))["air-momentum"].value
    loading = rows(make_plan(draft))["mass-loading"].value
    assert wheat < loading  # grain is out of the channel before drag has taken its speed
    assert dust <= 1.01 * loading  # all that dust could take: once the air's speed


def test_the_layer_on_the_slope_is_by_hand(vacuum: Scene) -> None:
    """One fraction, all on one slope of 45 degrees: eq. (2) and a ballistic bounce."""
    tables = vacuum.tables()
    tables["fraction"] = {"hard": {**tables["fraction"]["hard"]}}
    scene = Scene.parse(tables)
    found = rows(make_plan(scene))
    beta, speed = math.pi / 4, math.sqrt(2 * 9.81 * 0.1)
    along = speed * (math.sin(beta) - 0.3 * 1.5 * math.cos(beta))
    height = (0.5 * speed * math.cos(beta)) ** 2 / (2 * 9.81 * math.cos(beta)) + 2e-3
    assert found["layer"].value == pytest.approx(height, rel=1e-6)
    pull, length = 9.81 * math.cos(beta) * (1 - 0.3), 0.05 / math.cos(beta)
    stay = (math.sqrt(along**2 + pull * length) - along) / pull
    assert along * stay + 0.5 * pull * stay**2 == pytest.approx(0.5 * length)
    assert found["slope-covered"].value == pytest.approx(1.5 * 1.0 / 1300.0 * stay / length / 2e-3, rel=1e-6)
    sticky = rows(make_plan(scene.replace({"fraction.hard.friction": 5.0})))["slope-covered"]
    assert math.isinf(sticky.value)
    assert sticky.feed_rate == 0.0


def too_dense_for(plan: Plan) -> set[str]:
    """What the plan warns of as strained by the feed rate."""
    return {found[1] for line in plan.warnings if (found := re.match("the feed is too dense for ([^:]*):", line))}


def test_warnings_name_what_is_strained_and_the_rate_that_is_not(draft: Scene) -> None:
    plan = make_plan(draft, force={"collisions": False})
    assert too_dense_for(plan) == {INDEPENDENT}  # the air feels the granules
    one_way = make_plan(draft, force={"air-loading": False, "collisions": False})
    assert too_dense_for(one_way) == {COUPLING, INDEPENDENT}
    small = make_plan(draft.replace({"feed.rate": "1 g/hour"}))
    assert not too_dense_for(small)
    assert all(row.holds for row in small.validity)
    assert rows(plan)["mass-loading"].limit == LOADED


def test_the_plans_table_holds_them_without_infinities(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["plan", str(CASES / "vacuum.toml"), "--json", "--set", "fraction.hard.friction=5.0"]) == 0
    table = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(word))
    [row] = [row for row in table["validity"] if row["name"] == "slope-covered"]
    assert (row["value"], row["feed_rate"]) == (None, 0.0)
    assert main(["plan", str(CASES / "rhombus.toml"), "--all"]) == 0
    out = capsys.readouterr().out
    assert "impaction efficiency" in out
    assert "mass-loading" in out
    assert replace(make_plan(shipped("vacuum")), validity=[]).summary()["validity"] == []
