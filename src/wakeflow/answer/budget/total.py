"""All parts of an answer's error in one joint ensemble: each source is a column of it, by what it is known to be.

Halves of 95 % intervals (granules, shedding cycles, steps, mesh, the slab, the air's load) are normal; true bounds
(terms left out), of which nothing is known between -bound and +bound, are rectangular (JCGM 100:2008, 4.3.7). What one
bin of a fraction has too much by a source, its others lack. Sources of different runs are independent, but for those
that are a number of the world. A part of unknown size makes the total unknown: the row then says what to give or to
run, and its interval holds what is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.number import Number
from ...planning.unknowns import SIGMAS
from ..draws import ErrorSource as Column
from ..draws import tied_root
from ..joint import JointAnswer
from ..shares import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetTotal
from .source import INPUTS, budget_sources

if TYPE_CHECKING:
    from .source import FractionResults

BOUNDS = (LEFT_OUT, NOT_COMPUTED)
WEIGHS = 1.0 / 3.0  # of a total: a bound larger than that must be computed, or the row says so
Parts = Mapping[str, Mapping[str, Sequence[BudgetPart]]]  # by fraction and bin


def remedies(names: Iterable[str]) -> list[str]:
    """What to give or to run where the sizes of these sources' errors are not known, each once."""
    found = (budget_sources[name].if_unknown for name in names if name in budget_sources)
    return list(dict.fromkeys(one for one in found if one))


def numerical(parts: Iterable[BudgetPart]) -> float:
    """Half of the 95 % interval that computing alone is expected to leave (granules, cycles, steps, mesh): of parts as
    other settings would have them, before any ensemble is there.
    """
    computed = (part for part in parts if part.kind is None and not _beyond_computing(part.source))
    return math.hypot(*(part.error or 0.0 for part in computed))


def _beyond_computing(name: str) -> bool:
    """Whether no finer computing makes a source's error smaller."""
    return name == INPUTS or (name in budget_sources and budget_sources[name].beyond_computing)


def in_ensemble(joint: JointAnswer, parts: Parts, results: Mapping[str, FractionResults]) -> JointAnswer:
    """The ensemble with a column for each source of the ``parts``, of the fractions whose ``results`` are there."""
    return replace(joint, sources=(*joint.sources, *_columns(joint, parts, results)))


def _columns(joint: JointAnswer, parts: Parts, results: Mapping[str, FractionResults]) -> Iterator[Column]:
    every = [part for places in parts.values() for found in places.values() for part in found]
    bounds = {part.source: part.kind in BOUNDS for part in every if part.error is not None and part.source != INPUTS}
    for name, bounded in bounds.items():
        source = budget_sources[name] if not bounded and name in budget_sources else None
        own = None if source is None else source.column([results[one] for one in joint.fractions])
        if own is not None:
            yield own
            continue
        halves = {one: np.array([_half(name, found) for found in parts[one].values()]) for one in joint.fractions}
        tied = np.stack([tied_root(halves[one]) for one in joint.fractions])
        yield Column(name, tied, computing=not bounded and not _beyond_computing(name), bounded=bounded)


def _half(name: str, parts: Sequence[BudgetPart]) -> float:
    """Half of a 95 % interval that a source's parts are worth among others."""
    sizes = [SIGMAS / math.sqrt(3.0) * (one.error or 0.0) if one.kind in BOUNDS else one.error or 0.0
             for one in parts if one.source == name]  # fmt: skip
    return math.hypot(*sizes)


def total_of(number: Number, parts: Sequence[BudgetPart], seconds: float) -> BudgetTotal:
    """The total of a row of a share, a ``number`` of the ensemble; ``seconds``: run time of all that it rests on."""
    error, notes = max(number.value - number.low, number.high - number.value), []
    missing = [part.source for part in parts if part.error is None]
    if missing:
        notes.append(f"not known: {', '.join(missing)}; {'; '.join(remedies(missing))}".rstrip("; "))
    large = [part.source for part in parts if part.kind in BOUNDS and (part.error or 0.0) > WEIGHS * max(error, 1e-12)]
    if large:
        notes.append(f"mostly a bound on what is not computed: {', '.join(large)}")
    told = "; ".join(notes) or None
    return BudgetTotal(None if missing else error, seconds, number.low, number.high, number.numerical, told)
