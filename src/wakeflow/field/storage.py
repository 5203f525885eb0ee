"""A flow field's arrays in one .npz file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import SceneError
from ..core.tables import save_arrays


def write_arrays(path: Path | str, arrays: Mapping[str, ArrayLike], short: Collection[str]) -> None:
    """Write ``arrays`` by name to ``path``, whole or not at all; those in ``short`` in single precision."""
    save_arrays(path, {name: np.asarray(a, dtype=np.float32 if name in short else None) for name, a in arrays.items()})


def read_arrays(path: Path | str, needed: Collection[str], known: Collection[str]) -> dict[str, Any]:
    """Every array of the file by name. Raises SceneError when it cannot be read, lacks one that is ``needed``, or holds
    one that is not ``known``.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            content = {name: data[name] for name in data.files}
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read as a flow field ({error})") from None
    if not set(needed) <= set(content) <= set(known):
        raise SceneError(f"{path}: is not a flow field written by wakeflow")
    return content
