"""Exact problems of the single terms beside drag and gravity: buoyancy, pressure, added mass, lift, Magnus and spin."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.problems.exact import DENSITY, VISCOSITY, Answer, G, Setting, box, field_on, problem
from proofs.problems.flights import taylor_green
from proofs.problems.reference_all_terms import reference_end_states
from support import without_slip
from wakeflow.flight import Granules
from wakeflow.laws.lift import magnus_factor

Array = NDArray[np.float64]
DOWN = np.array([0.0, -G])
MAXEY_RILEY = "Maxey, M.R. & Riley, J.J. 1983, Phys. Fluids 26, 883; Auton, Hunt & Prud'homme 1988, J. Fluid Mech. 197"


def _with(tau: Array, ratio: Array, start: Array, speed: Array, **more: Any) -> Granules:
    """Granules of given relaxation times (n,) s and density ratios rho / rho_p (n,)."""
    density = DENSITY / np.asarray(ratio, dtype=float)
    count = len(density)
    diameter = np.sqrt(18 * VISCOSITY * np.asarray(tau, dtype=float) / density)
    return without_slip(np.tile(start, (count, 1)), np.tile(speed, (count, 1)), diameter, density, **more)


@problem(
    "linear-pressure", "weight, buoyancy and a uniform pressure gradient: a parabola", "Archimedes",
    "affine gravity buoyancy pressure-gradient", order=None,
)  # fmt: skip
def linear_pressure(cells: int) -> tuple[Setting, Answer]:
    mesh, slope, t = box(cells), np.array([12.0, -5.0]), 0.1
    density = np.array([2.4, 1.2, 0.8, 1000.0])
    start = np.tile([0.1, 0.2], (4, 1))
    field = field_on(mesh, np.zeros_like, pressure=mesh[0] @ slope)
    grains = without_slip(start, np.tile([0.3, 0.2], (4, 1)), 1e-3, density)
    pull = DOWN * (1 - DENSITY / density)[:, None] - slope / density[:, None]
    setting = Setting(field, grains, t, {"forces": ("gravity", "buoyancy", "pressure-gradient")})
    return setting, Answer(start + t * grains.velocity + 0.5 * t * t * pull, grains.velocity + t * pull)


@problem(
    "light-sphere", "without drag a sphere of density ratio s = rho / rho_p rises with g (s - 1) / (1 + s / 2)",
    "Batchelor, G.K. 1967, An Introduction to Fluid Dynamics, 6.8: 2 g for a void",
    "affine gravity buoyancy added-mass", order=None,
)  # fmt: skip
def light_sphere(cells: int) -> tuple[Setting, Answer]:
    ratio, t = np.array([1e-3, 0.5, 1.0, 2.0, 10.0, 1e6]), 0.2
    grains = _with(np.ones(6), ratio, np.array([0.1, -0.2]), np.array([0.3, 0.1]))
    pull = DOWN * ((1 - ratio) / (1 + 0.5 * ratio))[:, None]
    setting = Setting(field_on(box(cells), np.zeros_like), grains, t, {"forces": ("gravity", "buoyancy", "added-mass")})
    answer = Answer(grains.position + t * grains.velocity + 0.5 * t * t * pull, grains.velocity + t * pull)
    return setting, answer


@problem(
    "light-sphere-with-drag", "Stokes drag, buoyancy and added mass: settling with the time tau (1 + s / 2)",
    MAXEY_RILEY, "affine stiff drag gravity buoyancy added-mass", order=None,
)  # fmt: skip
def light_sphere_with_drag(cells: int) -> tuple[Setting, Answer]:
    tau, ratio = np.array([1e-6, 1e-3, 0.05, 0.2, 0.05, 0.1]), np.array([2.0, 2.0, 2.0, 0.5, 1e-3, 50.0])
    t, v = 0.25, np.array([0.8, -0.3])
    slow = (tau * (1 + 0.5 * ratio))[:, None]
    terminal = DOWN * ((1 - ratio) * tau)[:, None]
    gone = -np.expm1(-t / slow)
    grains = _with(tau, ratio, np.array([-0.5, 0.1]), v)
    forces = ("drag", "gravity", "buoyancy", "added-mass")
    setting = Setting(
        field_on(box(cells, (-1, -1), (1, 4)), np.zeros_like), grains, t, {"forces": forces, "drag": "stokes"}
    )
    position = grains.position + terminal * t + (v - terminal) * slow * gone
    return setting, Answer(position, terminal + (v - terminal) * (1 - gone))


@problem(
    "neutral-sphere", "of the air's density, with pressure gradient, added mass and any drag, it flies as the air does",
    MAXEY_RILEY, "affine drag pressure-gradient added-mass",
)  # fmt: skip
def neutral_sphere(cells: int) -> tuple[Setting, Answer]:
    a, t, start = 4.0, 0.4, np.array([0.1, 0.7])
    mesh = box(cells)
    x, y = mesh[0].T
    field = field_on(mesh, mesh[0] * [a, -a], pressure=-0.5 * DENSITY * a * a * (x * x + y * y))
    grains = _with(np.array([1e-3, 0.1, 10.0]), np.ones(3), start, start * [a, -a])
    end = start * np.exp([a * t, -a * t])
    setting = Setting(field, grains, t, {"forces": ("drag", "pressure-gradient", "added-mass"), "drag": "stokes"})
    return setting, Answer(np.tile(end, (3, 1)), np.tile(end * [a, -a], (3, 1)))


@problem(
    "stagnation-with-added-mass", "plane strain with its pressure: (1 + chi) x'' = (a x - x') / tau + 3 chi a^2 x",
    MAXEY_RILEY, "affine stiff drag pressure-gradient added-mass",
)  # fmt: skip
def stagnation_with_added_mass(cells: int) -> tuple[Setting, Answer]:
    a, t, start, speed = 4.0, 0.2, np.array([0.1, 0.7]), np.array([0.3, -1.0])
    tau, ratio = np.array([1e-5, 1e-2, 0.1, 0.1, 1.0]), np.array([2.0, 2.0, 0.5, 5.0, 1e-2])
    mesh = box(cells)
    x, y = mesh[0].T
    field = field_on(mesh, mesh[0] * [a, -a], pressure=-0.5 * DENSITY * a * a * (x * x + y * y))
    chi = 0.5 * ratio
    places, speeds = [], []
    for strain, z, w in zip((a, -a), start, speed, strict=True):
        root = np.sqrt(1 / tau**2 + 4 * (1 + chi) * (strain / tau + 3 * chi * a * a) + 0j)
        slow, fast = 2 * (strain / tau + 3 * chi * a * a) / (1 / tau + root), -(1 / tau + root) / (2 * (1 + chi))
        b = (w - slow * z) / (fast - slow)
        one, two = (z - b) * np.exp(slow * t), b * np.exp(fast * t)
        places.append((one + two).real)
        speeds.append((slow * one + fast * two).real)
    setting = Setting(
        field,
        _with(tau, ratio, start, speed),
        t,
        {"forces": ("drag", "pressure-gradient", "added-mass"), "drag": "stokes"},
    )
    return setting, Answer(np.stack(places, axis=1), np.stack(speeds, axis=1))


@problem(
    "swinging-air-with-added-mass", "uniform air, piecewise linear in time: added mass acts by its acceleration",
    MAXEY_RILEY, "affine time-dependent drag added-mass", order=None, cells=2,
)  # fmt: skip
def swinging_air_with_added_mass(cells: int) -> tuple[Setting, Answer]:
    knots, period = 12, 0.3
    tau, ratio = np.array([1e-3, 0.02, 0.4]), np.array([2.0, 0.5, 10.0])
    slow, push = tau * (1 + 0.5 * ratio), 0.5 * ratio / (1 + 0.5 * ratio)
    mesh, times = box(cells), np.arange(knots) * period / knots
    speed = 0.5 * np.sin(2 * np.pi * times / period)
    values = np.zeros((knots, len(mesh[0]), 2))
    values[..., 0] = speed[:, None]
    x, v, h = np.zeros(3), np.zeros(3), period / knots
    for k in range(30):  # v' = (u + u' s - v) / slow + push u'
        u, rise = speed[k % knots], (speed[(k + 1) % knots] - speed[k % knots]) / h
        level, gone = u + rise * (slow * push - slow), -np.expm1(-h / slow)  # v -> level + rise s
        x, v = (
            x + level * h + 0.5 * rise * h * h + (v - level) * slow * gone,
            level + rise * h + (v - level) * (1 - gone),
        )
    setting = Setting(
        field_on(mesh, values, times=times, period=period), _with(tau, ratio, np.zeros(2), np.zeros(2)), 30 * h,
        {"forces": ("drag", "added-mass"), "drag": "stokes"},
    )  # fmt: skip
    return setting, Answer(np.stack([x, 0 * x], axis=1), np.stack([v, 0 * v], axis=1))


@problem(
    "saffman-lift", "linear shear, Stokes drag, gravity and the lift of vanishing Re: a linear system",
    "Saffman, P.G. 1965, J. Fluid Mech. 22, 385", "affine drag gravity lift",
)  # fmt: skip
def saffman_lift(cells: int) -> tuple[Setting, Answer]:
    from scipy.linalg import expm

    # Re << sqrt(Re_w): granules vastly larger than the flow, in air as thick. Only ratios count.
    shear, t, tau = 5.0, 0.4, np.array([0.02, 0.1, 0.5])
    shear_reynolds, diameter = np.array([1.0, 4.0, 9.0]), 1e20 * np.array([1.0, 2.0, 3.0])
    viscosity = DENSITY * shear * diameter[0] ** 2 / shear_reynolds[0]
    density = 18 * viscosity * tau / diameter**2
    start, speed = np.array([-0.3, 0.6]), np.array([0.5, -1.0])
    ends = []
    for k in range(3):
        c = DENSITY / density[k] * 3 * 6.46 / (2 * np.pi * np.sqrt(shear_reynolds[k])) * shear
        system = np.zeros((5, 5))
        system[0, 2] = system[1, 3] = 1.0
        system[2] = np.array([0, shear, -1, 0, 0]) / tau[k] + c * np.array([0, 0, 0, 1, 0])
        system[3] = np.array([0, 0, 0, -1 / tau[k], -G]) + c * np.array([0, shear, -1, 0, 0])
        ends.append(expm(system * t) @ [*start, *speed, 1.0])
    field = field_on(box(cells), lambda p: np.stack([shear * p[:, 1], 0 * p[:, 1]], axis=1), viscosity=viscosity)
    grains = without_slip(np.tile(start, (3, 1)), np.tile(speed, (3, 1)), diameter, density)
    end = np.array(ends)
    return Setting(field, grains, t, {"forces": ("drag", "gravity", "lift"), "drag": "stokes"}), Answer(
        end[:, :2], end[:, 2:4]
    )


@problem(
    "magnus-circle", "in still air without drag, at constant spin: a circle at constant speed",
    "Rubinow & Keller 1961, J. Fluid Mech. 11, 447; Oesterle & Bui Dinh 1998, Exp. Fluids 25, 16", "affine magnus",
)  # fmt: skip
def magnus_circle(cells: int) -> tuple[Setting, Answer]:
    t, density, diameter = 0.5, np.array([30.0, 300.0, 3.0]), np.array([4e-3, 3e-3, 1e-4])
    spin, speed = np.array([300.0, -2000.0, 5.0]), np.array([2.0 + 0.5j, -1.0, 1.0j])
    per = DENSITY * diameter / VISCOSITY
    c = np.array([magnus_factor(r, s) for r, s in zip(np.abs(speed) * per, np.abs(spin) * diameter * per, strict=True)])
    rate = 0.75 * DENSITY / density * c * spin
    start = np.array([-0.5 + 0.0j, 0.4, -0.2 - 0.6j])
    end, after = start + speed * (np.exp(1j * rate * t) - 1) / (1j * rate), speed * np.exp(1j * rate * t)
    grains = without_slip(_plane(start), _plane(speed), diameter, density, spin=spin)  # a point mass keeps its spin
    setting = Setting(field_on(box(cells, (-2, -2), (2, 2)), np.zeros_like), grains, t, {"forces": ("magnus",)})
    return setting, Answer(_plane(end), _plane(after), spin=spin)


def _plane(z: Array) -> Array:
    return np.stack([z.real, z.imag], axis=1)


@problem(
    "spin-decay", "slow spin of a sphere falls exponentially, rate 60 mu / (rho_p d^2), to half the air's vorticity",
    "Kirchhoff 1876; Rubinow & Keller 1961, J. Fluid Mech. 11, 447", "affine stiff magnus", order=None,
)  # fmt: skip
def spin_decay_problem(cells: int) -> tuple[Setting, Answer]:
    t, omega, density, diameter = 0.5, 3.0, np.full(4, 1e6), np.array([1e-5, 1e-4, 3e-4, 1e-3])
    spin = np.array([20.0, -40.0, 30.0, -10.0])
    decay = np.exp(-60 * VISCOSITY / (density * diameter**2) * t)
    middle = np.zeros((4, 2))  # without slip nothing moves them
    field = field_on(box(cells), lambda p: omega * np.stack([-p[:, 1], p[:, 0]], axis=1))
    setting = Setting(
        field, without_slip(middle, middle, diameter, density, spin=spin, inertia=0.4), t, {"forces": ("magnus",)}
    )
    return setting, Answer(middle, middle, spin=omega + (spin - omega) * decay)


@problem(
    "magnus-spin-down", "in still air without drag: constant speed, on an arc that unbends as the spin decays at finite"
    " Re", "the reference integrator", "affine nonlinear judged magnus",
)  # fmt: skip
def magnus_spin_down(cells: int) -> tuple[Setting, Answer]:
    diameter, density = np.array([1e-3, 3e-3, 3e-3]), np.array([3.0, 30.0, 10.0])
    start, speed = np.array([[-0.5, 0.0], [0.4, 0.1], [-0.2, -0.6]]), np.array([[1.0, 0.5], [-1.0, 0.0], [0.0, 1.0]])
    grains = without_slip(start, speed, diameter, density, spin=np.array([2000.0, -3000.0, 500.0]), inertia=0.4)
    setting = Setting(field_on(box(cells), np.zeros_like), grains, 0.4, {"forces": ("magnus",)})
    return setting, _referenced(setting)


@problem(
    "spinning-throw", "drag, gravity, Magnus and the torque at finite Re, in a linear shear",
    "the reference integrator",
    "affine nonlinear judged drag gravity magnus",
)  # fmt: skip
def spinning_throw(cells: int) -> tuple[Setting, Answer]:
    diameter, density = np.array([4e-3, 1e-3, 3e-4]), np.array([60.0, 200.0, 900.0])
    start, speed = np.tile([-0.4, 0.2], (3, 1)), np.tile([2.0, 1.0], (3, 1))
    grains = without_slip(start, speed, diameter, density, spin=np.array([900.0, -3000.0, 2e4]), inertia=0.4)
    field = field_on(box(cells), lambda p: np.stack([4 * p[:, 1], 0 * p[:, 1]], axis=1))
    setting = Setting(field, grains, 0.2, {"forces": ("drag", "gravity", "magnus")})
    return setting, _referenced(setting)


def _referenced(setting: Setting, stiff: bool = False) -> Answer:
    end = reference_end_states(setting, stiff=stiff, rtol=1e-10 if stiff else 1e-12)
    return Answer(end[:, :2], end[:, 2:4], spin=end[:, 4])


CELLS_START = np.array([[0.23, 0.71], [-0.31, 0.64], [0.6, 0.8]])
CELLS_SPEED = np.array([[0.8, -0.3], [1.0, 0.5], [-1.0, 0.0]])


@problem(
    "lift-in-cells", "shear lift in Taylor-Green cells: the air's vorticity jumps at every face",
    "the reference integrator",
    "curved nonlinear judged drag gravity lift", cells=8,
)  # fmt: skip
def lift_in_cells(cells: int) -> tuple[Setting, Answer]:
    grains = without_slip(CELLS_START, CELLS_SPEED, np.array([2e-3, 1e-3, 3e-4]), np.array([50.0, 100.0, 300.0]))
    setting = Setting(field_on(box(cells), taylor_green), grains, 0.2, {"forces": ("drag", "gravity", "lift")})
    return setting, _referenced(setting)


@problem(
    "all-terms-in-cells", "every deterministic term at once, light and heavy spheres that spin",
    "the reference integrator",
    "curved nonlinear judged drag gravity buoyancy pressure-gradient added-mass lift magnus", cells=8,
)  # fmt: skip
def all_terms_in_cells(cells: int) -> tuple[Setting, Answer]:
    mesh = box(cells)
    x, y = 2 * np.pi * mesh[0].T
    field = field_on(mesh, taylor_green, pressure=DENSITY * (np.cos(x) + np.cos(y)))
    density = np.array([0.6, 20.0, 600.0])
    grains = without_slip(
        CELLS_START,
        CELLS_SPEED,
        np.array([3e-3, 1e-3, 3e-4]),
        density,
        spin=np.array([100.0, -500.0, 2000.0]),
        inertia=0.4,
    )
    forces = ("drag", "gravity", "buoyancy", "pressure-gradient", "added-mass", "lift", "magnus")
    setting = Setting(field, grains, 0.15, {"forces": forces})
    return setting, _referenced(setting)
