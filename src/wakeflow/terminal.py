"""What a person at a terminal sees: the live line of a run and the tables at its end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

    from .planning.plan import Plan
    from .planning.terms import LeftOut
    from .runs import Result

__all__ = ["live", "show_plan", "show_result"]

PLAIN_EVERY = 10.0  # s between lines when the output is not a terminal


@contextmanager
def live(*, enabled: bool) -> Iterator[Callable[[str, str], None]]:
    """A listener (stage, text): one line kept up to date on a terminal, a line now and then elsewhere."""
    from rich.console import Console

    console = Console(stderr=True)
    if not enabled:
        yield lambda stage, text: None
    elif console.is_terminal:
        with console.status("starting", spinner="dots") as status:

            def update(stage: str, text: str) -> None:
                if text.startswith("done"):
                    console.print(f"[green]✓[/] {stage}  [dim]{text.removeprefix('done').strip()}[/]")
                status.update(f"[bold]{stage}[/]  {text}")

            yield update
    else:
        last: dict[str, float] = {}

        def plain(stage: str, text: str) -> None:
            now = time.monotonic()
            if text.startswith("done") or now - last.get(stage, -PLAIN_EVERY) >= PLAIN_EVERY:
                last[stage] = now
                console.print(f"{stage}: {text}", highlight=False, markup=False, soft_wrap=True)

        yield plain


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
    _warn(console, plan.warnings)


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
    for term in terms:
        cells = [
            f"[bold]{how.bounds[term]:.2g}[/]" if term in how.forces else f"{how.bounds[term]:.2g}"
            for how in plan.fractions.values()
        ]
        table.add_row(term, *cells)
    table.add_section()
    table.add_row("left out below", *(f"{how.limit:.2g}" for how in plan.fractions.values()))
    return table


def show_result(result: Result) -> None:
    """Print the separation and its budget."""
    from rich.console import Console

    console = Console()
    table = result.table
    if "separation" in table:
        from .report.tables import budget_table, separation_table

        console.print(separation_table(table))
        console.print(budget_table(table))
    if table.get("funnel"):
        console.print(_poured(table["funnel"]), highlight=False)
    airflow: dict[str, Any] | None = table.get("airflow")
    if airflow and airflow["cd"] is None:
        flow, drop = airflow["flow_rate"], airflow["pressure_drop"]
        console.print(f"airflow: {airflow['verdict']}, {flow:.3g} m²/s, pressure drop {drop:.2g} Pa", highlight=False)
    elif airflow:
        cd, base = airflow["cd"], airflow["cp_base"]["value"]
        console.print(
            f"airflow: {airflow['verdict']}, Cd {cd['value']:.3f} [{cd['low']:.3f}, {cd['high']:.3f}], "
            f"base pressure coefficient {base:.2f}, pressure drop {airflow['pressure_drop']:.1f} Pa",
            highlight=False,
        )
    for name, picture in (table.get("pictures") or {}).items():
        console.print(f"figures/{name}: {picture['text']}", highlight=False, markup=False)
    _warn(console, table["warnings"])
    console.print(f"results: {result.folder}", highlight=False, soft_wrap=True)


def _poured(funnel: dict[str, Any]) -> str:
    """The feed funnel in one line."""
    rate, law = funnel["rate"], funnel["beverloo_cone"]
    if rate is None:
        return f"funnel: {funnel['verdict']} with {funnel['left']} of {funnel['beads']} beads inside"
    found = f"funnel: {1e3 * rate['value']:.3g} g/s"
    if rate["low"] is not None:
        found += f" [{1e3 * rate['low']:.3g}, {1e3 * rate['high']:.3g}]"
    empty = "" if funnel["time_to_empty"] is None else f", empty after {funnel['time_to_empty']:.3g} s"
    return found + empty + ("" if law is None else f"; Beverloo's law with cone factor, at rest: {1e3 * law:.3g} g/s")


def _warn(console: Any, warnings: Sequence[str]) -> None:
    for line in warnings:
        console.print(f"! {line}", highlight=False, markup=False, style="yellow")
