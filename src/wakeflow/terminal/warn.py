"""Warnings on a screen: the gravest, and how many more there are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..core.graded import Grade

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["MOST_WARNINGS", "warn"]

MOST_WARNINGS = 3  # on screen; the rest is in the report


def warn(console: Console, warnings: Sequence[str], grades: Sequence[str], most: int = MOST_WARNINGS) -> None:
    """The gravest warnings with their grades, at ``most`` so many, and how many more there are."""
    for line, grade in list(zip(warnings, grades, strict=True))[:most]:
        style = "bold red" if grade == Grade.VOID.value else "yellow" if grade == Grade.LESS_SURE.value else ""
        console.print(f"! {grade}: {line}", highlight=False, markup=False, style=style)
    if len(warnings) > most:
        console.print(f"! and {len(warnings) - most} more: report.html, or --json", highlight=False)
