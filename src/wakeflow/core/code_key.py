"""The code behind a cached stage: every module that computes it, found by reading imports, and their hash.

A stage's key must change whenever the code that computes it does. A list kept by hand becomes incomplete sooner or
later, so a key covers the import closure: a module, the modules that it imports from this package at the top or inside
a function, the modules that these import, the packages that they lie in, and so on. Imports for type checking do not
run and do not count, but for the names that a package hands on at first use: these are in its ``__init__`` for type
checking, and count where they are asked for.
"""

from __future__ import annotations

import ast
import platform
import re
from collections.abc import Iterator
from contextlib import suppress
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path

from .files import atomic_write, kernel_root, key_root
from .lazy import parsed
from .store import content_key, digest_files

NAME = __name__.partition(".")[0]
PACKAGE = Path(__file__).parent.parent
CALL = re.compile(rf"({NAME}(?:\.\w+)*):\w[\w.]*")  # "wakeflow.module:function" in a string: what a child process runs
EVERY = "iter_modules(__path__)"  # in a package that imports whatever lies in its folder
Import = tuple[str, str, str, bool]  # module, name wanted of it, bound as, whether it runs
ALL, NO_NAME = "*", ""  # in place of a name: the module itself, or that it runs alone


@cache
def package_key() -> str:
    """sha256 (hex) over all files of this package. Read once a process."""
    return digest_files([PACKAGE])


@lru_cache(maxsize=64)
def code_key(*modules: str) -> str:
    """sha256 (hex) over the sources of ``modules`` (full names), all that they import from this package, and the data
    files that lie beside these. Kept in the user's own folder, since reading all imports takes a second.
    """
    kept = key_root() / content_key(package_key(), modules)
    with suppress(OSError):  # not there yet
        if re.fullmatch("[0-9a-f]{64}", known := kept.read_text(encoding="ascii", errors="replace")):
            return known
    paths = {path for module in closure(*modules) for path in (_path(module), *_data(_path(module).parent))}
    key = content_key({path.relative_to(PACKAGE).as_posix(): digest_files([path]) for path in paths})
    with suppress(OSError), atomic_write(kept) as stream:  # the disk may be full: it is made again next time
        stream.write(key)
    return key


def closure(*modules: str) -> frozenset[str]:
    """Full names of ``modules`` and of every module of this package that running them imports.

    Raises ModuleNotFoundError for a name that is no module of it.
    """
    seen, ahead = set[tuple[str, str]](), [(module, ALL) for module in modules]
    while ahead:
        if (wanted := ahead.pop()) not in seen:
            seen.add(wanted)
            ahead += _wanted_by(*wanted)
    return frozenset(module for module, _ in seen)


def _wanted_by(module: str, name: str) -> Iterator[tuple[str, str]]:
    """What using ``name`` of a module makes run: modules, and the names wanted of them."""
    path = _path(module)
    imports = _imports(path, module)
    yield from ((source, inner) for source, inner, _, runs in imports if runs)
    if parent := module.rpartition(".")[0]:
        yield parent, NO_NAME  # its __init__ runs
    if path.name != "__init__.py" or name == NO_NAME:
        return
    if name == ALL:  # as an object: whatever it hands on
        yield from ((source, inner) for source, inner, _, _ in imports)
    elif any(place.exists() for place in _places(f"{module}.{name}")):
        yield f"{module}.{name}", ALL
    else:  # a lazy name stands among its imports for type checking
        yield from ((source, inner) for source, inner, bound, _ in imports if bound == name)


@lru_cache(maxsize=1024)
def _imports(path: Path, module: str) -> tuple[Import, ...]:
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    result = list(_read(parsed(path), package, runs=True))
    if path.name == "__init__.py" and EVERY in path.read_text(encoding="utf-8"):
        names = sorted({item.stem for item in path.parent.glob("*.py")} - {"__init__"})
        result += [(f"{package}.{name}", ALL, name, True) for name in names]
    return tuple(result)


def _read(node: ast.AST, package: str, *, runs: bool) -> Iterator[Import]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            for statement in child.body:
                yield from _read(ast.Module([statement], []), package, runs=False)
        elif isinstance(child, ast.Import):
            inner = (alias for alias in child.names if alias.name.split(".")[0] == NAME)
            yield from ((alias.name, ALL, alias.asname or NAME, runs) for alias in inner)
        elif isinstance(child, ast.ImportFrom):
            source = _source(child, package)
            if source.split(".")[0] == NAME:
                yield from ((source, alias.name, alias.asname or alias.name, runs) for alias in child.names)
        elif isinstance(child, ast.Constant) and isinstance(child.value, str):
            if call := CALL.fullmatch(child.value):
                yield call[1], ALL, "", runs
        else:
            yield from _read(child, package, runs=runs)


def _source(node: ast.ImportFrom, package: str) -> str:
    """Full name of the module that a ``from ... import`` in a ``package`` reads."""
    parts = package.split(".")
    above = parts[: len(parts) - node.level + 1] if node.level else []
    return ".".join([*above, *([node.module] if node.module else [])])


def _path(module: str) -> Path:
    if path := next((path for path in _places(module) if path.exists()), None):
        return path
    raise ModuleNotFoundError(f"{module} is no module of {NAME}", name=module)


def _places(module: str) -> tuple[Path, Path]:
    base = PACKAGE.joinpath(*module.split(".")[1:])
    return base / "__init__.py", base.with_suffix(".py")


def _data(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.is_file() and path.suffix not in (".py", ".pyc")]


# -- Where compiled code is kept ---------------------------------------------------------------------------------------
def kernel_folder(module: str) -> Path:
    """The folder of the kernel whose entry is in ``module``: of these sources, wherever they lie, compiled by these
    versions of numba and LLVM for this processor.
    """
    versions = [version(name) for name in ("numba", "llvmlite")]
    machine = content_key(*versions, platform.python_version(), platform.machine(), _processor())
    return kernel_root() / f"{code_key(module)[:20]}-{machine[:12]}"


def _processor() -> str:
    """The processor's name and what it can do."""
    try:
        about = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").partition("\n\n")[0]
    except OSError:
        return platform.processor()
    return "\n".join(re.findall(r"^(?:vendor_id|model name|flags|Features|CPU part)\s*:.*$", about, re.M))
