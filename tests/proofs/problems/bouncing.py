"""Exact numbers of a ball on a vibrating table: where it lifts off, and from which strength on it bounces once a period
or once in two periods. The tracker that runs in a scene flies all of it.

The table moves by a sin(w t), Gamma = a w^2 / g. A ball of restitution e that meets it at the same phase each period
leaves with g T / 2, so that cos(phase) = pi (1 - e) / ((1 + e) Gamma): the orbit is there for Gamma > Gamma_1 =
pi (1 - e) / (1 + e). Its linear map has determinant e^2 and loses its hold (multiplier -1: the period doubles) at
Gamma' = sqrt(Gamma_1^2 + (2 (1 + e^2) / (1 + e)^2)^2). Tufillaro, N.B., Abbott, T. & Reilly, J. 1992, An Experimental
Approach to Nonlinear Dynamics and Chaos, ch. 1; Luck, J.M. & Mehta, A. 1993, Phys. Rev. E 48, 3988. Without restitution
the ball rests on the table until sin(phase) = 1 / Gamma, and flies a period or more from Gamma = sqrt(1 + pi^2) on
(Mehta, A. & Luck, J.M. 1990, Phys. Rev. Lett. 65, 393; cited, not looked up).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from proofs.problems.ensembles import number
from proofs.problems.exact import G
from wakeflow.tracking import Body, Granules, Motion, Tracks, track

Array = NDArray[np.float64]
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
    grains = Granules(
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
