"""The history force (Basset, Mei & Adrian): drag's memory of how the slip came about, as a sum of fading memories.

A granule's slip s = u - v through the air adds to the drag of the moment

    F / m = 1 / tau_S  int_0^t K(t - t') s'(t') dt',      tau_S = rho_p d^2 / (18 mu)

since vorticity takes time to leave the sphere. K is Basset's a / sqrt(pi nu t) at first, and falls as 1 / t^2 once the
wake has carried the vorticity away. As a sum of exponentials K = sum w_i exp(-t / tau_i) it needs no record of the
past: a memory l_i of the slip follows it in the time tau_i, and the force is that of the slip that is not yet known to
the memories,

    l_i' = (s - l_i) / tau_i,      F / m = 1 / tau_S  sum w_i (s - l_i)

(van Hinsberg, M.A.T., ten Thije Boonkkamp, J.H.M. & Clercx, H.J.H. 2011, J. Comput. Phys. 230, 1465; Parmar, M.,
Annamalai, S., Balachandar, S. & Prosperetti, A. 2018, J. Fluid Mech. 844, 970). A velocity that jumps, as at a wall,
makes the slip jump and leaves the memories as they are: what it did is forgotten as K is.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from ..drag import relaxation_time, terminal_velocity
from .force import SIDEWAYS, AirProperties, Array, Bound, FlightScales, Force, Grains, Granule, Slots, drag_scale

MIN_SLIP_PART = 0.1  # of the typical slip: what the slip seldom falls below; chosen, and tried along recorded tracks
NODES = 2001  # of the quadrature in time^(1/4): error below 1e-4
# By what flights with and without the force exceed the estimate, in the shipped rhombus' steady wake
# (tests/unit/planning): dust that follows the air into the wake 9 times (95 % of it), chaff and wheat beside it 1.15.
# In a wake that sheds the estimate itself is some six times as large
IN_WAKE, SHEDDING, BESIDE_WAKE, FOLLOWS = 12.0, 2.0, 1.4, 1.0
COUNT = 7
MEMORIES = np.geomspace(1e-2, 3e2, COUNT)  # tau_i over the granule's own time
# The fit: the integral of K up to times between these two, over the granule's own time, at so many of them evenly in
# time^(1/4); what is faster than the fastest memory acts as a kick, which for a landing is the same
SHORTEST, LONGEST, POINTS = 1e-2, 1.5e2, 120
FINER = 4  # nodes of the quadrature of K's integral in each of its intervals
BELOW = 0.3  # of the integral's square root of time: counts as much as this where the integral is less


def history_kernel(time: Array, radius: float, speed: float, kinematic: float) -> Array:
    """K(t) of the history force 6 pi mu a int K(t - s) d(u - v)/ds ds; ``time`` s, ``radius`` m, slip ``speed`` m/s.

    K = {[pi t nu / a^2]^(1/4) + [pi U^3 t^2 / (2 a nu f_H^3)]^(1/2)}^-2, f_H = 0.75 + 0.105 Re, Re = 2 a U / nu: Mei,
    R. & Adrian, R.J. 1992, J. Fluid Mech. 237, 323, for Re up to about 100; Basset's sqrt(a^2 / pi nu t) at first,
    falling as 1 / t^2 later. ``kinematic`` viscosity m2/s.
    """
    factor = 0.75 + 0.105 * 2.0 * radius * speed / kinematic
    early = (math.pi * time * kinematic / radius**2) ** 0.25
    late = np.sqrt(0.5 * math.pi * speed**3 / (radius * kinematic * factor**3)) * time
    return np.asarray(1.0 / (early + late) ** 2)


def history_time(time: float, radius: float, speed: float, kinematic: float) -> float:
    """Integral (s) of :func:`history_kernel` from 0 to ``time`` (s), to 1e-4."""
    z = np.linspace(0.0, time**0.25, NODES)  # t = z^4 takes the singularity out
    middle = 0.5 * (z[1:] + z[:-1])
    return float(np.sum(history_kernel(middle**4, radius, speed, kinematic) * 4.0 * middle**3 * np.diff(z)))


# -- the memories of a granule -----------------------------------------------------------------------------------------


@cache
def _fit() -> tuple[Array, Array]:
    """Times^(1/4) (m,) at which the kernel's integral is matched, and what makes weights (COUNT, m) of it there."""
    z = np.linspace(SHORTEST**0.25, LONGEST**0.25, POINTS)
    counts = np.sqrt(1.0 / z) / (BELOW + z**2)  # evenly in the logarithm of time
    step = -MEMORIES * np.expm1(-(z[:, None] ** 4) / MEMORIES)
    return z, np.linalg.pinv(step * counts[:, None]) * counts


def _weights(late: Array) -> Array:
    """Weights (n, COUNT) of the memories for k(y) = (y^(1/4) + c y)^-2, c = ``late`` (n,) from 0 (Basset's kernel) to
    1; the integral of k is matched to 1 % for y from 0.1 to 150.
    """
    z, make = _fit()
    fine = np.concatenate([
        np.linspace(0.0, z[0], FINER * POINTS, endpoint=False),
        np.linspace(z[0], z[-1], FINER * (POINTS - 1) + 1),
    ])  # fmt: skip
    middle = 0.5 * (fine[1:] + fine[:-1])
    part = 4.0 * middle / (1.0 + late[:, None] * middle**3) ** 2 * np.diff(fine)
    whole = np.cumsum(part, axis=1)[:, FINER * POINTS - 1 :: FINER]
    return np.asarray(whole @ make.T)


def memories_of(
    diameter: Array, density: Array, scale: Array, air_density: float, viscosity: float, sphericity: Array | float = 1.0
) -> tuple[Array, Array]:
    """What granules (n,) remember of their slip: their own time (n,) s, over which MEMORIES are given, and the weight
    (n, COUNT) 1/s of each memory in the force per mass.

    The slip in Mei & Adrian's kernel, which is that of small changes about a steady slip U, is the granule's terminal
    speed in air at rest. Above Re of about 100 the kernel hardly knows U: all that it depends on is the time

        t* = 4^(4/3) pi^(-1/3) (a^2 / nu) (f_H / Re)^2      when    K = (pi t* nu / a^2)^(-1/2) k(t / t*)

    passes from Basset's law to the other. Where the ``sphericity`` is below 1, as of flakes, that speed is by Haider &
    Levenspiel's law, to which their ``scale`` is calibrated. The granule's own time is t*, or tau_S where that is less
    (slow, fine or light granules): what the air did more than 150 such times ago is forgotten.
    """
    unit, whole, late = _passing(diameter, density, scale, air_density, viscosity, sphericity)
    return unit, whole[:, None] * _weights(late)


def _passing(
    diameter: Array, density: Array, scale: Array, air_density: float, viscosity: float, sphericity: Array | float
) -> tuple[Array, Array, Array]:
    """The time of granules (n,) that their memories are given over (s), what all weights are multiplied by (1/s), and c
    of :func:`_weights`.
    """
    kinematic, radius = viscosity / air_density, 0.5 * diameter
    flat = np.broadcast_to(np.asarray(sphericity) < 1.0, np.shape(diameter))
    shape, speed = np.broadcast_to(sphericity, np.shape(diameter)), np.zeros(np.shape(diameter))
    for law, mine in (("brown-lawler", ~flat), ("haider-levenspiel", flat)):
        given = diameter[mine], density[mine], air_density, viscosity
        fall = terminal_velocity(*given, law=law, sphericity=shape[mine], drag_scale=scale[mine])
        speed[mine] = np.abs(fall)
    reynolds = speed * diameter / kinematic
    viscous, stokes = radius**2 / kinematic, relaxation_time(diameter, density, viscosity)
    late = np.sqrt(math.pi / 16.0) * (reynolds / (0.75 + 0.105 * reynolds)) ** 1.5  # of t nu / a^2 in the kernel
    with np.errstate(divide="ignore"):
        turns = (math.pi**0.25 / late) ** (4.0 / 3.0)  # t* nu / a^2; infinite without slip
    unit = np.minimum(turns * viscous, stokes)
    return unit, 1.0 / (stokes * np.sqrt(math.pi * unit / viscous)), (unit / viscous / turns) ** 0.75


def _of(grains: Grains, air: AirProperties) -> tuple[Array, Array, Array, float, float, Array]:
    return (
        grains.diameter, grains.density, drag_scale(grains, air), air.density, air.viscosity, grains.sphericity,
    )  # fmt: skip


def _factors(grains: Grains, air: AirProperties) -> Slots:
    """RECALL_0 .. RECALL_6 (1/s): the weight of each memory."""
    _, weights = memories_of(*_of(grains, air))
    return {f"RECALL_{i}": weights[:, i] for i in range(COUNT)}


def _constants(grains: Grains, air: AirProperties) -> Slots:
    """FORGET (1/s): one over the granule's own time."""
    return {"FORGET": 1.0 / _passing(*_of(grains, air))[0]}


def _memory(granule: Granule) -> tuple[tuple[float, float], ...]:
    diameter, density, scale = (np.array([x]) for x in (granule.diameter, granule.density, granule.drag_scale))
    unit, weights = memories_of(diameter, density, scale, granule.air_density, granule.viscosity, granule.sphericity)
    return tuple(zip((unit[0] * MEMORIES).tolist(), weights[0].tolist(), strict=True))


# -- what leaving it out could move ------------------------------------------------------------------------------------


def _shift(flight: FlightScales) -> float:
    stokes = float(relaxation_time(flight.diameter, flight.density, flight.viscosity))
    slowest = max(MIN_SLIP_PART * flight.typical_slip, min(flight.settling, flight.typical_slip))
    memory = history_time(flight.whole, 0.5 * flight.diameter, slowest, flight.viscosity / flight.air_density)
    last = min(flight.time, flight.tau)  # after a step of the air's velocity the shift grows as t exp(-t / tau)
    air = 0.0 if flight.calm else flight.air_speed
    sideways, along = max(SIDEWAYS * air, flight.thrown), max(air, flight.landing)  # change of the air's or its own
    change = min(math.hypot(sideways, flight.slope * along), flight.typical_slip)
    follows = flight.tau * flight.arrival < FOLLOWS * flight.width and not flight.calm
    margin = BESIDE_WAKE if not follows else SHEDDING if flight.shedding else IN_WAKE
    return flight.widths(margin * memory / stokes * change * last * math.exp(-last / flight.tau))


HISTORY_FORCE = Force(
    name="basset-history",
    means="drag's memory of past slip",
    source="Basset, A.B. 1888, Phil. Trans. R. Soc. A 179, 43; Mei, R. & Adrian, R.J. 1992, J. Fluid Mech. 237, 323",
    calm=True,
    effort=1.0,
    bound=Bound(_shift, "Mei & Adrian's kernel, an inertia of its integral over tau, times the change of slip"),
    factors=_factors,
    constants=_constants,
    memory=_memory,
)
