"""Records: frozen dataclasses whose fields carry a unit and a meaning, and pydantic's way between them and JSON.

A field is declared with :func:`column`. A reader of the type then sees what docs/results.md prints, which is made of
the types. JSON has neither infinite numbers nor NaN: they become null.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_type_hints

from pydantic import ConfigDict, GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import core_schema

from .errors import SceneError
from .files import write_json

# A table of a JSON or TOML file: what it holds is known only where it is read.
JsonTable = dict[str, Any]
JsonMapping = Mapping[str, Any]
Kind = TypeVar("Kind")
WRONG = {  # what pydantic calls it, and what the user reads
    "missing": "is missing",
    "unexpected_keyword_argument": "is not known to this version of wakeflow",
    "dataclass_type": "must be a table",
}


def column(
    unit: str, meaning: str, *, key: str = "", absent: bool = False, flat: bool = False, default: object = MISSING
) -> Any:
    """A field of a record: its ``unit`` ("1" for a plain number, "" for text) and what it means.

    ``key``: its name in JSON, where it differs from the field's. ``absent``: None, or what is not a number, leaves the
    key out of the JSON.
    ``flat``: whoever writes the record puts the keys of this part among the record's own. ``default``: a value, or
    ``dict`` for an empty one.
    """
    metadata: dict[str, object] = {"description": meaning, "json_schema_extra": {"unit": unit, "flat": flat}}
    metadata |= {"exclude_if": lambda value: value is None or value != value} if absent else {}
    metadata |= {"alias": key} if key else {}
    if default is dict:
        return field(default_factory=dict, metadata=metadata)
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Null:
    """Marks a column (``Annotated[float, Null(math.nan)]``) that is ``empty`` where nothing is known, and null in JSON:
    a number that is none, or what is false (0 of a count, "", no entries, a record that says so of itself).
    """

    empty: Any

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        inner, number = handler(source), isinstance(self.empty, float)  # of numbers JSON has neither NaN nor infinity
        read = core_schema.no_info_before_validator_function(lambda x: self.empty if x is None else x, inner)
        written = core_schema.wrap_serializer_function_ser_schema(lambda x, write: write(x) if number or x else None)
        return {**read, "serialization": written}


class Column(NamedTuple):
    """One key of a record's JSON table: the ``name`` of its field, the ``kind`` of value, ``unit`` and ``meaning``."""

    name: str
    key: str
    kind: Any
    unit: str
    meaning: str
    absent: bool
    flat: bool


def columns(kind: type) -> Iterator[Column]:
    """The columns of a record type, in the order of its JSON table."""
    hints, marks = get_type_hints(kind), get_type_hints(kind, include_extras=True)
    for item in fields(kind):
        if (extra := item.metadata.get("json_schema_extra")) is not None:
            about, key = item.metadata["description"], item.metadata.get("alias", item.name)
            absent = "exclude_if" in item.metadata
            null = any(isinstance(mark, Null) for mark in getattr(marks[item.name], "__metadata__", ()))
            hint = hints[item.name] | None if null else hints[item.name]
            yield Column(item.name, key, hint, extra["unit"], about, absent, extra["flat"])


@cache
def _adapter(kind: Hashable) -> TypeAdapter[Any]:
    """The adapter of a table with one record in it, whose key names where the record comes from, in errors."""
    config = ConfigDict(extra="forbid", validate_by_name=True, serialize_by_alias=True)
    return TypeAdapter(dict[str, kind], config=config)  # type: ignore[valid-type]


def _plain(value: Any) -> object:
    """What pydantic does not know by itself: numpy's truths and whole numbers, and read-only mappings."""
    return value.item() if hasattr(value, "item") else dict(value)


def to_json(value: object) -> Any:
    """A record, or what holds some, as JSON knows it: records become dicts, sequences lists; numbers and text stay."""
    kind = type(value) if is_dataclass(value) else Any
    adapter = _adapter(kind)  # type: ignore[arg-type]  # mypy does not take every type for hashable
    return json.loads(adapter.dump_json({"": value}, warnings=False, fallback=_plain))[""]


def from_json(kind: type[Kind], table: object, where: str = "result.json") -> Kind:
    """The record of type ``kind`` that :func:`to_json` made ``table`` of.

    Raises SceneError, naming ``where`` and the key, where a key is missing or unknown or holds what it cannot.
    """
    try:
        result: Kind = _adapter(kind).validate_python({where: table})[where]  # type: ignore[arg-type]
    except ValidationError as problem:
        first = problem.errors()[0]
        _, *keys = map(str, first["loc"])
        given = "null, must have a value" if first["input"] is None else f"{first['input']!r:.40}, {first['msg']}"
        place = ": ".join([where, *([".".join(keys)] if keys else [])])
        raise SceneError(f"{place}: {WRONG.get(first['type'], f'is {given}')}") from None
    return result


def save(path: Path, record: object) -> None:
    """Write a record as JSON."""
    write_json(path, to_json(record))


def load(kind: type[Kind], path: Path) -> Kind:
    """The record that :func:`save` wrote."""
    return from_json(kind, json.loads(path.read_text()), path.name)
