"""Near-wake residence time: how long a body's near wake keeps the fine dust that is in it.

Fine dust fills the near wake, its source stops, and the concentration there falls as exp(-t / tau). H = tau U / D is
what Gomes, M.S.P., Vincent, J.H. & Pui, D.Y.H. 1999, Atmos. Environ. 33, 4459 measured behind flat plates. Here the
dust is tracers that start uniformly in the near wake and are counted in it while they leave.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from wakeflow.air.field import AT_REST, FlowField
from wakeflow.core.errors import SceneError
from wakeflow.flight import Body, Fate, Granules, Tracks, track

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
COUNT = 2048  # tracers: an interval of some 12 % in the steady wake of the shipped scene, in 2 s of one core
FIRST, LAST = 0.50, 0.03  # of the tracers left: the decay is fitted between them
LONGEST = 256.0  # D / U that tracers are followed for; an exponential of H = 73 has come to LAST by then
STEP = 0.05  # D / U from one count to the next
STOKES = 3e-4  # tau_p U / D of a tracer: the air's own path to some 1e-3 D, and no stiffer than needed
DENSITY = 1000.0  # kg/m3 of a tracer; with STOKES it gives the diameter, nothing else
TOLERANCE = 1e-2  # of D, where a tracer ends: ten times as fine changes H by less than 1 %
POINTS = 512  # kept of a path, between which it is straight
BATCHES = 16  # of tracers, left out one after the other for the interval
MIN_BATCHES = 4  # batches that an interval is made of
TRIES = 64  # draws for each tracer before the near wake counts as no part of the mesh


@dataclass(frozen=True)
class ResidenceTime:
    """``value`` H = tau U / D and its 95 % interval ``low`` to ``high``; ``tau`` s; ``samples`` tracers.

    ``left``: share of them in the near wake at the end, 256 D / U after their start. Where it is more than 3 % the
    wake is ``closed``: value, high and tau are inf, and low is what an exponential decay would have at least.
    """

    value: float
    low: float
    high: float
    tau: float
    left: float
    samples: int

    @property
    def closed(self) -> bool:
        """Whether the near wake keeps tracers for longer than they were followed."""
        return math.isinf(self.value)


@dataclass(frozen=True)
class _NearWake:
    """The box in which tracers start and are counted: as wide as the body, from its widest place to a width behind."""

    middle: float  # m
    width: float  # m
    begin: float  # m along the air
    end: float  # m along the air
    sign: float  # of y along the air

    def holds(self, x: Array, y: Array) -> Mask:
        """Whether points lie in the box; those in the body too."""
        along = self.sign * y
        return (np.abs(x - self.middle) < self.width / 2) & (along > self.begin) & (along < self.end)


def residence_time(
    field: FlowField | Sequence[FlowField],
    outline: ArrayLike,
    direction: Literal["down", "up"],
    speed: float,
    *,
    count: int = COUNT,
    sheddings: int = 1,
    seed: int = 0,
    stokes: float = STOKES,
) -> ResidenceTime:
    """How long the near wake behind ``outline`` (k, 2) m keeps fine dust, in air that flows ``direction`` at ``speed``
    (m/s) far from the body. ``stokes``: tau_p U / D of dust by Stokes' law, for dust that is not fine.

    ``count`` tracers start uniformly in the box |x - middle| < D / 2, from the body's widest place to one width D
    behind its rear, as fast as the air there, and follow that of ``field`` with drag, and with dispersion where it has
    k and dissipation; no gravity. tau is the decay time of their number in the box, by least squares of its logarithm
    between 50 and 3 % left; the interval is a jackknife over batches. In a field that repeats they start evenly over
    its period, which holds ``sheddings``: these are the batches where there are four of them or more. Several fields,
    realisations of one flow, share the tracers in equal parts, and are the batches from four on. A field of snapshots
    without a period takes tracers in its first half, and stands still after its last. A mesh that swings stays in its
    middle position.
    Raises SceneError where the near wake lies outside the mesh or an argument is out of range.
    """
    fields = [field] if isinstance(field, FlowField) else list(field)
    if count < MIN_BATCHES * max(len(fields), 1) or not fields or sheddings < 1:
        raise SceneError(f"residence_time: {count} tracers, {len(fields)} fields, {sheddings} sheddings: too few")
    for name, number in (("speed", speed), ("stokes", stokes)):
        if not (math.isfinite(number) and number > 0):
            raise SceneError(f"residence_time: {name} = {number:g} must be positive and finite")
    body = Body(np.asarray(outline, dtype=float))
    wake = _near_wake(body, direction)
    each = -(-count // len(fields))
    found = [
        _counted(replace(air, motion=AT_REST), body, wake, speed, each, np.random.default_rng([seed, number]), stokes)
        for number, air in enumerate(fields)
    ]
    inside = np.concatenate(found)
    batch = _batches(len(fields), each, sheddings, timed=fields[0].in_time)
    return _fitted(inside, batch, wake.width / speed)


def _near_wake(body: Body, direction: Literal["down", "up"]) -> _NearWake:
    """The box behind a body: from the later of its widest places on the side where that comes first."""
    sign = 1.0 if direction == "up" else -1.0
    x, along = body.outline[:, 0], sign * body.outline[:, 1]
    width = float(np.ptp(x))
    widest = min(float(along[np.abs(x - side) <= 1e-9 * width].max()) for side in (x.min(), x.max()))
    return _NearWake(float(x.min() + x.max()) / 2, width, widest, float(along.max()) + width, sign)


def _counted(
    field: FlowField, body: Body, wake: _NearWake, speed: float, count: int, rng: np.random.Generator, stokes: float
) -> Mask:
    """Whether each tracer is in the near wake (count, times) at times STEP D / U apart since its start."""
    unit = wake.width / speed
    start = _births(field, count, rng)
    diameter = math.sqrt(18.0 * field.viscosity * stokes * unit / DENSITY)
    places = _places(field, wake, count, rng)
    tracers = Granules(
        position=places, velocity=_of_the_air(field, places, start), diameter=diameter, density=DENSITY,
        drag_scale=1.0, restitution=1.0, friction=0.0, time=start,
    )  # fmt: skip
    turbulent = field.has("k") and field.has("dissipation")
    tracks = track(
        field, tracers, until=float(start.max()) + LONGEST * unit, tolerance=TOLERANCE, length=wake.width,
        forces=("drag", "dispersion") if turbulent else ("drag",), bodies=[body], record=POINTS,
        seed=int(rng.integers(2**62)),
    )  # fmt: skip
    return _in_wake(tracks, start, wake, np.arange(0.0, LONGEST, STEP) * unit)


def _of_the_air(field: FlowField, places: Array, times: Array) -> Array:
    """The air's velocity (n, 2) m/s at ``places`` (n, 2) m and ``times`` (n,) s."""
    triangle = field.locate(places)
    corner, weight = field.triangles[triangle], field.barycentric(triangle, places)
    nodal = field.velocity if field.in_time else field.velocity[None]
    shares = np.stack([field.weights(float(time)) for time in times])
    return np.asarray(np.einsum("nr,rnkj,nk->nj", shares, nodal[:, corner], weight))


def _births(field: FlowField, count: int, rng: np.random.Generator) -> Array:
    """When tracers start (count,) s: in order, evenly over the period, or over the first half of what is known."""
    if not field.in_time:
        return np.zeros(count)
    span = field.period or float(np.ptp(field.times)) / 2
    return np.asarray(field.times[0] + span * (np.arange(count) + rng.random(count)) / count)


def _places(field: FlowField, wake: _NearWake, count: int, rng: np.random.Generator) -> Array:
    """Points (count, 2) m of the mesh, uniform in the near wake."""
    drawn = np.zeros((0, 2))
    for _ in range(TRIES):
        across, along = rng.random((2, count))
        x = wake.middle + wake.width * (across - 0.5)
        points = np.stack([x, wake.sign * (wake.begin + (wake.end - wake.begin) * along)], axis=1)
        drawn = np.concatenate([drawn, points[field.locate(points) >= 0]])
        if len(drawn) >= count:
            return drawn[:count]
    raise SceneError(f"residence_time: the near wake, to y = {wake.sign * wake.end:g} m, lies outside the mesh")


def _in_wake(tracks: Tracks, start: Array, wake: _NearWake, since: Array) -> Mask:
    """Whether each tracer is in the near wake (n, times) at times ``since`` (times,) s its start."""
    inside = np.zeros((len(tracks), len(since)), dtype=bool)
    gone = (Fate.BINNED, Fate.ESCAPED)
    for i in range(len(tracks)):
        time, place, _ = tracks.path(i)
        known = since <= time[-1] - start[i] if tracks.fate[i] in gone else np.ones(len(since), dtype=bool)
        clock = start[i] + since[known]
        inside[i, known] = wake.holds(np.interp(clock, time, place[:, 0]), np.interp(clock, time, place[:, 1]))
    return inside


def _batches(fields: int, each: int, sheddings: int, *, timed: bool) -> NDArray[np.int64]:
    """The batch that each tracer belongs to (n,): its realisation, or its shedding, else every sixteenth one."""
    if fields >= MIN_BATCHES:
        return np.repeat(np.arange(fields), each)
    place = np.tile(np.arange(each), fields)
    return place * sheddings // each if timed and sheddings >= MIN_BATCHES else place % min(BATCHES, each)


def _fitted(inside: Mask, batch: NDArray[np.int64], unit: float) -> ResidenceTime:
    """The decay time from ``inside`` (n, times) and its jackknife interval; ``unit`` = D / U in s."""
    left = np.array([inside[batch == number].sum(axis=0) for number in np.unique(batch)])
    sizes = np.unique(batch, return_counts=True)[1]
    whole, last, samples = left.sum(axis=0), float(inside[:, -1].mean()), len(inside)
    value = math.inf if last > LAST else _decay(whole / samples)
    if math.isinf(value):
        return ResidenceTime(np.inf, LONGEST / math.log(1 / LAST), np.inf, np.inf, last, samples)
    without = np.array([_decay((whole - one) / (samples - size)) for one, size in zip(left, sizes, strict=True)])
    count = len(without)
    half = float(student.ppf(0.975, count - 1) * math.sqrt((count - 1) ** 2 / count * np.var(without, ddof=1)))
    return ResidenceTime(value, max(value - half, 0.0), value + half, value * unit, last, samples)


def _decay(share: Array) -> float:
    """Decay time in D / U of the ``share`` (times,) left, which has come to LAST."""
    time = STEP * np.arange(len(share))
    fitted = slice(*(int(np.argmax(share <= bound)) for bound in (FIRST, LAST)))
    if fitted.stop - fitted.start < 3:  # gone within some counts: what is certain is that it is no slower
        return STEP
    return float(-1.0 / np.polyfit(time[fitted], np.log(share[fitted]), 1)[0])
