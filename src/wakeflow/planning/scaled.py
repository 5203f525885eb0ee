"""What is known of every fraction's flight before its forces are chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..laws.forces import FlightScales
from ..scene import Scene
from .air_loading import with_slowed_air
from .airflow import AirflowPlan
from .flight_scales import flights
from .impaction import Deflection, deflection

__all__ = ["Scaled", "scaled_flights"]


class Scaled(NamedTuple):
    """Of every fraction: the factor on its drag law; in air, how that turns it aside and the scales of its flights."""

    drag: Mapping[str, float]
    turned: Mapping[str, Deflection | None]
    flights: Mapping[str, Sequence[FlightScales]]


def scaled_flights(scene: Scene, airflow: AirflowPlan, drag: Mapping[str, float]) -> Scaled:
    """All fractions, ``drag`` being the factors on their drag laws; only these in a vacuum."""
    if scene.air is None:
        return Scaled(drag, {}, {})
    laws = {name: (scene.fraction[name].drag_law, factor) for name, factor in drag.items()}
    turned = {name: deflection(scene, name, *law) for name, law in laws.items()}
    straight = {name: one is not None and one.straight and not scene.obstacles for name, one in turned.items()}
    found = {
        name: flights(scene, name, *law, straight=straight[name], turbulent=airflow.turbulent)
        for name, law in laws.items()
    }
    return Scaled(drag, turned, with_slowed_air(scene, found))
