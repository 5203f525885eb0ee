"""Safer settings, tried in order when an airflow fails numerically; what was tried is kept with the case.

The order is that of the accuracy they give up: nothing for the first three, then an order.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TypeVar

from ..core.errors import SceneError
from ..core.files import write_json
from .case import FlowSpec, write_parameters
from .case_fields import time_folders
from .failure import AirflowFailure, Attempt
from .prepare import CHECKED
from .read import LOOP
from .sanity import is_sane
from .solver import PHASE, SAVE_EVERY, run_solver
from .start import first_step, perturb, start_from
from .time_resolved import COLLAPSED, RECORDED
from .watch import ProgressListener, Watch

__all__ = ["LADDER", "climb", "first_order_start", "warning"]

Result = TypeVar("Result")
LADDER = {
    "normal": "the usual schemes",
    "careful": "a smaller Courant number and a second outer corrector, or stronger relaxation; fully limited gradients",
    "first-order-start": "a first-order start, then the careful settings",
    "first-order": "first-order schemes throughout",
}
ATTEMPTS, STARTED = "attempts.json", "first_order_start.json"
# Length of a first-order start. Chosen: the impulse of the start has left the near wake by then.
START_ITERATIONS = 300  # of a steady run
START_TIME = 10.0  # of a time-resolved run, in convective times
SPARE = 1000  # iterations or convective times beyond: the file "stop", not OpenFOAM's endTime, ends the start


def climb(
    spec: FlowSpec, folder: Path, solve: Callable[[FlowSpec, bool], Result], log: str
) -> tuple[Result, str, list[Attempt]]:
    """Call ``solve(spec, first_order_start)`` with the settings of LADDER from ``spec.settings`` on, until one serves.

    Returns its result, the settings that served, and the attempts that failed. ``log``: name of the solver's log, kept
    as failed-N.log. Failures that are not numerical go through; the same call goes on at the same settings. Raises
    AirflowFailure naming all that was tried when nothing serves, SceneError for unknown settings.
    """
    names = list(LADDER)
    if spec.settings not in names:
        raise SceneError(f"settings = {spec.settings!r}: unknown (known: {', '.join(names)})")
    names = names[names.index(spec.settings) :]
    tried = _attempts_so_far(folder)
    while True:
        settings = names[len(tried)]
        known = "careful" if settings == "first-order-start" else settings
        try:
            return solve(replace(spec, settings=known), settings == "first-order-start"), settings, tried
        except AirflowFailure as failure:
            if not failure.cause.numerical:
                raise
            tried.append(Attempt(settings, failure.cause.word, str(failure).split("; log:")[0]))
            if (folder / log).exists():
                (folder / log).replace(folder / f"failed-{len(tried)}.log")
            if len(tried) == len(names):
                _clear(folder)  # the next call starts anew
                raise _all_failed(failure, folder, tried) from None
            _set_back(spec, folder, names[len(tried)])
            write_json(folder / ATTEMPTS, [asdict(attempt) for attempt in tried])


def _attempts_so_far(folder: Path) -> list[Attempt]:
    path = folder / ATTEMPTS
    return [Attempt(**row) for row in json.loads(path.read_text())] if path.exists() else []


def _all_failed(failure: AirflowFailure, folder: Path, tried: list[Attempt]) -> AirflowFailure:
    log = folder / f"failed-{len(tried)}.log"
    said = "; ".join(f"{attempt.settings}: {attempt.message}" for attempt in tried)
    return AirflowFailure(
        failure.cause,
        f"the airflow failed with all settings ({said}): check the scene's sizes and speed, or use a finer mesh; "
        f"log: {log}",
        command=failure.command,
        log=log,
        tail=failure.tail,
    )


def warning(settings: str, attempts: list[Attempt]) -> str | None:
    """A line that says which settings served and why not the usual ones; None when those did."""
    if settings == "normal":
        return None
    lower = "; first order: wakes are smeared, drag and suction less certain" if settings == "first-order" else ""
    failed = f" after {', '.join(f'{a.settings} {a.cause}' for a in attempts)}" if attempts else ""
    return f"airflow solved with {settings} settings ({LADDER[settings]}){failed}{lower}"


def first_order_start(
    spec: FlowSpec, folder: Path, start: Path | None, listener: ProgressListener, timeout: float | None
) -> None:
    """Bring a case through its start with first-order schemes; the caller writes the parameters that follow.

    300 iterations, or ten convective times. Does nothing when it was done before.
    """
    if (folder / STARTED).exists():
        return
    steady = spec.stepping == "steady"
    scale = 1.0 if steady else spec.convective_time
    end = START_ITERATIONS if steady else START_TIME * scale
    if not steady and not time_folders(folder):
        start_from(spec, folder, start)
        perturb(spec, folder)
    first = 1.0 if steady else first_step(spec)
    write_parameters(folder, {
        **replace(spec, settings="first-order").parameters(), "startFrom": "latestTime", "endTime": end + SPARE * scale,
        "deltaT": first, "writeControl": "clockTime", "writeInterval": SAVE_EVERY, "purgeWrite": 2,
    })  # fmt: skip
    watch = Watch(
        folder, "steady" if steady else "first-order start", listener, lambda rows: bool(rows[-1, 0] >= end),
        expected=end, least_step=0.0 if steady else COLLAPSED * scale,
    )  # fmt: skip
    run_solver(folder, "simpleFoam" if steady else "pimpleFoam", watch, timeout)
    write_parameters(folder, spec.parameters())
    write_json(folder / STARTED, {"end": end})


def _set_back(spec: FlowSpec, folder: Path, settings: str) -> None:
    """Go back to where ``settings`` should start: the last sound state of a time-resolved run, else the beginning.

    Iterations that diverge have passed no state worth keeping, and first-order schemes must not share statistics with
    others; only the careful settings, as accurate as the normal ones, go on.
    """
    if settings == "careful" and spec.stepping == "time-resolved":
        folders = time_folders(folder)
        older = reversed(folders[:-1])  # the last may hold the beginning of the end
        sound = next((path for path in older if is_sane(spec, folder, path)), None)
        if sound is not None:
            for path in folders[folders.index(sound) + 1 :]:
                shutil.rmtree(path)
            for name in (PHASE, LOOP, RECORDED):
                (folder / name).unlink(missing_ok=True)
            return
    _clear(folder)


def _clear(folder: Path) -> None:
    """Remove everything but the mesh and the logs of failed attempts."""
    for path in folder.iterdir():
        if path.name in ("constant", CHECKED) or path.name.startswith(("failed-", "log.")):
            continue
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
