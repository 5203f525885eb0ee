"""The source that is the granules' force on the air: what its passes leave open."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

from ...flight.stages.air_loading import AirLoading
from ...planning.terms import LOADING
from ..shares import MEASURED, LoadingEffect
from .source import FractionResults, Parts, Source, add


def loading_effects(loading: AirLoading, bins: Sequence[str]) -> dict[str, dict[str, LoadingEffect]]:
    """Of every fraction in every one of the ``bins``, elsewhere included, by their names in order."""
    last = loading.passes[-1].gathered.shares
    pairs = {name: zip(shares, last[name], strict=True) for name, shares in loading.first.shares.items()}
    return {name: {bin_: LoadingEffect(*pair) for bin_, pair in zip(bins, both, strict=True)}
            for name, both in pairs.items()}  # fmt: skip


class PassesOfLoading(Source[None]):
    """The granules' force on the air: what its last pass changed of a share in the steady airflow, and the part of what
    it does there that is not known for being gathered from few granules: a share moves with the force.
    """

    name, how, place = LOADING, MEASURED, 55
    if_large = "lower feed.rate"

    def shares(self, fraction: FractionResults) -> Parts:
        loading, found = fraction.pipeline.loading, {}
        if loading is None:
            return {}
        effects = loading_effects(loading, list(fraction.shares))[fraction.name]
        for number, (bin_, effect) in enumerate(effects.items()):
            moved, last = effect.loaded - effect.without, loading.last_change(fraction.name, number)
            told = (
                f"in the steady airflow the force moves the share by {100 * moved:+.2g} points, its last pass by "
                f"{100 * last:+.2g}; of the force {100 * loading.sampling:.2g} % are not known"
            )
            found[bin_] = [self.part(hypot(last, loading.sampling * moved), note=told)]
        return found


add(PassesOfLoading())
