"""Changes of a scene that are given as text, ``--set KEY=VALUE`` and ``--force TERM=on``, and how to quote them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any

from ..core.arrays import as_written, number
from ..core.errors import SceneError
from ..core.files import check_tables
from ..core.quantities import quantity
from ..core.record import JsonMapping, JsonTable
from ..core.registry import did_you_mean
from .scene_tables import ON_OFF

KINDS = {"shape", "kind"}  # keys whose value decides which other keys a table has: one with them comes whole
NAMED = ("body", "fraction", "bin", "picture")  # tables of tables, whose names are the user's


def changes_of(settings: Sequence[str]) -> dict[str, object]:
    """Dotted keys of a scene and their new values, from texts KEY=VALUE. Raises SceneError for any other text."""
    return {key: _value(value) for key, value in (setting(text, "--set") for text in settings)}


def switches_of(forced: Sequence[str]) -> dict[str, bool]:
    """Terms that are switched on or off, from texts TERM=on and TERM=off. Raises SceneError for any other text."""
    switches = {}
    for term, state in (setting(text, "--force", "TERM=on or TERM=off") for text in forced):
        if state not in ON_OFF:
            raise SceneError(f"--force {term}={state}: write on or off")
        switches[term] = state == "on"
    return switches


def setting(text: str, option: str, form: str = "KEY=VALUE") -> tuple[str, str]:
    """Key and value of an ``option``'s text, without blanks around them. Raises SceneError, naming the ``form``, for
    any other text.
    """
    key, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not value or not all(key.split(".")):
        raise SceneError(f"{option} {text!r}: write it as {form}")
    return key, value


def share_of(text: str) -> float:
    """A share from text, 0.05 or 5%. Raises ValueError for any other text."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return float(f"{quantity(text, '1', '5 %'):.15g}")  # 95 % is 0.95 exactly
    except ValueError as problem:
        cure = str(problem) if "," in text else "needs a share such as 0.05 or 5%"
        raise ValueError(f"{text!r}: {cure}") from None


def share_in(value: object, name: str) -> float:
    """A share that is given from Python as a number or as a text such as "5 %". Raises SceneError, by its ``name``, for
    anything else.
    """
    if isinstance(value, str):
        try:
            return share_of(value)
        except ValueError as problem:
            raise SceneError(f"{name} = {problem}") from None
    try:
        return number(name, value)
    except SceneError:
        raise SceneError(f"{name} = {value!r}: a number such as 0.01, or '1 %', is needed") from None


def changed(data: JsonMapping, changes: JsonMapping, name: str = "scene") -> JsonTable:
    """A deep copy of a scene's ``data`` with dotted keys set. Tables that are missing on the way are made, but for one
    whose name is nearly another's: that may be misspelt, and a new one of such a name comes whole. A star represents
    all tables that are there. A table of the scene changes in the keys that it names and keeps the others; a value that
    is written as a table, such as a size distribution, is swapped.

    Raises SceneError for a key in such a table, for a key in a value, and where ``changes`` are none.
    """
    if not isinstance(changes, Mapping) or not all(isinstance(key, str) for key in changes):
        raise SceneError(f"changes = {changes!r}: name each key and its value, {{'air.speed': '7 m/s'}}")
    result: JsonTable = json.loads(json.dumps(data, default=str))
    for key, value in changes.items():
        *tables, last = key.split(".")
        nodes = [result]
        for i, table in enumerate(tables):
            if table == "*":
                nodes = [part for node in nodes for part in node.values()]
            else:
                if any(table not in node for node in nodes):
                    _refuse_misspelt(tuple(tables[:i]), table, key, result, name)
                nodes = [node.setdefault(table, {}) for node in nodes]
            if not nodes or not all(isinstance(node, dict) for node in nodes):
                raise SceneError(f"{key}: {'.'.join(tables[: i + 1])} is {'a value, not a' if nodes else 'no'} table")
        for node in nodes:
            node[last] = _merged(key.split("."), node.get(last), _plain(key, value))
    return result


def _plain(key: str, value: object) -> Any:
    """A value as plain JSON. Raises SceneError where it is none."""
    try:
        return json.loads(json.dumps(value, default=as_written))
    except SceneError as problem:
        raise SceneError(f"{key}: {problem}") from None
    except (TypeError, ValueError, RecursionError):
        raise SceneError(f"{key}: a value of {type(value).__name__} that no scene holds") from None


def _merged(place: Sequence[str], before: Any, value: Any) -> Any:
    """The ``value`` at a ``place`` of a scene, or what was there ``before`` with the value's keys changed in it."""
    if not isinstance(before, dict) or not isinstance(value, dict) or not value or not _keeps_keys(place):
        return value
    if KINDS & value.keys():  # another shape has other keys
        return value
    return {**before, **{key: _merged([*place, key], before.get(key), item) for key, item in value.items()}}


def _keeps_keys(place: Sequence[str]) -> bool:
    """Whether a place of a scene is a table, not a value that is written as one."""
    top = place[0]
    if top in ("uncertainty", "force"):
        return True
    named = top in NAMED or list(place[:2]) == ["channel", "inlet"]
    depth = (2 if top in NAMED else 3) if named else 2 if list(place[:2]) == ["numerics", "span"] else 1
    return len(place) <= depth


def unquoted(words: Sequence[str]) -> str:
    """How to write ``--set KEY=7 m/s`` of a command line's ``words``, whose blank has parted the value; empty where no
    setting is followed by a word that goes on with it.
    """
    for place, word in enumerate(words[:-2]):
        if word == "--set":
            rest = takewhile(lambda item: not item.startswith("--"), words[place + 1 :])
            key, *parts = [item for item in rest if not item.endswith(".toml")]
            if parts:
                return f"put quotes round a value with blanks: --set '{' '.join([key, *parts])}'"
    return ""


def _refuse_misspelt(place: tuple[str, ...], table: str, key: str, data: JsonTable, name: str) -> None:
    """Raise SceneError where the tables at ``place`` have names of the user's, and one of them is nearly ``table``."""
    from .schema import at, named_tables  # the command line reads texts before it needs a scene

    if not named_tables(place, data):
        return
    known, kind = list(at(data, place) or {}), ".".join(place)
    if near := did_you_mean(table, known):
        hint = f"no {kind} {table!r}{near} (known: {', '.join(known)})"
        raise SceneError(f"{name}: {key}: {hint}; to add one, give it whole: {kind}.{table}={{...}}")


def _value(text: str) -> object:
    """A TOML value where the text is one (number, list, true, quoted string), else the text itself."""
    if "\n" in text:
        return text
    try:
        result = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # no TOML, or nothing that any key takes
        return text
    check_tables(result, "--set")
    return result
