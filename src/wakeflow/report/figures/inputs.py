"""The standard figure of what to measure next: a tornado for each fraction's least certain share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...results.sensitivity import grouped, least_sure, regressed_moves
from ..tornado import draw_tornado
from .figure import Figure, figures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..canvas import Paper
    from ..outcome import Outcome

__all__: list[str] = []


def _known(outcome: Outcome) -> bool:
    return bool(regressed_moves(outcome.result.landings))


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    moves = grouped(regressed_moves(outcome.result.landings))
    return draw_tornado(paper, {name: moves[name] for name in least_sure(moves)})


figures.add(
    "inputs",
    Figure("What to measure next: what each number that is not known exactly moves a share by.", _draw, _known),
)
