"""Folders that are the user's own: compiled kernels, keys of sources, the secret by which the user's work is known."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

from .files import atomic_write

KERNELS = "WAKEFLOW_KERNELS"  # names another folder, which is believed as it is


@cache
def kernel_root() -> Path:
    """The folder of compiled kernels: ``$WAKEFLOW_KERNELS``, else the user's own.

    Numba's index of compiled code is a pickle: who may write it may run code here. So it is never in the cache of
    stages, which may come from others with a folder of results.
    """
    root = Path(os.environ.get(KERNELS) or _own_folder("kernels")).absolute()
    os.environ[KERNELS] = str(root)  # for the processes that compile beside this one, if it is a temporary one
    return root


def key_root() -> Path:
    """The folder of the keys of sources: who may write there may pass stages of other sources off as these."""
    return _own_folder("keys")


def own_secret() -> bytes:
    """What only this user knows: what is signed with it did not come from others."""
    path = _own_folder("seals") / "secret"
    if not path.exists():
        with atomic_write(path, "wb") as stream:
            os.fchmod(stream.fileno(), 0o600)
            stream.write(os.urandom(32))
    return path.read_bytes()


@cache
def _own_folder(name: str) -> Path:
    """A folder in wakeflow/ in the user's own cache (``$XDG_CACHE_HOME`` or ~/.cache); a temporary one where that is
    not writable, not of the user's own, or others may write there.
    """
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        root = home.absolute() / "wakeflow" / name
        root.mkdir(parents=True, exist_ok=True, mode=0o700)
        about = root.stat()
        if about.st_uid == os.geteuid() and not about.st_mode & 0o022 and os.access(root, os.W_OK):
            return root
    except (OSError, RuntimeError):  # no home, or one that cannot be written: all is made once a process
        pass
    root = Path(tempfile.mkdtemp(prefix=f"wakeflow-{name}-"))
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return root
