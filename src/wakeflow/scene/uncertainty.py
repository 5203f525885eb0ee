"""[uncertainty]: how far the scene's own numbers may be off, which of them move together, which is never above another.

``fraction.wheat.restitution = {value = 0.5, uncertainty = 0.1}`` says that the mean restitution of the wheat at hand
lies between 0.4 and 0.6 in 19 of 20 cases. The same is in the table [uncertainty] under the key's own name, where
every command finds it: ``uncertainty.fraction.wheat.restitution``. What is not given has the default of
``laws.material``; 0 says that a number is exact.

``together = [{inputs = ["fraction.wheat.restitution", "fraction.chaff.restitution"], correlation = 0.8}]`` says that
where one is too large, the other most likely is too. ``never_above = [["fraction.chaff.restitution",
"fraction.wheat.restitution"]]`` says that the chaff rebounds no better than the wheat, however little is known of both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from typing_extensions import TypedDict

from ..core.quantities import quantity, split_quantity
from ..core.registry import did_you_mean
from ..laws.material import default_margins
from .table import Table, flat

SIGMAS = 1.959964  # standard deviations to either end of a normal distribution's middle 95 %
Margin = float | str  # half of a 95 % interval: in the number's unit (SI), or "5 %" of the number
VALUE, MARGIN, TABLE = "value", "uncertainty", "uncertainty"
TOGETHER, NEVER_ABOVE = "together", "never_above"  # keys of the table that tie numbers to each other (ties.py)
EITHER_SIGN = ("feed.position",)  # of what may be uncertain: only such a number can be off by more than itself
# What may be uncertain, and the unit of each number
OF_FRACTION = {
    "restitution": "1",
    "friction": "1",
    "rebound_scatter": "rad",
    "terminal_velocity": "m/s",
    "size": "m",
    "inverse_inertia": "1",
    "density": "kg/m3",
    "moisture": "1",
}
OF_SCENE = {
    "feed.width": "m", "feed.position": "m", "feed.height": "m", "feed.speed": "m/s", "air.speed": "m/s",
    "air.turbulence": "1", "wake.theta": "1", "wake.strength": "1", "dispersion": "1",
    "collisions.restitution": "1", "collisions.friction": "1", "spin_lift": "1",
    "entrainment": "1",
}  # fmt: skip


def with_uncertainty_table(data: Mapping[str, object]) -> Mapping[str, object]:
    """The tables of a scene with every {value, uncertainty} as the value, its uncertainty in [uncertainty]."""
    result: dict[str, object] = {}
    plain = _plain(data, "", result)
    if not result:
        return data
    given = plain.get(TABLE, {})
    return {**plain, TABLE: {**result, **given} if isinstance(given, Mapping) else given}


def _plain(table: Mapping[str, object], place: str, by_key: dict[str, object]) -> dict[str, object]:
    """A copy of ``table``, whose uncertainties go to ``by_key`` by the dotted key of the number that has them."""
    made: dict[str, object] = {}
    for key, value in table.items():
        inside = f"{place}{key}"
        if not isinstance(value, Mapping) or inside == TABLE:
            made[key] = value
        elif _is_uncertain(inside) and MARGIN in value:
            by_key[inside] = value[MARGIN]
            rest = {name: part for name, part in value.items() if name != MARGIN}
            made[key] = rest[VALUE] if rest.keys() == {VALUE} else rest
        else:
            made[key] = _plain(value, f"{inside}.", by_key)
    return made


def _is_uncertain(key: str) -> bool:
    first, _, rest = key.partition(".")
    return key in OF_SCENE or (first == "fraction" and rest.rpartition(".")[2] in OF_FRACTION)


def margins(value: object) -> object:
    """{"air.speed": 0.1} from {air: {speed: "0.1 m/s"}}, as TOML reads ``uncertainty.air.speed = "0.1 m/s"``; what ties
    numbers to each other as it is.

    Raises ValueError for what is no uncertainty.
    """
    if not isinstance(value, Mapping):
        return value
    ties = {key: tie for key, tie in value.items() if key in (TOGETHER, NEVER_ABOVE)}
    numbers = {str(key): half for key, half in flat({**value, **dict.fromkeys(ties, 0.0)}).items() if half != {}}
    return {key: ties.get(key, _margin(key, half)) for key, half in numbers.items()}


def _margin(key: str, value: object) -> object:
    """An uncertainty as it is kept: a number of the SI, or a percentage as text. That of a number that takes none is
    left as it is: the whole scene tells which numbers do.
    """
    if not _is_uncertain(key):
        return value
    unit = OF_SCENE.get(key) or OF_FRACTION.get(key.rpartition(".")[2], "1")
    example = "5 %" if unit == "1" else f"0.1 {unit}"
    if isinstance(value, str):
        parts = split_quantity(value)
        if parts is not None and parts[1] == "%" and parts[0] >= 0.0:
            if parts[0] > 100.0 and key not in EITHER_SIGN:
                raise ValueError(f"{key} = {value!r}: a number that is never negative is off by 100 % at most")
            return f"{parts[0]:g} %"
        try:
            value = quantity(value, unit, example)
        except ValueError as problem:
            raise ValueError(f"{key} = {value!r}: {problem}") from None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < float("inf"):
        raise ValueError(f"{key} = {value!r}: needs a number that is not negative, or a part of the value: '5 %'")
    return float(value)


# -- Which numbers move together, and which is never above another -----------------------------------------------------
Array = NDArray[np.float64]
LEAST_FREE = 1e-6  # least eigenvalue of a matrix of correlations: below it one number follows from the others
INVOLVED = 1e-3  # part of a number in what cannot be from which on it is named
FINE = 100.0  # of a factor that a message names: hundredths
ANY_MARGIN = {"type": ["number", "string"]}  # what the JSON schema allows below a number's key


class Together(Table):
    """Numbers that are too large or too small together, each pair of them with the same ``correlation``."""

    inputs: Annotated[list[str], Field(min_length=2)] = Field(description="keys of numbers that take an uncertainty")
    correlation: Annotated[float, Field(gt=-1, lt=1)] = Field(
        description="below 0: where one is too large, the other is too small"
    )


if TYPE_CHECKING:
    UncertaintyTable = dict[str, Any]
else:

    class UncertaintyTable(TypedDict, total=False):
        """[uncertainty]: margins by the keys of their numbers, and what ties numbers to each other."""

        __pydantic_config__ = ConfigDict(
            extra="allow",
            json_schema_extra={
                "additionalProperties": {"anyOf": [ANY_MARGIN, {"type": "object", "additionalProperties": {
                    "anyOf": [ANY_MARGIN, {"type": "object", "additionalProperties": ANY_MARGIN}]}}]}
            },
        )  # fmt: skip
        together: Annotated[list[Together], Field(description="which numbers are too large or too small together")]
        never_above: Annotated[
            list[Annotated[list[str], Field(min_length=2)]],
            Field(description="lists of keys: the number at each is never above that at the next"),
        ]


def margins_of(uncertainty: UncertaintyTable) -> dict[str, Margin]:
    """The margins of single numbers by their keys."""
    return {key: value for key, value in uncertainty.items() if key not in (TOGETHER, NEVER_ABOVE)}


def orders_of(uncertainty: UncertaintyTable) -> list[tuple[str, str]]:
    """Each pair of keys of which the first number is never above the second."""
    return [pair for keys in uncertainty.get(NEVER_ABOVE, []) for pair in pairwise(keys)]


def said_of(uncertainty: UncertaintyTable) -> set[str]:
    """The keys of all numbers of which it is said how they move together."""
    return {key for tie in uncertainty.get(TOGETHER, []) for key in tie.inputs}


def correlation_of(uncertainty: UncertaintyTable, keys: Sequence[str]) -> Array:
    """The correlation (K, K) of the numbers at ``keys``; those that are not said to move together do not."""
    result, place = np.eye(len(keys)), {key: i for i, key in enumerate(keys)}
    for tie in uncertainty.get(TOGETHER, []):
        for item, other in combinations([place[key] for key in tie.inputs if key in place], 2):
            result[item, other] = result[other, item] = tie.correlation
    return result


# -- What cannot be ----------------------------------------------------------------------------------------------------
def wrong_ties(uncertainty: UncertaintyTable, units: Mapping[str, str]) -> Iterator[str]:
    """A line for each mistake in the ties of a scene, whose numbers that are drawn have these ``units`` by key."""
    lists = [(f"{TOGETHER}[{i}].inputs", tie.inputs) for i, tie in enumerate(uncertainty.get(TOGETHER, []), 1)]
    lists += [(f"{NEVER_ABOVE}[{i}]", keys) for i, keys in enumerate(uncertainty.get(NEVER_ABOVE, []), 1)]
    mistakes = [line for place, keys in lists for line in _wrong_keys(f"uncertainty.{place}", keys, units)]
    yield from mistakes or (*_said_twice(uncertainty), *_impossible(uncertainty), *_wrong_orders(uncertainty, units))


def _wrong_keys(place: str, keys: Sequence[str], units: Mapping[str, str]) -> Iterator[str]:
    for key in dict.fromkeys(keys):
        if key not in units:
            hint = "" if key in OF_SCENE else did_you_mean(key, list(units))
            yield f"{place}: no number {key!r} that is drawn with others{hint}"
    if len(set(keys)) < len(keys):
        yield f"{place}: names a number twice"


def _said_twice(uncertainty: UncertaintyTable) -> Iterator[str]:
    said: set[frozenset[str]] = set()
    for number, tie in enumerate(uncertainty.get(TOGETHER, []), 1):
        pairs = [frozenset(pair) for pair in combinations(tie.inputs, 2)]
        for pair in said.intersection(pairs):
            yield f"uncertainty.together[{number}]: how {' and '.join(sorted(pair))} move together is said before"
        said.update(pairs)


def _impossible(uncertainty: UncertaintyTable) -> Iterator[str]:
    """Mistake of correlations that no numbers have: their matrix is not positive definite. Made smaller by one factor
    they can be: with the least eigenvalue v by 1 / (1 - v); those of the numbers in its eigenvector are too large.
    """
    ties = uncertainty.get(TOGETHER, [])
    keys = list(dict.fromkeys(key for tie in ties for key in tie.inputs))
    if not keys:
        return
    sizes, ways = np.linalg.eigh(correlation_of(uncertainty, keys))
    if sizes[0] >= LEAST_FREE:
        return
    meant = {key for key, part in zip(keys, np.abs(ways[:, 0]), strict=True) if part > INVOLVED}
    which = [i for i, tie in enumerate(ties, 1) if len(meant.intersection(tie.inputs)) > 1]
    places = ", ".join(f"together[{i}]" for i in which)
    factor = np.floor(FINE * (1.0 - LEAST_FREE) / (1.0 - sizes[0])) / FINE
    lower = ", ".join(f"{np.trunc(1e3 * factor * ties[i - 1].correlation) / 1e3:g}" for i in which)
    yield (
        f"uncertainty.{places}: no numbers move together like this; lower to {lower}"
        + (", or say of each pair how it moves together" if len(which) > 1 else " or nearer to 0")
    )


def _wrong_orders(uncertainty: UncertaintyTable, units: Mapping[str, str]) -> Iterator[str]:
    above: dict[str, set[str]] = {}
    for low, high in orders_of(uncertainty):
        above.setdefault(high, set()).add(low)
        if units[low] != units[high]:
            lower, higher = (f"{key} ({'no unit' if units[key] == '1' else units[key]})" for key in (low, high))
            yield f"uncertainty.never_above: {lower} cannot be compared with {higher}"
    try:
        TopologicalSorter(above).prepare()
    except CycleError as problem:
        yield f"uncertainty.never_above goes round: {', '.join(problem.args[1])}; leave one of these orders out"


def source_of(key: str, why: str) -> str:
    """What the interval of the number at ``key`` of a scene rests on: the scene, a measurement, or a default with its
    source.
    """
    if not why.startswith("default"):
        return why
    entry = key.rpartition(".")[2] if key.startswith("fraction.") else key.replace(".", "_")
    margin = default_margins().get(entry)
    return why if margin is None else f"{why}: {margin.source}"
