"""Every kind of airflow, registered by its module."""

from __future__ import annotations

from . import blended_air, known_air, solved_air  # noqa: F401 - they register kinds of airflow
from .airflow_kinds import airflow_kinds

__all__ = ["airflow_kinds"]
