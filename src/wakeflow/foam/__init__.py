"""The only package that knows OpenFOAM: from a mesh to a measured airflow and arrays of it.

Imports happen on first use, so that reading a user's case does not load what solving needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .airflow import solve_airflow
    from .airflow_result import AirflowResult
    from .case import FlowSpec, Stream
    from .read import read_flow
    from .watch import Progress

_HOMES = {
    "AirflowResult": "airflow_result",
    "FlowSpec": "case",
    "Progress": "watch",
    "Stream": "case",
    "read_flow": "read",
    "solve_airflow": "airflow",
}
__all__ = ["AirflowResult", "FlowSpec", "Progress", "Stream", "read_flow", "solve_airflow"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
