"""The standard figures of a report, each registered under its name, which is the picture's too.

The names are in ``scene.pictures.STANDARD_FIGURES``, in the order of the page, since no [picture.NAME] of a scene may
take one of them; the modules here are imported in that order.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from .. import sketch  # noqa: F401
from ..canvas import saved
from ..outcome import AirAndTracks, Figure, figures

__all__ = ["Figure", "captions", "draw_figures", "figure_files", "figures", "lasting_figures"]

for _module in ("air_figures", "flights", "share_figures", "budget_figures", "solver_figures"):
    import_module(f".{_module}", __name__)


def draw_figures(folder: Path, outcome: AirAndTracks, *, of_answer: bool) -> None:
    """Draw every figure ``of_answer``, or of what is there before it, that the run has something for, as NAME.png and
    .svg into ``folder``, its data beside it.
    """
    for name, figure in ((name, figures[name]) for name in figures if figures[name].of_answer == of_answer):
        if parts := figure.parts(outcome):
            figure.draw(folder / f"{name}.png", *parts)


def figure_files(folder: Path) -> list[Path]:
    """What is in ``folder`` of all that :func:`draw_figures` may write there."""
    return [file for name in figures for file in saved(folder / f"{name}.png") if file.exists()]


def lasting_figures() -> Iterator[str]:
    """Files that each finished report has in its folder ``figures``."""
    return (f"{name}.png" for name in figures if figures[name].always)


def captions() -> dict[str, str]:
    """What each figure shows, by its name."""
    return {name: figures[name].caption for name in figures}
