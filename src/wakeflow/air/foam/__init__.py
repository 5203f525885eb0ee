"""The only package that knows OpenFOAM: from a mesh to a measured airflow and arrays of it.

Comes in: a FlowSpec and a mesh file. Goes out: a solved case with its AirflowResult, arrays of its fields.
May call it: ``kinds``, and what shows a case. Imports happen on first use, so that reading a user's case does not load
what solving needs.
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
