"""The JSON schema of scene files: what an editor checks, and where messages find a key's unit and range."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from pydantic.json_schema import GenerateJsonSchema
from pydantic_core.core_schema import DictSchema, NullableSchema, WithDefaultSchema

from ..core.errors import SceneError
from ..core.quantities import say
from ..core.record import JsonTable
from ..core.registry import did_you_mean
from .scene_tables import SceneTables
from .table import without_none

Place = tuple[str | int, ...]  # keys, and places in lists, from the top of a scene
Node = JsonTable  # a schema within the schema
LIMITS = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))


class _OfToml(GenerateJsonSchema):
    """TOML has no null: a key that is not given is left out. Names of tables that the pattern refuses are refused."""

    def nullable_schema(self, schema: NullableSchema) -> Node:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: WithDefaultSchema) -> Node:
        if "serialization" in schema["schema"]:  # of a key that is not set: what it is then is no value of it
            return self.generate_inner(schema["schema"])
        node: Node = super().default_schema(schema)
        return without_none(node)

    def dict_schema(self, schema: DictSchema) -> Node:
        node: Node = super().dict_schema(schema)
        return {**node, "additionalProperties": False} if "patternProperties" in node else node


def scene_schema() -> Node:
    """JSON schema (2020-12) of a scene file. ``unit`` of a key is that of a number alone; its description says unit and
    range in words too.
    """
    made = SceneTables.model_json_schema(by_alias=True, schema_generator=_OfToml)
    for table in (made, *made["$defs"].values()):
        if "description" in table:  # python -OO leaves docstrings out
            table["description"] = table["description"].replace("``", "`")  # editors show Markdown
        for node in table["properties"].values():
            _document(node)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made, "title": "Scene"}


def _document(node: Node) -> None:
    """Add unit and range to the description of a key, for editors that show no more than that."""
    unit, example = unit_and_example(node) or ("1", "")
    words = [node.get("description", ""), allowed_range(node, unit)]
    if example:
        words.append(f"a number{'' if unit == '1' else f' in {unit}'}, or a string such as {example!r}")
    if any(words):
        node["description"] = "; ".join(word for word in words if word)


def allowed_range(node: Node, unit: str) -> str:
    """The range of a key in words, such as ">= 10 deg and <= 80 deg"; empty without one. ``unit``: that of its numbers,
    which is said as the user's; "1" for none.
    """
    number: Node = next((item for item in _here(node) if item.get("type") in ("number", "integer")), {})
    return " and ".join(f"{sign} {say(number[word], unit)}" for word, sign in LIMITS if word in number)


def known_keys(node: Node, table: object = None) -> list[str]:
    """The keys that a table may have, or the ``table`` that is given; none for one with other keys of the user's, and
    for a value.
    """
    kinds = (item for item in _variants(node) if table is None or _is_kind(item, table))
    closed = (item for item in kinds if "properties" in item and not item.get("additionalProperties"))
    return list(dict.fromkeys(key for item in closed for key in item["properties"]))


def unit_and_example(node: Node) -> tuple[str, str] | None:
    """Unit of a key's numbers and an example of a string for it; None where there is no unit."""
    return next(((item["unit"], item["examples"][0]) for item in _here(node) if "unit" in item), None)


def described(place: Place, data: object) -> Node:
    """What the schema says of ``place`` in a scene's ``data``; empty where nothing may be."""
    node, here = _schema(), data
    for part in place:
        node, here = _below(node, part, here), at(here, (part,))
    return node


def named_tables(place: Place, data: object) -> bool:
    """Whether ``place`` in a scene's ``data`` holds tables whose names are the user's, as [fraction] does."""
    return any("patternProperties" in item for item in _variants(described(place, data)))


def refuse_unknown(key: str, data: Any, where: str) -> None:
    """Raise SceneError where a dotted key leads to a table that a scene's ``data`` lacks, or to what no scene may hold;
    ``where`` it is written, for the message. A star represents every table.
    """
    place = tuple(key.split("."))
    for end, part in enumerate(place):
        above = place[:end]
        if end < len(place) - 1 and part != "*" and named_tables(above, data):
            known = list(at(data, above) or {}) if above[-1:] != ("*",) else [part]
        else:
            known = known_keys(described(above, data))
        if known and part not in known:
            raise SceneError(f"{where}: unknown key {part!r}{did_you_mean(part, known)} (known: {', '.join(known)})")


def at(data: object, place: Place) -> Any:
    """What is at ``place`` in a scene's ``data``; the last thing on the way there where that is a value."""
    for part in place:
        if isinstance(data, Mapping):
            data = data.get(str(part))
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
    return data


def values_in(data: object) -> Iterator[tuple[Place, object, Node]]:
    """Every value that a scene's ``data`` gives: its place, itself, and what the schema says of it."""
    ahead: deque[tuple[Place, object, Node]] = deque([((), data, _schema())])
    while ahead:
        place, value, node = ahead.popleft()
        if isinstance(value, Mapping):
            inner: list[tuple[str | int, object]] = list(value.items())
        elif isinstance(value, list):
            inner = list(enumerate(value))
        else:
            yield place, value, node
            continue
        ahead += [((*place, part), item, _below(node, part, value)) for part, item in inner]


@cache
def _schema() -> Node:
    return scene_schema()


def _here(node: Node) -> Iterator[Node]:
    """The node and whatever else may be in its place."""
    yield node
    for several in ("anyOf", "oneOf"):
        for item in node.get(several, ()):
            yield from _here(item)


def _variants(node: Node) -> Iterator[Node]:
    """The node and whatever else may be in its place, references followed."""
    for item in _here(node):
        yield from _variants(_schema()["$defs"][item["$ref"].rpartition("/")[2]]) if "$ref" in item else (item,)


def _below(node: Node, part: str | int, table: object) -> Node:
    """What the schema says of ``part`` of a ``table`` or list that ``node`` describes."""
    for item in _variants(node):
        result: Node = {}
        if isinstance(part, int):
            result = item.get("items", result)
        elif _is_kind(item, table):
            result = item.get("properties", {}).get(part) or next(
                iter(item.get("patternProperties", {}).values()), result
            )
        if result:
            return result
    return {}


def _is_kind(node: Node, table: object) -> bool:
    """Whether a table may be what ``node`` describes: its kind is that of the node, where the node has one."""
    kind = node.get("properties", {}).get("kind", {}).get("const")
    return kind is None or (isinstance(table, Mapping) and table.get("kind") == kind)
