"""Number types of scene files: a number in SI, or a string with a unit, each with the range that makes sense."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

__all__ = [
    "AnyAngle",
    "Coordinate",
    "Diameter",
    "Duration",
    "Frequency",
    "Length",
    "Mass",
    "MassDensity",
    "MassRate",
    "Modulus",
    "Name",
    "Point",
    "Portion",
    "PositiveSpeed",
    "ScatterAngle",
    "SlopeAngle",
    "Speed",
    "Viscosity",
]  # fmt: skip


def _in(unit: str, example: str) -> BeforeValidator:
    """Convert a string with a unit to a number in ``unit`` (pint is loaded only for strings); numbers pass."""

    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        import pint

        try:
            quantity = pint.application_registry.Quantity(value)
            return float(quantity.to(unit).magnitude)
        except (pint.PintError, ValueError, AssertionError, AttributeError, TypeError):
            raise ValueError(f"needs a number in {unit} or a string such as {example!r}") from None

    return BeforeValidator(convert)


def _unit(unit: str) -> dict[str, Any]:
    return {"unit": unit}


Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,40}$")]  # becomes a patch and a file name
Length = Annotated[float, Field(gt=0, lt=1e3, json_schema_extra=_unit("m")), _in("m", "50 mm")]
Coordinate = Annotated[float, Field(gt=-1e3, lt=1e3, json_schema_extra=_unit("m")), _in("m", "-120 mm")]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Diameter = Annotated[float, Field(ge=1e-9, le=0.1, json_schema_extra=_unit("m")), _in("m", "50 um")]
SlopeAngle = Annotated[
    float,
    Field(ge=math.radians(10) - 1e-9, le=math.radians(80) + 1e-9, json_schema_extra=_unit("rad")),
    _in("rad", "60 deg"),
]
AnyAngle = Annotated[
    float, Field(ge=-2 * math.pi, le=2 * math.pi, json_schema_extra=_unit("rad")), _in("rad", "90 deg")
]
ScatterAngle = Annotated[float, Field(ge=0, le=1, json_schema_extra=_unit("rad")), _in("rad", "0.1 rad")]
Speed = Annotated[float, Field(ge=0, le=100, json_schema_extra=_unit("m/s")), _in("m/s", "1.4 m/s")]
PositiveSpeed = Annotated[float, Field(ge=1e-6, le=100, json_schema_extra=_unit("m/s")), _in("m/s", "5 m/s")]
MassDensity = Annotated[float, Field(gt=0, le=3e4, json_schema_extra=_unit("kg/m^3")), _in("kg/m^3", "1300 kg/m^3")]
Viscosity = Annotated[float, Field(ge=1e-7, le=1, json_schema_extra=_unit("Pa*s")), _in("Pa*s", "1.8e-5 Pa*s")]
Frequency = Annotated[float, Field(gt=0, le=1e4, json_schema_extra=_unit("Hz")), _in("Hz", "30 Hz")]
Duration = Annotated[float, Field(gt=0, lt=1e4, json_schema_extra=_unit("s")), _in("s", "0.2 s")]
MassRate = Annotated[float, Field(gt=0, json_schema_extra=_unit("kg/s")), _in("kg/s", "500 kg/hour")]
Mass = Annotated[float, Field(gt=0, lt=1e3, json_schema_extra=_unit("kg")), _in("kg", "35 g")]
Modulus = Annotated[float, Field(ge=5e6, le=1e9, json_schema_extra=_unit("Pa")), _in("Pa", "5 MPa")]
Portion = Annotated[float, Field(gt=0, le=1)]
