"""``wakeflow verify coverage``: how often the intervals hold the truth, as a report with its gates."""

from __future__ import annotations

import datetime
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.files import write_json
from ...core.store import Store, cache_root
from .counted import Counted, HeldTally, counted, of_kind, tally_of
from .flown import Predicted, predicted, with_bins
from .laminar import laminar_rows, references
from .parts import Bounded, bounded, inputs_alone, left_out_wakes, numerical_alone, sampling_alone
from .scenes import GROUPS, VariedScene, varied_scenes

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["SCENES", "CoverageGate", "coverage_tables", "gates", "run_coverage"]

Tell = Callable[[str], None]
SCENES, QUICK = 200, 20
TRUTH = 2**12  # granules a fraction of the truth
COMPARED = 2**11  # granules a fraction of what is flown often
EVERY = 10  # one turn of the groups in so many is flown for each part alone
ENSEMBLE = 32  # draws of the inputs, of one scene a group
OVERALL, IN_GROUP, WIDEST = (0.93, 0.975), 0.88, 4.0
BROKEN = "bounds on terms left out that are broken"
FAILING: dict[str, str] = {}  # gates that are known not to be met, and why: empty since all are
LABELS = ("shares", "recoveries", "purities")


@dataclass
class _Found:
    """What the scenes gave: numbers with the whole interval, and with that of each part alone."""

    whole: list[Counted] = field(default_factory=list)
    sampling: list[Counted] = field(default_factory=list)
    numerical: list[Counted] = field(default_factory=list)
    inputs: list[Counted] = field(default_factory=list)
    laminar: list[Counted] = field(default_factory=list)
    bounds: list[Bounded] = field(default_factory=list)


@dataclass(frozen=True)
class CoverageGate:
    """What is asked, what was found, and whether it is met."""

    what: str
    wanted: str
    found: str
    met: bool


def run_coverage(
    folder: Path, *, slow: bool = False, tell: Tell = lambda _: None, scenes: int | None = None, parts: bool = True
) -> dict[str, Any]:
    """Fly the varied scenes and write ``coverage.json`` into ``folder``; ``slow``: all of them. Everything is cached:
    the same call goes on after an interruption.

    ``scenes``: another number; without ``parts`` the whole intervals alone are counted.
    """
    started, found = time.monotonic(), _Found()
    many = (SCENES if slow else QUICK) if scenes is None else scenes
    store = Store(cache_root())
    for number, one in enumerate(varied_scenes(many)):
        tell(f"{number + 1} of {many}: {one.name}")
        _fly(one, number, store, found, parts=parts)
    for name in references() if slow and parts else ():
        tell(name)
        found.laminar += laminar_rows(name)
    report = _report(found, many, time.monotonic() - started)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "coverage.json", json.loads(json.dumps(report)))
    return report


def _fly(one: VariedScene, number: int, store: Store, found: _Found, *, parts: bool) -> None:
    told = predicted(with_bins(one, store), store)
    found.whole += counted(told, told.truth.shares(TRUTH, told.truth.drawn(0)))
    turn = number // len(GROUPS)
    if parts and turn % EVERY == 0:
        _fly_parts(told, found)
    if parts and turn == 0:
        found.inputs += inputs_alone(told, ENSEMBLE, COMPARED)


def _fly_parts(told: Predicted, found: _Found) -> None:
    plan = told.pipeline.plan
    given = told.truth.shares(TRUTH, plan=plan)
    found.sampling += sampling_alone(told, given)
    found.numerical += numerical_alone(told, given)
    found.bounds += bounded(told, COMPARED)


def _report(found: _Found, scenes: int, seconds: float) -> dict[str, Any]:
    whole = [of_kind(found.whole, kind) for kind in ("share", "recovery", "purity")]
    shares = whole[0]
    groups = [tally_of(group, [row for row in shares if row.group == group]) for group in GROUPS]
    kinds = [tally_of(label, rows) for label, rows in zip(LABELS, whole, strict=True)]
    alone = [
        tally_of("granules", found.sampling),
        tally_of("granules and steps", found.numerical),
        tally_of("inputs", found.inputs),
        tally_of("mesh and averaging, laminar", found.laminar),
    ]
    wakes, asked = left_out_wakes(), gates(kinds[0], groups, found.bounds)
    return {
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "scenes": scenes,
        "seconds": seconds,
        "groups": _tables(groups),
        "kinds": _tables(kinds),
        "parts": _tables(alone),
        "bounds": _bounds(found.bounds),
        "wakes": [asdict(row) | {"held": row.held} for row in wakes],
        "gates": [asdict(gate) for gate in asked],
        "missed": [gate.what for gate in asked if not gate.met and gate.what not in FAILING],
        "outside": [asdict(row) for row in shares if not row.trivial and not row.covered],
        "notes": [
            f"{scenes} scenes in {seconds:.0f} s; of recoveries and purities nothing is asked",
            f"theta and strength of wakes, each measurement predicted from all others: {sum(w.held for w in wakes)} of "
            f"{len(wakes)} lie within the range given; not {', '.join(w.name for w in wakes if not w.held)}",
            *(f"known not to be met: {gate}; {why}" for gate, why in FAILING.items()),
        ],
    }


def _tables(tallies: Iterable[HeldTally]) -> list[dict[str, Any]]:
    return [tally.table() for tally in tallies]


def _bounds(rows: Sequence[Bounded]) -> list[dict[str, Any]]:
    """For each term how often its bound holds, and the largest change beside the bound on it."""
    made = []
    for term in dict.fromkeys(row.term for row in rows):
        own = [row for row in rows if row.term == term]
        worst = max(own, key=lambda row: row.change)
        held = {"many": len(own), "held": sum(row.held for row in own)}
        made.append({"term": term, **held, "change": worst.change, "bound": worst.bound, "scene": worst.scene})
    return made


def gates(overall: HeldTally, groups: Sequence[HeldTally], bounds: Sequence[Bounded]) -> list[CoverageGate]:
    """What is asked of the shares, and of the bounds."""
    low, high = OVERALL
    known = [group for group in groups if group.coverage is not None]
    worst = min(known, key=lambda group: group.coverage or 0.0)
    broken = sum(not row.held for row in bounds)
    share, width = overall.coverage or 0.0, overall.width or float("inf")
    return [
        CoverageGate(
            "shares held overall", f"{100 * low:g} to {100 * high:g} %", f"{100 * share:.1f} %", low <= share <= high
        ),
        CoverageGate(
            "shares held in the worst group",
            f"at least {100 * IN_GROUP:g} %",
            f"{100 * (worst.coverage or 0.0):.1f} % ({worst.label})",
            (worst.coverage or 0.0) >= IN_GROUP,
        ),
        CoverageGate("median half width over median error", f"at most {WIDEST:g}", f"{width:.2f}", width <= WIDEST),
        CoverageGate(BROKEN, "none", f"{broken} of {len(bounds)}", broken == 0),
    ]


# -- tables ------------------------------------------------------------------------------------------------------------


def coverage_tables(report: dict[str, Any]) -> list[Table]:
    """The report as tables."""
    from rich.table import Table

    head = ("scenes", "numbers", "held %", "with trivial %", "above %", "below %", "half %", "error %", "half / error")
    tables = []
    for key, first in (("groups", "shares, by group"), ("kinds", "all groups"), ("parts", "one part alone")):
        table = Table(first, *head, title=f"truth within the 95 % interval: {first}", title_justify="left",
                      pad_edge=False, box=None)  # fmt: skip
        for row in report[key]:
            table.add_row(*_cells(row))
        tables.append(table)
    tables += [_bound_table(report), _gate_table(report)]
    return tables


def _cells(row: dict[str, Any]) -> list[str]:
    percents = (_percent(row[key]) for key in ("coverage", "every", "above", "below"))
    sizes = ("–" if row[key] is None else f"{100 * row[key]:.2f}" for key in ("half", "error"))
    width = "–" if row["width"] is None else f"{row['width']:.2f}"
    return [row["label"], str(row["scenes"]), str(row["many"]), *percents, *sizes, width]


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}"


def _bound_table(report: dict[str, Any]) -> Table:
    from rich.table import Table

    table = Table("term left out", "shares", "within its bound", "largest change %", "its bound %", "where",
                  title="terms switched on against their bounds", title_justify="left", pad_edge=False,
                  box=None)  # fmt: skip
    for row in report["bounds"]:
        sizes = (f"{100 * row[key]:.3f}" for key in ("change", "bound"))
        table.add_row(row["term"], str(row["many"]), str(row["held"]), *sizes, row["scene"])
    return table


def _gate_table(report: dict[str, Any]) -> Table:
    from rich.table import Table

    table = Table("gate", "wanted", "found", "met", title="to reach, and reached", title_justify="left",
                  pad_edge=False, box=None)  # fmt: skip
    for gate in report["gates"]:
        table.add_row(gate["what"], gate["wanted"], gate["found"], "yes" if gate["met"] else "NO")
    return table
