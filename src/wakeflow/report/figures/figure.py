"""A standard figure of the report, as a registered object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...core.registry import Registry

if TYPE_CHECKING:
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["Figure", "figures"]


@dataclass(frozen=True)
class Figure:
    """A picture in the folder ``figures`` and on the page, NAME.png under the name that it is registered by.

    ``caption``: what it shows; ``draw(paper, outcome)`` writes the PNG, the SVG and the data, or draws on the axes or
    in the figure that the paper is, and returns the axes, one or an array; ``needs(outcome)``: whether the run has what
    it shows; ``always``: every finished report has it, so that one without it is drawn again.
    """

    caption: str
    draw: Callable[[Paper, Outcome], Any]
    needs: Callable[[Outcome], bool] | None = None
    always: bool = False


figures: Registry[Figure] = Registry("standard figure")
