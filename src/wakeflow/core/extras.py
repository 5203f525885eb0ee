"""The extras: packages built upon the rooms. No room names one; each registers what it adds, and says its commands."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType


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
