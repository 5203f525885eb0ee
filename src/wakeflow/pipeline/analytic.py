"""The air of a channel without bodies: known without mesh or solver.

Uniform between slip walls; between no-slip walls laminar and fully developed. The turbulence that a uniform stream
brings decays along the channel as the k-omega model has it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..field import FlowField
from ..laws.turbulence import OMEGA, entering_energy
from ..scene import Scene
from .airflow import Airflow

Array = NDArray[np.float64]
COLUMNS = 64  # of triangles across a parabolic profile: linear on each, they miss it by 1.5 / COLUMNS^2 of U at most
ROWS = 32  # along decaying turbulence
BETA, BETA_STAR = 0.0828, 0.09  # of the k-omega SST model away from walls: Menter, F.R. 1994, AIAA J. 32, 1598
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
        omega = known(OMEGA.entering)(k0, channel.width)  # as a solved airflow enters
        k, dissipation = decaying(k0, omega, sign * (points[:, 1] - start) / air.speed)
    velocity = np.stack([np.zeros(len(points)), sign * speed], axis=1)
    return FlowField.from_arrays(
        points, triangles, velocity, pressure, k=k, dissipation=dissipation, density=air.density,
        viscosity=air.viscosity,
    )  # fmt: skip


def _strip(x: Array, y: Array) -> tuple[Array, NDArray[np.int64]]:
    """Points (n m, 2) of a grid and its rectangles cut in two, (2 (n - 1) (m - 1), 3)."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    corner = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
    right, above = corner + 1, corner + len(x)
    cut = [np.stack([corner, right, above + 1], axis=1), np.stack([corner, above + 1, above], axis=1)]
    return points, np.concatenate(cut)


def duct_airflow(scene: Scene) -> Airflow:
    """What is known of the air; null for what only a body has."""
    air, channel = scene.airstream, scene.channel
    parabolic = air.profile == "parabolic"
    slope = 12.0 * air.viscosity * air.speed / channel.width**2 if parabolic else 0.0
    return Airflow(
        verdict=air.profile,
        reynolds=scene.reynolds,
        pressure_drop=slope * (channel.top - channel.bottom),
        flow_rate=air.speed * channel.width,
    )
