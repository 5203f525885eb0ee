"""The run time that a stage took."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.record import column


@dataclass(frozen=True)
class StageTime:
    """What a stage took when it was computed."""

    seconds: float = column("s", "run time of the stage, when it was computed")
    cached: bool = column("", "whether it came from the cache now")
