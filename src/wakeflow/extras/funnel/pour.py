"""The bed that falls into the closed funnel, its discharge once the lid is off, and both as stages in the cache."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.code_key import code_key
from ...core.record import load, save
from ...core.store import content_key
from ...laws.collision import contact_time
from ...laws.streams import beverloo, cone_factor
from ...planning.feed_funnel import DischargeCurve, FunnelSummary, Make
from ...scene import Funnel
from . import engine
from .engine import INSTALL, Cone, Curve, cone_of, liggghts_version

# -- The bed -----------------------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
POISSON = 0.25  # glass 0.2 to 0.25; the ratio of tangential to normal stiffness depends on it weakly
FAST = 1.0  # m/s, and the wall's peak speed: the quickest collision that the time step resolves
CALM = 2e-3  # m/s: rms speed of a bed that lies
MAX_POURING = 2.0  # s of pouring
CHUNK = 0.02  # s between looks at the bed
PROBES = 20_000  # points that measure the packing: 0.3 % of it


@dataclass(frozen=True)
class Steps:
    """Time step ``dt`` (s), a whole part of the vibration's period, and the collision time (s) that it divides."""

    dt: float
    contact: float

    def of(self, time: float) -> int:
        """Number of whole steps nearest to ``time`` (s), at least one."""
        return max(1, round(time / self.dt))


@dataclass(frozen=True)
class Bed:
    """Settled beads: centres (n, 3) m and diameters (n,) m."""

    centres: Array
    diameters: Array


def steps_of(funnel: Funnel) -> Steps:
    """The time step: 1/steps_per_contact of the quickest collision of two of the smallest beads."""
    omega = 2 * math.pi * funnel.shaken_at
    speed = FAST + omega * funnel.amplitude
    contact = contact_time(funnel.low, funnel.density, funnel.youngs_modulus, speed, POISSON)
    dt = contact / funnel.steps_per_contact
    if (frequency := funnel.shaken_at) > 0.0:
        dt = 1 / (frequency * math.ceil(1 / (frequency * dt)))
    return Steps(dt, contact)


def contact_settings(funnel: Funnel, steps: Steps) -> dict[str, float | int | str]:
    """Variables of beads.liggghts."""
    return {
        "youngs": funnel.youngs_modulus, "poisson": POISSON, "e": funnel.restitution, "f": funnel.friction,
        "fw": funnel.wall_friction, "fr": funnel.rolling_friction,
        "rolling": "epsd2" if funnel.rolling_friction > 0 else "off", "g": funnel.gravity, "dt": steps.dt,
        "skin": 0.25 * funnel.diameter,
    }  # fmt: skip


def box_of(funnel: Funnel, cone: Cone, drop: float) -> Array:
    """The box (3, 2) m that beads may be in: the moving funnel and ``drop`` below it."""
    side = cone.widest + 2 * funnel.high
    return np.array([(-side, side), (-side, side), (-drop, cone.brim + funnel.amplitude + 2 * funnel.high)])


def pour(funnel: Funnel, folder: Path, tell: Callable[[str], None]) -> None:
    """Let the loose heap settle; ``bed.dump`` in ``folder`` holds it. Raises ProgramError as LIGGGHTS does."""
    still = funnel.model_copy(update={"gamma": 0.0, "frequency": None})
    cone, steps = cone_of(still), steps_of(still)
    centres, diameters, velocities = engine.loose_heap(still)
    engine.write_stl(folder, cone)
    engine.write_beads(folder, centres, diameters, velocities, still.density, box_of(still, cone, 4 * still.high))
    settings = contact_settings(still, steps) | {
        "every": steps.of(CHUNK / 2),
        "chunk": steps.of(CHUNK),
        "turns": math.ceil(MAX_POURING / CHUNK),
        "calm": 0.5 * still.total_mass * CALM**2,
    }
    engine.write_settings(folder, settings)
    tell(f"pouring {still.beads} beads")
    engine.run_script(folder, engine.SCRIPTS / "settle.liggghts")


def read_bed(folder: Path) -> Bed:
    """The bed that :func:`pour` left in ``folder``."""
    _, rows = engine.read_dump(folder / "bed.dump")[-1]
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


# -- The discharge -----------------------------------------------------------------------------------------------------
SAMPLING = 5e-4  # s between counts
REST = 0.03  # s with the lid on: the friction contacts of the poured bed form again
SHAKEN = 0.05  # s at least of vibration with the lid on
QUIET = 0.1  # s, and four periods: after that time without a bead the discharge is over
PATIENCE = 10.0  # times what Beverloo's law would take, and a second
SHOTS = 6  # pictures of the beads in the time that Beverloo's law would take
CURVE_POINTS = 400  # points of the curve that are kept


def discharge(funnel: Funnel, poured: Path, folder: Path, tell: Callable[[str], None]) -> None:
    """Empty the bed in the folder ``poured``; ``funnel.json`` in ``folder`` holds the ``funnel`` table of result.json.

    Raises ProgramError as LIGGGHTS does.
    """
    cone, steps, bed = cone_of(funnel), steps_of(funnel), read_bed(poured)
    level = -(funnel.amplitude + funnel.high)
    engine.write_stl(folder, cone)
    box = box_of(funnel, cone, -level + 3 * funnel.high)
    engine.write_beads(folder, bed.centres, bed.diameters, np.zeros_like(bed.centres), funnel.density, box)
    closed = steps.of(_whole(funnel, SHAKEN if funnel.amplitude else REST))
    engine.write_settings(folder, contact_settings(funnel, steps) | _timing(funnel, steps, closed, level))
    total = float((funnel.density * math.pi / 6 * bed.diameters**3).sum())

    def hear(line: str) -> None:
        words = line.split()
        if len(words) == 4 and words[0] == "curve":
            out = max(0.0, 1 - float(words[2]) / total)
            tell(f"{float(words[1]) - closed * steps.dt:.2f} s, {out:.0%} of the mass is out")

    engine.run_script(folder, engine.SCRIPTS / "discharge.liggghts", hear)
    curve = engine.read_curve((folder / "curve.txt").read_text(), closed * steps.dt)
    shots = engine.read_dump(folder / "beads.dump")
    save(folder / "funnel.json", _table(funnel, cone, steps, bed, curve, total, shots))


def _whole(funnel: Funnel, time: float) -> float:
    """The next whole number of periods above ``time`` (s); at rest ``time`` itself."""
    frequency = funnel.shaken_at
    return math.ceil(time * frequency - 1e-9) / frequency if frequency else time


def _timing(funnel: Funnel, steps: Steps, closed: int, level: float) -> dict[str, float | int | str]:
    """Variables of discharge.liggghts."""
    expected = funnel.total_mass / funnel.expected_rate if funnel.expected_rate else 1.0
    chunk = _whole(funnel, max(QUIET, 4 / funnel.shaken_at if funnel.shaken_at else 0.0))
    return {
        "amplitude": funnel.amplitude, "period": 1 / funnel.frequency if funnel.frequency else 1.0, "level": level,
        "closed": closed, "every": steps.of(SAMPLING), "shot": steps.of(_whole(funnel, expected / SHOTS)),
        "chunk": steps.of(chunk), "turns": math.ceil((1.0 + PATIENCE * expected) / chunk),
    }  # fmt: skip


def _table(
    funnel: Funnel, cone: Cone, steps: Steps, bed: Bed, curve: Curve, total: float, shots: list[tuple[int, Array]]
) -> FunnelSummary:
    rate = engine.rate_of(curve, total, 1 / funnel.shaken_at if funnel.shaken_at else 0.0)
    filled = packing_fraction(bed, cone)
    law = math.nan
    if not math.isnan(filled):
        law = beverloo(funnel.orifice, funnel.diameter, filled * funnel.density, gravity=funnel.gravity)
    kept = np.unique(np.linspace(0, len(curve.time) - 1, min(len(curve.time), CURVE_POINTS)).astype(int))
    left = int(curve.beads[-1])
    return FunnelSummary(
        verdict="emptied" if left <= 0.01 * len(bed.diameters) else "stopped", rate=rate,
        time_to_empty=engine.time_to_empty(curve, total), left=left, beads=len(bed.diameters), mass=total,
        packing=filled, beverloo=law,
        beverloo_cone=law * cone_factor(funnel.half_angle), frequency=funnel.frequency or math.nan,
        gamma=funnel.gamma, time_step=steps.dt, contact_time=steps.contact, youngs_modulus=funnel.youngs_modulus,
        overlap=max((_overlap(rows) for _, rows in shots if len(rows) > 1), default=0.0), engine="LIGGGHTS",
        version=liggghts_version(),
        curve=DischargeCurve(tuple(curve.time[kept].tolist()), tuple(curve.mass[kept].tolist())),
    )  # fmt: skip


def _overlap(rows: Array) -> float:
    """The deepest overlap of two beads, in diameters, of rows (n, 5): id, radius, x, y, z."""
    from scipy.spatial import cKDTree

    radius, centres = rows[:, 1], rows[:, 2:]
    i, j = cKDTree(centres).query_pairs(2 * float(radius.max()), output_type="ndarray").T
    gap = np.linalg.norm(centres[i] - centres[j], axis=1) - radius[i] - radius[j]
    return max(0.0, -float(gap.min(initial=0.0))) / (2 * float(radius.mean()))


CODE = ("wakeflow.extras.funnel.pour",)  # with LIGGGHTS' own scripts beside it
SPEED = 4e6  # beads times steps a second of one core


class Liggghts:
    """Computes beads with LIGGGHTS."""

    install: ClassVar[str] = INSTALL

    def compute(self, funnel: Funnel, make: Make, tell: Callable[[str], None]) -> FunnelSummary:
        """Pour and discharge. The bed is a stage of its own, since every vibration starts from the same bed."""
        inputs = {name: getattr(funnel, name) for name in type(funnel).model_fields}
        inputs |= {"count": funnel.beads, "mass": None, "material": None, "gravity": funnel.gravity}
        if not funnel.amplitude:
            inputs["frequency"] = None
        code = (code_key(*CODE), liggghts_version())
        still = {name: value for name, value in inputs.items() if name not in ("frequency", "gamma")}
        bed_key = content_key("bed", still, code)
        bed = make("bed", bed_key, lambda part: pour(funnel, part, tell))
        done = make(
            "funnel", content_key("funnel", bed_key, inputs, code), lambda part: discharge(funnel, bed, part, tell)
        )
        return load(FunnelSummary, done / "funnel.json")

    def seconds(self, funnel: Funnel) -> float:
        """Core-seconds of pouring and discharge, by Beverloo's law; good to a factor 3."""
        time = 0.3 + (0.6 * funnel.total_mass / funnel.expected_rate if funnel.expected_rate else 1.0)
        return funnel.beads * time / steps_of(funnel).dt / SPEED

    def version(self) -> str:
        return liggghts_version()
