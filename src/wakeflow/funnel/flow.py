"""The discharge: the lid of the vibrating funnel is taken off, and the beads that fall out are counted."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..core.record import save
from ..laws.constants import GRAVITY
from ..laws.discharge import beverloo, cone_factor
from ..scene import Funnel
from .cone import Cone, cone_of, write_stl
from .delivered import DischargeCurve, FunnelSummary
from .engine import SCRIPTS, liggghts_version, read_dump, run_script, write_beads, write_settings
from .pour import Bed, Steps, box_of, contact_settings, packing_fraction, read_bed, steps_of
from .rate import Curve, rate_of, read_curve, time_to_empty

__all__ = ["discharge"]

Array = NDArray[np.float64]
SAMPLING = 5e-4  # s between counts
REST = 0.03  # s with the lid on: the friction contacts of the poured bed form again
SHAKEN = 0.05  # s at least of vibration with the lid on
QUIET = 0.1  # s, and four periods: after that time without a bead the discharge is over
PATIENCE = 10.0  # times what Beverloo's law would take, and a second
SHOTS = 6  # pictures of the beads in the time that Beverloo's law would take
DRAWN = 400  # points of the curve that are kept


def discharge(funnel: Funnel, poured: Path, folder: Path, tell: Callable[[str], None]) -> None:
    """Empty the bed in the folder ``poured``; ``funnel.json`` in ``folder`` holds the ``funnel`` table of result.json.

    Raises ProgramError as LIGGGHTS does.
    """
    cone, steps, bed = cone_of(funnel), steps_of(funnel), read_bed(poured)
    level = -(funnel.amplitude + funnel.high)
    write_stl(folder, cone)
    box = box_of(funnel, cone, -level + 3 * funnel.high)
    write_beads(folder, bed.centres, bed.diameters, np.zeros_like(bed.centres), funnel.bead_density, box)
    closed = steps.of(_whole(funnel, SHAKEN if funnel.amplitude else REST))
    write_settings(folder, contact_settings(funnel, steps) | _timing(funnel, steps, closed, level))
    total = float((funnel.bead_density * math.pi / 6 * bed.diameters**3).sum())

    def hear(line: str) -> None:
        words = line.split()
        if len(words) == 4 and words[0] == "curve":
            out = max(0.0, 1 - float(words[2]) / total)
            tell(f"{float(words[1]) - closed * steps.dt:.2f} s, {out:.0%} of the mass is out")

    run_script(folder, SCRIPTS / "discharge.liggghts", hear)
    curve = read_curve((folder / "curve.txt").read_text(), closed * steps.dt)
    shots = read_dump(folder / "beads.dump")
    save(folder / "funnel.json", _table(funnel, cone, steps, bed, curve, total, shots))


def _whole(funnel: Funnel, time: float) -> float:
    """The next whole number of periods above ``time`` (s); at rest ``time`` itself."""
    if not funnel.amplitude:
        return time
    return math.ceil(time * known(funnel.frequency) - 1e-9) / known(funnel.frequency)


def _timing(funnel: Funnel, steps: Steps, closed: int, level: float) -> dict[str, float | int | str]:
    """Variables of discharge.liggghts."""
    expected = funnel.total_mass / funnel.expected_rate if funnel.expected_rate else 1.0
    chunk = _whole(funnel, max(QUIET, 4 / funnel.frequency if funnel.amplitude and funnel.frequency else 0.0))
    return {
        "amplitude": funnel.amplitude,
        "period": 1 / funnel.frequency if funnel.frequency else 1.0,
        "level": level,
        "closed": closed,
        "every": steps.of(SAMPLING),
        "shot": steps.of(_whole(funnel, expected / SHOTS)),
        "chunk": steps.of(chunk),
        "turns": math.ceil((1.0 + PATIENCE * expected) / chunk),
    }


def _table(
    funnel: Funnel, cone: Cone, steps: Steps, bed: Bed, curve: Curve, total: float, shots: list[tuple[int, Array]]
) -> FunnelSummary:
    rate = rate_of(curve, total, 1 / funnel.frequency if funnel.amplitude and funnel.frequency else None)
    filled = packing_fraction(bed, cone)
    law = (
        None
        if math.isnan(filled)
        else beverloo(funnel.orifice, funnel.diameter, filled * funnel.bead_density, gravity=GRAVITY)
    )
    kept = np.unique(np.linspace(0, len(curve.time) - 1, min(len(curve.time), DRAWN)).astype(int))
    left = int(curve.beads[-1])
    return FunnelSummary(
        verdict="emptied" if left <= 0.01 * len(bed.diameters) else "stopped",
        rate=rate,
        time_to_empty=time_to_empty(curve, total),
        left=left,
        beads=len(bed.diameters),
        mass=total,
        packing=None if math.isnan(filled) else filled,
        beverloo=law,
        beverloo_cone=None if law is None else law * cone_factor(funnel.half_angle),
        frequency=funnel.frequency,
        gamma=funnel.gamma,
        time_step=steps.dt,
        contact_time=steps.contact,
        youngs_modulus=funnel.youngs_modulus,
        overlap=max((_overlap(rows) for _, rows in shots if len(rows) > 1), default=0.0),
        engine="LIGGGHTS",
        version=liggghts_version(),
        curve=DischargeCurve(tuple(curve.time[kept].tolist()), tuple(curve.mass[kept].tolist())),
    )


def _overlap(rows: Array) -> float:
    """The deepest overlap of two beads, in diameters, of rows (n, 5): id, radius, x, y, z."""
    from scipy.spatial import cKDTree

    radius, centres = rows[:, 1], rows[:, 2:]
    i, j = cKDTree(centres).query_pairs(2 * float(radius.max()), output_type="ndarray").T
    gap = np.linalg.norm(centres[i] - centres[j], axis=1) - radius[i] - radius[j]
    return max(0.0, -float(gap.min(initial=0.0))) / (2 * float(radius.mean()))
