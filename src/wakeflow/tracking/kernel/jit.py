"""How kernels are compiled: numba's cache does not notice edits in other files, so its folder is named by a hash over
everything that the kernel's entry imports. An edit there means another folder.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numba

from ...core.sources import kernel_folder

# No reference counts: the kernel makes no arrays, and counting them at every call would take most of its time.
OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}


def compiled(function: Any) -> Any:
    """A helper of the kernel: compiled into whatever calls it. What a law calls of its own module is compiled too:
    laws are plain Python, and a compiled function calls compiled ones only.
    """
    own, names = function.__globals__, function.__code__.co_names if ".laws." in function.__module__ else ()
    called = {name: own[name] for name in names if isinstance(own.get(name), FunctionType)}
    if called:
        ready = own | {name: compiled(law) for name, law in called.items()}
        function = FunctionType(function.__code__, ready, function.__name__, function.__defaults__)
    return numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **OPTIONS)(function)


def inlined(function: Any) -> Any:
    """A helper with one caller that takes many arrays: a call would copy all their descriptors."""
    return numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True, **OPTIONS)(function)


def merged(function: Any) -> Any:
    """A helper that becomes part of its only caller before anything is compiled: quicker than compiling both."""
    return numba.njit(inline="always", **OPTIONS)(function)


def entry(function: Any) -> Any:
    """The kernel's entry: compiled once per machine and version of the sources, then read from the cache."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(kernel_folder(function.__module__))
    try:
        return numba.njit(cache=True, **OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = before
