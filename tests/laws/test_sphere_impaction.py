"""Which fine granules a moving sphere meets: against paths in the potential flow about it, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wakeflow.laws.sphere_impaction import sphere_caught

POTENTIAL = 1e200  # a Reynolds number, of which the law's logarithm is large


def _met(stokes: float, step: float = 0.01, starts: int = 400) -> float:
    """The share by integration of paths towards a sphere of radius 1 at rest, air of speed 1 along x: exponential
    midpoint steps of granules that start with the air, six diameters upstream.
    """
    tau, y = 2.0 * stokes, np.linspace(0.0025, 1.0, starts)
    start, x, hit = y.copy(), np.full(starts, -12.0), np.zeros(starts, dtype=bool)
    decay = math.exp(-step / tau)

    def air(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r2 = np.maximum(x * x + y * y, 1.0)
        return 1.0 + 0.5 * (y * y - 2.0 * x * x) / r2**2.5, -1.5 * x * y / r2**2.5

    u, v = air(x, y)
    for _ in range(round(20.0 / step)):
        ax, ay = air(x + 0.5 * step * u, y + 0.5 * step * v)
        x = x + ax * step + (u - ax) * tau * (1.0 - decay)
        y = y + ay * step + (v - ay) * tau * (1.0 - decay)
        u, v = ax + (u - ax) * decay, ay + (v - ay) * decay
        hit |= x * x + y * y < 1.0
    return float(start[hit].max(initial=0.0) ** 2)


@pytest.mark.parametrize("stokes", [0.04, 0.08, 0.12, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0])
def test_at_a_high_reynolds_number_paths_in_potential_flow_are_met_as_often(stokes: float) -> None:
    assert abs(_met(stokes) - sphere_caught(stokes, POTENTIAL)) < 0.03


def test_none_of_the_finest_and_all_of_the_coarsest_are_met_and_more_in_faster_air() -> None:
    assert sphere_caught(0.0, 1e3) == 0.0
    assert sphere_caught(0.6, 0.0) == 0.0  # creeping flow: S0 = 1.2
    assert sphere_caught(1e6, 1.0) == pytest.approx(1.0, abs=1e-6)
    stokes, reynolds = np.meshgrid(np.geomspace(0.01, 100.0, 60), np.geomspace(1.0, 1e5, 20))
    share = sphere_caught(stokes, reynolds)
    assert np.all(np.diff(share, axis=1) >= 0.0)
    assert np.all(np.diff(share, axis=0) >= 0.0)
    assert np.all((share >= 0.0) & (share < 1.0))
