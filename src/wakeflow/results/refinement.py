"""What a run with a target error bought, round by round: tables of result.json."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.record import column

__all__ = ["KnobSettings", "Refinement", "RefinementRound"]


@dataclass(frozen=True)
class KnobSettings:
    """The numbers of a scene that time is spent on."""

    granules: int = column("1", "tracked per fraction: feed.count")
    tolerance: float = column("body widths", "landing error of the tracker: numerics.tolerance")
    mesh_scale: float | None = column("1", "factor on every cell edge: numerics.mesh_scale; null without a mesh")
    averaging: float | None = column(
        "1", "relative half width at which the wake's averages may end: numerics.averaging; null where nothing sheds"
    )
    slab: int | None = column("1", "granules counted in the slab: collisions.count; null where granules do not meet")


@dataclass(frozen=True)
class RefinementRound:
    """One run on the way to a target error: what it was spent on, and the error that was expected and found."""

    settings: KnobSettings = column("", "what was computed with")
    bought: str = column("", "what is finer than in the round before, in words")
    expected: float | None = column("1", "largest error by computing that was expected; null of the first round")
    found: float = column("1", "the same, found: of the bin shares that computing can bring to the target")
    expected_seconds: float | None = column("s", "run time that was expected; null of the first round")
    seconds: float = column("s", "run time of the stages that no round before had made")


@dataclass(frozen=True)
class Refinement:
    """How a target error was met, or why it could not be."""

    target: float = column("1", "half width asked for every bin share, by computing alone")
    met: bool = column("", "whether every bin share meets it by computing alone, with no part unknown")
    numerical: float = column("1", "largest half width of a bin share by computing alone")
    total: float | None = column("1", "largest half width with the inputs; null where a part is unknown")
    rounds: tuple[RefinementRound, ...] = column("", "every run on the way, the last one is the answer's")
    unmet: tuple[str, ...] = column(
        "", "parts and bounds that no setting brings to the target, and what to give or run instead"
    )
    measure: tuple[str, ...] = column("", "what to measure, how well, for totals that meet the target too")
