"""Where each fraction of granules lands behind a body in a vertical airflow, with one honest interval.

    import wakeflow as wf
    result = wf.run("machine.toml")                          # or wakeflow run machine.toml
    result.share("wheat", "outer-right")                     # value, low, high: 95 %
    result.plot.tracks()

 1. Scene      what is asked: Scene.load(file), .replace({"air.speed": "7 m/s"}), .save(file)
 2. plan       what a scene needs, what is left out and by which bound, its cost: wf.plan(scene)
 3. run        the answer: wf.run(scene, out=folder, rung="draft"); a second time from the cache
 4. Result     a run: Result.load(folder), .share(), .recovery(), .loss(), .purity(), .dirt(), .frame(), .plot.tracks()
 5. chain      impacts and parabolas without the air, in memory: for a first search
 6. variants   a scene changed along axes: wf.variants(scene, {"air.speed": ["3 m/s", "4 m/s"]})
 7. sweep      many scenes, each stage once, one table: wf.sweep(variants), .frame(), .plot(quantity, over)
 8. compare    finished runs side by side, and what differs
 9. dividers   where bins should end for a purity, from the landings of a finished run
10. search     the best design for goals, limits and a budget

A scene is a Scene or the path of its file everywhere. ``wakeflow new rhombus machine.toml`` writes one to start from;
docs/tutorial.md goes from there to a report in ten steps. What cannot be done is a WakeflowError, in one line. Below
these stand the parts: track, FlowField, Granules and Body; impact, layer and layers.

The rest of help() is the reference: every class and function with its options, units and errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .core.lazy import loaded

if TYPE_CHECKING:
    from .air.field import FlowField
    from .core.errors import FoamError, MeshError, ProgramError, SceneError, WakeflowError
    from .extras.dividers.dividers import dividers
    from .extras.search.designs import Search, search
    from .extras.studies.sensitivity import Sensitivity, sensitivity
    from .extras.trays.calibration import Posterior, calibrate
    from .flight import Body, Collisions, Fate, Granules, Motion, Tracks, track
    from .laws.collision import impact
    from .laws.restitution import Restitution
    from .laws.streams import layer, layers
    from .many.comparison import compare
    from .many.compute import Sweep, sweep
    from .many.variant import variants
    from .planning.plan import Plan
    from .runs import run
    from .runs.planned import chain
    from .runs.planned import make_plan as plan
    from .scene import Scene
    from .show.views import Result

# The rooms in the order in which a run uses them: each imports only those before it (tests/unit/test_architecture.py).
# The folders of air and of flight are rooms themselves
LAYERS = (
    "core",
    "laws",
    "scene",
    "planning",
    "air",
    "flight",
    "answer",
    "show",
    "runs",
    "many",
    "cli",
    "extras",
)

__all__ = [
    "Body", "Collisions", "Fate", "FlowField", "FoamError", "Granules", "MeshError", "Motion", "Plan",
    "Posterior", "ProgramError", "Restitution", "Result", "Scene", "SceneError", "Search", "Sensitivity", "Sweep",
    "Tracks", "WakeflowError", "calibrate", "chain", "compare", "dividers", "impact", "layer", "layers", "plan", "run",
    "search", "sensitivity", "sweep", "track", "variants",
]  # fmt: skip


DISTRIBUTION = "wakeflow-separation"  # on the registry, where "wakeflow" is an astronomer's package
UNINSTALLED = "0 (a source tree that was never installed)"


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version(DISTRIBUTION)
        except PackageNotFoundError:
            return UNINSTALLED
    return loaded(__name__, name)


def __dir__() -> list[str]:
    return sorted(__all__)
