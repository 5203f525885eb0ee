"""What all tables of a scene share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import Parameter, signature
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter
from pydantic_core.core_schema import CoreSchema, no_info_before_validator_function

__all__ = ["Shorthand", "Table", "takes"]

Array = NDArray[np.float64]


class Table(BaseModel):
    """A table of a scene file: unknown keys and values of another type are refused, and nothing changes it later."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


@dataclass(frozen=True)
class Shorthand:
    """Marks a table that may be written as a value of the type ``short``, which ``table`` turns into the table; tables
    pass through it. The JSON schema allows both.
    """

    short: Any
    table: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(self.table, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [TypeAdapter(self.short).json_schema(), handler(schema)]}


def takes(kind: str, name: str, function: Callable[..., Any], given: Mapping[str, Any]) -> str:
    """What a registered function needs, from its signature, after it refused ``given``."""
    wanted = {p.name: p.default for p in signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY}
    missing = [key for key, default in wanted.items() if default is Parameter.empty and key not in given]
    unknown = [key for key in given if key not in wanted]
    parts = [f"{word} {', '.join(keys)}" for word, keys in (("lacks", missing), ("has no", unknown)) if keys]
    return f"{kind} {name!r} {' and '.join(parts)} (takes: {', '.join(wanted)})"
