"""Fields made of others: blended, faded into a period, at another speed.

u = (1 - theta) u_s + theta u_m + strength u', with u_s the steady solution, u_m the mean of the one in time and u' its
fluctuation; the pressure likewise. The form is linear, its ends are the two solutions (theta = 0 without fluctuation;
theta = strength = 1), and every air between them keeps its volume, the walls and the inlet, since each of the three
does. k and its dissipation take min(strength, theta) of their fluctuation: what is left is then a mixture of positive
numbers, and stays positive. A wake that is the one for theta of the time and the other for the rest has the variance
theta u'^2 + theta (1 - theta) (u_s - u_m)^2 about the mean that is flown in, and its momentum asks for it; what of that
the flown fluctuation does not bring is added to k, where dispersion takes it from.

No stretch of a turbulent record repeats, so that there is no loop to look for. The first snapshots of the record, the
lead-in, are taken off, and the last ones turn into them over the same time: the field that follows the end, the first
after the lead-in, is then the one that followed it in reality. Fluctuations about the mean over time are added with
weights a and b whose squares have the sum 1, so that their variance is that of the record where the two are
uncorrelated; mean and fluctuations are free of divergence, and so is the sum. What cannot be negative (k and its
dissipation) is weighted by a^2 and b^2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.lazy import cached_property
from .flow import POSITIVE, STEADY, FlowField, nodal
from .modes import MeshOscillation, fit
from .triangles import Triangles

# -- The wake between its two ends -------------------------------------------------------------------------------------
Array = NDArray[np.float64]
MAX_TRIANGLES_TRIED = 8  # triangles tried for a point outside the mesh: those whose centres are nearest
AT_REST, FIXED = 1e-3, 1e-6  # of the fastest air: mean speed at a wall, moving or not; fluctuation where air is given
SAMPLES = 8  # of the swing for each knot of the splines in time: enough that the fit is theirs


@dataclass(frozen=True, eq=False)
class Wakes:
    """The air of one machine with its ``steady`` wake and with the one in time, ``resolved``, for blends of the two."""

    resolved: FlowField
    steady: FlowField

    @cached_property
    def mean(self) -> dict[str, Array]:
        """The time mean of the wake in time by name (N, ..)."""
        weights = self.resolved.time_axis.mean_weights()
        return {name: np.tensordot(weights, values, axes=1) for name, values in nodal(self.resolved).items()}

    @cached_property
    def still(self) -> dict[str, Array]:
        """The steady wake on the nodes of the one in time."""
        beside = interpolated(self.steady, _like(self.steady, nodal(self.resolved)), self.resolved.points)
        return _with_boundary(self.resolved, beside, self.mean["velocity"])

    @cached_property
    def variance(self) -> Array:
        """Variance of the wake in time at its nodes (N,) m2/s2, of both components of the velocity together."""
        field = self.resolved
        velocity = field.at_knots("velocity") if field.has("coefficients") else field.velocity
        weights = field.time_axis.shares()
        result: Array = np.einsum("t,tnj->n", weights, (velocity - self.mean["velocity"]) ** 2)
        return result

    def blended(self, theta: float, strength: float) -> FlowField:
        """The air between the two, see :func:`blended_wake`."""
        for name, number in (("theta", theta), ("strength", strength)):
            if not 0.0 <= number <= 1.0:
                raise SceneError(f"blended_wake: {name} = {number:g}, allowed 0 to 1")
        resolved = self.resolved
        if not resolved.in_time or theta == strength == 1.0:
            return resolved
        data, middle, still = nodal(resolved), self.mean, self.still
        mean: dict[str, Any] = {name: (1.0 - theta) * still[name] + theta * middle[name] for name in data}
        if resolved.has("k"):
            given = self._dropped(theta, strength)
            share = np.divide(given, mean["k"], out=np.zeros_like(given), where=mean["k"] > 0.0)  # k is 0 on walls
            mean |= {name: (1.0 + share) * mean[name] for name in POSITIVE if name in data}
        if strength == 0.0 and not resolved.motion:
            return resolved.with_values(**STEADY, **mean)
        kept = {name: min(strength, theta) if name in POSITIVE else strength for name in data}
        varying: dict[str, Any] = {
            name: mean[name] + kept[name] * (values - middle[name]) for name, values in data.items()
        }
        if resolved.has("coefficients"):  # part 0 is the mean, the others have none
            varying = {n: np.concatenate([mean[n][None], kept[n] * values[1:]]) for n, values in data.items()}
        made = resolved.with_values(**varying)
        return _swinging(made, made.motion, still["velocity"], 1.0 - strength) if made.motion else made

    def _dropped(self, theta: float, strength: float) -> Array:
        """Energy (N,) m2/s2 that the blend's mean motion needs and its fluctuation lacks; no more than what it drops.

        Reynolds' average of a wake that is one of the two at a time, theta of the time the one in time: both means are
        then exact, and so is zero at either end. Eddies are taken to be alike in all directions, as dispersion does.
        """
        apart = theta * (1.0 - theta) * np.sum((self.still["velocity"] - self.mean["velocity"]) ** 2, axis=1)
        most = (1.0 - strength**2) * self.variance
        needed: Array = np.clip((theta - strength**2) * self.variance + apart, 0.0, most)
        return 0.5 * needed


def blended_wake(resolved: FlowField, steady: FlowField, theta: float, strength: float) -> FlowField:
    """The air between ``steady`` and the field in time ``resolved``, on the latter's nodes and functions of time.

    ``theta``: share of the mean of ``resolved`` in the mean; ``strength``: rms of the fluctuation over that of
    ``resolved``; both 0 to 1. ``steady`` may be on another mesh of the same channel. A field that is steady itself
    comes back as it is, and without fluctuation the result is steady. Energy that the blend drops and the mean motion
    needs goes to k, and its dissipation grows in proportion: eddies keep their lifetime. On a mesh that swings with the
    body the steady air swings with it as it would past a slow body: u_s + V (e - u_s / U), V(t) e the velocity of the
    mesh and U the mean air speed, which is V at the body and the given velocity at the inlet.
    Raises SceneError for numbers out of range, and for a ``steady`` field that lacks what ``resolved`` has.
    """
    return Wakes(resolved, steady).blended(theta, strength)


def interpolated(mesh: Triangles, nodal: Mapping[str, Array], points: Array) -> dict[str, Array]:
    """Nodal arrays (N, ..) of ``mesh`` by name, at ``points`` (n, 2) m: linear inside every triangle.

    A point that lies outside, by round-off or beside the corners of a curved wall, takes the nearest value of the
    triangle that it is least outside of.
    """
    from scipy.spatial import cKDTree

    triangle = mesh.locate(points)
    out = np.flatnonzero(triangle < 0)
    if len(out):
        centres = cKDTree(mesh.points[mesh.triangles].mean(axis=1))
        near = centres.query(points[out], k=min(MAX_TRIANGLES_TRIED, len(mesh.triangles)))[1].reshape(len(out), -1)
        spread = np.repeat(points[out], near.shape[1], axis=0)
        least = mesh.barycentric(near.ravel(), spread).min(axis=1).reshape(near.shape)
        triangle[out] = near[np.arange(len(out)), least.argmax(axis=1)]
    weight = np.clip(mesh.barycentric(triangle, points), 0.0, None)
    weight /= weight.sum(axis=1, keepdims=True)
    corner = mesh.triangles[triangle]
    return {name: np.einsum("nk,nk...->n...", weight, values[corner]) for name, values in nodal.items()}


def _like(steady: FlowField, fields: Mapping[str, Array]) -> dict[str, Array]:
    """The nodal arrays of the steady field that a field in time has as well."""
    if steady.in_time:
        raise SceneError("blended_wake: the steady field is one in time")
    given: dict[str, Any] = {
        name: steady.pressure_gradient if name == "given_gradient" else getattr(steady, name) for name in fields
    }
    for name, values in given.items():
        if not values.size:
            raise SceneError(f"blended_wake: the steady field has no {name}, the one in time has")
    return given


def _with_boundary(resolved: FlowField, still: dict[str, Array], mean: Array) -> dict[str, Array]:
    """The steady arrays with the velocity (N, 2) at walls and inlets as it is given there: that of the field in time.

    These are the nodes of the boundary where the mean air rests, or where nothing fluctuates.
    """
    moving = resolved.velocity[1:] if resolved.has("coefficients") else resolved.velocity - mean
    fastest = float(np.linalg.norm(mean, axis=1).max())
    rests = np.linalg.norm(mean, axis=1) < AT_REST * fastest
    given = np.linalg.norm(moving, axis=-1).max(axis=0, initial=0.0) < FIXED * fastest
    fixed = np.zeros(len(mean), dtype=bool)
    fixed[resolved.boundary] = (rests | given)[resolved.boundary]
    return {**still, "velocity": np.where(fixed[:, None], mean, still["velocity"])}


def _swinging(field: FlowField, motion: MeshOscillation, still: Array, share: float) -> FlowField:
    """The ``field`` with ``share`` of what the ``motion`` of its mesh does to the steady air ``still`` (N, 2) m/s."""
    times, period = field.time_axis.times, field.time_axis.period
    along = np.array(motion[:2]) / np.linalg.norm(motion[:2])
    width, height = np.ptp(field.points, axis=0)
    through = float(field.area @ still[field.triangles, 1].mean(axis=1)) / (width * height)  # the same at every height
    pushed = along - still * float(along[1]) / through
    if not field.has("coefficients"):
        speed = motion.velocity(times) @ along
        return field.with_values(velocity=field.velocity + share * speed[:, None, None] * pushed)
    count = len(times)
    times = times[0] + np.arange(SAMPLES * count) * (period / (SAMPLES * count))
    result = fit(times, (motion.velocity(times) @ along)[:, None], period, count)
    more: dict[str, Any] = {
        name: np.concatenate([values, np.zeros_like(values[:1])]) for name, values in nodal(field).items()
    }
    more["velocity"][-1] = share * pushed
    return field.with_values(coefficients=np.hstack([field.coefficients, result - result.mean(axis=0)]), **more)


# -- A record of an irregular wake made periodic -----------------------------------------------------------------------
EVEN = 1e-3  # of the time between snapshots: how far they may be off an even spacing (OpenFOAM rounds times)
SIGNED = ("velocity", "pressure", "given_gradient")


def fade(values: Array, lead: int, *, positive: bool) -> Array:
    """Snapshots (t, ...) less the first ``lead`` of them, into which the last ``lead`` turn; (t - ``lead``, ...)."""
    loop = np.array(values[lead:])
    share = np.arange(1, lead + 1) / (lead + 1)
    a, b = (np.reshape(f(0.5 * np.pi * share), (lead, *[1] * (values.ndim - 1))) for f in (np.cos, np.sin))
    ending, before = values[len(values) - lead :], values[:lead]
    if positive:
        loop[len(loop) - lead :] = a**2 * ending + b**2 * before
    else:
        mean = loop.mean(axis=0)
        loop[len(loop) - lead :] = mean + a * (ending - mean) + b * (before - mean)
    return loop


def cross_faded(field: FlowField, lead: int) -> FlowField:
    """The periodic field of a record of evenly spaced snapshots: its first ``lead`` are faded into.

    Raises SceneError for a field that is not such a record, or has fewer than four times as many snapshots.
    """
    if not field.in_time or field.period or field.has("coefficients"):
        raise SceneError("cross_faded: the field must hold snapshots that do not repeat")
    step = np.diff(field.times)
    if len(field.times) < 4 * lead or lead < 1:
        raise SceneError(f"cross_faded: {len(field.times)} snapshots are too few to fade {lead} of them")
    if np.ptp(step) > EVEN * step.mean():
        raise SceneError("cross_faded: the snapshots are not evenly spaced in time")
    changes: dict[str, Any] = {
        name: fade(values, lead, positive=name in POSITIVE)
        for name in (*SIGNED, *POSITIVE)
        if (values := getattr(field, name)).size
    }
    count, mean = len(field.times) - lead, float(step.mean())
    changes["times"] = mean * np.arange(count)
    return field.with_values(**changes, period=count * mean)


# -- The same airflow at another speed ---------------------------------------------------------------------------------
def varied(
    field: FlowField, speed: float = 1.0, energy: float = 1.0, lifetime: float = 1.0, *, entering: float = math.inf
) -> FlowField:
    """``field`` with the factor ``speed`` on its velocity, ``energy`` on the kinetic energy of its turbulence next to
    that, as far as it is no more than what is ``entering`` (m2/s2): the rest is made by the bodies' wakes. ``lifetime``
    is a factor on that of the eddies k / dissipation next to both.

    By similarity at an unchanged Reynolds number: pressure and k go with the speed's square, dissipation with its cube,
    times with its inverse, so that the Strouhal number stays; a length scale k^3/2 / dissipation stays where the energy
    changes. That the flow itself does not change with its Reynolds number holds for some per cent about the computed
    one. On a mesh that swings with the body the clock stays, which is the vibration's.
    """
    grown = _grown(field, energy, entering)
    factors = {
        "velocity": speed,
        "pressure": speed**2,
        "given_gradient": speed**2,
        "k": grown * speed**2,
        "dissipation": grown**1.5 * speed**3 / lifetime,
    }
    made: dict[str, Any] = {name: factors[name] * values for name, values in nodal(field).items()}
    if field.in_time and not field.motion:
        made |= {"times": field.times / speed, "period": field.period / speed}
    return field.with_values(**made)


def _grown(field: FlowField, energy: float, entering: float) -> Array:
    """The factor (N,) on k, the same at all times: ``energy`` on as much of its mean as is ``entering`` (m2/s2)."""
    if not field.has("k"):
        return np.asarray(energy)
    steady = field.k.ndim == 1
    mean = field.k if steady else field.k[0] if field.has("coefficients") else field.k.mean(axis=0)
    brought = np.divide(entering, mean, out=np.full_like(mean, np.inf), where=mean > 0.0)
    return np.asarray(1.0 + (energy - 1.0) * np.minimum(1.0, brought))
