"""A steady airflow under a force: solved on from the airflow without it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..core.boxes import ForceDensity
from .airflow import solve_airflow
from .airflow_result import AirflowResult
from .case import FlowSpec
from .failure import disk_trouble_named
from .ladder import schemes_in
from .momentum_source import write_source
from .prepare import prepare_case
from .watch import ProgressListener

__all__ = ["solve_loaded"]


def solve_loaded(
    spec: FlowSpec,
    msh: Path,
    folder: Path,
    force: ForceDensity,
    *,
    start: Path,
    listener: ProgressListener = lambda _: None,
    timeout: float | None = None,
) -> AirflowResult:
    """Solve the steady airflow ``spec`` under ``force`` in the case ``folder``, from the case ``start`` of the same
    airflow without it, by the same stopping rule and with the settings that served there, so that the force alone is
    what changes; goes on from what an interrupted call left.

    Arguments and errors as of :func:`wakeflow.foam.airflow.solve_airflow`.
    """
    with disk_trouble_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        spec = replace(spec, settings=schemes_in(start))
        prepare_case(replace(spec, stepping="steady"), msh, folder)
        write_source(folder, force, spec.density)
    return solve_airflow(spec, msh, folder, start=start, listener=listener, timeout=timeout)
