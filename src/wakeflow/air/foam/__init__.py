"""The only package that knows OpenFOAM: from a mesh to a measured airflow and arrays of it.

Imports happen on first use, so that reading a user's case does not load what solving needs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...core.lazy import loaded

if TYPE_CHECKING:
    from .airflow import solve_airflow
    from .airflow_result import AirflowResult
    from .case import FlowSpec, Stream
    from .read import read_flow
    from .watch import Progress

__all__ = ["AirflowResult", "FlowSpec", "Progress", "Stream", "read_flow", "solve_airflow"]


def __getattr__(name: str) -> Any:
    return loaded(__name__, name)
