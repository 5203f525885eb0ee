"""What the granules' force on the air does: to the steady airflow, and to the shares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..pipeline.pipeline import Pipeline
from ..pipeline.track_stage import Companion
from .companions import Shares, shares_of
from .landing_results import LoadingEffect

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

__all__ = ["Unloaded", "fly_unloaded"]

UNLOADED = Companion("unloaded", loaded=False)


@dataclass(frozen=True)
class Unloaded:
    """Shares in air that does not feel the granules beside those of the same granules in the answer's air, and the run
    time (s) of the former.
    """

    without: Shares
    loaded: Shares
    seconds: float

    def effect(self, name: str, place: int) -> LoadingEffect:
        """Of a fraction in bin number ``place``."""
        return LoadingEffect(float(self.without[name][:, place].mean()), float(self.loaded[name][:, place].mean()))

    def effects(self, bins: Sequence[str]) -> dict[str, dict[str, LoadingEffect]]:
        """Of every fraction in every bin, elsewhere included, by their names in order."""
        return {name: {bin_: self.effect(name, i) for i, bin_ in enumerate(bins)} for name in self.loaded}


def fly_unloaded(pipeline: Pipeline, tracked: Tracked) -> Unloaded | None:
    """Fly the granules of the comparisons in air that does not feel them; None where no air does."""
    if pipeline.loading is None:
        return None
    without = shares_of(pipeline, pipeline.tracks(UNLOADED))
    return Unloaded(without, shares_of(pipeline, tracked), pipeline.spent(UNLOADED.name))
