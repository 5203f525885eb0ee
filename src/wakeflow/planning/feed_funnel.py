"""The feed funnel: what a run takes of it. Its beads are computed one by one by an engine, which is an extra.

It is optional: without a [funnel] table in the scene nothing here runs, and no engine need be there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from ..core.number import Known, Measured
from ..core.record import column
from ..core.registry import Registry
from ..scene import Funnel

PROVED = "1.02 to 1.26"  # rates computed bead by bead over the law: docs/validation.md#feed-funnel
DEEP = 0.05  # diameters: softened beads should overlap less
ENGINE = "LIGGGHTS"
Make = Callable[[str, str, Callable[[Path], None]], Path]


# -- What a feed funnel delivered --------------------------------------------------------------------------------------
@dataclass(frozen=True)
class DischargeCurve:
    """The mass left in the funnel over time."""

    time: tuple[float, ...] = column("s", "time since the outlet was opened")
    mass: tuple[float, ...] = column("kg", "mass left above the outlet")


@dataclass(frozen=True)
class FunnelSummary:
    """The discharge of a feed funnel, computed bead by bead."""

    verdict: str = column("", "emptied or stopped")
    rate: Measured = column("kg/s", "discharge rate; null where the flow stopped too early")
    time_to_empty: Known = column("s", "time until 99 % of the mass is out; null where it never was")
    left: int = column("1", "beads left inside")
    beads: int = column("1", "beads")
    mass: float = column("kg", "mass of all beads")
    packing: Known = column("1", "volume of beads over volume of the poured bed")
    beverloo: Known = column("kg/s", "Beverloo's law for a funnel at rest, flat floor")
    beverloo_cone: Known = column("kg/s", "Beverloo's law with Rose & Tanaka's cone factor")
    frequency: Known = column("Hz", "frequency of the vibration")
    gamma: Known = column("1", "peak acceleration of the wall over g")
    time_step: float = column("s", "time step of the computation")
    contact_time: float = column("s", "duration of the quickest collision")
    youngs_modulus: float = column("Pa", "Young's modulus of the beads, softened")
    overlap: float = column("1", "deepest overlap of two beads seen, in diameters")
    engine: str = column("", "the program")
    version: str = column("", "version of the program")
    curve: DischargeCurve = column("", "mass left over time")


# -- What computes it --------------------------------------------------------------------------------------------------
class BeadEngine(Protocol):
    """What pours beads into a funnel and lets them out; ``install``: the command that brings its program."""

    install: ClassVar[str]

    def compute(self, funnel: Funnel, make: Make, tell: Callable[[str], None]) -> FunnelSummary:
        """Pour and discharge. ``make(stage, key, work)`` gives the folder of a finished stage, from the cache or by
        ``work(folder)``. Raises ProgramError when the program is missing or fails.
        """

    def seconds(self, funnel: Funnel) -> float:
        """Core-seconds of pouring and discharge, as expected."""

    def version(self) -> str:
        """Version of the program. Raises ProgramError when there is none."""


bead_engines: Registry[BeadEngine] = Registry("engine of beads", extended=True)


def summary(funnel: Funnel) -> str:
    """The plan's line on the funnel."""
    if not funnel.computed:
        return f"feed funnel: {_by_law(funnel)}; no bead is computed"
    how = "at rest" if not funnel.amplitude else f"at {funnel.frequency:g} Hz, Gamma {funnel.gamma:g}"
    return (
        f"feed funnel: {funnel.beads} beads through {1e3 * funnel.orifice:.3g} mm {how} with {ENGINE}, about "
        f"{bead_engines[ENGINE].seconds(funnel):.0f} s; {_by_law(funnel)}"
    )


def _by_law(funnel: Funnel) -> str:
    return f"{1e3 * funnel.expected_rate:.3g} g/s by Beverloo's law for one at rest"


def by_law_line(funnel: Funnel) -> str:
    """What a user must know of the answer of a scene whose ``funnel`` delivers by its law."""
    return f"funnel: {_by_law(funnel)}; in seven funnels beads left {PROVED} times as fast"


def discharge_lines(discharge: FunnelSummary) -> list[str]:
    """What a user must know of a ``discharge``."""
    lines = []
    if discharge.verdict != "emptied":
        lines.append(f"funnel: the flow stopped with {discharge.left} of {discharge.beads} beads still inside")
    if discharge.rate and not discharge.rate.known:
        lines.append("funnel: emptied within a few periods of its vibration: the rate has no interval; use more mass")
    if discharge.overlap > DEEP:
        lines.append(
            f"funnel: beads overlap by up to {discharge.overlap:.1%} of their diameter; raise funnel.youngs_modulus"
        )
    return lines
