"""The tables that docs/results.md must hold, made from the types of result.json."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import is_dataclass
from typing import Any, Union, get_args, get_origin

from wakeflow.core.record import columns
from wakeflow.results.result import Result

PLAIN = {int: "integer", float: "number", str: "text", bool: "true or false", Any: "anything"}


def word(kind: Any) -> str:
    """A type in the words of the page."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (alone,) = [part for part in parts if part is not types.NoneType]
        return f"{word(alone)} or null"
    if origin is tuple:
        return f"list of {word(parts[0])}"
    if origin is dict:
        return f"table of {word(parts[1])}"
    return PLAIN.get(kind) or f"[{kind.__name__}](#{kind.__name__.lower()})"


def records(kind: type = Result, seen: set[type] | None = None) -> Iterator[type]:
    """Every record type that result.json is made of, each once, the whole first."""
    seen = set() if seen is None else seen
    seen.add(kind)
    yield kind
    for column in columns(kind):
        for part in _inner(column.kind):
            if part not in seen:
                yield from records(part, seen)


def _inner(kind: Any) -> Iterator[type]:
    if is_dataclass(kind):
        yield kind  # type: ignore[misc]
    for part in get_args(kind):
        yield from _inner(part)


def rows(kind: type) -> list[tuple[str, str, str, str]]:
    """(key, type, unit, meaning) of every key of a record type, as the page says them."""
    found = []
    for column in columns(kind):
        key = "*its keys stand here*" if column.flat else f"`{column.key}`"
        kind_word = word(column.kind).removesuffix(" or null") if column.absent or column.flat else word(column.kind)
        found.append((key, kind_word, column.unit or "–", column.meaning))
    return found


def section(kind: type) -> str:
    """A section of the page."""
    about = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows(kind))
    return f"### {kind.__name__}\n\n{about}\n\n| key | type | unit | meaning |\n|---|---|---|---|\n{table}\n"


if __name__ == "__main__":  # prints the sections, for a page that is to be brought up to date
    print("\n".join(section(kind) for kind in records()))
