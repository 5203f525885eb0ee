"""How long the near wake of a case's body keeps fine dust: in its airflow, and between two of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...field import FlowField
from ...field.blend import blended_wake
from ...laws.best_estimate import WakeEstimate, best_estimate, wakes
from ...pipeline.pipeline import Pipeline
from ...tracking.residence import ResidenceTime, residence_time

__all__ = ["RESIDENCE", "DustyWake", "dusty_wake", "estimate_without", "within_estimate"]

RESIDENCE = "residence_time"  # the quantity, here and in the wakes' data


@dataclass(frozen=True, eq=False)
class DustyWake:
    """The air round the first body of a scene: its ``field``, read where it is needed, the body's ``outline`` (k, 2) m,
    where the air flows and how fast (m/s), and the ``frequency`` (Hz) of the shedding, None where there is none.
    """

    field: Callable[[], FlowField]
    outline: NDArray[np.float64]
    direction: Literal["down", "up"]
    speed: float
    frequency: float | None = None

    def residence(self) -> ResidenceTime:
        """The near-wake residence time; its interval is over the sheddings of a field that repeats."""
        field = self.field()
        whole = 0.0 if field.period is None or self.frequency is None else field.period * self.frequency
        return residence_time(field, self.outline, self.direction, self.speed, sheddings=max(1, round(whole)))

    def between(self, steady: DustyWake, theta: float, strength: float) -> DustyWake:
        """The wake between ``steady`` and this one in time, see :func:`wakeflow.field.blend.blended_wake`."""
        return replace(self, field=lambda: blended_wake(self.field(), steady.field(), theta, strength))


def dusty_wake(pipeline: Pipeline, strouhal: float | None) -> DustyWake | None:
    """The air round the first body of a pipeline's scene, whose wake sheds at ``strouhal``; None without a body."""
    scene = pipeline.scene
    if scene.air is None or scene.first_outline is None:
        return None
    frequency = None if strouhal is None else strouhal * scene.air.speed / scene.width
    return DustyWake(lambda: pipeline.field[1], scene.first_outline, scene.air.direction, scene.air.speed, frequency)


def estimate_without(quantity: str, family: str, blockage: float, reynolds: float) -> WakeEstimate:
    """The best estimate of ``family``'s wake from all data but those of ``quantity``, which it is to be judged by."""
    return best_estimate(family, blockage, reynolds, [entry for entry in wakes() if entry.quantity != quantity])


def within_estimate(resolved: DustyWake, steady: DustyWake, estimate: WakeEstimate) -> Iterator[ResidenceTime]:
    """The residence time at the estimate itself, and at both ends of the range of theta and of the strength."""
    theta, strength = estimate.theta, estimate.strength
    for share, fluctuation in (
        (theta.value, strength.value),
        (theta.low, strength.value),
        (theta.high, strength.value),
        (theta.value, strength.low),
        (theta.value, strength.high),
    ):
        yield resolved.between(steady, share, fluctuation).residence()
