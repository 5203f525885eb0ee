"""The materials of granules: all in a table, one with all that is known of it, a file to fill in with one's own.

Comes in: the shipped materials, or a file of a user's. Goes out: tables on a screen, a commented file.
May call it: the command line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from ..core.errors import SceneError
from ..laws.material import Material, default_margins

NONE = "–"
RANGE = 2.0  # standard deviations: 95 % of the granules lie within
NOTE = (
    "+-: from granule to granule, 95 % within. Trust: of size and terminal velocity.\n"
    "Sources: wakeflow materials NAME. Your own: materials = 'mine.toml' in a scene."
)


QUANTITIES = ("terminal_velocity", "restitution", "friction", "rebound_scatter", "tangential_restitution", "impact")
UNITS = {"terminal_velocity": "m/s", "rebound_scatter": "rad", "density": "kg/m3"}  # of those that are no plain numbers


def _print_all(known: Mapping[str, Material]) -> None:
    """Print a row for each material."""

    from ..show.screen import print_table

    rows = [
        [
            name, f"{1e3 * material.diameter:.3g}", f"{material.density:.4g}", _within(material, "terminal_velocity"),
            _within(material, "restitution"), _within(material, "friction"), material.confidence,
        ]
        for name, material in known.items()
    ]  # fmt: skip
    heads = ("material", "mm", "kg/m3", "falls at, m/s", "restitution", "friction", "trust")
    print_table(heads, rows, caption=NOTE, whole=True)


def _print_material(name: str, material: Material) -> None:
    """Print every value of a material, how well a lot's mean is taken to be known, how far to trust it, its source."""
    from rich.console import Console
    from rich.padding import Padding

    from ..show.screen import plain

    console = Console()
    for line, source in _values(name, material):
        console.print(plain(line), style="bold")
        console.print(Padding(plain(source), (0, 0, 0, 4)))


def _values(name: str, material: Material) -> Iterator[tuple[str, str]]:
    """What is known of each quantity, and its source."""
    size = f"{1e3 * material.diameter:.3g} mm, {material.density:.4g} kg/m3"
    yield f"{name}: {size}; {material.confidence}", material.source
    for quantity in QUANTITIES:
        if quantity in material.evidence:
            known = material.evidence[quantity]
            value = f"{_within(material, quantity)} {UNITS.get(quantity, '')}".strip()
            yield f"{quantity}: {value}{_mean(material, quantity)}; {known.confidence}", known.source
    if material.dimensions:
        known = material.evidence["dimensions"]
        sides = " x ".join(f"{1e3 * side:.3g}" for side in material.dimensions)
        yield f"dimensions: {sides} mm; {known.confidence}", known.source
    if material.moisture is not None:
        for key, ends in material.moisture.ends.items():
            unit, scale = ("mm", 1e3) if key == "diameter" else (UNITS.get(key, ""), 1.0)
            pairs = zip(ends, material.moisture.share, strict=True)
            values = ", ".join(f"{scale * value:.4g} {unit}".strip() + f" at {100 * wet:.3g}%" for value, wet in pairs)
            yield f"{key} by moisture: {values}", material.moisture.source


def _within(material: Material, name: str) -> str:
    """A value with the range in which 95 % of the granules lie."""
    value, std = getattr(material, name), getattr(material, f"{name}_std", 0.0)
    if not isinstance(value, int | float):
        return NONE if value is None else str(value)
    return f"{value:.3g} +- {RANGE * std:.2g}" if std else f"{value:.3g}"


def _mean(material: Material, quantity: str) -> str:
    """Half of the 95 % interval of a lot's mean, where a scene says nothing better; empty where it has none."""
    value, margin = getattr(material, quantity), default_margins().get(quantity)
    if margin is None or not isinstance(value, int | float):
        return ""
    half = material.half_of(quantity, margin.half(float(value), material.evidence[quantity].confidence, 0.0))
    return f" (a lot's mean: +- {half:.2g})"


def materials(name: str | None = None, *, file: Path | None = None, new: Path | None = None) -> None:
    """List the materials of granules; of one NAME every value with its range, source and how far to trust it.

    A file of your own, written alike, is named in a scene: materials = "mine.toml".

    Parameters
    ----------
    name
        A material; default all.
    file
        List those of your own in this file.
    new
        Write a commented file with a material of your own there, to fill in.
    """
    from ..laws.material import materials as shipped
    from ..laws.material import near_material, write_own_material
    from ..scene.user_files import read_materials

    if new is not None:
        write_own_material(new)
        print(f'{new} written; fill it in, and name it in a scene: materials = "{new.name}"')
        return
    known = {kind: shipped[kind] for kind in shipped} if file is None else read_materials(file)
    if name is None:
        _print_all(known)
    elif name in known:
        _print_material(name, known[name])
    else:
        raise SceneError(f"unknown material {name!r}{near_material(name, list(known))} (known: {', '.join(known)})")


COMMANDS = (f"{__name__}:materials",)
