"""Tables of shares: the answer and the answer without collisions, with what to measure next below."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..report.words import NO_VALUE, change_of, expected, holds, percent
from ..results.landing_results import Separation, least_certain

if TYPE_CHECKING:
    from rich.table import Table

    from ..results.result import Result

__all__ = ["alone_table", "measure_next", "separation_table"]

NEXT = "Measure these, and write them as { value = ..., uncertainty = ... }"
NEXT_OF_WAKE = "of wake.*: numerics.rung = '3d'"
TOLD_FROM = 0.1  # part of a share's variance from which an unknown number is told
MOST_TOLD = 4  # numbers that are told under the answer


def separation_table(result: Result, separation: Separation) -> Table:
    """Bins by fractions: shares in percent with half their 95 % interval; throughput, purity, recovery."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    met = result.landings is not None and result.landings.slab is not None
    title = f"{'VOID: ' if result.void else ''}share of each fraction's mass, %{', granules colliding' if met else ''}"
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
        purest = "\n".join(f"{name} {_parted(percent(found))}" for name, found in expected(result, place)) or NO_VALUE
        table.add_row(place, *cells, f"{separation.throughput[place]:.3g}", purest)
    table.add_section()
    table.add_row("recovery", *(percent(separation.recovery.get(name)) for name in separation.fractions), "", "")
    below = [] if result.void else measure_next(result)  # more exact numbers mend no answer that is worth nothing
    table.caption, table.caption_justify = "\n".join([holds(result), *below]), "left"
    return table


def _parted(text: str) -> str:
    """A percentage with its two arms below it, so that columns stay narrow."""
    return text if "±" in text else text.replace(" ", "\n", 1)


def measure_next(result: Result) -> list[str]:
    """For each fraction the numbers of the scene that make most of its least certain share uncertain."""
    told, wake = [], False
    for name, (place, parts) in ({} if result.landings is None else least_certain(result.landings)).items():
        known = [(key, part) for key, part in parts.items() if part.variance >= TOLD_FROM and part.tells][:MOST_TOLD]
        if known:
            inputs = ", ".join(f"{key} {100 * part.half:.2g}" for key, part in known)
            told.append(f"{name} in {place} hangs most on (points each): {inputs}")
            wake |= any(key.startswith("wake.") for key, _ in known)
    return [*told, f"{NEXT}; {NEXT_OF_WAKE}." if wake else f"{NEXT}."] if told else []


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
