"""One airflow from mesh to measured numbers: prepare, solve, measure. Goes on where an interrupted call stopped."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import FoamError
from ..process import capture
from .case import INSTALL, FlowSpec, environment
from .measure import measure, to_table
from .solve import Progress, prepare, run_steady, run_time_resolved

__all__ = ["solve_airflow", "version"]


def solve_airflow(
    spec: FlowSpec, msh: Path, case: Path, *, listener: Callable[[Progress], None] = lambda _: None
) -> dict[str, Any]:
    """Compute the airflow in the folder ``case`` and return what was measured, as JSON-able numbers.

    Raises MeshError when OpenFOAM refuses the mesh, FoamError when it is missing, fails or diverges.
    """
    started = time.monotonic()
    check = prepare(spec, msh, case)
    run = run_steady if spec.stepping == "steady" else run_time_resolved
    verdict = run(spec, case, listener=listener)
    return to_table(measure(spec, case, verdict, seconds=time.monotonic() - started, mesh=asdict(check)))


@cache
def version() -> str:
    """Version and patch of the installed OpenFOAM, "1912 (patch=200626)". Raises FoamError when there is none."""
    code, text = capture(["simpleFoam", "-help"], env=environment())
    if code != 0:
        raise FoamError(
            f"OpenFOAM's simpleFoam does not start; {INSTALL}", command="simpleFoam -help", tail=text[-500:]
        )
    found = re.search(r"OpenFOAM-\s*\(?v?(\w+)\)?.*?Build:\s*(\S.*?)\s*$", text, re.S | re.M)
    return f"{found[1]} {found[2]}" if found else " ".join(text.split())[-80:]
