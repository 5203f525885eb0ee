"""Whether an answer keeps the limits of its scene: met, not met or open, and what would decide."""

from __future__ import annotations

from collections.abc import Iterator

from ...core.number import Number
from ...scene import Scene
from ..measurements import measured_words, purchases
from ..result import Result
from ..shares import OPEN, Standing, Verdict
from .budget import remedies


def verdicts_of(result: Result) -> Iterator[Verdict]:
    """A verdict on every limit of the scene of a ``result`` that has shares."""
    if result.landings is None:
        return
    separation = result.landings.separation
    for name, most in Scene.parse(result.scene).limit.asked.items():
        kind, of = name.split(".")
        value = separation.loss[of] if kind == "loss" else separation.dirt[of]
        verdict = judged(result, value, most)
        yield Verdict(name, most, value, verdict, _deciding(result, name, value, most) if verdict is OPEN else "")


def judged(result: Result, value: Number | None, most: float) -> Standing:
    """Whether a ``value`` of a ``result`` is known to be at most so much: met, not met or open. An answer that is void
    says nothing, and one whose interval lacks something at most what exceeds the limit is known to be too little.
    """
    if value is None or result.void or result.lacking:
        return OPEN
    return Standing.of(value.low, value.high, most)


def _deciding(result: Result, name: str, value: Number | None, most: float) -> str:
    """What would decide of a limit that is open: first what is against every number of the answer, then finer
    computing where that alone leaves it open, then the measurement that leaves the limit out of the interval.
    """
    if result.void:
        return f"an answer that is not void: {result.why_void}"
    if value is None:
        return "a design in which something lands there"
    if result.lacking:
        cures = "; ".join(remedies(result.lacking)) or "nothing that the program computes"
        return f"the size of {', '.join(result.lacking)}, which the interval lacks: {cures}"
    if value.numerical is not None and value.value - value.numerical <= most < value.value + value.numerical:
        return f"finer computing, which alone leaves +- {100 * value.numerical:.2g} points (--target-error)"
    own = result.joint.own
    of = own.of_name(name)
    bought = [] if of is None else purchases(result, name, value, own.effects(of))
    for one in bought:
        if Standing.of(one.number.low, one.number.high, most) is not OPEN:
            return f"measuring {measured_words(one)}"
    return f"no measurement alone; first {measured_words(bought[0])}" if bought else "no single measurement"
