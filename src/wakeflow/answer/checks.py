"""What a result that is read must hold whatever it is about: numbers within their intervals, shares that sum to one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

from ..core.number import Number

if TYPE_CHECKING:
    from .shares import Separation

ROUNDED = 1e-6  # by how much sums and ends of intervals may be off


def mistakes_in(result: object, shares: Mapping[str, Separation | None]) -> Iterator[str]:
    """What is wrong with a record, and with the ``shares`` in it, by their names: each in words that name the key."""
    yield from _in_numbers(result, "")
    for name, part in shares.items():
        if part is not None:
            yield from _in_shares(part, name)


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
    parts = [*part.recovery.items(), *((k, one) for k, row in part.purity.items() for one in (row or {}).values())]
    for key, found in parts:
        if found is not None and not -ROUNDED <= found.value <= 1.0 + ROUNDED:
            yield f"{name}: {found.value:.6g} of {key} is no share, 0 to 1"
    for place, rate in part.throughput.items():
        if not 0.0 <= rate < math.inf:
            yield f"{name}.throughput.{place} = {rate:.6g} is no rate"
