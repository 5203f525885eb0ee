"""What the folder of an OpenFOAM case must not hold: code, which OpenFOAM would compile or load and run, and files from
outside of the case.

A user's case is read, and nothing is started on it: others may run OpenFOAM on what they were handed with the results.
A case in the cache is gone on from, and the cache may have come from others too. So every file is searched that
OpenFOAM reads by itself, in system, constant, the times and the parts of ranks; every other one that has OpenFOAM's
header; and what they include. What else lies in a case (scripts, logs, pictures) OpenFOAM does not read.
"""

from __future__ import annotations

import gzip
import mmap
import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from itertools import product
from math import prod
from pathlib import Path
from typing import NamedTuple

from .errors import SceneError
from .files import read_packed
from .foam_contents import Reader, is_plain, shown, values_of
from .foam_tokens import Text, header_of, tokens

OF_FOLDERS = re.compile(rb"(?:\$[a-z]\w*/)+[^$]*")  # names as of the template; those of the environment are in capitals
TIME = re.compile(r"-?[\d.]+(?:[eE][-+]?\d+)?")
SURFACES = (".obj", ".stl", ".stlb", ".vtk", ".ply", ".nas", ".csv")  # of bodies, which have comments of their own
FIRST = 65536  # bytes in which a file's header begins, behind comments
DEEPEST = 20  # includes of variables that an included file gives
WAYS = 100  # that a name with variables may mean
MOST = 1_000_000  # files of a case: a link to a whole disk has more


class CaseFile(NamedTuple):
    """A file of a case: its ``place`` there (DATA, DICTIONARY or OTHER), bytes, and when it was changed (ns)."""

    path: Path
    place: str
    size: int
    changed: int


DATA, DICTIONARY, INCLUDED = "a field or mesh", "a dictionary", "included, and so read as text whatever it is"
OTHER = "nothing that OpenFOAM reads by itself"


def refuse_code(
    case: Path, who: str = "air.case", advice: str = "a case is read and never run: take it out of a copy"
) -> None:
    """Raise SceneError, naming ``who``, the file, what it is and the ``advice``, where a file of the case holds code or
    includes one from outside of the case, or may. What was looked at is remembered until a file changes.
    """
    case = case.resolve()
    files = tuple(_files(case))
    if len(files) > MOST:
        raise SceneError(f"{who}: {case} has more than {MOST} files; is a link in it that leads too far?")
    if found := _searched(case, files):
        raise SceneError(f"{who}: {found}; {advice}")


def refuse_links(folder: Path, who: str, advice: str) -> None:
    """Raise SceneError where the folder of a case, or that of the stage above it, is a link, or holds one that leads
    out of it: what is written there would be written elsewhere.
    """
    above = [folder.parent] if folder.parent.suffix == ".part" else []
    linked = [path for path in (folder, *above) if path.is_symlink()]
    inside = folder.resolve()
    for at, folders, names in os.walk(folder):
        paths = (Path(at, name) for name in (*folders, *names))
        linked += [path for path in paths if path.is_symlink() and not _lies_in(path, inside)]
    if linked:
        raise SceneError(f"{who}: {linked[0].name} is a link that leads elsewhere; {advice}")


def _lies_in(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder)
    except (OSError, RuntimeError, ValueError):  # a link in a circle, a name that is none
        return False


# -- The files of a case -----------------------------------------------------------------------------------------------
def _files(case: Path) -> Iterator[CaseFile]:
    """The regular files of a case, one more than MOST at most, those of a folder that is linked at two places of one
    kind once.
    """
    seen: set[tuple[int, int, str] | None] = {None}
    count = 0
    for at, folders, names in os.walk(case, followlinks=True):
        place, about = _place(Path(at).relative_to(case).parts), _about(Path(at))
        known = about and (about.st_dev, about.st_ino, place)
        if known in seen or count > MOST:
            folders.clear()
            continue
        seen.add(known)
        folders[:] = sorted(name for name in folders if place != OTHER or name not in ("postProcessing", "dynamicCode"))
        for path in (Path(at, name) for name in sorted(names)):
            about = _about(path)
            if about and stat.S_ISREG(about.st_mode):
                count += 1
                yield CaseFile(path, place, about.st_size, about.st_mtime_ns)


def _about(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:  # a link to nothing, or what a solver has just removed
        return None


def _place(parts: tuple[str, ...]) -> str:
    """What a folder holds, by the parts of its path in the case."""
    if "system" in parts:
        return DICTIONARY
    if any(TIME.fullmatch(part) or part.startswith("polyMesh") for part in parts):
        return DATA
    return DICTIONARY if any(part == "constant" or part.startswith("processor") for part in parts) else OTHER


def _has_header(path: Path) -> bool:
    """Whether a file begins as OpenFOAM's own do, behind comments."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            return header_of(stream.read(FIRST))[0] is not None
    except (OSError, EOFError, zlib.error):
        return False


@contextmanager
def _text(path: Path) -> Iterator[Text]:
    """What a file holds, unpacked; nothing where it was removed meanwhile."""
    if path.suffix == ".gz":
        yield read_packed(path)
        return
    try:
        stream = path.open("rb")
    except FileNotFoundError:
        yield b""
        return
    with stream:
        if not os.fstat(stream.fileno()).st_size:
            yield b""
            return
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole:
            yield whole


# -- All that a case says ----------------------------------------------------------------------------------------------
@lru_cache(maxsize=8)
def _searched(case: Path, files: tuple[CaseFile, ...]) -> str | None:
    """Which file of a case has what, the first that is found; None where none is."""
    return _Search(case, [(one.path, one.place) for one in files if _is_read(one)]).found()


def _is_read(one: CaseFile) -> bool:
    """Whether OpenFOAM may take a file for its own without being told so by another."""
    surface = one.path.name.lower().removesuffix(".gz").endswith(SURFACES)
    return (one.place != OTHER and not surface) or _has_header(one.path)


class _Search:
    """The files of a case that are read, each with its place: at first those given, then what these include."""

    def __init__(self, case: Path, files: list[tuple[Path, str]]) -> None:
        self.case, self.files, self.done = case, files, 0
        self.queued: set[Path] = set()  # of those included
        self.waiting: list[tuple[Path, bytes]] = []  # files and what they include by a variable
        self.given: dict[bytes, tuple[set[bytes | None], int]] = {}  # by key: what so many of the files give it

    def found(self) -> str | None:
        """As :func:`_searched`."""
        for _ in range(DEEPEST):
            while self.done < len(self.files):
                path, place = self.files[self.done]
                self.done += 1
                if what := self._in(path, place):
                    return f"{path.relative_to(self.case)} has {what}"
            for path, name in self.waiting:
                if not self._follows(path, name):
                    return f"{path.relative_to(self.case)} has an include from outside of the case, {shown(name)}"
            if self.done == len(self.files):
                return None
        return "system has includes in each other without end"

    def _in(self, path: Path, place: str) -> str | None:
        reader = Reader()
        with _text(path) as text:
            if is_plain(text):
                return None
            for token in tokens(text, binary=place in (DATA, OTHER)):
                if what := reader.refused(token):
                    return what
        for name in reader.included:
            if OF_FOLDERS.fullmatch(name):
                self.waiting.append((path, name))
            elif not self._queue(path, name):
                return f"an include from outside of the case, {shown(name)}"
        return None

    def _follows(self, path: Path, name: bytes) -> bool:
        """Queue all that ``name`` may mean, $KEY/REST, by what any file gives that key; whether all is in the case."""
        parts: list[list[bytes]] = []
        for part in name.split(b"/"):
            means = self._values(part[1:]) if part.startswith(b"$") else {part}
            parts.append([one for one in means if one is not None])
            if None in means or not 0 < prod(map(len, parts)) <= WAYS:
                return False
        return all(self._queue(path, b"/".join(way)) for way in product(*parts))

    def _values(self, key: bytes) -> set[bytes | None]:
        found, looked = self.given.get(key, (set(), 0))
        for path, place in self.files[looked : self.done]:
            with _text(path) as text:
                found.update(values_of(text, key, binary=place in (DATA, OTHER)))
        self.given[key] = found, self.done
        return found

    def _queue(self, path: Path, name: bytes) -> bool:
        """Have a file read that another includes, as it is or packed; whether it lies in the case."""
        text = os.fsdecode(name)
        target = path.parent / text
        # . is where the program was started, ~ and < are folders of the user's and OpenFOAM's; .gz would be read packed
        if not text or text.startswith(("~", "<", "./")) or re.search(r"[$\\\0]|^\.$|\.gz$", text):
            return False
        if not all(_lies_in(one, self.case) for one in (target, target.parent, Path(f"{target}.gz"))):
            return False
        target = target.parent.resolve() / target.name  # .. behind a link is meant as the system takes it
        for one in (target, Path(f"{target}.gz")):
            about = None if one in self.queued else _about(one)
            if about and stat.S_ISREG(about.st_mode):
                self.queued.add(one)
                self.files.append((one, INCLUDED))
        return True
