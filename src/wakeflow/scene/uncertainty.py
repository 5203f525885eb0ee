"""[uncertainty]: how far the scene's own numbers may be off.

``fraction.wheat.restitution = {value = 0.5, uncertainty = 0.1}`` says that the mean restitution of the wheat at hand
lies between 0.4 and 0.6 in 19 of 20 cases. The same is in the table [uncertainty] under the key's own name, where
every command finds it: ``uncertainty.fraction.wheat.restitution``. What is not given has the default of
``laws.material``; 0 says that a number is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..core.quantities import quantity, split_quantity

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
    found: dict[str, object] = {}
    plain = _plain(data, "", found)
    if not found:
        return data
    given = plain.get(TABLE, {})
    return {**plain, TABLE: {**found, **given} if isinstance(given, Mapping) else given}


def _plain(table: Mapping[str, object], place: str, found: dict[str, object]) -> dict[str, object]:
    """A copy of ``table``, whose uncertainties go to ``found`` by the dotted key of the number that has them."""
    made: dict[str, object] = {}
    for key, value in table.items():
        inside = f"{place}{key}"
        if not isinstance(value, Mapping) or inside == TABLE:
            made[key] = value
        elif _is_uncertain(inside) and MARGIN in value:
            found[inside] = value[MARGIN]
            rest = {name: part for name, part in value.items() if name != MARGIN}
            made[key] = rest[VALUE] if rest.keys() == {VALUE} else rest
        else:
            made[key] = _plain(value, f"{inside}.", found)
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
    return dict(_flat(value, ""))


def _flat(table: Mapping[object, object], place: str) -> Iterator[tuple[str, object]]:
    for key, value in table.items():
        inside = f"{place}{key}"
        if inside in (TOGETHER, NEVER_ABOVE):
            yield inside, value
        elif isinstance(value, Mapping):
            yield from _flat(value, f"{inside}.")
        else:
            yield inside, _margin(inside, value)


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
