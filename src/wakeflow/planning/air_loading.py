"""Whether the air feels the granules: by what their drag takes from the air of the curtain's own stream tube."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..core.errors import SceneError
from ..laws.forces import FlightScales
from ..scene import Scene
from .airflow import AirflowPlan
from .bounds import LOADING, bounds
from .coupling import taken_from_the_air

__all__ = ["feels_granules", "with_slowed_air"]

KINDS = ("steady", "time-resolved", "best-estimate")  # of airflows, which a steady one that OpenFOAM solves is part of


def with_slowed_air(scene: Scene, scales: Mapping[str, Sequence[FlightScales]]) -> Mapping[str, Sequence[FlightScales]]:
    """The ``scales`` of all fractions with what their drag together takes from the air; as they are in a scene without
    feed.rate, which says nothing of how dense its curtain is.
    """
    if scene.air is None or scene.feed.rate is None:
        return scales
    slowed = taken_from_the_air(scene, scales).slowed
    return {name: [replace(flight, slowed=slowed) for flight in flights] for name, flights in scales.items()}


def feels_granules(
    scene: Scene,
    airflow: AirflowPlan,
    scales: Mapping[str, Sequence[FlightScales]],
    limit: float,
    switched: bool | None,
) -> bool:
    """Whether the airflow is computed with the granules' force on it: where that could move a fraction by more than
    ``limit`` (body widths), or as ``switched`` by hand. Raises SceneError where it is asked for and cannot be had.
    """
    if switched is False:
        return False
    obstacle = _obstacle(scene, airflow)
    if switched and obstacle is not None:
        raise SceneError(f"--force {LOADING}=on: {obstacle}")
    if obstacle is not None:
        return False
    return bool(switched) or any(bounds[LOADING].shift(flight) > limit for some in scales.values() for flight in some)


def _obstacle(scene: Scene, airflow: AirflowPlan) -> str | None:
    """Why the granules' force cannot be given to the air; None where it can."""
    if airflow.kind not in KINDS:
        return f"rung {airflow.rung} has no steady airflow that OpenFOAM could solve on; use draft or standard"
    if scene.feed.rate is None:
        return "the scene has no feed.rate, which says how dense the curtain is"
    return None
