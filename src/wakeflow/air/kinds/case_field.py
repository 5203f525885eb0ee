"""The field on triangles that granules fly through, made of OpenFOAM's solutions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

from ..field import EMPTY, FlowField
from ..field.combined import cross_faded
from ..foam.case import FlowSpec
from ..foam.read import CaseFields, late_states
from ..foam.spanwise.span_record import SpanRecord, lead_of, read_layers


# -- From an OpenFOAM case to the field on triangles that the tracker reads --------------------------------------------
def case_field(case: Path, time: str, density: float, *, half: bool) -> FlowField:
    """The field of the whole channel in a case: at ``time`` (as for ``FlowField.from_openfoam``), ``density`` kg/m3; of
    "states", which are no times, the mean.

    ``half``: the case is the right half of a symmetric channel, and its mirror image is added. A periodic field is
    stored as a mean and modes.
    """
    field = FlowField.from_openfoam(case, time="mean" if time == "states" else time, density=density)
    if half:
        field = field.mirrored()
    return field.compressed() if field.period else field


def state_fields(case: Path, density: float, *, half: bool) -> tuple[FlowField, ...]:
    """The late states of a steady airflow that does not settle, each a field as of :func:`case_field`; () of others.
    They are read together: what costs is the mesh, which is one.
    """
    if not late_states(case):
        return ()
    every = FlowField.from_openfoam(case, time="states", density=density)
    if half:
        every = every.mirrored()
    alone = replace(every, times=EMPTY)
    return tuple(alone.mapped(itemgetter(number)) for number in range(len(every.velocity)))


# -- From the snapshots of an airflow in three dimensions to the plane fields that the tracker reads -------------------
def layer_file(folder: Path, number: int) -> Path:
    """Where the field of the ``number``-th of the layers that are flown in is kept."""
    return folder / f"layer-{number}.npz"


def save_layers(case: Path, folder: Path, spec: FlowSpec, begin: float, flown: Sequence[int]) -> None:
    """Write the periodic fields, from ``begin`` (s) on, of the layers that are ``flown`` into ``folder``."""
    record = SpanRecord(case, CaseFields(case))
    for number, layer in enumerate(flown):
        (arrays,) = read_layers(record, [layer], begin, spec.density)
        field = FlowField.from_arrays(**arrays)
        cross_faded(field, lead_of(spec, field.time_axis.times)).save(layer_file(folder, number))
