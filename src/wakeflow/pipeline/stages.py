"""The stages of a pipeline by name, and the run time that each took."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..core.record import column

__all__ = ["StageKey", "StageTime"]


class StageKey(NamedTuple):
    """A ``stage`` of one pipeline; ``label`` tells the pipelines of a scene's airflows apart, "" for the answer's."""

    label: str
    stage: str

    def __str__(self) -> str:
        return self.label + self.stage


@dataclass(frozen=True)
class StageTime:
    """What a stage took when it was computed."""

    seconds: float = column("s", "run time of the stage, when it was computed")
    cached: bool = column("", "whether it came from the cache now")
