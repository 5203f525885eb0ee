"""``wakeflow verify calibration``: the scenes of the coverage again, with trays that were weighed where the truth is
known: whether what a calibration says of inputs and shares holds it, and whether a wrong label is found out.

The truth of a scene is flown under a draw of its inputs; each share has a discrepancy of the model too, drawn as large
as the calibration says that it may be. Three trays, a count of finite samples, or whole trays by mass are measured of
it in turn, and the program is asked at the numbers as given.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from proofs.coverage.counted import Counted, tally_of
from proofs.coverage.flown import Predicted, chance_of, predicted, with_bins
from proofs.coverage.report import HELD, OVERALL
from proofs.coverage.scenes import GROUPS, VariedScene, varied_scenes
from proofs.report import Report, Row, Table, Tell
from wakeflow.answer.budget.agreement import DISAGREES
from wakeflow.core.store import Store, cache_root
from wakeflow.extras.trays.calibration import TELLS, inputs_after
from wakeflow.extras.trays.calibration_update import DISCREPANCY, Updated, agreement_with, covariance_of_missed, updated
from wakeflow.planning.unknowns import SIGMAS, Unknown, unknown_kinds
from wakeflow.scene.measured import Measured, Tray

Array = NDArray[np.float64]
TRUTH = 2**12  # granules a fraction of the truth
CHEAP = ("vacuum, rhombus", "vacuum, prism", "vacuum, polygon", "duct, dispersion")
SCENES, QUICK = 200, 12
KERNELS = 300  # of a fraction that are counted
ACCURACY = 0.02  # half of the 95 % interval of a weighed tray
TRAYS = 3  # weighed of a scene
KINDS = ("three trays", "counted", "not sorted")
TOLD_APART = 0.15  # of a share: trays that differ by more are exchanged
FALSE_ALARMS, FOUND_OUT = 0.03, 0.8  # of the right model; of exchanged labels
NARROWER = {"kind": "{kind}", "scenes": "{scenes}", "widest recovery before, points": "{before:.1f*100}",
            "after": "{after:.1f*100}", "rounds": "{rounds:.1f}"}  # fmt: skip
CHECKS = {"": "{what}", "scenes": "{scenes}", "disagrees": "{found}", "%": "{share:.1f*100}"}
GATES = {"gate": "{what}", "wanted": "{wanted}", "found": "{found}", "met": "{met:yes|NO}"}


@dataclass
class _Found:
    """Numbers with their intervals after the calibration; whether each scene's right and exchanged labels disagree."""

    inputs: list[Counted] = field(default_factory=list)
    learnt: list[Counted] = field(default_factory=list)
    shares: list[Counted] = field(default_factory=list)
    halves: list[tuple[str, float, float, int]] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)
    exchanged: list[bool] = field(default_factory=list)


def cheap_scenes(count: int) -> list[VariedScene]:
    """The first ``count`` scenes of groups that cost little."""
    most = len(GROUPS) * (count // len(CHEAP) + 1)
    return list(islice((one for one in varied_scenes(most) if one.group in CHEAP), count))


def run_calibration(
    *, slow: bool = False, tell: Tell = lambda _: None, scenes: int | None = None, draw: int = 0
) -> Report:
    """Calibrate scenes whose truth is known, that of a ``draw`` of its inputs; ``slow``: 200 of them. Everything is
    cached.
    """
    started, found, store = time.monotonic(), _Found(), Store(cache_root())
    many = (SCENES if slow else QUICK) if scenes is None else scenes
    for number, one in enumerate(cheap_scenes(many)):
        tell(f"{number + 1} of {many}: {one.name}")
        _calibrate(predicted(with_bins(one, store), store), KINDS[number // len(CHEAP) % len(KINDS)], found, draw)
    return _report(found, many, time.monotonic() - started)


def true_shares(told: Predicted, draw: int = 0) -> Array:
    """The shares (S,) of the machine: of the model under a ``draw`` of its inputs, with a discrepancy."""
    shares, chance = told.separation.fractions, chance_of(told.one, 7)
    places = [(name, place) for name, found in shares.items() for place in found]
    flown = told.truth.shares(TRUTH, told.truth.drawn(draw))
    off = chance.multivariate_normal(np.zeros(len(places)), covariance_of_missed(told.joint, DISCREPANCY))
    made = np.clip(np.concatenate([flown[name] for name in shares]) + off, 0.0, 1.0)
    for name in shares:
        mine = [i for i, (other, _) in enumerate(places) if other == name]
        made[mine] /= made[mine].sum()
    return made


def trays_of(told: Predicted, kind: str, true: Array) -> list[Tray]:
    """What is measured of it: three trays, all trays counted, or all trays weighed without sorting."""
    chance, mass = chance_of(told.one, 8), told.scene.mass_shares()
    places = [(name, place) for name, found in told.separation.fractions.items() for place in found]
    if kind == "three trays":
        free = [i for i, (_, place) in enumerate(places) if place != "elsewhere" and 0.02 < true[i] < 0.98]
        picked = chance.permutation(free or range(len(places)))[:TRAYS]
        return [_weighed(*places[i], float(true[i]), chance) for i in sorted(picked)]
    bins = told.separation.bins
    if kind == "not sorted":
        whole = [sum(mass[n] * true[i] for i, (n, p) in enumerate(places) if p == place) for place in bins]
        return [_weighed(None, place, float(share), chance) for place, share in zip(bins, whole, strict=True)]
    found = []
    for name in told.scene.fraction:
        share = np.array([true[i] for i, (other, _) in enumerate(places) if other == name])
        counts = chance.multinomial(KERNELS, share / share.sum())
        found += [Tray(fraction=name, bin=place, count=int(n)) for place, n in zip(bins, counts, strict=True)]
    return found


def _weighed(fraction: str | None, place: str, share: float, chance: np.random.Generator) -> Tray:
    seen = share + ACCURACY / SIGMAS * float(chance.standard_normal())
    return Tray(fraction=fraction, bin=place, share=float(np.clip(seen, 0.0, 1.0)), uncertainty=ACCURACY)


def exchanged(trays: Sequence[Tray]) -> list[Tray] | None:
    """The same with the labels of two trays of one fraction exchanged, those that differ most; None where all are much
    alike.
    """
    shares, best = Measured.of(trays).shares, (TOLD_APART, -1, -1)
    for i, one in enumerate(trays):
        for j, other in enumerate(trays[:i]):
            if one.fraction == other.fraction:
                best = max(best, (abs(float(shares[i] - shares[j])), i, j))
    _, i, j = best
    if i < 0:
        return None
    made = list(trays)
    made[i], made[j] = (trays[a].model_copy(update={"bin": trays[b].bin}) for a, b in ((i, j), (j, i)))
    return made


def _calibrate(told: Predicted, kind: str, found: _Found, draw: int) -> None:
    true = true_shares(told, draw)
    trays = trays_of(told, kind, true)
    made = _updated(told, trays)
    found.right.append(made.agreement.verdict == DISAGREES)
    if (wrong := exchanged(trays)) is not None:
        found.exchanged.append(agreement_with(told.joint, Measured.of(wrong), DISCREPANCY).verdict == DISAGREES)
    after_inputs = inputs_after(made)
    for z, unknown in zip(told.drawn(draw), made.unknowns, strict=True):
        one = after_inputs[unknown.key]
        ends = [_placed(unknown, x) for x in (*one.after, float(np.clip(unknown.at(float(z)), *_span(unknown))))]
        row = Counted(told.one.name, told.one.group, unknown.key, *ends)
        found.inputs.append(row)
        if one.narrower < TELLS:
            found.learnt.append(row)
    after = made.after.own.separation()
    for i, (name, place) in enumerate((name, place) for name in after.fractions for place in after.bins):
        one = after.fractions[name][place]
        label = f"share.{name}.{place}"
        found.shares.append(Counted(told.one.name, told.one.group, label, *one, float(true[i])))
    worst = max((n for n, r in told.separation.recovery.items() if r), key=lambda n: _half(told.separation.recovery[n]))
    halves = _half(told.separation.recovery[worst]), _half(after.recovery[worst])
    found.halves.append((kind, *halves, made.rounds))


def _span(unknown: Unknown) -> tuple[float, float]:
    return unknown_kinds[unknown.kind].span


def _placed(unknown: Unknown, x: float) -> float:
    """A number as a part of ten times the interval that is stated of it at first, 0.5 in its middle."""
    return 0.5 + 0.1 * (x - unknown.value) / (unknown.low + unknown.high)


def _half(number: object) -> float:
    return float(getattr(number, "half", 0.0))


def _updated(told: Predicted, trays: Sequence[Tray]) -> Updated:
    return updated(told.flights, told.joint, Measured.of(trays))


def _report(found: _Found, scenes: int, seconds: float) -> Report:
    tallies = [tally_of(label, rows) for label, rows in (
        ("shares after", found.shares), ("inputs after", found.inputs), ("of these, inputs that learnt", found.learnt),
    )]  # fmt: skip
    held = [tally.table() for tally in tallies]
    checks: list[Row] = [
        {"what": what, "scenes": len(rows), "found": sum(rows), "share": sum(rows) / max(1, len(rows))}
        for what, rows in (("the right model", found.right), ("two labels exchanged", found.exchanged))
    ]
    narrower = [
        {"kind": kind, "scenes": len(mine), "before": np.median([one[1] for one in mine]),
         "after": np.median([one[2] for one in mine]), "rounds": np.mean([one[3] for one in mine])}
        for kind in KINDS if (mine := [one for one in found.halves if one[0] == kind])
    ]  # fmt: skip
    (low, high), alarms, seen = OVERALL, checks[0]["share"], checks[1]["share"]
    gates: list[Row] = [
        {"what": f"{tally.label} held", "wanted": f"{100 * low:g} to {100 * high:g} %",
         "found": f"{100 * (tally.coverage or 0.0):.1f} %", "met": low <= (tally.coverage or 0.0) <= high}
        for tally in tallies[:2]
    ]  # fmt: skip
    gates.append({"what": "the right model disagrees", "wanted": f"at most {100 * FALSE_ALARMS:g} %",
                  "found": f"{100 * alarms:.1f} %", "met": alarms <= FALSE_ALARMS})  # fmt: skip
    gates.append({"what": "exchanged labels are found out", "wanted": f"at least {100 * FOUND_OUT:g} %",
                  "found": f"{100 * seen:.1f} %", "met": seen >= FOUND_OUT})  # fmt: skip
    tables = [
        Table("truth within the 95 % interval after a calibration", HELD, held),
        Table("measured shares against the model", CHECKS, checks),
        Table("half of the 95 % interval of the recovery that is known worst, median", NARROWER, narrower),
        Table("to reach, and reached", GATES, gates),
    ]
    facts = {"scenes": scenes, "seconds": seconds, "held": held, "checks": checks, "narrower": narrower, "gates": gates}
    missed = [gate["what"] for gate in gates if not gate["met"]]
    return Report("calibration", tables, facts, [f"{scenes} scenes in {seconds:.0f} s"], missed)
