"""How long the near wake of a case's body keeps fine dust: in its airflow, and between two of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wakeflow.field.blend import blended_wake
from wakeflow.laws.best_estimate import WakeEstimate, best_estimate, wakes
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.realisations import Realisations
from wakeflow.tracking.residence import ResidenceTime, residence_time

RESIDENCE = "residence_time"  # the quantity, here and in the wakes' data


@dataclass(frozen=True, eq=False)
class DustyWake:
    """The ``air`` round the first body of a scene, read where it is needed, the body's ``outline`` (k, 2) m, and where
    and how fast (m/s) the air flows.
    """

    air: Callable[[], Realisations]
    outline: NDArray[np.float64]
    direction: Literal["down", "up"]
    speed: float

    def residence(self) -> ResidenceTime:
        """The near-wake residence time; its interval is over the realisations, or the cycles of the only one."""
        air = self.air()
        fields = [made for number in range(len(air)) if (made := air.make(number)) is not None]
        return residence_time(fields, self.outline, self.direction, self.speed, sheddings=air.cycles)

    def between(self, steady: DustyWake, theta: float, strength: float) -> DustyWake:
        """The wake between ``steady`` and this one in time, see :func:`wakeflow.field.blend.blended_wake`."""

        def blended() -> Realisations:
            air, end = self.air(), steady.air().field
            assert air.field is not None
            assert end is not None
            return Realisations(blended_wake(air.field, end, theta, strength), cycles=air.cycles)

        return replace(self, air=blended)


def dusty_wake(pipeline: Pipeline) -> DustyWake | None:
    """The air round the first body of a pipeline's scene; None without a body."""
    scene = pipeline.scene
    if scene.air is None or scene.first_outline is None:
        return None
    return DustyWake(lambda: pipeline.kind.realisations, scene.first_outline, scene.air.direction, scene.air.speed)


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
