"""From landings to the answer: shares with what finite numbers of granules and shedding cycles leave open."""

from __future__ import annotations

from collections.abc import Mapping

from ..flight.stages.landings import Landings
from ..scene import Scene
from .draws import ErrorSource
from .ensemble import joint_answer
from .shares import Separation
from .spread import sample_errors


def separate(scene: Scene, landings: Mapping[str, Landings]) -> Separation:
    """Shares, purity, recovery and throughput (kg/h) of every bin from the ``landings`` of each fraction, with the
    interval that the finite numbers of granules and of shedding cycles make.
    """
    errors = sample_errors(landings, len(scene.bin), scene.images)
    sources = [ErrorSource(which, roots, together=True) for which, roots in errors._asdict().items()]
    return joint_answer(scene, landings, sources=sources).own.separation()
