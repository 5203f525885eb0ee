"""The command line. Parses, shows progress, prints; everything else is a call into the package."""

from __future__ import annotations

import errno
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter, UnusedCliTokensError

from .commands import MANY
from .core.errors import ProgramError, SceneError, WakeflowError
from .looking import LOOKING
from .options import Fidelity, Folder, Forced, Quiet, Settings, Stage, Target, Threads
from .scene.overrides import changes_of, switches_of, unquoted

__all__ = ["app", "main"]

INTERRUPTED = 130  # exit code, as a shell gives it for Ctrl-C

app = App(
    name="wakeflow",
    help="Where each granule fraction lands behind a vibrating rhombus or prism in a vertical airflow.",
    version_flags=["--version"],
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
for _command in (*LOOKING, *MANY):
    app.command(_command)


def _version() -> str:
    from . import __version__

    return str(__version__)


app.version = _version
app.register_install_completion_command(help="Install completion of commands and options for your shell.")


@app.command
def run(
    scene: Path,
    *,
    out: Folder = None,
    until: Stage | None = None,
    rung: Fidelity = None,
    settings: Settings = [],  # noqa: B006
    force: Forced = [],  # noqa: B006
    target_error: Target = None,
    near: Path | None = None,
    workers: Threads = None,
    quiet: Quiet = False,
    as_json: Annotated[bool, Parameter(name="--json")] = False,
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
    from . import runs
    from .scene import Scene
    from .scene.changes import run_folder
    from .terminal import live

    changes, switches = changes_of(settings), switches_of(force)
    asked = Scene.load(scene, changes)
    options = {"rung": rung, **switches, "target-error": target_error}
    with live(enabled=not quiet, as_json=as_json) as listener:
        result = runs.run(
            asked, out or Path("runs", run_folder(scene.stem, asked, changes, options)), until=until, rung=rung,
            force=switches, target_error=target_error, near=near, workers=workers, listener=listener,
            planned=listener.planned,
        )  # fmt: skip
    if as_json:
        print(json.dumps(result.table, indent=2))
    elif not quiet:
        from .terminal import show_result

        show_result(result)


@app.command
def new(kind: str, path: Path | None = None, *, overwrite: bool = False) -> None:
    """Write a commented scene file to start from.

    Parameters
    ----------
    kind
        One of: rhombus, prism, labyrinth, aspirator, vacuum, funnel, wheat-straw-dust.
    path
        Where to write it; default KIND.toml here.
    overwrite
        Replace an existing file.
    """
    from .scene.templates import write_template

    target = path or Path(f"{kind}.toml")
    write_template(kind, target, overwrite=overwrite)
    print(f"{target} written; run it with: wakeflow run {shlex.quote(str(target))}")


@app.command
def schema() -> None:
    """Print the JSON schema of scene files, for editors."""
    from .scene.schema import scene_schema

    print(json.dumps(scene_schema(), indent=2))


@app.command
def doctor(*, as_json: Annotated[bool, Parameter(name="--json")] = False) -> int:
    """Say what is installed, at which version, and the command that mends what is not.

    Parameters
    ----------
    as_json
        Print JSON.
    """
    from dataclasses import asdict

    from rich.console import Console

    from . import doctor as examiner

    findings = examiner.examine()
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        Console().print(examiner.table(findings))
    return examiner.exit_code(findings)


@app.command
def report(
    run_folder: Path, *, pdf: Annotated[bool, Parameter(negative="", help="Write every figure as PDF too.")] = False
) -> None:
    """Draw figures, tables and report.html of a finished run again.

    Parameters
    ----------
    run_folder
        A folder that ``wakeflow run`` wrote.
    """
    from . import runs

    print(runs.report_again(run_folder, pdf=pdf))


@app.command
def verify(
    what: str | None = None, *, slow: bool = False, as_json: Annotated[bool, Parameter(name="--json")] = False
) -> int:
    """Prove it: exact problems, landing error against run time beside other trackers, airflow beside published values.

    Parameters
    ----------
    what
        tracker, problems, airflow, meshes, shares, extremes (what happens at the ends of what can be asked for), crowd
        or funnel; or a scene file: its airflow beside published values, or where nothing is published the error of its
        shares against run time. Default: all but crowd (granules that meet, beside LIGGGHTS, DPMFoam, MPPICFoam and
        kinetic theory) and funnel, which need LIGGGHTS. Reports go to runs/verify. Exit code 1 where a row of extremes
        is missed.
    slow
        tracker: finer settings, a computed time-resolved wake and 1e7 granules, most of an hour. airflow: every case,
        an hour or two of one core. extremes: 1e7 granules, dense feeds, more airflows, some 20 minutes. A scene: its
        own airflow instead of a draft, and that on three grids. crowd: more
        replicates and variants, a quarter of an hour. funnel: more beads, and the paper's 35 g.
    as_json
        Print JSON instead of tables.
    """
    from functools import partial

    from .terminal import live
    from .verify import runner

    with live(enabled=not as_json) as listener:
        reports = runner.prove(what, slow=slow, tell=partial(listener, "verify"))
    if as_json:
        print(json.dumps(reports, indent=2))
    else:
        runner.show(reports)
    return runner.verdict_code(reports)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, by default with the process's own arguments.

    Returns the exit code: 0 done, 2 wrong input, 3 an outside program failed, 130 interrupted.
    """
    try:
        code = app(arguments, exit_on_error=False, print_error=False)
    except CycloptsError as problem:
        words = sys.argv[1:] if arguments is None else arguments
        parted = unquoted(words) if isinstance(problem, UnusedCliTokensError) else None
        _complain(parted or str(problem).strip().splitlines()[-1])
        return SceneError.exit_code
    except WakeflowError as problem:
        _complain(str(problem))
        if isinstance(problem, ProgramError):
            _details(problem)
        return problem.exit_code
    except BrokenPipeError:
        sys.stderr.close()  # the reader left; nothing more can be said
        return 0
    except OSError as problem:
        full = problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        place = f"{problem.filename}: " if problem.filename else ""
        _complain(
            f"{place}{problem.strerror}; {'free some space or ' if full else ''}choose another --out and WAKEFLOW_CACHE"
        )
        return ProgramError.exit_code if full else SceneError.exit_code
    except KeyboardInterrupt:
        _complain("interrupted; what is finished is kept, the same command goes on")
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def _complain(text: str) -> None:
    print(f"wakeflow: {text}", file=sys.stderr)


def _details(problem: ProgramError) -> None:
    for label, text in (("command", problem.command), ("log", problem.log), ("last lines", problem.tail)):
        if text:
            body = str(text)
            print(f"  {label}: {body}" if "\n" not in body else f"  {label}:\n{body}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
