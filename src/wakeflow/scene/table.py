"""What all tables of a scene share, and their number types: SI, or a string with a unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from itertools import pairwise
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PrivateAttr,
    TypeAdapter,
    create_model,
)
from pydantic_core.core_schema import (
    CoreSchema,
    no_info_after_validator_function,
    no_info_before_validator_function,
    wrap_serializer_function_ser_schema,
)

from ..core.errors import SceneError
from ..core.quantities import QUANTITY, quantity
from ..core.record import JsonTable
from ..core.registry import Registry
from ..laws.constants import GRAVITY
from ..laws.vibration import MAX_ROCK

# -- What all tables of a scene share ----------------------------------------------------------------------------------
Array = NDArray[np.float64]


class Table(BaseModel):
    """A table of a scene file: unknown keys and values of another type are refused, and nothing changes it later."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def flat(tables: Mapping[str, object]) -> JsonTable:
    """Nested tables as dotted keys and their values.

    >>> flat({"air": {"speed": 5.0}, "fraction": {"husk": {"size": {"mean": 1e-3}}}})
    {'air.speed': 5.0, 'fraction.husk.size.mean': 0.001}
    """
    result: dict[str, object] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping) and value:
            result |= {f"{key}.{below}": member for below, member in flat(value).items()}
        else:
            result[key] = value
    return result


def without_none(table: Mapping[str, Any]) -> JsonTable:
    """The table, and those in it, without the keys that have no value."""
    return {
        key: without_none(value) if isinstance(value, Mapping) else value
        for key, value in table.items()
        if value is not None
    }


class LawTable(Table):
    """A table that names a law, a shape or a motion, whose parameters are keys beside the name."""

    takes: ClassVar[tuple[str, ...]] = ()  # of :func:`parameters`

    @property
    def given(self) -> dict[str, Any]:
        """The parameters that are given, by their keys."""
        return {key: value for key in self.takes if (value := getattr(self, key)) is not None}


Kind = TypeVar("Kind", bound=LawTable)


def parameters(**types: Any) -> Callable[[type[Kind]], type[Kind]]:
    """A table with these keys beside its own, of which the law or shape that it names takes some; read by
    :attr:`LawTable.given` alone. ``types``: of each key its type, or that, a description and the name in the file.
    """
    keys: dict[str, Any] = {}
    for key, item in types.items():
        inner, words, name = (*item, None)[:3] if isinstance(item, tuple) else (item, None, None)
        keys[key] = inner | None, Field(None, description=words, alias=name)

    def with_keys(table: type[Kind]) -> type[Kind]:
        made = create_model(table.__name__, __base__=table, __module__=table.__module__, __doc__=table.__doc__, **keys)
        made.takes = tuple(keys)
        return made

    return with_keys


class Weighed(Table):
    """A table whose numbers depend on gravity, which the scene tells it."""

    _gravity: float = PrivateAttr(GRAVITY)

    @property
    def gravity(self) -> float:
        """m/s2"""
        return self._gravity

    def weighed(self, gravity: float) -> None:
        """Take the scene's ``gravity`` (m/s2)."""
        self._gravity = gravity


@dataclass(frozen=True)
class Shorthand:
    """Marks a table that may be written as a value of the type ``short``, which ``table`` turns into the table. The
    JSON schema allows both.
    """

    short: Any
    table: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(
            lambda given: given if isinstance(given, Mapping | Table) else self.table(given), handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonTable:
        return {"anyOf": [TypeAdapter(self.short).json_schema(), handler(schema)]}


def made_by(laws: Registry[Callable[..., Array]], name: str, *args: object, **given: object) -> Array:
    """What the law called ``name`` makes of ``args`` and the parameters ``given``.

    Raises SceneError where there is no such law, and where it takes other parameters.
    """
    law = laws[name]
    try:
        return law(*args, **given)
    except TypeError:
        pass
    wanted = {p.name: p.default for p in signature(law).parameters.values() if p.kind is p.KEYWORD_ONLY}
    missing = [key for key, default in wanted.items() if default is Parameter.empty and key not in given]
    unknown = [key for key in given if key not in wanted]
    parts = [f"{word} {', '.join(keys)}" for word, keys in (("lacks", missing), ("has no", unknown)) if keys]
    raise SceneError(f"{laws.kind} {name!r} {' and '.join(parts)} (takes: {', '.join(wanted)})")


class Unset:
    """Marks a key that is 0, "" or without entries, as no value of it is, where it is not given. JSON has null then,
    and the schema no default; an empty text is refused where it is given.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        written = wrap_serializer_function_ser_schema(lambda value, write: write(value) if value else None)
        return {**no_info_after_validator_function(self._given, handler(source)), "serialization": written}

    @staticmethod
    def _given(value: object) -> object:
        if value == "":
            raise SceneError("give a value, or leave the key out")
        return value


UNSET = Unset()


# -- Number types of scene files ---------------------------------------------------------------------------------------
@dataclass(frozen=True)
class WithUnit:
    """Marks a number in ``unit``: a string with another unit of the kind, such as ``example``, is converted to it.

    :func:`wakeflow.core.quantities.quantity` reads the strings; pint is loaded only for them. Stands after the range,
    which is that of the number. The JSON schema allows both.
    """

    unit: str
    example: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(self._number, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonTable:
        text = {"type": "string", "pattern": QUANTITY}
        return {"anyOf": [handler(schema), text], "unit": self.unit, "examples": [self.example]}

    def _number(self, value: object) -> object:
        return quantity(value, self.unit, self.example) if isinstance(value, str) else value


def rise(values: Sequence[float]) -> bool:
    """Whether each of the values is above the one before it."""
    return all(low < high for low, high in pairwise(values))


RESERVED_BIN = "elsewhere"  # the bin in which everything counts that reaches no other
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,40}$")]  # becomes a patch and a file name
Length = Annotated[float, Field(gt=0, lt=1e3), WithUnit("m", "50 mm")]
Coordinate = Annotated[float, Field(gt=-1e3, lt=1e3), WithUnit("m", "-120 mm")]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Diameter = Annotated[float, Field(ge=1e-9, le=0.1), WithUnit("m", "4 mm")]
SlopeAngle = Annotated[
    float,
    Field(ge=math.radians(10) - 1e-9, le=math.radians(80) + 1e-9),
    WithUnit("rad", "60 deg"),
]
TiltAngle = Annotated[float, Field(ge=-math.pi / 2 - 1e-9, le=math.pi / 2 + 1e-9), WithUnit("rad", "20 deg")]
RockAngle = Annotated[float, Field(gt=0, le=MAX_ROCK), WithUnit("rad", "2 deg")]
AnyAngle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi), WithUnit("rad", "90 deg")]
ScatterAngle = Annotated[float, Field(ge=0, le=1), WithUnit("rad", "0.1 rad")]
Speed = Annotated[float, Field(ge=0, le=100), WithUnit("m/s", "1.4 m/s")]
PositiveSpeed = Annotated[float, Field(ge=1e-6, le=100), WithUnit("m/s", "5 m/s")]
MassDensity = Annotated[float, Field(gt=0, le=3e4), WithUnit("kg/m^3", "1300 kg/m^3")]
Temperature = Annotated[float, Field(ge=170, le=1900), WithUnit("K", "20 degC")]
Pressure = Annotated[float, Field(ge=1e3, le=1e6), WithUnit("Pa", "1013 hPa")]
FreePath = Annotated[float, Field(ge=0, lt=1e-2), WithUnit("m", "0.066 um")]
Gravity = Annotated[float, Field(ge=0.01, le=1e4), WithUnit("m/s^2", "9.81 m/s^2")]
Viscosity = Annotated[float, Field(ge=1e-7, le=1), WithUnit("Pa*s", "1.8e-5 Pa*s")]
Frequency = Annotated[float, Field(gt=0, le=1e4), WithUnit("Hz", "30 Hz")]
Duration = Annotated[float, Field(gt=0, lt=1e4), WithUnit("s", "0.2 s")]
MassRate = Annotated[float, Field(gt=0), WithUnit("kg/s", "500 kg/hour")]
AirFlow = Annotated[float, Field(ge=0, le=1e4), WithUnit("m^3/s", "2000 m3/hour")]
Drop = Annotated[float, Field(ge=0, le=1e5), WithUnit("Pa", "400 Pa")]
Mass = Annotated[float, Field(gt=0, lt=1e3), WithUnit("kg", "35 g")]
Modulus = Annotated[float, Field(ge=5e6, le=1e9), WithUnit("Pa", "5 MPa")]
SHARE = WithUnit("1", "90 %")
Portion = Annotated[float, Field(gt=0, le=1), SHARE]
