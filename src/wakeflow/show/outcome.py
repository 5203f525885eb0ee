"""What a run hands to its report, the standard figures that are drawn of it, and what extras add to its page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.registry import Registry
from ..core.tables import AnyArray

if TYPE_CHECKING:
    from ..air.field import FlowField
    from ..air.kinds.airflow_table import Airflow
    from ..answer.result import Result
    from ..flight.stages.solved_case import ForceHistory, PlaneCells
    from ..scene import Scene

# of a granule: time (m,) s, position (m, 2) m, velocity (m, 2) m/s; diameter () m; bin () as below, fate () of wf.Fate
Track = Mapping[str, AnyArray]


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
class AirAndTracks:
    """What of a run is there before its answer, for the report to show.

    ``field``: the air that the tracker read, and ``airflow``, what is known of it, None in a vacuum; ``tracks``: a
    sample of every fraction's; ``cells`` and ``history``: mesh and recorded forces of a solved airflow, None of
    another.
    """

    scene: Scene
    field: FlowField | None
    airflow: Airflow | None
    tracks: Mapping[str, Sequence[Track]]
    cells: PlaneCells | None
    history: ForceHistory | None


@dataclass(frozen=True)
class Outcome(AirAndTracks):
    """What a run hands to its report.

    ``landings``: all of every fraction's; ``result``: the answer; ``shown``: the tracks of each [picture.NAME] by
    fraction; ``granules``: the columns of granules.npz, of a sample of the landings.
    """

    landings: Mapping[str, Landed]
    result: Result
    shown: Mapping[str, Mapping[str, Sequence[Track]]]
    granules: Mapping[str, AnyArray]


@dataclass(frozen=True)
class Figure:
    """A picture in the folder ``figures`` and on the page, NAME.png under the name that it is registered by.

    ``caption``: what it shows; ``parts(outcome)``: what it shows of a run, empty where the run has nothing of it;
    ``draw(paper, *parts)`` writes the PNG, the SVG and the data, or draws on the axes or in the figure that the paper
    is, and returns the axes, one or an array; ``always``: every finished report has it, so that one without it is drawn
    again; ``of_answer``: it shows the answer, not what is there before (:class:`AirAndTracks`) alone.
    """

    caption: str
    draw: Callable[..., Any]
    parts: Callable[[Any], tuple[object, ...]]
    always: bool = False
    of_answer: bool = True


figures: Registry[Figure] = Registry("standard figure")


def add_figure(
    name: str, caption: str, draw: Callable[..., Any], parts: Callable[[Any], tuple[object, ...]], *,
    always: bool = False, of_answer: bool = True,
) -> None:  # fmt: skip
    """Register a :class:`Figure`."""
    figures.add(name, Figure(caption, draw, parts, always, of_answer))


@dataclass(frozen=True)
class PagePart:
    """HTML that an extra adds to report.html: its ``section`` before the pictures, its line of the ``contents``, its
    ``script`` at the end.
    """

    section: str
    contents: str = ""
    script: str = ""


@dataclass(frozen=True)
class PageAddition:
    """``part`` of the page of an outcome in a folder. The extra's ``files``, relative to the folder, belong to the
    answer: they stay where its report is drawn anew, and are removed with it.
    """

    part: Callable[[Path, Outcome], PagePart]
    files: tuple[str, ...] = ()


page_additions: Registry[PageAddition] = Registry("addition to the page of a run", extended=True)
