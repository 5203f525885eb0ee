"""What another step, airflow or grid makes of the same granules: the measured parts of a scene's budget.

Each comparison flies the granules of the first replicates again, with the same random numbers, so that the difference
shows the change and not another sample. A share's part of the error is that difference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..pipeline.landings import Landings
from ..pipeline.pipeline import Pipeline
from ..pipeline.track_stage import Companion
from ..planning.plan import COMPARED
from ..scene import RESERVED_BIN
from .grid_convergence import GridEstimate, estimate

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

__all__ = [
    "FINER",
    "Comparison",
    "airflow_on_grids",
    "airflows",
    "compared",
    "differences",
    "finer_steps",
    "grids",
    "mesh_error",
]

Array = NDArray[np.float64]
Shares = dict[str, Array]  # a fraction's share in every bin and elsewhere, (replicates, bins + 1)
FINER = 0.01  # tolerance of the companion run over the scene's: a tenth may give the same steps, cut at the cells
HALF = 0.5  # of the fluctuation, between the mean wake and the computed one
STEADY, MEAN, HALVED, COMPUTED = "steady", "mean", "half", "computed"


@dataclass(frozen=True)
class Comparison:
    """Shares by airflow or grid, the answer's own last, and the run time (s) of the others."""

    shares: dict[str, Shares]
    seconds: float

    def table(self, bins: list[str]) -> dict[str, Any]:
        """Mean shares {fraction: {bin: {airflow: share}}}, for result.json."""
        names = list(next(iter(self.shares.values())))
        return {
            name: {
                place: {which: float(found[name][:, i].mean()) for which, found in self.shares.items()}
                for i, place in enumerate([*bins, RESERVED_BIN])
            }
            for name in names
        }


def compared(landing: Landings) -> Landings:
    """The landings of the replicates that fly in comparisons."""
    kept = landing.replicate < COMPARED
    return replace(landing, **{name: values[kept] for name, values in vars(landing).items()})


def _shares(pipeline: Pipeline, tracked: Tracked) -> Shares:
    landings: Mapping[str, Landings] = tracked.landings
    return {name: compared(landings[name]).counts(len(pipeline.scene.bin)) for name in landings}


def finer_steps(pipeline: Pipeline) -> tuple[Tracked, float]:
    """The same granules at a hundredth of the tolerance, and the run time (s)."""
    finer = Companion("companion", tolerance=FINER * pipeline.scene.numerics.tolerance)
    return pipeline.tracks(finer), pipeline.seconds[f"{pipeline.label}companion"]["seconds"]


def airflows(pipeline: Pipeline, tracked: Tracked) -> Comparison | None:
    """The ends between which the truth lies, and what is between: steady wake, mean wake, half of the fluctuation, all
    of it. None where the computed airflow is the flow itself, or is the steady end.
    """
    if not pipeline.plan.airflow.brackets or pipeline.field[1].times is None:
        return None
    others: list[tuple[str, Pipeline, Companion]] = [
        (STEADY, pipeline.draft, Companion("steady wake")),
        (MEAN, pipeline, Companion("mean wake", blend=0.0)),
        (HALVED, pipeline, Companion("half fluctuation", blend=HALF)),
    ]
    shares, seconds = {}, 0.0
    for name, where, change in others:
        shares[name] = _shares(pipeline, where.tracks(change))
        seconds += where.seconds[where.label + change.name]["seconds"]
    return Comparison({**shares, COMPUTED: _shares(pipeline, tracked)}, seconds)


def grids(pipeline: Pipeline, tracked: Tracked) -> Comparison | None:
    """The same granules in the airflow on every grid of the plan, by its cells; None where the plan has one."""
    own, *others = (pipeline.on_grid(i) for i in range(len(pipeline.plan.airflow.scales)))
    if not others:
        return None
    shares, seconds = {}, 0.0
    for other in others:
        shares[str(other.airflow["cells"])] = _shares(pipeline, other.tracks(Companion("tracks")))
        seconds += sum(other.seconds[other.label + stage]["seconds"] for stage in ("airflow", "tracks"))
    return Comparison({**shares, str(own.airflow["cells"]): _shares(pipeline, tracked)}, seconds)


def mesh_error(comparison: Comparison, name: str, place: int) -> GridEstimate:
    """A share with its mesh error, from :func:`grids`; 95 % half widths over the replicates are its noise."""
    from scipy.stats import t

    values = [shares[name][:, place] for shares in comparison.shares.values()]
    noise = [float(t.ppf(0.975, len(v) - 1) * v.std(ddof=1) / np.sqrt(len(v))) for v in values]
    sizes = [int(cells) ** -0.5 for cells in comparison.shares]
    return estimate(sizes, [float(v.mean()) for v in values], noise)


def airflow_on_grids(pipeline: Pipeline) -> list[dict[str, Any]] | None:
    """Cd, base pressure and reversal length with their mesh error, and what each grid gave; None with one grid."""
    if len(pipeline.plan.airflow.scales) < 2:
        return None
    found = [pipeline.on_grid(i).airflow for i in range(len(pipeline.plan.airflow.scales))]
    sizes = [row["cells"] ** -0.5 for row in found]
    measured = {name: [row[name] for row in found] for name in ("cd", "cp_base")}
    table = {
        name: ([row["value"] for row in rows], [0.5 * (row["high"] - row["low"]) for row in rows])
        for name, rows in measured.items()
    }
    lengths = [row["suction"]["reversal_length"] for row in found]
    drag, noise = table["cd"]
    table["reversal_length"] = (
        lengths,
        [at * half / drag_ for at, half, drag_ in zip(lengths, noise, drag, strict=True)],
    )
    return [
        {"quantity": name, "cells": [row["cells"] for row in found], "values": values}
        | asdict(estimate(sizes, values, halves))
        for name, (values, halves) in table.items()
    ]


def differences(comparison: Comparison, name: str, place: int) -> Iterator[tuple[str, float]]:
    """How far each other airflow's share of fraction ``name`` in bin number ``place`` lies from the answer's own."""
    *others, own = comparison.shares
    here = comparison.shares[own][name][:, place].mean()
    for which in others:
        yield which, float(comparison.shares[which][name][:, place].mean() - here)
