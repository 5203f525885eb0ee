"""What is at hand, on a screen: materials, all in a table or one with all that is known of it; stages in the cache."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime

from ..core.quantities import duration
from ..core.store import KeptStage
from ..laws.material import Material, default_margins
from .screen import plain, screen_table

NONE = "–"
MAX_ROWS = 50  # of the cache
RANGE = 2.0  # standard deviations: 95 % of the granules lie within
NOTE = (
    "+-: from granule to granule, 95 % within. Trust: of size and terminal velocity.\n"
    "Sources: wakeflow materials NAME. Your own: materials = 'mine.toml' in a scene."
)


QUANTITIES = ("terminal_velocity", "restitution", "friction", "rebound_scatter", "tangential_restitution", "impact")
UNITS = {"terminal_velocity": "m/s", "rebound_scatter": "rad", "density": "kg/m3"}  # of those that are no plain numbers


def show_materials(known: Mapping[str, Material]) -> None:
    """Print a row for each material."""
    from rich.console import Console

    rows = [
        [
            name, f"{1e3 * one.diameter:.3g}", f"{one.density:.4g}", _within(one, "terminal_velocity"),
            _within(one, "restitution"), _within(one, "friction"), one.confidence,
        ]
        for name, one in known.items()
    ]  # fmt: skip
    heads = ("material", "mm", "kg/m3", "falls at, m/s", "restitution", "friction", "trust")
    Console().print(screen_table(heads, rows, caption=NOTE, whole=True), highlight=False)


def show_material(name: str, one: Material) -> None:
    """Print every value of a material, how well a lot's mean is taken to be known, how far to trust it, its source."""
    from rich.console import Console
    from rich.padding import Padding

    console = Console()
    for told, source in _values(name, one):
        console.print(plain(told), style="bold")
        console.print(Padding(plain(source), (0, 0, 0, 4)))


def _values(name: str, one: Material) -> Iterator[tuple[str, str]]:
    """What is known of each quantity, and its source."""
    yield f"{name}: {1e3 * one.diameter:.3g} mm, {one.density:.4g} kg/m3; {one.confidence}", one.source
    for quantity in QUANTITIES:
        if quantity in one.evidence:
            known = one.evidence[quantity]
            value = f"{_within(one, quantity)} {UNITS.get(quantity, '')}".strip()
            yield f"{quantity}: {value}{_mean(one, quantity)}; {known.confidence}", known.source
    if one.dimensions is not None:
        known = one.evidence["dimensions"]
        sides = " x ".join(f"{1e3 * side:.3g}" for side in one.dimensions)
        yield f"dimensions: {sides} mm; {known.confidence}", known.source
    if one.moisture is not None:
        for key, ends in one.moisture.ends.items():
            unit, scale = ("mm", 1e3) if key == "diameter" else (UNITS.get(key, ""), 1.0)
            pairs = zip(ends, one.moisture.share, strict=True)
            told = ", ".join(f"{scale * value:.4g} {unit}".strip() + f" at {100 * wet:.3g}%" for value, wet in pairs)
            yield f"{key} by moisture: {told}", one.moisture.source


def _within(one: Material, name: str) -> str:
    """A value with the range in which 95 % of the granules lie."""
    value, std = getattr(one, name), getattr(one, f"{name}_std", 0.0)
    if not isinstance(value, int | float):
        return NONE if value is None else str(value)
    return f"{value:.3g} +- {RANGE * std:.2g}" if std else f"{value:.3g}"


def _mean(one: Material, quantity: str) -> str:
    """Half of the 95 % interval of a lot's mean, where a scene says nothing better; empty where it has none."""
    value, margin = getattr(one, quantity), default_margins().get(quantity)
    if margin is None or not isinstance(value, int | float):
        return ""
    own = one.half_of(quantity)
    half = margin.half(float(value), one.evidence[quantity].confidence, 0.0) if own is None else own
    return f" (a lot's mean: +- {half:.2g})"


def show_removed(stages: Sequence[KeptStage], *, done: bool) -> None:
    """Say in one line what was or would be removed from the cache, and what making it again would take."""
    size, spent = sum(one.size for one in stages) / 1e6, sum(one.seconds or 0.0 for one in stages)
    verb, frees = ("removed", "freed") if done else ("would be removed", "would be freed")
    print(f"{len(stages)} stages {verb}, {size:.1f} MB {frees}, {duration(spent)} to make again")


def show_stages(stages: Sequence[KeptStage], title: str = "in the cache") -> None:
    """Print stages of the cache, the one that was used longest ago first: size, time to make it again."""
    from rich.console import Console

    def sums(used: str, what: str, part: Sequence[KeptStage]) -> list[str]:
        size, spent = sum(one.size for one in part), sum(one.seconds or 0.0 for one in part)
        return [used, f"{len(part)} {what}", "", f"{size / 1e6:.1f}", duration(spent)]

    rows: list[list[str]] = []
    for one in stages[:MAX_ROWS]:
        used = datetime.fromtimestamp(one.used, UTC).astimezone().strftime("%Y-%m-%d %H:%M")
        again = NONE if one.seconds is None else duration(one.seconds)
        key = one.folder.name[:12] + ("" if one.finished else " unfinished")
        rows.append([used, one.stage, key, f"{one.size / 1e6:.1f}", again])
    if len(stages) > MAX_ROWS:
        rows.append(sums("later", "more", stages[MAX_ROWS:]))
    heads = ("used", "stage", "key", "MB", "to make again")
    Console().print(screen_table(heads, [*rows, [], sums("all", "stages", stages)], title, left=3))
