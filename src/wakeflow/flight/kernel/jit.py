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

from ...core.code_key import kernel_folder


class _Kernel(JITCodeLibrary):
    """The code of a kernel: its entry's, what that takes in, and all that is called."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.apart: dict[_Part, None] = {}  # the helpers that are called, each after those that it calls

    def add_linking_library(self, library: Any) -> None:
        """Take in what this code calls."""
        library._ensure_finalized()
        if isinstance(library, _Part):
            self.apart |= library.apart
            if not library.inlined:
                self.apart[library] = None
                return
        super().add_linking_library(library)

    def finalize(self) -> None:
        """Put everything together, callers first: LLVM takes in only what is called by what is there."""
        self._linking_libraries += reversed(self.apart)
        super().finalize()


class _Part(_Kernel):
    """The code of a helper. It is optimised, since it is taken into others, but never made machine code, which nobody
    would run. Once is enough, while numba does it twice, to find counts of references in between: here are none.
    """

    def __init__(self, codegen: Any, inlined: bool) -> None:
        super().__init__(codegen, "helper")
        self.inlined = inlined

    def finalize(self) -> None:
        """Put together what is inlined; what is called stays apart."""
        JITCodeLibrary.finalize(self)

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """What is written below of the Python objects that machine code uses."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: there is no machine code, and helpers use no such objects."""


class _Helper(Compiler):
    """Numba's compiler, which makes a helper a part of what calls it."""

    def compile_extra(self, function: Any) -> Any:
        """Compile a helper, for numba."""
        self.state.library = _Part(self.state.targetctx.codegen(), bool(self.state.flags.forceinline))
        return super().compile_extra(function)


class _Entry(Compiler):
    """Numba's compiler, of a whole kernel."""

    def compile_extra(self, function: Any) -> Any:
        """Compile a whole kernel, for numba."""
        self.state.library = _Kernel(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


# No reference counts: the kernel makes no arrays, and counting them at every call would take most of its time.
OPTIONS = {"pipeline_class": _Entry, "nogil": True, "error_model": "numpy", "_nrt": False}
HELPER = OPTIONS | {"pipeline_class": _Helper, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: Any) -> Any:
    """A helper of the kernel that becomes a part of whatever calls it: a call would copy the descriptors of all arrays
    that it takes.
    """
    return numba.njit(forceinline=True, **HELPER)(_with_its_laws(function))


def called(function: Any) -> Any:
    """A helper that stays a call: it is rarely run, as what walls do is, or has several callers. A kernel that takes in
    everything takes twice as long to optimise.
    """
    return numba.njit(forceinline=False, **HELPER)(function)


def _with_its_laws(function: Any) -> Any:
    """The function, with what a law calls of its own module compiled too: laws are plain Python, and a compiled
    function calls compiled ones only.
    """
    around, names = function.__globals__, function.__code__.co_names if ".laws." in function.__module__ else ()
    laws = {name: around[name] for name in names if isinstance(around.get(name), FunctionType)}
    if not laws:
        return function
    ready = around | {name: compiled(law) for name, law in laws.items()}
    return FunctionType(function.__code__, ready, function.__name__, function.__defaults__)


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
        """Make the place of a function's kernel, for numba."""
        return cls(function, file)

    def get_source_stamp(self) -> str:
        """Give no stamp: the folder's name says which sources."""
        return ""

    def get_disambiguator(self) -> str:
        """Give no further name: a module's kernels have different names."""
        return ""


class _Sealed(CompileResultCacheImpl):
    """What is kept of a kernel, with its hash: damaged machine code would run all the same."""

    _locator_classes = (_Place,)

    def reduce(self, kernel: Any) -> tuple[bytes, bytes]:
        """Turn a kernel into what the file holds: a hash and the machine code."""
        kept = dumps(super().reduce(kernel))
        return hashlib.sha256(kept).digest(), kept

    def rebuild(self, target: Any, sealed: tuple[bytes, bytes]) -> Any:
        """Make a kernel out of what the file holds. Raises ValueError where that is damaged."""
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
