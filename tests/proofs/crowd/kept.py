"""What a peer found, kept in the cache: an interrupted comparison goes on where it was."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakeflow.core.store import Store, cache_root, content_key, digest_files
from wakeflow.tracking import Granules

FILE = "found.npz"
HERE = Path(__file__).parent


def kept_flight(
    peer: str,
    sources: Sequence[str],
    grains: Granules,
    settings: Any,
    work: Callable[[Path], tuple[NDArray[Any], float]],
) -> tuple[NDArray[Any], float]:
    """What ``work(folder)`` found for each granule, and processor seconds: from the cache, or computed.

    Kept by the ``peer``'s name, its ``sources`` in this folder, the granules, and JSON-able ``settings``.
    """

    def make(folder: Path) -> None:
        found, seconds = work(folder)
        np.savez(folder / FILE, found=found, seconds=np.array(seconds))

    key = content_key(peer, settings, _fingerprint(grains), digest_files([HERE / name for name in sources]))
    folder, _ = Store(cache_root()).make("verify-crowd", key, make)
    with np.load(folder / FILE) as data:
        return data["found"], float(data["seconds"])


def _fingerprint(grains: Granules) -> str:
    total = hashlib.sha256()
    for name in ("position", "velocity", "time", "depth", "diameter", "density", "restitution", "friction"):
        total.update(np.ascontiguousarray(getattr(grains, name), dtype=float).tobytes())
    return total.hexdigest()
