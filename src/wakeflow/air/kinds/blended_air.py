"""The kind of airflow that is a best estimate between the steady wake and the one in time, and its numbers."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from ...core.errors import known
from ...core.number import Number
from ...laws.best_estimate import WakeEstimate
from ..field import FlowField
from ..foam import FlowSpec
from ..foam.airflow_result import SuctionZone
from ..foam.suction import suction_zone
from .airflow_kinds import airflow_kinds
from .airflow_table import Airflow, WakeEnd, WakeEnds
from .solved_air import TimeResolvedAir


# -- The best estimate's air -------------------------------------------------------------------------------------------
@airflow_kinds.register("best-estimate")
class BestEstimateAir(TimeResolvedAir):
    """The wake between the steady one and the one in time, as much of each as the plan's best estimate says."""

    means = "a best estimate between the steady wake and the one in time"

    @property
    def estimate(self) -> WakeEstimate:
        """The plan's."""
        return known(self.plan.airflow.wake)

    def make_field(self) -> tuple[str, FlowField]:
        return self.between(self.estimate.theta.value, self.estimate.strength.value)

    def make_table(self) -> Airflow:
        """That of the time-resolved airflow where it came to rest, and so is no end."""

        if self.resolved[1].times is None:
            return self.measured
        mean = self.between(self.estimate.theta.value, 0.0)[1].mean()  # in time where the mesh moves
        return blended_airflow(self.flow_spec, self.estimate, mean, self.steady().measured, self.measured)


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

    def linear(low: float | None, high: float | None) -> float:
        """A mean of the air, without an interval."""
        return (1.0 - theta.value) * known(low) + theta.value * known(high)

    p_inlet = linear(steady.p_inlet, resolved.p_inlet)
    lift = _between(estimate.lift, Number(0.0, 0.0, 0.0), known(resolved.cl_rms))
    return replace(
        resolved,
        cd=_between(theta, known(steady.cd), known(resolved.cd)),
        cp_base=_between(theta, known(steady.cp_base), known(resolved.cp_base)),
        cl_rms=replace(lift, low=max(0.0, lift.low)),
        cp_front=linear(steady.cp_front, resolved.cp_front),
        p_inlet=p_inlet,
        pressure_drop=linear(steady.pressure_drop, resolved.pressure_drop),
        flow_rate=linear(steady.flow_rate, resolved.flow_rate),
        cd_of={name: linear((steady.cd_of or {})[name], drag) for name, drag in (resolved.cd_of or {}).items()},
        suction=_suction(spec, mean, p_inlet),
        ends=WakeEnds(*(WakeEnd(end.cd, end.cl_rms, end.cp_base, end.suction) for end in (steady, resolved))),
        wake=estimate,
    )


def _between(share: Number, steady: Number, resolved: Number) -> Number:
    """A number that is linear in the ``share`` of the time-resolved end, with its interval."""
    (low, value, high), (here, there, beyond) = (_ends(number) for number in (steady, resolved))
    middle = (1.0 - share.value) * value + share.value * there
    own = hypot((1.0 - share.value) * 0.5 * (high - low), share.value * 0.5 * (beyond - here))
    moved = sorted(((share.low - share.value) * (there - value), (share.high - share.value) * (there - value)))
    return Number(middle, middle - hypot(own, moved[0]), middle + hypot(own, moved[1]))


def _ends(number: Number) -> tuple[float, float, float]:
    """Low, value and high; the value itself for ends that are not known."""
    value, low, high = number
    return (low, value, high) if number.known else (value, value, value)


def _suction(spec: FlowSpec, mean: FlowField, p_inlet: float) -> SuctionZone:
    """The suction zone of a mean field; ``p_inlet`` (Pa) is what its pressure coefficients count from."""
    cp = (known(mean.pressure) - p_inlet) / (0.5 * spec.density * spec.speed**2)
    return suction_zone(spec, mean.points, mean.triangles, cp, mean.velocity, _at_bodies(mean))


def _at_bodies(mesh: FlowField) -> NDArray[np.intp]:
    """The nodes on the bodies: those of the boundary that do not lie on the edges of the channel."""
    points, nodes = mesh.points, mesh.boundary
    low, high = points.min(axis=0), points.max(axis=0)
    slack = ON_EDGE * (high - low)
    inside = np.all((points[nodes] > low + slack) & (points[nodes] < high - slack), axis=1)
    return nodes[inside]
