"""The standard figure of what to measure next: a tornado for each fraction's least certain share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...results.sensitivity import grouped, least_sure, regressed_moves
from ..tornado import draw_tornado
from .figure import Figure, figures

if TYPE_CHECKING:
    from ..outcome import Outcome

__all__: list[str] = []


def _known(outcome: Outcome) -> bool:
    return bool(regressed_moves(outcome.result.landings))


def _draw(path: Path, outcome: Outcome) -> None:
    moves = grouped(regressed_moves(outcome.result.landings))
    draw_tornado(path, {name: moves[name] for name in least_sure(moves)})


figures.add(
    "inputs",
    Figure("What to measure next: what each number that is not known exactly moves a share by.", _draw, _known),
)
