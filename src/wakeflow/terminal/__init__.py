"""What a person at a terminal sees: the live line of a run and the tables at its end."""

from __future__ import annotations

from ..progress import live
from .plan import show_plan, show_whole_plan
from .result import show_result

__all__ = ["live", "show_plan", "show_result", "show_whole_plan"]
