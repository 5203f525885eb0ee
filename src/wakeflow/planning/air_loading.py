"""Whether the air feels the granules: by what their drag takes from the air of the curtain's own stream tube."""

from __future__ import annotations

from collections.abc import Mapping

from ..core.errors import SceneError
from ..scene import Scene
from .airflow import AirflowPlan
from .approach import Approach
from .bounds import LOADING, bounds
from .terms import limit_of

__all__ = ["feels_granules"]

KINDS = ("steady", "time-resolved", "best-estimate")  # of airflows, which a steady one that OpenFOAM solves is part of


def feels_granules(
    scene: Scene,
    airflow: AirflowPlan,
    approaches: Mapping[str, Approach],
    target: float,
    switched: bool | None,
) -> bool:
    """Whether the airflow is computed with the granules' force on it: where that could move one of the fractions that
    come by ``approaches`` farther than the accuracy ``target`` (of a share) allows, or as ``switched`` by hand. Raises
    SceneError where it is asked for and cannot be had.
    """
    if switched is False:
        return False
    obstacle = _obstacle(scene, airflow)
    if switched and obstacle is not None:
        raise SceneError(f"--force {LOADING}=on: {obstacle}")
    if obstacle is not None:
        return False
    limit, scales = limit_of(scene, target), (flight for one in approaches.values() for flight in one.scales)
    return bool(switched) or any(bounds[LOADING].shift(flight) > limit for flight in scales)


def _obstacle(scene: Scene, airflow: AirflowPlan) -> str | None:
    """Why the granules' force cannot be given to the air; None where it can."""
    if airflow.kind not in KINDS:
        return f"rung {airflow.rung} has no steady airflow that OpenFOAM could solve on; use draft or standard"
    if scene.feed.rate is None:
        return "the scene has no feed.rate, which says how dense the curtain is"
    return None
