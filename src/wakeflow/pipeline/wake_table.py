"""The numbers of a best estimate: what the air between the two ends amounts to, and the ends beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from math import hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..field import FlowField
from ..foam import FlowSpec
from ..foam.suction import suction_zone
from ..laws.best_estimate import Estimate, WakeEstimate

__all__ = ["wake_table"]

Interval = Mapping[str, float | None]
OF_AN_END = ("cd", "cl_rms", "cp_base", "suction")
LINEAR = ("cp_front", "p_inlet", "pressure_drop", "flow_rate")  # means of the air, without an interval
ON_EDGE = 1e-6  # of the mesh's extent: how far inside the channel's edges a body's nodes lie at least


def wake_table(
    spec: FlowSpec, estimate: WakeEstimate, mean: FlowField, steady: Mapping[str, Any], resolved: Mapping[str, Any]
) -> dict[str, Any]:
    """The table of the time-resolved airflow ``resolved`` with the numbers of the estimate, and both ends in it.

    ``mean``: the mean field of the estimate, on which the suction zone is measured; ``steady``: the other end's table.
    The mean forces and pressures are linear in theta as the pressure is; the lift fluctuates by the strength. Their
    intervals hold those of the ends and the ranges of theta and of the strength.
    """
    theta, strength = estimate.theta, estimate.strength
    share = theta.value
    found = dict(resolved)
    for name in ("cd", "cp_base"):
        found[name] = _between(theta, steady[name], resolved[name])
    found["cl_rms"] = _between(strength, {"value": 0.0, "low": 0.0, "high": 0.0}, resolved["cl_rms"])
    for name in LINEAR:
        found[name] = (1.0 - share) * steady[name] + share * resolved[name]
    found["cd_of"] = {
        name: (1.0 - share) * steady["cd_of"][name] + share * drag for name, drag in resolved["cd_of"].items()
    }
    found["suction"] = _suction(spec, mean, found["p_inlet"])
    ends = {"steady": steady, "time_resolved": resolved}
    found["ends"] = {which: {name: table[name] for name in OF_AN_END} for which, table in ends.items()}
    found["wake"] = {"theta": asdict(theta), "strength": asdict(strength), "why": estimate.why}
    return found


def _between(share: Estimate, steady: Interval, resolved: Interval) -> dict[str, float]:
    """A number that is linear in the ``share`` of the time-resolved end, with its interval."""
    (low, value, high), (here, there, beyond) = (_ends(number) for number in (steady, resolved))
    middle = (1.0 - share.value) * value + share.value * there
    own = hypot((1.0 - share.value) * 0.5 * (high - low), share.value * 0.5 * (beyond - here))
    moved = sorted(((share.low - share.value) * (there - value), (share.high - share.value) * (there - value)))
    return {"value": middle, "low": middle - hypot(own, moved[0]), "high": middle + hypot(own, moved[1])}


def _ends(number: Interval) -> tuple[float, float, float]:
    """Low, value and high; the value itself for an end that is not known."""
    value = number["value"]
    assert value is not None
    low, high = number["low"], number["high"]
    return value if low is None else low, value, value if high is None else high


def _suction(spec: FlowSpec, mean: FlowField, p_inlet: float) -> dict[str, float]:
    """The suction zone of a mean field; ``p_inlet`` (Pa) is what its pressure coefficients count from."""
    assert mean.pressure is not None
    cp = (mean.pressure - p_inlet) / (0.5 * spec.density * spec.speed**2)
    return asdict(suction_zone(spec, mean.points, mean.triangles, cp, mean.velocity, _at_bodies(mean)))


def _at_bodies(mesh: FlowField) -> NDArray[np.intp]:
    """The nodes on the bodies: those of the boundary that do not lie on the edges of the channel."""
    points, nodes = mesh.points, mesh.boundary
    low, high = points.min(axis=0), points.max(axis=0)
    slack = ON_EDGE * (high - low)
    inside = np.all((points[nodes] > low + slack) & (points[nodes] < high - slack), axis=1)
    return nodes[inside]
