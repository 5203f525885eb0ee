"""A property that is computed once, and by two threads at once for two objects."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from wakeflow.core.lazy import cached_property


class Slow:
    def __init__(self, meeting: Barrier) -> None:
        self.meeting, self.times = meeting, 0

    @cached_property
    def made(self) -> int:
        """What it says."""
        self.times += 1
        self.meeting.wait(timeout=20)
        return self.times


def test_two_threads_do_not_wait_for_each_other_and_each_value_is_made_once() -> None:
    both = Barrier(2)  # broken, and an error, where one is made only after the other
    subjects = [Slow(both), Slow(both)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda one: one.made, subjects)) == [1, 1]
    assert [one.made for one in subjects] == [1, 1]
    assert Slow.made.__doc__ == "What it says."
