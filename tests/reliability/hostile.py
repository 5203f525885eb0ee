"""What is handed to the program that nobody should have to write: mutated scenes, command lines, damaged files.

Everything is drawn from a seed, which a failing test prints: the same seed gives the same mutants.
"""

from __future__ import annotations

import json
import random
import tomllib
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import tomlkit

from support import CASES

Tables = dict[str, Any]
SCENES = ("vacuum", "rhombus", "prism", "labyrinth", "aspirator", "funnel", "wheat-straw-dust", "zigzag", "rocking",
          "sticky")  # fmt: skip
VALUES: tuple[Any, ...] = (
    0,
    1,
    -1,
    2**62,
    10**400,
    1e-300,
    1e300,
    -0.0,
    float("nan"),
    float("inf"),
    "",
    " ",
    "0",
    "5 mm",
    "-5 mm",
    "5",
    "1e400 m",
    "5 kg",
    "5 %",
    "1,5 m",
    "mm",
    "nan",
    "inf m",
    "3 parsec",
    "é",
    "=cmd|calc!A0",
    "<b>x</b>",
    "../../etc/passwd",
    "a\nb",
    "\x1b[31mred",
    "\x00",
    "\u202eabc",
    "x" * 5000,
    True,
    False,
    [],
    {},
    [[]],
    [1, 2, 3],
    ["a", "b"],
    [[0, 0], [1, 1]],
    [[0.0, 0.0], [0.02, 0.02], [0.02, 0.0], [0.0, 0.02]],
    {"value": 1, "uncertainty": "10 %"},
    {"a": {"b": {"c": 1}}},
    {"distribution": "normal", "mean": "2 mm", "std": "5 mm"},
    {"distribution": "lognormal", "median": 1, "gsd": 0.5},
)
KEYS = (
    "x",
    "speed",
    "width",
    "",
    " ",
    "a.b",
    "[x]",
    "a[b]",
    "con\n",
    "é",
    "=1+1",
    "__class__",
    "x" * 300,
    "\x1b[1m",
    "*",
    "value",
    "distribution",
    "0",
    "-",
    "{}",
    "%s",
)


def scene_of(name: str) -> Tables:
    """The tables of a shipped scene."""
    return tomllib.loads((CASES / f"{name}.toml").read_text())


def places_in(tables: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every key of tables and lists, with those above it."""
    items = tables.items() if isinstance(tables, dict) else enumerate(tables) if isinstance(tables, list) else ()
    for key, value in items:
        yield (*above, key)
        yield from places_in(value, (*above, key))


def _parent(tables: Any, place: tuple[Any, ...]) -> Any:
    for key in place[:-1]:
        tables = tables[key]
    return tables


def _set(tables: Tables, place: tuple[Any, ...], chance: random.Random) -> None:
    _parent(tables, place)[place[-1]] = deepcopy(chance.choice(VALUES))


def _drop(tables: Tables, place: tuple[Any, ...], chance: random.Random) -> None:
    del _parent(tables, place)[place[-1]]


def _scale(tables: Tables, place: tuple[Any, ...], chance: random.Random) -> None:
    """Numbers, and those of texts with units, a little, much or absurdly other."""
    parent, key = _parent(tables, place), place[-1]
    factor = chance.choice([0.0, -1.0, 0.5, 0.9, 1.1, 2.0, 10.0, 1e-3, 1e3, 1e-9, 1e9])
    if isinstance(parent[key], int | float) and not isinstance(parent[key], bool):
        parent[key] = min(parent[key], 10**300) * factor
    elif isinstance(parent[key], str) and parent[key].split(" ")[0].replace(".", "").isdigit():
        number, _, unit = parent[key].partition(" ")
        parent[key] = f"{float(number) * factor:g} {unit}"


def _rename(tables: Tables, place: tuple[Any, ...], chance: random.Random) -> None:
    parent = _parent(tables, place)
    if isinstance(parent, dict):
        parent[chance.choice(KEYS)] = parent.pop(place[-1])


def _add(tables: Tables, place: tuple[Any, ...], chance: random.Random) -> None:
    parent = _parent(tables, place)
    if isinstance(parent, dict):
        parent[chance.choice(KEYS)] = deepcopy(chance.choice(VALUES))


def _graft(tables: Tables, place: tuple[Any, ...], chance: random.Random) -> None:
    """What stands at another place of another scene."""
    other = scene_of(chance.choice(SCENES))
    there = chance.choice(list(places_in(other)))
    _parent(tables, place)[place[-1]] = deepcopy(_parent(other, there)[there[-1]])


CHANGES: tuple[Callable[[Tables, tuple[Any, ...], random.Random], None], ...] = (
    _set,
    _drop,
    _scale,
    _scale,
    _scale,
    _rename,
    _add,
    _graft,
)


def mutated(chance: random.Random) -> Tables:
    """A shipped scene with one to four changes."""
    tables = scene_of(chance.choice(SCENES))
    for _ in range(chance.choice([1, 1, 1, 2, 3, 4])):
        places = list(places_in(tables))
        if places:
            chance.choice(CHANGES)(tables, chance.choice(places), chance)
    return tables


def as_toml(tables: Tables) -> str:
    """The tables as a file, a whole number of any length included."""
    return tomlkit.dumps(tables)


# -- Command lines -----------------------------------------------------------------------------------------------------
COMMANDS = (
    "plan {v} --json",
    "plan {v} --set {s} --json",
    "plan {v} --rung none --json",
    "plan {v} --force {f} --json",
    "compare {r} {r}",
    "bins {r} --purity {p}",
    "materials {w}",
    "schema",
    "sensitivity {r}",
    "view {v} --picture {o}.png",
    "new {w} {o}.toml",
    "sweep {v} --set {s} --dry-run",
    "search {w}",
    "clean --dry-run --keep {k}",
    "animate {r} --span {k}",
    "run {v} --until mesh --out {o}",
    "run {v} --set {s} --until mesh --out {o}",
    "{w} {v}",
    "report {w}",
    "doctor --{w}",
    "plan {v} --target-error {k} --json",
    "run {w}",
)
WORDS = (
    "",
    " ",
    "x",
    "-",
    "--",
    "---",
    "-1",
    "=",
    "a=b",
    "../x",
    "/dev/null",
    "/",
    ".",
    "..",
    "~",
    "\x1b[31m",
    "a\nb",
    "é",
    "wheat",
    "rhombus",
    "vacuum",
    "nan",
    "1e400",
    "9" * 5000,
    "[" * 3000,
    "{" * 2000,
    "%s%n",
    "$(id)",
    "`id`",
    "x" * 1000,
    "\udc80",
    "on",
    "--help=1",
    "--json",
    "--no-such",
    "@x",
    "*",
    "10GB",
    "1.5",
    "0",
    "5%",
    "'",
    '"',
    "\\",
)


SETTINGS = ("feed.count", "air.speed", "fraction.*.friction", "x", ".", "*", "bin")


def command_line(chance: random.Random, scene: Path, run: Path, out: Path) -> list[str]:
    """A command that is nearly right, or was before a word was changed, left out, doubled or moved."""
    fill = {
        "v": str(scene),
        "r": str(run),
        "o": str(out / "o"),
        "w": chance.choice(WORDS),
        "s": f"{chance.choice(SETTINGS)}={chance.choice(WORDS)}",
        "f": f"{chance.choice(['lift', 'drag', 'x', 'wheat.lift', '.'])}={chance.choice(['on', 'off', *WORDS])}",
        "p": f"{chance.choice(['hard', 'soft', 'x', ''])}={chance.choice(['0.9', '90%', *WORDS])}",
        "k": chance.choice(WORDS),
    }
    words = [part.format(**fill) for part in chance.choice(COMMANDS).split(" ")]
    for _ in range(chance.choice([0, 0, 1, 2])):
        place = chance.randrange(len(words))
        how = chance.randrange(4)
        if how == 0:
            words[place] = chance.choice(WORDS)
        elif how == 1 and len(words) > 1:
            del words[place]
        elif how == 2:
            words.insert(place, words[place])
        else:
            words.insert(place, chance.choice(WORDS))
    return words


# -- Damaged files -----------------------------------------------------------------------------------------------------
def damaged(content: bytes, chance: random.Random) -> bytes:
    """The bytes of a file after something went wrong."""
    some = bytearray(content)
    at = chance.randrange(len(some))
    how = chance.randrange(9)
    if how == 0:
        some[at] ^= 1 << chance.randrange(8)
    elif how == 1:
        some[at] = chance.randrange(256)
    elif how == 2:
        del some[at:]
    elif how == 3:
        some[at : at + chance.choice([1, 16, 512, 4096])] = bytes(min(len(some) - at, chance.choice([1, 16, 512])))
    elif how == 4:
        del some[at : at + chance.choice([1, 4, 100])]
    elif how == 5:
        some[at:at] = bytes(chance.randrange(256) for _ in range(chance.choice([1, 8, 200])))
    elif how == 6:  # a digit for a digit
        digits = [i for i, one in enumerate(some) if 48 <= one <= 57]
        if digits:
            some[chance.choice(digits)] = 48 + chance.randrange(10)
    elif how == 7:
        some = bytearray(chance.choice(WHOLE))
    else:
        start = chance.randrange(len(some))
        some[at:at] = some[start : start + 300]
    return bytes(some)


WHOLE = (
    b"",
    b"\x00",
    b"{}",
    b"[]",
    b"null",
    b"1",
    b'"s"',
    b"\xff\xfe",
    b"[" * 100_000,
    b'{"a":' * 50_000,
    b"9" * 5000,
    b"NaN",
    b"PK\x05\x06" + bytes(18),
    b"\x80\x04\x95.",
    json.dumps({"schema": 2}).encode(),
    b"\xef\xbb\xbf{}",
    b"1e999",
    b"{" + b" " * 9999,
)
