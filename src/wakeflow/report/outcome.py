"""What a run hands to its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..field import FlowField
    from ..results.airflow_summary import Airflow
    from ..results.result import Result
    from ..results.solved_case import ForceHistory, PlaneCells
    from ..scene import Scene

__all__ = ["Landed", "Outcome", "Track"]

# of a granule: time (m,) s, position (m, 2) m, velocity (m, 2) m/s; diameter () m; bin () as below, fate () of wf.Fate
Track = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Landed:
    """Where a fraction's granules landed: ``x`` and ``y`` (n,) m, ``weight`` (n,) of each as a share of the fraction's
    mass, ``bin`` (n,) index into the scene's bins or -1 for elsewhere.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    weight: NDArray[np.float64]
    bin: NDArray[np.integer]


@dataclass(frozen=True)
class Outcome:
    """What a run hands to its report.

    ``field``: the air that the tracker read, None in a vacuum; ``tracks``: a sample of every fraction's;
    ``landings``: all of every fraction's; ``result``: the answer; ``shown``: the tracks of each [picture.NAME] by
    fraction; ``granules``: the columns of granules.npz, of a sample of the landings; ``cells`` and ``history``: mesh
    and recorded forces of a solved airflow, None of another.
    """

    scene: Scene
    field: FlowField | None
    tracks: Mapping[str, Sequence[Track]]
    landings: Mapping[str, Landed]
    result: Result
    shown: Mapping[str, Mapping[str, Sequence[Track]]]
    granules: Mapping[str, NDArray[Any]]
    cells: PlaneCells | None = None
    history: ForceHistory | None = None

    @property
    def airflow(self) -> Airflow | None:
        """What is known of the air; None in a vacuum."""
        return self.result.airflow
