"""Records: frozen dataclasses whose fields carry a unit and a meaning, and the one way between them and JSON.

A field is declared with :func:`column`. A reader of the type then sees what docs/results.md prints, and a test holds
the page against the types.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from enum import Enum
from functools import cache
from typing import Any, Self, TypeVar, Union, get_args, get_origin, get_type_hints

from .errors import SceneError

__all__ = ["Column", "Partial", "column", "columns", "from_json", "to_json"]

Kind = TypeVar("Kind")


def column(
    unit: str, meaning: str, *, key: str = "", absent: bool = False, flat: bool = False, default: Any = MISSING
) -> Any:
    """A field of a record: its ``unit`` ("1" for a plain number, "" for text) and what it means.

    ``key``: its name in JSON, where it differs from the field's. ``absent``: None leaves the key out of the JSON.
    ``flat``: the keys of this record stand among those of the one that holds it; None leaves all of them out.
    """
    metadata = {"unit": unit, "meaning": meaning, "key": key, "absent": absent, "flat": flat}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Partial:
    """A record whose JSON table need not hold every key: ``told`` are the keys that it holds, in their order.

    A key that is not told reads as None. A record that is made without ``told`` tells all of its keys.
    """

    told: tuple[str, ...] | None = field(default=None, kw_only=True, repr=False, compare=False)

    def extended(self, **parts: Any) -> Self:
        """The same record with ``parts`` told after the others."""
        told = None if self.told is None else (*self.told, *parts)
        return replace(self, told=told, **parts)


@dataclass(frozen=True)
class Column:
    """One key of a record's JSON table: the ``name`` of its field, the ``kind`` of value, ``unit`` and ``meaning``."""

    name: str
    key: str
    kind: Any
    unit: str
    meaning: str
    absent: bool
    flat: bool


@cache
def _columns(kind: Any) -> tuple[Column, ...]:
    hints = get_type_hints(kind)
    return tuple(
        Column(
            part.name, part.metadata["key"] or part.name, hints[part.name], part.metadata["unit"],
            part.metadata["meaning"], part.metadata["absent"], part.metadata["flat"],
        )
        for part in fields(kind)
        if "unit" in part.metadata
    )  # fmt: skip


def columns(kind: type) -> tuple[Column, ...]:
    """The columns of a record type, in the order of its JSON table."""
    return _columns(_any(kind))


def _any(kind: type) -> Any:
    """A type as a key of a cache: mypy does not take every type for hashable."""
    return kind


def to_json(value: Any) -> Any:
    """``value`` as JSON knows it: records and mappings become dicts, sequences lists; numbers and text stay."""
    if is_dataclass(value) and not isinstance(value, type):
        return _table(value)
    if isinstance(value, Mapping):
        return {str(key): to_json(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(member) for member in value]
    return value.value if isinstance(value, Enum) else value


def _table(record: Any) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for one in columns(type(record)):
        value = getattr(record, one.name)
        if one.flat:
            table |= {} if value is None else _table(value)
        elif value is not None or not one.absent:
            table[one.key] = to_json(value)
    told = record.told if isinstance(record, Partial) else None
    return table if told is None else {key: table[key] for key in told}


def from_json(kind: type[Kind], table: Any, where: str = "result.json") -> Kind:
    """The record of type ``kind`` that :func:`to_json` made ``table`` of.

    Raises SceneError, naming ``where`` and the key, where a key is missing or unknown or is null and must not be.
    """
    if not isinstance(table, Mapping):
        raise SceneError(f"{where}: is {table!r}, must be a table")
    known, values = columns(kind), {}
    for one in known:
        if one.flat:
            values[one.name] = _flat(one, table, where)
        elif one.key in table:
            values[one.name] = _read(one.kind, table[one.key], f"{where}: {one.key}")
        elif one.absent:
            values[one.name] = None
        elif not issubclass(kind, Partial):
            raise SceneError(f"{where}: {one.key} is missing")
    keys = _keys(_any(kind))
    if unknown := [key for key in table if key not in keys]:
        raise SceneError(f"{where}: {unknown[0]} is not known to this version of wakeflow")
    if issubclass(kind, Partial):
        values["told"] = tuple(table)
    return kind(**values)


@cache
def _keys(kind: Any) -> frozenset[str]:
    """Every key that a table of this type may hold, those of its flat parts too."""
    found: set[str] = set()
    for one in columns(kind):
        found |= _keys(_alone(one.kind)) if one.flat else {one.key}
    return frozenset(found)


def _flat(group: Column, table: Mapping[str, Any], where: str) -> Any:
    kind = _alone(group.kind)
    part = {key: value for key, value in table.items() if key in _keys(kind)}
    return from_json(kind, part, where) if part or kind is group.kind else None


def _alone(kind: Any) -> Any:
    """``X`` of ``X | None``."""
    if get_origin(kind) in (Union, types.UnionType):
        (kind,) = [part for part in get_args(kind) if part is not types.NoneType]
    return kind


def _read(kind: Any, value: Any, where: str) -> Any:
    if kind is Any:
        return value
    alone = _alone(kind)
    if value is None:
        if alone is kind:
            raise SceneError(f"{where}: is null, must have a value")
        return None
    if is_dataclass(alone):
        return from_json(alone, value, where)  # type: ignore[arg-type]
    origin, parts = get_origin(alone), get_args(alone)
    if origin is tuple:
        return tuple(_read(parts[0], member, where) for member in value)
    if origin is dict:
        return {key: _read(parts[1], member, f"{where}.{key}") for key, member in value.items()}
    return value
