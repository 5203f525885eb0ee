"""One airflow in three dimensions from mesh to numbers."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path

from ..core.files import write_json
from .case import FlowSpec
from .case_fields import CaseFields
from .failure import disk_trouble_named
from .measure import AirflowResult
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
        check = run_span(spec, msh, folder, start=start, listener=listener, timeout=timeout)
        record = SpanRecord(folder, CaseFields(folder))
        result = measure_span(spec, record, folder / SPAN, seconds=time.monotonic() - begun)
        quality = {
            "non_orthogonality": check.non_orthogonality,
            "mean_non_orthogonality": check.mean_non_orthogonality,
            "skewness": check.skewness,
        }
        checks = check_airflow(spec, folder, result)
        result = replace(result, mesh=quality, checks={check.name: check.used for check in checks})
        write_json(folder / "airflow.json", asdict(result))
    return result
