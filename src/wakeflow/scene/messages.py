"""Messages for what pydantic finds wrong with a scene: one line with field, value and what is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from ..core.errors import SceneError
from ..core.registry import did_you_mean
from .bins import Bin
from .feed import Feed, Profile
from .fraction import Fraction, Rebound, Size, Speeds
from .funnel import Funnel
from .pictures import picture_tables
from .surroundings import Air, Body, Channel, Inlet, Samples, Vibration
from .whole import Numerics, SceneTables, SpanTable

__all__ = ["explain", "unit_of"]


def explain(problem: ValidationError) -> Iterator[str]:
    """Each mistake: where, the value given, what is wrong, what is allowed."""
    for error in problem.errors():
        where = [str(part) for part in error["loc"] if "[" not in str(part)]  # drop pydantic's words for itself
        value, text = error["input"], error["msg"].removeprefix("Value error, ")
        key = ".".join(part for place, part in enumerate(where) if (where[0], place) != ("picture", 2))  # its kind
        if error["type"].startswith("union_tag"):
            kinds = list(picture_tables())
            given = error.get("ctx", {}).get("tag")
            hint = "missing" if given is None else f"{given!r} is unknown{did_you_mean(given, kinds)}"
            yield f"{key}.kind: {hint} (known: {', '.join(kinds)})"
        elif error["type"] == "extra_forbidden":
            known = _known_keys(where[:-1])
            yield f"{key}: unknown key{did_you_mean(where[-1], known)} (known: {', '.join(known)})"
        elif error["type"] == "missing":
            yield f"{key}: missing{_allowed(where)}"
        elif isinstance(value, Mapping | BaseModel):
            yield f"{key}: {text}"
        else:
            yield f"{key} = {value!r}: {text[0].lower()}{text[1:]}{_allowed(where)}"


def _allowed(where: list[str]) -> str:
    """The range and unit of a field, from its JSON schema."""
    field = _schema_of(where)
    limits = [
        f"{sign} {field[word]:.6g}"
        for word, sign in (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
        if word in field
    ]
    unit = field.get("unit", "")
    if not limits and not unit:
        return ""
    hint = "; a string may carry another unit, such as '60 deg'" if unit == "rad" else ""
    return f" (allowed: {' and '.join(limits)} {unit}".rstrip() + f"{hint})"


def unit_of(key: str) -> str:
    """The SI unit of a dotted key of a scene, such as "m/s" of air.speed; empty for plain numbers and other values."""
    return str(_schema_of(key.split(".")).get("unit", ""))


def _schema_of(where: list[str]) -> dict[str, Any]:
    """What the JSON schema says of a field; empty where there is none."""
    try:
        model = _model_at(where[:-1])
    except SceneError:  # a picture of an unknown kind
        return {}
    field: dict[str, Any] = model.model_json_schema(by_alias=True)["properties"].get(where[-1], {}) if model else {}
    for several in ("anyOf", "oneOf"):  # a number or nothing; a number or a table
        field = {**field.get(several, [{}])[0], **field}
    return field


def _model_at(where: list[str]) -> type[BaseModel] | None:
    """The table that a dotted place belongs to; None inside keyed tables before their name."""
    keyed: dict[str, type[BaseModel]] = {"body": Body, "fraction": Fraction, "bin": Bin}
    plain: dict[str, type[BaseModel]] = {
        "channel": Channel, "air": Air, "vibration": Vibration, "feed": Feed, "funnel": Funnel,
        "numerics": Numerics,
    }  # fmt: skip
    if not where:
        return SceneTables
    if where[:2] == ["channel", "inlet"]:
        return Inlet if len(where) > 2 else None
    if where[:2] == ["vibration", "samples"]:
        return Samples
    if where[:2] == ["numerics", "span"]:
        return SpanTable
    if where[:2] == ["feed", "profile"]:
        return Profile
    if where[0] == "picture":  # its kind stands after its name
        return picture_tables()[where[2]] if len(where) > 2 else None
    if where[0] not in keyed:
        return plain.get(where[0])
    parts: dict[str, type[BaseModel]] = {"size": Size, "terminal_velocity": Speeds, "restitution": Rebound}
    if where[2:] and where[2] in parts:
        return parts[where[2]]
    return keyed[where[0]] if len(where) > 1 else None


def _known_keys(where: list[str]) -> list[str]:
    model = _model_at(where)
    return [] if model is None else [field.alias or key for key, field in model.model_fields.items()]
