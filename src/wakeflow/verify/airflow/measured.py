"""The numbers of a solved airflow that published values are compared with: a registry of quantities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.registry import Registry
from ...foam.cost import core_seconds
from ...pipeline.pipeline import Pipeline

__all__ = ["Measured", "Quantity", "QuantityValue", "measured", "quantities"]

HISTORY_CD, HISTORY_CL = 1, 3  # columns of OpenFOAM's coefficient.dat


@dataclass(frozen=True)
class QuantityValue:
    """A value with the ends of its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half of the interval's width."""
        return (self.high - self.low) / 2


@dataclass(frozen=True)
class Measured:
    """A solved airflow: its ``airflow`` table, its OpenFOAM case, the body's projected width (m), and the case of the
    draft that a time-resolved one starts from.
    """

    table: dict[str, Any]
    case: Path
    width: float
    start: Path | None = None

    @cached_property
    def cost(self) -> float:
        """Processor seconds of its solver, and of the draft that it starts from."""
        return core_seconds(self.case) + (0.0 if self.start is None else core_seconds(self.start))

    @cached_property
    def day(self) -> str:
        """The date on which it was computed, not that on which it was read from the cache."""
        return date.fromtimestamp((self.case / "airflow.json").stat().st_mtime).isoformat()

    @cached_property
    def last_periods(self) -> NDArray[np.float64]:
        """Rows (n, 3) of time (s), Cd, Cl over the last period of a shedding wake; all rows of another."""
        from ...foam.history import read_table

        rows = read_table(self.case, "forceCoefficients", (HISTORY_CD, HISTORY_CL))
        period = self.table["period"]
        return rows if period is None else rows[rows[:, 0] >= rows[-1, 0] - period]


@dataclass(frozen=True)
class Quantity:
    """``label`` as printed in tables; ``of`` a solved airflow: the number, None where it has none."""

    label: str
    of: Callable[[Measured], QuantityValue | None]


quantities: Registry[Quantity] = Registry("quantity")


def measured(pipeline: Pipeline) -> Measured:
    """The airflow of a scene, solved or from the cache."""
    start = pipeline.draft.solution[1] / "case" if pipeline.plan.airflow.stepping == "time-resolved" else None
    return Measured(pipeline.airflow, pipeline.solution[1] / "case", pipeline.scene.width, start)


def _number(entry: Any, scale: float = 1.0) -> QuantityValue | None:
    """A value of the ``airflow`` table, with or without its interval."""
    if entry is None:
        return None
    low, value, high = (entry[k] for k in ("low", "value", "high")) if isinstance(entry, dict) else (entry,) * 3
    return QuantityValue(scale * value, scale * low, scale * high)


def _entry(name: str) -> Callable[[Measured], QuantityValue | None]:
    return lambda airflow: _number(airflow.table[name])


def _pressures(airflow: Measured) -> QuantityValue | None:
    front, base = _number(airflow.table["cp_front"]), _number(airflow.table["cp_base"])
    assert front is not None
    assert base is not None
    return QuantityValue(front.value - base.value, front.low - base.high, front.high - base.low)


def _swing(column: int, what: Callable[[NDArray[np.float64]], Any]) -> Callable[[Measured], QuantityValue | None]:
    def of(airflow: Measured) -> QuantityValue | None:
        return None if airflow.table["period"] is None else _number(float(what(airflow.last_periods[:, column])))

    return of


for _name, _label, _of in (
    ("cd", "mean Cd", _entry("cd")),
    ("cl_rms", "Cl rms", _entry("cl_rms")),
    ("strouhal", "St", _entry("strouhal")),
    ("cp_base", "base Cp", _entry("cp_base")),
    ("cp_front", "front Cp", _entry("cp_front")),
    ("dp", "front less base Cp", _pressures),
    ("reversal", "reversal length / D", lambda a: _number(a.table["suction"]["reversal_length"], 1 / a.width)),
    ("cd_max", "largest Cd", _swing(1, np.max)),
    ("cd_min", "least Cd", _swing(1, np.min)),
    ("cl_swing", "Cl peak to peak", _swing(2, np.ptp)),
):
    quantities.add(_name, Quantity(_label, _of))
