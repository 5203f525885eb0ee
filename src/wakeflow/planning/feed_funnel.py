"""The feed funnel: beads in a vibrated cone, computed one by one with LIGGGHTS, and the rate at which they leave it.

It is optional: without a [funnel] table in the scene nothing here runs, and LIGGGHTS need not be installed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..core.record import load
from ..core.sources import code_key
from ..core.store import content_key
from ..scene import Funnel
from .feed_funnel import FunnelSummary

__all__ = ["compute", "estimated_seconds", "notices", "summary"]

CODE = ("wakeflow.extras.funnel.pour", "wakeflow.extras.funnel.pour")  # with LIGGGHTS' own scripts beside them
SPEED = 4e6  # beads times steps a second of one core
PROVED = "1.02 to 1.26"  # rates computed bead by bead over the law: docs/validation.md#feed-funnel
DEEP = 0.05  # diameters: softened beads should overlap less
Make = Callable[[str, str, Callable[[Path], None]], Path]


def compute(funnel: Funnel, make: Make, tell: Callable[[str], None]) -> FunnelSummary:
    """Pour and discharge.

    ``make(stage, key, work)`` gives the folder of a finished stage, from the cache or by ``work(folder)``. The bed is a
    stage of its own, since every vibration starts from the same bed. Raises ProgramError when LIGGGHTS is missing or
    fails.
    """
    from ..extras.funnel.engine import liggghts_version
    from ..extras.funnel.pour import discharge, pour

    asked = {name: getattr(funnel, name) for name in type(funnel).model_fields}
    asked |= {"density": funnel.bead_density, "restitution": funnel.bead_restitution, "friction": funnel.bead_friction}
    asked |= {"count": funnel.beads, "mass": None, "material": None, "gravity": funnel.gravity}
    if not funnel.amplitude:
        asked["frequency"] = None
    code = (code_key(*CODE), liggghts_version())
    still = {name: value for name, value in asked.items() if name not in ("frequency", "gamma")}
    bed_key = content_key("bed", still, code)
    bed = make("bed", bed_key, lambda part: pour(funnel, part, tell))
    done = make("funnel", content_key("funnel", bed_key, asked, code), lambda part: discharge(funnel, bed, part, tell))
    return load(FunnelSummary, done / "funnel.json")


def estimated_seconds(funnel: Funnel) -> float:
    """Core-seconds of pouring and discharge, by Beverloo's law; good to a factor 3."""
    from ..extras.funnel.pour import steps_of

    time = 0.3 + (0.6 * funnel.total_mass / funnel.expected_rate if funnel.expected_rate else 1.0)
    return funnel.beads * time / steps_of(funnel).dt / SPEED


def summary(funnel: Funnel) -> str:
    """The plan's line."""
    if not funnel.computed:
        return f"feed funnel: {_by_law(funnel)}; no bead is computed"
    how = "at rest" if not funnel.amplitude else f"at {funnel.frequency:g} Hz, Gamma {funnel.gamma:g}"
    return (
        f"feed funnel: {funnel.beads} beads through {1e3 * funnel.orifice:.3g} mm {how} with LIGGGHTS, about "
        f"{estimated_seconds(funnel):.0f} s; {_by_law(funnel)}"
    )


def _by_law(funnel: Funnel) -> str:
    return f"{1e3 * funnel.expected_rate:.3g} g/s by Beverloo's law for one at rest"


def notices(funnel: Funnel | None, found: FunnelSummary | None) -> list[str]:
    """What a user must know of a scene's ``funnel`` and of what was ``found`` of its discharge."""
    if funnel is not None and not funnel.computed:
        return [f"funnel: {_by_law(funnel)}; in seven funnels beads left {PROVED} times as fast"]
    if found is None:
        return []
    lines = []
    if found.verdict != "emptied":
        lines.append(f"funnel: the flow stopped with {found.left} of {found.beads} beads still inside")
    if found.rate is not None and not found.rate.known:
        lines.append("funnel: emptied within a few periods of its vibration: the rate has no interval; use more mass")
    if found.overlap > DEEP:
        lines.append(
            f"funnel: beads overlap by up to {found.overlap:.1%} of their diameter; raise funnel.youngs_modulus"
        )
    return lines
