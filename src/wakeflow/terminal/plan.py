"""The plan on a screen: what is used, what is left out and by which bound, the cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..planning.plan import whole_terms
from .warn import warn

if TYPE_CHECKING:
    from rich.table import Table

    from ..planning.plan import Plan
    from ..planning.terms import LeftOut

__all__ = ["show_plan"]


def show_plan(plan: Plan) -> None:
    """Print what is used, the bound on every term for every fraction, what is left out, and the cost."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    for line in plan.used:
        console.print(f"• {line}", highlight=False, markup=False)
    if any(how.bounds for how in plan.fractions.values()):
        console.print(_bounds_table(plan))
    table = Table("left out", "fraction", f"bound ({plan.unit})", "why", title=None, pad_edge=False)
    for (name, why), rows in _grouped(plan.left_out).items():
        bounds = "\n".join("–" if row.bound is None else f"{row.bound:.2g}" for row in rows)
        table.add_row(name, "\n".join(row.fraction or "all" for row in rows), bounds, Text(why))
    console.print(table)
    cost = plan.estimate
    console.print(
        f"about {cost['seconds']:.0f} s, {cost['memory'] / 1e9:.1f} GB of memory, {cost['disk'] / 1e6:.0f} MB of disk",
        highlight=False,
    )
    warn(console, plan.warnings, [notice.grade.value for notice in plan.notices])


def _grouped(rows: Sequence[LeftOut]) -> dict[tuple[str, str], list[LeftOut]]:
    """Rows with the same name and reason together, whatever their fraction."""
    groups: dict[tuple[str, str], list[LeftOut]] = {}
    for row in rows:
        groups.setdefault((row.name, row.why), []).append(row)
    return groups


def _bounds_table(plan: Plan) -> Table:
    """Terms by fractions: what each could move, in body widths; bold where it is computed."""
    from rich.table import Table

    title = f"how far each term could move a fraction, {plan.unit} (accuracy {plan.target_error:.2g} of a share)"
    table = Table(
        "term", title=title, title_justify="left", pad_edge=False, caption="bold: computed; the rest left out"
    )
    for name in plan.fractions:
        table.add_column(name, justify="right")
    terms = list(next(iter(plan.fractions.values())).bounds)
    whole = whole_terms(plan.airflow, plan.crowd)
    for term in terms:
        cells = [
            f"[bold]{how.bounds[term]:.2g}[/]" if term in how.forces or term in whole else f"{how.bounds[term]:.2g}"
            for how in plan.fractions.values()
        ]
        table.add_row(term, *cells)
    table.add_section()
    table.add_row("left out below", *(f"{how.limit:.2g}" for how in plan.fractions.values()))
    return table
