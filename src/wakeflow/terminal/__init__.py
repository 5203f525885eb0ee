"""What a person at a terminal sees: the live line of a run and the tables at its end."""

from __future__ import annotations

from ..progress import live
from .budget import budget_table
from .plan import show_plan, show_whole_plan
from .result import show_result
from .shares import alone_table, separation_table
from .warn import MOST_WARNINGS

__all__ = [
    "MOST_WARNINGS", "alone_table", "budget_table", "live", "separation_table", "show_plan", "show_result",
    "show_whole_plan",
]  # fmt: skip
