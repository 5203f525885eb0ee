"""What a finished run shows of itself in Python: its pictures on axes, and its answer in a notebook."""

from __future__ import annotations

from ..answer.result import accessors
from .html.cards import result_card
from .plot import Plot

accessors.add("plot", Plot)
accessors.add("html", result_card)
