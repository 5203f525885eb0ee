"""How kernels are compiled, and kept: numba's cache notices neither edits in other files nor equal sources elsewhere.
So a kernel's folder is named by a hash over everything that its entry imports, and by that alone: an edit there means
another folder, and a copy of the sources the same.
"""

from __future__ import annotations

import hashlib
import pickle
from contextlib import suppress
from types import FunctionType
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.serialize import dumps

from ...core.sources import kernel_folder

# No reference counts: the kernel makes no arrays, and counting them at every call would take most of its time.
OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}


class _Part(JITCodeLibrary):
    """The code of a helper. It is optimised, since whatever calls it takes it in, but never made machine code, which
    nobody would run: that of all helpers together takes about as long as that of the kernel.
    """

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """What is written below of the Python objects that machine code uses."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing: there is no machine code, and helpers use no such objects."""


class _Helper(Compiler):
    """Numba's compiler, into a part."""

    def __init__(self, types: Any, target: Any, library: Any, *more: Any) -> None:
        super().__init__(types, target, library or _Part(target.codegen(), "helper"), *more)


HELPER = {"pipeline_class": _Helper, "no_cpython_wrapper": True, "no_cfunc_wrapper": True} | OPTIONS


def compiled(function: Any) -> Any:
    """A helper of the kernel: compiled into whatever calls it. What a law calls of its own module is compiled too:
    laws are plain Python, and a compiled function calls compiled ones only.
    """
    own, names = function.__globals__, function.__code__.co_names if ".laws." in function.__module__ else ()
    called = {name: own[name] for name in names if isinstance(own.get(name), FunctionType)}
    if called:
        ready = own | {name: compiled(law) for name, law in called.items()}
        function = FunctionType(function.__code__, ready, function.__name__, function.__defaults__)
    return numba.njit(**HELPER)(function)


def inlined(function: Any) -> Any:
    """A helper with one caller that takes many arrays: a call would copy all their descriptors."""
    return numba.njit(forceinline=True, **HELPER)(function)


def merged(function: Any) -> Any:
    """A helper that becomes part of its only caller before anything is compiled: quicker than compiling both."""
    return numba.njit(inline="always", **OPTIONS)(function)


def entry(function: Any) -> Any:
    """The kernel's entry: compiled once per machine and version of the sources, then read from the cache."""
    kernel = numba.njit(**OPTIONS)(function)
    kernel._cache = _Cache(function)
    return kernel


class _Place(UserProvidedCacheLocator):
    """The folder of a kernel. Numba's own name it by the path of one file, and its contents by that file's."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(kernel_folder(function.__module__))

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Place:
        """For numba."""
        return cls(function, file)

    def get_source_stamp(self) -> str:
        """Nothing: the folder's name says which sources."""
        return ""

    def get_disambiguator(self) -> str:
        """Nothing: a module's kernels have different names."""
        return ""


class _Sealed(CompileResultCacheImpl):
    """What is kept of a kernel, with its hash: damaged machine code would run all the same."""

    _locator_classes = (_Place,)

    def reduce(self, kernel: Any) -> tuple[bytes, bytes]:
        """For the file."""
        kept = dumps(super().reduce(kernel))
        return hashlib.sha256(kept).digest(), kept

    def rebuild(self, target: Any, sealed: tuple[bytes, bytes]) -> Any:
        """From the file."""
        seal, kept = sealed
        if hashlib.sha256(kept).digest() != seal:
            raise ValueError("damaged")
        return super().rebuild(target, pickle.loads(kept))


class _Cache(FunctionCache):
    """Numba's cache, for which files that are damaged are none, and a folder that cannot be written keeps nothing."""

    _impl_class = _Sealed

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The kernel as it was kept; None: it has to be compiled."""
        try:
            return super().load_overload(signature, target)
        except Exception:  # whatever pickle, LLVM or the disk make of what is not whole
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, signature: Any, kernel: Any) -> None:
        """Keep a kernel that was compiled."""
        with suppress(OSError):
            super().save_overload(signature, kernel)
