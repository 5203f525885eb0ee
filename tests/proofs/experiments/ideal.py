"""Theories of what a body keeps of the drops that air carries against it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wakeflow.laws.drag import drag_laws, relaxation_time, slip_correction
from wakeflow.laws.impaction import Cylinder, Impaction, approach

Array = NDArray[np.float64]
FAR = 10.0  # widths of the body ahead of it, where drops begin with the air's speed


def on_a_cylinder(
    width: float, speed: float, sizes: Array, liquid: float, gas: tuple[float, float], law: str,
    start: tuple[float, float] | None = None,
) -> Impaction:  # fmt: skip
    """Drops of ``sizes`` (n,) m and density ``liquid`` in potential flow of ``speed`` (m/s) round a cylinder, without
    weight; ``gas``: its density and viscosity. They have the drag ``law``, and begin FAR ahead with the air, or so many
    m above it and so fast (``start``).
    """
    density, viscosity = gas
    still = (relaxation_time(sizes, liquid, viscosity) * slip_correction(sizes))[:, None]
    reynolds, factor = density * sizes[:, None] / viscosity, drag_laws[law].factor
    above, fast = start or (FAR * width, speed)
    return approach(
        Cylinder(0.5 * width, speed), above=above, speed=fast, radius=0.5 * sizes,
        relax=lambda slip: still / factor(reynolds * slip, 1.0), pull=0.0,
    )  # fmt: skip


def on_a_ribbon(stokes: float) -> float:
    """Share that a ribbon across the air keeps, K = tau U / half width: drops of Stokes' drag in plane stagnation flow
    against a wall without edges, from one width ahead.

    Ranz & Wong 1952, Ind. Eng. Chem. 44, 1371 (not read; the formula as a public code of large-eddy simulation has it):
    none below K = 1/4.
    """
    psi = 0.5 * stokes
    if psi <= 0.125:
        return 0.0
    q = math.sqrt(0.5 / psi - (0.25 / psi) ** 2)
    t = math.atan2(4.0 * psi * q, 4.0 * psi - 1.0) / q
    slow, fast = (sign * math.sqrt((0.25 / psi) ** 2 + 0.5 / psi) - 0.25 / psi for sign in (-1.0, 1.0))
    return (fast - slow) / (fast * math.exp(slow * t) - slow * math.exp(fast * t))


def kept_between(found: Impaction, half: float, ends: Array) -> Array:
    """Local catch (n, k - 1): the part of the undisturbed flux that a cylinder of radius ``half`` (m) keeps between k
    distances ``ends`` (m) from its foremost line along its surface, of each of n sizes of drops.
    """
    beta = []
    for start, met, reach in zip(found.start, found.turned.z, found.reach, strict=True):
        hit = start < reach
        along = half * np.abs(np.angle(half - met[hit]))
        edge = along[-1] + (reach - start[hit][-1]) * (along[-1] / start[hit][-1]) if hit.any() else 0.0
        begun = np.interp(ends, [0.0, *along, edge], [0.0, *start[hit], reach])
        beta.append(np.diff(begun) / np.diff(ends))
    return np.array(beta)
