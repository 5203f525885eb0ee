"""The CSV files of a result; their columns carry units. Shares are of a fraction's mass, purities of a bin's mass."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ..core.files import atomic_write
from ..injection.impact_loads import FractionImpact, ImpactForces, ImpactSummary
from ..results.landing_results import BudgetRow, Separation
from ..results.result import Result

__all__ = [
    "BUDGET_COLUMNS",
    "IMPACT_COLUMNS",
    "SEPARATION_COLUMNS",
    "budget_cells",
    "impact_cells",
    "separation_cells",
    "write_tables",
]

Cell = str | float | bool | None
Row = dict[str, Cell]
SEPARATION_COLUMNS = (  # low and high: the 95 % interval, of which computing alone makes a part
    "fraction",
    "bin",
    "share (%)",
    "share low (%)",
    "share high (%)",
    "share by computing alone (+- %)",
    "purity (%)",
    "purity low (%)",
    "purity high (%)",
    "target",
    "not in the interval",
    "bin throughput (kg/h)",
    "share without collisions (%)",
    "share without collisions low (%)",
    "share without collisions high (%)",
)
BUDGET_COLUMNS = ("quantity", "source", "error", "unit of error", "run time (s)", "how")
IMPACT_COLUMNS = (  # normal: into the slope; tangential: down it; power: from the vibration to the stream
    "fraction",
    "slope",
    "mass flow (kg/h)",
    "fall speed (m/s)",
    "normal force (N)",
    "tangential force (N)",
    "power (W)",
    "speed after, x (m/s)",
    "speed after, y (m/s)",
)
ALL = "all"  # in a table of impacts: all fractions, or all slopes
SLOPES = 6  # of a body with more of them only all together are shown
HOUR = 3600.0  # s


def separation_cells(result: Result, separation: Separation) -> list[Row]:
    """One row a fraction and bin, keys as SEPARATION_COLUMNS; None where a bin stays empty and has no purity, and where
    granules met no others anyway.
    """
    rows: list[Row] = []
    alone = None if result.landings is None else result.landings.without_collisions
    lacking = {
        row.quantity: "; ".join(part.source for part in row.parts if part.error is None) for row in result.budget
    }
    for name, places in separation.fractions.items():
        for place, share in places.items():
            pure = (separation.purity.get(place) or {}).get(name)
            values: list[float | None] = [share.value, share.low, share.high, share.numerical]
            values += [None] * 3 if pure is None else [*pure]
            numbers = [None if value is None else 100.0 * value for value in values]
            wanted = place in result.targets(name)
            single = None if alone is None else alone.fractions[name][place]
            beside = [None] * 3 if single is None else [100.0 * x for x in single]
            missing = lacking.get(f"share.{name}.{place}", "")
            cells: list[Cell] = [name, place, *numbers, wanted, missing, separation.throughput[place], *beside]
            rows.append(dict(zip(SEPARATION_COLUMNS, cells, strict=True)))
    return rows


def budget_cells(budget: Sequence[BudgetRow]) -> list[Row]:
    """One row a quantity and source of error, keys as BUDGET_COLUMNS, and the total; None where unknown."""
    rows: list[Row] = []
    for row in budget:
        parts = [(part.source, part.error, part.seconds, part.how) for part in row.parts]
        for source, error, seconds, how in [*parts, ("total", row.total.error, row.total.seconds, "")]:
            cells: list[Cell] = [row.quantity, source, error, row.measure, seconds, how]
            rows.append(dict(zip(BUDGET_COLUMNS, cells, strict=True)))
    return rows


def impact_cells(impact: ImpactSummary | None) -> list[Row]:
    """One row a fraction and slope, keys as IMPACT_COLUMNS, then all fractions together; of a body with many slopes one
    row for all of them. Nothing where no granule falls on a body.
    """
    if impact is None or not impact.total.mass_flow:
        return []
    whole = len(impact.slopes) > SLOPES
    rows: list[Row] = []
    for name, fraction in impact.fractions.items():
        rows += [_impact(name, slope, speed, forces) for slope, speed, forces in _streams(fraction, whole)]
    slopes = {ALL: impact.total} if whole else impact.slopes
    rows += [_impact(ALL, slope, None, forces) for slope, forces in slopes.items()]
    return [row for row in rows if row["mass flow (kg/h)"]]


def _streams(fraction: FractionImpact, whole: bool) -> Iterable[tuple[str, float | None, ImpactForces]]:
    """A fraction's stream on every slope, or on all together where ``whole``: name, fall speed (m/s) and forces."""
    found = {ALL: fraction.total} if whole else fraction.slopes
    return ((slope, stream.fall_speed, stream) for slope, stream in found.items())


def _impact(name: str, slope: str, fall_speed: float | None, forces: ImpactForces) -> Row:
    after = forces.velocity or (None, None)
    numbers = [fall_speed, forces.normal, forces.tangential, forces.power, *after]
    return dict(zip(IMPACT_COLUMNS, [name, slope, HOUR * forces.mass_flow, *numbers], strict=True))


def write_tables(folder: Path, result: Result) -> None:
    """Write separation.csv, budget.csv and impact.csv of what a result holds: percent, kg/h, empty where unknown."""
    if result.landings is not None:
        rows = separation_cells(result, result.landings.separation)
        _write(folder / "separation.csv", SEPARATION_COLUMNS, rows)
        _write(folder / "budget.csv", BUDGET_COLUMNS, budget_cells(result.landings.budget))
    impacts = impact_cells(None if result.flights is None else result.flights.impact)
    if impacts:
        _write(folder / "impact.csv", IMPACT_COLUMNS, impacts)


def _write(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Cell]]) -> None:
    with atomic_write(path) as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _text(value) for key, value in row.items()} for row in rows)


def _text(value: Cell) -> str | float:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.10g}" if isinstance(value, float) else value
