"""How far a run is, and who is told: a terminal, a log, the cell of a notebook."""

from __future__ import annotations

from .live import Told, live
from .notebook import heard, unheard
from .pace import RunProgress

__all__ = ["RunProgress", "Told", "heard", "live", "unheard"]
