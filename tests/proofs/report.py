"""Reports of the proofs and studies: the writer that ``wakeflow verify`` uses, and the numbers that rows are made of.

A proof is a function ``run(slow=..., tell=...) -> Report``. Its tables are rows under columns that are templates of a
cell: ``Table("title", {"drag": "{cd:.3f}", "error %": "{error:.2g*100}"}, rows)``. A row is a mapping from names to
values; by these names where a proof has them: ``case``, ``quantity``, ``value`` with its 95 % interval ``low`` to
``high``, ``expected``, ``gate`` (what is asked, in words), ``met``, ``seconds``, ``source``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wakeflow.core.number import student
from wakeflow.extras.verify.report import NOTHING, Column, Report, Row, Table, Tell, cell

__all__ = [
    "NOTHING", "Column", "Report", "Row", "Table", "Tell", "cell", "mean_interval", "plus_minus",
]  # fmt: skip

Interval = tuple[float, float, float]  # value, low, high


def mean_interval(values: ArrayLike, least: float = 0.0) -> Interval:
    """Mean of independent ``values`` and its 95 % interval by Student's t, whose half width is ``least`` at least."""
    found = np.asarray(values, dtype=float)
    value, half = float(found.mean()), least
    if len(found) > 1:
        half = max(half, student(len(found) - 1) * float(found.std(ddof=1)) / np.sqrt(len(found)))
    return value, value - half, value + half


def plus_minus(key: str, digits: int = 2, factor: float = 1.0) -> Column:
    """The column of an interval ``key`` of rows, as its value and half width; a dash where there is none."""

    def text(row: Row) -> str:
        if row[key] is None:
            return NOTHING
        value, low, high = (factor * number for number in row[key])
        return f"{value:.{digits}f} ± {0.5 * (high - low):.{digits}f}"

    return text
