"""What a result that is read must hold whatever it is about: numbers within their intervals, shares that sum to one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Set
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.number import Number
from ..core.record import JsonMapping
from ..core.tables import Columns

if TYPE_CHECKING:
    from .shares import LandingResults, Separation

ROUNDED = 1e-6  # by how much sums and ends of intervals may be off


def mistakes_in(result: object, scene: JsonMapping, landings: LandingResults | None) -> Iterator[str]:
    """What is wrong with a result, the ``scene`` and the ``landings`` in it: each in words that name the key."""
    yield from _in_scene(scene)
    yield from _in_numbers(result, "")
    if landings is not None:
        for name in ("separation", "without_collisions"):
            if (shares := getattr(landings, name)) is not None:
                yield from _in_shares(shares, name)
        yield from _in_inputs(landings)


def _in_scene(scene: JsonMapping) -> Iterator[str]:
    """Fractions that are no tables, and targets that name no bins."""
    fractions = scene.get("fraction")
    if not isinstance(fractions, Mapping) or not all(isinstance(one, Mapping) for one in fractions.values()):
        yield "scene.fraction is no table of fractions"
        return
    for name, one in fractions.items():
        target = one.get("target") or []
        if not isinstance(target, str | list | tuple) or not all(isinstance(place, str) for place in target):
            yield f"scene.fraction.{name}.target names no bins"


def _in_inputs(landings: LandingResults) -> Iterator[str]:
    """Inputs that nothing is known of, and numbers of the answer that there are not, in what inputs do to it."""
    shares, inputs = landings.separation.fractions, landings.inputs
    targets = {f"recovery.{name}" for name in shares}
    targets |= {f"purity.{place}.{name}" for name, places in shares.items() for place in places}
    moved = {f"of_targets.{name}": parts for name, parts in landings.of_targets.items()}
    for name in landings.of_targets:
        if name not in targets:
            yield f"of_targets.{name} is no recovery and no purity of the answer"
    for name, places in landings.measure_next.items():
        for place, parts in places.items():
            moved[f"measure_next.{name}.{place}"] = parts
            if place not in shares.get(name, {}):
                yield f"measure_next.{name}.{place} is no share of the answer"
    for where, parts in moved.items():
        if unknown := [key for key in parts if key not in inputs]:
            yield f"{where}.{unknown[0]} is none of the inputs"


def _in_numbers(value: object, place: str) -> Iterator[str]:
    """Numbers that are none, and intervals that do not hold their number."""
    if isinstance(value, Number):
        slack = ROUNDED * max(1.0, abs(value.value)) if math.isfinite(value.value) else 0.0
        if not value.low - slack <= value.value <= value.high + slack:  # of NaN neither
            yield f"{place} = {value.value:.6g} is outside of its interval, {value.low:.6g} to {value.high:.6g}"
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield from _in_numbers(one, f"{place}.{key}".removeprefix("."))
    elif isinstance(value, tuple | list):
        for number, one in enumerate(value, 1):
            if not isinstance(one, float | int | str):
                yield from _in_numbers(one, f"{place}[{number}]")
    elif is_dataclass(value):
        for one in fields(value):
            yield from _in_numbers(getattr(value, one.name), f"{place}.{one.name}".removeprefix("."))


def _in_shares(part: Separation, name: str) -> Iterator[str]:
    for fraction, places in part.fractions.items():
        if set(places) != set(part.bins):
            yield f"{name}.fractions.{fraction}: its bins are not those of the scene"
        for place, share in places.items():
            if not 0.0 <= share.value <= 1.0:
                yield f"{name}.fractions.{fraction}.{place} = {share.value:.6g} is no share, 0 to 1"
        total = sum(share.value for share in places.values())
        if abs(total - 1.0) > ROUNDED:
            yield f"{name}.fractions.{fraction}: its shares sum to {total:.6g}, not to 1"
    pure = ((place, one) for place, row in part.purity.items() for one in (row or {}).values())
    for key, found in (*part.recovery.items(), *part.loss.items(), *part.dirt.items(), *pure):
        if found is not None and not -ROUNDED <= found.value <= 1.0 + ROUNDED:
            yield f"{name}: {found.value:.6g} of {key} is no share, 0 to 1"
    for place, rate in part.throughput.items():
        if not 0.0 <= rate < math.inf:
            yield f"{name}.throughput.{place} = {rate:.6g} is no rate"


# of granules.npz: a row for each granule that is kept
KEPT = ("fraction", "weight", "position", "bin", "diameter", "fate", "time", "impacts")


def are_granules(table: Columns, fractions: Set[str], bins: int | None) -> bool:
    """Whether the arrays of granules.npz are those of an answer: granules of its ``fractions``, in one of so many
    ``bins`` (None where it ended before it had any), somewhere, with a size and a mass.
    """
    if set(table) != {"names", *KEPT} or not all(table[name].dtype.kind in "iuf" for name in KEPT):
        return False
    names, fraction, place, mass = (table[name] for name in ("names", "fraction", "bin", "weight"))
    shapes = {"position": (mass.size, 2)}
    return bool(
        all(table[name].shape == shapes.get(name, (mass.size,)) for name in KEPT)
        and all(np.isfinite(table[name]).all() for name in KEPT)
        and fraction.dtype.kind in "iu"
        and place.dtype.kind in "iu"
        and names.shape == (len(fractions),)
        and set(names.tolist()) == fractions
        and ((fraction >= 0) & (fraction < len(fractions))).all()
        and (place >= -1).all()  # elsewhere, which is the last of the bins
        and (bins is None or (place < bins - 1).all())
        and (table["diameter"] > 0).all()
        and (mass >= 0).all()
        and (np.bincount(fraction.astype(int), mass)[fraction] > 0).all()  # a fraction weighs something
    )
