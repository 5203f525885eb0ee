"""What is constant of a granule for the kernel: terms of the forces, and the table of its drag law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..field import FlowField
from ..laws.drag import drag_laws, drag_table, slip_correction
from ..laws.forces import forces as forces_known
from ..laws.restitution import Restitution
from ..laws.rotation import spin_rate
from ..laws.turbulence import brownian_diffusivity
from .granules import Granules
from .kernel import layout as at

__all__ = ["FORCES", "check_forces", "pack_granules", "pack_tables"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
FORCES = tuple(name for name in forces_known if forces_known[name].computed)
MOST_TABLES = 4096
BY_LAW = -1.0  # in place of a granule's restitution: look it up at the approach speed


def check_forces(forces: Sequence[str], field: FlowField | None) -> None:
    """Raise SceneError for a force that is unknown, not computed, or lacks what it needs of the field."""
    for force in forces:
        needs = forces_known[force].needs
        if not forces_known[force].computed:
            raise SceneError(f"force {force!r} is only bounded, not computed (computed: {', '.join(FORCES)})")
        if field is None:
            continue
        if needs == "pressure" and field.pressure_gradient is None:
            raise SceneError(f"forces: {force} needs a field with pressure")
        if needs == "turbulence" and (field.k is None or field.dissipation is None):
            raise SceneError(f"forces: {force} needs a field with k and dissipation; a laminar airflow has none")


def pack_granules(grains: Granules, field: FlowField | None, forces: Sequence[str], gravity: Sequence[float]) -> Array:
    """Constants of every granule (n, CONSTANTS), see ``kernel.layout``."""
    rows = np.zeros((len(grains), at.CONSTANTS))
    g = np.asarray(gravity, dtype=float)
    if g.shape != (2,) or not np.all(np.isfinite(g)):
        raise SceneError(f"gravity = {gravity}, expected two finite numbers in m/s2")
    rows[:, at.RADIUS] = grains.diameter / 2
    rows[:, at.RESTITUTION] = BY_LAW if isinstance(grains.restitution, Restitution) else grains.restitution
    rows[:, at.FRICTION] = grains.friction
    rows[:, at.MOBILITY] = 1.0 / grains.inertia
    pull = np.tile(g if "gravity" in forces else np.zeros(2), (len(grains), 1))
    if field is None:
        rows[:, [at.GX, at.GY]] = pull
        return rows
    ratio = field.density / grains.density
    added = 0.5 * ratio if "added-mass" in forces else np.zeros(len(grains))
    if "buoyancy" in forces:
        pull -= ratio[:, None] * g
    rows[:, [at.GX, at.GY]] = pull / (1.0 + added)[:, None]
    rows[:, at.REYNOLDS2] = (field.density * grains.diameter / field.viscosity) ** 2
    rows[:, at.VORTICITY] = field.density * grains.diameter**2 / field.viscosity
    rows[:, at.INERTIAL] = added / (1.0 + added)
    for force, column, value in (
        ("drag", at.STOKES, grains.drag_scale * 18.0 * field.viscosity / (grains.density * grains.diameter**2)),
        ("pressure-gradient", at.PRESSURE, -1.0 / grains.density),
        ("lift", at.LIFT, ratio),
        ("magnus", at.MAGNUS, 0.75 * ratio),
    ):
        if force in forces:
            rows[:, column] = value / (1.0 + added)
    if "magnus" in forces:
        rows[:, at.SPIN_RATE] = spin_rate(grains.diameter, grains.density, field.viscosity, grains.inertia)
    rows[:, at.EXTRA] = np.any(rows[:, [at.INERTIAL, at.LIFT, at.MAGNUS]] != 0.0, axis=1)
    rows[:, at.DISPERSION] = "dispersion" in forces
    if "brownian" in forces:
        rows[:, at.DIFFUSIVITY] = brownian_diffusivity(
            grains.diameter, field.viscosity, slip_correction=slip_correction(grains.diameter)
        )
    rows[:, at.NOISE] = (rows[:, at.DISPERSION] != 0.0) | (rows[:, at.DIFFUSIVITY] != 0.0)
    return rows


def pack_tables(law: str, sphericity: Array) -> tuple[Array, Index]:
    """Tables of the drag law (k, cells, 4), one for every sphericity that occurs, and which one each granule uses."""
    if not drag_laws[law].uses_sphericity:
        return drag_table(law)[None], np.zeros(len(sphericity), dtype=np.int64)
    values, which = np.unique(sphericity, return_inverse=True)
    if len(values) > MOST_TABLES:
        raise SceneError(f"granule sphericity: {len(values)} different values, allowed {MOST_TABLES}; round them")
    if not len(values):
        values = np.ones(1)
    return np.stack([drag_table(law, float(value)) for value in values]), which.astype(np.int64)
