"""A field's functions of time: what of each of its snapshots or parts makes it up at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .splines import POWERS, around

__all__ = ["TimeAxis", "time_shares"]

Array = NDArray[np.float64]


def time_shares(times: Array, period: float | None) -> Array:
    """The part of the time that each snapshot stands for (T,): trapezoidal rule, round the period if there is one."""
    step = np.diff(times)
    share = np.zeros(len(times))
    share[:-1] += step / 2
    share[1:] += step / 2
    if period is not None:
        gap = times[0] + period - times[-1]
        share[0] += gap / 2
        share[-1] += gap / 2
    return share / share.sum() if share.sum() > 0 else np.full(len(share), 1.0 / len(share))


@dataclass(frozen=True, eq=False)
class TimeAxis:
    """``times`` (T,) s, the ``period`` (s) after which they repeat, and the ``coefficients`` (T, R) of the parts'
    splines; as in :class:`wakeflow.field.FlowField`, None for what it has not.
    """

    times: Array | None
    period: float | None
    coefficients: Array | None

    def around(self, t: float) -> tuple[int, int, float]:
        """Indices of the two snapshots around time ``t`` (s) and the weight of the second; (0, 0, 0.0) when steady."""
        if self.times is None:
            return 0, 0, 0.0
        times, last = self.times, len(self.times) - 1
        if self.period is not None:
            t = times[0] + (t - times[0]) % self.period
            gap = times[0] + self.period - times[last]
            if t >= times[last] and gap > 0:
                return last, 0, float((t - times[last]) / gap)
        i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(last - 1, 0)))
        j = min(i + 1, last)
        return i, j, float(np.clip((t - times[i]) / (times[j] - times[i]), 0.0, 1.0)) if j > i else 0.0

    def weights(self, t: float) -> Array:
        """The weight of each snapshot or part (R,) at time ``t`` (s); a lone 1 when steady."""
        if self.times is None:
            return np.ones(1)
        if self.coefficients is not None:
            assert self.period is not None
            index, share = around(t, float(self.times[0]), self.period, len(self.times))
            return np.asarray(share @ self.coefficients[index])
        i, j, w = self.around(t)
        weight = np.zeros(len(self.times))
        weight[i] += 1.0 - w
        weight[j] += w
        return weight

    def polynomial(self, t: float) -> tuple[float, float, Array]:
        """See ``FlowField.polynomial``."""
        if self.times is None:
            return t, np.inf, np.ones((1, 1))
        if self.coefficients is not None:
            assert self.period is not None
            step = self.period / len(self.times)
            first = np.floor((t - self.times[0]) / step)
            near = (int(first) + np.arange(-1, 3)) % len(self.times)
            shares = POWERS @ self.coefficients[near] / step ** np.arange(4)[:, None]
            return float(self.times[0] + first * step), float(self.times[0] + (first + 1) * step), shares
        i, j, w = self.around(t)
        rise = np.zeros(len(self.times))
        if i == j:
            return t, np.inf, np.stack([self.weights(t), rise])
        step = self.times[j] - self.times[i] + (0.0 if j > i else self.period or 0.0)
        rise[i], rise[j] = -1.0 / step, 1.0 / step
        return t, t + (1.0 - w) * float(step), np.stack([self.weights(t), rise])

    def mean_weights(self) -> Array:
        """The time mean of each snapshot's or part's weight (R,); for a field in time."""
        assert self.times is not None
        return time_shares(self.times, self.period) if self.coefficients is None else self.coefficients.mean(axis=0)
