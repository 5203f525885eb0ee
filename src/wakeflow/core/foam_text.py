"""OpenFOAM's files as text: macros and included files written out, entries of one name merged, as OpenFOAM reads them.

foamlib, which makes numbers of the text, leaves macros as they stand. A macro has the value that its name has before
it, in its own dictionary or in one around it. Syntax: openfoam.com's user guide, section 2.2; OpenFOAM of the
Foundation parts the names of dictionaries by / from version 9 on, where the other has points.
"""

from __future__ import annotations

import os
import re
from copy import deepcopy
from pathlib import Path
from typing import cast

from .errors import FoamError
from .files import MAX_RECORD, read_packed, read_whole

Entries = dict[str, "str | Entries"]  # texts and dictionaries; patterns in quotes
BLANK = re.compile(r"(?:\s+|//[^\n]*|/\*.*?\*/)*", re.S | re.A)
WORD = re.compile(r'"(?:[^"\\]|\\.)*"|\$\{[^{}]*\}|(?:(?!/[/*])[^\s{};"])+', re.S | re.A)
MACRO = r"\$(?:\{[^{}]*\}|[\w.:/!+-]+)"
ALONE = re.compile(MACRO + r"(?=\s*;)")
PART = re.compile(
    r'(?P<note>//[^\n]*|/\*.*?\*/)|(?P<whole>"(?:[^"\\]|\\.)*"|#\{.*?#\})|(?P<computed>#\w+)|(?P<macro>'
    + MACRO + r")|List<(?P<kind>\w+)>\s*(?P<count>\d+)\s*\(|(?P<open>[({[])|(?P<close>[)}\]])|(?P<end>;)", re.S | re.A
)  # fmt: skip
NUMBERS = {"scalar": 1, "vector": 3, "sphericalTensor": 1, "symmTensor": 6, "tensor": 9}  # in one value of a list
INCLUDED = 100  # files: more are one that includes itself
ETC = "/usr/share/openfoam"  # WM_PROJECT_DIR of Debian's package


def read_entries(path: Path) -> tuple[Entries, list[Path]]:
    """What a dictionary or a field says, packed by gzip or not, its header as FoamFile; and the files that were read:
    with those that it includes.

    A list of values as internalField is not written out where a patch names it: it stays ``$internalField``. Raises
    FoamError, with file and line, for what is cut short, computed by OpenFOAM, or defined nowhere; OSError where there
    is no file.
    """
    reader, result = _Reader(path, []), Entries()
    reader.fill((result,))
    return {"FoamFile": reader.header, **result}, reader.files


def text_of(entries: Entries) -> str:
    """The entries as a file of OpenFOAM's has them; a letter is a byte (latin-1)."""
    return "".join(
        f"{key} {{\n{text_of(said)}}}\n" if isinstance(said, dict) else f"{key} {said};\n"
        for key, said in entries.items()
    )


class _Reader:
    """One file at a time: ``files`` are those that were read, ``header`` is what FoamFile says."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        packed = path.with_name(path.name + ".gz")
        self.path = path if path.exists() or not packed.exists() else packed
        raw = read_packed(packed) if self.path == packed else read_whole(path, MAX_RECORD)
        self.raw = raw.decode("latin-1")  # a letter is a byte
        self.files, self.header = files, Entries()
        files.append(self.path)

    def fill(self, scopes: tuple[Entries, ...], at: int = 0) -> int:
        """Read entries from byte ``at`` on into the last of the ``scopes``, dictionaries from the outermost on, to the
        end of the file or of an inner dictionary; return where that is.
        """
        inner = at > 0
        while True:
            at = self._after_blanks(at)
            if at == len(self.raw) and not inner:
                return at
            if self.raw[at : at + 1] == "}" and inner:
                return at + 1
            if self.raw[at : at + 1] == ";":
                at += 1
                continue
            word = WORD.match(self.raw, at)
            if word is None:
                raise self._refused(at, "it ends within an entry, or has a bracket too many; write it anew")
            at = self._entry(scopes, word[0], at, self._after_blanks(word.end()))

    def _entry(self, scopes: tuple[Entries, ...], word: str, at: int, then: int) -> int:
        """Read the entry that begins with a ``word`` at byte ``at``, and goes on at ``then``."""
        following, scope = self.raw[then : then + 1], scopes[-1]
        if word[:1] == "#":
            return self._directive(scopes, word, at + len(word))
        if word[:1] == "$":
            said = self._macro(scopes, word, at)
            if following in (";", "}"):
                if not isinstance(said, dict):
                    raise self._refused(at, f"{word} is no dictionary; write out what it represents")
                _merge(scope, said)
                return then
            word = said if isinstance(said, str) else word
        key, old = word, scope.get(word)
        if following == "{":
            child: Entries = old if isinstance(old, dict) else {}
            end = self.fill((*scopes, child), then + 1)
            if key == "FoamFile":
                self.header = child
            else:
                scope[key] = child
            return end
        result, end = self._value(scopes, then)
        if isinstance(old, dict) and isinstance(result, dict):
            _merge(old, result)
        else:
            scope[key] = result
        return end

    def _value(self, scopes: tuple[Entries, ...], at: int) -> tuple[str | Entries, int]:
        """The value that begins at byte ``at``, and where it ends."""
        if alone := ALONE.match(self.raw, at):
            return deepcopy(self._macro(scopes, alone[0], at)), self._after_blanks(alone.end()) + 1
        pieces, depth, begin = list[str](), 0, at
        while part := PART.search(self.raw, at):
            at = part.end()
            if part["end"] and depth == 0:
                return "".join([*pieces, self.raw[begin : part.start()]]).strip(), at
            if part["kind"]:
                end = self._end_of_list(part)
                depth, at = depth + (not end), end or at
            elif part["computed"]:
                raise self._refused(at, f"{part[0]} is computed by OpenFOAM; write out its result")
            elif part["note"] or part["macro"]:
                said = self._macro(scopes, part[0], part.start()) if part["macro"] else " "
                if isinstance(said, dict):
                    raise self._refused(at, f"{part[0]} is a dictionary; write out what is meant")
                pieces += [self.raw[begin : part.start()], said]
                begin = at
            depth += bool(part["open"]) - bool(part["close"])
            if depth < 0:
                break
        raise self._refused(begin, "it ends within an entry, or has a bracket too many; write it anew")

    def _end_of_list(self, part: re.Match[str]) -> int:
        """Where a list of numbers ends that begins with a ``part``; 0 where it has to be read piece by piece."""
        if part["kind"] not in NUMBERS:
            return 0
        if self.header.get("format") == "binary":
            size = 4 if "scalar=32" in cast(str, self.header.get("arch", "")) else 8
            end = part.end() + int(part["count"]) * NUMBERS[part["kind"]] * size
            if self.raw[end : end + 1] != ")":
                raise self._refused(part.start(), "its list is cut short; write it anew")
            return end + 1
        end = self.raw.find(";", part.end())
        return 0 if end < 0 or any(mark in self.raw[part.end() : end] for mark in ("$", "/", "}")) else end

    def _macro(self, scopes: tuple[Entries, ...], macro: str, at: int) -> str | Entries:
        """What a ``macro`` at byte ``at`` represents."""
        name, _, usual = macro.strip("${}").partition(":-")
        entry = _named(scopes, name)
        if not entry and not usual:
            raise self._refused(at, f"${name} is defined nowhere before; write out what it represents")
        result = entry[0] if entry else usual
        if isinstance(result, str) and result.startswith("nonuniform") and name.endswith("internalField"):
            return "$internalField"
        return result

    def _directive(self, scopes: tuple[Entries, ...], word: str, at: int) -> int:
        """Obey ``#include``, ``#ifeq`` and their like; returns where to go on, known up to byte ``at`` of its line."""
        end = self.raw.find("\n", at)
        end = len(self.raw) if end < 0 else end
        line = self.raw[at:end]
        if word == "#inputMode" and line.strip(" \t\r;") in ("merge", "default"):
            return end
        if word == "#endif" or (word == "#ifeq" and self._alike(scopes, line, at)):
            return end
        if word in ("#ifeq", "#else"):
            return self._skipped(word, at)
        named = re.match(r'\s*"([^"]*)"', line)
        if word not in ("#include", "#includeIfPresent", "#sinclude", "#includeEtc") or named is None:
            raise self._refused(at, f"{word} is for OpenFOAM alone; write out what it brings")
        path = self._place(scopes, named[1], at, etc=word == "#includeEtc")
        if path.is_file() or word in ("#include", "#includeEtc"):
            if not path.is_file():
                raise self._refused(at, f"includes {path}, which is no file")
            if len(self.files) > INCLUDED:
                raise self._refused(at, f"more than {INCLUDED} files are included; does one include itself?")
            _Reader(path, self.files).fill(scopes)
        return end

    def _alike(self, scopes: tuple[Entries, ...], line: str, at: int) -> bool:
        """Whether the two words of an ``#ifeq`` are one."""
        words = [self._macro(scopes, item, at) if item[:1] == "$" else item for item in line.partition("//")[0].split()]
        if len(words) != 2:
            raise self._refused(at, "#ifeq needs two words")
        return words[0] == words[1]

    def _skipped(self, word: str, at: int) -> int:
        """Where the branch ends that an ``#ifeq`` does not take, or its ``#else`` after the other was taken."""
        depth = 0
        for mark in re.compile(r"^[ \t]*#(if|ifeq|else|endif)\b[^\n]*", re.M).finditer(self.raw, at):
            if depth == 0 and (mark[1] == "endif" or (mark[1] == "else" and word == "#ifeq")):
                return mark.end()
            depth += {"else": 0, "endif": -1}.get(mark[1], 1)
        raise self._refused(at, f"{word} has no #endif")

    def _place(self, scopes: tuple[Entries, ...], name: str, at: int, *, etc: bool) -> Path:
        """The file of a ``name`` in quotes: relative to the file that includes it, or in OpenFOAM's own folder."""
        case = next((folder for folder in self.files[0].parents if (folder / "constant").is_dir()), self.path.parent)
        place = os.fsencode(case).decode("latin-1")
        name = re.sub(r"^<(case|constant|system)>", lambda kind: f"{place}/{kind[1].removeprefix('case')}", name)
        name = re.sub(r"\$\{?FOAM_CASE\b\}?", lambda _: place, name)

        def said(macro: re.Match[str]) -> str:
            result = self._macro(scopes, macro[0], at)
            return result.strip('"') if isinstance(result, str) else macro[0]

        name = os.fsdecode(re.sub(r"\$(?:\{[^{}]*\}|\w+)", said, name).encode("latin-1"))
        return Path(os.environ.get("WM_PROJECT_DIR", ETC), "etc", name) if etc else self.path.parent / name

    def _after_blanks(self, at: int) -> int:
        blank = BLANK.match(self.raw, at)
        return at if blank is None else blank.end()

    def _refused(self, at: int, why: str) -> FoamError:
        line = self.raw.count("\n", 0, at) + 1
        return FoamError(f"cannot read {self.path}, line {line}: {why}", log=self.path)


def _named(scopes: tuple[Entries, ...], name: str) -> list[str | Entries]:
    """What a name means in the innermost of the ``scopes`` that has it; nothing where none has."""
    for scope in reversed(scopes):
        if entry := _in(scope, name):
            return entry
    if name[:1] in ":!":
        steps, scopes = re.split(r"[./]", name[1:]), scopes[:1]
    elif "/" in name:
        steps = [step for step in name.split("/") if step != "."]
        up = steps.count("..")
        steps, scopes = steps[up:], scopes[len(scopes) - up - 1 : len(scopes) - up]
    else:
        steps = name.lstrip(".").split(".")
        up = len(name) - len(name.lstrip("."))
        scopes = scopes[len(scopes) - up : len(scopes) - up + 1] if up else scopes
    entry = next(filter(None, (_in(scope, steps[0]) for scope in reversed(scopes))), [])
    for step in steps[1:]:
        entry = _in(entry[0], step) if entry and isinstance(entry[0], dict) else []
    return entry


def _in(scope: Entries, name: str) -> list[str | Entries]:
    """The entry of a ``name``, else that of the last pattern which it matches; nothing without either."""
    if name in scope:
        return [scope[name]]
    return [scope[key] for key in reversed(scope) if key[:1] == '"' and re.fullmatch(key[1:-1], name)][:1]


def _merge(into: Entries, entries: Entries) -> None:
    """Take entries over: a dictionary into that of its name, anything else in place of it."""
    for key, said in entries.items():
        old = into.get(key)
        if isinstance(old, dict) and isinstance(said, dict):
            _merge(old, said)
        else:
            into[key] = deepcopy(said)
