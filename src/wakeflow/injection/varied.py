"""Granules as a draw of what is unknown has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..laws.restitution import Restitution
from ..planning.variation import GranuleVariation
from ..tracking import Granules

__all__ = ["varied_granules"]

MOST_SCATTER = 1.0  # rad, as the tracker takes it


def varied_granules(grains: Granules, variation: GranuleVariation) -> Granules:
    """``grains`` with the variation's shift and factors; what leaves the range of a quantity ends at it."""
    own = grains.restitution
    restitution: Any = (
        own.shifted(variation.restitution)
        if isinstance(own, Restitution)
        else np.clip(own + variation.restitution, 0.0, 1.0)
    )
    return grains.replace(
        diameter=grains.diameter * variation.size,
        restitution=restitution,
        friction=grains.friction * variation.friction,
        scatter=np.minimum(grains.scatter * variation.scatter, MOST_SCATTER),
        drag_scale=grains.drag_scale * variation.drag,
        inertia=grains.inertia / variation.turning,
    )
