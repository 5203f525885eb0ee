"""What is measured in a solved airflow: quantities by name, among them how long the near wake keeps fine dust, and
lines of the wake that were measured by others.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import date
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from proofs.airflow.residence import ResidenceTime, residence_time
from wakeflow.air.field import FlowField
from wakeflow.air.field.combined import blended_wake, interpolated
from wakeflow.air.foam.case import read_parameters
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.core.errors import known
from wakeflow.core.lazy import cached_property
from wakeflow.core.number import Number
from wakeflow.core.registry import Registry
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.laws.best_estimate import WakeEstimate, best_estimate, wakes

RESIDENCE = "residence_time"  # the quantity, here and in the wakes' data
ENTRY = re.compile(r"^(nProcs|ExecutionTime) *[:=] *([0-9.e+]+)", re.M)


def core_seconds(case: Path) -> float:
    """Processor seconds (all ranks) that the solvers spent in ``case``, restarts and failed attempts counted.

    OpenFOAM prints ``nProcs`` when it starts and its ExecutionTime, processor time since then, after every step. Unlike
    wall seconds it does not grow when other programs share the machine.
    """
    total = 0.0
    for log in sorted([*case.glob("log.[sp]imple*"), *case.glob("failed-*.log")]):
        ranks, last = 1, 0.0
        for name, value in ENTRY.findall(log.read_text(errors="replace")):
            if name == "nProcs":
                total, last, ranks = total + ranks * last, 0.0, int(value)
            else:
                last = float(value)
        total += ranks * last
    return total


@dataclass(frozen=True, eq=False)
class DustyWake:
    """The ``air`` round the first body of a scene, read where it is needed, the body's ``outline`` (k, 2) m, and where
    and how fast (m/s) the air flows.
    """

    air: Callable[[], Realisations]
    outline: NDArray[np.float64]
    direction: Literal["down", "up"]
    speed: float

    def residence(self) -> ResidenceTime:
        """The near-wake residence time; its interval is over the realisations, or the cycles of the only one."""
        air = self.air()
        fields = [made for number in range(len(air)) if (made := air.make(number)) is not None]
        return residence_time(fields, self.outline, self.direction, self.speed, sheddings=air.cycles)

    def between(self, steady: DustyWake, theta: float, strength: float) -> DustyWake:
        """The wake between ``steady`` and this one in time, see :func:`wakeflow.air.field.combined.blended_wake`."""

        def blended() -> Realisations:
            air, end = self.air(), steady.air().field
            assert air.field is not None
            assert end is not None
            return Realisations(blended_wake(air.field, end, theta, strength), cycles=air.cycles)

        return replace(self, air=blended)


def dusty_wake(pipeline: Pipeline) -> DustyWake | None:
    """The air round the first body of a pipeline's scene; None without a body."""
    scene = pipeline.scene
    if scene.air is None or scene.first_outline is None:
        return None
    return DustyWake(lambda: pipeline.air.realisations, scene.first_outline, scene.air.direction, scene.air.speed)


def estimate_without(quantity: str, family: str, blockage: float, reynolds: float) -> WakeEstimate:
    """The best estimate of ``family``'s wake from all data but those of ``quantity``, which it is to be judged by."""
    return best_estimate(family, blockage, reynolds, [entry for entry in wakes() if entry.quantity != quantity])


def within_estimate(resolved: DustyWake, steady: DustyWake, estimate: WakeEstimate) -> Iterator[ResidenceTime]:
    """The residence time at the estimate itself, and at both ends of the range of theta and of the strength."""
    theta, strength = estimate.theta, estimate.strength
    for share, fluctuation in (
        (theta.value, strength.value),
        (theta.low, strength.value),
        (theta.high, strength.value),
        (theta.value, strength.low),
        (theta.value, strength.high),
    ):
        yield resolved.between(steady, share, fluctuation).residence()


HISTORY_CD, HISTORY_CL = 1, 3  # columns of OpenFOAM's coefficient.dat


@dataclass(frozen=True)
class SolvedAirflow:
    """A solved airflow: what was ``found``, its OpenFOAM case, the body's projected width (m), the cases that a
    time-resolved one starts from in turn (those on coarser meshes, the draft), and the air round the body for what is
    measured with dust in it.
    """

    found: Airflow
    case: Path
    width: float
    before: tuple[Path, ...] = ()
    wake: DustyWake | None = None

    @property
    def cells(self) -> int:
        """Cells of its mesh."""
        return self.found.cells

    @cached_property
    def cost(self) -> float:
        """Processor seconds of its solver, and of those that it starts from."""
        return sum(map(core_seconds, (self.case, *self.before)))

    @cached_property
    def day(self) -> str:
        """The date on which it was computed, not that on which it was read from the cache."""
        return date.fromtimestamp((self.case / "airflow.json").stat().st_mtime).isoformat()

    @cached_property
    def last_periods(self) -> NDArray[np.float64]:
        """Rows (n, 3) of time (s), Cd, Cl over the last period of a shedding wake; all rows of another."""
        from wakeflow.air.foam.statistics import read_table

        rows = read_table(self.case, "forceCoefficients", (HISTORY_CD, HISTORY_CL))
        period = self.found.period
        return rows if math.isnan(period) else rows[rows[:, 0] >= rows[-1, 0] - period]

    @cached_property
    def fluctuation(self) -> tuple[FlowField, NDArray[np.float64]]:
        """The field of the air, and the variance (N, 2) m2/s2 of its velocity along the air and across it."""
        field = known(known(self.wake).air().field)
        return field, variance(field)[:, ::-1]


@dataclass(frozen=True)
class Quantity:
    """``label`` as printed in tables; ``of`` a solved airflow: the number, None where it has none."""

    label: str
    of: Callable[[SolvedAirflow], Number | None]


def variance(field: FlowField) -> NDArray[np.float64]:
    """Of the velocity (N, 2) m2/s2 in x and y at the nodes: all that an instrument sees, what the field has in time and
    2k/3 of what is modelled.
    """
    if not field.in_time:
        return np.repeat(2.0 / 3.0 * field.k[:, None], 2, axis=1)
    snapshots = field.snapshots()
    velocity, k = snapshots.velocity, snapshots.k
    weights = field.time_axis.shares()
    moves = velocity - np.tensordot(weights, velocity, axes=1)
    return np.asarray(np.tensordot(weights, moves**2, axes=1) + 2.0 / 3.0 * (weights @ k)[:, None])


quantities: Registry[Quantity] = Registry("quantity")


def measured(pipeline: Pipeline) -> SolvedAirflow:
    """The airflow of a scene, solved or from the cache."""
    in_time, airs = pipeline.plan.airflow.stepping == "time-resolved", pipeline.airs
    solved = [*airs.answers, airs.steady[-1]] if in_time else airs.answers[:1]
    case, *before = (air.in_case.case for air in solved)
    return SolvedAirflow(pipeline.airflow, case, pipeline.scene.width, tuple(before), dusty_wake(pipeline))


def _number(found: Number | float, scale: float = 1.0) -> Number | None:
    """A number of an airflow, with or without its interval."""
    value, low, high = found if isinstance(found, Number) else (found,) * 3
    if isinstance(found, Number) and not found.known:
        return None
    return Number(scale * value, scale * low, scale * high)


def _pressures(airflow: SolvedAirflow) -> Number | None:
    front, base = _number(airflow.found.cp_front), _number(airflow.found.cp_base)
    assert front is not None
    assert base is not None
    return Number(front.value - base.value, front.low - base.high, front.high - base.low)


def _reversal(airflow: SolvedAirflow) -> Number | None:
    return _number(airflow.found.suction.reversal_length, 1 / airflow.width)


def _residence(airflow: SolvedAirflow) -> Number | None:
    """None also for a wake that keeps its dust for ever."""
    found = None if airflow.wake is None else airflow.wake.residence()
    return None if found is None or found.closed else Number(found.value, found.low, found.high)


def _swing(column: int, what: Callable[[NDArray[np.float64]], Any]) -> Callable[[SolvedAirflow], Number | None]:
    def of(airflow: SolvedAirflow) -> Number | None:
        return None if math.isnan(airflow.found.period) else _number(float(what(airflow.last_periods[:, column])))

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


Array = NDArray[np.float64]
REACH = 3.0  # widths behind the rear within which the fastest reversed air is looked for: near wakes end there
STEP = 0.01  # widths between the places that are looked at
ACROSS = 1.2  # widths to either side, as far as the profiles were measured
STATIONS = (0.375, 0.95, 1.53, 3.75, 9.4)  # widths behind the rear: where the Volvo rig's profiles were measured


@cache
def _mean(case: Path) -> tuple[FlowField, Array, Array, float, float]:
    """The mean field of a solved case; where the first body's axis leaves it (m), the unit vector along the air, the
    inlet's mean speed (m/s) and the body's width (m).
    """
    given = read_parameters(case)
    rear, along = (
        np.array(given[name].strip("()").split()[:2], dtype=float) for name in ("basePoint", "flowDirection")
    )
    field = FlowField.from_openfoam(case, "mean" if (case / "loop.json").exists() else "latest")
    return field, rear, along, float(given["inletSpeed"]), float(given["bodyWidth"])


def mean_axial(case: Path, behind: Array, across: Array) -> Array:
    """Mean velocity along the air over the inlet's mean speed, at places (n,) behind the first body's rear and across
    its axis, both in its widths; NaN outside of the mesh. On half a domain the other half is its mirror image.
    """
    field, _, along, speed, _ = _mean(case)
    return np.asarray(field.sample(_places(case, field, behind, across))[0] @ along / speed)


def _places(case: Path, field: FlowField, behind: Array, across: Array) -> Array:
    """Those places (n, 2) m in a ``field`` of the case."""
    _, rear, along, _, width = _mean(case)
    beside = width * across
    if field.points[:, 0].min() > rear[0] - 1e-6 * width:  # only x >= 0 was meshed
        beside = np.abs(beside)
    return np.asarray(rear + width * behind[:, None] * along + beside[:, None] * np.array([1.0, 0.0]))


def rms(airflow: SolvedAirflow, behind: Array, across: Array) -> Array:
    """Rms (n, 2) of the velocity along the air and across it over the inlet's mean speed, there."""
    field, square = airflow.fluctuation
    places = _places(airflow.case, field, behind, across)
    return np.asarray(np.sqrt(interpolated(field, {"square": square}, places)["square"]) / _mean(airflow.case)[3])


def _exact(value: float) -> Number | None:
    return Number(value, value, value) if np.isfinite(value) else None


def _reversed(airflow: SolvedAirflow, *, where: bool) -> Number | None:
    behind = np.arange(STEP, REACH, STEP)
    values = mean_axial(airflow.case, behind, np.zeros_like(behind))
    if np.isnan(values).all():
        return None
    fastest = int(np.nanargmin(values))
    return _exact(float(behind[fastest] if where else values[fastest]))


def _on_axis(airflow: SolvedAirflow, station: float) -> Number | None:
    return _exact(float(mean_axial(airflow.case, np.array([station]), np.zeros(1))[0]))


def _fastest_beside(airflow: SolvedAirflow, station: float) -> Number | None:
    across = np.arange(-ACROSS, ACROSS + STEP, STEP)
    values = mean_axial(airflow.case, np.full_like(across, station), across)
    return None if np.isnan(values).any() else _exact(float(values.max()))


def _rms(airflow: SolvedAirflow, station: float, *, across: bool, axis: bool) -> Number | None:
    """At a station on the axis, or the largest of the profile there."""
    if airflow.wake is None:
        return None
    beside = np.zeros(1) if axis else np.arange(-ACROSS, ACROSS + STEP, STEP)
    return _exact(float(rms(airflow, np.full_like(beside, station), beside)[:, int(across)].max()))


def _most_across(airflow: SolvedAirflow, *, where: bool) -> Number | None:
    if airflow.wake is None:
        return None
    behind = np.arange(STEP, REACH, STEP)
    values = rms(airflow, behind, np.zeros_like(behind))[:, 1]
    return _exact(float(behind[values.argmax()] if where else values.max()))


for _name, _label, _of in (
    ("rms_v_most", "largest rms v on the axis", partial(_most_across, where=False)),
    ("rms_v_most_at", "its place behind the rear / D", partial(_most_across, where=True)),
    *(
        (
            f"rms_{name}_{'axis_' * axis}{at:g}",
            f"{'largest ' * (not axis)}rms {name}{' on the axis' * axis} at {at:g} D",
            partial(_rms, station=at, across=name == "v", axis=axis),
        )
        for at in STATIONS
        for name in "uv"
        for axis in (True, False)
    ),
    ("axis_least", "least mean u on the axis", partial(_reversed, where=False)),
    ("axis_least_at", "its place behind the rear / D", partial(_reversed, where=True)),
    *((f"axis_{at:g}", f"mean u on the axis at {at:g} D", partial(_on_axis, station=at)) for at in STATIONS),
    *((f"beside_{at:g}", f"largest mean u at {at:g} D", partial(_fastest_beside, station=at)) for at in STATIONS),
):
    quantities.add(_name, Quantity(_label, _of))
