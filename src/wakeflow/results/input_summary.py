"""What the unknown inputs of a run were, and what each does to every share: tables of result.json."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .landing_results import InputPart, InputSummary

if TYPE_CHECKING:
    from .inputs import Inputs

__all__ = ["inputs_of"]

Parts = dict[str, dict[str, dict[str, InputPart]]]


def inputs_of(inputs: Inputs | None) -> tuple[dict[str, InputSummary] | None, Parts | None]:
    """Every unknown with its interval by key, and by fraction and bin its part; None where everything is known."""
    if inputs is None:
        return None, None
    known = {one.key: InputSummary(one.value, *one.ends, unit=one.unit, why=one.why) for one in inputs.draws.unknowns}
    parts: Parts = {}
    for name, shares in inputs.shares.items():
        ranges = ((place, inputs.of_share(name, [place])) for place in shares)
        parts[name] = {
            place: {
                effect.unknown.key: InputPart(effect.half, effect.share, effect.error, effect.rise)
                for effect in over.effects
            }
            for place, over in ranges
            if over.effects
        }
    return known, parts
