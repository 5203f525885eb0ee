"""Notices: each once, the gravest first."""

from __future__ import annotations

from wakeflow.core.graded import gravest_first, information, less_sure, void


def test_the_gravest_come_first_each_once_and_in_order() -> None:
    told = [information("a"), less_sure("b"), void("c"), less_sure("d"), less_sure("b")]
    assert [notice.text for notice in gravest_first(told)] == ["c", "b", "d", "a"]
