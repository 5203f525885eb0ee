"""What a person at a terminal sees of measured shares: beside a run, after a calibration, and as a plan to weigh."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.errors import known
from ...core.quantities import say, speaking
from ...show.plan_words import UNITS
from ...show.screen import print_lines, print_table
from ...show.terminal import show_agreement
from ...show.words import percent
from .calibration import TELLS

if TYPE_CHECKING:
    from .calibration import CalibratedInput, Posterior
    from .protocol import Protocol

MOST = 8  # inputs that are shown; all are in inputs.csv
WORTH = 0.97  # of an interval: what would leave more of it is not worth measuring
NARROWER = 1.05  # times wider without it: a tray that tells less is not named


def show_calibration(posterior: Posterior) -> None:
    """Print what became known: shares, inputs, whether the model fits; which tray told most, what to measure next."""
    if posterior.conflict:
        print_lines([posterior.conflict])
    show_agreement(posterior.agreement)
    if posterior.result is None:
        print_lines(
            ["Nothing is calibrated: weigh the trays again, or mend the scene.", f"results: {posterior.folder}"]
        )
        return
    before, after = (known(result.landings) for result in (posterior.before, posterior.result))
    rows = [
        [f"{name} recovered", percent(share), percent(after.separation.recovery[name])]
        for name, share in before.separation.recovery.items() if share is not None
    ]  # fmt: skip
    rows += [
        [f"{name} in {place}", percent(before.separation.fractions[name][place]), percent(share)]
        for name, places in after.separation.fractions.items() for place, share in places.items()
    ]  # fmt: skip
    print_table(["share", "before, %", "after, %"], rows, "shares")
    learnt = [entry for entry in posterior.inputs.values() if entry.narrower < TELLS][:MOST]
    cells = [[entry.key, *_said(entry), f"{100 * entry.narrower:.0f}"] for entry in learnt]
    print_table(["input", "before", "after", "interval left, %"], cells, "inputs that became narrower")
    lines = [
        f"rounds of flights: {posterior.rounds}{'' if posterior.stands else '; the inputs still moved in the last'}"
    ]
    lines += [f"{tray}: without it the widest recovery would be {times:.2g} times as wide"
              for tray, times in posterior.wider_without if times > NARROWER]  # fmt: skip
    lines += [f"measure next: {key}, which would leave {100 * left:.0f} % of the widest recovery's interval"
              for key, left in posterior.next if left < WORTH]  # fmt: skip
    print_lines([*lines, f"results: {posterior.folder}"])


def _said(entry: CalibratedInput) -> list[str]:
    """The number before and after, in the units of measures."""
    with speaking(UNITS):
        ends = ([say(x, entry.unit, 3) for x in number] for number in (entry.before, entry.after))
        return [f"{value} ({low} to {high})" for value, low, high in ends]


def show_protocol(protocol: Protocol) -> None:
    """Print which trays to weigh, how often, and what each buys."""

    rows = [
        [step.about, f"{step.kernels}", f"{step.repetitions}", f"± {100 * step.half:.1f}"] for step in protocol.steps
    ]
    title = f"{protocol.wanted}: ± {100 * protocol.half:.1f} points now"
    print_table(["weigh or count", "kernels", "repetitions", "then known to, points"], rows, title)
    print_lines([protocol.sentence, f"{protocol.page}\n{protocol.form}"])
