"""Tables for Python: what pandas makes of columns where it is installed."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

__all__ = ["frame_of"]


def frame_of(columns: Mapping[str, Any]) -> Any:
    """Arrays of one length by the heads of their columns, as a pandas DataFrame where pandas is installed, else as a
    dict.
    """
    if find_spec("pandas") is None:
        return dict(columns)
    return import_module("pandas").DataFrame(dict(columns))
