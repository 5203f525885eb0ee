"""The numbers of a solved airflow that published values are compared with: a registry of quantities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.airflow.dust import RESIDENCE, DustyWake, dusty_wake
from wakeflow.core.lazy import cached_property
from wakeflow.core.registry import Registry
from wakeflow.foam.cost import core_seconds
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.results.airflow_summary import Airflow, airflow_of
from wakeflow.results.measured import Measured

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
class SolvedAirflow:
    """A solved airflow: what was ``found``, its OpenFOAM case, the body's projected width (m), the case of the draft
    that a time-resolved one starts from, and the air round the body for what is measured with dust in it.
    """

    found: Airflow
    case: Path
    width: float
    start: Path | None = None
    wake: DustyWake | None = None

    @property
    def cells(self) -> int:
        """Cells of its mesh."""
        assert self.found.cells is not None
        return self.found.cells

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
        from wakeflow.foam.history import read_table

        rows = read_table(self.case, "forceCoefficients", (HISTORY_CD, HISTORY_CL))
        period = self.found.period
        return rows if period is None else rows[rows[:, 0] >= rows[-1, 0] - period]


@dataclass(frozen=True)
class Quantity:
    """``label`` as printed in tables; ``of`` a solved airflow: the number, None where it has none."""

    label: str
    of: Callable[[SolvedAirflow], QuantityValue | None]


quantities: Registry[Quantity] = Registry("quantity")


def measured(pipeline: Pipeline) -> SolvedAirflow:
    """The airflow of a scene, solved or from the cache."""
    start = pipeline.draft.solution[1] / "case" if pipeline.plan.airflow.stepping == "time-resolved" else None
    case = pipeline.solution[1] / "case"
    return SolvedAirflow(airflow_of(pipeline), case, pipeline.scene.width, start, dusty_wake(pipeline))


def _number(found: Measured | float | None, scale: float = 1.0) -> QuantityValue | None:
    """A number of an airflow, with or without its interval."""
    if found is None:
        return None
    low, value, high = (found.low, found.value, found.high) if isinstance(found, Measured) else (found,) * 3
    if value is None or low is None or high is None:
        return None
    return QuantityValue(scale * value, scale * low, scale * high)


def _pressures(airflow: SolvedAirflow) -> QuantityValue | None:
    front, base = _number(airflow.found.cp_front), _number(airflow.found.cp_base)
    assert front is not None
    assert base is not None
    return QuantityValue(front.value - base.value, front.low - base.high, front.high - base.low)


def _reversal(airflow: SolvedAirflow) -> QuantityValue | None:
    zone = airflow.found.suction
    return None if zone is None else _number(zone.reversal_length, 1 / airflow.width)


def _residence(airflow: SolvedAirflow) -> QuantityValue | None:
    """None also for a wake that keeps its dust for ever."""
    found = None if airflow.wake is None else airflow.wake.residence()
    return None if found is None or found.closed else QuantityValue(found.value, found.low, found.high)


def _swing(column: int, what: Callable[[NDArray[np.float64]], Any]) -> Callable[[SolvedAirflow], QuantityValue | None]:
    def of(airflow: SolvedAirflow) -> QuantityValue | None:
        return None if airflow.found.period is None else _number(float(what(airflow.last_periods[:, column])))

    return of


for _name, _label, _of in (
    ("cd", "mean Cd", lambda a: _number(a.found.cd)),
    ("cl_rms", "Cl rms", lambda a: _number(a.found.cl_rms)),
    ("strouhal", "St", lambda a: _number(a.found.strouhal)),
    ("cp_base", "base Cp", lambda a: _number(a.found.cp_base)),
    ("cp_front", "front Cp", lambda a: _number(a.found.cp_front)),
    ("dp", "front less base Cp", _pressures),
    ("reversal", "reversal length / D", _reversal),
    ("cd_max", "largest Cd", _swing(1, np.max)),
    ("cd_min", "least Cd", _swing(1, np.min)),
    ("cl_swing", "Cl peak to peak", _swing(2, np.ptp)),
    (RESIDENCE, "residence time U / D of dust", _residence),
):
    quantities.add(_name, Quantity(_label, _of))
