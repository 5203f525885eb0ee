"""What a feed funnel delivered: the ``funnel`` table of result.json."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.number import Number
from ..core.record import column


@dataclass(frozen=True)
class DischargeCurve:
    """The mass left in the funnel over time."""

    time: tuple[float, ...] = column("s", "since the outlet was opened")
    mass: tuple[float, ...] = column("kg", "left above the outlet")


@dataclass(frozen=True)
class FunnelSummary:
    """The discharge of a feed funnel, computed bead by bead."""

    verdict: str = column("", "emptied or stopped")
    rate: Number | None = column("kg/s", "discharge rate; null where the flow stopped too early")
    time_to_empty: float | None = column("s", "until 99 % of the mass is out; null where it never was")
    left: int = column("1", "beads left inside")
    beads: int = column("1", "beads")
    mass: float = column("kg", "of all beads")
    packing: float | None = column("1", "volume of beads over volume of the poured bed")
    beverloo: float | None = column("kg/s", "Beverloo's law for a funnel at rest, flat floor")
    beverloo_cone: float | None = column("kg/s", "the same with Rose & Tanaka's cone factor")
    frequency: float | None = column("Hz", "of the vibration")
    gamma: float | None = column("1", "peak acceleration of the wall over g")
    time_step: float = column("s", "of the computation")
    contact_time: float = column("s", "duration of the quickest collision")
    youngs_modulus: float = column("Pa", "of the beads, softened")
    overlap: float = column("1", "deepest overlap of two beads seen, in diameters")
    engine: str = column("", "the program")
    version: str = column("", "of the program")
    curve: DischargeCurve = column("", "mass left over time")
