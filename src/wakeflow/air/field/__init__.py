"""The air on triangles, steady or in time: what the tracker flies through."""

from __future__ import annotations

from .combined import blended_wake, interpolated
from .flow import FlowField
from .mirror import MeshOscillation
from .modes import Truncation
from .triangles import Divergence

__all__ = ["Divergence", "FlowField", "MeshOscillation", "Truncation", "blended_wake", "interpolated"]
