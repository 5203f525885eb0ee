"""The air on triangles, steady or in time: what the tracker flies through.

Comes in: arrays at nodes. Goes out: a FlowField, and others made of it: blended, mirrored, as a mean and modes.
May call it: a user (``wf.FlowField``), every room after it.
"""

from __future__ import annotations

from .combined import blended_wake, interpolated
from .flow import EMPTY, FlowField
from .modes import AT_REST, MeshOscillation, Truncation
from .triangles import Divergence

__all__ = [
    "AT_REST", "EMPTY", "Divergence", "FlowField", "MeshOscillation", "Truncation", "blended_wake", "interpolated",
]  # fmt: skip
