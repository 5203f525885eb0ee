"""From an OpenFOAM case to the field on triangles that the tracker reads."""

from __future__ import annotations

from pathlib import Path

from ..field import FlowField

__all__ = ["case_field"]


def case_field(case: Path, time: str, density: float, *, half: bool) -> FlowField:
    """The field of the whole channel in a case: at ``time`` (as for ``FlowField.from_openfoam``), ``density`` kg/m3.

    ``half``: the case is the right half of a symmetric channel, and its mirror image is added. A periodic field is
    stored as a mean and modes.
    """
    field = FlowField.from_openfoam(case, time=time, density=density)
    if half:
        field = field.mirrored()
    return field if field.period is None else field.compressed()
