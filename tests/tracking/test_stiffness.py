"""Relaxation times from 1e-9 s to 1e3 s, steps from 1e-12 to 1e12 of them: cost bounded, limits reached, no NaN."""

from itertools import product

import numpy as np
import pytest

from proofs.problems.exact import DENSITY, VISCOSITY, Setting, box, field_on, fly
from proofs.problems.flights import taylor_green, two_modes
from proofs.problems.reference_all_terms import reference_end_states
from support import G
from wakeflow.field import FlowField
from wakeflow.laws.drag import drag_laws
from wakeflow.tracking import Fate, Granules, track

DECADES = 10.0 ** np.arange(-9.0, 4.0)
DIAMETER = 1e-3  # Re 67 at a slip of 1 m/s
STARTS = 8  # granules that a cost is averaged over


def of_size(tau: float | np.ndarray, position: object, velocity: object) -> Granules:
    """Granules of 1 mm, which stay in the nonlinear range of drag; their density gives the relaxation time."""
    return Granules(position, velocity, DIAMETER, 18 * VISCOSITY * np.asarray(tau) / DIAMETER**2)  # type: ignore[arg-type]


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
