"""One airflow in three dimensions from mesh to numbers."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from ..core.record import save
from .airflow_result import AirflowResult
from .case import FlowSpec
from .case_fields import CaseFields
from .failure import disk_trouble_named
from .sanity import check_airflow
from .span_measure import measure_span
from .span_record import SpanRecord
from .span_run import SPAN, run_span
from .watch import ProgressListener

__all__ = ["solve_span"]


def solve_span(
    spec: FlowSpec,
    msh: Path,
    folder: Path,
    *,
    start: Path | None = None,
    listener: ProgressListener = lambda _: None,
    timeout: float | None = None,
) -> AirflowResult:
    """Solve the airflow of ``spec``, which has a span, in the case ``folder`` on the plane mesh ``msh``.

    ``airflow.json`` there holds the result, ``packed`` the snapshots. Arguments and failures as of
    :func:`wakeflow.foam.solve_airflow`; goes on from what an interrupted call left.
    """
    begun = time.monotonic()
    with disk_trouble_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        mesh = run_span(spec, msh, folder, start, listener, timeout)
        record = SpanRecord(folder, CaseFields(folder))
        result = measure_span(spec, record, folder / SPAN, seconds=time.monotonic() - begun)
        checks = {check.name: check.used for check in check_airflow(spec, folder, result)}
        result = replace(result, mesh=mesh, checks=checks)
        save(folder / "airflow.json", result)
    return result
