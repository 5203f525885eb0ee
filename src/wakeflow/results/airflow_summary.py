"""What is known of an airflow, with what other grids and the near wake's dust say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..core.number import Number
from ..foam.airflow_result import SuctionZone
from ..pipeline.airflow import Airflow, GridStudy, ResidenceTimes, WakeEnds

__all__ = ["Airflow", "GridStudy", "SuctionZone", "with_mesh_error", "with_residence"]


def with_mesh_error(airflow: Airflow, studies: Sequence[GridStudy]) -> Airflow:
    """The airflow with the mesh's part in the intervals of what several grids were compared in. A best estimate keeps
    its own: its grids are those of one end.
    """
    found = {study.quantity: study for study in studies if airflow.ends is None}
    return replace(
        airflow,
        cd=_on_meshes(airflow.cd, found.get("cd")),
        cp_base=_on_meshes(airflow.cp_base, found.get("cp_base")),
    )


def _on_meshes(number: Number | None, study: GridStudy | None) -> Number | None:
    """A number with the wider of its own interval and that of a comparison of grids, which holds it."""
    if number is None or study is None:
        return number
    own = number if number.known else study
    return replace(number, low=min(own.low, study.low), high=max(own.high, study.high))


def with_residence(airflow: Airflow, found: ResidenceTimes | None) -> Airflow:
    """The airflow with the near wakes' residence times; as it is without."""
    if found is None:
        return airflow
    ends = airflow.ends and WakeEnds(
        replace(airflow.ends.steady, residence_time=found.steady),
        replace(airflow.ends.time_resolved, residence_time=found.time_resolved),
    )
    return replace(airflow, residence_time=found.answer, ends=ends)
