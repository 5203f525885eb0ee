"""From the snapshots of an airflow in three dimensions to the plane fields that the tracker reads, a layer each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..core.errors import known
from ..field import FlowField
from ..field.cross_fade import cross_faded
from ..foam.case import FlowSpec
from ..foam.case_fields import CaseFields
from ..foam.span_read import lead_of, read_layers
from ..foam.span_record import SpanRecord

__all__ = ["layer_field", "layer_file", "save_layers"]


def layer_file(folder: Path, number: int) -> Path:
    """Where the field of the ``number``-th of the layers that are flown in is kept."""
    return folder / f"layer-{number}.npz"


def save_layers(case: Path, folder: Path, spec: FlowSpec, flown: Sequence[int]) -> None:
    """Write the periodic fields of the layers that are ``flown`` into ``folder``, one at a time."""
    record = SpanRecord(case, CaseFields(case))
    begin = known(spec.span).start_up * spec.convective_time
    for number, layer in enumerate(flown):
        (arrays,) = read_layers(record, [layer], begin, spec.density)
        field = FlowField.from_arrays(**arrays)
        cross_faded(field, lead_of(spec, known(field.times))).save(layer_file(folder, number))


def layer_field(folder: Path, number: int) -> FlowField:
    """The field of one of the layers that :func:`save_layers` wrote."""
    return FlowField.load(layer_file(folder, number))
