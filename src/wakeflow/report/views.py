"""What a finished run shows of itself in Python: its pictures on axes, and its answer in a notebook."""

from __future__ import annotations

from ..results.result import Result, accessors
from .plot import Plot
from .tables import result_card

__all__ = ["Result"]

accessors.add("plot", Plot)
accessors.add("html", result_card)
