"""The knobs: what time is spent on, from the scene's own to the finest that a scene may ask for.

A knob is one number of a scene. All of them together are :class:`KnobSettings`; a number is None where the scene has no
such knob: no mesh without a solver, no averaging where nothing sheds, no slab where granules do not meet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil, log2, sqrt
from typing import Any

from ..core.registry import Registry
from ..planning.plan import COMPARED, REPLICATES, Plan, replicate_size
from ..planning.unknowns import SIGMAS
from ..results.refinement import KnobSettings
from ..scene import Scene

__all__ = ["Knob", "applied", "cheapest", "finer", "finest_of", "knobs", "own_settings"]

COARSER_MESH = 2.0  # of the cheapest pass, times the scene's own cells: an eighth of the time
MOST_COARSE = 4.0  # largest numerics.mesh_scale of a scene
LOOSER = 0.1  # of the target: a landing error that moves few granules over a bin's end
FEWEST = 256  # granules of the cheapest pass: 16 a replicate
# Granules of the cheapest pass times the target: what any answer needs, since the limit of a share of which nothing was
# found among the granules that fly again is SIGMAS^2 over their number
IN_FIRST = SIGMAS**2 * REPLICATES / COMPARED


@dataclass(frozen=True)
class Knob:
    """One knob: the ``field`` of :class:`KnobSettings` that holds it, the ``key`` of a scene, the factor ``step`` of
    its next finer value, and the ``finest`` that a scene may ask for; ``name`` in words.
    """

    name: str
    field: str
    key: str
    step: float
    finest: float

    def of(self, settings: KnobSettings) -> float | None:
        """Where the knob stands; None where the scene has no such knob."""
        value: float | None = getattr(settings, self.field)
        return value

    def at(self, settings: KnobSettings, value: float) -> KnobSettings:
        """The settings with the knob at a value."""
        change: dict[str, Any] = {self.field: round(value) if self.step > 1.0 else value}
        return replace(settings, **change)

    def next(self, settings: KnobSettings) -> KnobSettings | None:
        """One step finer; None at the finest."""
        now = self.of(settings)
        if now is None or (now * self.step - self.finest) * (self.step - 1.0) > 0.0:
            return None
        return self.at(settings, now * self.step)

    def finer(self, one: float, other: float) -> float:
        """The finer of two values."""
        return max(one, other) if self.step > 1.0 else min(one, other)


knobs: Registry[Knob] = Registry("knob")
for _knob in (
    Knob("granules", "granules", "feed.count", 2.0, 2**23),
    Knob("tolerance", "tolerance", "numerics.tolerance", 10**-0.5, 1e-9),
    Knob("mesh", "mesh_scale", "numerics.mesh_scale", sqrt(0.5), 0.2),
    Knob("averaging", "averaging", "numerics.averaging", sqrt(0.5), 0.002),
    Knob("slab", "slab", "collisions.count", 2.0, 2**17),
):
    knobs.add(_knob.name, _knob)


def own_settings(scene: Scene, plan: Plan) -> KnobSettings:
    """What the scene itself asks for, under its ``plan``."""
    solved = plan.airflow.stepping is not None and plan.airflow.span is None
    sheds = solved and plan.airflow.stepping == "time-resolved"
    return KnobSettings(
        granules=REPLICATES * replicate_size(scene.feed.count),
        tolerance=scene.numerics.tolerance,
        mesh_scale=scene.numerics.mesh_scale if solved else None,
        averaging=plan.airflow.accuracy if sheds else None,
        slab=None if plan.crowd is None else plan.crowd.count,
    )


def cheapest(own: KnobSettings, target: float) -> KnobSettings:
    """Of the first pass, which measures how the errors stand: never finer than the scene's ``own``."""
    count = max(FEWEST, 2 ** ceil(log2(IN_FIRST / target)))
    mesh = None if own.mesh_scale is None else max(own.mesh_scale, min(COARSER_MESH * own.mesh_scale, MOST_COARSE))
    return replace(
        own,
        granules=min(own.granules, count),
        tolerance=max(own.tolerance, LOOSER * target),
        mesh_scale=mesh,
        slab=None if own.slab is None else min(own.slab, count),
    )


def finer(one: KnobSettings, other: KnobSettings) -> KnobSettings:
    """Every knob at the finer of two settings."""
    for knob in _present(one):
        here, there = knob.of(one), knob.of(other)
        assert here is not None
        one = knob.at(one, here if there is None else knob.finer(here, there))
    return one


def finest_of(settings: KnobSettings) -> KnobSettings:
    """Every knob at the end of its steps."""
    for knob in _present(settings):
        while (further := knob.next(settings)) is not None:
            settings = further
    return settings


def applied(scene: Scene, settings: KnobSettings) -> Scene:
    """The scene with the settings in it."""
    return scene.replace({knob.key: knob.of(settings) for knob in _present(settings)})


def _present(settings: KnobSettings) -> Iterator[Knob]:
    return (knobs[name] for name in knobs if knobs[name].of(settings) is not None)
