"""What a user must know, graded by what it does to the answer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from .record import column

GRADES = "of each warning: the answer is void, less sure, or for information"


class Grade(Enum):
    """What a notice says of the answer, the gravest first."""

    VOID = "the answer is void"
    LESS_SURE = "less sure"
    INFORMATION = "for information"


@dataclass(frozen=True)
class Notice:
    """One line that a user must know."""

    grade: Grade = column("", GRADES)
    text: str = column("", "the line, which ends with what to change where something can be changed")


def void(text: str) -> Notice:
    """What makes the answer worth nothing."""
    return Notice(Grade.VOID, text)


def less_sure(text: str) -> Notice:
    """What makes the answer less sure than it looks."""
    return Notice(Grade.LESS_SURE, text)


def information(text: str) -> Notice:
    """What explains the answer and takes nothing from it."""
    return Notice(Grade.INFORMATION, text)


def gravest_first(notices: Iterable[Notice]) -> tuple[Notice, ...]:
    """Order notices, each once: the gravest first, those of a grade in the order in which they come."""
    grades = list(Grade)
    return tuple(sorted(dict.fromkeys(notices), key=lambda notice: grades.index(notice.grade)))
