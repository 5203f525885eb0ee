"""The air on triangles, steady or in time: what the tracker flies through."""

from __future__ import annotations

from .flow import Divergence, FlowField, Swing, Truncation

__all__ = ["Divergence", "FlowField", "Swing", "Truncation"]
