"""What is made on first use: a property, by threads that do not wait for each other; the public names of a package."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

if TYPE_CHECKING:
    import ast

Value = TypeVar("Value")


class cached_property(Generic[Value]):
    """``functools.cached_property`` without its lock, which up to Python 3.11 is one for all instances of a class: two
    threads that compute two airflows would do it one after the other.
    """

    def __init__(self, make: Callable[[Any], Value]) -> None:
        self.make, self.name, self.__doc__ = make, "", make.__doc__

    def place(self, instance: Any) -> dict[str, Any]:
        """Where the value is kept: in the ``instance``, which then has it without asking here again."""
        return instance.__dict__  # type: ignore[no-any-return]

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: object = None) -> cached_property[Value]: ...

    @overload
    def __get__(self, instance: object, owner: object = None) -> Value: ...

    def __get__(self, instance: object, owner: object = None) -> cached_property[Value] | Value:
        if instance is None:
            return self
        kept = self.place(instance)
        if self.name not in kept:
            kept[self.name] = self.make(instance)
        value: Value = kept[self.name]
        return value


def loaded(package: str, name: str) -> Any:
    """A public name of a ``package`` whose ``__init__`` imports it for type checking alone.

    Raises AttributeError where it imports no such name.
    """
    home = _homes(package).get(name)
    if home is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    return getattr(import_module(home[0], package), home[1])


# One at a time: up to Python 3.11.4 the depth of a tree that is made belongs to all threads, and two that parse end in
# "SystemError: AST constructor recursion depth mismatch" (CPython issue 106905). A library may parse meanwhile, which
# takes no turn: then the tree is made again
_parsing = threading.RLock()
AGAIN = 20
SHORTLY = 0.01  # s


def parsed(file: Path) -> ast.Module:
    """The tree of a source file."""
    import ast

    source = file.read_bytes()
    with _parsing:
        for _ in range(AGAIN):
            try:
                return ast.parse(source)
            except SystemError:
                time.sleep(SHORTLY)
        return ast.parse(source)


@cache
def _homes(package: str) -> dict[str, tuple[str, str]]:
    """The module and the name there of each name that the ``__init__`` of a ``package`` imports for type checking."""
    import ast

    file = sys.modules[package].__file__
    assert file is not None
    blocks = (node.body for node in parsed(Path(file)).body if isinstance(node, ast.If))
    imports = [node for body in blocks for node in body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: (f".{node.module}", alias.name) for node in imports for alias in node.names}
