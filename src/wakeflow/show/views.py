"""What a finished run shows of itself in Python: its pictures on axes; and in a notebook, as a table of many does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..answer.result import Result, accessors
from .html.template import page_template
from .many_figures import main_quantities
from .plot import Plot
from .sketch import UNITS
from .words import bins_in_words, holds

if TYPE_CHECKING:
    from ..answer.result_table import ResultTable

__all__ = ["Result", "result_card", "table_card"]  # a Result with what it shows

WARNINGS = 3  # on a card, the gravest
ROWS = 50  # of a card's table; all are in its frame


def result_card(result: Result) -> str:
    """The shares of a finished run as HTML, with their intervals, bold in a fraction's targets; the gravest warnings;
    links to the report.
    """
    landings, page = result.landings, result.folder / "report.html"
    bins = [] if landings is None else list(bins_in_words(result, landings.separation))
    card = page_template("cards.html.j2").module.result
    return str(card(result, landings, bins, result.warnings[:WARNINGS], holds(result), page))


def table_card(table: ResultTable) -> str:
    """A row a scene as HTML: its inputs, and what the table is made for, in percent with 95 % intervals."""
    return str(page_template("cards.html.j2").module.scenes(table.read_in(UNITS), main_quantities(table), ROWS))


accessors.add("plot", Plot)
accessors.add("html", result_card)
