"""The command of proofs: verify."""

from __future__ import annotations

import json

from ...cli.options import AsJson


def verify(what: str | None = None, *, slow: bool = False, as_json: AsJson = False) -> int:
    """Prove it: a scene's error against run time, extremes, and in a checkout all else.

    Parameters
    ----------
    what
        extremes (what happens at the ends of what can be asked for), or a scene file: the error of its shares against
        run time. In a checkout of the repository also tracker (landing error against run time next to other trackers),
        problems, airflow, meshes, shares, coverage, tails, crowd (granules that meet, next to LIGGGHTS, DPMFoam,
        MPPICFoam and kinetic theory) and funnel, OpenFOAM's parcels next to a scene, and of a scene of which airflows
        are published, its airflow next to these. Default: all but crowd and funnel, which need LIGGGHTS.
        Reports go to runs/verify. Exit code 1 where a row of extremes is missed.
    slow
        tracker: finer settings, a computed time-resolved wake and 1e7 granules, most of an hour. airflow: every case,
        an hour or two of one core. extremes: 1e7 granules, dense feeds, more airflows, some 20 minutes. A scene: errors
        against the airflow of rung reference, and that on three grids. crowd: more
        replicates and variants, a quarter of an hour. funnel: more beads, and the paper's 35 g.
    as_json
        Print JSON instead of tables.
    """
    from functools import partial

    from ...runs.progress import live
    from . import runner

    with live(enabled=not as_json) as listener:
        reports = runner.prove(what, slow=slow, tell=partial(listener, "verify"))
    if as_json:
        print(json.dumps({name: report.data() for name, report in reports.items()}, indent=2))
    else:
        runner.show(reports)
    return runner.verdict_code(reports)
