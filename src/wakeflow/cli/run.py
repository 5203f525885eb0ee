"""The commands around one scene: run, new, schema, report; and what examines: doctor."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .options import PACE, AsJson, Budget, Folder, Pace, Quiet, Settings, Stage, Threads, scene_and_folder


def run(
    scene: Path,
    *,
    out: Folder = None,
    until: Stage | None = None,
    settings: Settings = (),
    gate: Pace = PACE,
    budget: Budget = None,
    near: Path | None = None,
    workers: Threads = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Compute where each fraction of a scene lands; results in runs/NAME and what was changed (or --out).

    With --target-error the granules, the tolerance, the mesh and the averages are chosen so that computing alone knows
    every bin's share so well, in rounds that say what they buy; what computing cannot bring there is said after the
    first, with what to measure or switch on.

    Parameters
    ----------
    scene
        A scene file (TOML); make one with: wakeflow new
    until
        Stop after this stage.
    near
        Folder of a run whose airflow this one's is solved on from, instead of from rest.
    as_json
        Print result.json instead of tables; on stderr how far the run is, as JSON lines.
    """
    from .. import runs
    from ..runs.progress import live

    asked, folder = scene_and_folder(scene, settings, gate, out)
    with live(enabled=not quiet, as_json=as_json) as listener:
        result = runs.run(
            asked, folder, until=until, near=near, workers=workers, listener=listener, planned=listener.planned,
            quick=gate.quick, budget=budget, **gate.how,
        )  # fmt: skip
    if as_json:
        print(json.dumps(result.table, indent=2))
    elif not quiet:
        from .show_result import show_result

        show_result(result)


def new(kind: str, path: Path | None = None, *, overwrite: bool = False) -> None:
    """Write a commented scene file to start from.

    Parameters
    ----------
    kind
        One of: rhombus, prism, labyrinth, cascade, aspirator, fan, zigzag, vacuum, funnel, wheat-straw-dust,
        rocking, sticky.
    path
        Where to write it; default KIND.toml here.
    overwrite
        Replace an existing file.
    """
    from ..scene.changes import write_template

    target = path or Path(f"{kind}.toml")
    write_template(kind, target, overwrite=overwrite)
    print(f"{target} written; run it with: wakeflow run {shlex.quote(str(target))}")


def schema() -> None:
    """Print the JSON schema of scene files, for editors."""
    from ..scene.schema import scene_schema

    print(json.dumps(scene_schema(), indent=2))


def doctor(*, as_json: AsJson = False) -> int:
    """Try in small what a run does; say which versions did it, and the command that mends what fails.

    Parameters
    ----------
    as_json
        Print JSON.
    """
    from dataclasses import asdict

    from rich.console import Console

    from . import doctor as examiner

    with Console(stderr=True).status("trying what a run does; the tracker's first compilation takes a minute or two"):
        findings = examiner.examine()
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        Console().print(examiner.table(findings))
    return examiner.exit_code(findings)


def report(
    run_folder: Path, *, pdf: Annotated[bool, Parameter(negative="", help="Write every figure as PDF too.")] = False
) -> None:
    """Draw figures, tables and report.html of a finished run again.

    Parameters
    ----------
    run_folder
        A folder that ``wakeflow run`` wrote.
    """
    from .. import runs

    print(runs.report_again(run_folder, pdf=pdf))


COMMANDS = (run, new, schema, doctor, report)
