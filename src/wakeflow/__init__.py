"""wakeflow predicts where each fraction of granules lands behind a body in a vertical airflow.

Public names are loaded on first use, so that ``import wakeflow`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .core.errors import FoamError, MeshError, ProgramError, SceneError, WakeflowError
    from .field import FlowField
    from .labyrinth import chain
    from .laws.collision import impact
    from .laws.granule_layer import layer, layers
    from .laws.restitution import Restitution
    from .planning.make import make_plan as plan
    from .planning.plan import Plan
    from .report.plot import Result
    from .results.dividers import dividers
    from .runs import run
    from .scene import Scene
    from .searching.designs import Search, search
    from .sweeps.comparison import compare
    from .sweeps.compute import Sweep, sweep
    from .sweeps.variant import variants
    from .tracking import Body, Collisions, Fate, Granules, Motion, Tracks, track

# The listing is the pipeline: a layer imports only from those before it (held by tests/test_architecture.py).
LAYERS = (
    "core",
    "laws",
    "scene",
    "funnel",
    "planning",
    "meshing",
    "foam",
    "field",
    "tracking",
    "ballistics",
    "injection",
    "pipeline",
    "results",
    "report",
    "refining",
    "runs",
    "sweeps",
    "searching",
    "labyrinth",
    "verify",
    "doctor",
    "terminal",
    "commands",
    "looking",
    "cli",
)

_HOME = {
    "Body": "tracking",
    "Collisions": "tracking",
    "Fate": "tracking",
    "FlowField": "field",
    "FoamError": "core.errors",
    "Granules": "tracking",
    "MeshError": "core.errors",
    "Motion": "tracking",
    "Plan": "planning.plan",
    "ProgramError": "core.errors",
    "Restitution": "laws.restitution",
    "Result": "report.plot",
    "Scene": "scene",
    "SceneError": "core.errors",
    "Search": "searching.designs",
    "Sweep": "sweeps.compute",
    "Tracks": "tracking",
    "WakeflowError": "core.errors",
    "chain": "labyrinth",
    "compare": "sweeps.comparison",
    "dividers": "results.dividers",
    "impact": "laws.collision",
    "layer": "laws.granule_layer",
    "layers": "laws.granule_layer",
    "plan": "planning.make:make_plan",
    "run": "runs",
    "search": "searching.designs",
    "sweep": "sweeps.compute",
    "track": "tracking",
    "variants": "sweeps.variant",
}

__all__ = [
    "Body", "Collisions", "Fate", "FlowField", "FoamError", "Granules", "MeshError", "Motion", "Plan",
    "ProgramError", "Restitution", "Result", "Scene", "SceneError", "Search", "Sweep", "Tracks", "WakeflowError",
    "chain", "compare", "dividers", "impact", "layer", "layers", "plan", "run", "search", "sweep", "track", "variants",
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
