"""Flakes: their spin after a blow, in the air; the section of convex bodies; the model beside rigid plates."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import wakeflow as wf
from proofs.studies.flakes import row_of
from support import RHOMBUS
from wakeflow.flight.granules import toss_of
from wakeflow.laws.collision import scattered_rebound
from wakeflow.laws.flake import ROD, SPREAD, TURN, flung, plate_lift, plate_torque, section, shape_of
from wakeflow.laws.lift import plate_spin

GLUME = (6e-3, 2e-3, 0.2e-3)  # m
COUNT = 4000
DROP, R, F = 2.42, 0.2, 0.4  # m/s on a slope of 45 degrees


def _glumes(**more: object) -> wf.Granules:
    shape = shape_of(GLUME, flake=True)
    own = {"diameter": GLUME[0] / shape[0], "density": 950.0, "restitution": R, "friction": F, "inertia": 0.5}
    place, velocity = np.tile([8e-3, 0.03], (COUNT, 1)), np.tile([0.0, -DROP], (COUNT, 1))
    return wf.Granules(place, velocity, **{**own, "shape": shape, "flake": True, **more})


def _of_one_blow(spin: np.ndarray) -> None:
    """Mean and deviation are those of the law, both senses occur."""
    into = DROP / math.sqrt(2.0)
    along, scale = min(F * (1 + R) * into, into / 3.0), math.sqrt(GLUME[0] * GLUME[1])
    assert spin.std() == pytest.approx(SPREAD * (1 + R) * into / scale, rel=0.05)
    assert -spin.mean() == pytest.approx(TURN * along / scale, abs=4.0 * spin.std() / math.sqrt(COUNT))
    assert 0.5 < np.mean(spin < 0.0) < 0.75


def test_a_flake_leaves_a_slope_with_a_spin_by_chance_and_the_velocity_of_a_disc() -> None:
    grains = _glumes()
    laws = {"until": 0.02, "bodies": [RHOMBUS], "gravity": (0.0, 0.0)}
    tracks, disc = wf.track(None, grains, **laws), wf.track(None, grains.replace(flake=False), **laws)
    assert np.all(tracks.impacts == 1)
    np.testing.assert_array_equal(tracks.velocity, disc.velocity)
    _of_one_blow(tracks.spin)
    slab = wf.track(
        None, grains.replace(time=np.linspace(0.0, 20.0, COUNT)), **{**laws, "until": 20.02},
        collisions=wf.Collisions(0.06, step=2e-3),
    )  # fmt: skip
    _of_one_blow(slab.spin[slab.impacts == 1])
    wall, hits = np.zeros((COUNT, 2)), np.tile([math.sqrt(0.5)] * 2, (COUNT, 1))
    xi = np.random.default_rng(1).standard_normal(COUNT)
    none = np.zeros(COUNT)
    rest = (R, F, 2.0, grains.diameter / 2, 0.0, none, toss_of(grains), xi)
    velocity, spin, _ = scattered_rebound(grains.velocity, none, hits, wall, *rest)
    np.testing.assert_allclose(velocity, disc.velocity, atol=1e-12)
    _of_one_blow(spin)


def test_a_flake_slides_where_a_disc_rolls() -> None:
    slope, f = math.radians(30.0), 0.2
    floor = wf.Body(np.array([[1.0, -math.tan(slope)], [-1.0, math.tan(slope)]]), open=True)
    one = _glumes(friction=f)[:1]
    up = one.diameter[0] / 2 / math.cos(slope)
    still = one.replace(position=[[0.0, up]], velocity=[[0.0, 0.0]])
    found = wf.track(None, still, until=0.1, bodies=[floor], length=0.1)
    pull = 9.81 * (math.sin(slope) - f * math.cos(slope))
    assert np.linalg.norm(found.velocity[0]) == pytest.approx(0.1 * pull, rel=1e-6)


def test_a_blow_makes_no_energy() -> None:
    rng = np.random.default_rng(2)
    spin, toss, normal, along, freed, xi = rng.normal(size=(6, 10_000)) * [[300], [100], [3], [1], [4], [1]]
    freed, toss = np.maximum(freed, 0.0), np.abs(toss)
    after = flung(spin, toss, np.abs(normal), along, freed, xi)
    length = SPREAD / toss
    assert np.all(length**2 * (after**2 - spin**2) / ROD <= freed * (1 + 1e-9) + 1e-12)
    np.testing.assert_array_equal(flung(spin, toss, 0.0, 0.0, 0.0, xi), spin)  # without a blow it keeps its spin


def test_air_stops_a_plate_by_the_pressure_on_its_halves() -> None:
    """The torque of strips, integrated here; the closed form in time."""
    long, wide, thick = GLUME
    rho, density, turning = 1.2, 950.0, 500.0
    strip = quad(lambda x: 0.5 * rho * 1.2 * wide * (turning * x) ** 2 * x, 0.0, long / 2)[0]
    slowing = 2.0 * strip / (density * thick * wide * long**3 / 12.0)
    c = float(plate_torque(np.array([GLUME]), np.array([rho / density]))[0])
    assert c * turning**2 == pytest.approx(slowing, rel=1e-12)
    assert plate_spin(-turning, 0.1, c) == pytest.approx(-1.0 / (1.0 / turning + c * 0.1))
    assert float(plate_lift(np.array([GLUME]), np.array([rho / density]))[0]) == pytest.approx(
        rho
        / (density * thick)
        * (long**2 * wide**2 / (wide + 2 * long) + long**2 * wide**2 / (long + 2 * wide))
        / (4.0 * long * wide)
    )


def test_sections_are_those_of_convex_bodies() -> None:
    """A ball, a glume with a wheat kernel, an ellipsoid whose projections are measured."""
    assert [float(part[0]) for part in section(np.ones((1, 3)), np.array([False]))] == [1.0, 1.0]
    shape, ball = shape_of(GLUME, flake=True), 1.94e-3
    area, girth = (float(part[0]) for part in section(shape[None], np.array([True])))
    r = 0.5 * GLUME[0] / shape[0]
    assert math.pi * (area * r**2 + ball**2 + 2.0 * girth * r * ball) == pytest.approx(43e-6, rel=0.03)
    axes = np.array([1.84, 0.97, 0.56])
    n = np.random.default_rng(3).normal(size=(200_000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    area, girth = section(axes[None], np.array([False]))
    assert area[0] == pytest.approx(axes.prod() * np.sqrt(((n / axes) ** 2).sum(axis=1)).mean(), rel=0.013)
    assert girth[0] == pytest.approx(np.sqrt(((n * axes) ** 2).sum(axis=1)).mean(), rel=0.013)


@pytest.mark.parametrize("plate", [(6.0, 2.0, 0.2), (3.0, 3.0, 0.1)])
def test_rigid_plates_thrown_on_a_slope_are_turned_as_the_law_says(plate: tuple[float, ...]) -> None:
    row = row_of(plate, 45.0, 0.5, 0.3, 600)
    assert row["turn"] == pytest.approx(TURN, rel=0.4)
    assert row["spread"] == pytest.approx(SPREAD, rel=0.4)
    assert row["mean"] < 0.15 * row["disc"]
    assert row["along"] == pytest.approx(row["disc_along"], rel=0.15)
