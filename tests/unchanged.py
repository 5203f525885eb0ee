"""Test files that need not run: nothing that they read has changed since all of their tests passed.

What a file reads is its import closure: itself, the modules of the tests that it imports, the modules of the package
that these make run (``wakeflow.core.code_key``), data beside any of them, the scenes and templates of ``cases``. A file
that looks at the package, the documents or a started program as a whole reads all of it. ``passed/KEY`` in the cache of
the tests is there for every content that passed; ``--all`` runs every file.
"""

from __future__ import annotations

import ast
import re
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache, lru_cache
from pathlib import Path

from wakeflow.core import code_key
from wakeflow.core.lazy import parsed
from wakeflow.core.store import content_key, digest_files

ROOT = Path(__file__).parents[1]
TESTS = ROOT / "tests"
HOMES = (TESTS, TESTS / "unit", TESTS / "reliability", ROOT / "cases")  # pythonpath of pyproject.toml
# What runs more of the package than it imports: other programs, the command line and its extras, fixtures that do
PACKAGE = re.compile(r"\bsubprocess\b|sys\.executable|Popen|wakeflow\.cli|\bsmall_run\b|\brunning\b|\bbrowser\b")
# What looks at folders, documents, or other tests too, or makes code of text
ALL = re.compile(r"\bROOT\b|\bDOCS\b|\br?glob\(|import_module|\bexec\(|__file__")
# Whose own use of these counts where a test asks for it
SHARED = {TESTS / name for name in ("support.py", "conftest.py", "unchanged.py")}
Wanted = tuple[str, str | None]  # module, a name of it or None for all


def paths_of(file: Path) -> frozenset[Path]:
    """Every file that the tests in ``file`` may read."""
    own = _modules_of(file.resolve())
    texts = [_text(path) for path in own - SHARED]
    if any(ALL.search(text) for text in texts):
        return own | _beside(code_key.PACKAGE) | _documents() | _beside(TESTS) | _cases()
    beside = {found for path in own for found in _data_beside(path)}
    if any(PACKAGE.search(text) for text in texts):
        return own | _beside(code_key.PACKAGE) | _cases() | beside
    wanted = {one for path in own if path != TESTS / "conftest.py" for one in _package_of(path)}
    read = {code_key._path(module) for module in _run(wanted)}
    return frozenset(own | read | {path for one in read for path in _data(one.parent)} | _cases() | beside)


def key_of(file: Path) -> str:
    """sha256 (hex) over all that ``file`` reads and the packages that are installed."""
    named = {path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name: _digest(path)
             for path in paths_of(file)}  # fmt: skip
    return content_key(file.name, named, _installed())


def unchanged(files: Iterable[Path], passed: Path, mode: str) -> set[Path]:
    """Those of ``files`` whose content has passed in this ``mode`` (what was skipped then)."""
    if not passed.is_dir():
        return set()
    return {file for file in files if (passed / content_key(key_of(file), mode)).exists()}


def note_passed(file: Path, passed: Path, mode: str) -> None:
    """Keep that all tests in ``file`` passed as it is."""
    passed.mkdir(parents=True, exist_ok=True)
    (passed / content_key(key_of(file), mode)).write_text(f"{file.relative_to(ROOT).as_posix()}\n")


# -- What is read ------------------------------------------------------------------------------------------------------
@lru_cache(maxsize=256)
def _modules_of(file: Path) -> frozenset[Path]:
    """A module of the tests, those that it imports, and the conftest.py above it."""
    seen: set[Path] = set()
    ahead = [file, *(folder / "conftest.py" for folder in file.parents if folder.is_relative_to(TESTS))]
    while ahead:
        path = ahead.pop()
        if path in seen or not path.exists():
            continue
        seen.add(path)
        ahead += _imported(path)
    return frozenset(seen)


@cache
def _imported(path: Path) -> frozenset[Path]:
    """The modules of the tests that a module imports, and the packages that they lie in."""
    found: set[Path] = set()
    for node in ast.walk(parsed(path)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for parts in (name.split(".") for name in names):
            if parts[0] == code_key.NAME:
                continue
            for home in (path.parent, *HOMES):
                ends = [home.joinpath(*parts[:end]) for end in range(1, len(parts) + 1)]
                found |= {one for end in ends for one in (end.with_suffix(".py"), end / "__init__.py") if one.is_file()}
    return frozenset(found)


@cache
def _package_of(path: Path) -> frozenset[Wanted]:
    """What a module of the tests wants of the package; of ``wakeflow as wf`` the names that it uses."""
    tree = parsed(path)
    found: set[Wanted] = set()
    for module, name, bound, runs in code_key._read(tree, "", runs=True):
        if (module, name) == (code_key.NAME, None):
            used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)
                    and isinstance(node.value, ast.Name) and node.value.id == bound}  # fmt: skip
            found |= {(module, one) for one in used} or {(module, "")}
        elif runs:
            found.add((module, name))
    return frozenset(found)


def _run(wanted: set[Wanted]) -> set[str]:
    """The modules of the package that wanting these makes run."""
    seen: set[Wanted] = set()
    ahead = list(wanted)
    while ahead:
        if (one := ahead.pop()) not in seen:
            seen.add(one)
            ahead += _wanted_by(*one)
    return {module for module, _ in seen}


@cache
def _wanted_by(module: str, name: str | None) -> tuple[Wanted, ...]:
    return tuple(code_key._wanted_by(module, name))


@cache
def _data(folder: Path) -> frozenset[Path]:
    return frozenset(code_key._data(folder))


@cache
def _beside(folder: Path) -> frozenset[Path]:
    return frozenset(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)


@cache
def _cases() -> frozenset[Path]:
    return _beside(ROOT / "cases") | {ROOT / "pyproject.toml"}


@cache
def _documents() -> frozenset[Path]:
    above = (path for path in ROOT.iterdir() if path.is_file() and path.suffix in (".md", ".toml", ".lock", ".cff"))
    return _beside(ROOT / "docs") | frozenset(above)


def _data_beside(path: Path) -> Iterator[Path]:
    """Data in the folder of a module of the tests, and in folders of it that hold no Python."""
    for one in path.parent.iterdir():
        if one.is_file() and one.suffix not in (".py", ".pyc"):
            yield one
        elif one.is_dir() and path.parent != TESTS and not any(one.rglob("*.py")):
            yield from _beside(one)


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def _digest(path: Path) -> str:
    return digest_files([path])


@cache
def _installed() -> tuple[str, ...]:
    found = Path(sysconfig.get_path("purelib")).glob("*.dist-info")
    return (sys.version, *sorted(path.name for path in found))
