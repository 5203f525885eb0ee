"""The numbers of a result as one flat list: name, unit, value, 95 % interval and the whole error.

Read off the types of the result: what a record there gains is in the list, in every table and figure made of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, get_args

from ..core.number import Number
from ..core.record import columns
from ..funnel.delivered import FunnelSummary
from ..scene import RESERVED_BIN, Scene
from .airflow_summary import Airflow
from .landing_results import Separation
from .result import Result

SECONDS = "seconds"
RENAMED = {"fractions": "share"}  # as the rows of the budget are called
PARTS = ("share.", "purity.", "recovery.")


@dataclass(frozen=True, kw_only=True)
class TableQuantity(Number):
    """One number of a result, its ``unit`` ("1" for plain numbers), and ``error``, the total of its budget, None where
    parts are unknown or there is none.
    """

    name: str
    unit: str
    error: float | None = None


def is_part(name: str) -> bool:
    """Whether a number is a part of a whole, 0 to 1, with or without collisions."""
    return name.removeprefix("without_collisions.").startswith(PARTS)


def quantities_of(result: Result) -> tuple[TableQuantity, ...]:
    """Shares (share.FRACTION.BIN), purity.BIN.FRACTION, recovery.FRACTION, throughput.BIN; the airflow's and the
    funnel's numbers (airflow.cd, ...); seconds, the run time of all stages when they were computed.
    """
    errors = {row.quantity: row.total.error for row in result.budget}
    found: list[TableQuantity] = []
    if result.landings is not None:
        for one in columns(type(result.landings)):
            part = getattr(result.landings, one.name)
            if isinstance(part, Separation):
                found += _inside(part, "" if one.name == "separation" else f"{one.key}.", errors)
    if result.airflow is not None:
        found += _measured(result.airflow, "airflow.")
    if result.funnel is not None:
        found += _measured(result.funnel, "funnel.")
    spent = sum(stage.seconds for stage in result.seconds.values())
    return (*found, TableQuantity(spent, name=SECONDS, unit="s"))


def names_for(scene: Scene) -> list[str]:
    """Every name that :func:`quantities_of` may give to a number of a scene's results, whatever its rung."""
    bins = [*scene.with_top().bin, RESERVED_BIN]
    landed = [
        *(f"{RENAMED['fractions']}.{fraction}.{place}" for fraction in scene.fraction for place in bins),
        *(f"purity.{place}.{fraction}" for place in bins for fraction in scene.fraction),
        *(f"recovery.{name}" for name, fraction in scene.fraction.items() if fraction.targets),
        *(f"throughput.{place}" for place in bins),
    ]
    found = [*landed, *(f"without_collisions.{name}" for name in landed), SECONDS]
    for prefix, kind, given in (("airflow", Airflow, scene.air), ("funnel", FunnelSummary, scene.funnel)):
        if given is not None:
            told = [one for one in columns(kind) if {Number, float} & {one.kind, *get_args(one.kind)}]
            found += [f"{prefix}.{one.key}" for one in told]
    return found


def _inside(record: Any, prefix: str, errors: Mapping[str, float | None]) -> Iterator[TableQuantity]:
    for one in columns(type(record)):
        name = prefix + RENAMED.get(one.key, one.key)
        yield from _numbers(getattr(record, one.name), name, one.unit, errors)


def _measured(record: Any, prefix: str) -> Iterator[TableQuantity]:
    """The numbers of a record, not those of records inside it, which say how it was computed."""
    for one in columns(type(record)):
        value = getattr(record, one.name)
        if isinstance(value, Number | float):
            yield from _numbers(value, prefix + one.key, one.unit, {})


def _numbers(value: Any, name: str, unit: str, errors: Mapping[str, float | None]) -> Iterator[TableQuantity]:
    if isinstance(value, Mapping):
        for key, member in value.items():
            yield from _numbers(member, f"{name}.{key}", unit, errors)
    elif isinstance(value, Number):
        yield TableQuantity(value.value, value.low, value.high, value.numerical, name=name, unit=unit,
                            error=errors.get(name))  # fmt: skip
    elif is_dataclass(value):
        yield from _inside(value, f"{name}.", errors)
    elif isinstance(value, float):
        yield TableQuantity(value, name=name, unit=unit, error=errors.get(name))
