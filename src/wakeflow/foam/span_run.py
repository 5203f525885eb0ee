"""Run an airflow in three dimensions: in segments of flow time, resumable at any moment and over days.

A case has two parts. The folder itself is one layer of cells: the plane mesh, and the plane wake that all starts from.
The folder ``span`` below it is the same mesh extruded. When one of its segments has ended, the snapshots that it wrote
are packed into the first part (``span_record``) and their time folders removed. All times are fixed by the case, and
whatever is killed begins again with the segment it was in: any number of interruptions leaves the same files.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

from ..core.errors import known
from ..core.files import write_json
from ..laws.span import CADENCE, Span
from ..laws.turbulence_models import USUAL
from .airflow_result import CheckMesh
from .case import FlowSpec
from .case_fields import time_folders
from .extrude import extrude
from .failure import AirflowFailure
from .prepare import prepare_case
from .segments import drop_after, last_state, purge, run_segment, segment_ends
from .solver import PHASE
from .span_record import PACKED, pack
from .span_start import start_span
from .start import first_step, perturb, start_from
from .time_resolved import COLLAPSED
from .watch import ProgressListener, Watch

__all__ = ["COURANT", "SPAN", "record_ends", "run_span"]

SPAN = "span"  # the extruded case, below the one-layer one
# Convective times. Chosen:
PLANE = 15.0  # of the plane wake before it is extruded: the vortices have formed by then
SEGMENT = 2.0  # what an interruption may cost; starting the solver costs some per cent of it
COURANT = 2.0  # the largest Courant number; halved, down to
CAREFUL = 0.5  # this one, when a segment fails numerically
SAME = 1e-6  # cadences


def run_span(
    spec: FlowSpec, msh: Path, folder: Path, start: Path | None, listener: ProgressListener, timeout: float | None
) -> CheckMesh:
    """Run the airflow of ``spec`` with its span to the end of its record; goes on from what is there.

    ``start``: any solved plane case that the plane wake starts from. ``timeout`` (s) bounds each program. Raises
    MeshError for a mesh that checkMesh refuses, AirflowFailure where a program fails or no Courant number serves.
    """
    flat = replace(spec, turbulence=USUAL, span=None, ranks=1)
    check = prepare_case(flat, msh, folder)
    _plane_wake(flat, folder, start, listener, timeout)
    deep, phase = folder / SPAN, folder / PHASE
    if not phase.exists():
        extrude(spec, folder, deep)
        start_span(spec, folder, deep)
        write_json(phase, {"phase": "span", "courant": COURANT})
    _record(spec, known(spec.span), folder, listener, timeout)
    return check


def _plane_wake(
    spec: FlowSpec, folder: Path, start: Path | None, listener: ProgressListener, timeout: float | None
) -> None:
    """The plane wake that every layer starts from, time-resolved for PLANE convective times."""
    end = PLANE * spec.convective_time
    if last_state(folder) >= end * (1 - SAME):
        return
    drop_after(folder, 0.0)
    start_from(spec, folder, start)
    perturb(spec, folder)
    watch = Watch(folder, "plane wake", listener, expected=end, least_step=COLLAPSED * spec.convective_time)
    run_segment(folder, "pimpleFoam", end, {"deltaT": first_step(spec)}, watch, timeout)


def record_ends(span: Span, scale: float) -> list[float]:
    """The ends (s) of the run's segments, ``scale`` (s) being the convective time: whole snapshots, the last one's end
    not before that of the record.
    """
    beats, whole = round(SEGMENT / CADENCE), math.ceil(span.whole / CADENCE - SAME)
    ends = [*range(beats, whole, beats), whole]
    return [beat * CADENCE * scale for beat in ends]


def _record(spec: FlowSpec, span: Span, folder: Path, listener: ProgressListener, timeout: float | None) -> None:
    """Run segment after segment; where one fails numerically, the last two again with half the Courant number."""
    deep, scale = folder / SPAN, spec.convective_time
    ends = record_ends(span, scale)
    watch = Watch(deep, "three dimensions", listener, expected=ends[-1], least_step=COLLAPSED * scale)
    while True:
        now, state = last_state(deep), json.loads((folder / PHASE).read_text())
        _pack_new(folder, now, span.start_up * scale)
        following = [end for end in ends if end > now * (1 + SAME)]
        if not following:
            return
        try:
            run_segment(deep, "pimpleFoam", following[0], {
                "deltaT": first_step(spec), "maxCo": state["courant"], "writeInterval": CADENCE * scale,
                "ranks": spec.ranks,
            }, watch, timeout)  # fmt: skip
        except AirflowFailure as failure:
            if not failure.cause.numerical or state["courant"] <= CAREFUL:
                raise
            write_json(folder / PHASE, {**state, "courant": 0.5 * state["courant"]})
            _go_back(folder)


def _pack_new(folder: Path, until: float, begin: float) -> None:
    """Pack the snapshots between ``begin`` and ``until`` (s), of segments that ended, and remove what is not needed."""
    deep = folder / SPAN
    for path in time_folders(deep):
        packed = folder / PACKED / f"{path.name}.npy"
        if begin * (1 - SAME) <= float(path.name) <= until * (1 + SAME) and not packed.exists():
            pack(path, folder)
    if until > 0:
        purge(deep)


def _go_back(folder: Path) -> None:
    """Forget the last segment that ended: it may hold the beginning of a failure."""
    deep, ends = folder / SPAN, segment_ends(folder / SPAN)
    drop_after(deep, ends[-2] if len(ends) > 1 else 0.0)
    now = last_state(deep)
    for path in (folder / PACKED).glob("*.npy"):
        if float(path.stem) > now * (1 + SAME):
            path.unlink()
