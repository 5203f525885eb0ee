"""The wake that a scene is flown in, and what one over a span costs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ..core.errors import SceneError
from ..core.geometry import wall_edge
from ..laws.best_estimate import WakeEstimate, best_estimate
from ..laws.span import CADENCE, Span
from ..laws.turbulence import model_at
from ..scene import Scene

# -- The wake that a scene is flown in ---------------------------------------------------------------------------------
SHARP = 0.02  # radius over width up to which an edge is sharp: Munson's triangles lose a seventh of their drag there
SQUARE, THIN = (0.8, 1.25), 0.25  # extent along the air over that across it, of a square and of a plate; chosen
ON_BOX = 1e-9  # of the width: how far a rectangle's corners may lie off the corners of its box


class ShapeFamily(NamedTuple):
    """A shape of the data, empty for one without; ``slope`` (deg) of its faces from the horizontal, nan without any."""

    name: str = ""
    slope: float = math.nan


class Wake(StrEnum):
    """The wakes in which the granules of a comparison fly."""

    STEADY = "steady"
    TIME_RESOLVED = "time-resolved"
    MEAN = "mean"  # of the time-resolved wake
    HALF = "half"  # of its fluctuation
    ANSWER = "answer"  # the answer's own


def wakes_beside(brackets: bool, estimate: WakeEstimate) -> dict[Wake, tuple[float, float]]:
    """Theta and strength of the wakes in which part of the granules fly beside the answer's own.

    Around a best estimate: its two ends. Around a time-resolved wake that is the answer itself: the steady one, and two
    with less of the fluctuation.
    """
    if not brackets:
        return {}
    if not estimate:
        return {Wake.STEADY: (0.0, 0.0), Wake.MEAN: (1.0, 0.0), Wake.HALF: (1.0, 0.5)}
    return {Wake.STEADY: (0.0, 0.0), Wake.TIME_RESOLVED: (1.0, 1.0)}


def wake_of(scene: Scene, reynolds: float) -> WakeEstimate:
    """The best estimate of the wake of a scene's bodies, at a Reynolds number at which it is turbulent."""
    family = family_of(scene)
    return best_estimate(family.name, scene.width / scene.channel.width, reynolds, slope=family.slope)


def family_of(scene: Scene) -> ShapeFamily:
    """Which shape of the data is in the air; none for several bodies, one on a wall, rounded edges, other shapes."""
    (body, *others) = scene.body.values()
    outline = body.outline()
    standing = wall_edge(outline, scene.channel.width / 2)
    if others or standing or body.rounding > SHARP * scene.width:
        return ShapeFamily()
    across, along = np.ptp(outline, axis=0)
    if body.shape == "rhombus":
        return ShapeFamily("rhombus", math.degrees(math.atan2(along, across)))
    if body.shape == "prism":
        upstream = body.given.get("apex", "up") == ("up" if scene.airstream.direction == "down" else "down")
        slope = math.degrees(math.atan2(2.0 * along, across))
        return ShapeFamily("triangle-up" if upstream else "triangle-down", slope)
    box = np.abs(outline - 0.5 * (outline.min(axis=0) + outline.max(axis=0))) - 0.5 * np.array([across, along])
    if len(outline) == 4 and np.abs(box).max() < ON_BOX * across:
        name = "plate" if along < THIN * across else "square" if SQUARE[0] <= along / across <= SQUARE[1] else ""
        return ShapeFamily(name)
    return ShapeFamily()


# -- The plan of an airflow in three dimensions ------------------------------------------------------------------------
STEPS = 95.0  # time steps in one, on the usual mesh at a Courant number of 2: measured, 81 to 95
# Measured on 2020s hardware: 2.6 to 3.1 microseconds on meshes of 92 to 128 thousand cells.
SECONDS = 3e-6  # of one core, a cell and time step
BYTES = 24.0  # of disk, a cell and snapshot: six numbers in single precision
MEMORY = 2800.0  # bytes a cell that OpenFOAM holds
LAYERS_A_WIDTH, MIN_LAYERS = 8, 4
HOURS_FROM = 100.0  # core-minutes from which a cost is written in hours


@dataclass(frozen=True)
class SpanCost:
    """What an airflow in three dimensions costs; good to a factor of one and a half once its mesh is known."""

    cells: float
    steps: float
    core_seconds: float
    memory: float  # bytes
    disk: float  # bytes

    def __str__(self) -> str:
        gigabyte, minutes = 1e9, self.core_seconds / 60
        time = f"{minutes:.2g} core-minutes" if minutes < HOURS_FROM else f"{minutes / 60:.2g} core-hours"
        return (
            f"about {self.cells:.3g} cells x {self.steps:.3g} time steps x {1e6 * SECONDS:g} microseconds = "
            f"{time}; {self.memory / gigabyte:.2g} GB of memory, {self.disk / gigabyte:.2g} GB of disk"
        )


def span_of(scene: Scene) -> Span:
    """The span that a scene asks for: 8 layers a body width unless it says how many.

    Raises SceneError where the wake is not turbulent, and for what a span cannot follow.
    """
    span, reynolds = scene.numerics.span, scene.reynolds
    if not model_at(reynolds).turbulent:
        raise SceneError(f"rung = '3d' resolves a turbulent wake; at Re {reynolds:.3g} it is laminar: choose standard")
    if scene.air is not None and scene.air.profile == "parabolic":
        raise SceneError("rung = '3d': a parabolic inlet is laminar and its wake is not; air.profile = 'uniform'")
    layers = span.layers or max(MIN_LAYERS, math.ceil(LAYERS_A_WIDTH * span.depth))
    return Span(span.depth, layers, span.shedding_cycles)


def cost_of(span: Span, plane_cells: float, scale: float) -> SpanCost:
    """What a ``span`` over a plane mesh of so many cells costs; ``scale``: their edges over the usual ones."""
    cells, steps = plane_cells * span.layers, STEPS / scale * span.whole
    snapshots = span.recorded / CADENCE
    return SpanCost(
        cells=cells,
        steps=steps,
        core_seconds=cells * steps * SECONDS,
        memory=MEMORY * cells,
        disk=BYTES * cells * snapshots,
    )


def span_lines(span: Span, cost: SpanCost) -> Iterator[str]:
    """The plan's lines on the span."""
    yield (
        f"three dimensions: a periodic span of {span.depth:g} body widths in {span.layers} layers, {span.sheddings:g} "
        f"shedding cycles recorded after a start-up of {span.start_up:g} body widths of travel"
    )
    yield f"{cost}; it may be stopped and started again at any time"
