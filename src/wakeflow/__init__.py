"""wakeflow predicts where each fraction of granules lands behind a body in a vertical airflow.

Public names are loaded on first use, so that ``import wakeflow`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .cascade import chain
    from .errors import FoamError, MeshError, ProgramError, SceneError, WakeflowError
    from .field import FlowField
    from .laws.collision import impact
    from .laws.layer import layer, layers
    from .laws.restitution import Restitution
    from .planning import make_plan as plan
    from .plans import Plan
    from .runs import Result, run
    from .scene import Scene
    from .tracking import Body, Fate, Granules, Motion, Tracks, track

_HOME = {
    "Body": "tracking",
    "Fate": "tracking",
    "FlowField": "field",
    "FoamError": "errors",
    "Granules": "tracking",
    "MeshError": "errors",
    "Motion": "tracking",
    "Plan": "plans",
    "ProgramError": "errors",
    "Restitution": "laws.restitution",
    "Result": "runs",
    "Scene": "scene",
    "SceneError": "errors",
    "Tracks": "tracking",
    "WakeflowError": "errors",
    "chain": "cascade",
    "impact": "laws.collision",
    "layer": "laws.layer",
    "layers": "laws.layer",
    "plan": "planning:make_plan",
    "run": "runs",
    "track": "tracking",
}

__all__ = [
    "Body", "Fate", "FlowField", "FoamError", "Granules", "MeshError", "Motion", "Plan", "ProgramError",
    "Restitution", "Result", "Scene", "SceneError", "Tracks", "WakeflowError", "chain", "impact", "layer", "layers",
    "plan", "run", "track",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'wakeflow' has no attribute {name!r}")
    module, _, attribute = _HOME[name].partition(":")
    value = getattr(import_module(f".{module}", __name__), attribute or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
