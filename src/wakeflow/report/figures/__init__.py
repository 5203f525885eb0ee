"""The standard figures of a report: a module each, registered under its own name, which is the picture's too.

The names stand in ``scene.pictures.STANDARD_FIGURES``, in the order of the page, since no [picture.NAME] of a scene may
take one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ...scene.pictures import STANDARD_FIGURES
from ..canvas import saved
from .figure import Figure, figures

if TYPE_CHECKING:
    from ..outcome import Outcome

__all__ = ["Figure", "captions", "draw_figures", "figure_files", "figures", "lasting_figures"]

for _name in STANDARD_FIGURES:
    import_module(f".{_name}", __name__)


def draw_figures(folder: Path, outcome: Outcome) -> None:
    """Draw every figure whose needs the run meets, as NAME.png and .svg into ``folder``, its data beside it."""
    for name in figures:
        needs = figures[name].needs
        if needs is None or needs(outcome):
            figures[name].draw(folder / f"{name}.png", outcome)


def figure_files(folder: Path) -> list[Path]:
    """What stands in ``folder`` of all that :func:`draw_figures` may write there."""
    return [file for name in figures for file in saved(folder / f"{name}.png")]


def lasting_figures() -> Iterator[str]:
    """Files that each finished report has in its folder ``figures``."""
    return (f"{name}.png" for name in figures if figures[name].always)


def captions() -> dict[str, str]:
    """What each figure shows, by its name."""
    return {name: figures[name].caption for name in figures}
