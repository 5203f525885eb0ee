"""The bed: a loose heap that has fallen into the closed funnel at rest. The same for every vibration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..laws.constants import GRAVITY
from ..laws.hertz import contact_time
from ..scene import Funnel
from .cone import Cone, cone_of, loose_heap, write_stl
from .engine import SCRIPTS, read_dump, run_script, write_beads, write_settings

__all__ = ["Bed", "Steps", "box_of", "contact_settings", "packing_fraction", "pour", "read_bed", "steps_of"]

Array = NDArray[np.float64]
POISSON = 0.25  # glass 0.2 to 0.25; the ratio of tangential to normal stiffness depends on it weakly
FAST = 1.0  # m/s, and the wall's peak speed: the quickest collision that the time step resolves
CALM = 2e-3  # m/s: rms speed of a bed that lies
LONGEST = 2.0  # s of pouring
CHUNK = 0.02  # s between looks at the bed
PROBES = 20_000  # points that measure the packing: 0.3 % of it


@dataclass(frozen=True)
class Steps:
    """Time step ``dt`` (s), a whole part of the vibration's period, and the collision time (s) that it divides."""

    dt: float
    contact: float

    def of(self, time: float) -> int:
        """Whole steps nearest to ``time`` (s), at least one."""
        return max(1, round(time / self.dt))


@dataclass(frozen=True)
class Bed:
    """Settled beads: centres (n, 3) m and diameters (n,) m."""

    centres: Array
    diameters: Array


def steps_of(funnel: Funnel) -> Steps:
    """The time step: 1/steps_per_contact of the quickest collision of two of the smallest beads."""
    omega = 2 * math.pi * (funnel.frequency or 0.0)
    speed = FAST + omega * funnel.amplitude
    contact = contact_time(funnel.low, funnel.bead_density, funnel.youngs_modulus, speed, POISSON)
    dt = contact / funnel.steps_per_contact
    if funnel.amplitude:
        dt = 1 / (known(funnel.frequency) * math.ceil(1 / (known(funnel.frequency) * dt)))
    return Steps(dt, contact)


def contact_settings(funnel: Funnel, steps: Steps) -> dict[str, float | int | str]:
    """Variables of beads.liggghts."""
    return {
        "youngs": funnel.youngs_modulus,
        "poisson": POISSON,
        "e": funnel.bead_restitution,
        "f": funnel.bead_friction,
        "fw": funnel.wall_friction,
        "fr": funnel.rolling_friction,
        "rolling": "epsd2" if funnel.rolling_friction > 0 else "off",
        "g": GRAVITY,
        "dt": steps.dt,
        "skin": 0.25 * funnel.diameter,
    }


def box_of(funnel: Funnel, cone: Cone, drop: float) -> Array:
    """The box (3, 2) m that beads may be in: the moving funnel and ``drop`` below it."""
    side = cone.widest + 2 * funnel.high
    return np.array([(-side, side), (-side, side), (-drop, cone.brim + funnel.amplitude + 2 * funnel.high)])


def pour(funnel: Funnel, folder: Path, tell: Callable[[str], None]) -> None:
    """Let the loose heap settle; ``bed.dump`` in ``folder`` holds it. Raises ProgramError as LIGGGHTS does."""
    still = funnel.model_copy(update={"gamma": 0.0, "frequency": None})
    cone, steps = cone_of(still), steps_of(still)
    centres, diameters, velocities = loose_heap(still)
    write_stl(folder, cone)
    write_beads(folder, centres, diameters, velocities, still.bead_density, box_of(still, cone, 4 * still.high))
    settings = contact_settings(still, steps) | {
        "every": steps.of(CHUNK / 2),
        "chunk": steps.of(CHUNK),
        "turns": math.ceil(LONGEST / CHUNK),
        "calm": 0.5 * still.total_mass * CALM**2,
    }
    write_settings(folder, settings)
    tell(f"pouring {still.beads} beads")
    run_script(folder, SCRIPTS / "settle.liggghts")


def read_bed(folder: Path) -> Bed:
    """The bed that :func:`pour` left in ``folder``."""
    _, rows = read_dump(folder / "bed.dump")[-1]
    return Bed(rows[:, 2:], 2 * rows[:, 1])


def packing_fraction(bed: Bed, cone: Cone) -> float:
    """Share of the volume that the beads fill, inside the bed: a diameter off the walls, the outlet and the surface.

    It is measured with random points: a point counts where it lies in a bead.
    """
    from scipy.spatial import cKDTree

    size = float(bed.diameters.max())
    top = float(np.quantile(bed.centres[:, 2], 0.95)) - 1.5 * size
    random = np.random.default_rng(0)
    points = random.uniform(-1, 1, (20 * PROBES, 3)) * [cone.widest, cone.widest, 1]
    points[:, 2] = size + (top - size) * 0.5 * (points[:, 2] + 1)
    points = points[cone.room(points) > size][:PROBES]
    if len(points) < 100:
        return math.nan
    distance, nearest = cKDTree(bed.centres).query(points, k=8)
    radii = np.append(bed.diameters / 2, 0.0)[nearest]
    return float((distance < radii).any(axis=1).mean())
