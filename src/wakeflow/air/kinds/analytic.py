"""The air of a channel without bodies: known without mesh or solver.

Uniform between slip walls; between no-slip walls laminar and fully developed. The turbulence that a uniform stream
brings decays along the channel as the k-omega model has it. Where the air rests, a curtain drives a jet of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import ForceDensity
from ...laws.driven_jet import DrivenJet, driven_jet
from ...laws.turbulence import OMEGA, entering_energy
from ...scene import Scene
from ..field import FlowField
from .airflow_table import Airflow

Array = NDArray[np.float64]
COLUMNS = 64  # of triangles across a parabolic profile: linear on each, they miss it by 1.5 / COLUMNS^2 of U at most
ROWS = 32  # along decaying turbulence
BETA, BETA_STAR = 0.0828, 0.09  # of the k-omega SST model away from walls: Menter, F.R. 1994, AIAA J. 32, 1598
LEVELS, BESIDE = 128, 96  # of a driven jet: rows below the curtain's beginning, columns on either side of it
NEAR = 1.5  # power with which these rows come closer towards the beginning, where the jet grows with a root
FINE = 0.25  # of the jet's width where it is narrowest: the columns next to its axis
SLACK = 1e-6  # channel widths: how far the field reaches beyond the lines at which tracks end


def decaying(k: float, omega: float, time: Array) -> tuple[Array, Array]:
    """k (m2/s2) and its dissipation (m2/s3) after ``time`` (s) in a uniform stream that entered with k and omega (1/s).

    domega/dt = -beta omega^2, dk/dt = -beta* k omega: omega = omega_0 / s, k = k_0 s^(-beta*/beta), s = 1 + beta
    omega_0 t. High turbulence Reynolds number, away from walls.
    """
    stretch = 1.0 + BETA * omega * time
    left = k * stretch ** (-BETA_STAR / BETA)
    return left, BETA_STAR * left * omega / stretch


def duct_field(scene: Scene, *, turbulent: bool) -> FlowField:
    """The air of the whole channel. ``turbulent``: with the turbulence of ``air.turbulence``, for uniform air.

    Pressure (Pa) falls along parabolic air by 12 mu U / W^2 a metre and is constant in uniform air; it is 0 where the
    air leaves.
    """
    channel, air = scene.channel, scene.airstream
    sign, slack = (1.0 if air.direction == "up" else -1.0), 2.0 * SLACK * channel.width
    parabolic = air.profile == "parabolic"
    x = np.linspace(-0.5 * channel.width, 0.5 * channel.width, (COLUMNS if parabolic else 2) + 1)
    y = np.linspace(channel.bottom - slack, channel.top + slack, (ROWS if turbulent else 2) + 1)
    points, triangles = _strip(x, y)
    speed, pressure = np.full(len(points), air.speed), np.zeros(len(points))
    start, end = (y[0], y[-1]) if sign > 0 else (y[-1], y[0])
    if parabolic:
        speed = 1.5 * air.speed * (1.0 - (2.0 * points[:, 0] / channel.width) ** 2)
        pressure = 12.0 * air.viscosity * air.speed / channel.width**2 * sign * (end - points[:, 1])
    k = dissipation = None
    if turbulent:
        k0 = entering_energy(air.turbulence, air.speed)
        omega = OMEGA.entering(k0, channel.width)  # as a solved airflow enters
        k, dissipation = decaying(k0, omega, sign * (points[:, 1] - start) / air.speed)
    velocity = np.stack([np.zeros(len(points)), sign * speed], axis=1)
    return FlowField.from_arrays(
        points, triangles, velocity, pressure, k=k, dissipation=dissipation, density=air.density,
        viscosity=air.viscosity, temperature=air.temperature, mean_free_path=air.mean_free_path,
    )  # fmt: skip


def _strip(x: Array, y: Array) -> tuple[Array, NDArray[np.int64]]:
    """Points (n m, 2) of a grid and its rectangles cut in two, (2 (n - 1) (m - 1), 3)."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    corner = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
    right, above = corner + 1, corner + len(x)
    cut = [np.stack([corner, right, above + 1], axis=1), np.stack([corner, above + 1, above], axis=1)]
    return points, np.concatenate(cut)


def jet_of(scene: Scene, force: ForceDensity) -> DrivenJet:
    """The jet of air that the granules' force drives below the level at which the curtain begins."""
    boxes, feed = force.boxes, scene.feed
    edges = boxes.bottom + boxes.pitch * np.arange(boxes.rows + 1)
    above = np.concatenate([np.cumsum(-force.density[::-1, :, 1].sum(axis=1))[::-1], [0.0]])  # down to each edge
    fall = (scene.level - scene.channel.bottom) * np.linspace(0.0, 1.0, LEVELS + 1) ** NEAR
    push = np.interp(scene.level - fall, edges, above * boxes.pitch**2) / scene.airstream.density
    push = np.maximum(push - push[0], 0.0)
    deviation = float(np.std(feed.places((np.arange(COLUMNS) + 0.5) / COLUMNS)))
    return driven_jet(fall, push, math.sqrt(12.0) * deviation)


def jet_field(scene: Scene, force: ForceDensity) -> FlowField:
    """The air at rest with the jet in it that the granules' force drives; what it draws in comes through the walls."""
    channel, jet, air = scene.channel, jet_of(scene, force), scene.airstream
    half, axis, slack = 0.5 * channel.width, scene.feed.position, 2.0 * SLACK * channel.width
    first = FINE * float(np.min(jet.width, where=jet.width > 0.0, initial=half))
    x = axis + np.concatenate([-_spread(half + axis, first)[:0:-1], _spread(half - axis, first)])
    down = jet.stream_function(x - axis)
    speed = np.stack([-np.gradient(down, jet.fall, axis=0), -np.gradient(down, x, axis=1)], axis=-1)
    energy = jet.turbulence(x - axis)
    rows = scene.level - jet.fall
    rows[-1] -= slack
    points, triangles = _strip(x, np.concatenate([rows[::-1], [channel.top + slack]]))
    speed[0] = 0.0
    velocity, k, dissipation = (
        np.concatenate([part[::-1], np.zeros_like(part[:1])]).reshape(len(points), -1) for part in (speed, *energy)
    )
    return FlowField.from_arrays(
        points, triangles, velocity, np.zeros(len(points)), k=k[:, 0], dissipation=dissipation[:, 0],
        density=air.density, viscosity=air.viscosity, temperature=air.temperature, mean_free_path=air.mean_free_path,
    )  # fmt: skip


def _spread(reach: float, first: float) -> Array:
    """Distances (BESIDE + 1,) m from 0 to ``reach``, the first of them about ``first``, the next ever farther apart."""
    from scipy.optimize import brentq

    t = np.linspace(0.0, 1.0, BESIDE + 1)
    if first >= reach / BESIDE:
        return reach * t
    rate = brentq(lambda k: math.sinh(k / BESIDE) / math.sinh(k) - first / reach, 1e-6, 50.0)
    return np.asarray(reach * np.sinh(rate * t) / math.sinh(rate))


def duct_airflow(scene: Scene, turbulence: str) -> Airflow:
    """What is known of the air, with the plan's ``turbulence``; null for what only a body has."""
    air, channel = scene.airstream, scene.channel
    parabolic = air.profile == "parabolic"
    slope = 12.0 * air.viscosity * air.speed / channel.width**2 if parabolic else 0.0
    return Airflow(
        verdict=air.profile,
        turbulence=turbulence,
        reynolds=scene.reynolds,
        pressure_drop=slope * (channel.top - channel.bottom),
        flow_rate=air.speed * channel.width,
    )
