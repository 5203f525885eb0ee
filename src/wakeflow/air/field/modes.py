"""A field in time: what it is made of at each time, how its mesh moves, a repeating one as its mean and the modes that
matter, with functions of time that are smooth.

f(t) = sum over j of c_j B((t - t_0) / h - j), B the centred cubic B-spline (de Boor 2001, A Practical Guide to Splines,
ch. IX), h the period over the number of knots: twice continuously differentiable, fourth-order accurate in h, and at
any time made of four coefficients only.

Proper orthogonal decomposition by the method of snapshots (Sirovich 1987, Q. Appl. Math. 45, 561) of velocity and
pressure together, each weighted by the area a node represents and scaled to unit energy; k and dissipation are
projected on the same functions of time (extended modes: Boree 2003, Exp. Fluids 35, 188). What is cut off is measured
on the snapshots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import SceneError
from ...core.record import column

# -- Functions of time that repeat -------------------------------------------------------------------------------------
Array = NDArray[np.float64]
Index = NDArray[np.int64]
# coefficients of 1, w, w^2, w^3 in an interval between knots, of the four spline coefficients around it
POWERS = np.array([(1, 4, 1, 0), (-3, 0, 3, 0), (3, -6, 3, 0), (-1, 3, -3, 1)]) / 6.0


def around(t: ArrayLike, start: float, period: float, knots: int) -> tuple[Index, Array]:
    """The four coefficients that make f at times ``t`` (..,) s: their indices (.., 4) and weights (.., 4)."""
    place = (np.asarray(t, dtype=float) - start) * (knots / period)
    first = np.floor(place)
    weight = np.asarray((place - first)[..., None] ** np.arange(4) @ POWERS, dtype=np.float64)
    index = (first[..., None].astype(np.int64) + np.arange(-1, 3)) % knots
    return index, weight


def design(t: Array, start: float, period: float, knots: int) -> Array:
    """Matrix (T, knots) from coefficients to values at times ``t`` (T,)."""
    index, weight = around(t, start, period, knots)
    matrix = np.zeros((len(t), knots))
    np.add.at(matrix, (np.arange(len(t))[:, None], index), weight)
    return matrix


def fit(t: Array, values: Array, period: float, knots: int) -> Array:
    """Coefficients (knots, K) of the least-squares splines through ``values`` (T, K) at times ``t``; knots begin at
    t[0].
    """
    result = np.linalg.lstsq(design(t, float(t[0]), period, knots), values, rcond=1e-10)[0]
    return np.asarray(result, dtype=np.float64)


# -- A field's functions of time ---------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class TimeAxis:
    """``times`` (T,) s, the ``period`` (s) after which they repeat, and the ``coefficients`` (T, R) of the parts'
    splines; as in :class:`wakeflow.air.field.FlowField`: without times a steady field, of an infinite period what does
    not repeat, without coefficients snapshots.
    """

    times: Array
    period: float
    coefficients: Array

    @property
    def repeats(self) -> bool:
        """Whether the times come again."""
        return self.period < np.inf

    def shares(self) -> Array:
        """The part of the time that each snapshot represents (T,): trapezoidal rule, round the period if there is
        one.
        """
        times, step = self.times, np.diff(self.times)
        share = np.zeros(len(times))
        share[:-1] += step / 2
        share[1:] += step / 2
        if self.repeats:
            gap = times[0] + self.period - times[-1]
            share[0] += gap / 2
            share[-1] += gap / 2
        return share / share.sum() if share.sum() > 0 else np.full(len(share), 1.0 / len(share))

    def around(self, t: float) -> tuple[int, int, float]:
        """Indices of the two snapshots around time ``t`` (s) and the weight of the second."""
        times, last = self.times, len(self.times) - 1
        if self.repeats:
            t = times[0] + (t - times[0]) % self.period
            gap = times[0] + self.period - times[last]
            if t >= times[last] and gap > 0:
                return last, 0, float((t - times[last]) / gap)
        i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(last - 1, 0)))
        j = min(i + 1, last)
        return i, j, float(np.clip((t - times[i]) / (times[j] - times[i]), 0.0, 1.0)) if j > i else 0.0

    def weights(self, t: float) -> Array:
        """The weight of each snapshot or part (R,) at time ``t`` (s); a lone 1 when steady."""
        if not len(self.times):
            return np.ones(1)
        if self.coefficients.size:
            index, share = around(t, float(self.times[0]), self.period, len(self.times))
            return np.asarray(share @ self.coefficients[index])
        i, j, w = self.around(t)
        weight = np.zeros(len(self.times))
        weight[i] += 1.0 - w
        weight[j] += w
        return weight

    def polynomial(self, t: float) -> tuple[float, float, Array]:
        """The piece of time from ``t`` (s) on in which a field is a polynomial, as of ``FlowField.polynomial``."""
        if not len(self.times):
            return t, np.inf, np.ones((1, 1))
        if self.coefficients.size:
            step = self.period / len(self.times)
            first = np.floor((t - self.times[0]) / step)
            near = (int(first) + np.arange(-1, 3)) % len(self.times)
            shares = POWERS @ self.coefficients[near] / step ** np.arange(4)[:, None]
            return float(self.times[0] + first * step), float(self.times[0] + (first + 1) * step), shares
        i, j, w = self.around(t)
        rise = np.zeros(len(self.times))
        if i == j:
            return t, np.inf, np.stack([self.weights(t), rise])
        step = self.times[j] - self.times[i] + (0.0 if j > i else self.period)
        rise[i], rise[j] = -1.0 / step, 1.0 / step
        return t, t + (1.0 - w) * float(step), np.stack([self.weights(t), rise])

    def mean_weights(self) -> Array:
        """The time mean of each snapshot's or part's weight (R,); for a field in time."""
        return self.coefficients.mean(axis=0) if self.coefficients.size else self.shares()


# -- The motion of a field's whole mesh --------------------------------------------------------------------------------
WHOLE = 0.01  # vibrations by which a moving field's period may miss a whole number of them. Chosen: 4 degrees of phase


class MeshOscillation(NamedTuple):
    """Harmonic motion of the whole mesh: displacement (x, y) sin(omega t + phase); m, rad/s, rad."""

    x: float
    y: float
    omega: float
    phase: float = 0.0

    def __bool__(self) -> bool:
        """Whether it moves."""
        return self.omega > 0.0

    def displacement(self, t: ArrayLike) -> Array:
        """Where the mesh is (.., 2) m at times ``t`` (..,) s, from where its points say."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.sin(angle)[..., None] * np.array([self.x, self.y]))

    def velocity(self, t: ArrayLike) -> Array:
        """How fast the mesh moves (.., 2) m/s."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.cos(angle)[..., None] * np.array([self.x, self.y]) * self.omega)

    def check(self, in_time: bool, period: float) -> None:
        """Raise SceneError for numbers that are not finite, and for a field in time (``in_time``) whose ``period`` (s)
        is not a whole number of swings.
        """
        if not (np.all(np.isfinite(self)) and self.omega > 0):
            raise SceneError(f"motion: amplitude, omega and phase {tuple(self)} must be finite, and omega positive")
        if in_time:
            turns = period * self.omega / (2 * np.pi)
            if not abs(turns - np.round(turns)) <= WHOLE:
                raise SceneError(f"motion: the field repeats after {turns:.4g} swings of its mesh, not a whole number")


AT_REST = MeshOscillation(0.0, 0.0, 0.0)

# -- A repeating field as its mean and the modes that matter -----------------------------------------------------------
TINY = 1e-13  # of the mean square: a fluctuation below it is round-off
MIN_KNOTS = 8  # of a period, for splines and snapshots alike; chosen: below, a mode's function of time is a guess


@dataclass(frozen=True)
class Truncation:
    """What a time-resolved field lost when it was stored as a mean and modes; zero for what the field has not."""

    modes: int = column("1", "modes kept")
    knots: int = column("1", "knots of the splines in time")
    snapshots: int = column("1", "snapshots of the loop that was stored")
    velocity: float = column("1", "velocity cut off: rms over the rms of its fluctuation")
    velocity_max: float = column("1", "largest velocity cut off, over the rms speed of the field")
    pressure: float = column("1", "pressure cut off: rms over the rms of its fluctuation")
    k: float = column("1", "turbulent kinetic energy cut off: rms over its rms")
    dissipation: float = column("1", "dissipation of that cut off: rms over its rms")

    def __bool__(self) -> bool:
        """Whether it was stored so, :data:`KEPT_WHOLE` being one that was not."""
        return self.snapshots > 0

    @classmethod
    def from_array(cls, values: Array) -> Truncation:
        """The record from its numbers in order, as a file holds them."""
        modes, knots, snapshots, *lost = values.ravel().tolist()
        return cls(int(modes), int(knots), int(snapshots), *lost)


KEPT_WHOLE = Truncation(0, 0, 0, *[0.0] * 5)


def compress(
    axis: TimeAxis,
    nodal: Mapping[str, Array],
    node_area: Array,
    *,
    error: float,
    knots: Sequence[int],
) -> tuple[dict[str, Array], Array, Truncation]:
    """Nodal parts (R, N, ..) by name, spline coefficients (M, R) of their functions of time, and what was lost.

    ``axis``: of T snapshots over a period; ``nodal``: arrays (T, N, ..) by name, velocity and pressure among them;
    ``node_area`` (N,): share of the area that each node represents. Part 0 is the mean over time.
    As few modes and, of the numbers ``knots``, as few knots as keep the rms error of velocity and pressure below
    ``error`` times the rms of their fluctuations; the last number where none does. Raises SceneError without a period,
    with fewer than MIN_KNOTS snapshots, and for ``error`` or ``knots`` out of range.
    """
    times, period = axis.times, axis.period
    if not axis.repeats or len(times) < MIN_KNOTS:
        raise SceneError(f"compressed: needs at least {MIN_KNOTS} snapshots over a whole period")
    if not 0 < error < 1:
        raise SceneError(f"compressed: error = {error:g}, allowed above 0 and below 1")
    if not MIN_KNOTS <= knots[0] <= len(times):
        raise SceneError(f"compressed: knots = {knots[0]}, allowed {MIN_KNOTS} to {len(times)}, the snapshots")
    share, area = axis.shares(), node_area
    mean = {name: np.tensordot(share, values, axes=1) for name, values in nodal.items()}
    grams = [_gram(nodal[n] - mean[n], mean[n], share, area) for n in ("velocity", "pressure") if n in nodal]
    history = _temporal(grams, share, 0.5 * error**2)
    coefficients = _smooth(times, period, history, share, grams, 0.5 * error**2, knots)
    modes = {n: np.tensordot((share[:, None] * history).T, values, axes=1) for n, values in nodal.items()}
    lean = coefficients.mean(axis=0)  # part 0 is the mean of the whole, to round-off
    parts = {n: np.concatenate([(mean[n] + np.tensordot(lean, m, axes=1))[None], m]) for n, m in modes.items()}
    parts = {n: values.astype(np.float32).astype(np.float64) for n, values in parts.items()}
    coefficients = np.concatenate([np.ones((len(coefficients), 1)), coefficients - lean], axis=1)
    drawn = design(times, float(times[0]), period, len(coefficients)) @ coefficients
    return parts, coefficients, _measured(nodal, mean, parts, drawn, share, area)


def _square(values: Array, area: Array) -> Array:
    """Area mean of the square of nodal values (.., N) or (.., N, 2)."""
    square = values**2 if values.shape[-1] == len(area) else (values**2).sum(axis=-1)
    return np.asarray(square @ area, dtype=np.float64)


def _gram(deviation: Array, mean: Array, share: Array, area: Array) -> Array:
    """Correlations (T, T) between snapshots, of trace 1; zero where nothing fluctuates."""
    weight = np.sqrt(share)[:, None] * np.sqrt(area)
    rows = deviation * (weight if deviation.ndim == 2 else weight[..., None])
    flat = rows.reshape(len(share), -1)
    gram = flat @ flat.T
    energy = float(np.trace(gram))
    return np.asarray(gram / energy if energy > TINY * float(_square(mean, area)) else 0.0 * gram)


def _temporal(grams: list[Array], share: Array, lost: float) -> Array:
    """Orthonormal functions of time (T, K), as few as leave no more than ``lost`` of any energy out."""
    vectors = np.linalg.eigh(np.sum(grams, axis=0))[1][:, ::-1]
    kept = [np.cumsum(np.einsum("ik,ij,jk->k", vectors, gram, vectors)) for gram in grams if np.trace(gram) > 0]
    count = max((int(np.argmax(energy >= energy[-1] - lost)) + 1 for energy in kept), default=0)
    return np.asarray(vectors[:, :count] / np.sqrt(share)[:, None])


def _smooth(
    times: Array, period: float, motion: Array, share: Array, grams: list[Array], lost: float, knots: Sequence[int]
) -> Array:
    """Spline coefficients (M, K) on the first of ``knots`` knots that lose no more than ``lost`` of any energy at the
    snapshots.
    """
    rows = np.sqrt(share)[:, None]
    energy = [(rows * motion).T @ gram @ (rows * motion) for gram in grams]
    for count in knots:
        result = fit(times, motion, period, count)
        left = rows * (design(times, float(times[0]), period, count) @ result - motion)
        if all(float(np.sum((left.T @ left) * e)) <= lost for e in energy):
            break
    return result


def _measured(
    nodal: Mapping[str, Array], mean: dict[str, Array], parts: dict[str, Array], drawn: Array, share: Array, area: Array
) -> Truncation:
    lost, whole, worst = dict.fromkeys(nodal, 0.0), dict.fromkeys(nodal, 0.0), 0.0
    speed = np.sqrt(share @ _square(nodal["velocity"], area)) or 1.0
    for i, part in enumerate(share):
        for name, values in nodal.items():
            off = np.tensordot(drawn[i], parts[name], axes=1) - values[i]
            lost[name] += part * float(_square(off, area))
            base = mean[name] if name in ("velocity", "pressure") else 0.0
            whole[name] += part * float(_square(values[i] - base, area))
            if name == "velocity":
                worst = max(worst, float(np.sqrt((off**2).sum(axis=1)).max()) / float(speed))
    error = {n: float(np.sqrt(lost[n] / whole[n])) if whole[n] > 0 else 0.0 for n in nodal}
    count = drawn.shape[1] - 1
    rest = (error.get(n, 0.0) for n in ("pressure", "k", "dissipation"))
    return Truncation(count, 0, len(share), error["velocity"], worst, *rest)
