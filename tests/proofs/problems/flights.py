"""Exact flights under drag and gravity: in a vacuum, in still air, in affine and in curved flows, on and off walls."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.problems.exact import DENSITY, Answer, G, Setting, box, field_on, of_tau, problem
from proofs.problems.reference_all_terms import Plane, reference_end_states, scalar_drag
from support import without_slip
from wakeflow.flight import Body, Fate

Array = NDArray[np.float64]
DRAG_ONLY = {"forces": ("drag",), "drag": "stokes"}


@problem("ballistic-flight", "a parabola", "Galilei 1638", "ballistic gravity", order=None)
def ballistic_flight(cells: int) -> tuple[Setting, Answer]:
    rng = np.random.default_rng(0)
    x, v, g, t = rng.normal(size=(20, 2)), rng.normal(size=(20, 2)), np.array([1.0, -G]), 0.7
    grains = without_slip(x, v, diameter=1e-3, density=1000)
    setting = Setting(None, grains, t, {"gravity": tuple(g), "forces": ("gravity",)})
    return setting, Answer(x + t * v + 0.5 * t * t * g, v + t * g, np.full(20, t), Fate.AIRBORNE)


@problem(
    "stokes-settling", "linear drag and gravity in still air: v = v_s (1 - exp(-t / tau))",
    "Stokes 1851; Clift, Grace & Weber 1978, Bubbles, Drops and Particles, ch. 11", "affine stiff drag gravity",
    order=None,
)  # fmt: skip
def stokes_settling(cells: int) -> tuple[Setting, Answer]:
    tau, t = np.array([1e-9, 1e-6, 1e-3, 0.02, 0.2, 10.0, 1e3])[:, None], 0.3
    x, v, g = np.tile([-0.1, 0.7], (7, 1)), np.tile([0.5, -0.8], (7, 1)), np.array([0.0, -G])
    gone = -np.expm1(-t / tau)
    z = t / tau
    series = t * z / 2 * (1 - z / 3 * (1 - z / 4 * (1 - z / 5)))
    settled = np.where(z < 1e-3, series, t - tau * gone)  # without cancellation
    setting = Setting(field_on(box(cells), np.zeros_like), of_tau(tau[:, 0], x, v), t, {"drag": "stokes"})
    return setting, Answer(x + v * tau * gone + g * tau * settled, v * (1 - gone) + g * tau * gone)


@problem(
    "linear-projectile", "a throw with linear drag lands where Lambert's function says",
    "Stewart, S.M. 2006, Eur. J. Phys. 27, 1041", "affine lines drag gravity", order=None,
)  # fmt: skip
def linear_projectile(cells: int) -> tuple[Setting, Answer]:
    from scipy.special import lambertw

    tau, u, w = 0.2, 2.0, np.array([3.0, 1.0, 4.0])
    a = (w + G * tau) / (G * tau)
    time = tau * (a + lambertw(-a * np.exp(-a)).real)
    decay = np.exp(-time / tau)
    start = np.tile([-0.4, 0.0], (3, 1))
    grains = of_tau(tau, start, np.stack([np.full(3, u), w], axis=1))
    floor = np.array([[-0.9, -1e-14], [0.9, -1e-14]])  # just below the start: a track born on a line does not cross it
    field = field_on(box(cells, high=(1.0, 1.2)), np.zeros_like)
    setting = Setting(field, grains, 9.0, {"drag": "stokes", "lines": (floor,)})
    position = start + np.stack([u * tau * (1 - decay), 0 * time], axis=1)
    velocity = np.stack([u * decay, w * decay - G * tau * (1 - decay)], axis=1)
    return setting, Answer(position, velocity, time, Fate.BINNED)


def _constant_drag(terminal: Array) -> tuple[float, Array]:
    """Diameter and density of granules whose drag coefficient is Putnam's 0.424 at any speed, in air of 1e-10 Pa s.

    0.424 as the tracker's table has it, to 1e-8: its own error is tested with the laws.
    """
    reynolds = 1e9
    coefficient = 24 / reynolds * scalar_drag("putnam", 1.0)(reynolds)
    return 1.0, 3 * coefficient * DENSITY * terminal**2 / (4 * G)


@problem(
    "quadratic-settling", "constant drag coefficient: v = v_t tanh(g t / v_t)",
    "Parker, G.W. 1977, Am. J. Phys. 45, 606", "affine nonlinear drag gravity",
)  # fmt: skip
def quadratic_settling(cells: int) -> tuple[Setting, Answer]:
    terminal, t = np.array([8.0, 3.0]), 1.0
    start = np.array([[0.1, 0.6], [-3.0, 5.0]])
    diameter, density = _constant_drag(terminal)
    field = field_on(box(cells, (-10.0, -10.0), (10.0, 10.0)), np.zeros_like, viscosity=1e-10)
    setting = Setting(field, without_slip(start, 0 * start, diameter, density), t, {"drag": "putnam"})
    drop = terminal**2 / G * np.log(np.cosh(G * t / terminal))
    speed = terminal * np.tanh(G * t / terminal)
    return setting, Answer(start - np.outer(drop, [0, 1]), -np.outer(speed, [0, 1]))


@problem(
    "quadratic-throw", "thrown up at w0 with a constant drag coefficient: height v_t^2 / 2g ln(1 + w0^2 / v_t^2), and"
    " back", "Parker, G.W. 1977, Am. J. Phys. 45, 606", "affine nonlinear drag gravity",
)  # fmt: skip
def quadratic_throw(cells: int) -> tuple[Setting, Answer]:
    terminal, w, t = np.array([8.0, 3.0, 8.0]), np.array([10.0, 6.0, 20.0]), 1.5
    start = np.array([[0.1, -3.0], [-3.0, 2.0], [2.0, -5.0]])
    diameter, density = _constant_drag(terminal)
    field = field_on(box(cells, (-10.0, -10.0), (10.0, 10.0)), np.zeros_like, viscosity=1e-10)
    grains = without_slip(start, np.outer(w, [0, 1]), diameter, density)
    late = G * (t - terminal / G * np.arctan(w / terminal)) / terminal
    height = terminal**2 / (2 * G) * np.log1p((w / terminal) ** 2) - terminal**2 / G * np.log(np.cosh(late))
    answer = Answer(start + np.outer(height, [0, 1]), np.outer(-terminal * np.tanh(late), [0, 1]))
    return Setting(field, grains, t, {"drag": "putnam"}), answer


@problem(
    "oscillating-flow", "uniform air that swings, as the tracker sees it: piecewise linear in time",
    "Hjelmfelt, A.T. & Mockros, L.F. 1966, Appl. Sci. Res. 16, 149 (their Stokes limit)",
    "affine time-dependent stiff drag", order=None, cells=2,
)  # fmt: skip
def oscillating_flow(cells: int) -> tuple[Setting, Answer]:
    omega, speed, knots = 20.0, 0.3, 24
    period, tau = 2 * np.pi / omega, np.array([1e-9, 1e-6, 1e-3, 0.04, 1.0, 1e3])
    times = np.arange(knots) * period / knots
    mesh = box(cells)
    values = np.zeros((knots, len(mesh[0]), 2))
    values[..., 0] = speed * np.sin(omega * times)[:, None]
    field = field_on(mesh, values, times=times, period=period)
    x, v = np.zeros(len(tau)), np.zeros(len(tau))
    pieces = 5 * knots // 2
    for k in range(pieces):  # v' = (u + u' s - v) / tau over each piece of length h
        h, u = period / knots, speed * np.sin(omega * times[k % knots])
        rise = (speed * np.sin(omega * times[(k + 1) % knots]) - u) / h
        z = h / tau
        e, one = np.exp(-z), -np.expm1(-z)
        two = np.where(z < 1e-2, z / 2 - z**2 / 6 + z**3 / 24 - z**4 / 120 + z**5 / 720, 1 - one / z)
        three = np.where(z < 1e-2, z / 6 - z**2 / 24 + z**3 / 120 - z**4 / 720, 0.5 - two / z)
        x, v = x + tau * one * v + h * two * u + h * h * three * rise, e * v + one * u + h * two * rise
    still = np.zeros((len(tau), 2))
    setting = Setting(field, of_tau(tau, still, still), pieces * period / knots, DRAG_ONLY)
    return setting, Answer(np.stack([x, 0 * x], axis=1), np.stack([v, 0 * v], axis=1))


def modes(rate: complex | Array, tau: Array) -> tuple[Array, Array]:
    """Exponents (slow, fast) of tau z'' + z' = rate z, without cancellation: (-1 +- sqrt(1 + 4 rate tau)) / 2 tau."""
    root = np.sqrt(1 + 4 * rate * tau + 0j)
    return 2 * rate / (1 + root), -(1 + root) / (2 * tau)


def two_modes(rate: complex, tau: Array, z: Any, w: Any, t: float) -> tuple[Array, Array]:
    """Place and velocity at t from z and w under tau z'' + z' = rate z."""
    slow, fast = modes(rate, tau)
    b = (w - slow * z) / (fast - slow)
    a, b = (z - b) * np.exp(slow * t), b * np.exp(fast * t)
    return a + b, a * slow + b * fast


@problem(
    "solid-rotation", "growth rate (-1 + sqrt(1 + 4 i S)) / 2 tau in air that turns as a whole, S = Omega tau",
    "Maxey, M.R. & Riley, J.J. 1983, Phys. Fluids 26, 883, Stokes drag only", "affine stiff drag",
)  # fmt: skip
def solid_rotation(cells: int) -> tuple[Setting, Answer]:
    omega, t = 5.0, 0.5
    tau = np.array([1e-9, 1e-5, 1e-3, 0.01, 0.1, 0.2, 0.4, 3.0, 1e3])
    z, w = two_modes(1j * omega, tau, 0.3 + 0.13j, 0.5 - 0.4j, t)
    field = field_on(box(cells), lambda p: omega * np.stack([-p[:, 1], p[:, 0]], axis=1))
    grains = of_tau(tau, np.tile([0.3, 0.13], (9, 1)), np.tile([0.5, -0.4], (9, 1)))
    answer = Answer(np.stack([z.real, z.imag], axis=1), np.stack([w.real, w.imag], axis=1))
    return Setting(field, grains, t, DRAG_ONLY), answer


@problem(
    "plane-stagnation", "tau x'' + x' = -a x towards the line, +a along it", "Langmuir, I. & Blodgett, K.B. 1946, "
    "Army Air Forces TR 5418: roots of their stagnation flow", "affine stiff drag",
)  # fmt: skip
def plane_stagnation(cells: int) -> tuple[Setting, Answer]:
    a, t = 4.0, 0.4
    tau = np.array([1e-9, 1e-5, 1e-3, 0.02, 0.07, 0.2, 3.0, 1e3])
    field = field_on(box(cells), lambda p: p * [a, -a])
    x, vx = two_modes(a, tau, 0.1, 0.3, t)
    y, vy = two_modes(-a, tau, 0.7, -1.0, t)
    grains = of_tau(tau, np.tile([0.1, 0.7], (8, 1)), np.tile([0.3, -1.0], (8, 1)))
    answer = Answer(np.stack([x.real, y.real], axis=1), np.stack([vx.real, vy.real], axis=1))
    return Setting(field, grains, t, DRAG_ONLY), answer


@problem(
    "critical-stokes-number", "a granule crosses the stagnation line when a tau > 1/4, at a known time and place",
    "Langmuir, I. & Blodgett, K.B. 1946, Army Air Forces TR 5418", "affine lines drag",
)  # fmt: skip
def critical_stokes_number(cells: int) -> tuple[Setting, Answer]:
    a, y0, x0, t = 2.0, 0.9, 0.01, 4.0
    stokes = np.array([0.20, 0.24, 0.27, 0.30, 0.40, 1.0])
    tau, count = stokes / a, len(stokes)
    slow, fast = modes(-a, tau)
    b = (-a * y0 - slow * y0) / (fast - slow)  # starts with the air's velocity
    growth, decay = modes(a, tau)
    c = (a * x0 - growth * x0) / (decay - growth)
    crosses = stokes > 0.25
    swing = slow.imag[crosses]
    time = np.full(count, t)
    # y = 2 Re((y0 - b) exp(slow t)) with conjugate roots: zero at the first odd multiple of pi / 2
    time[crosses] = np.mod(np.pi / 2 - np.angle((y0 - b)[crosses]), np.pi) / swing
    y = ((y0 - b) * np.exp(slow * time) + b * np.exp(fast * time)).real
    x = ((x0 - c) * np.exp(growth * time) + c * np.exp(decay * time)).real
    field = field_on(box(cells, (-40.0, 0.0), (40.0, 1.0)), lambda p: p * [a, -a])
    grains = of_tau(tau, np.tile([x0, y0], (count, 1)), np.tile([a * x0, -a * y0], (count, 1)))
    fate = np.where(crosses, Fate.ESCAPED, Fate.AIRBORNE)
    answer = Answer(np.stack([x, np.where(crosses, 0.0, y)], axis=1), None, time, fate)
    return Setting(field, grains, t, DRAG_ONLY), answer


@problem(
    "settling-through-a-profile", "linear drag across layers of shear: a parabolic profile sampled on rows of cells",
    "linear equations in every row, joined by their matrix exponentials", "curved drag gravity", cells=8,
)  # fmt: skip
def settling_through_a_profile(cells: int) -> tuple[Setting, Answer]:
    from scipy.linalg import expm
    from scipy.optimize import brentq

    tau, t, v0 = np.array([0.02, 0.1, 0.5]), 0.35, np.array([0.4, -3.0])
    points, triangles = box(cells, jitter=0.0)
    field = field_on((points, triangles), np.stack([3 * (1 - points[:, 1] ** 2), 0 * points[:, 1]], axis=1))
    rows = np.linspace(-1, 1, cells + 1)
    ends = []
    for lag in tau:

        def height(s: float, lag: float = lag) -> float:
            return float(0.9 + lag * (v0[1] + G * lag) * -np.expm1(-s / lag) - G * lag * s)

        passed = [brentq(lambda s, r=r: height(s) - r, 0, t, xtol=1e-15) for r in rows if height(t) < r < 0.9]
        clock = [0.0, *sorted(passed), t]
        state = np.array([-0.7, 0.9, *v0, 1.0])
        for start, end in pairwise(clock):
            row = int(np.searchsorted(rows, height(0.5 * (start + end)))) - 1
            low, high = 3 * (1 - rows[row] ** 2), 3 * (1 - rows[row + 1] ** 2)
            slope = (high - low) / (rows[row + 1] - rows[row])
            system = np.zeros((5, 5))
            system[0, 2] = system[1, 3] = 1.0
            system[2] = np.array([0, slope, -1, 0, low - slope * rows[row]]) / lag
            system[3] = np.array([0, 0, 0, -1 / lag, -G])
            state = expm(system * (end - start)) @ state
        ends.append(state[:4])
    grains = of_tau(tau, np.tile([-0.7, 0.9], (3, 1)), np.tile(v0, (3, 1)))
    end_states = np.array(ends)
    return Setting(field, grains, t, {"drag": "stokes"}), Answer(end_states[:, :2], end_states[:, 2:])


# -- nonlinear drag in curved air, judged ------------------------------------------------------------------------------


def taylor_green(points: Array) -> Array:
    """Cells of 1 m with a mean stream: 2 (sin pi x cos pi y, -0.8 - cos pi x sin pi y) m/s; free of divergence."""
    x, y = np.pi * points.T
    return 2 * np.stack([np.sin(x) * np.cos(y), -0.8 - np.cos(x) * np.sin(y)], axis=1)


@problem(
    "nonlinear-drag-in-cells", "Brown & Lawler's drag in Taylor-Green cells with a mean stream",
    "Maxey, M.R. 1987, Phys. Fluids 30, 1915 (cellular flow); the reference integrator",
    "curved nonlinear judged drag gravity",
    cells=12,
)  # fmt: skip
def nonlinear_drag_in_cells(cells: int) -> tuple[Setting, Answer]:
    diameter = np.array([4e-3, 1e-3, 3e-4])
    start, speed = np.array([[0.23, 0.71], [-0.31, 0.64], [0.6, 0.8]]), np.array([[0.8, -0.3], [1.0, 0.5], [-1.0, 0.0]])
    setting = Setting(field_on(box(cells), taylor_green), without_slip(start, speed, diameter, 900.0), 0.25)
    end = reference_end_states(setting)
    return setting, Answer(end[:, :2], end[:, 2:4])


@problem(
    "dust-in-cells", "stiff granules with nonlinear drag in Taylor-Green cells", "the reference integrator, Radau",
    "curved nonlinear stiff judged drag gravity", cells=12,
)  # fmt: skip
def dust_in_cells(cells: int) -> tuple[Setting, Answer]:
    diameter = np.array([1e-4, 3e-5, 3e-6])
    start, speed = np.array([[0.23, 0.71], [-0.31, 0.64], [0.6, 0.8]]), np.array([[0.8, -0.3], [1.0, 0.5], [-1.0, 0.0]])
    setting = Setting(field_on(box(cells), taylor_green), without_slip(start, speed, diameter, 900.0), 0.1)
    end = reference_end_states(setting, stiff=True, rtol=1e-10)
    return setting, Answer(end[:, :2], end[:, 2:4])


@problem(
    "snapshots-of-cells", "nonlinear drag in Taylor-Green cells whose strength changes from snapshot to snapshot",
    "the reference integrator", "curved nonlinear time-dependent judged drag gravity", cells=6,
)  # fmt: skip
def snapshots_of_cells(cells: int) -> tuple[Setting, Answer]:
    mesh, times = box(cells), np.array([0.0, 0.03, 0.08, 0.11])
    values = np.stack([taylor_green(mesh[0]) * (1 + 0.5 * np.sin(40 * t)) for t in times])
    field = field_on(mesh, values, times=times, period=0.13)
    start, speed = np.array([[0.23, 0.71], [-0.31, 0.64]]), np.array([[0.8, -0.3], [1.0, 0.5]])
    setting = Setting(field, without_slip(start, speed, np.array([1e-3, 3e-4]), 900.0), 0.2)
    end = reference_end_states(setting)
    return setting, Answer(end[:, :2], end[:, 2:4])


# -- walls -------------------------------------------------------------------------------------------------------------


@problem(
    "bounce-on-a-slope", "nonlinear drag in curved air, a bounce with friction on a slope, and on",
    "the reference integrator",
    "curved nonlinear walls judged drag gravity", cells=8,
)  # fmt: skip
def bounce_on_a_slope(cells: int) -> tuple[Setting, Answer]:
    angle = 0.5
    along, normal = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    foot = np.array([0.0, -0.9])
    slope = Body(np.stack([foot + 8 * along, foot - 8 * along]), open=True)  # solid on its left: below
    start, speed = np.array([[-0.31, 0.64], [0.1, 0.3], [-0.5, 0.2]]), np.array([[1.0, -4.0], [0.3, -5.0], [0.6, -3.0]])
    grains = without_slip(start, speed, np.array([1e-3, 2e-3, 4e-3]), 900.0, restitution=0.6, friction=0.2)
    field = field_on(box(cells, (-1.0, -1.5), (1.5, 1.0)), taylor_green)
    setting = Setting(field, grains, 0.6, {"bodies": (slope,), "length": 1.0})
    end = reference_end_states(setting, [Plane(tuple(foot), tuple(normal))])
    return setting, Answer(end[:, :2], end[:, 2:4])


@problem(
    "bouncing-ball", "dropped from h it comes to rest after sqrt(2h/g) (1 + e) / (1 - e)",
    "Bernstein, A.D. 1977, Am. J. Phys. 45, 41", "walls ballistic gravity", order=None,
)  # fmt: skip
def bouncing_ball(cells: int) -> tuple[Setting, Answer]:
    e, radius, h = np.array([0.0, 0.3, 0.5, 0.8, 0.9]), 0.01, 0.5
    x = np.linspace(-0.4, 0.4, 5)
    floor = Body(np.array([[0.5, 0.0], [-0.5, 0.0]]), open=True)  # solid below
    grains = without_slip(
        np.stack([x, np.full(5, radius + h)], axis=1), np.zeros((5, 2)), 2 * radius, 1000.0, restitution=e
    )
    time = np.sqrt(2 * h / G) * (1 + e) / (1 - e)
    setting = Setting(None, grains, 30.0, {"bodies": (floor,), "length": 1.0, "forces": ("gravity",)})
    return setting, Answer(np.stack([x, np.full(5, radius)], axis=1), np.zeros((5, 2)), time, Fate.RESTING)
