"""The source that is the third dimension: how far a share in a run in three dimensions of such a machine is from the
best estimate's in two.

Under the granules' force the two are one within what both leave open; where only air that does not feel them is known,
they differ, and whether they do in the answer's air is not known. So it does not move the answer, and its whole size
widens the interval (JCGM 100:2008, F.2.4.5). It is taken in ln(p / (1 - p)), which stays within 0 and 1; what the bin
gains the fraction's other bins lose in proportion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from ..draws import ErrorSource as Column
from ..shares import CALIBRATED
from .source import FractionResults, Parts, Source, add, signed_column
from .span_shares import farther_in_three_dimensions, log_odds


class ThirdDimension(Source[None]):
    """The wake's third dimension, where it was computed for a machine like the scene's."""

    name, how, place = "three-dimensions", CALIBRATED, 51
    beyond_computing: ClassVar[bool] = True
    if_large = "run rung 3d (--rung 3d)"

    def shares(self, fraction: FractionResults) -> Parts:
        note = "as far as its share in three dimensions is from the plane one, each granule alone"
        found = self._moved(fraction)
        return {place: [self.part(abs(moved), note=note)] for place, moved in found.items()}

    def column(self, fractions: Sequence[FractionResults]) -> Column | None:
        return signed_column(self.name, [self._moved(one) for one in fractions])

    def _moved(self, fraction: FractionResults) -> dict[str, float]:
        pipeline = fraction.pipeline
        farther = farther_in_three_dimensions(pipeline.scene, pipeline.plan).get(fraction.name, {})
        found = dict.fromkeys(fraction.shares, 0.0)
        for place, more in farther.items():
            own = fraction.shares[place]
            if not 0.0 < own < 1.0:
                continue
            moved = 1.0 / (1.0 + math.exp(-log_odds(own) - more)) - own
            for other, share in fraction.shares.items():
                found[other] += moved if other == place else -moved * share / (1.0 - own)
        return found if farther else {}


add(ThirdDimension())
