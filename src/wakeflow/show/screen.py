"""What all that is printed on a screen shares: tables, lines, warnings."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from ..core.graded import Grade

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from .words import WordTable


MAX_WARNINGS = 3  # on screen; the rest is in the report


def plain(words: str | Text, style: str = "") -> Text:
    """Words as they are, whoever chose them: brackets are no markup, :smile: is no picture, control characters are as
    Python writes them.
    """
    from rich.text import Text

    if isinstance(words, Text):
        return words
    shown = (letter if letter.isprintable() or letter == "\n" else repr(letter)[1:-1] for letter in words)
    return Text("".join(shown), style)


def screen_table(
    heads: Sequence[str], rows: Iterable[Sequence[str | Text]], title: str = "", caption: str = "", *, left: int = 1,
    whole: bool = False,
) -> Table:  # fmt: skip
    """A table whose first columns, ``left`` of them, lean to the left and the others to the right; an empty one
    among the ``rows`` of words draws a line. ``whole``: no cell is broken into lines.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=plain(title, "table.title") if title else None, title_justify="left",
        caption=plain(caption, "table.caption") if caption else None, caption_justify="left",
        pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD,
    )  # fmt: skip
    for place, head in enumerate(heads):
        table.add_column(plain(head), justify="left" if place < left else "right", overflow="fold", no_wrap=whole)
    for row in rows:
        if row:
            table.add_row(*map(plain, row))
        else:
            table.add_section()
    return table


def print_table(
    heads: Sequence[str], rows: Iterable[Sequence[str | Text]], title: str = "", caption: str = "", *, left: int = 1,
    whole: bool = False,
) -> None:  # fmt: skip
    """Print a :func:`screen_table`."""
    from rich.console import Console

    Console().print(screen_table(heads, rows, title, caption, left=left, whole=whole), highlight=False)


def print_parts(parts: Iterable[str | WordTable]) -> None:
    """Print texts, broken into lines as wide as the screen, and tables."""
    from rich.console import Console

    console = Console()
    for part in parts:
        console.print(plain(part) if isinstance(part, str) else screen_table(*part[:4], left=part.left))


def print_lines(lines: Iterable[str], style: str = "") -> None:
    """Print lines as they are, however long."""
    from rich.console import Console

    console = Console()
    for line in lines:
        console.print(plain(line), soft_wrap=True, style=style)


def print_pairs(pairs: Iterable[tuple[str, str]]) -> None:
    """Print labels, and beside them their texts, in lines as long as the screen is wide."""
    from rich.console import Console
    from rich.table import Table

    lines = Table.grid(padding=(0, 2))
    lines.add_column(style="bold", no_wrap=True)
    lines.add_column()
    for label, text in pairs:
        lines.add_row(label, plain(text))
    Console().print(lines, highlight=False)


def warn(warnings: Sequence[str], grades: Sequence[str], most: int = MAX_WARNINGS) -> None:
    """Print the gravest warnings with their grades, at ``most`` so many, and how many more there are."""
    from rich.console import Console

    console = Console()
    for line, grade in list(zip(warnings, grades, strict=True))[:most]:
        style = "bold red" if grade == Grade.VOID.value else "yellow" if grade == Grade.LESS_SURE.value else ""
        console.print(plain(f"! {grade}: {line}"), style=style)
    if len(warnings) > most:
        console.print(f"! and {len(warnings) - most} more: report.html, or --json", highlight=False)


def counted(number: int, what: str) -> str:
    """``"2 scenes"``: so many of something."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def has_screen() -> bool:
    """Whether a window can be shown: a variable names a screen."""
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
