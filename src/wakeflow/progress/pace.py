"""How far a run is: which of its stages are done, and how long the others will take at the pace so far."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from ..core.quantities import duration
from ..planning.cost import wall_seconds
from ..planning.plan import StageCost

__all__ = ["FROM_CACHE", "RunProgress"]

DONE, FROM_CACHE = "done", "done (from the cache)"  # how the text of a stage begins that is done
TRUSTED = 20.0  # s: until about as much has been done the expected times are trusted more than the pace so far
OVERDUE = 0.95  # of a stage's expected time: no more counts as done before the stage says so


@dataclass
class RunProgress:
    """The stages that are expected, and what was heard of them since ``started`` (s, of the ``clock``)."""

    expected: Sequence[StageCost] = ()
    cores: int = 2
    clock: Callable[[], float] = time.monotonic
    started: float = 0.0
    done: Counter[str] = field(default_factory=Counter)  # by stage: how often it is done
    under_way: dict[str, float] = field(default_factory=dict)  # by stage: since when

    def begin(self, expected: Sequence[StageCost], cores: int) -> None:
        """Start anew, with these stages."""
        self.expected, self.cores, self.started = expected, cores, self.clock()
        self.done.clear()
        self.under_way.clear()

    def hear(self, stage: str, text: str) -> None:
        """Take note of what a listener hears."""
        if text.startswith(FROM_CACHE) and not self.done[stage]:  # what costs nothing now says nothing of the pace
            self.expected = [one for one in self.expected if one.name != stage]
        elif text.startswith(DONE):
            self.done[stage] += not text.startswith(FROM_CACHE)
            self.under_way.pop(stage, None)
        else:
            self.under_way.setdefault(stage, self.clock())

    @property
    def number(self) -> int:
        """The place of the stage that is under way among the expected ones, counted from one."""
        return min(len(self.expected), 1 + sum(self.done[one.name] >= one.times for one in self.expected))

    @property
    def part(self) -> float:
        """What part of the expected time has been worked off."""
        whole = wall_seconds(self.expected, self.cores)
        return 1.0 - wall_seconds(self._ahead(), self.cores) / whole if self.expected else 0.0

    @property
    def left(self) -> float | None:
        """Seconds until the end; None where nothing is known of what is to come."""
        if not self.expected:
            return None
        ahead = wall_seconds(self._ahead(), self.cores)
        behind = wall_seconds(self.expected, self.cores) - ahead
        return ahead * (self.clock() - self.started + TRUSTED) / (behind + TRUSTED)

    def _ahead(self) -> list[StageCost]:
        """The stages with what they will still take."""
        now, found = self.clock(), []
        for one in self.expected:
            ahead = max(0, one.times - self.done[one.name]) * one.seconds
            if ahead and one.name in self.under_way:
                ahead -= min(now - self.under_way[one.name], OVERDUE * one.seconds)
            found.append(replace(one, seconds=ahead, times=1))
        return found

    def __str__(self) -> str:
        """Stage n of m, and the time left; empty where nothing is known."""
        if self.left is None:
            return ""
        return f"stage {self.number} of {len(self.expected)}, about {duration(self.left)} left"
