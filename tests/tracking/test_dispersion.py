"""Dispersion and Brownian motion in the tracker: well mixed, independent of intervals, threads and company."""

import numpy as np
import pytest
from scipy.stats import chi2

from proofs.problems.exact import box
from wakeflow.field import FlowField
from wakeflow.tracking import Body, Fate, Granules, driver, track

HEIGHT = 1.0


def closed_box(cells: int, k: object, dissipation: object) -> tuple[FlowField, list[Body]]:
    """Still mean air in a unit box with walls that reflect; k and dissipation of the height y."""
    points, triangles = box(cells, low=0.0, high=HEIGHT)
    y = points[:, 1]
    field = FlowField.from_arrays(points, triangles, 0 * points, k=k(y), dissipation=dissipation(y))  # type: ignore[operator]
    t = 0.1
    corners = [(-t, -t, 1 + t, 0.0), (-t, 1.0, 1 + t, 1 + t), (-t, 0.0, 0.0, 1.0), (1.0, 0.0, 1 + t, 1.0)]
    walls = [Body(np.array([[a, b], [c, b], [c, d], [a, d]]), restitution=1.0, friction=0.0) for a, b, c, d in corners]
    return field, walls


def tracers(count: int, seed: int = 3) -> Granules:
    rng = np.random.default_rng(seed)
    return Granules(rng.uniform(1e-3, 1 - 1e-3, (count, 2)), np.zeros((count, 2)), diameter=1e-6, density=1000.0)


def profile(y: np.ndarray) -> np.ndarray:
    """k from 0.06 at the walls to 1.5 in the middle: the deviation changes by a factor of five."""
    return 1.5 * (0.2 + 0.8 * np.sin(np.pi * y)) ** 2


@pytest.mark.parametrize("life", [0.02, 0.2])
def test_tracers_stay_well_mixed_in_uneven_turbulence(life: float) -> None:
    """Thomson (1987): what fills a box evenly goes on doing so. Without the drift it gathers at the walls."""
    field, walls = closed_box(24, profile, lambda y: profile(y) / (0.5 + 0.75 * 2.1) / life)
    count, bins = 4000, 10
    tracks = track(
        field,
        tracers(count),
        until=1.0,
        forces=("drag", "dispersion"),
        bodies=walls,
        tolerance=1e-3,
        length=1.0,
        seed=5,
    )
    assert np.all(tracks.fate == Fate.AIRBORNE)
    found, _ = np.histogram(tracks.position[:, 1], bins=bins, range=(0, HEIGHT))
    statistic = np.sum((found - count / bins) ** 2 / (count / bins))
    assert statistic < chi2.ppf(0.999, bins - 1), found


def spread(slip: float, noise: float, monkeypatch: pytest.MonkeyPatch, seed: int = 1) -> np.ndarray:
    """Variances (across, along the fall) of granules that fall at ``slip`` m/s in even turbulence of rms 1 m/s."""
    monkeypatch.setattr(driver, "NOISE_STEP", noise)
    life, until, count = 0.05, 1.0, 4000
    points, triangles = box(8, low=-20.0, high=20.0)
    k = np.full(len(points), 1.5)
    field = FlowField.from_arrays(points, triangles, 0 * points, k=k, dissipation=k / (0.5 + 0.75 * 2.1) / life)
    grains = Granules(np.zeros((count, 2)), np.tile([0.0, -slip], (count, 1)), diameter=2e-5, density=1000.0)
    tau = 1000.0 * 4e-10 / (18 * field.viscosity)
    tracks = track(
        field, grains, until=until, forces=("drag", "gravity", "dispersion"), drag="stokes", seed=seed,
        gravity=(0.0, -slip / tau), tolerance=1e-4, length=1.0,
    )  # fmt: skip
    assert np.all(tracks.fate == Fate.AIRBORNE)
    return tracks.position.var(axis=0) / (2 * life * (until - life))


def test_the_spread_does_not_depend_on_the_intervals_of_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    fine, coarse = spread(0.0, 0.05, monkeypatch), spread(0.0, 0.4, monkeypatch, seed=2)
    np.testing.assert_allclose(fine, coarse, rtol=0.1)  # 4000 granules: 2.2 % each


def test_granules_that_fall_through_eddies_spread_less_and_least_across(monkeypatch: pytest.MonkeyPatch) -> None:
    """Csanady (1963): K along = rms^2 T / sqrt(1 + b^2), across = rms^2 T / sqrt(1 + 4 b^2), b = 0.8 slip / rms."""
    slip = 4.0
    across, along = spread(slip, 0.1, monkeypatch)
    b = 0.8 * slip
    # the relative velocity holds the fluctuation too, which slows it down a little further
    assert along == pytest.approx(1 / np.sqrt(1 + b * b), rel=0.12)
    assert across == pytest.approx(1 / np.sqrt(1 + 4 * b * b), rel=0.12)


def test_random_forces_are_bit_identical_for_any_threads_and_company() -> None:
    field, walls = closed_box(12, profile, lambda y: 10.0 * profile(y))
    grains = tracers(1500)
    forces = ("drag", "dispersion", "brownian")
    arguments = {"until": 0.3, "forces": forces, "bodies": walls, "tolerance": 1e-3, "length": 1.0}
    alone = track(field, grains, workers=1, seed=9, **arguments)  # type: ignore[arg-type]
    many = track(field, grains, workers=3, seed=9, **arguments)  # type: ignore[arg-type]
    np.testing.assert_array_equal(alone.position, many.position)
    first = track(field, grains[:700], workers=2, seed=9, **arguments)  # type: ignore[arg-type]
    np.testing.assert_array_equal(alone.position[:700], first.position)
    other = track(field, grains[:700], seed=10, **arguments)  # type: ignore[arg-type]
    assert np.all(np.any(other.position != first.position, axis=1))


def test_calm_air_disperses_nothing() -> None:
    field, walls = closed_box(6, lambda y: 0 * y, lambda y: 0 * y)
    grains = tracers(50)
    still = track(field, grains, until=0.5, forces=("drag",), bodies=walls, length=1.0)
    noisy = track(field, grains, until=0.5, forces=("drag", "dispersion"), bodies=walls, length=1.0)
    np.testing.assert_allclose(noisy.position, still.position, atol=1e-12)
