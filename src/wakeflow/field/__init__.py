"""The air on triangles, steady or in time: what the tracker flies through."""

from __future__ import annotations

from .blend import blended_wake, interpolated
from .divergence import Divergence
from .flow import FlowField
from .modes import Truncation
from .swing import Swing

__all__ = ["Divergence", "FlowField", "Swing", "Truncation", "blended_wake", "interpolated"]
