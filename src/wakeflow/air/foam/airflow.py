"""One airflow from mesh to numbers."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...core.geometry import ForceDensity
from ...core.record import save
from .airflow_result import AirflowResult
from .case import FlowSpec
from .failure import disk_trouble_named
from .fallback_settings import climb, first_order_start
from .measure import measure
from .momentum_source import write_source
from .prepare import prepare_case
from .sanity import check_airflow, check_finite
from .steady import MOST, run_steady
from .time_resolved import run_time_resolved
from .watch import ProgressListener


def solve_airflow(
    spec: FlowSpec,
    msh: Path,
    folder: Path,
    *,
    start: Path | None = None,
    force: ForceDensity | None = None,
    listener: ProgressListener = lambda _: None,
    most: int = MOST,
) -> AirflowResult:
    """Solve the airflow in the case ``folder`` on the mesh file ``msh``; ``airflow.json`` there holds the result.

    Goes on from what an interrupted call left in ``folder``. ``start``: the case folder of any solved airflow to start
    from (best of the same bodies; another mesh, speed, size and Reynolds number are scaled). ``force``: on the air,
    beside that of the bodies; ``most``: iterations of a steady solution. ``listener`` gets a ``Progress`` several
    times a second; an exception it raises ends the solver. A numerical failure, or a solution that is not possible
    (:mod:`wakeflow.air.foam.sanity`), is tried again with safer settings (:mod:`wakeflow.air.foam.fallback_settings`);
    the result names those that served and what failed before. Raises MeshError for a mesh that checkMesh refuses;
    AirflowFailure (a FoamError) when OpenFOAM is missing or fails, when the disk is full, or when no settings serve.
    """
    begun = time.monotonic()
    log = folder / ("log.simpleFoam" if spec.stepping == "steady" else "log.pimpleFoam")
    with disk_trouble_named(folder):
        folder.mkdir(parents=True, exist_ok=True)

        def solve(how: FlowSpec, first_order: bool) -> AirflowResult:
            check = prepare_case(how, msh, folder)
            if force is not None:
                write_source(folder, force, spec.density)
            if first_order:
                first_order_start(how, folder, start, listener)
            steady = how.stepping == "steady"
            run = partial(run_steady, most=most) if steady else run_time_resolved
            verdict = run(how, folder, start=start, listener=listener)
            check_finite(folder)
            result = measure(how, folder, verdict, residuals=_last_residuals(log), mesh=check)
            return replace(result, checks={check.name: check.used for check in check_airflow(how, folder, result)})

        solved, settings, tried = climb(spec, folder, solve, log.name)
        result = replace(solved, settings=settings, attempts=tuple(tried), seconds=time.monotonic() - begun)
        save(folder / "airflow.json", result)
    return result


def _last_residuals(log: Path) -> dict[str, float]:
    """The initial residual of every field in the last iteration or step."""
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - 8000))
        text = stream.read().decode(errors="replace")
    return {name: float(value) for name, value in re.findall(r"Solving for (\w+), Initial residual = ([^,]+)", text)}
