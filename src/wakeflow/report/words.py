"""The numbers of a result as words and tables: CSV, the page, the screen and notebooks take theirs here.

Shares are of a fraction's mass, purities of a bin's mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..answer.measurements import Purchase, worth_measuring
from ..answer.result import VOID
from ..answer.shares import LEFT_OUT, NOT_COMPUTED, SHARE_UNIT, BudgetPart, BudgetRow
from ..budget.agreement import agreement_in, measured_in
from ..budget.total import remedies
from ..core.number import Number
from ..core.quantities import say, speaking
from ..core.tables import Cell, CellTable

if TYPE_CHECKING:
    from ..answer.result import Result
    from ..answer.shares import LandingResults, Separation
    from ..answer.table import Difference
    from ..injection.impact_loads import ImpactForces, ImpactSummary


# -- The numbers of a result as words ----------------------------------------------------------------------------------
NO_VALUE = "–"
OF_WHAT = "what the scene does not say exactly, granules, {}, terms left out"
UNPROVEN = "No measurement of granules validates this machine."
UNKNOWN_ERROR = "unknown"
TERMS = {LEFT_OUT: "terms left out", NOT_COMPUTED: "terms not computed"}  # a column of the budget for each kind of term
MAX_DIGITS = 4  # after the point of a percentage, however narrow its interval
COARSE = 2.5  # percentage points: an arm of an interval from which on a percentage has no decimals
UNKNOWN_SPAN = 0.5  # of a purity: an interval from which on nothing is known of it
ROUGH = 0.1  # an error of a share from which percentage points are written without decimals


def percent(number: Number | None, *, void: bool = False) -> str:
    """``"62.1 (61.3 to 62.9)"`` from a measured number in 0..1: percent and its 95 % interval; a dash for none,
    and ``"void"`` for a number of an answer that is worth nothing.

    The number of decimals follows the shorter arm of the interval that is not zero, so that both arms are seen.
    """
    if number is None or not math.isfinite(number.value):
        return NO_VALUE
    if void:
        return VOID
    if not number.known:
        return f"{100 * number.value:.1f}"
    arms = [100.0 * arm for arm in (number.value - number.low, number.high - number.value) if arm > 0.0]
    digits = -math.floor(math.log10(min(arms) / COARSE)) if arms else 1
    digits = min(MAX_DIGITS, max(0, digits))
    value, low, high = (_whole(f"{100 * one:.{digits}f}") for one in number)
    return f"{value} ({low} to {high})"


def _whole(text: str) -> str:
    """None and all of a whole without decimals."""
    return f"{float(text):.0f}" if float(text) in (0.0, 100.0) else text


def purity(number: Number | None, *, void: bool = False) -> str:
    """A purity as :func:`percent`; ``"unknown (0 to 50)"`` where its interval spans half of all that it could be."""
    told = percent(number, void=void)
    wide = number is not None and number.known and round(number.high - number.low, 2) >= UNKNOWN_SPAN
    return f"{UNKNOWN_ERROR} {told.partition(' ')[2]}" if wide and not void else told


def part_text(name: str, number: Number | None, *, void: bool = False) -> str:
    """A part of a whole by its ``name`` in tables: purity.BIN.FRACTION as a purity, every other as a share."""
    return (purity if "purity." in name else percent)(number, void=void)


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
    """With what an answer was calibrated, and what the scene says that contradicts it; empty of any other answer."""
    told = result.calibration
    return "" if told is None else f"Calibrated with {told.source}. {told.conflict}".rstrip()


def in_three_dimensions(landings: LandingResults | None) -> str:
    """The shares that were computed in three dimensions for a machine like this one; empty without any."""
    found = {} if landings is None else landings.three_dimensions or {}
    told = [
        f"{name} in {place} {percent(share)} %" for name, places in found.items() for place, share in places.items()
    ]
    about = "this body at this Stokes number, each granule alone; in the interval"
    return f"Three dimensions: {', '.join(told)} ({about})" if told else ""


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


def measured_words(bought: Purchase) -> str:
    """``"the restitution of wheat to +- 0.03 (a drop test)"``."""
    parts = bought.key.split(".")
    what = f"the {parts[2]} of {parts[1]}" if parts[0] == "fraction" else bought.key
    with speaking({"m": "mm", "rad": "deg"}):
        half = say(bought.half, bought.unit, 2)
    return f"{what.replace('_', ' ')} to +- {half} ({bought.method.how})"


def headline(result: Result) -> list[str]:
    """The answer in plain words, a sentence for each fraction that has a target."""
    if result.landings is None:
        return []
    if result.void:
        return [f"This answer is void: {result.why_void}."]
    told, shares = [], result.landings.separation
    for name, number in shares.recovery.items():
        if number is None:
            continue
        places = result.targets(name)
        pure = [(place, (shares.purity.get(place) or {}).get(name)) for place in places]
        known = [(purity(one), place) for place, one in pure if one is not None]
        parts = list(dict.fromkeys(part for part, _ in known))
        of_bin = ""
        if len(parts) == 1 and parts[0].startswith(UNKNOWN_ERROR):
            ends = parts[0].removeprefix(f"{UNKNOWN_ERROR} ").replace(")", " %)")
            of_bin = f"; which part of what lies there is {name} is not known {ends}"
        elif len(parts) == 1:
            of_bin = f"; it makes up {parts[0]} % of what lies there"
        elif known:
            of_bin = f"; it makes up {', '.join(f'{part} % in {place}' for part, place in known)}"
        told.append(f"Of the {name}, {percent(number)} % lands in {' or '.join(places)}{of_bin}.")
    return told


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


def difference_text(one: Difference) -> str:
    """``"+3.1 points (+1.2 to +5)"``: a difference and its 95 % interval; of shares, purities and recoveries percentage
    points, of others in their unit.
    """
    share = one.unit == "1" and not one.quantity.startswith("airflow.")
    scale, unit = (100.0, "points") if share else (1.0, "" if one.unit == "1" else one.unit)
    ends = f" ({scale * one.low:+.3g} to {scale * one.high:+.3g})" if one.known else ""
    return f"{scale * one.value:+.3g} {unit}".rstrip() + ends


def expected(result: Result, place: str) -> list[tuple[str, Number]]:
    """Whose purity matters in a bin: the fractions that have it as target, else the one that makes up most of it."""
    purity = None if result.landings is None else result.landings.separation.purity.get(place)
    if not purity:
        return []
    wanted = [(name, found) for name, found in purity.items() if place in result.targets(name)]
    return wanted or [max(purity.items(), key=lambda item: item[1].value)]


def condensed(budget: Sequence[BudgetRow]) -> list[BudgetRow]:
    """The budget with the terms that are left out added up, parts of unknown size last.

    One part represents the terms that were left out as small enough for the accuracy asked for, one for those that
    could matter and are not computed; their notes name the terms.
    """
    rows = []
    for row in budget:
        parts = [part for part in row.parts if part.kind is None]
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


def _ends(number: Number | None) -> list[float | None]:
    """A number and its interval in percent."""
    return [None] * 3 if number is None else [_percent(one) for one in (number.value, *number.ends)]


def _percent(number: float | None) -> float | None:
    return None if number is None else 100.0 * number


def budget_cells(budget: Sequence[BudgetRow]) -> CellTable:
    """One row a quantity and source of error, and the total; None where unknown."""
    rows: list[list[Cell]] = []
    for row in budget:
        parts = [(part.source, part.error, part.seconds, part.how) for part in row.parts]
        for source, error, seconds, how in [*parts, ("total", row.total.error, row.total.seconds, "")]:
            rows.append([row.quantity, source, error, row.measure, seconds, how])
    return CellTable(BUDGET_COLUMNS, rows)


def impact_cells(impact: ImpactSummary | None) -> CellTable:
    """One row a fraction and slope, then all fractions together; of a body with many slopes one row for all of them.
    No rows where no granule falls on a body.
    """
    rows: list[list[Cell]] = []
    if impact is not None and impact.total.mass_flow:
        whole = len(impact.slopes) > SLOPES
        for name, fraction in impact.fractions.items():
            streams = {ALL: fraction.total} if whole else fraction.slopes
            rows += [_impact(name, slope, one.fall_speed, one) for slope, one in streams.items()]
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
    impacts = impact_cells(None if result.flights is None else result.flights.impact)
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
    """The shares of every bin, percent with 95 % interval; the recoveries last."""
    for place in separation.bins:
        shares = [
            (percent(places[place], void=result.void), place in result.targets(name))
            for name, places in separation.fractions.items()
        ]
        pure = [(name, purity(found, void=result.void)) for name, found in expected(result, place)]
        yield BinWords(place, shares, f"{separation.throughput[place]:.3g}", pure or [("", NO_VALUE)])
    recoveries = [(percent(separation.recovery.get(name), void=result.void), False) for name in separation.fractions]
    yield BinWords("recovery", recoveries, "", [])
