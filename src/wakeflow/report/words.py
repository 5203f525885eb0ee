"""The numbers of a result as words: what the page and the terminal say of shares, purities and errors alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..answer.shares import LEFT_OUT, NOT_COMPUTED, SHARE_UNIT, BudgetPart, BudgetRow
from ..budget.total import remedies
from ..core.graded import Grade
from ..core.number import Number

if TYPE_CHECKING:
    from ..answer.result import Result
    from ..answer.table import Difference

NO_VALUE = "–"
OF_WHAT = "what the scene does not say exactly, granules, {}, terms left out"
UNPROVEN = "No measurement of granules validates this machine."
UNKNOWN_ERROR = "unknown"
TERMS = {LEFT_OUT: "terms left out", NOT_COMPUTED: "terms not computed"}  # a column of the budget for each kind of term
MOST_DIGITS = 4  # after the point of a percentage, however narrow its interval
ALIKE = 0.25  # of half of an interval: arms that differ by no more are shown as one
ROUGH = 0.1  # an error of a share from which percentage points are written without decimals
ROUGH_POINTS = 100.0 * ROUGH


def percent(number: Number | None) -> str:
    """``"62.1 ± 0.8"`` from a measured number in 0..1: percent and half its 95 % interval, or its two arms where they
    differ, ``"98.2 -3.1 +0.9"``; a dash for none.

    The number of decimals follows the shorter arm, so that it never shows as zero unless it is: two figures from ten
    points on.
    """
    if number is None or not math.isfinite(number.value):
        return NO_VALUE
    if not number.known:
        return f"{100 * number.value:.1f}"
    below, above = 100.0 * (number.value - number.low), 100.0 * (number.high - number.value)
    half, shorter = 0.5 * (below + above), min(below, above)
    alike = max(below, above) - shorter <= ALIKE * half
    least = half if alike or shorter <= 0.0 else shorter
    decimal = 0 if least >= ROUGH_POINTS else 1
    digits = 1 if least <= 0 else min(MOST_DIGITS, max(decimal, -math.floor(math.log10(least))))
    value = f"{100 * number.value:.{digits}f}"
    arms = [f"-{below:.{digits}f}"] * (below > 0.0) + [f"+{above:.{digits}f}"] * (above > 0.0)
    return f"{value} ± {half:.{digits}f}" if alike else " ".join([value, *arms])


def holds(result: Result) -> str:
    """What the intervals of an answer hold, and what they do not."""
    if result.void:
        why = next(
            text for text, grade in zip(result.warnings, result.grades, strict=True) if grade == Grade.VOID.value
        )
        return f"VOID: the answer is worth nothing, whatever its intervals say: {why}."
    of_what = OF_WHAT.format("steps" if result.airflow is None else "sheddings, steps, mesh")
    if not result.lacking:
        mostly = f" {result.caveat.capitalize()}." if result.caveat else ""
        return f"The interval holds 95 %: {of_what}.{mostly} {UNPROVEN}"
    cures = remedies(result.lacking)
    mend = f"; it takes {'; '.join(cures)}" if cures else ""
    return (
        f"The interval lacks {', '.join(result.lacking)}, whose size is not known{mend}. Of the rest it holds 95 %: "
        f"{of_what}. {UNPROVEN}"
    )


def change_of(before: Number | None, after: Number | None) -> str:
    """``"-17.2"``: what a share in 0..1 changes by, in percentage points; a dash where either is not known."""
    if before is None or after is None:
        return NO_VALUE
    return f"{100.0 * (after.value - before.value):+.1f}"


def difference_text(one: Difference) -> str:
    """``"+3.1 points [+1.2, +5]"``: a difference and its 95 % interval; of shares, purities and recoveries percentage
    points, of others in their unit.
    """
    share = one.unit == "1" and not one.quantity.startswith("airflow.")
    scale, unit = (100.0, "points") if share else (1.0, "" if one.unit == "1" else one.unit)
    ends = f" [{scale * one.low:+.3g}, {scale * one.high:+.3g}]" if one.known else ""
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

    One part stands for the terms that were left out as small enough for the accuracy asked for, one for those that
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
