"""What a user's OpenFOAM case must not hold: code, which OpenFOAM would compile and run, and files outside of the case.

This program reads such a case and starts nothing on it. A case that asks for code all the same is refused whole: others
may run OpenFOAM on what they were handed with the results.
"""

from __future__ import annotations

import mmap
import os
import re
from collections.abc import Iterator
from pathlib import Path

from ..core.errors import SceneError
from ..core.files import read_packed, read_whole

CODE = {  # what runs code, and what it is looked for by
    "#codeStream": rb"#\s*codeStream\b",
    "#calc": rb"#\s*(calc|eval)\b",
    "code between #{ and #}": rb"#\{",
    "a coded condition": rb"\btype\s+coded\w*\s*;",
    "systemCall": rb"\bsystemCall\b",
    "libs with the path of a file": rb"\b(?:libs|functionObjectLibs)\s*\([^)]*?/[^)]*\)",
}
INCLUDED = re.compile(rb"#\s*(include\w*)\s+[\"<]?([^\"\s>;]+)")
COMMENT = re.compile(rb"//[^\n]*|/\*.*?\*/", re.S)
BINARY = re.compile(rb"\bformat\s+binary\s*;")
LISTED = re.compile(rb"\b(\d{1,12})\s*\(")
WIDTHS = (1, 4, 8, 12, 16, 24, 48, 72)  # bytes of an entry of a binary list, from a char to a tensor
WORDS = 1_000_000  # bytes at a file's ends that are searched: between them fields and meshes have numbers


def refuse_code(case: Path, latest: Path) -> None:
    """Raise SceneError where a dictionary of a case, of its constant and system or of its ``latest`` time, holds code
    or names a file outside of the case.
    """
    for path in _dictionaries(case, latest):
        text = _text(path)
        found = next((what for what, looks in CODE.items() if re.search(looks, text)), None)
        outside = next((name for name in _included(text) if not _is_inside(name, path, case)), None)
        if outside is not None:
            found = f"an include from outside of the case, {outside}"
        if found is not None:
            place = path.relative_to(case)
            raise SceneError(f"air.case: {place} has {found}; a case is read and never run: take it out of a copy")


def _dictionaries(case: Path, latest: Path) -> Iterator[Path]:
    for top in (case / "system", case / "constant", latest):
        for folder, _, names in os.walk(top):  # links to folders are not followed
            yield from (Path(folder, name) for name in sorted(names) if Path(folder, name).is_file())


def _text(path: Path) -> bytes:
    """What a file says before its numbers and after them, without comments."""
    if path.suffix == ".gz":
        return COMMENT.sub(b" ", read_packed(path))
    if path.stat().st_size == 0:
        return b""
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        if BINARY.search(whole[:WORDS]):
            return COMMENT.sub(b" ", _without_numbers(whole[:]))
        head, tail = whole[:WORDS], whole[WORDS:][-WORDS:]
    return COMMENT.sub(b" ", head + tail)


def _without_numbers(text: bytes) -> bytes:
    """A binary file without the bytes of its lists, which may look like anything: as many as the list says, in front of
    the bracket that ends it.
    """
    parts, at = [], 0
    while found := LISTED.search(text, at):
        ends = (found.end() + int(found[1]) * width for width in WIDTHS)
        end = next((one for one in ends if text[one : one + 1] == b")"), found.end())
        parts.append(text[at : found.end()])
        at = end
    return b"".join([*parts, text[at:]])


def _included(text: bytes) -> Iterator[str]:
    for kind, name in INCLUDED.findall(text):
        if kind in (b"include", b"includeIfPresent", b"sinclude"):
            yield name.decode("latin-1")
        elif kind == b"includeEtc":  # of OpenFOAM's installation
            yield f"/etc/{name.decode('latin-1')}"


def _is_inside(name: str, path: Path, case: Path) -> bool:
    """Whether what is included lies in the case; $NAME/ at its beginning is a folder beside it, as this program's own
    template has it, where the case's parameters say no more than that.
    """
    if found := re.match(r"\$(\w+)/(.*)", name):
        values = re.findall(rf"^\s*{found[1]}\s+([^;]*);", _parameters(case), re.M)
        name = f"{values[-1].strip()}/{found[2]}" if values else "/"
    return not name.startswith(("~", "$", "<")) and (path.parent / name).resolve().is_relative_to(case)


def _parameters(case: Path) -> str:
    path = case / "system" / "parameters"
    return read_whole(path).decode("latin-1") if path.is_file() else ""
