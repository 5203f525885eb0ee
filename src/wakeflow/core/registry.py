"""One registry for everything that comes in named kinds: drag laws, size distributions, shapes, materials.

An entry that is registered is tested: the test suite is parametrised over the registries. The extras, packages built
upon the rooms, register what they add; no room names one.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Generic, TypeVar

from .errors import SceneError

Entry = TypeVar("Entry")


def did_you_mean(name: object, known: list[str]) -> str:
    """A hint ``; did you mean 'x'?`` when a known name is close to ``name``, else an empty string."""
    if not isinstance(name, str):  # a caller from Python may ask for anything
        return ""
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


class Registry(Generic[Entry]):
    """A named collection of ``Entry``; ``kind`` is the word for one of them in messages. ``extended``: extras add to
    it, which are asked to when an entry is first looked for.

    >>> laws = Registry[float]("drag law")
    >>> laws.add("stokes", 24.0)
    24.0
    >>> laws["stokes"], list(laws)
    (24.0, ['stokes'])
    """

    def __init__(self, kind: str, *, extended: bool = False) -> None:
        self.kind, self._extended = kind, extended
        self._entries: dict[str, Entry] = {}

    def add(self, name: str, entry: Entry) -> Entry:
        """Register ``entry`` and return it. Raises ValueError for a name that is taken."""
        if name in self._entries:
            raise ValueError(f"{self.kind} {name!r} is registered twice")
        self._entries[name] = entry
        return entry

    def remove(self, name: str) -> Entry:
        """Take the entry called ``name`` out again, as a trial does at its end, and return it."""
        entry = self[name]
        del self._entries[name]
        return entry

    def register(self, name: str) -> Callable[[Entry], Entry]:
        """Decorator form of :meth:`add`."""
        return lambda entry: self.add(name, entry)

    def __getitem__(self, name: str) -> Entry:
        """The entry called ``name``. Raises SceneError naming the nearest known one."""
        if name not in self:
            known = list(self)
            raise SceneError(f"unknown {self.kind} {name!r}{did_you_mean(name, known)} (known: {', '.join(known)})")
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known())

    def __len__(self) -> int:
        return len(self._known())

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name in self._entries or name in self._known())

    def _known(self) -> dict[str, Entry]:
        if self._extended:
            register_extras()
        return self._entries


# -- The extras --------------------------------------------------------------------------------------------------------
@cache
def extras() -> tuple[ModuleType, ...]:
    """Every extra that is there. ``COMMANDS`` of one: its commands, "module:function" each."""
    home = import_module("..extras", __package__)
    return tuple(import_module(f"{home.__name__}.{module.name}") for module in iter_modules(home.__path__))


@cache
def register_extras() -> None:
    """Have each extra add its entries to the rooms' registries, by its function ``register`` where it has one."""
    for extra in extras():
        if add := getattr(extra, "register", None):
            add()
