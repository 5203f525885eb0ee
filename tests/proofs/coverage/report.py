"""``wakeflow verify coverage``: how often the intervals hold the truth, as a report with its gates."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from proofs.coverage.counted import (
    Bounded,
    Counted,
    HeldTally,
    bounded,
    counted,
    inputs_alone,
    left_out_wakes,
    numerical_alone,
    of_kind,
    sampling_alone,
    tally_of,
)  # fmt: skip
from proofs.coverage.flown import Predicted, predicted, with_bins
from proofs.coverage.laminar import laminar_rows, references
from proofs.coverage.scenes import GROUPS, VariedScene, varied_scenes
from proofs.report import Report, Row, Table, Tell
from wakeflow.core.store import Store, cache_root

SCENES, QUICK = 200, 20
TRUTH = 2**12  # granules a fraction of the truth
COMPARED = 2**11  # granules a fraction of what is flown often
EVERY = 10  # one turn of the groups in so many is flown for each part alone
ENSEMBLE = 32  # draws of the inputs, of one scene a group
OVERALL, IN_GROUP, WIDEST = (0.93, 0.975), 0.88, 3.2
SIDE, SIDE_OF_FEW = (0.01, 0.04), (0.0, 0.08)  # of the truths on each side; the first scenes alone miss 0 to 8 of 100
WIDTH = "median half width over median error"
BROKEN = "bounds on terms left out that are broken"
# Laminar at a Reynolds number at which the program says that it would be turbulent: what that could change is in its
# interval and not in this truth, so that the group says whether intervals hold, and not how wide they need be
DOUBTED = "duct"
FAILING: dict[str, str] = {}  # gates that are known not to be met, and why: empty since all are
HELD = {
    "": "{label}", "scenes": "{scenes}", "numbers": "{many}", "held %": "{coverage:.1f*100}",
    "with trivial %": "{every:.1f*100}", "above %": "{above:.1f*100}", "below %": "{below:.1f*100}",
    "half %": "{half:.2f*100}", "error %": "{error:.2f*100}", "half / error": "{width:.2f}",
}  # fmt: skip
BOUNDS = {
    "term left out": "{term}", "shares": "{many}", "untested": "{untested}", "tested": "{tested}",
    "within its bound": "{held}", "largest change %": "{change:.3f*100}", "its bound %": "{bound:.3f*100}",
    "where": "{scene}",
}  # fmt: skip
GATES = {"gate": "{what}", "wanted": "{wanted}", "found": "{found}", "met": "{met:yes|NO}"}
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


def run_coverage(
    *, slow: bool = False, tell: Tell = lambda _: None, scenes: int | None = None, parts: bool = True
) -> Report:
    """Fly the varied scenes; ``slow``: all of them. Everything is cached: the same call goes on after an interruption.

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
    return _report(found, many, time.monotonic() - started)


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


def _report(found: _Found, scenes: int, seconds: float) -> Report:
    whole = [of_kind(found.whole, kind) for kind in ("share", "recovery", "purity")]
    shares = whole[0]
    groups = [tally_of(group, [row for row in shares if row.group == group]) for group in GROUPS]
    kinds = [tally_of(label, rows) for label, rows in zip(LABELS, whole, strict=True)]
    sharp = [
        tally_of(f"{label}, without the {DOUBTED}", [row for row in rows if row.group != DOUBTED])
        for label, rows in zip(LABELS, whole, strict=True)
    ]
    alone = [
        tally_of("granules", found.sampling),
        tally_of("granules and steps", found.numerical),
        tally_of("inputs", found.inputs),
        tally_of("mesh and averaging, laminar", found.laminar),
    ]
    wakes, asked = left_out_wakes(), gates(kinds[0], groups, sharp[0], found.bounds)
    groups_told, kinds_told, parts = (
        [tally.table() for tally in tallies] for tallies in (groups, kinds + sharp, alone)
    )
    facts: dict[str, Any] = {
        "scenes": scenes, "seconds": seconds, "groups": groups_told, "kinds": kinds_told, "parts": parts,
        "bounds": _bounds(found.bounds), "wakes": wakes, "gates": asked,
        "outside": [asdict(row) for row in shares if not row.trivial and not row.covered],
    }  # fmt: skip
    notes = [
        f"{scenes} scenes in {seconds:.0f} s; of recoveries and purities nothing is asked",
        f"theta, strength and lift of wakes, each source predicted from all others: {sum(w['held'] for w in wakes)} of "
        f"{len(wakes)} lie within the range given; not {', '.join(w['name'] for w in wakes if not w['held'])}",
        *(f"known not to be met: {gate}; {why}" for gate, why in FAILING.items()),
    ]
    titles = {"groups": "shares, by group", "kinds": "all groups", "parts": "one part alone"}
    tables = [Table(f"truth within the 95 % interval: {text}", HELD, facts[key]) for key, text in titles.items()]
    tables.append(Table("terms switched on against their bounds", BOUNDS, facts["bounds"]))
    tables.append(Table("to reach, and reached", GATES, facts["gates"]))
    missed = [gate["what"] for gate in asked if not gate["met"] and gate["what"] not in FAILING]
    return Report("coverage", tables, facts, notes, missed)


def _bounds(rows: Sequence[Bounded]) -> list[dict[str, Any]]:
    """For each term how many of its bounds were tested and held, and the largest change, of the tested if there are
    any, beside the bound on it. What other random numbers change by more than the bound leaves it untested.
    """
    made = []
    for term in dict.fromkeys(row.term for row in rows):
        own = [row for row in rows if row.term == term]
        tested = [row for row in own if row.tested]
        worst = max(tested or own, key=lambda row: row.change)
        held = {"many": len(own), "untested": len(own) - len(tested), "tested": len(tested),
                "held": sum(row.held for row in tested)}  # fmt: skip
        made.append({"term": term, **held, "change": worst.change, "bound": worst.bound, "scene": worst.scene})
    return made


def gates(overall: HeldTally, groups: Sequence[HeldTally], sharp: HeldTally, bounds: Sequence[Bounded]) -> list[Row]:
    """What is asked of the shares, of how wide the intervals of those that are ``sharp`` are, and of the bounds; what
    was found, and whether it is met. A bound below the noise of its test can be broken by chance alone.
    """
    low, high = OVERALL
    known = [group for group in groups if group.coverage is not None]
    worst = min(known, key=lambda group: group.coverage or 0.0)
    tested = [row for row in bounds if row.tested]
    broken, beyond = (sum(not row.held for row in rows) for rows in (tested, bounds))
    untested = f"{len(bounds) - len(tested)} untested, {beyond - broken} of them beyond their noise"
    share, least, width = overall.coverage or 0.0, worst.coverage or 0.0, sharp.width or float("inf")
    asked = (
        ("shares held overall", f"{100 * low:g} to {100 * high:g} %", f"{100 * share:.1f} %", low <= share <= high),
        ("shares held in the worst group", f"at least {100 * IN_GROUP:g} %", f"{100 * least:.1f} % ({worst.label})",
         least >= IN_GROUP),
        *_sides(overall),
        (f"{WIDTH}, without the {DOUBTED}", f"at most {WIDEST:g}", f"{width:.2f}", width <= WIDEST),
        (BROKEN, "none", f"{broken} of {len(tested)} tested; {untested}", broken == 0),
    )  # fmt: skip
    return [dict(zip(("what", "wanted", "found", "met"), gate, strict=True)) for gate in asked]


def _sides(overall: HeldTally) -> list[tuple[str, str, str, bool]]:
    """That the shares are missed on both sides alike: an interval that is moved holds as many, and one end is wrong."""
    low, high = SIDE if overall.scenes > QUICK else SIDE_OF_FEW
    sides = (("below", overall.below or 0.0), ("above", overall.above or 0.0))
    wanted = f"{100 * low:g} to {100 * high:g} %"
    return [(f"shares {side} their intervals", wanted, f"{100 * x:.1f} %", low <= x <= high) for side, x in sides]
