"""The plan of an airflow in three dimensions: a periodic span behind the picture, and what it will cost."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from ..core.errors import SceneError
from ..laws.span import CADENCE, Span
from ..laws.turbulence_models import model_at
from ..scene import Scene

__all__ = ["SpanCost", "cost_of", "span_lines", "span_of"]

STEPS = 95.0  # time steps in one, on the usual mesh at a Courant number of 2: measured, 81 to 95
# Measured on 2020s hardware: 2.6 to 3.1 microseconds on meshes of 92 to 128 thousand cells.
SECONDS = 3e-6  # of one core, a cell and time step
BYTES = 24.0  # of disk, a cell and snapshot: six numbers in single precision
MEMORY = 2800.0  # bytes a cell that OpenFOAM holds
LAYERS_A_WIDTH, LEAST_LAYERS = 8, 4


@dataclass(frozen=True)
class SpanCost:
    """What an airflow in three dimensions costs; good to a factor of one and a half once its mesh is known."""

    cells: float
    steps: float
    core_seconds: float
    memory: float  # bytes
    disk: float  # bytes

    def __str__(self) -> str:
        hours, gigabyte = self.core_seconds / 3600, 1e9
        return (
            f"about {self.cells:.3g} cells x {self.steps:.3g} time steps x {1e6 * SECONDS:g} microseconds = "
            f"{hours:.2g} core-hours; {self.memory / gigabyte:.2g} GB of memory, {self.disk / gigabyte:.2g} GB of disk"
        )


def span_of(scene: Scene) -> Span:
    """The span that a scene asks for: 8 layers a body width unless it says how many.

    Raises SceneError where the wake is not turbulent, and for what a span cannot follow.
    """
    asked, reynolds = scene.numerics.span, scene.reynolds or 0.0
    if not model_at(reynolds).turbulent:
        raise SceneError(f"rung = '3d' resolves a turbulent wake; at Re {reynolds:.3g} it is laminar: choose standard")
    if scene.air is not None and scene.air.profile == "parabolic":
        raise SceneError("rung = '3d': a parabolic inlet is laminar and its wake is not; air.profile = 'uniform'")
    layers = asked.layers if asked.layers is not None else max(LEAST_LAYERS, math.ceil(LAYERS_A_WIDTH * asked.depth))
    return Span(asked.depth, layers, asked.sheddings)


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
    """The plan's lines on it."""
    yield (
        f"three dimensions: a periodic span of {span.depth:g} body widths in {span.layers} layers, {span.sheddings:g} "
        f"sheddings recorded after a start-up of {span.start_up:g} body widths of travel"
    )
    yield f"{cost}; it may be stopped and started again at any time"
