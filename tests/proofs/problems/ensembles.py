"""Exact numbers: those of ensembles of granules, and those of a ball on a vibrating table.

ensembles: Exact numbers that an ensemble of granules gives: impaction efficiency, trapping threshold, response to
swinging air, spreading.

bouncing: Exact numbers of a ball on a vibrating table: where it lifts off, and from which strength on it bounces once a
period or once in two periods. The tracker that runs in a scene flies all of it.

The table moves by a sin(w t), Gamma = a w^2 / g. A ball of restitution e that meets it at the same phase each period
leaves with g T / 2, so that cos(phase) = pi (1 - e) / ((1 + e) Gamma): the orbit is there for Gamma > Gamma_1 = pi (1 -
e) / (1 + e). Its linear map has determinant e^2 and loses its hold (multiplier -1: the period doubles) at Gamma' =
sqrt(Gamma_1^2 + (2 (1 + e^2) / (1 + e)^2)^2). Tufillaro, N.B., Abbott, T. & Reilly, J. 1992, An Experimental Approach
to Nonlinear Dynamics and Chaos, ch. 1; Luck, J.M. & Mehta, A. 1993, Phys. Rev. E 48, 3988. Without restitution the ball
rests on the table until sin(phase) = 1 / Gamma, and flies a period or more from Gamma = sqrt(1 + pi^2) on (Mehta, A. &
Luck, J.M. 1990, Phys. Rev. Lett. 65, 393; cited, not looked up).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from proofs.problems.exact import VISCOSITY, ExactNumber, G, box, exact_numbers, field_on, of_tau, ring
from support import without_slip
from wakeflow.air.field import FlowField
from wakeflow.flight import Body, Fate, Motion, Tracks, driver, track
from wakeflow.laws.turbulence import brownian_diffusivity, lifetime

# -- ensembles ---------------------------------------------------------------------------------------------------------
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
        grains = without_slip(start, past_a_cylinder(start), diameter, 18 * VISCOSITY * tau / diameter**2)
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


SWING, LAGS = 20.0, np.array([1e-4, 0.01, 0.05, 0.25, 5.0])
RESPONSE = np.concatenate([1 / np.hypot(1, SWING * LAGS), np.arctan(SWING * LAGS)])


@number(
    "response-to-swinging-air", "amplitude 1 / sqrt(1 + (omega tau)^2) and lag atan(omega tau) in air that swings",
    "Hjelmfelt, A.T. & Mockros, L.F. 1966, Appl. Sci. Res. 16, 149, Stokes drag only", "affine time-dependent drag",
    tuple(f"{what}, omega tau = {SWING * lag:g}" for what in ("amplitude", "lag") for lag in LAGS),
    RESPONSE - 1e-4, RESPONSE + 1e-4, RESPONSE,
)  # fmt: skip
def response_to_swinging_air(tolerance: float) -> Array:
    knots, period, speed = 400, 2 * np.pi / SWING, 0.3
    mesh, times = box(2), np.arange(knots) * period / knots
    values = np.zeros((knots, len(mesh[0]), 2))
    values[..., 0] = speed * np.sin(SWING * times)[:, None]
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
    "affine drag brownian", ("t = 0.1 s", "t = 1 s"), 1 - SPREAD, 1 + SPREAD, (1.0, 1.0),
)  # fmt: skip
def brownian_spreading(tolerance: float) -> Array:
    return np.array([spread_of_dust(t, tolerance) for t in (0.1, 1.0)])


def spread_of_dust(t: float, tolerance: float) -> float:
    """Variance of dust of 10 um in still air after ``t`` (s) over 2 D t; its steps are as many as relaxation times."""
    diameter = 10e-6
    field, diffusivity = _still(1e-3), brownian_diffusivity(diameter, VISCOSITY)
    grains = without_slip(np.zeros((SWARM, 2)), np.zeros((SWARM, 2)), diameter, 100.0)
    tracks = track(
        field, grains, until=t, tolerance=tolerance, length=np.sqrt(diffusivity * t), forces=("drag", "brownian"),
        drag="stokes", seed=1,
    )  # fmt: skip
    return float(np.mean(tracks.position**2) / (2 * diffusivity * t))


# A strip of 1 m of still air, in its middle (or at its end) less than 2 cm over which rms or lifetime fall steeply
FLAT, CALM, LIFE = 1.0, 0.1, 0.5  # m/s, m/s, s
TURBULENCE: dict[str, tuple[list[float], list[float], list[float]]] = {  # heights (m), rms (m/s), lifetimes (s)
    "rms 1 to 0.1 over 20 mm": ([0.0, 0.49, 0.51, 1.0], [FLAT, FLAT, CALM, CALM], [LIFE] * 4),
    "rms 0.1 to 1 over 20 mm": ([0.0, 0.49, 0.51, 1.0], [CALM, CALM, FLAT, FLAT], [LIFE] * 4),
    "rms 1 to 0.03 over 10 mm": ([0.0, 0.495, 0.505, 1.0], [FLAT, FLAT, 0.03, 0.03], [LIFE] * 4),
    "lifetime 0.5 to 0.1 s over 10 mm": ([0.0, 0.495, 0.505, 1.0], [FLAT] * 4, [LIFE, LIFE, 0.1, 0.1]),
    "both to 0 at a wall over 20 mm": ([0.0, 0.5, 0.98, 1.0], [FLAT, FLAT, FLAT, 0.0], [LIFE, LIFE, LIFE, 0.0]),
}
MIXED = 4 / np.sqrt(SWARM)  # of the share of a half, relative


@number(
    "well-mixed-strip", "share of tracers in the upper half of a strip that they filled evenly, over 1/2: eddies "
    "gather none", "Thomson, D.J. 1987, J. Fluid Mech. 180, 529", "walls drag dispersion", tuple(TURBULENCE), 1 - MIXED,
    1 + MIXED, np.ones(len(TURBULENCE)),
)  # fmt: skip
def well_mixed_strip(tolerance: float) -> Array:
    found = []
    for name in TURBULENCE:
        tracks = mixed(name, 1e-7, max(tolerance, 1e-3), 10.0)
        found.append(2.0 * np.mean(tracks.position[:, 1] > 0.5))
    return np.array(found)


@number(
    "well-mixed-strip-intervals", "change of that share by intervals of noise that last twice as long: no less than "
    "the error of the program's own", "at least first order", "walls drag dispersion", tuple(TURBULENCE),
    -math.sqrt(2.0) * MIXED, math.sqrt(2.0) * MIXED, np.zeros(len(TURBULENCE)),
)  # fmt: skip
def well_mixed_by_intervals(tolerance: float) -> Array:
    own = well_mixed_strip(tolerance)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "NOISE_STEP", 2.0 * driver.NOISE_STEP)
        return np.asarray(well_mixed_strip(tolerance) - own)


def mixed(name: str, tau: float, tolerance: float, until: float, seed: int = 1) -> Tracks:
    """Granules of relaxation time ``tau`` (s) that fill a strip of ``TURBULENCE`` evenly at rest, ``until`` (s)."""
    heights, rms, lives = TURBULENCE[name]
    low, high = heights[1:3]
    rows = np.unique(np.concatenate([np.linspace(*ends, 25) for ends in ((0.0, low), (high, 1.0))]))
    rows = np.unique(np.concatenate([rows, np.linspace(low, high, 5 if high - low < 0.1 else 25)]))
    rows = rows[np.append(True, np.diff(rows) > 1e-9)]
    places = np.stack(np.meshgrid(np.linspace(0.0, 1.0, 5), rows), axis=-1).reshape(-1, 2)
    corner = (5 * np.arange(len(rows) - 1)[:, None] + np.arange(4)).ravel()
    cells = np.concatenate(
        [np.stack([corner, corner + 1, corner + 6], 1), np.stack([corner, corner + 6, corner + 5], 1)]
    )
    k = 1.5 * np.interp(places[:, 1], heights, rms) ** 2
    dissipation = lifetime(k, np.maximum(np.interp(places[:, 1], heights, lives), 1e-9))
    field = field_on((places, cells), np.zeros_like, k=k, dissipation=dissipation)
    t, sides = 0.1, []
    for a, b, c, d in ((-t, -t, 1 + t, 0.0), (-t, 1.0, 1 + t, 1 + t), (-t, 0.0, 0.0, 1.0), (1.0, 0.0, 1 + t, 1.0)):
        sides.append(Body(np.array([[a, b], [c, b], [c, d], [a, d]]), restitution=1.0, friction=0.0))
    start = np.random.default_rng(seed).uniform(1e-3, 1 - 1e-3, (SWARM, 2))
    return track(
        field, of_tau(np.full(SWARM, tau), start, np.zeros((SWARM, 2))), until=until, tolerance=tolerance, length=1.0,
        forces=("drag", "dispersion"), drag="stokes", bodies=sides, seed=seed,
    )  # fmt: skip


def _still(half: float, k: float = 0.0, dissipation: float = 0.0) -> FlowField:
    """A box of calm mean air."""
    points, cells = box(2, (-half, -half), (half, half))
    uniform = np.ones(len(points))
    turbulence = {"k": k * uniform, "dissipation": dissipation * uniform} if k > 0 else {}
    return field_on((points, cells), np.zeros_like, **turbulence)


# -- bouncing ----------------------------------------------------------------------------------------------------------
RESTITUTIONS = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95])
TABLE = np.array([[-1.0, -0.2], [1.0, -0.2], [1.0, 0.0], [-1.0, 0.0]])
FREQUENCY, RADIUS = 20.0, 1e-3  # Hz, m
OMEGA, PERIOD = 2 * math.pi * FREQUENCY, 1 / FREQUENCY
ABOUT = np.array([0.998, 1.002])  # share of a threshold: orbits are examined just below and just above it
LENGTH = 0.1  # m
LATE = 1500  # periods after which an orbit does not change any more


def first(restitution: Array) -> Array:
    """Gamma_1: above it a ball can bounce once a period."""
    return np.asarray(math.pi * (1 - restitution) / (1 + restitution))


def doubling(restitution: Array) -> Array:
    """Gamma': above it the orbit of period one is unstable."""
    return np.asarray(np.hypot(first(restitution), 2 * (1 + restitution**2) / (1 + restitution) ** 2))


def _bounced(e: float, gamma: float, periods: int, nudge: float, tolerance: float) -> float:
    """Distance, in amplitudes, of a ball from the orbit of period one after so many periods; its first speed is off by
    the share ``nudge``. Half way between the orbit's bounces.
    """
    a = gamma * G / OMEGA**2
    phase = math.acos(min(1.0, float(first(np.array(e))) / gamma))
    height, speed, born = a * math.sin(phase) + RADIUS, 0.5 * G * PERIOD, phase / OMEGA
    tracks = _flown(e, gamma, [height], [speed * (1 + nudge)], born + 1e-12, born + (periods + 0.5) * PERIOD, tolerance)
    return float(tracks.position[0, 1] - height - 0.125 * G * PERIOD**2) / a


def _flown(
    e: float, gamma: float, height: list[float], speed: list[float], born: float, until: float, tolerance: float,
    record: bool = False,
) -> Tracks:  # fmt: skip
    count = len(height)
    grains = without_slip(
        np.stack([np.zeros(count), height], axis=1), np.stack([np.zeros(count), speed], axis=1), 2 * RADIUS, 1000.0,
        restitution=e, friction=0.0, time=born,
    )  # fmt: skip
    body = Body(TABLE, motion=Motion((0.0, gamma * G / OMEGA**2), FREQUENCY))
    return track(
        None, grains, until=until, tolerance=tolerance, length=LENGTH, bodies=[body], gravity=(0.0, -G), record=record
    )


@number(
    "period-doubling-on-a-table", "Gamma from which on a ball on a vibrating table bounces at two heights in turn",
    "Tufillaro, N.B., Abbott, T. & Reilly, J. 1992, ch. 1; Luck, J.M. & Mehta, A. 1993, Phys. Rev. E 48, 3988",
    "walls ballistic gravity", tuple(f"e = {e:g}" for e in RESTITUTIONS),
    doubling(RESTITUTIONS) * (1 - 2e-5), doubling(RESTITUTIONS) * (1 + 2e-5), doubling(RESTITUTIONS),
)  # fmt: skip
def period_doubling(tolerance: float) -> Array:
    """Where a small deviation from the orbit only changes its sign: between what is found just below and just above.

    Deviations after bounces obey x'' = trace x' - determinant x, whose two numbers four of them in turn give (without
    restitution nothing is left of x, and two do); a multiplier is -1 where 1 + trace + determinant passes zero, which
    is linear in Gamma sin(phase).
    """
    found = []
    for e, threshold in zip(RESTITUTIONS, doubling(RESTITUTIONS), strict=True):
        strengths, margin = ABOUT * threshold, []
        for strength in strengths:
            w, x, y, z = (_bounced(e, strength, k, 1e-6, tolerance) for k in range(1, 5))
            margin.append(1 + x / w if e == 0 else 1 + np.linalg.solve([[x, -w], [y, -x]], [y, z]).sum())
        low, high = np.sqrt(strengths**2 - first(e) ** 2)
        between = low - margin[0] * (high - low) / (margin[1] - margin[0])
        found.append(math.hypot(between, float(first(e))))
    return np.array(found)


@number(
    "periods-on-a-table", "after how many periods a ball's bounces repeat, just below and above that Gamma",
    "the same", "walls ballistic gravity",
    tuple(f"e = {e:g}, {share:g} Gamma'" for e in RESTITUTIONS for share in ABOUT), np.tile([1.0, 2.0], 7),
    np.tile([1.0, 2.0], 7), np.tile([1.0, 2.0], 7),
)  # fmt: skip
def periods(tolerance: float) -> Array:
    found = []
    for e, threshold in zip(RESTITUTIONS, doubling(RESTITUTIONS), strict=True):
        for strength in ABOUT * threshold:
            now, *later = (_bounced(e, strength, LATE + k, 1e-3, tolerance) for k in (0, 1, 2))
            found.append(next((k + 1.0 for k, other in enumerate(later) if abs(other - now) < 1e-6), math.inf))
    return np.array(found)


BOUNCY = RESTITUTIONS[1:]


@number(
    "first-period-on-a-table", "distance from the bounce of period one after 300 periods, in amplitudes, just "
    "below and above the Gamma from which on there is one", "the same", "walls ballistic gravity",
    tuple(f"e = {e:g}, {share:g} Gamma_1" for e in BOUNCY for share in ABOUT),
    np.tile([1e-2, 0.0], len(BOUNCY)), np.tile([math.inf, 1e-7], len(BOUNCY)),
)  # fmt: skip
def first_period(tolerance: float) -> Array:
    return np.array([
        abs(_bounced(e, share * float(first(e)), 300, 0.0, tolerance)) for e in BOUNCY for share in ABOUT
    ])  # fmt: skip


LIFTS = np.array([1.01, 1.5, 3.0, 10.0, 50.0])


@number(
    "lift-off-from-a-table", "Gamma sin(phase) where a ball at rest on the table leaves it; and without restitution "
    "the flight's length in periods at Gamma = sqrt(1 + pi^2)", "balance of forces; Mehta, A. & Luck, J.M. 1990, Phys. "
    "Rev. Lett. 65, 393", "walls ballistic gravity", (*(f"Gamma = {gamma:g}" for gamma in LIFTS), "flight"),
    1 - 1e-7, 1 + 1e-7, np.ones(len(LIFTS) + 1),
)  # fmt: skip
def lift_off(tolerance: float) -> Array:
    found = [_first_flight(gamma, tolerance)[0] for gamma in LIFTS]
    return np.array([*found, _first_flight(math.sqrt(1 + math.pi**2), tolerance)[1]])


def _first_flight(gamma: float, tolerance: float) -> tuple[float, float]:
    """Gamma sin(phase) where a ball that rests on the table at phase zero lifts off, and its flight in periods."""
    a = gamma * G / OMEGA**2
    tracks = _flown(0.0, gamma, [RADIUS], [a * OMEGA], 0.0, 1.5 * PERIOD + 2 * a * OMEGA / G, tolerance, record=True)
    t, x, _ = tracks.path(0)
    off = x[:, 1] - RADIUS - a * np.sin(OMEGA * t) > 1e-11 * LENGTH
    up = int(np.argmax(off[1:] | (np.diff(t) > 0.06 / OMEGA)))  # in contact no step is so long
    down = up + 1 + int(np.argmin(off[up + 1 :]))
    return gamma * math.sin(OMEGA * t[up]), (t[down] - t[up]) / PERIOD
