"""One airflow from mesh to numbers, with safer settings, tried in order, where it fails numerically.

The order is that of the accuracy they give up: nothing for the first three, then an order. What was tried is kept with
the case.
"""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from ...core.errors import SceneError
from ...core.files import write_json
from ...core.geometry import ForceDensity
from ...core.record import load, save
from .airflow_result import AirflowResult, Attempt
from .case import FlowSpec, write_parameters
from .measure import measure
from .momentum_source import write_source
from .programs import AirflowFailure, disk_trouble_named
from .read import LOOP
from .sanity import check_airflow, check_finite, is_sane
from .solver import PHASE, drop_after, ended_early, last_state, run_segment, states
from .start import CHECKED, first_step, prepare_case, start_in_time
from .steady import MOST, run_steady
from .time_resolved import run_time_resolved, watch_over
from .watch import ProgressListener

Result = TypeVar("Result")
FALLBACKS = {
    "normal": "the usual schemes",
    "careful": "a smaller Courant number and a second outer corrector, or stronger relaxation; fully limited gradients",
    "first-order-start": "a first-order start, then the careful settings",
    "first-order": "first-order schemes throughout",
}
ATTEMPTS, STARTED = "attempts.json", "first_order_start.json"
# Length of a first-order start. Chosen: the impulse of the start has left the near wake by then.
START_ITERATIONS = 300  # of a steady run
START_TIME = 10.0  # of a time-resolved run, in convective times


def climb(
    spec: FlowSpec, folder: Path, solve: Callable[[FlowSpec, bool], Result], log: str
) -> tuple[Result, str, list[Attempt]]:
    """Call ``solve(spec, first_order_start)`` with the settings of LADDER from ``spec.settings`` on, until one serves.

    Returns its result, the settings that served, and the attempts that failed. ``log``: name of the solver's log, kept
    as failed-N.log. Failures that are not numerical go through; the same call goes on at the same settings. Raises
    AirflowFailure naming all that was tried when nothing serves, SceneError for unknown settings.
    """
    names = list(FALLBACKS)
    if spec.settings not in names:
        raise SceneError(f"settings = {spec.settings!r}: unknown (known: {', '.join(names)})")
    names = names[names.index(spec.settings) :]
    tried = _attempts_so_far(folder, log)
    while True:
        settings = names[len(tried)]
        try:
            return solve(replace(spec, settings=_schemes(settings)), settings == "first-order-start"), settings, tried
        except AirflowFailure as failure:
            if not failure.cause.numerical:
                raise
            tried.append(Attempt(settings, failure.cause.word, str(failure).split("; log:")[0]))
            if len(tried) == len(names):
                _put_away(folder, log, tried)
                _clear(folder)  # the next call starts anew
                raise _all_failed(failure, folder, tried) from None
            _go_back(folder, log, tried, _sound_state(spec, folder, names[len(tried)]))


def schemes_in(case: Path) -> str:
    """The settings of LADDER with whose schemes the airflow in the folder ``case`` was solved in the end."""
    return _schemes(load(AirflowResult, case / "airflow.json").settings or "normal")


def _schemes(settings: str) -> str:
    return "careful" if settings == "first-order-start" else settings


def _attempts_so_far(folder: Path, log: str) -> list[Attempt]:
    path = folder / ATTEMPTS
    if not path.exists():
        return []
    known = json.loads(path.read_text())
    tried = [Attempt(**row) for row in known["attempts"]]
    if known["back_to"] is not None:  # interrupted while it went back
        _go_back(folder, log, tried, known["back_to"])
    return tried


def _put_away(folder: Path, log: str, tried: list[Attempt]) -> None:
    """Keep the log of the last attempt as failed-N.log."""
    if (folder / log).exists():
        (folder / log).replace(folder / f"failed-{len(tried)}.log")


def _all_failed(failure: AirflowFailure, folder: Path, tried: list[Attempt]) -> AirflowFailure:
    log = folder / f"failed-{len(tried)}.log"
    by_cause: dict[str, list[str]] = {}
    for attempt in tried:
        by_cause.setdefault(attempt.message, []).append(attempt.settings)
    said = "; ".join(f"{', '.join(settings)}: {message}" for message, settings in by_cause.items())
    return AirflowFailure(
        failure.cause,
        f"the airflow failed with all settings ({said}): check the scene's sizes and speed, or use a finer mesh; "
        f"log: {log}",
        command=failure.command,
        log=log,
        tail=failure.tail,
    )


def warning(settings: str, attempts: Sequence[Attempt]) -> str:
    """A line that says which settings served and why not the usual ones; empty when those did."""
    if settings == "normal":
        return ""
    lower = "; first order: wakes are smeared, drag and suction less certain" if settings == "first-order" else ""
    failed = f" after {', '.join(f'{a.settings} {a.cause}' for a in attempts)}" if attempts else ""
    return f"airflow solved with {settings} settings ({FALLBACKS[settings]}){failed}{lower}"


def first_order_start(spec: FlowSpec, folder: Path, start: Path | None, listener: ProgressListener) -> None:
    """Bring a case through its start with first-order schemes; the caller writes the parameters that follow.

    300 iterations, or ten convective times. Does nothing when it was done before.
    """
    if (folder / STARTED).exists():
        return
    steady = spec.stepping == "steady"
    end = START_ITERATIONS if steady else START_TIME * spec.convective_time
    drop_after(folder, last_state(folder))
    if not steady and not last_state(folder):
        start_in_time(spec, folder, start)
    write_parameters(folder, replace(spec, settings="first-order").parameters())
    watch = watch_over(spec, folder, "steady" if steady else "first-order start", listener, end)
    if not ended_early(folder):  # and was interrupted before it said so
        program = "simpleFoam" if steady else "pimpleFoam"
        run_segment(folder, program, end, {"deltaT": 1.0 if steady else first_step(spec)}, watch)
    write_parameters(folder, spec.parameters())
    write_json(folder / STARTED, {"end": end})


def _sound_state(spec: FlowSpec, folder: Path, settings: str) -> float:
    """Where ``settings`` should start (s, or iterations): the last sound end of a segment of a time-resolved run, else
    0, the beginning.

    Iterations that diverge have passed no state worth keeping, and first-order schemes must not share statistics with
    others; only the careful settings, as accurate as the normal ones, go on.
    """
    if settings != "careful" or spec.stepping != "time-resolved":
        return 0.0
    older = reversed(states(folder)[:-1])  # the last may hold the beginning of the end
    return next((float(path.name) for path in older if is_sane(spec, folder, path)), 0.0)


def _go_back(folder: Path, log: str, tried: list[Attempt], time: float) -> None:
    """Bring the case back to the end ``time`` of a segment, or to the beginning; what is to be done is noted first, so
    that an interruption changes nothing.
    """
    rows = [asdict(attempt) for attempt in tried]
    write_json(folder / ATTEMPTS, {"attempts": rows, "back_to": time})
    _put_away(folder, log, tried)
    if time > 0:
        drop_after(folder, time)
        for name in (PHASE, LOOP):
            (folder / name).unlink(missing_ok=True)
    else:
        _clear(folder, ATTEMPTS)
    write_json(folder / ATTEMPTS, {"attempts": rows, "back_to": None})


def _clear(folder: Path, *kept: str) -> None:
    """Remove everything but the mesh, the logs of failed attempts, and what ``kept`` names."""
    for path in folder.iterdir():
        if path.name in ("constant", CHECKED, *kept) or path.name.startswith(("failed-", "log.")):
            continue
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


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
    (:mod:`wakeflow.air.foam.sanity`), is tried again with safer settings (:mod:`wakeflow.air.foam.airflow`);
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
