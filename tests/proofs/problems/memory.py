"""Exact problems of the history force: drag's memory of past slip.

Three truths, each of its own: the linear equation of a sphere with its memories, whose solution is the exponential of a
matrix; Basset's own kernel in creeping flow, where the velocity is known in error functions; and Mei & Adrian's kernel
at finite Reynolds number, taken without any memories, by product integration over all of the past.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofs.problems.ensembles import number
from proofs.problems.exact import DENSITY, VISCOSITY, Answer, G, Setting, box, field_on, problem
from support import without_slip
from wakeflow.core.lazy import cached_property
from wakeflow.flight import Body, Granules, track
from wakeflow.laws.drag import drag_laws, terminal_velocity
from wakeflow.laws.forces.history_force import MEMORIES, history_time, memories_of

Array = NDArray[np.float64]
KINEMATIC = VISCOSITY / DENSITY
WITH_MEMORY = ("drag", "gravity", "buoyancy", "added-mass", "basset-history")
HINSBERG = (
    "van Hinsberg, ten Thije Boonkkamp & Clercx 2011, J. Comput. Phys. 230, 1465; Parmar et al. 2018, J. Fluid Mech. "
    "844, 970"
)


# -- the memories themselves -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Line:
    """One component of a flight with Stokes drag in air of the velocity ``strain`` (1/s) times x, under a ``pull``
    (m/s2): linear in place, velocity and lags.
    """

    tau: float  # s
    ratio: float  # density of the air over the granule's
    times: Array  # s, of the memories
    weights: Array  # 1/s
    strain: float
    pull: float

    @cached_property
    def rates(self) -> Array:
        """The matrix of the equation of (x, v, lags .., 1)."""
        count = len(self.times)
        slip = np.array([self.strain, -1.0, *np.zeros(count), 0.0])  # of the unknowns
        rates = np.zeros((count + 3, count + 3))
        rates[0, 1] = 1.0
        rates[1] = (1.0 / self.tau + self.weights.sum()) * slip
        rates[1, 2:-1] -= self.weights
        rates[1, [0, -1]] += 0.5 * self.ratio * self.strain**2, self.pull
        rates[1] /= 1.0 + 0.5 * self.ratio
        rates[2:-1] = slip / self.times[:, None]
        rates[2:-1, 2:-1] -= np.diag(1.0 / self.times)
        return rates

    def begin(self, x: float, v: float, came: float) -> Array:
        """The unknowns of a granule that came with the velocity ``came`` and leaves with v."""
        return np.array([x, v, *np.full(len(self.times), self.strain * x - came), 1.0])

    def after(self, time: float, state: Array) -> Array:
        """The unknowns a ``time`` (s) later."""
        from scipy.linalg import expm

        return np.asarray(expm(time * self.rates) @ state)


def _lines(grains: Granules, strain: tuple[float, float]) -> Iterator[tuple[_Line, _Line]]:
    """Both components of each granule's flight."""
    own, weights = memories_of(grains.diameter, grains.density, grains.drag_scale, DENSITY, VISCOSITY)
    for d, density, time, weight in zip(grains.diameter, grains.density, own, weights, strict=True):
        tau, ratio = density * d * d / (18 * VISCOSITY), DENSITY / density
        pulls = (0.0, -G * (1.0 - ratio))
        yield tuple(_Line(tau, ratio, time * MEMORIES, weight, a, pull) for a, pull in zip(strain, pulls, strict=True))  # type: ignore[misc]


def _heavy_and_light(start: tuple[float, float]) -> Granules:
    tau, ratio = np.array([5e-3, 0.02, 0.05, 0.1, 0.1]), np.array([1e-3, 1e-2, 0.2, 0.5, 2.0])
    places, speed, came = (np.tile(pair, (len(tau), 1)) for pair in (start, (0.8, -0.3), (0.2, -0.9)))
    density = DENSITY / ratio
    return without_slip(places, speed, np.sqrt(18 * VISCOSITY * tau / density), density, arrival=came)


def _linear(cells: int, strain: tuple[float, float], start: tuple[float, float]) -> tuple[Setting, Answer]:
    mesh, t, grains = box(cells), 0.1, _heavy_and_light(start)
    ends = []
    for i, lines in enumerate(_lines(grains, strain)):
        begun = zip(lines, grains.position[i], grains.velocity[i], grains.arrival[i], strict=True)
        ends.append([line.after(t, line.begin(*how))[:2] for line, *how in begun])
    setting = Setting(field_on(mesh, mesh[0] * strain), grains, t, {"forces": WITH_MEMORY, "drag": "stokes"})
    return setting, Answer(np.array(ends)[..., 0], np.array(ends)[..., 1])


@problem(
    "remembered-settling", "still air, a blow at birth: Stokes drag, added mass and seven memories, a linear equation",
    HINSBERG, "affine drag gravity buoyancy added-mass basset-history", cells=2,
)  # fmt: skip
def remembered_settling(cells: int) -> tuple[Setting, Answer]:
    """Granules struck at birth that settle in air at rest."""
    return _linear(cells, (0.0, 0.0), (-0.2, 0.3))


@problem(
    "remembered-strain", "the same in plane strain: the air's velocity changes along the way",
    HINSBERG, "affine drag gravity buoyancy added-mass basset-history",
)  # fmt: skip
def remembered_strain(cells: int) -> tuple[Setting, Answer]:
    """The same granules in plane strain of 4 1/s."""
    return _linear(cells, (4.0, -4.0), (0.1, 0.5))


@problem(
    "remembered-bounce", "a bounce on a floor in still air: the slip jumps, the memories do not",
    HINSBERG, "affine walls drag gravity buoyancy added-mass basset-history", cells=4,
)  # fmt: skip
def remembered_bounce(cells: int) -> tuple[Setting, Answer]:
    """Three granules that bounce once on a floor: the memories of before the bounce act after it."""
    from scipy.optimize import brentq

    floor, t = -0.5, 0.3
    start, speed = np.tile([-0.3, -0.2], (3, 1)), np.array([[1.0, -3.0], [0.5, -2.0], [0.5, -3.0]])
    grains = without_slip(start, speed, np.array([4e-3, 1e-3, 8e-3]), np.array([200.0, 60.0, 20.0]), friction=0.0)
    ends = []
    for i, (across, down) in enumerate(_lines(grains, (0.0, 0.0))):
        (x, y), (v, w), radius = grains.position[i], grains.velocity[i], 0.5 * grains.diameter[i]
        one = down.begin(y, w, w)
        met = brentq(lambda s, down=down, one=one, low=floor + radius: down.after(s, one)[0] - low, 0.0, t, xtol=1e-15)
        hit = down.after(met, one)
        hit[1] *= -grains.restitution[i]
        ends.append([across.after(t, across.begin(x, v, v))[:2], down.after(t - met, hit)[:2]])
    wall = Body(np.array([[1.0, floor], [-1.0, floor]]), open=True)  # solid below
    how = {"forces": WITH_MEMORY, "drag": "stokes", "bodies": (wall,), "length": 1.0}
    setting = Setting(field_on(box(cells), np.zeros_like), grains, t, how)
    return setting, Answer(np.array(ends)[..., 0], np.array(ends)[..., 1])


# -- the kernels that they stand for -----------------------------------------------------------------------------------

CREEPING = np.array([0.1, 1.0, 10.0, 100.0])  # drag times
LIGHT = 0.2  # density of the air over the granule's


def _creeping(time: Array, ratio: float) -> Array:
    """Velocity over the terminal one, ``time`` (drag times) after a start from rest, with Basset's kernel: with x^2 for
    1/t in Laplace's sense, the roots of (1 + ratio / 2) x^2 + sqrt(9 ratio / 2) x + 1.
    """
    from scipy.special import wofz

    one, other = np.roots([1.0 + 0.5 * ratio, np.sqrt(4.5 * ratio), 1.0]).astype(complex)
    root = np.sqrt(time)
    parts = other * wofz(-1j * one * root) - one * wofz(-1j * other * root)
    return np.asarray(1.0 + (parts / (one - other)).real)


@number(
    "basset-settling", "velocity of a sphere from rest in creeping flow over that with Basset's kernel",
    "Clift, Grace & Weber 1978, Bubbles, Drops, and Particles, 11.II; Basset 1888",
    "affine drag gravity buoyancy added-mass basset-history",
    tuple(f"{time:g} drag times" for time in CREEPING), 0.99, 1.01, np.ones(len(CREEPING)),
)  # fmt: skip
def basset_settling(tolerance: float) -> Array:
    """Velocities (4,) after CREEPING drag times, each over the closed form's."""
    density, diameter = DENSITY / LIGHT, 1e-5
    tau = density * diameter**2 / (18 * VISCOSITY)
    field = field_on(box(1, (-1e-3, -1e-3), (1e-3, 1e-3)), np.zeros_like)
    grains = without_slip(np.zeros((1, 2)), np.zeros((1, 2)), diameter, density)
    ends = [
        track(
            field, grains, until=float(time * tau), forces=WITH_MEMORY, drag="stokes", tolerance=tolerance, length=1e-7
        )
        for time in CREEPING
    ]  # fmt: skip
    fallen = np.array([-end.velocity[0, 1] for end in ends])
    return np.asarray(fallen / (G * (1 - LIGHT) * tau) / _creeping(CREEPING, LIGHT))


PIECES = 800  # of a flight with all of its past


def flown_with_all_of_the_past(
    diameter: float, density: float, speeds: tuple[float, float], wind: float, lasts: float, kernel_speed: float
) -> float:
    """Way (m, downward) in ``lasts`` (s) of a sphere in air that blows down at ``wind`` (m/s), with Mei & Adrian's
    kernel of a slip ``kernel_speed`` (m/s; infinite: without the history force).

    ``speeds`` (m/s, downward): before a blow at the beginning, and after it. The equation of the velocity, integrated
    once, has the kernel's integral J in the place of K, which is finite, and the jump of the slip times J:

        v(t) = v(0) + int (B s + g) dt' + (s(0) - s(-)) J(t) / tau_S + 1 / tau_S int J(t - t') s'(t') dt'

    by the trapezoidal rule, the slip straight between times that lie closer at first; error below 1e-3 of what the
    force does.
    """
    came, v = speeds
    stokes = density * diameter**2 / (18 * VISCOSITY)
    law, pull = drag_laws["brown-lawler"].factor, G * (1.0 - DENSITY / density)
    time = lasts * np.linspace(0.0, 1.0, PIECES + 1) ** 2
    known = lasts * np.linspace(0.0, 1.0, 100) ** 4
    felt = np.zeros(len(known))
    if np.isfinite(kernel_speed):
        felt[1:] = [history_time(float(t), 0.5 * diameter, kernel_speed, KINEMATIC) / stokes for t in known[1:]]

    def integral(since: Array) -> Array:
        return np.asarray(np.interp(np.maximum(since, 0.0) ** 0.25, known**0.25, felt))

    def rate(speed: float) -> float:
        return float(law(np.asarray(abs(wind - speed) * diameter / KINEMATIC), 1.0)) * (wind - speed) / stokes + pull

    slopes, way, pushed, begun = np.zeros(PIECES), 0.0, 0.0, v
    middle = 0.5 * (time[1:] + time[:-1])
    for k in range(PIECES):
        step, now = time[k + 1] - time[k], time[k + 1]
        weight = integral(now - middle[: k + 1]) * np.diff(time[: k + 2])
        past = float(weight[:k] @ slopes[:k] + (came - begun) * integral(np.array([now]))[0])
        before, end = v, v
        for _ in range(4):
            slopes[k] = -(end - before) / step
            end = begun + pushed + 0.5 * step * (rate(before) + rate(end)) + past + float(weight[k] * slopes[k])
        pushed += 0.5 * step * (rate(before) + rate(end))
        way += 0.5 * step * (before + end)
        slopes[k], v = -(end - before) / step, end
    return way


BLOWS = {  # diameter m, density kg/m3; speed before and after the blow, air's speed m/s, downward; time s
    "straw thrown up": (6.37e-3, 128.0, (3.0, -1.0), 5.0, 0.2),
    "chaff stopped": (1.3e-3, 200.0, (2.6, 0.0), 5.0, 0.1),
    "wheat stopped": (3.88e-3, 1300.0, (1.6, 0.0), 5.0, 0.3),
    "dust stopped": (5e-5, 1500.0, (5.0, 0.0), 5.0, 0.03),
    "chaff that begins to fall": (1.3e-3, 200.0, (0.0, 0.0), 0.0, 0.4),
}


@number(
    "memory-at-finite-reynolds-numbers", "way that the history force adds to a fall over that of Mei & Adrian's kernel",
    "Mei & Adrian 1992, J. Fluid Mech. 237, 323; product integration over all of the past",
    "affine nonlinear drag gravity buoyancy basset-history", tuple(BLOWS), 0.98, 1.02, np.ones(len(BLOWS)),
)  # fmt: skip
def memory_at_finite_reynolds_numbers(tolerance: float) -> Array:
    """What the force adds to the way of each of BLOWS, over what the whole past gives."""
    found = []
    for diameter, density, speeds, wind, lasts in BLOWS.values():
        settling = float(terminal_velocity(diameter, density, DENSITY, VISCOSITY))
        ways = [
            flown_with_all_of_the_past(diameter, density, speeds, wind, lasts, kernel_speed)
            for kernel_speed in (settling, np.inf)
        ]  # fmt: skip
        field = field_on(box(1, (-2.0, -2.0), (2.0, 2.0)), np.tile([0.0, -wind], (4, 1)))
        grains = without_slip(
            np.zeros((1, 2)), np.array([[0.0, -speeds[1]]]), diameter, density, arrival=np.array([[0.0, -speeds[0]]])
        )
        ends = [
            track(field, grains, until=lasts, forces=forces, tolerance=tolerance).position[0, 1]
            for forces in (("drag", "gravity", "buoyancy", "basset-history"), ("drag", "gravity", "buoyancy"))
        ]  # fmt: skip
        found.append((ends[1] - ends[0]) / (ways[0] - ways[1]))
    return np.array(found)
