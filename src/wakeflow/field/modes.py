"""A repeating field as its mean and the modes that matter, with functions of time that are smooth.

Proper orthogonal decomposition by the method of snapshots (Sirovich 1987, Q. Appl. Math. 45, 561) of velocity and
pressure together, each weighted by the area a node stands for and scaled to unit energy; k and dissipation are
projected on the same functions of time (extended modes: Boree 2003, Exp. Fluids 35, 188). What is cut off is measured
on the snapshots.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.record import column
from .splines import design, fit
from .time_axis import time_shares

__all__ = ["Truncation", "compress"]

Array = NDArray[np.float64]
TINY = 1e-13  # of the mean square: a fluctuation below it is round-off
FEWEST_KNOTS = 8  # of a period, for splines and snapshots alike; chosen: below, a mode's function of time is a guess


@dataclass(frozen=True)
class Truncation:
    """What a time-resolved field lost when it was stored as a mean and modes; zero for what the field has not."""

    modes: int = column("1", "modes kept")
    knots: int = column("1", "knots of the splines in time")
    snapshots: int = column("1", "of the loop that was stored")
    velocity: float = column("1", "velocity cut off: rms over the rms of its fluctuation")
    velocity_max: float = column("1", "largest velocity cut off, over the rms speed of the field")
    pressure: float = column("1", "pressure cut off: rms over the rms of its fluctuation")
    k: float = column("1", "turbulent kinetic energy cut off: rms over its rms")
    dissipation: float = column("1", "its dissipation cut off: rms over its rms")

    @classmethod
    def from_array(cls, values: Array) -> Truncation:
        """The record from its numbers in order, as a file holds them."""
        modes, knots, snapshots, *lost = values.ravel().tolist()
        return cls(int(modes), int(knots), int(snapshots), *lost)


def compress(
    times: Array | None,
    period: float | None,
    nodal: Mapping[str, Array],
    node_area: Array,
    *,
    error: float,
    knots: int | None = None,
) -> tuple[dict[str, Array], Array, Truncation]:
    """Nodal parts (R, N, ..) by name, spline coefficients (M, R) of their functions of time, and what was lost.

    ``times`` (T,) s of the snapshots over the ``period`` (s); ``nodal``: arrays (T, N, ..) by name, velocity and
    pressure among them; ``node_area`` (N,): share of the area that each node stands for. Part 0 is the mean over time.
    As few modes and, unless ``knots`` says how many, as few knots as keep the rms error of velocity and pressure below
    ``error`` times the rms of their fluctuations. Raises SceneError without a period, with fewer than FEWEST_KNOTS
    snapshots, and for ``error`` or ``knots`` out of range.
    """
    if times is None or period is None or len(times) < FEWEST_KNOTS:
        raise SceneError(f"compressed: needs at least {FEWEST_KNOTS} snapshots over a whole period")
    if not 0 < error < 1:
        raise SceneError(f"compressed: error = {error:g}, allowed above 0 and below 1")
    if knots is not None and not FEWEST_KNOTS <= knots <= len(times):
        raise SceneError(f"compressed: knots = {knots}, allowed {FEWEST_KNOTS} to {len(times)}, the snapshots")
    share, area = time_shares(times, period), node_area
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
    times: Array, period: float, motion: Array, share: Array, grams: list[Array], lost: float, knots: int | None
) -> Array:
    """Spline coefficients (M, K) on as few knots as lose no more than ``lost`` of any energy at the snapshots."""
    rows = np.sqrt(share)[:, None]
    energy = [(rows * motion).T @ gram @ (rows * motion) for gram in grams]
    for count in range(FEWEST_KNOTS, len(times) + 1) if knots is None else [knots]:
        found = fit(times, motion, period, count)
        left = rows * (design(times, float(times[0]), period, count) @ found - motion)
        if all(float(np.sum((left.T @ left) * e)) <= lost for e in energy):
            break
    return found


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
