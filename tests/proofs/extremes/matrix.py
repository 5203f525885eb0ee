"""What a row of the stability matrix is, the registry of rows, and how a row is judged.

A row is one function without arguments that asks the program for something extreme and says what happened. It holds
where every granule has a fate, no number is NaN, none is STOPPED without a reason that the row names, and its error
against an independent answer is no larger than the row allows. A row that the program must refuse holds where it is
refused in one line that contains the number that says why. What is registered is tested.
"""

from __future__ import annotations

import re
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import Any

from proofs.report import NOTHING, Column, Report, Table, Tell
from wakeflow.core.errors import WakeflowError
from wakeflow.core.registry import Registry
from wakeflow.flight import Fate
from wakeflow.flight.stages.compilation import compile_tracker

ERROR_UNITS = {  # of the error of a row: what it is
    "tolerance": "landing error of the worst granule over the tolerance that was asked for",
    "relative": "relative",
    "share": "largest error of a share",
    "granules": "share of the granules that fared otherwise",
}
HELD, MISSED, REFUSED = "held", "missed", "refused"


@dataclass(frozen=True)
class Happened:
    """What happened: how many granules were ``injected``, their ``fates``, whether all that the program returned is
    ``finite``, the ``error`` in the row's unit (None: nothing is compared), ``steps`` a granule (None: the flight has
    none), and the run time (``seconds``) of the program alone, without that of the answer it is compared with.
    """

    injected: int | None
    fates: Mapping[str, int]
    finite: bool
    error: float | None
    steps: float | None
    seconds: float
    note: str = ""


@dataclass(frozen=True)
class Extreme:
    """A row: of a ``group`` the ``value`` that is extreme, what ``happens`` when it is asked for, the answer that the
    error is measured ``against``, the largest error ``allowed``, in one of ERROR_UNITS.

    ``stops`` says why granules may be STOPPED, where they may; ``refused``: the program must refuse it; ``slow``: only
    with --slow; ``openfoam``: starts OpenFOAM.
    """

    group: str
    value: str
    happens: Callable[[], Happened]
    against: str = ""
    allowed: float = 1.0
    unit: str = "tolerance"
    stops: str = ""
    refused: bool = False
    slow: bool = False
    openfoam: bool = False


extremes: Registry[Extreme] = Registry("extreme")


def add_row(group: str, value: str, happens: Callable[[], Happened], against: str = "", **more: Any) -> None:
    """Register a row."""
    extremes.add(f"{group}: {value}", Extreme(group, value, happens, against, **more))


def fly_extreme(name: str) -> dict[str, object]:
    """The row ``name`` of the matrix, as JSON: what was asked, what happened, ``verdict`` (held, missed or refused) and
    ``why`` it was missed.

    Anything but one of the program's own errors is a crash: the row is missed and keeps the traceback.
    """
    row = extremes[name]
    begun, crash = time.monotonic(), None
    happened: Happened | None = None
    refusal = ""
    try:
        happened = row.happens()
    except WakeflowError as problem:
        refusal = str(problem)
    except Exception as problem:  # the matrix goes on, and says so in the row
        refusal, crash = f"{type(problem).__name__}: {problem}", traceback.format_exc()
    why = f"crashed: {refusal}" if crash else _complaint(row, happened, refusal)
    good = REFUSED if row.refused else HELD
    return {
        "name": name, "group": row.group, "value": row.value, "against": row.against, "unit": row.unit,
        "allowed": None if row.refused or not row.against else row.allowed, "slow": row.slow,
        **asdict(happened or Happened(None, {}, True, None, None, time.monotonic() - begun)),
        "with_answer": time.monotonic() - begun, "stops": row.stops, "refusal": refusal, "traceback": crash,
        "verdict": MISSED if why else good, "why": why,
    }  # fmt: skip


def _complaint(row: Extreme, happened: Happened | None, refusal: str) -> str:
    """Why the row is missed; empty where it is not."""
    if happened is None:
        if not row.refused:
            return f"refused: {refusal}"
        whole = "\n" not in refusal and re.search(r"\d", refusal)
        return "" if whole else "refused without the number that says why"
    if row.refused:
        return "not refused"
    if sum(happened.fates.values()) != happened.injected:
        return f"{happened.injected} granules injected, {sum(happened.fates.values())} have a fate"
    if not happened.finite:
        return "numbers that are not finite"
    stopped = happened.fates.get(Fate.STOPPED.name.lower(), 0)
    if stopped and not row.stops:
        return f"{stopped} of {happened.injected} granules stopped"
    return _inaccuracy(row, happened.error)


def _inaccuracy(row: Extreme, error: float | None) -> str:
    if error is None:
        return "nothing was compared" if row.against else ""
    return "" if error <= row.allowed else f"error {error:.2g}, allowed {row.allowed:.2g}"


def run_extremes(*, slow: bool, tell: Tell) -> Report:
    """Fly every row, with ``slow`` those of minutes too. A row that is missed does not keep the others from being
    flown; the report's ``missed`` names them.
    """
    import_module(__package__ or "")  # registers the rows
    compile_tracker()  # before anything is timed
    chosen = [name for name in extremes if slow or not extremes[name].slow]
    groups = list(dict.fromkeys(extremes[name].group for name in extremes))
    chosen.sort(key=lambda name: groups.index(extremes[name].group))
    rows = []
    for done, name in enumerate(chosen):
        tell(f"{done + 1} of {len(chosen)}: {name}")
        rows.append(fly_extreme(name))
    left = len(extremes) - len(chosen)
    notes = [f"{unit}: {meaning}" for unit, meaning in ERROR_UNITS.items()]
    notes += [f"{row['name']}: {row[key]}" for key in ("stops", "note") for row in rows if row[key]]
    notes += [f"{left} more rows take minutes: wakeflow verify extremes --slow"] if left else []
    flown = [row for row in rows if row["verdict"] != REFUSED]
    refused = [row for row in rows if row["verdict"] == REFUSED]
    tables = [Table(TITLE, FLOWN_COLUMNS, flown), Table("what is refused", REFUSAL_COLUMNS, refused)]
    missed = [f"{row['name']}: {row['why']}" for row in rows if row["verdict"] == MISSED]
    return Report("extremes", tables, {"rows": rows}, notes, missed)


TITLE = "stability matrix: what happened at the ends of what can be asked for"
REFUSAL_COLUMNS = {"refused": "{name}", "with the number that says why": "{refusal}"}
FLOWN_COLUMNS: dict[str, Column] = {
    "extreme": "{name}{slow: (slow)|}",
    "what happened": lambda row: ", ".join(f"{number} {fate}" for fate, number in row["fates"].items()) or NOTHING,
    "error": "{error:.1e}", "allowed": "{allowed:.2g}",
    "of": lambda row: row["unit"] if row["against"] else NOTHING, "against": lambda row: row["against"] or NOTHING,
    "steps": "{steps:.0f}", "seconds": "{seconds:.2g}",
    "verdict": lambda row: row["verdict"].upper() if row["verdict"] == MISSED else row["verdict"],
}  # fmt: skip
