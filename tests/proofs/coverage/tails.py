"""``wakeflow verify tails``: on which side intervals miss the truth, number by number, through the public calls alone.

Of each threshold scene the program is asked once. Then its inputs are drawn many times from what is stated of them, and
each draw is evaluated in closed form. An interval of 95 % that is no wider than it need be leaves 2.5 % of these truths
below it and 2.5 % above. A side of a number counts where truths can lie there: below 0, or below what a tenth of all
draws give exactly, there are none, and misses would be diluted. A miss is counted on any side, from one granule on.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

import wakeflow as wf
from proofs.coverage.counted import MIN_DISTANCE, ROUND_OFF
from proofs.coverage.thresholds import COUNT, FACTORS, SIGMAS, Threshold, threshold_scenes
from proofs.report import Report, Row, Table, Tell

Array = NDArray[np.float64]
Shares = dict[str, dict[str, float]]
SCENES, QUICK = 20, 4
TRUTHS = 500  # draws of the inputs of a scene
GRANULES = 2**12  # a fraction, of a truth
POSTERIORS = 3  # truths of a scene that are measured and calibrated
TRAYS, ACCURACY = 3, 0.02  # that are weighed of each, to half of a 95 % interval
EXACT = 1e-3  # discrepancy of a model that is exact: what its calibrations allow for
ENOUGH = 25.0  # draws that trays must leave for the sharpest interval to be known from them
TAIL = (0.025, 0.975)
TOUCH = 1.0 / COUNT  # of a share: a truth so near to an end is held, for that is one of the granules that are flown
COUNTS = 0.01  # of the truths that the sharpest interval must leave on a side for the side to count
NAMED = {"share": "shares", "recovery": "recoveries", "purity": "purities"}
ONCE, LEARNT = "posteriors, shares", "posteriors, inputs"  # kinds whose every number has one truth
FAR = ("restitution", "size")  # of a granule: inputs of which one is far off
FAR_OFF = {"posteriors, shares, at the edge": 2.3, "posteriors, shares, outside": 6.0}  # standard deviations
FEW = (ONCE, LEARNT, *FAR_OFF)  # kinds whose every number has one truth
SIDE, WIDEST = (0.01, 0.04), 1.15  # of truths on a side; median width over the sharpest
LOOSE = (0.0, 0.06)  # of truths on a side where there are few: of posteriors, and of the first scenes alone
WORST = 10  # numbers that are listed
ELSEWHERE = "draws end at 2.5 standard deviations, and other inputs explain the trays as well"
FAILING = {  # gates that are known not to be met, and why: meant to be empty
    "posteriors, shares, at the edge: truths above": ELSEWHERE,
    "posteriors, shares, outside: truths below": ELSEWHERE,
    "posteriors, shares, outside: truths above": ELSEWHERE,
}
COLUMNS = {
    "": "{label}", "scenes": "{scenes}", "numbers": "{numbers}", "truths": "{truths}", "below %": "{below:.1f*100}",
    "worst below": "{worst_below}", "above %": "{above:.1f*100}", "worst above": "{worst_above}",
    "width / sharpest": "{width:.2f}",
}  # fmt: skip
NOMINAL = {
    "scene": "{scene}", "largest difference of a share %": "{difference:.2f*100}", "chance %": "{chance:.2f*100}",
}  # fmt: skip
MISSED = {
    "kind": "{kind}", "scene": "{scene}", "number": "{quantity}", "below %": "{below:.1f*100}",
    "above %": "{above:.1f*100}", "width / sharpest": "{width:.2f}",
}  # fmt: skip
GATES = {"gate": "{what}", "wanted": "{wanted}", "found": "{found}", "met": "{met:yes|NO}"}


class Answer(Protocol):
    """What says shares, recoveries and purities: a run's Result, one with other bins, one after a calibration."""

    def share(self, fraction: str, place: str) -> Any: ...
    def recovery(self, fraction: str) -> Any: ...
    def purity(self, place: str, fraction: str) -> Any: ...


@dataclass(frozen=True)
class Tail:
    """One number of one scene with its interval, against the ``truths`` (n,): the part of them ``below`` it and
    ``above``, whether truths can lie on either side, and its width over that of the ``sharpest`` interval.
    """

    kind: str
    scene: str
    quantity: str
    truths: int
    below: float
    above: float
    can_below: bool
    can_above: bool
    width: float | None


# -- Counting ----------------------------------------------------------------------------------------------------------
def tail_of(
    kind: str, scene: str, quantity: str, said: tuple[float, float, float], truths: Array, *, whole: bool = True
) -> Tail | None:  # fmt: skip
    """``said`` (value, low, high) of a number against its ``truths`` (n,). None where it is trivial: value and middle
    95 % of the truths are next to 0, or of parts of a ``whole`` next to 1.
    """
    known = truths[np.isfinite(truths)]
    if not len(known) or trivial(said[0], known, whole=whole):
        return None
    low, high = np.quantile(known, TAIL)
    can = [float(np.mean(part)) >= COUNTS for part in (known < low - ROUND_OFF, known > high + ROUND_OFF)]
    below, above = np.mean(known < said[1] - TOUCH), np.mean(known > said[2] + TOUCH)
    width = (said[2] - said[1]) / (high - low) if high - low > MIN_DISTANCE else None
    return Tail(kind, scene, quantity, len(known), float(below), float(above), can[0], can[1], width)


def trivial(value: float, truths: Array, *, whole: bool = True) -> bool:
    """Whether a number is next to 0 as said and in nearly all truths; of a part of a whole, or next to 1."""
    every = [value, *np.quantile(truths, TAIL)]
    return max(np.abs(every)) < MIN_DISTANCE or (whole and min(every) > 1.0 - MIN_DISTANCE)


def quantities(shares: Shares, mass: Mapping[str, float], targets: Mapping[str, Sequence[str]]) -> dict[str, float]:
    """Shares, recoveries and purities by the names that results give them; the purity of an empty bin is nan."""
    found = {f"share.{name}.{place}": x for name, own in shares.items() for place, x in own.items()}
    for name, places in targets.items():
        found[f"recovery.{name}"] = sum(shares[name][place] for place in places)
    for place in next(iter(shares.values())):
        total = sum(mass[name] * own[place] for name, own in shares.items())
        for name, own in shares.items():
            pure = mass[name] * own[place] / total if total > MIN_DISTANCE else np.nan
            found[f"purity.{place}.{name}"] = pure
    return found


def said_by(answer: Answer, quantity: str) -> tuple[float, float, float] | None:
    """Value, low and high of a number; None where the answer has it not: the purity of an empty bin."""
    kind, *names = quantity.split(".")
    try:
        found = getattr(answer, kind)(*names)
    except wf.SceneError:
        return None
    return (found.value, found.low, found.high) if found.known else None


# -- A scene -----------------------------------------------------------------------------------------------------------
class Truths(NamedTuple):
    """Draws of the inputs of a scene: each ``drawn`` by key, and of every number the truths (n,) as the scene is, of
    the ``other`` design, and with the bins ``moved``.
    """

    drawn: Sequence[Mapping[str, float]]
    own: Mapping[str, Array]
    other: Mapping[str, Array]
    moved: Mapping[str, Array]


def truths_of(one: Threshold, count: int, granules: int = GRANULES) -> Truths:
    """``count`` truths of a scene, by random numbers of which the program knows nothing."""
    chance = np.random.default_rng([*one.name.encode(), 20261128])
    drawn = [one.drawn(chance) for _ in range(count)]
    rows: list[list[dict[str, float]]] = [[], [], []]
    for draw in drawn:
        own, moved = one.design.divided([one.design.bins, one.moved], draw, granules)
        other = moved if one.changes is one.dividers else one.other.shares(draw, granules)
        for row, shares in zip(rows, (own, other, moved), strict=True):
            row.append(quantities(shares, one.mass, one.targets))
    found = [{name: np.array([one[name] for one in row]) for name in row[0]} for row in rows]
    return Truths(drawn, *found)


def asked(one: Threshold, folder: Path, changes: Mapping[str, float] | None = None) -> wf.Result:
    """The program's answer, without a report."""
    scene = one.scene.replace(dict(changes or {}))
    return wf.run(scene, folder, rung=one.rung, report=False, listener=lambda *_: None)


def tails_of(one: Threshold, truths: Truths, folder: Path) -> Iterator[Tail | None]:
    """Every number of a scene: as it is, with its bins moved where results can do that, and next to another design."""
    base, other = asked(one, folder / "own"), asked(one, folder / "other", one.changes)
    yield from _answer(one, "", base, truths.own)
    if hasattr(base, "moved"):
        yield from _answer(one, "moved", base.moved(dict(one.dividers)), truths.moved)
    for row in wf.compare([base, other]).differences:
        if row.quantity in truths.own:
            said = row.value, row.low, row.high
            true = truths.other[row.quantity] - truths.own[row.quantity]
            yield tail_of("differences", one.name, row.quantity, said, true, whole=False)


def _answer(one: Threshold, kind: str, answer: Answer, truths: Mapping[str, Array]) -> Iterator[Tail | None]:
    for quantity, known in truths.items():
        said = said_by(answer, quantity)
        if said is not None:
            yield tail_of(kind or NAMED[quantity.split(".")[0]], one.name, quantity, said, known)


def nominal(one: Threshold, answer: Answer, granules: int = GRANULES) -> tuple[float, float]:
    """:func:`apart` at the numbers as given."""
    given = {key: 1.0 if key.rpartition(".")[2] in FACTORS else value for key, (value, _) in one.inputs.items()}
    return apart(one, answer, given, granules)


def apart(
    one: Threshold, answer: Answer, drawn: Mapping[str, float], granules: int = GRANULES
) -> tuple[float, float]:  # fmt: skip
    """The largest difference of a share between an answer and the closed form where the inputs are as ``drawn``, and
    what chance may make of it: half of a 95 % interval of independent granules.
    """
    largest, chance = 0.0, 0.0
    for name, own in one.design.shares(drawn, granules).items():
        for place, share in own.items():
            largest = max(largest, abs(answer.share(name, place).value - share))
            chance = max(chance, SIGMAS * math.sqrt(max(share * (1.0 - share), 0.0) / one.scene.feed.count))
    return largest, chance


# -- Posteriors --------------------------------------------------------------------------------------------------------
def far_truth(one: Threshold, truths: Truths, deviations: float) -> Truths | None:
    """The truths with one before them whose first input of a granule lies so many standard ``deviations`` off, to where
    there is room; None where there is none.
    """
    key = next(key for key in one.inputs if key.startswith("fraction.") and key.rpartition(".")[2] in FAR)
    value, half = one.inputs[key]
    last, reach = key.rpartition(".")[2], deviations * half / SIGMAS
    most = 1.0 if last == "restitution" else np.inf
    x = value + reach if value + reach <= most else value - reach
    if x <= 0.0:
        return None
    draw = {**truths.drawn[0], key: x / value if last in FACTORS else x}
    (shares,) = one.design.divided([one.design.bins], draw, GRANULES)
    own = quantities(shares, one.mass, one.targets)
    return truths._replace(drawn=[draw, *truths.drawn], own={k: np.array([own[k], *x]) for k, x in truths.own.items()})


def posteriors_of(one: Threshold, truths: Truths, folder: Path, count: int, kind: str = ONCE) -> Iterator[Tail | None]:
    """Some of the truths as they are measured: what a calibration then says of shares and inputs."""
    chance = np.random.default_rng([*one.name.encode(), 20261129])
    for number in range(count):
        trays, weights = _measured(truths, number, chance)
        made = wf.calibrate(
            one.scene, trays, folder / "own", rung=one.rung, discrepancy=EXACT, listener=lambda *_: None
        )
        for quantity, known in truths.own.items():
            said = said_by(made.result, quantity)
            if said is not None and np.isfinite(known[number]) and not trivial(said[0], known[np.isfinite(known)]):
                yield _once(kind, one, quantity, said, known, number, weights)
        if kind != ONCE:
            continue
        for key, after in made.inputs.items():
            value = one.inputs[key][0] if key.rpartition(".")[2] in FACTORS else 1.0
            known = value * np.array([draw[key] for draw in truths.drawn])
            yield _once(LEARNT, one, key, (after.value, after.low, after.high), known, number, weights)


def _measured(truths: Truths, number: int, chance: np.random.Generator) -> tuple[dict[str, list[Any]], Array]:
    """The trays of one truth, and how likely (n,) each of the truths makes them."""
    shares = {name: x for name, x in truths.own.items() if name.startswith("share.")}
    free = [name for name, x in shares.items() if 0.02 < x[number] < 0.98] or list(shares)
    picked = [str(name) for name in chance.permutation(free)[:TRAYS]]
    columns: dict[str, list[Any]] = {"fraction": [], "bin": [], "share": [], "uncertainty": []}
    off = np.zeros(len(truths.drawn))
    for name in picked:
        seen = float(np.clip(shares[name][number] + ACCURACY / SIGMAS * chance.standard_normal(), 0.0, 1.0))
        for key, cell in zip(columns, (*name.split(".")[1:], seen, ACCURACY), strict=True):
            columns[key].append(cell)
        off += ((shares[name] - seen) * SIGMAS / ACCURACY) ** 2
    return columns, np.exp(-0.5 * (off - off.min()))


def _once(
    kind: str,
    one: Threshold,
    quantity: str,
    said: tuple[float, float, float],
    known: Array,
    number: int,
    weights: Array,
) -> Tail:
    """A number against the one truth that was measured; the sharpest interval is that of all truths by their weights,
    where these leave enough of them.
    """
    width, usable = None, np.isfinite(known)
    some = weights[usable]
    if some.sum() > 0.0 and some.sum() ** 2 / (some**2).sum() >= ENOUGH:
        order = np.argsort(known[usable])
        part = (np.cumsum(some[order]) - 0.5 * some[order]) / some.sum()
        low, high = np.interp(TAIL, part, known[usable][order])
        width = (said[2] - said[1]) / (high - low) if high - low > MIN_DISTANCE * abs(said[0]) else None
    true = known[number]
    return Tail(kind, one.name, quantity, 1, float(true < said[1] - ROUND_OFF), float(true > said[2] + ROUND_OFF),
                True, True, width)  # fmt: skip


# -- The report --------------------------------------------------------------------------------------------------------
def run_tails(
    *, slow: bool = False, tell: Tell = lambda _: None, scenes: int | None = None, truths: int = TRUTHS,
    posteriors: int | None = None,
) -> Report:  # fmt: skip
    """Ask of ``scenes`` threshold scenes, ``slow``: of all of them, and count ``truths`` of each, of which as many as
    ``posteriors`` are measured and calibrated.
    """
    started, found, agreed = time.monotonic(), list[Tail](), list[Row]()
    many = (SCENES if slow else QUICK) if scenes is None else scenes
    measured = (POSTERIORS if slow else 1) if posteriors is None else posteriors
    with tempfile.TemporaryDirectory() as folder:
        for number, one in enumerate(threshold_scenes(many)):
            tell(f"{number + 1} of {many}: {one.name}")
            place, true = Path(folder, str(number)), truths_of(one, truths)
            found += [tail for tail in tails_of(one, true, place) if tail is not None]
            difference, chance = nominal(one, wf.Result.load(place / "own"))
            agreed.append({"scene": one.name, "difference": difference, "chance": chance})
            found += [tail for tail in posteriors_of(one, true, place, measured) if tail is not None]
            for kind, deviations in FAR_OFF.items() if measured else ():
                if (far := far_truth(one, true, deviations)) is not None:
                    found += [tail for tail in posteriors_of(one, far, place, 1, kind) if tail is not None]
    return _report(found, agreed, many, time.monotonic() - started)


def row_of(kind: str, tails: Sequence[Tail]) -> Row | None:
    """Both sides of all numbers of a kind, and their median width over the sharpest; None where there are none."""
    own = [tail for tail in tails if tail.kind == kind]
    if not own:
        return None
    row: dict[str, Any] = {"label": kind, "scenes": len({tail.scene for tail in own}), "numbers": len(own),
                           "truths": sum(tail.truths for tail in own)}  # fmt: skip
    for side in ("below", "above"):
        able = sum(tail.truths for tail in own if getattr(tail, f"can_{side}"))
        row[side] = sum(tail.truths * getattr(tail, side) for tail in own) / able if able else None
        row[f"worst_{side}"] = _worst(own, side)
    widths = [tail.width for tail in own if tail.width is not None]
    return row | {"width": float(np.median(widths)) if widths else None}


def _nothing(kind: str) -> Row:
    """The row of a kind that was not counted: results of a version that cannot move their bins, or no calibrations."""
    empty = dict.fromkeys(("below", "worst_below", "above", "worst_above", "width"))
    return {"label": f"{kind} (skipped: none were made)", "scenes": 0, "numbers": 0, "truths": 0, **empty}


def _worst(own: Sequence[Tail], side: str) -> str:
    """The number that is missed most on a side, with its scene; of numbers with one truth each the worst scene."""
    by_place: dict[str, list[float]] = {}
    for tail in own:
        place = tail.scene if tail.kind in FEW else f"{tail.scene} {tail.quantity}"
        by_place.setdefault(place, []).append(getattr(tail, side))
    place, rates = max(by_place.items(), key=lambda one: np.mean(one[1]))
    return f"{100 * np.mean(rates):.1f} ({place})"


def gates(rows: Sequence[Row], agreed: Sequence[Row]) -> list[Row]:
    """What is asked of each kind, and whether it is met; of the closed form that the program agrees with it. Of the
    posteriors of few scenes nothing is asked: they are a dozen truths.
    """
    asked_of: list[Row] = []
    whole = len(agreed) >= SCENES
    for row in rows if whole else [row for row in rows if row["label"] not in FEW]:
        low, high = SIDE if whole and row["label"] not in FEW else LOOSE
        for side in ("below", "above"):
            if (rate := row[side]) is not None:
                wanted = f"{100 * low:g} to {100 * high:g} %"
                asked_of.append({"what": f"{row['label']}: truths {side}", "wanted": wanted,
                                 "found": f"{100 * rate:.1f} %", "met": low <= rate <= high})  # fmt: skip
        if (width := row["width"]) is not None:
            asked_of.append({"what": f"{row['label']}: width over the sharpest", "wanted": f"at most {WIDEST:g}",
                             "found": f"{width:.2f}", "met": width <= WIDEST})  # fmt: skip
    others = [row["scene"] for row in agreed if row["difference"] > row["chance"] + MIN_DISTANCE]
    asked_of.append({"what": "closed form and program agree at the numbers as given", "wanted": "within chance",
                     "found": f"not {', '.join(others)}" if others else "all", "met": not others})  # fmt: skip
    return asked_of


def _report(found: Sequence[Tail], agreed: Sequence[Row], scenes: int, seconds: float) -> Report:
    kinds = [*NAMED.values(), "differences", "moved", *FEW]
    rows = [row_of(kind, found) or _nothing(kind) for kind in kinds]
    asked_of = gates(rows, agreed)
    worst = [asdict(tail) for tail in sorted(found, key=lambda tail: -max(tail.below, tail.above))]
    listed = [row for row in worst if row["kind"] in NAMED.values()][:WORST]
    facts = {"scenes": scenes, "seconds": seconds, "kinds": rows, "gates": asked_of, "nominal": list(agreed),
             "numbers": worst}  # fmt: skip
    notes = [
        f"{scenes} scenes in {seconds:.0f} s",
        *(f"known not to be met: {one}; {why}" for one, why in FAILING.items()),
    ]
    tables = [
        Table("truths on either side of the 95 % interval", COLUMNS, rows),
        Table("shares, recoveries and purities that are missed most", MISSED, listed),
        Table("closed form against program", NOMINAL, agreed),
        Table("to reach, and reached", GATES, asked_of),
    ]
    missed = [gate["what"] for gate in asked_of if not gate["met"] and gate["what"] not in FAILING]
    return Report("tails", tables, facts, notes, missed)
