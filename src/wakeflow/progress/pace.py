"""How far a run is: which of its stages are done, and how long the others will take at the pace of their kind."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from ..core.quantities import duration
from ..planning.cost import wall_seconds
from ..planning.stages import StageCost

__all__ = ["FROM_CACHE", "RunProgress"]

DONE, FROM_CACHE = "done", "done (from the cache)"  # how the text of a stage begins that is done
TRUSTED = 20.0  # s: until about as much of a kind of work is done its expected time is trusted more than its pace
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
    took: dict[str, float] = field(default_factory=dict)  # by stage: s, each time it was done now

    def begin(self, expected: Sequence[StageCost], cores: int) -> None:
        """Start anew, with these stages."""
        self.expected, self.cores, self.started = expected, cores, self.clock()
        for known in (self.done, self.under_way, self.took):
            known.clear()

    def hear(self, stage: str, text: str) -> None:
        """Take note of what a listener hears."""
        if text.startswith(FROM_CACHE) and not self.done[stage]:  # what costs nothing now says nothing of the pace
            self.expected = [one for one in self.expected if one.name != stage]
        elif text.startswith(DONE):
            began = self.under_way.pop(stage, None)
            if began is not None and not text.startswith(FROM_CACHE):
                self.took[stage] = self.took.get(stage, 0.0) + self.clock() - began
            self.done[stage] += not text.startswith(FROM_CACHE)
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
        """Seconds until the end, each kind of work at its own pace so far: a solver that takes twice as long as was
        expected says nothing of flights. None where nothing is known of what is to come.
        """
        if not self.expected:
            return None
        paces = self._paces()
        ahead = [replace(one, seconds=one.seconds * paces[one.key.stage.work]) for one in self._ahead()]
        return wall_seconds(ahead, self.cores)

    def _paces(self) -> dict[str, float]:
        """By kind of work: seconds that its stages take over those expected of them."""
        sums = {one.key.stage.work: [TRUSTED, TRUSTED] for one in self.expected}
        for one, taken, expected in self._seen():
            both = sums[one.key.stage.work]
            both[0], both[1] = both[0] + taken, both[1] + expected
        return {kind: taken / expected for kind, (taken, expected) in sums.items()}

    def _seen(self) -> Iterator[tuple[StageCost, float, float]]:
        """Stages that are done or overdue, with the seconds that they took so far and those expected of them."""
        now = self.clock()
        for one in self.expected:
            if one.name in self.took:
                yield one, self.took[one.name], self.done[one.name] * one.seconds
            if now - self.under_way.get(one.name, now) > one.seconds:
                yield one, now - self.under_way[one.name], one.seconds

    def _ahead(self) -> list[StageCost]:
        """The stages with what they were expected to take still."""
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
