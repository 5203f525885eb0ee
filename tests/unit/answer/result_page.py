"""The last part of docs/results.md, made from the types of result.json: ``python tests/unit/answer/result_page.py``."""

import re
import types
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from wakeflow.answer.result import Result
from wakeflow.core.record import columns

PAGE = Path(__file__).parents[3] / "docs" / "results.md"
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
    if kind in EVERY and uses()[kind] == 1:
        return "record"
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


EVERY = tuple(records())


@cache
def uses() -> Counter[type]:
    """How often each record type is a part of another one, or what that begins with."""
    parts = [part for kind in EVERY for column in columns(kind) for part in _inner(column.kind)]
    return Counter([*parts, *(base for kind in EVERY for base in _bases(kind))])


def _bases(kind: type) -> list[type]:
    return [base for base in kind.__mro__[1:] if base in EVERY]


def _step(kind: Any) -> str:
    """What leads from a key to the record in it: the name of a table's entry, or the brackets of a list."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is tuple:
        return "[]" + _step(parts[0])
    if origin in (dict, Mapping):
        return ".NAME" + _step(parts[1])
    return "".join(_step(part) for part in parts)


def rows(kind: type, path: str = "") -> Iterator[tuple[str, str, str, str]]:
    """(key, type, unit, meaning) of every key of a record type, below it those of a record that occurs only there."""
    inherited = {column.key for base in _bases(kind) for column in columns(base)}
    yield from ((f"*{path}: its keys too*" if path else "*its keys too*", word(base), "–", "") for base in _bases(kind))
    for column in columns(kind):
        if column.key in inherited:
            continue
        kind_word = word(column.kind).removesuffix(" or null") if column.absent or column.flat else word(column.kind)
        inside = [part for part in _inner(column.kind) if uses()[part] == 1]
        about = " ".join([column.meaning + "." * bool(inside), *map(_about, inside)])
        key = f"*{path}its keys are here*" if column.flat else f"`{path}{column.key}`"
        yield key, kind_word, column.unit or "–", about
        for part in inside:
            yield from rows(part, path if column.flat else f"{path}{column.key}{_step(column.kind)}.")


def _about(kind: type) -> str:
    """What a record type is, from its docstring."""
    about = " ".join((kind.__doc__ or "").split("\n\n")[0].split()).replace("``", "`")
    return re.sub(r":\w+:`[~.]*([\w.]+)`", r"`\1`", about)


def section(kind: type) -> str:
    """The rows of the page for a type: what it is, then its keys."""
    lines = [(f"**{kind.__name__}**", "", "", _about(kind)), *rows(kind)]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)


def page() -> str:
    """The page as it should be: what stands above the first type, and the types."""
    above, _, _ = PAGE.read_text().partition(HEAD)
    return above + HEAD + "".join(section(kind) for kind in EVERY if uses()[kind] != 1)


if __name__ == "__main__":
    PAGE.write_text(page())
