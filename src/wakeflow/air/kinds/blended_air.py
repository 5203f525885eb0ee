"""The air that is a blend of the steady wake and the one in time, and its numbers."""

from __future__ import annotations

from dataclasses import replace
from math import hypot
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.lazy import cached_property
from ...core.number import Number
from ...core.store import content_key
from ...laws.best_estimate import NO_ESTIMATE, WakeEstimate
from ...planning.stage_cache import code_of
from ..field import FlowField
from ..field.combined import Wakes
from ..foam import FlowSpec
from ..foam.airflow_result import SuctionZone
from ..foam.measure import suction_zone
from .airflow_kinds import CaseAir, MadeOf, Realisations, airflow_kinds
from .airflow_table import Airflow, WakeEnd, WakeEnds


# -- The air between two wakes -----------------------------------------------------------------------------------------
@airflow_kinds.register("best-estimate")
class BlendedAir(MadeOf):
    """The wake between a ``steady`` one and the one in time, ``bare``, as much of each as the plan's best estimate
    says; without an estimate it is the one in time, which has wakes beside it.
    """

    means = "a best estimate between the steady wake and the one in time"

    def __init__(self, steady: CaseAir, bare: CaseAir) -> None:
        super().__init__(bare)
        self.steady = steady

    @property
    def estimate(self) -> WakeEstimate:
        """The plan's; none where the answer is the wake in time: where that came to rest, too."""
        return self.plan.airflow.wake if self.bare.field.in_time else NO_ESTIMATE

    @property
    def key(self) -> str:
        if not (wake := self.estimate):
            return self.bare.key
        numbers = wake.theta.value, wake.strength.value
        return content_key("blend", self.bare.key, self.steady.key, *numbers, code_of("air.field.combined"))

    def make_field(self) -> FlowField:
        wake = self.estimate
        return self.between(wake.theta.value, wake.strength.value) if wake else self.bare.field

    def make_numbers(self) -> Airflow:
        if not (wake := self.estimate):
            return self.bare.measured
        mean = self.between(wake.theta.value, 0.0).mean()  # in time where the mesh moves
        return blended_airflow(self.flow_spec, wake, mean, self.steady.measured, self.bare.measured)

    @cached_property
    def wakes(self) -> Wakes:
        """Both wakes, the steady one and the one in time, to be blended."""
        return Wakes(self.bare.field, self.steady.field)

    def between(self, theta: float, strength: float) -> FlowField:
        if not self.bare.field.in_time or theta == strength == 1.0:  # it came to rest, or is wanted as it is
            return self.bare.field
        return self.wakes.blended(theta, strength)

    @property
    def realisations(self) -> Realisations:
        return Realisations(self.field, cycles=self.bare.stored.cycles)

    def make_solution(self) -> tuple[str, Path]:
        return self.bare.solution


# -- The numbers of a best estimate ------------------------------------------------------------------------------------
ON_EDGE = 1e-6  # of the mesh's extent: how far inside the channel's edges a body's nodes lie at least


def blended_airflow(
    spec: FlowSpec, estimate: WakeEstimate, mean: FlowField, steady: Airflow, resolved: Airflow
) -> Airflow:
    """The time-resolved airflow ``resolved`` with the numbers of the estimate, and both ends in it.

    ``mean``: the mean field of the estimate, on which the suction zone is measured; ``steady``: the other end. The mean
    forces and pressures are linear in theta as the pressure is; the lift fluctuates by its own number. Their intervals
    hold those of the ends and the ranges of theta and of the lift.
    """
    theta = estimate.theta

    def linear(low: float, high: float) -> float:
        """A mean of the air, without an interval."""
        return (1.0 - theta.value) * low + theta.value * high

    p_inlet = linear(steady.p_inlet, resolved.p_inlet)
    ends = WakeEnds(*(WakeEnd(end.cd, end.cl_rms, end.cp_base, end.suction) for end in (steady, resolved)))
    lift = _between(estimate.lift, Number(0.0, 0.0, 0.0), ends.time_resolved.cl_rms)
    return replace(
        resolved,
        cd=_between(theta, steady.cd, resolved.cd),
        cp_base=_between(theta, steady.cp_base, resolved.cp_base),
        cl_rms=replace(lift, low=max(0.0, lift.low)),
        cp_front=linear(steady.cp_front, resolved.cp_front),
        p_inlet=p_inlet,
        pressure_drop=linear(steady.pressure_drop, resolved.pressure_drop),
        flow_rate=linear(steady.flow_rate, resolved.flow_rate),
        cd_of={name: linear((steady.cd_of or {})[name], drag) for name, drag in (resolved.cd_of or {}).items()},
        suction=_suction(spec, mean, p_inlet),
        ends=ends,
        wake=estimate,
    )


def _between(share: Number, steady: Number, resolved: Number) -> Number:
    """A number that is linear in the ``share`` of the time-resolved end, with its interval."""
    (low, value, high), (here, there, beyond) = (_ends(number) for number in (steady, resolved))
    middle = (1.0 - share.value) * value + share.value * there
    spread = hypot((1.0 - share.value) * 0.5 * (high - low), share.value * 0.5 * (beyond - here))
    moved = sorted(((share.low - share.value) * (there - value), (share.high - share.value) * (there - value)))
    return Number(middle, middle - hypot(spread, moved[0]), middle + hypot(spread, moved[1]))


def _ends(number: Number) -> tuple[float, float, float]:
    """Low end, value and high end of a number; three times the value where its ends are not known."""
    value, low, high = number
    return (low, value, high) if number.known else (value, value, value)


def _suction(spec: FlowSpec, mean: FlowField, p_inlet: float) -> SuctionZone:
    """The suction zone of a mean field; ``p_inlet`` (Pa) is what its pressure coefficients count from."""
    cp = (mean.pressure - p_inlet) / (0.5 * spec.density * spec.speed**2)
    return suction_zone(spec, mean.points, mean.triangles, cp, mean.velocity, _at_bodies(mean))


def _at_bodies(mesh: FlowField) -> NDArray[np.intp]:
    """The nodes on the bodies: those of the boundary that do not lie on the edges of the channel."""
    points, nodes = mesh.points, mesh.boundary
    low, high = points.min(axis=0), points.max(axis=0)
    slack = ON_EDGE * (high - low)
    inside = np.all((points[nodes] > low + slack) & (points[nodes] < high - slack), axis=1)
    return nodes[inside]
