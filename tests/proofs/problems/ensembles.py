"""Exact numbers that an ensemble of granules gives: impaction efficiency, trapping threshold, response to swinging air,
spreading.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from proofs.problems.exact import VISCOSITY, ExactNumber, box, exact_numbers, field_on, of_tau, ring
from wakeflow.field import FlowField
from wakeflow.laws.turbulence import brownian_diffusivity, lifetime
from wakeflow.tracking import Body, Fate, Granules, track

Array = NDArray[np.float64]


def number(
    name: str, means: str, source: str, tags: str, labels: tuple[str, ...], low: object, high: object,
    exact: object = None,
) -> Callable[[Callable[[float], Array]], Callable[[float], Array]]:  # fmt: skip
    """Decorator that registers a function ``measure(tolerance) -> values``, which lie between ``low`` and ``high``."""

    def add(measure: Callable[[float], Array]) -> Callable[[float], Array]:
        known = None if exact is None else np.asarray(exact, dtype=float)
        least, most = (np.broadcast_to(np.asarray(b, dtype=float), (len(labels),)) for b in (low, high))
        exact_numbers.add(
            name, ExactNumber(means, source, frozenset(tags.split()), measure, least, most, labels, known)
        )
        return measure

    return add


# Trajectories by LSODA (relative tolerance 1e-10) from 50 radii upstream; spread below 1e-4 to K = 4, 1e-3 at 20.
# Langmuir & Blodgett's differential analyser gave 0.045, 0.129, 0.253, 0.358, 0.506, 0.696, 0.803, 0.864, 0.926.
INERTIA = np.array([0.256, 0.4, 0.625, 0.9, 1.6, 3.6, 6.4, 10.0, 19.6])
CAUGHT = np.array([0.04269, 0.12999, 0.24656, 0.35172, 0.51655, 0.71295, 0.81429, 0.87147, 0.92896])


def past_a_cylinder(points: Array) -> Array:
    """Potential flow of unit speed past a cylinder of unit radius: 1 - (cos 2 theta, sin 2 theta) / r^2."""
    x, y = points.T
    r2 = x * x + y * y
    return np.stack([1 - (x * x - y * y) / r2**2, -2 * x * y / r2**2], axis=1)


@number(
    "impaction-on-a-cylinder", "share of the granules ahead of a cylinder in potential flow that hit it, against K = "
    "tau U / R", "Langmuir, I. & Blodgett, K.B. 1946, Army Air Forces TR 5418, Stokes drag; recomputed with LSODA",
    "curved walls drag", tuple(f"K = {k:g}" for k in INERTIA), CAUGHT - 0.005, CAUGHT + 0.005, CAUGHT,
)  # fmt: skip
def impaction_on_a_cylinder(tolerance: float) -> Array:
    angles = np.linspace(0, np.pi, 181)
    field = field_on(ring(np.geomspace(1.0, 50.0, 161), angles), past_a_cylinder)
    outline = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    body = Body(np.concatenate([outline, (outline * [1, -1])[-2:0:-1]]), capture=True)
    low, high, rays = np.zeros(len(INERTIA)), np.ones(len(INERTIA)), 24
    for _ in range(3):  # the share ends where granules begin to miss the cylinder: narrowed down
        height = low[:, None] + np.outer(high - low, (np.arange(rays) + 0.5) / rays)
        start = np.stack([np.full(height.size, -49.0), height.ravel()], axis=1)
        # points: their size must not count, only their relaxation time
        tau, diameter = np.repeat(INERTIA, rays), 1e-9
        grains = Granules(start, past_a_cylinder(start), diameter, 18 * VISCOSITY * tau / diameter**2)
        tracks = track(
            field, grains, until=400.0, tolerance=tolerance, length=1.0, forces=("drag",), drag="stokes", bodies=(body,)
        )
        hits = (tracks.fate == Fate.CAPTURED).reshape(height.shape).sum(axis=1)
        low, high = (
            low + (high - low) * (hits - 0.5).clip(0) / rays,
            low + (high - low) * (hits + 0.5).clip(0, rays) / rays,
        )
    return 0.5 * (low + high)


@number(
    "trapping-in-cells", "share of inertial granules that leave a Taylor-Green cell: none below St = 1/4, some above",
    "Kumar, S., Nath, A.V.S., Panchagnula, M.V. & Roy, A. 2025, arXiv 2503.07480", "curved drag",
    ("St = 0.20", "St = 0.24", "St = 0.30", "St = 0.40"), (0.0, 0.0, 0.01, 0.1), (0.0, 0.0, 1.0, 1.0),
)  # fmt: skip
def trapping_in_cells(tolerance: float) -> Array:
    half, side = np.pi / 2, 12
    mesh = box(64, (-half, -half), (3 * half, 3 * half), jitter=0.0)  # cell 0..pi, its sides along the mesh's lines
    field = field_on(mesh, cell_flow)
    line = np.pi * (np.arange(side) + 0.5) / side
    start = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    left, fine = [], min(tolerance, 1e-8)  # granules near a separatrix exponentially: errors carry them across
    for stokes in (0.20, 0.24, 0.30, 0.40):
        grains = of_tau(stokes, start, cell_flow(start))
        tracks = track(field, grains, until=30.0, tolerance=fine, length=np.pi, forces=("drag",), drag="stokes")
        left.append(np.mean(np.any((tracks.position < -1e-6) | (tracks.position > np.pi + 1e-6), axis=1)))
    return np.array(left)


def cell_flow(points: Array) -> Array:
    """(sin x cos y, -cos x sin y): cells of side pi, strain 1 at the corners, rotation 1 at the centres."""
    x, y = points.T
    return np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)], axis=1)


OMEGA, LAGS = 20.0, np.array([1e-4, 0.01, 0.05, 0.25, 5.0])
RESPONSE = np.concatenate([1 / np.hypot(1, OMEGA * LAGS), np.arctan(OMEGA * LAGS)])


@number(
    "response-to-swinging-air", "amplitude 1 / sqrt(1 + (omega tau)^2) and lag atan(omega tau) in air that swings",
    "Hjelmfelt, A.T. & Mockros, L.F. 1966, Appl. Sci. Res. 16, 149, Stokes drag only", "affine time-dependent drag",
    tuple(f"{what}, omega tau = {OMEGA * lag:g}" for what in ("amplitude", "lag") for lag in LAGS),
    RESPONSE - 1e-4, RESPONSE + 1e-4, RESPONSE,
)  # fmt: skip
def response_to_swinging_air(tolerance: float) -> Array:
    knots, period, speed = 400, 2 * np.pi / OMEGA, 0.3
    mesh, times = box(2), np.arange(knots) * period / knots
    values = np.zeros((knots, len(mesh[0]), 2))
    values[..., 0] = speed * np.sin(OMEGA * times)[:, None]
    field = field_on(mesh, values, times=times, period=period)
    amplitude, lag = RESPONSE[: len(LAGS)] * speed, RESPONSE[len(LAGS) :]
    # born on the steady oscillation and seen a quarter of a period apart: two numbers for two unknowns
    grains = of_tau(LAGS, np.zeros((len(LAGS), 2)), np.stack([-amplitude * np.sin(lag), 0 * lag], axis=1))
    seen = [
        track(field, grains, until=4.0 * period + part, tolerance=tolerance, forces=("drag",), drag="stokes").velocity[
            :, 0
        ]
        for part in (0.0, 0.25 * period)
    ]
    return np.concatenate([np.hypot(*seen) / speed, np.arctan2(-seen[0], seen[1])])


# -- spreading: sampling errors are known, so the intervals are four standard deviations -------------------------------

SWARM = 4000
SPREAD = 4 * np.sqrt(2 / (2 * SWARM))  # of a variance from 2 SWARM independent normal numbers, relative


@number(
    "taylor-dispersion", "variance of tracers in homogeneous turbulence over 2 u'^2 T^2 (t/T - 1 + exp(-t/T))",
    "Taylor, G.I. 1921, Proc. London Math. Soc. 20, 196", "affine drag dispersion",
    ("t = 0.1 T", "t = T", "t = 10 T"), 1 - SPREAD, 1 + SPREAD, (1.0, 1.0, 1.0),
)  # fmt: skip
def taylor_dispersion(tolerance: float) -> Array:
    k, dissipation = 0.015, 0.3
    field = _still(10.0, k=k, dissipation=dissipation)
    time, found = lifetime(k, dissipation), []
    for part in (0.1, 1.0, 10.0):
        grains = of_tau(np.full(SWARM, 1e-7), np.zeros((SWARM, 2)), np.zeros((SWARM, 2)))
        tracks = track(
            field, grains, until=part * time, tolerance=tolerance, length=np.sqrt(k) * time,
            forces=("drag", "dispersion"), drag="stokes", seed=1,
        )  # fmt: skip
        expected = 2 * (2 * k / 3) * time**2 * (part - 1 + np.exp(-part))
        found.append(np.mean(tracks.position**2) / expected)
    return np.array(found)


@number(
    "brownian-spreading", "variance of fine dust in still air over 2 D t", "Einstein, A. 1905, Ann. Phys. 322, 549",
    "affine drag brownian", ("t = 0.1 s", "t = 1 s"), 1 - SPREAD, 1.02 + SPREAD, (1.0, 1.0),
)  # fmt: skip
def brownian_spreading(tolerance: float) -> Array:
    return np.array([spread_of_dust(t, tolerance) for t in (0.1, 1.0)])


def spread_of_dust(t: float, tolerance: float) -> float:
    """Variance of dust of 10 um in still air after ``t`` (s) over 2 D t; its steps are as many as relaxation times."""
    diameter = 10e-6  # 1.7 % slip of the air on granules so fine is allowed for
    field, diffusivity = _still(1e-3), brownian_diffusivity(diameter, VISCOSITY)
    grains = Granules(np.zeros((SWARM, 2)), np.zeros((SWARM, 2)), diameter, 100.0)
    tracks = track(
        field, grains, until=t, tolerance=tolerance, length=np.sqrt(diffusivity * t), forces=("drag", "brownian"),
        drag="stokes", seed=1,
    )  # fmt: skip
    return float(np.mean(tracks.position**2) / (2 * diffusivity * t))


def _still(half: float, k: float = 0.0, dissipation: float = 0.0) -> FlowField:
    """A box of calm mean air."""
    points, cells = box(2, (-half, -half), (half, half))
    uniform = np.ones(len(points))
    turbulence = {"k": k * uniform, "dissipation": dissipation * uniform} if k > 0 else {}
    return field_on((points, cells), np.zeros_like, **turbulence)
