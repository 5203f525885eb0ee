"""What the falling stream does to the first body: the ``impact`` table of result.json."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.record import column, from_json
from ..injection.impact_loads import impact_loads
from ..planning.plan import Plan
from ..scene import Scene

__all__ = ["FractionImpact", "ImpactForces", "ImpactSummary", "SlopeImpact", "StreamImpact", "impact_of"]


@dataclass(frozen=True)
class ImpactForces:
    """Mass flow, forces and power of first impacts, per metre of depth of the feed as given."""

    mass_flow: float = column("kg/s", "mass that meets the slope")
    normal: float = column("N", "force into the slope")
    tangential: float = column("N", "force down the slope")
    force: tuple[float, ...] = column("N", "on the body, x and y")
    power: float = column("W", "what the vibration gives to the stream")
    velocity: tuple[float, ...] | None = column("m/s", "of the centre of mass after the impact, x and y; null of none")


@dataclass(frozen=True)
class SlopeImpact:
    """All fractions on one slope."""

    start: tuple[float, ...] = column("m", "left end of the slope, x and y", key="from")
    end: tuple[float, ...] = column("m", "right end of the slope, x and y", key="to")
    forces: ImpactForces = column("", "the keys of ImpactForces", flat=True)


@dataclass(frozen=True)
class StreamImpact:
    """One fraction's stream on one slope, or on all."""

    fall_speed: float | None = column("m/s", "mean speed of fall on arrival; null of none")
    forces: ImpactForces = column("", "the keys of ImpactForces", flat=True)


@dataclass(frozen=True)
class FractionImpact:
    """One fraction's stream on the body."""

    mode: str = column("", "injected or resolved")
    slopes: dict[str, StreamImpact] = column("", "every slope that it meets")
    total: StreamImpact = column("", "all slopes together")


@dataclass(frozen=True)
class ImpactSummary:
    """First impacts on the first body, from left to right."""

    body: str = column("", "name of the body")
    slopes: dict[str, SlopeImpact] = column("", "every slope that is met, by name")
    fractions: dict[str, FractionImpact] = column("", "every fraction")
    total: ImpactForces = column("", "all fractions on all slopes")


def impact_of(scene: Scene, plan: Plan) -> ImpactSummary | None:
    """What the stream does to the first body; None where none stands or another may be met before it."""
    table = impact_loads(scene, plan)
    return None if table is None else from_json(ImpactSummary, table, "impact")
