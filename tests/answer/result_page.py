"""The last part of docs/results.md, made from the types of result.json: ``python tests/answer/result_page.py``."""

import re
import types
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from wakeflow.answer.result import Result
from wakeflow.core.record import columns

PAGE = Path(__file__).parents[2] / "docs" / "results.md"
HEAD = "| key | type | unit | meaning |\n|---|---|---|---|\n"
PLAIN = {int: "integer", float: "number", str: "text", bool: "true or false", Any: "anything"}


def word(kind: Any) -> str:
    """A type in the words of the page."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (alone,) = [part for part in parts if part is not types.NoneType]
        return f"{word(alone)} or null"
    if origin is Annotated or (isinstance(kind, type) and issubclass(kind, Enum)):
        return word(parts[0]) if parts else "text"
    if origin is Literal:
        return "text"
    if origin is tuple:
        return f"list of {word(parts[0])}"
    if origin in (dict, Mapping):
        return f"table of {word(parts[1])}"
    return PLAIN.get(kind) or str(kind.__name__)


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
    """(key, type, unit, meaning) of every key of a record type; the keys of another type as a link."""
    bases = [base for base in kind.__mro__[1:] if is_dataclass(base) and base in set(records())]
    found = [("*its keys too*", word(base), "–", "") for base in bases]
    told = {row for base in bases for row in rows(base)}
    for column in columns(kind):
        key = "*its keys are here*" if column.flat else f"`{column.key}`"
        kind_word = word(column.kind).removesuffix(" or null") if column.absent or column.flat else word(column.kind)
        found.append((key, kind_word, column.unit or "–", column.meaning))
    return [row for row in found if row not in told]


def section(kind: type) -> str:
    """The rows of the page for a type: what it is, then its keys."""
    about = " ".join((kind.__doc__ or "").split("\n\n")[0].split()).replace("``", "`")
    told = re.sub(r":\w+:`[~.]*([\w.]+)`", r"`\1`", about)
    lines = [(f"**{kind.__name__}**", "", "", told), *rows(kind)]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)


def page() -> str:
    """The page as it should be: what stands above the first type, and the types."""
    above, _, _ = PAGE.read_text().partition(HEAD)
    return above + HEAD + "".join(section(kind) for kind in records())


if __name__ == "__main__":
    PAGE.write_text(page())
