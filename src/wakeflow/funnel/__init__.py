"""The feed funnel: beads in a vibrated cone, computed one by one with LIGGGHTS, and the rate at which they leave it.

Optional: nothing here runs, and LIGGGHTS need not be there, unless a scene has a [funnel] table.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..files import content_key, digest_files
from ..tables import Funnel

__all__ = ["compute", "estimated_seconds"]

CODE = Path(__file__).parent
SPEED = 1.0e6  # beads times steps a second of one core
Make = Callable[[str, str, Callable[[Path], None]], Path]


def compute(funnel: Funnel, make: Make, tell: Callable[[str], None]) -> dict[str, Any]:
    """Pour and discharge: the ``funnel`` table of result.json.

    ``make(stage, key, work)`` gives the folder of a finished stage, from the cache or by ``work(folder)``. The bed is a stage of its
    own, since every vibration begins with the same. Raises ProgramError when LIGGGHTS is missing or fails.
    """
    from .engine import version
    from .flow import discharge
    from .pour import pour

    asked = {name: getattr(funnel, name) for name in type(funnel).model_fields}
    asked |= {"density": funnel.bead_density, "restitution": funnel.bead_restitution, "friction": funnel.bead_friction}
    asked |= {"count": funnel.beads, "mass": None, "material": None}
    if not funnel.amplitude:
        asked["frequency"] = None
    code = (digest_files([CODE, CODE.parent / "laws" / "hertz.py", CODE.parent / "laws" / "discharge.py"]), version())
    still = {name: value for name, value in asked.items() if name not in ("frequency", "gamma")}
    bed_key = content_key("bed", still, code)
    bed = make("bed", bed_key, lambda part: pour(funnel, part, tell))
    done = make("funnel", content_key("funnel", bed_key, asked, code), lambda part: discharge(funnel, bed, part, tell))
    table: dict[str, Any] = json.loads((done / "funnel.json").read_text())
    return table


def estimated_seconds(funnel: Funnel) -> float:
    """Core-seconds of pouring and discharge, by Beverloo's law; good to a factor 3."""
    from .pour import steps_of

    time = 0.3 + (0.6 * funnel.total_mass / funnel.expected_rate if funnel.expected_rate else 1.0)
    return funnel.beads * time / steps_of(funnel).dt / SPEED
