"""The sketch of the machine: what was asked, to scale, with its measures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..canvas import save
from ..sketch import draw_sketch
from .figure import Figure, figures

if TYPE_CHECKING:
    from ..outcome import Outcome


def _draw(path: Path, outcome: Outcome) -> None:
    save(draw_sketch(outcome.scene), path)


figures.add("sketch", Figure("The machine to scale, with its measures.", _draw, always=True))
