"""The numbers of a result as words and tables: CSV, the page, the screen and notebooks take theirs here.

Shares are of a fraction's mass, purities of a bin's mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..answer.budget.agreement import agreement_in, measured_in
from ..answer.budget.budget import remedies
from ..answer.measurements import measured_words, worth_measuring
from ..answer.result_table import is_part
from ..answer.shares import LEFT_OUT, NOT_COMPUTED, SHARE_UNIT, BudgetPart, BudgetRow
from ..core.errors import known
from ..core.number import NO_VALUE as NO_VALUE
from ..core.number import UNKNOWN_ERROR as UNKNOWN_ERROR
from ..core.number import VOID as VOID
from ..core.number import Number
from ..core.number import percent as percent
from ..core.quantities import say
from ..core.tables import Cell, CellTable

if TYPE_CHECKING:
    from rich.text import Text

    from ..air.kinds.airflow_table import Airflow
    from ..answer.result import Result
    from ..answer.result_table import Difference, TableQuantity
    from ..answer.shares import Separation, Verdict
    from ..flight.feed.impact_loads import ImpactForces
    from ..planning.feed_funnel import FunnelSummary


# -- The numbers of a result as words ----------------------------------------------------------------------------------
OF_WHAT = "what the scene does not say exactly, granules, {}, terms left out"
UNPROVEN = "No measurement of granules validates this machine."
Differences = Mapping[str, Mapping[str, "Difference"]]  # from the first of several runs, by quantity and run
TERMS = {LEFT_OUT: "terms left out", NOT_COMPUTED: "terms not computed"}  # a column of the budget for each kind of term
ROUGH = 0.1  # an error of a share from which percentage points are written without decimals


class WordTable(NamedTuple):
    """A table to print: its heads, rows of cells (an empty row draws a line), title and caption; the first ``left``
    columns lean to the left.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[str | Text]]
    title: str = ""
    caption: str = ""
    left: int = 1


def holds(result: Result) -> str:
    """What the intervals of an answer hold, and what they do not."""
    if result.void:
        return f"VOID: the answer is worth nothing, whatever its intervals say: {result.why_void}."
    of_what = OF_WHAT.format("steps" if result.airflow is None else "shedding cycles, steps, mesh")
    measured = None if result.landings is None else measured_in(result)
    if result.calibration is not None:
        proven = calibrated_with(result)
    else:
        proven = UNPROVEN if measured is None else agreement_in(result, measured).sentence
    if not result.lacking:
        return f"The interval holds 95 %: {of_what}. {proven}"
    cures = remedies(result.lacking)
    mend = f"; it takes {'; '.join(cures)}" if cures else ""
    return (
        f"The interval lacks {', '.join(result.lacking)}, whose size is not known{mend}. Of the rest it holds 95 %: "
        f"{of_what}. {proven}"
    )


def calibrated_with(result: Result) -> str:
    """What an answer was calibrated with, and what the scene says that contradicts it; empty of any other answer."""
    calibration = result.calibration
    return "" if calibration is None else f"Calibrated with {calibration.source}. {calibration.conflict}".rstrip()


def in_three_dimensions(result: Result) -> str:
    """The shares that were computed in three dimensions for a machine like this one; empty without any."""
    known = {} if result.landings is None else result.landings.three_dimensions
    shares = [f"{name} in {place} {percent(share)} %" for name, row in known.items() for place, share in row.items()]
    about = "this body at this Stokes number, each granule alone; in the interval"
    return f"Three dimensions: {', '.join(shares)} ({about})" if shares else ""


def measurement_lines(result: Result) -> list[str]:
    """A line for each recovery and purity that a measurement would narrow: the best one, and what it leaves."""
    lines = []
    for name, number, bought in worth_measuring(result):
        kind, *of = name.split(".")
        what = f"recovery of {of[0]}" if kind == "recovery" else f"purity of {of[1]} in {of[0]}"
        best = bought[0]
        lines.append(
            f"{what}, now {percent(number)} %: measure {measured_words(best)} and it becomes {percent(best.number)} %"
        )
    return lines


def headline(result: Result) -> list[str]:
    """The answer in plain words, a sentence for each fraction that has a target."""
    if result.landings is None:
        return []
    if result.void:
        return [f"This answer is void: {result.why_void}."]
    lines, shares = [], result.landings.separation
    for name, number in shares.recovery.items():
        if number is None:
            continue
        places = result.targets(name)
        pure = [(place, (shares.purity.get(place) or {}).get(name)) for place in places]
        known = [(part_words(purity), place) for place, purity in pure if purity is not None]
        parts = list(dict.fromkeys(part for part, _ in known))
        of_bin = ""
        if len(parts) == 1:
            of_bin = f"; it makes up {parts[0]} of what lies there"
        elif known:
            of_bin = f"; it makes up {', '.join(f'{part} in {place}' for part, place in known)}"
        lost = f"{part_words(shares.loss.get(name))}, {rate_words(shares.lost.get(name))}, is lost"
        lines.append(f"Of the {name}, {part_words(number)} lands in {' or '.join(places)}; {lost}{of_bin}.")
    return lines


def part_words(number: Number | None) -> str:
    """A part of a whole within a sentence: ``"62.1 (61.3 to 62.9) %"``, or ``"an unknown part (0 to 50 %)"``."""
    text = part_text(number)
    return f"an {text[:-3].replace('(', 'part (')} %)" if text.startswith(UNKNOWN_ERROR) else text


def part_text(number: Number | None, *, void: bool = False) -> str:
    """Text of a part as of :func:`percent`, with its sign behind what is a number."""
    text = percent(number, void=void)
    return text if text in (NO_VALUE, VOID) else f"{text} %"


def quantity_text(number: TableQuantity | None, *, void: bool = False) -> str:
    """A number of a table with its 95 % interval: a part of a whole as :func:`percent`, another in its own unit."""
    if number is None or void or is_part(number.name) or not math.isfinite(number.value):
        return percent(number, void=void)
    return _unit_words(number, "").rstrip()


def rate_words(number: Number | None, *, void: bool = False) -> str:
    """``"3.9 (1.5 to 9.6) kg/h"`` from a rate in kg/h; as :func:`percent` for none, and in a void answer."""
    if number is None or void:
        return percent(number, void=void)
    return _unit_words(number, "kg/h")


def _unit_words(number: Number, unit: str) -> str:
    value, low, high = (f"{end:.3g}" for end in number)
    return f"{value} ({low} to {high}) {unit}" if number.known else f"{value} {unit}"


def air_words(airflow: Airflow) -> str:
    """The airflow in one line."""
    drop, cd, base = airflow.pressure_drop, airflow.cd, airflow.cp_base
    if not cd or not base:
        return f"airflow: {airflow.verdict}, {airflow.flow_rate:.3g} m²/s, pressure drop {drop:.2g} Pa"
    interval = f" ({cd.low:.3f} to {cd.high:.3f})" if cd.known else ""  # none of a given case
    return (
        f"airflow: {airflow.verdict}, Cd {cd.value:.3f}{interval}, "
        f"base pressure coefficient {base.value:.2f}, pressure drop {drop:.1f} Pa"
    )


def loading_words(result: Result) -> str:
    """What the granules' force on the air does, in one line."""
    loading = known(known(result.airflow).loading)
    if not loading.cd:
        does = f"driven to {say(loading.speed, 'm/s', 2)}"
    else:
        does = f"steady Cd {loading.cd_without.value:.3f} to {loading.cd.value:.3f}"
    passes = f"{loading.passes} pass{'es' if loading.passes != 1 else ''}"
    line = f"air loading: {passes}, {loading.given:.2g} N/m on the air, {does}"
    effects = None if result.landings is None else result.landings.air_loading
    if not effects:
        return line
    rows = [(name, place, effect) for name, places in effects.items() for place, effect in places.items()]
    name, place, most = max(rows, key=lambda row: abs(row[2].loaded - row[2].without))
    before, after = (f"{100 * share:.1f}" for share in (most.without, most.loaded))
    return f"{line}; " + (
        f"most moved: {name} in {place}, {before} to {after} %" if before != after else "no share moves"
    )


def funnel_words(funnel: FunnelSummary) -> str:
    """The feed funnel in one line."""
    rate, law = funnel.rate, funnel.beverloo_cone
    if not rate:
        return f"funnel: {funnel.verdict} with {funnel.left} of {funnel.beads} beads inside"
    line = f"funnel: {1e3 * rate.value:.3g} g/s"
    if rate.known:
        line += f" ({1e3 * rate.low:.3g} to {1e3 * rate.high:.3g})"
    empty = f", empty after {funnel.time_to_empty:.3g} s" if funnel.time_to_empty > 0.0 else ""
    return line + empty + (f"; Beverloo's law with cone factor, at rest: {1e3 * law:.3g} g/s" if law > 0.0 else "")


def verdict_lines(result: Result) -> list[str]:
    """A line for each limit of the scene: what it is, whether it is met, what the answer says, what would decide."""
    return [
        f"{verdict.limit} at most {100 * verdict.most:.4g} %: {verdict.verdict}, {_held(verdict, void=result.void)}"
        + (f"; it takes {verdict.decides}" if verdict.decides else "")
        for verdict in result.limits
    ]


def _held(verdict: Verdict, *, void: bool) -> str:
    """What the answer says of what a limit holds."""
    if void:
        return "the answer is void"
    return "nothing lands there" if verdict.value is None else part_words(verdict.value)


def money_lines(result: Result) -> list[str]:
    """What the setting earns an hour and what that is made of; nothing in a scene without prices."""
    money = None if result.landings is None else result.landings.separation.money
    if money is None:
        return []
    if result.void:
        return [f"Money: {VOID}."]
    products = _unit_words(money.products, "EUR/h")
    if money.fan is None or money.total is None:
        return [f"The products are worth {products}; the fan's cost is not known: this airflow has no pressure drop."]
    fan = ""
    if money.fan_power is not None:
        fan = f", less {money.fan:.3g} EUR/h for a fan that draws {say(money.fan_power, 'W', 3)}"
    return [f"It earns {_unit_words(money.total, 'EUR/h')}: products worth {products}{fan}."]


def split_cure(line: str) -> tuple[str, str]:
    """A warning in two: what is the matter, and the keys and switches that change it, empty where it names none."""
    what, sign, cure = line.rpartition("; ")
    named = sign and any(mark in cure for mark in ("=", "--", ".", "[", "_"))
    return (what, cure) if named else (line, "")


def change_of(before: Number | None, after: Number | None) -> str:
    """``"-17.2"``: what a share in 0..1 changes by, in percentage points; a dash where either is not known."""
    if before is None or after is None:
        return NO_VALUE
    return f"{100.0 * (after.value - before.value):+.1f}"


def difference_text(difference: Difference) -> str:
    """``"+3.1 points (+1.2 to +5)"``: a difference and its 95 % interval; of shares, purities and recoveries percentage
    points, of others in their unit.
    """
    share = difference.unit == "1" and not difference.quantity.startswith("airflow.")
    scale, unit = (100.0, "points") if share else (1.0, "" if difference.unit == "1" else difference.unit)
    ends = f" ({scale * difference.low:+.3g} to {scale * difference.high:+.3g})" if difference.known else ""
    return f"{scale * difference.value:+.3g} {unit}".rstrip() + ends


def expected(result: Result, place: str) -> list[tuple[str, Number]]:
    """Purities that matter in a bin: of the fractions that have it as target, else the one that makes up most of it."""
    purity = None if result.landings is None else result.landings.separation.purity.get(place)
    if not purity:
        return []
    wanted = [(name, number) for name, number in purity.items() if place in result.targets(name)]
    return wanted or [max(purity.items(), key=lambda item: item[1].value)]


def condensed(budget: Sequence[BudgetRow]) -> list[BudgetRow]:
    """The budget with the terms that are left out added up, parts of unknown size last.

    One part represents the terms that were left out as small enough for the accuracy asked for, one for those that
    could matter and are not computed; their notes name the terms.
    """
    rows = []
    for row in budget:
        parts = [part for part in row.parts if not part.kind]
        for kind, title in TERMS.items():
            terms = [part for part in row.parts if part.kind == kind]
            if terms:
                parts.append(_sum(terms, title))
        known = [part for part in parts if part.error is not None]
        rows.append(replace(row, parts=(*known, *(part for part in parts if part.error is None))))
    return rows


def _sum(terms: Sequence[BudgetPart], title: str) -> BudgetPart:
    error = min(1.0, sum(term.error or 0.0 for term in terms))
    return replace(terms[0], source=title, error=error, note=", ".join(term.source for term in terms))


def budget_columns(budget: Sequence[BudgetRow]) -> list[str]:
    """Every source of error in the budget, in order of appearance."""
    return list(dict.fromkeys(part.source for row in budget for part in row.parts))


def error_text(row: BudgetRow, error: float | None) -> str:
    """An error as shown: percentage points for shares, the quantity's own unit otherwise."""
    if error is None:
        return UNKNOWN_ERROR
    if row.measure == SHARE_UNIT:
        return "0" if error == 0 else f"{100 * error:.0f}" if error >= ROUGH else f"{100 * error:.2g}"
    return f"{error:.2g} {row.measure}"


def source_seconds(budget: Sequence[BudgetRow]) -> dict[str, float]:
    """The run time (s) behind each source; the same run serves all quantities, so the largest counts."""
    spent: dict[str, float] = {}
    for row in budget:
        for part in row.parts:
            spent[part.source] = max(spent.get(part.source, 0.0), part.seconds)
    return spent


# -- A result as tables ------------------------------------------------------------------------------------------------
SEPARATION_COLUMNS = (  # low and high: the 95 % interval, of which computing alone makes a part
    "fraction", "bin", "share (%)", "share low (%)", "share high (%)", "share by computing alone (+- %)", "purity (%)",
    "purity low (%)", "purity high (%)", "target", "not in the interval", "bin throughput (kg/h)",
    "share without collisions (%)", "share without collisions low (%)", "share without collisions high (%)",
)  # fmt: skip
BUDGET_COLUMNS = ("quantity", "source", "error", "unit of error", "run time (s)", "how")
IMPACT_COLUMNS = (  # normal: into the slope; tangential: down it; power: from the vibration to the stream
    "fraction", "slope", "mass flow (kg/h)", "fall speed (m/s)", "normal force (N)", "tangential force (N)",
    "power (W)", "speed after, x (m/s)", "speed after, y (m/s)",
)  # fmt: skip
ALL = "all"  # in a table of impacts: all fractions, or all slopes
SLOPES = 6  # of a body with more of them only all together are shown
HOUR = 3600.0  # s


def separation_cells(result: Result, separation: Separation) -> CellTable:
    """One row a fraction and bin: percent, kg/h; None where a bin stays empty and has no purity, and where granules met
    no others anyway.
    """
    rows: list[list[Cell]] = []
    alone = None if result.landings is None else result.landings.without_collisions
    lacking = {
        row.quantity: "; ".join(part.source for part in row.parts if part.error is None) for row in result.budget
    }
    for name, places in separation.fractions.items():
        for place, share in places.items():
            pure = (separation.purity.get(place) or {}).get(name)
            numbers = [*_ends(share), _percent(share.numerical), *_ends(pure)]
            missing = lacking.get(f"share.{name}.{place}", "")
            flow, single = separation.throughput[place], None if alone is None else alone.fractions[name][place]
            rows.append([name, place, *numbers, place in result.targets(name), missing, flow, *_ends(single)])
    return CellTable(SEPARATION_COLUMNS, rows)


def _ends(number: Number | None) -> list[Cell]:
    """A number and its interval in percent."""
    return [None] * 3 if number is None else [_percent(end) for end in (number.value, *number.ends)]


def _percent(number: float | None) -> Cell:
    return None if number is None else 100.0 * number


def budget_cells(budget: Sequence[BudgetRow]) -> CellTable:
    """One row a quantity and source of error, and the total; None where unknown."""
    rows: list[list[Cell]] = []
    for row in budget:
        parts = [(part.source, part.error, part.seconds, part.how) for part in row.parts]
        for source, error, seconds, how in [*parts, ("total", row.total.error, row.total.seconds, "")]:
            rows.append([row.quantity, source, error, row.measure, seconds, how])
    return CellTable(BUDGET_COLUMNS, rows)


def impact_cells(result: Result) -> CellTable:
    """One row a fraction and slope, then all fractions together; of a body with many slopes one row for all of them.
    No rows where no granule falls on a body.
    """
    rows: list[list[Cell]] = []
    impact = None if result.flights is None else result.flights.impact
    if impact is not None and impact.total.mass_flow:
        whole = len(impact.slopes) > SLOPES
        for name, fraction in impact.fractions.items():
            streams = {ALL: fraction.total} if whole else fraction.slopes
            rows += [_impact(name, slope, forces.fall_speed, forces) for slope, forces in streams.items()]
        slopes = {ALL: impact.total} if whole else impact.slopes
        rows += [_impact(ALL, slope, None, forces) for slope, forces in slopes.items()]
    return CellTable(IMPACT_COLUMNS, [row for row in rows if row[IMPACT_COLUMNS.index("mass flow (kg/h)")]])


def _impact(name: str, slope: str, fall_speed: float | None, forces: ImpactForces) -> list[Cell]:
    numbers = [fall_speed, forces.normal, forces.tangential, forces.power, *(forces.velocity or (None, None))]
    return [name, slope, HOUR * forces.mass_flow, *numbers]


def write_tables(folder: Path, result: Result) -> None:
    """Write separation.csv, budget.csv and impact.csv of what a result holds: percent, kg/h, empty where unknown."""
    if result.landings is not None:
        separation_cells(result, result.landings.separation).write_csv(folder / "separation.csv")
        budget_cells(result.landings.budget).write_csv(folder / "budget.csv")
    impacts = impact_cells(result)
    if impacts.rows:
        impacts.write_csv(folder / "impact.csv")


# -- in words ----------------------------------------------------------------------------------------------------------


class BinWords(NamedTuple):
    """A bin in words: each fraction's share and whether it should land there, the throughput, whose purity matters."""

    place: str
    shares: list[tuple[str, bool]]
    flow: str
    purities: list[tuple[str, str]]


def bins_in_words(result: Result, separation: Separation) -> Iterator[BinWords]:
    """The shares of every bin, percent with 95 % interval, and the purity of what lies there, its dirt behind it; the
    recoveries, and what is lost, last.
    """
    void, names = result.void, separation.fractions
    for place in separation.bins:
        shares = [(percent(places[place], void=void), place in result.targets(name)) for name, places in names.items()]
        pure = [(name, percent(number, void=void)) for name, number in expected(result, place)]
        if (dirt := separation.dirt.get(place)) is not None:
            pure.append(("dirt", percent(dirt, void=void)))
        flow = VOID if void else f"{separation.throughput[place]:.3g}"
        yield BinWords(place, shares, flow, pure or [("", NO_VALUE)])
    for head, numbers in (("recovery", separation.recovery), ("loss", separation.loss)):
        yield BinWords(head, [(percent(numbers.get(name), void=void), False) for name in names], "", [])
    lost = [(rate_words(separation.lost.get(name), void=void).removesuffix(" kg/h"), False) for name in names]
    yield BinWords("loss, kg/h", lost, "", [])


SUMMED = 3  # rows of :func:`bins_in_words` below the bins
