"""The end of a run on a screen: the budget, the air, warnings, and last the answer; and the dividers of a run."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from ..answer.dividers import Dividers, cut
from ..answer.measurements import PAGE
from ..answer.shares import SHARE_UNIT, BudgetRow, Separation, least_certain, weightiest
from ..core.errors import known
from ..core.number import Number
from ..core.quantities import say
from ..show import words
from .screen import print_lines, screen_table, warn

if TYPE_CHECKING:
    from rich.table import Table

    from ..air.kinds.airflow_table import Airflow
    from ..answer.result import Result
    from ..planning.feed_funnel import FunnelSummary


HOW_TO_MEASURE = f"How to measure: {PAGE}. Write what you find as {{ value = ..., uncertainty = ... }}."
WEIGHS, MAX_PARTS = 0.1, 4  # of the largest error of a quantity, and how many errors are reported on screen
UNBROKEN = 1000  # letters, in which no line of a table breaks
SHORTEST = 0.5  # s: shorter run times are not worth a word
LEVEL = ("floor", "top")  # lines along x


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
    warn(result.warnings, result.grades)
    print_lines([f"results: {result.folder}"])
    if result.landings is not None:  # the answer last: it is what stays in sight
        if result.landings.without_collisions is not None:
            console.print(alone_table(result.landings.separation, result.landings.without_collisions))
        console.print(separation_table(result, result.landings.separation))


def _air(airflow: Airflow) -> str:
    """The airflow in one line."""
    drop, cd, base = airflow.pressure_drop, airflow.cd, airflow.cp_base
    if cd is None or base is None:
        return f"airflow: {airflow.verdict}, {airflow.flow_rate:.3g} m²/s, pressure drop {drop:.2g} Pa"
    interval = f" ({cd.low:.3f} to {cd.high:.3f})" if cd.known else ""  # none of a given case
    return (
        f"airflow: {airflow.verdict}, Cd {cd.value:.3f}{interval}, "
        f"base pressure coefficient {base.value:.2f}, pressure drop {drop:.1f} Pa"
    )


def _loading(result: Result) -> str:
    """What the granules' force on the air does, in one line."""
    loading = known(known(result.airflow).loading)
    if loading.cd is None:
        does = f"driven to {say(known(loading.speed), 'm/s', 2)}"
    else:
        does = f"steady Cd {known(loading.cd_without).value:.3f} to {loading.cd.value:.3f}"
    passes = f"{loading.passes} pass{'es' if loading.passes != 1 else ''}"
    told = f"air loading: {passes}, {loading.given:.2g} N/m on the air, {does}"
    effects = None if result.landings is None else result.landings.air_loading
    if not effects:
        return told
    rows = [(name, place, found) for name, places in effects.items() for place, found in places.items()]
    name, place, most = max(rows, key=lambda row: abs(row[2].loaded - row[2].without))
    before, after = (f"{100 * share:.1f}" for share in (most.without, most.loaded))
    return f"{told}; " + (
        f"most moved: {name} in {place}, {before} to {after} %" if before != after else "no share moves"
    )


def _poured(funnel: FunnelSummary) -> str:
    """The feed funnel in one line."""
    rate, law = funnel.rate, funnel.beverloo_cone
    if rate is None:
        return f"funnel: {funnel.verdict} with {funnel.left} of {funnel.beads} beads inside"
    found = f"funnel: {1e3 * rate.value:.3g} g/s"
    if rate.known:
        found += f" ({1e3 * rate.low:.3g} to {1e3 * rate.high:.3g})"
    empty = "" if funnel.time_to_empty is None else f", empty after {funnel.time_to_empty:.3g} s"
    return found + empty + ("" if law is None else f"; Beverloo's law with cone factor, at rest: {1e3 * law:.3g} g/s")


def separation_table(result: Result, separation: Separation) -> Table:
    """Bins by fractions: shares in percent with their 95 % interval; throughput, purity, recovery. Intervals are below
    their numbers where the screen is too narrow for them beside.
    """
    from rich.console import Console

    beside, console = _separated(result, separation, parted=False), Console()
    unbroken = console.measure(beside, options=console.options.update(max_width=UNBROKEN)).maximum
    return beside if unbroken <= console.width else _separated(result, separation, parted=True)


def _separated(result: Result, separation: Separation, *, parted: bool) -> Table:
    from rich.text import Text

    met = result.landings is not None and result.landings.slab is not None
    of = (
        "VOID: "
        if result.void
        else ""
        if result.calibration is None
        else f"calibrated with {result.calibration.source}: "
    )
    title = f"{of}share of each fraction's mass, %{', granules colliding' if met else ''}"
    rows: list[list[str | Text]] = []
    for one in words.bins_in_words(result, separation):
        told = [(_parted(share) if parted else share, wanted) for share, wanted in one.shares]
        shares = [Text(share, style="bold green" if wanted else "") for share, wanted in told]
        purest = "\n".join(f"{name} {_parted(share)}".strip() for name, share in one.purities)
        rows.append([one.place, *shares, one.flow, purest])
    below = [] if result.void else measure_next(result)  # more exact numbers mend no answer that is worth nothing
    first = [*words.verdict_lines(result), *words.money_lines(result)]
    caption = "\n".join(filter(None, [*first, words.holds(result), words.in_three_dimensions(result.landings), *below]))
    heads = ["bin", *separation.fractions, "kg/h", "purity"]
    return screen_table(heads, [*rows[: -words.SUMMED], [], *rows[-words.SUMMED :]], title, caption)


def _parted(text: str) -> str:
    """A percentage with its interval below it, so that columns stay narrow."""
    return text.replace(" ", "\n", 1)


def measure_next(result: Result) -> list[str]:
    """What a measurement would make of each recovery and each purity of a target; without targets, on which numbers
    each fraction's least certain share depends most.
    """
    if told := words.measurement_lines(result):
        return [*told, HOW_TO_MEASURE]
    told = []
    for name, (place, parts) in ({} if result.landings is None else least_certain(result.landings)).items():
        if known := weightiest(parts):
            inputs = ", ".join(f"{key} {part.points}" for key, part in known)
            told.append(f"{name} in {place} depends most on (points each): {inputs}")
    return [*told, HOW_TO_MEASURE] if told else []


def alone_table(separation: Separation, alone: Separation) -> Table:
    """Bins by fractions: the shares of granules that meet no others, and what crowding changes of them, in points."""

    def row(name: str, pairs: Iterable[tuple[Number | None, Number | None]]) -> list[str]:
        return [name, *(f"{words.percent(one)}  ({words.change_of(one, met)})" for one, met in pairs)]

    rows = [
        row(place, ((alone.fractions[name][place], found[place]) for name, found in separation.fractions.items()))
        for place in separation.bins
    ]
    recoveries = row("recovery", ((alone.recovery.get(n), separation.recovery.get(n)) for n in separation.fractions))
    title = "without collisions, %, and what they change, points"
    return screen_table(["bin", *separation.fractions], [*rows, [], recoveries], title)


def budget_table(budget: Sequence[BudgetRow]) -> Table:
    """The largest known errors of every quantity, the run time that knowing each source took, and what is unknown."""
    shown = words.condensed(budget)
    known = {part.source for row in shown for part in row.parts if part.error is not None}
    totals = any(row.total.error is not None for row in shown)  # else the note says why not
    rows = []
    for row in shown:
        unit = "" if row.measure == SHARE_UNIT else f" ({row.measure})"
        total = [_bare(row, row.total.error)] if totals else []
        rows.append([row.quantity.removeprefix("share.") + unit, _largest(row), *total])
    title = "budget: the largest errors, of shares in percentage points (all: budget.csv)"
    heads = ["quantity", "what limits it", *(["total"] if totals else [])]
    return screen_table(heads, rows, title, _budget_notes(shown, known), left=2)


def _largest(row: BudgetRow) -> str:
    """The largest errors of a quantity in words, those that weigh beside the largest."""
    parts = sorted((part for part in row.parts if part.error), key=lambda part: -(part.error or 0.0))
    if not parts:
        return words.NO_VALUE
    weighing = [part for part in parts if (part.error or 0.0) >= WEIGHS * (parts[0].error or 0.0)][:MAX_PARTS]
    return ", ".join(f"{part.source} {_bare(row, part.error)}" for part in weighing)


def _budget_notes(rows: Sequence[BudgetRow], known: Collection[str]) -> str:
    """Which terms are behind each sum of terms, and which sources are unknown."""
    notes: dict[str, None] = {}  # in order, each once
    for row in rows:
        for part in row.parts:
            if part.source in words.TERMS.values():
                notes[f"{row.quantity.split('.')[1]}, {part.source}: {part.note}"] = None
    cost = {source: spent for source, spent in words.source_seconds(rows).items() if spent >= SHORTEST}
    if cost:
        notes[f"run time, s: {', '.join(f'{source} {spent:.0f}' for source, spent in cost.items())}"] = None
    if unknown := [source for source in words.budget_columns(rows) if source not in known]:
        notes[f"unknown, so that no total is claimed: {', '.join(unknown)}"] = None
    return "\n".join(notes)


def _bare(row: BudgetRow, error: float | None) -> str:
    """An error without its unit, for a table that names it elsewhere."""
    return words.error_text(row, error).removesuffix(f" {row.measure}")


def show_dividers(found: Sequence[Dividers], on: str) -> None:
    """Print what dividers give at each purity asked; of a single one also the tables for a scene file."""
    from rich.console import Console

    fraction, level = found[0].fraction, on in LEVEL  # places are the machine's own x there
    rows = []
    for one in found:
        start = one.line[0, 0] if level else 0.0
        places = ", ".join(f"{1e3 * (start + low):.1f} to {1e3 * (start + high):.1f}" for low, high in one.stretches)
        judged = (
            [words.percent(one.purity), words.percent(one.recovery)]
            if one.possible
            else [words.NO_VALUE, words.NO_VALUE]
        )
        rows.append([f"{100 * one.asked:.4g}", *judged, places or "no stretch reaches it"])
    title = f"{fraction} on {on}, percent; judged on granules that had no part in the choice; interval: of their number"
    heads = ("purity asked", "purity", "recovery", f"stretches ({'x in mm' if level else 'mm along the line'})")
    Console().print(screen_table(heads, rows, title, left=0))
    if len(found) > 1 or not found[0].possible:
        return
    stretches = enumerate(found[0].stretches, 1)
    print_lines(f"[bin.{fraction}-{number}]\n{_as_bin(found[0], stretch, on)}" for number, stretch in stretches)
    if (found[0].purity.high or 1.0) < found[0].asked:
        asked = f"the {100 * found[0].asked:.4g} % asked for: ask for more, or keep more granules to choose by"
        print_lines([f"! judged on other granules the product is less pure than {asked} with numerics.keep"], "yellow")


def _as_bin(found: Dividers, stretch: tuple[float, float], on: str) -> str:
    """The keys of a bin over a stretch: from and to on the floor, else the points of its line."""
    points = cut(found.line, *stretch)
    if on == "floor":
        return "\n".join(f'{key} = "{1e3 * x:.5g} mm"' for key, (x, _) in zip(("from", "to"), points, strict=True))
    ends = ", ".join(f'["{1e3 * x:.5g} mm", "{1e3 * y:.5g} mm"]' for x, y in points)
    return f"points = [{ends}]"
