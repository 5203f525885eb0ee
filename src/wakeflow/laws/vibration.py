"""A measured vibration: one period of acceleration samples, integrated twice without error.

Between samples the acceleration is linear, so velocity is a parabola and displacement a cubic from sample to sample:
the integrals are sums of closed forms, and nothing is filtered. Two things of a record are not kept: its mean
acceleration, since a vibrating body stays where it is in the mean, and its initial place and speed, since the body
swings about the place where it stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import numbers
from ..core.errors import SceneError

Array = NDArray[np.float64]
MAX_ROCK = math.radians(30) + 1e-9  # rad: the tracker's steps past a body, short against its period, turn it by little
MAX_SAMPLES = 20_000  # kept with every result of the scene


@dataclass(frozen=True, eq=False)
class Record:
    """One period of a motion along a line, at its samples (k,): time (s, from 0 to the period), displacement (m),
    velocity (m/s) and acceleration (m/s2). It repeats; the last sample is the first of the next period.
    """

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array

    @property
    def period(self) -> float:
        """Length of the record (s)."""
        return float(self.time[-1])

    @property
    def seam(self) -> float:
        """The jump of the acceleration from one period to the next, over its peak."""
        return float(abs(self.acceleration[-1] - self.acceleration[0])) / self.peak_acceleration

    @property
    def peak_acceleration(self) -> float:
        """Largest |acceleration| (m/s2): between samples it is linear, so a sample holds it."""
        return float(np.abs(self.acceleration).max())

    @property
    def peak_speed(self) -> float:
        """Largest |velocity| (m/s): at a sample or where the acceleration between two passes zero."""
        return self._peak(*self._zeros(self.acceleration[:-1], np.diff(self.acceleration), 0.0), part=1)

    @property
    def reach(self) -> float:
        """Largest |displacement| (m): at a sample or where the velocity between two passes zero."""
        h = np.diff(self.time)
        parabola = self.velocity[:-1], self.acceleration[:-1] * h, 0.5 * h * np.diff(self.acceleration)
        return max(self._peak(*self._zeros(*parabola, sign=sign), part=0) for sign in (1.0, -1.0))

    @property
    def pace(self) -> float:
        """Largest rate of change of the acceleration over its peak (rad/s); for a harmonic motion this is its angular
        frequency w.
        """
        return float(np.max(np.abs(np.diff(self.acceleration)) / np.diff(self.time))) / self.peak_acceleration

    def at(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Displacement (m), velocity (m/s) and acceleration (m/s2) at any times (s)."""
        t = np.asarray(time, dtype=float) % self.period
        k = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        return self._within(k, t - self.time[k])

    def _within(self, k: NDArray[np.intp], s: Array) -> tuple[Array, Array, Array]:
        """The motion a time s (s) after sample k."""
        x, v, a = self.displacement[k], self.velocity[k], self.acceleration[k]
        jerk = (self.acceleration[k + 1] - a) / (self.time[k + 1] - self.time[k])
        rise = a + s * jerk
        return x + s * (v + s * (a / 2 + s * jerk / 6)), v + s * (a + s * jerk / 2), rise

    def _zeros(self, c: Array, b: Array, a: Array | float, sign: float = 1.0) -> tuple[NDArray[np.intp], Array]:
        """Intervals k and times (s) in them where c + b w + a w^2 passes zero, w from 0 to 1."""
        with np.errstate(all="ignore"):
            root = b + np.copysign(np.sqrt(b * b - 4 * a * c), b)  # the two roots without cancellation
            w = -2 * c / root if sign > 0 else -root / (2 * np.asarray(a))
        k = np.flatnonzero((w > 0) & (w < 1))
        return k, w[k] * np.diff(self.time)[k]

    def _peak(self, k: NDArray[np.intp], s: Array, part: int) -> float:
        ends = np.abs((self.displacement, self.velocity)[part]).max()
        return float(max(ends, np.abs(self._within(k, s)[part]).max(initial=0.0)))


def integrated(time: ArrayLike, acceleration: ArrayLike) -> Record:
    """The motion of one period of a measured ``acceleration`` (k,) m/s2 at ``time`` (k,) s, at any spacing.

    The mean acceleration over the period is taken off, and the constants of both integrations make the means of
    velocity and displacement zero. Raises SceneError for fewer than four samples, more than MAX_SAMPLES, times that do
    not increase, values that are not finite, or an acceleration that does not change.
    """
    t, a = numbers("samples: time", time, "s"), numbers("samples: acceleration", acceleration, "m/s^2")
    if t.ndim != 1 or t.shape != a.shape:
        raise SceneError(f"samples: {t.size} times and {a.size} accelerations; give as many of both")
    if not 4 <= len(t) <= MAX_SAMPLES:
        raise SceneError(f"samples: {len(t)} of them, allowed 4 to {MAX_SAMPLES}")
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(a))):
        raise SceneError("samples: every time and acceleration must be a finite number")
    h = np.diff(t)
    if not np.all(h > 1e-9 * (t[-1] - t[0])):
        raise SceneError(f"samples: times must increase; sample {int(np.argmin(h)) + 1} does not")
    period = t[-1] - t[0]
    most = np.abs(a).max()
    a = a - np.sum(0.5 * (a[1:] + a[:-1]) * h) / period
    if not np.abs(a).max() > 1e-12 * most:
        raise SceneError("samples: the acceleration does not change; a body at rest needs no [vibration]")
    v = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * h)])
    v -= _moved(v, a, h).sum() / period
    x = np.concatenate([[0.0], np.cumsum(_moved(v, a, h))])
    x -= np.sum(h * (x[:-1] + h * (v[:-1] / 2 + h * (3 * a[:-1] + a[1:]) / 24))) / period
    return Record(t - t[0], x, v, a)


def _moved(v: Array, a: Array, h: Array) -> Array:
    """Displacements (m) from sample to sample: the integral of the velocity, which is a parabola."""
    return h * (v[:-1] + h * (2 * a[:-1] + a[1:]) / 6)
