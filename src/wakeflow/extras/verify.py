"""Proof: the error of a scene against its run time, what happens at the ends of what can be asked for, and all else.

Comes in: a scene file, or the name of a proof.
Goes out: the reports of a checkout's room of proofs (``tests/proofs``), which needs no installation of its own.
May call it: the command line.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from ..cli.options import AsJson
from ..core.errors import SceneError

TESTS = Path(__file__).parents[3] / "tests"


def room(what: str) -> Any:
    """The module ``proofs.commands`` of a checkout. Raises SceneError in a wheel, which has none."""
    if not (TESTS / "proofs" / "commands.py").is_file():
        raise SceneError(f"{what}: needs a checkout of wakeflow's repository: the proofs are in its tests/proofs")
    if str(TESTS) not in sys.path:
        sys.path.append(str(TESTS))
    return import_module("proofs.commands")


def verify(what: str | None = None, *, slow: bool = False, as_json: AsJson = False) -> int:
    """Prove it: a scene's error against run time, extremes, all else. In a checkout of the repository.

    Parameters
    ----------
    what
        A scene file: the error of its shares against run time, next to OpenFOAM's parcels; of a scene of which airflows
        are published, its airflow next to these. Or extremes (what happens at the ends of what can be asked for),
        tracker (landing error against run time next to other trackers), problems, airflow, meshes, shares, coverage,
        tails, calibration, measured, collisions (granules that meet, next to LIGGGHTS, DPMFoam, MPPICFoam and kinetic
        theory) or funnel. Default: all but collisions and funnel, which need LIGGGHTS. Reports go to runs/verify.
        Exit code 1 where a row of extremes is missed.
    slow
        tracker: finer settings, a computed time-resolved wake and 1e7 granules, most of an hour. airflow: every case,
        an hour or two of one core. extremes: 1e7 granules, dense feeds, more airflows, some 20 minutes. A scene: errors
        against the airflow of rung reference, and that on three grids. collisions: more
        replicates and variants, a quarter of an hour. funnel: more beads, and the paper's 35 g.
    as_json
        Print JSON instead of tables.
    """
    from functools import partial

    from ..runs.progress import live

    proofs = room("verify" if what is None else f"verify {what}")
    with live(enabled=not as_json) as listener:
        reports = proofs.prove(what, slow=slow, tell=partial(listener, "verify"))
    if as_json:
        print(json.dumps({name: report.data() for name, report in reports.items()}, indent=2))
    else:
        proofs.show(reports)
    return int(any(report.missed for report in reports.values()))  # of extremes, or a gate that is not known to fail


COMMANDS = (f"{__name__}:verify",)
