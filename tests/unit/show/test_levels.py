"""Mass flow, mean velocity and spread at given heights: kind = "levels"."""

import csv
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import OdeSolution, solve_ivp

import wakeflow as wf
from support import G, without_slip
from wakeflow import FlowField, track
from wakeflow.core.errors import SceneError, known
from wakeflow.core.geometry import halved
from wakeflow.extras.pictures.levels import level_numbers, passages
from wakeflow.flight.stages.landings import paths_of
from wakeflow.laws.constants import STANDARD_AIR
from wakeflow.laws.drag import drag_laws
from wakeflow.scene import Scene
from wakeflow.show.moving import Path2D

CURTAIN = """
[channel]
width = "0.5 m"
top = "0.1 m"
bottom = "-2 m"
[feed]
level = "0 m"
speed = "1 m/s"
width = "12 mm"
rate = "36 kg/hour"
count = 256
[fraction.beads]
size = "1 mm"
density = 2500
restitution = 0.5
friction = 0.3
[bin.floor]
from = "-250 mm"
to = "250 mm"
[picture.fall]
kind = "levels"
levels = ["-0.5 m", "50 mm", "-1.5 m"]
granules = 256
"""


def thrown(vx: float, vy: float, x: float = 0.0, moments: int = 9) -> Path2D:
    time = np.linspace(0.0, 1.0, moments)
    position = np.stack([x + vx * time, vy * time - 0.5 * G * time**2], axis=1)
    velocity = np.stack([np.full(moments, vx), vy - G * time], axis=1)
    return Path2D(time, position, velocity, velocity, 1e-3)


@pytest.mark.parametrize("level", [0.3, 0.05, -0.4, -1.5])
def test_a_thrown_granule_passes_where_its_parabola_does(level: float) -> None:
    found = passages([thrown(0.5, 3.0)], level)
    down = math.sqrt(9.0 - 2.0 * G * level)
    ways = [down, -down] if level > 0.0 else [-down]  # up and down again, or down alone
    np.testing.assert_allclose(found.velocity[:, 1], ways, rtol=1e-12)
    np.testing.assert_allclose(found.x, [0.5 * (3.0 - way) / G for way in ways], rtol=1e-12)
    assert found.granule.tolist() == [0] * len(ways)


def exact_fall(after: float) -> OdeSolution:
    """Height (m) and velocity (m/s) of the bead below while it falls from rest at y = 0, over time (s)."""
    rho, mu = STANDARD_AIR
    tau, law = DENSE * SIZE**2 / (18.0 * mu), drag_laws["brown-lawler"].factor

    def rate(_: float, z: np.ndarray) -> list[float]:
        drag = float(law(np.array(rho * abs(z[1]) * SIZE / mu), 1.0)) / tau
        return [z[1], -G - drag * z[1]]

    return solve_ivp(rate, (0.0, after), [0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-13, dense_output=True).sol


SIZE, DENSE, DROP = 697e-6, 3300.0, 3.0
PLATE = np.array([(-0.5, -0.1), (0.5, -0.1), (0.5, 0.0), (-0.5, 0.0)]) - (0.0, DROP)


def test_a_bead_in_still_air_passes_levels_as_its_equation_of_motion_says() -> None:
    """Of a recorded point every 0.13 s, where a parabola is 2 % too fast; the last piece ends in an impact."""
    corners = np.array([(-2.0, -4.0), (2.0, -4.0), (2.0, 1.0), (-2.0, 1.0)])
    rho, mu = STANDARD_AIR
    air = FlowField.from_arrays(corners, [(0, 1, 2), (0, 2, 3)], np.zeros((4, 2)), density=rho, viscosity=mu)
    bead = without_slip([[0.0, 0.0]], [[0.0, 0.0]], diameter=SIZE, density=DENSE, restitution=0.5, friction=0.3)
    tracks = track(air, bead, until=1.0, tolerance=1e-4, length=0.1, bodies=[PLATE], record=True)
    (table,) = known(tracks.recorded)
    hit, every = int(np.argmax(table[:, 4] > 0.0)), np.arange(0.0, 1.0, 0.13)
    kept = np.unique([*np.searchsorted(table[:hit, 0], every, side="right") - 1, hit, len(table) - 1])
    path = Path2D.of(paths_of(replace(tracks, recorded=[table[kept]]), bead, 0)[0])
    met = float(table[hit, 0])
    exact = exact_fall(met)
    times = np.linspace(0.0, met - 1e-9, 200)
    where, pace = path.at(times)
    np.testing.assert_allclose(where[:, 1], exact(times)[0], atol=1e-4)
    np.testing.assert_allclose(pace[:, 1], exact(times)[1], atol=5e-3)
    for level in (-0.3, -1.0, -2.0, -2.9):
        time = float(halved(lambda t, y=level: exact(t)[0] > y, 0.0, met, 60)[1])
        assert passages([path], level).velocity[0, 1] == pytest.approx(exact(time)[1], rel=1e-3)


def test_nobody_passes_a_level_above_all_tracks() -> None:
    found = level_numbers([thrown(0.5, 3.0)] * 40, 0.6, 1.0)
    assert found["down"].value == found["up"].value == 0.0
    assert math.isnan(found["vy"].value)
    assert not found["spread"].known
    assert level_numbers([], 0.6, 1.0)["down"].value == 0.0


def test_intervals_hold_the_truth_in_nineteen_of_twenty() -> None:
    rng, hits = np.random.default_rng(3), {"vx": 0, "x": 0, "spread": 0, "down": 0}
    trials, past = 200, 0.7  # 30 % of the granules end above the level
    for _ in range(trials):
        vx, x, falls = rng.normal(0.4, 0.1, 64), rng.normal(0.0, 0.02, 64), rng.random(64) < past
        paths = [thrown(a, 0.0, b, 2 if c else 1) for a, b, c in zip(vx, x, falls, strict=True)]
        time = math.sqrt(2.0 * 0.5 / G)
        truth = {"vx": 0.4, "x": 0.4 * time, "spread": math.hypot(0.02, 0.1 * time), "down": 3.0 * past}
        found = level_numbers(paths, -0.5, 3.0)
        for name, value in truth.items():
            hits[name] += found[name].low <= value <= found[name].high
    for name, count in hits.items():
        assert 0.88 * trials <= count <= 0.99 * trials, (name, count)


def test_a_curtain_in_a_vacuum_has_the_speeds_of_free_fall(tmp_path: Path) -> None:
    result = wf.run(Scene.parse(tomllib.loads(CURTAIN)), tmp_path)
    with (tmp_path / "figures" / "fall.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["y (m)"]) for row in rows] == [-1.5, -0.5, 0.05]
    for row in rows[:2]:
        assert float(row["vy (m/s)"]) == pytest.approx(-math.sqrt(1.0 - 2.0 * G * float(row["y (m)"])), rel=1e-6)
        assert float(row["down (kg/s)"]) == pytest.approx(0.01, rel=1e-9)
        assert float(row["up (kg/s)"]) == 0.0
        assert float(row["spread low (m)"]) < 0.012 / math.sqrt(12.0) < float(row["spread high (m)"])
    assert float(rows[2]["down (kg/s)"]) == 0.0  # above the feed
    assert rows[2]["vy (m/s)"] == ""
    table = result.table["pictures"]["fall"]
    assert set(table["files"]) >= {"fall.png", "fall.csv"}
    assert table["numbers"]["levels"] == [-1.5, -0.5, 0.05]
    assert table["numbers"]["fractions"]["beads"][0]["vy"][0] == pytest.approx(-math.sqrt(1.0 + 3.0 * G), rel=1e-6)
    assert "Spread: beads 3.4" in table["text"]


def test_a_level_outside_the_channel_is_refused() -> None:
    with pytest.raises(SceneError, match=r"picture\.fall\.levels: y = .*is not in the channel"):
        Scene.parse(tomllib.loads(CURTAIN.replace('"50 mm"', '"150 mm"')))
