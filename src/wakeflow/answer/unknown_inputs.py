"""What the numbers of the scene that are not known exactly were, and what each does to every number of an answer."""

from __future__ import annotations

from ..planning.unknowns import Unknown
from .joint import Bins
from .shares import InputPart, InputSummary

Parts = dict[str, dict[str, dict[str, InputPart]]]


def summary_of(one: Unknown) -> InputSummary:
    """An unknown with its interval."""
    return InputSummary(one.value, *one.ends, unit=one.unit, why=one.why)


def effects_in(own: Bins) -> tuple[Parts, dict[str, dict[str, InputPart]]]:
    """What each input alone does to every share, by fraction and bin; and to every recovery and purity of targets."""
    shares = {
        name: {place: parts for place in own.names if (parts := own.effects(own.of_share(name, [place]), name))}
        for name in own.joint.fractions
    }
    found: dict[str, dict[str, InputPart]] = {}
    for name, targets in own.joint.targets.items():
        if targets:
            found[f"recovery.{name}"] = own.effects(own.of_share(name, targets), name)
        for place in targets:
            if (own.joint.mass * own.value[:, own.names.index(place)]).sum() > 0.0:
                found[f"purity.{place}.{name}"] = own.effects(own.of_purity(place, name))
    return shares, found
