"""One airflow from mesh to numbers."""

from __future__ import annotations

import math
import re
import time
from dataclasses import asdict
from pathlib import Path

from ..errors import FoamError
from ..files import write_json
from .case import FlowSpec
from .measure import AirflowResult, measure
from .shedding import run_time_resolved
from .solve import Listener, prepare, run_steady

__all__ = ["AirflowResult", "solve_airflow"]

LEAK = 1e-3  # inflow less outflow over inflow: more than this is not a solution


def solve_airflow(
    spec: FlowSpec,
    msh: Path,
    folder: Path,
    *,
    start: Path | None = None,
    listener: Listener = lambda _: None,
    timeout: float | None = None,
) -> AirflowResult:
    """Solve the airflow in the case ``folder`` on the mesh file ``msh``; ``airflow.json`` there holds the result.

    Goes on from what an interrupted call left in ``folder``. ``start``: the case folder of any solved airflow
    to start from (best of the same bodies; another mesh, speed, size and Reynolds number are scaled). ``listener`` gets
    a :class:`Progress` several times a second; an exception it raises ends the solver. ``timeout`` (s) bounds each program. Raises MeshError for a mesh that checkMesh refuses;
    FoamError when OpenFOAM is missing, fails, diverges, or leaves a solution that does not conserve mass.
    """
    begun = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    check = prepare(spec, msh, folder)
    if spec.stepping == "steady":
        verdict = run_steady(spec, folder, start=start, listener=listener, timeout=timeout)
        log = folder / "log.simpleFoam"
    else:
        verdict = run_time_resolved(spec, folder, start=start, listener=listener, timeout=timeout)
        log = folder / "log.pimpleFoam"
    result = measure(
        spec,
        folder,
        verdict,
        seconds=time.monotonic() - begun,
        residuals=_last_residuals(log),
        mesh={
            "non_orthogonality": check.non_orthogonality,
            "mean_non_orthogonality": check.mean_non_orthogonality,
            "skewness": check.skewness,
        },
    )
    _refuse_nonsense(result, log)
    write_json(folder / "airflow.json", asdict(result))
    return result


def _last_residuals(log: Path) -> dict[str, float]:
    """The initial residual of every field in the last iteration or step."""
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - 8000))
        text = stream.read().decode(errors="replace")
    return {name: float(value) for name, value in re.findall(r"Solving for (\w+), Initial residual = ([^,]+)", text)}


def _refuse_nonsense(result: AirflowResult, log: Path) -> None:
    numbers = [result.cd.value, result.cp_base.value, result.pressure_drop, result.flow_rate, result.mass_error]
    if not all(math.isfinite(number) for number in numbers):
        raise FoamError(f"the airflow has values that are not finite; log: {log}", log=log)
    if abs(result.mass_error) > LEAK:
        raise FoamError(
            f"the airflow loses {100 * result.mass_error:.2g} % of its mass between inlet and outlet; log: {log}",
            log=log,
        )
