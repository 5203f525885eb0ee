"""Materials on a screen: all in a table, or one with every value, its range, its source and how far to trust it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ..laws.material import Material
from ..laws.uncertainties import default_margins

__all__ = ["show_material", "show_materials"]

NONE = "–"
RANGE = 2.0  # standard deviations: 95 % of the granules lie within
NOTE = (
    "+-: from granule to granule, 95 % within. Trust: of size and terminal velocity.\n"
    "Sources: wakeflow materials NAME. Your own: materials = 'mine.toml' in a scene."
)


class _Quantity(NamedTuple):
    """A quantity of a material: its name in scenes, and its unit."""

    name: str
    unit: str


QUANTITIES = (
    _Quantity("terminal_velocity", "m/s"),
    _Quantity("restitution", ""),
    _Quantity("friction", ""),
    _Quantity("rebound_scatter", "rad"),
    _Quantity("tangential_restitution", ""),
    _Quantity("impact", ""),
)


def show_materials(known: Mapping[str, Material]) -> None:
    """Print a row for each material."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD, caption=NOTE, caption_justify="left")
    table.add_column("material", no_wrap=True)
    for heading in ("mm", "kg/m3", "falls at, m/s", "restitution", "friction"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("trust", no_wrap=True)
    for name, one in known.items():
        table.add_row(
            name, f"{1e3 * one.diameter:.3g}", f"{one.density:.4g}", _within(one, "terminal_velocity"),
            _within(one, "restitution"), _within(one, "friction"), one.confidence,
        )  # fmt: skip
    Console().print(table, highlight=False)


def show_material(name: str, one: Material) -> None:
    """Print every value of a material, how well a lot's mean is taken to be known, how far to trust it, its source."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console()
    for told, source in _values(name, one):
        console.print(told, highlight=False, markup=False, style="bold")
        console.print(Padding(Text(source), (0, 0, 0, 4)))


def _values(name: str, one: Material) -> Iterator[tuple[str, str]]:
    """What is known of each quantity, and its source."""
    yield f"{name}: {1e3 * one.diameter:.3g} mm, {one.density:.4g} kg/m3; {one.confidence}", one.source
    for quantity in QUANTITIES:
        if quantity.name in one.evidence:
            known = one.evidence[quantity.name]
            value = f"{_within(one, quantity.name)} {quantity.unit}".strip()
            yield f"{quantity.name}: {value}{_mean(one, quantity)}; {known.confidence}", known.source
    if one.moisture is not None:
        ends = zip(one.moisture.share, one.moisture.terminal_velocity, strict=True)
        told = ", ".join(f"{speed:.3g} m/s at {share:.0%}" for share, speed in ends)
        yield f"terminal_velocity by moisture: {told}", one.moisture.source


def _within(one: Material, name: str) -> str:
    """A value with the range in which 95 % of the granules lie."""
    value, std = getattr(one, name), getattr(one, f"{name}_std", 0.0)
    if not isinstance(value, int | float):
        return NONE if value is None else str(value)
    return f"{value:.3g} +- {RANGE * std:.2g}" if std else f"{value:.3g}"


def _mean(one: Material, quantity: _Quantity) -> str:
    """Half of the 95 % interval of a lot's mean, where a scene says nothing better; empty where it has none."""
    value, margin = getattr(one, quantity.name), default_margins().get(quantity.name)
    if margin is None or not isinstance(value, int | float):
        return ""
    half = margin.half(float(value), one.evidence[quantity.name].confidence, 0.0)
    return f" (a lot's mean: +- {half:.2g})"
