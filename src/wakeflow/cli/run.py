"""The commands around one scene: run, plan, new, schema, report."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ..show.screen import has_screen, print_pairs, print_parts, warn
from .options import PACE, AsJson, Budget, Folder, Pace, Picture, Quiet, Settings, Threads, next_to, scene_and_folder

if TYPE_CHECKING:
    from ..scene import Scene

Stage = Literal["funnel", "mesh", "airflow", "tracks"]  # after which a run can stop


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

    machine, folder = scene_and_folder(scene, settings, gate, out)
    with live(enabled=not quiet, as_json=as_json) as listener:
        result = runs.run(
            machine, folder, until=until, near=near, workers=workers, listener=listener, planned=listener.planned,
            quick=gate.quick, budget=budget, **gate.how,
        )  # fmt: skip
    if as_json:
        print(json.dumps(result.table, indent=2))
    elif not quiet:
        from ..show.terminal import show_result

        show_result(result)


def plan(
    scene: Path,
    *,
    everything: Annotated[bool, Parameter(name="--all", negative="")] = False,
    picture: Picture = None,
    show: Annotated[bool, Parameter(name="--open", negative="")] = False,
    out: Path | None = None,
    until: Stage | None = None,
    workers: Threads = None,
    settings: Settings = (),
    gate: Pace = PACE,
    as_json: AsJson = False,
) -> None:
    """Say in ten lines what is flown, left out and doubtful and what it costs, and draw the machine with its measures.

    Starts nothing heavy. The drawing goes to runs/NAME-plan.png, beside the folder of the results, or to --picture.

    Parameters
    ----------
    scene
        A scene file (TOML).
    everything
        Print all that is used, each bound, what is left out and why, every stage and every warning.
    show
        Open the drawing.
    out, until, workers
        Taken as by run, so that its command line can be reused; a plan does not depend on them.
    as_json
        Print JSON, and draw only with --picture.
    """
    del until, workers
    from ..core.store import cache_root
    from ..runs.planned import make_plan
    from ..runs.progress import on_this_machine
    from ..scene import units_written
    from ..show.plan_words import cost_words, plan_lines, told_by_all, whole_plan

    machine, folder = scene_and_folder(scene, settings, gate, out)
    how = gate.how
    if gate.quick:
        from ..runs.time_budget import quick_settings

        machine, how = quick_settings(machine, how)
    made = make_plan(machine, **how)
    if as_json:
        print(json.dumps(made.summary(), indent=2))
    else:
        stages, runs = on_this_machine(made, cache_root())
        cost = cost_words(made, stages, runs)
        if everything:
            print_parts(whole_plan(made, stages))
            warn(made.warnings, [notice.grade.value for notice in made.notices], most=len(made.notices))
            print_parts([cost])
        else:
            print_pairs([*plan_lines(made, machine, cost, units_written(scene)), ("", told_by_all(made))])
    if picture is not None or not as_json:
        _draw(picture or next_to(folder, "-plan.png"), machine, scene, print_path=not as_json, show=show)


def _draw(path: Path, machine: Scene, scene: Path, *, print_path: bool, show: bool) -> None:
    """Draw what a scene file asks for, in the units that it writes; print the picture's path, and open it."""
    from ..scene import units_written
    from ..show.sketch import write_sketch

    write_sketch(path, machine, units_written(scene))
    if print_path:
        print(f"drawing: {path}")
    if show:
        _open(path)


def _open(path: Path) -> None:
    """Show a file in the program that the desktop has for it; where there is no screen, say so."""
    import webbrowser

    if not has_screen() or not webbrowser.open(path.absolute().as_uri()):
        print(f"no screen to open it on: {path}")


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


COMMANDS = (run, plan, new, schema, report)
