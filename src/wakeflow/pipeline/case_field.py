"""From an OpenFOAM case to the field on triangles that the tracker reads."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from pathlib import Path

from ..field import FlowField
from ..foam.read import late_states

__all__ = ["case_field", "state_fields"]


def case_field(case: Path, time: str, density: float, *, half: bool) -> FlowField:
    """The field of the whole channel in a case: at ``time`` (as for ``FlowField.from_openfoam``), ``density`` kg/m3; of
    "states", which are no times, the mean.

    ``half``: the case is the right half of a symmetric channel, and its mirror image is added. A periodic field is
    stored as a mean and modes.
    """
    field = FlowField.from_openfoam(case, time="mean" if time == "states" else time, density=density)
    if half:
        field = field.mirrored()
    return field if field.period is None else field.compressed()


def state_fields(case: Path, density: float, *, half: bool) -> tuple[FlowField, ...]:
    """The late states of a steady airflow that does not settle, each a field as of :func:`case_field`; () of others.
    They are read together: what costs is the mesh, which is one.
    """
    if not late_states(case):
        return ()
    every = FlowField.from_openfoam(case, time="states", density=density)
    if half:
        every = every.mirrored()
    alone = replace(every, times=None)
    return tuple(alone.mapped(itemgetter(number)) for number in range(len(every.velocity)))
