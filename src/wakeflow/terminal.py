"""What a person at a terminal sees: the live line of a run and the tables at its end."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from .core.graded import Grade
from .planning.plan import whole_terms
from .report.words import (
    HOLDS,
    NO_VALUE,
    TERMS,
    budget_columns,
    change_of,
    condensed,
    error_text,
    expected,
    percent,
    source_seconds,
)
from .results.landing_results import SHARE_UNIT, BudgetRow, Separation

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from .planning.plan import Plan
    from .planning.terms import LeftOut
    from .results.airflow_summary import Airflow
    from .results.funnel_summary import FunnelSummary
    from .results.result import Result

__all__ = ["alone_table", "budget_table", "live", "measure_next", "separation_table", "show_plan", "show_result"]

MOST_WARNINGS = 3  # on screen; the rest is in the report
TOLD_FROM = 0.1  # part of a share's variance from which an unknown number is told
WEIGHS, MOST_PARTS = 0.1, 4  # of the largest error of a quantity, and how many errors are told on screen
SHORTEST = 0.5  # s: shorter run times are not worth a word
PLAIN_EVERY = 10.0  # s between lines when the output is not a terminal


@contextmanager
def live(*, enabled: bool) -> Iterator[Callable[[str, str], None]]:
    """A listener (stage, text): a line a thread kept up to date on a terminal, a line now and then elsewhere."""
    from rich.console import Console

    console = Console(stderr=True)
    if not enabled:
        yield lambda *_told: None
    elif console.is_terminal:
        with console.status("starting", spinner="dots") as status:
            now: dict[int, str] = {}  # what each thread is doing

            def update(stage: str, text: str) -> None:
                now[threading.get_ident()] = f"[bold]{stage}[/]  {text}"
                if text.startswith("done"):
                    console.print(f"[green]✓[/] {stage}  [dim]{text.removeprefix('done').strip()}[/]")
                    del now[threading.get_ident()]
                status.update("\n".join(now.values()))

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
    _warn(console, plan.warnings, [notice.grade.value for notice in plan.notices])


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


def show_result(result: Result) -> None:
    """Print the budget, the funnel, the airflow, what pictures say, the gravest warnings, and last the answer."""
    from rich.console import Console

    console = Console()
    if result.landings is not None:
        console.print(budget_table(result.landings.budget))
    if result.funnel is not None:
        console.print(_poured(result.funnel), highlight=False)
    if result.airflow is not None:
        console.print(_air(result.airflow), highlight=False)
        if result.airflow.loading is not None:
            console.print(_loading(result), highlight=False)
    for name, picture in (result.pictures or {}).items():
        console.print(f"figures/{name}: {picture.text}", highlight=False, markup=False)
    if result.refinement is not None:
        for line in (*result.refinement.unmet, *result.refinement.measure):
            console.print(f"• {line}", highlight=False, markup=False)
    _warn(console, result.warnings, result.grades)
    console.print(f"results: {result.folder}", highlight=False, soft_wrap=True)
    if result.landings is not None:  # the answer last: it is what stays in sight
        if result.landings.without_collisions is not None:
            console.print(alone_table(result.landings.separation, result.landings.without_collisions))
        console.print(separation_table(result, result.landings.separation))


def separation_table(result: Result, separation: Separation) -> Table:
    """Bins by fractions: shares in percent with half their 95 % interval; throughput, purity, recovery."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    met = result.landings is not None and result.landings.slab is not None
    title = f"share of each fraction's mass, %{', granules colliding' if met else ''}"
    table = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
    table.add_column("bin")
    for name in separation.fractions:
        table.add_column(name, justify="right")
    table.add_column("kg/h", justify="right")
    table.add_column("purity", justify="right")
    for place in separation.bins:
        cells = [
            Text(percent(places[place]), style="bold green" if place in result.targets(name) else "")
            for name, places in separation.fractions.items()
        ]
        purest = "\n".join(f"{name} {percent(found)}" for name, found in expected(result, place)) or NO_VALUE
        table.add_row(place, *cells, f"{separation.throughput[place]:.3g}", purest)
    table.add_section()
    table.add_row("recovery", *(percent(separation.recovery.get(name)) for name in separation.fractions), "", "")
    table.caption, table.caption_justify = "\n".join([HOLDS, *measure_next(result)]), "left"
    return table


def measure_next(result: Result) -> list[str]:
    """For each fraction the numbers of the scene that make most of its least certain share uncertain."""
    moved = {} if result.landings is None else result.landings.measure_next or {}
    told = []
    for name, places in moved.items():
        if not places:
            continue
        place, parts = max(places.items(), key=lambda one: sum(part.half**2 for part in one[1].values()))
        known = [(key, part) for key, part in parts.items() if part.variance >= TOLD_FROM][:MOST_PARTS]
        if known:
            inputs = ", ".join(f"{key} {100 * part.half:.2g}" for key, part in known)
            told.append(f"to know {name} in {place} better, measure (points each): {inputs}")
    return told


def alone_table(separation: Separation, alone: Separation) -> Table:
    """Bins by fractions: the shares of granules that meet no others, and what crowding changes of them, in points."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    title = "without collisions, %, and what they change, points"
    table = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
    table.add_column("bin")
    for name in separation.fractions:
        table.add_column(name, justify="right")
    for place in separation.bins:
        pairs = ((alone.fractions[name][place], found[place]) for name, found in separation.fractions.items())
        table.add_row(place, *(f"{percent(one)}  ({change_of(one, met)})" for one, met in pairs))
    table.add_section()
    recoveries = ((alone.recovery.get(name), separation.recovery.get(name)) for name in separation.fractions)
    table.add_row("recovery", *(f"{percent(one)}  ({change_of(one, met)})" for one, met in recoveries))
    return table


def budget_table(budget: Sequence[BudgetRow]) -> Table:
    """The largest known errors of every quantity, the run time that knowing each source took, and what is unknown."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    rows = condensed(budget)
    known = {part.source for row in rows for part in row.parts if part.error is not None}
    title = "budget: the largest errors, of shares in percentage points (all: budget.csv)"
    table = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
    table.add_column("quantity", no_wrap=True)
    table.add_column("what limits it")
    totals = any(row.total.error is not None for row in rows)  # else the note says why not
    if totals:
        table.add_column("total", justify="right")
    for row in rows:
        unit = "" if row.measure == SHARE_UNIT else f" ({row.measure})"
        total = [_bare(row, row.total.error)] if totals else []
        table.add_row(row.quantity.removeprefix("share.") + unit, _largest(row), *total)
    table.caption, table.caption_justify = _budget_notes(rows, known), "left"
    return table


def _largest(row: BudgetRow) -> str:
    """The largest errors of a quantity in words, those that weigh beside the largest."""
    parts = sorted((part for part in row.parts if part.error), key=lambda part: -(part.error or 0.0))
    if not parts:
        return NO_VALUE
    weighing = [part for part in parts if (part.error or 0.0) >= WEIGHS * (parts[0].error or 0.0)][:MOST_PARTS]
    return ", ".join(f"{part.source} {_bare(row, part.error)}" for part in weighing)


def _budget_notes(rows: Sequence[BudgetRow], known: Collection[str]) -> str | None:
    """Which terms stand behind each sum of terms, and which sources are unknown."""
    notes: dict[str, None] = {}  # in order, each once
    for row in rows:
        for part in row.parts:
            if part.source in TERMS.values():
                notes[f"{row.quantity.split('.')[1]}, {part.source}: {part.note}"] = None
    cost = {source: spent for source, spent in source_seconds(rows).items() if spent >= SHORTEST}
    if cost:
        notes[f"run time, s: {', '.join(f'{source} {spent:.0f}' for source, spent in cost.items())}"] = None
    if unknown := [source for source in budget_columns(rows) if source not in known]:
        notes[f"unknown, so that no total is claimed: {', '.join(unknown)}"] = None
    return "\n".join(notes) or None


def _bare(row: BudgetRow, error: float | None) -> str:
    """An error without its unit, for a table that names it elsewhere."""
    return error_text(row, error).removesuffix(f" {row.measure}")


def _air(airflow: Airflow) -> str:
    """The airflow in one line."""
    drop, cd, base = airflow.pressure_drop, airflow.cd, airflow.cp_base
    if cd is None or base is None:
        return f"airflow: {airflow.verdict}, {airflow.flow_rate:.3g} m²/s, pressure drop {drop:.2g} Pa"
    interval = "" if cd.low is None or cd.high is None else f" [{cd.low:.3f}, {cd.high:.3f}]"  # none of a given case
    return (
        f"airflow: {airflow.verdict}, Cd {cd.value:.3f}{interval}, "
        f"base pressure coefficient {base.value:.2f}, pressure drop {drop:.1f} Pa"
    )


def _loading(result: Result) -> str:
    """What the granules' force on the air does, in one line."""
    assert result.airflow is not None
    loading = result.airflow.loading
    assert loading is not None
    assert loading.cd is not None
    assert loading.cd_without is not None
    told = (
        f"air loading: {loading.passes} passes, {loading.given:.2g} N/m on the air, "
        f"steady Cd {loading.cd_without.value:.3f} to {loading.cd.value:.3f}"
    )
    effects = None if result.landings is None else result.landings.air_loading
    if not effects:
        return told
    rows = [(name, place, found) for name, places in effects.items() for place, found in places.items()]
    name, place, most = max(rows, key=lambda row: abs(row[2].loaded - row[2].without))
    return f"{told}; most moved: {name} in {place}, {100 * most.without:.1f} to {100 * most.loaded:.1f} %"


def _poured(funnel: FunnelSummary) -> str:
    """The feed funnel in one line."""
    rate, law = funnel.rate, funnel.beverloo_cone
    if rate is None or rate.value is None:
        return f"funnel: {funnel.verdict} with {funnel.left} of {funnel.beads} beads inside"
    found = f"funnel: {1e3 * rate.value:.3g} g/s"
    if rate.low is not None and rate.high is not None:
        found += f" [{1e3 * rate.low:.3g}, {1e3 * rate.high:.3g}]"
    empty = "" if funnel.time_to_empty is None else f", empty after {funnel.time_to_empty:.3g} s"
    return found + empty + ("" if law is None else f"; Beverloo's law with cone factor, at rest: {1e3 * law:.3g} g/s")


def _warn(console: Console, warnings: Sequence[str], grades: Sequence[str]) -> None:
    """The gravest warnings with their grades, and how many more there are."""
    for line, grade in list(zip(warnings, grades, strict=True))[:MOST_WARNINGS]:
        style = "bold red" if grade == Grade.VOID.value else "yellow" if grade == Grade.LESS_SURE.value else ""
        console.print(f"! {grade}: {line}", highlight=False, markup=False, style=style)
    if len(warnings) > MOST_WARNINGS:
        console.print(f"! and {len(warnings) - MOST_WARNINGS} more: report.html, or --json", highlight=False)
