"""Where granules land, written down without the program: impacts of point masses on a slope, parabolas, Stokes' drag.

Sources: eq. (1)-(2) of Spade et al. 2020 (doi 10.22616/ERDev.2020.19.TF365): a point mass meets a slope with friction f
and restitution R; the normal impulse (1 + R) w is followed by a tangential one of at most f times it, which stops the
slip at most. Stokes 1851 for the drag, Davies 1945 for its slip. Nothing here is the program's: it is what judges it.

Left out, and why it is little: granules have a radius at faces but not at corners. Those of 50 um fall on the corner of
a curtain of 10 mm in less than 0.3 % of cases. Positions are metres, the first body's centre is the origin, y is up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s2; the program's own is compared with it in tests/proofs/test_tails.py
AIR_DENSITY, AIR_VISCOSITY = 1.204, 1.825e-5  # kg/m3 and Pa s of air at 20 C, which scenes without their own have
MEAN_FREE_PATH = 6.6e-8  # m, of air at 20 C; moves the drag of 100 um by 2e-3
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
BLOWS = 400  # on one face: with R = 0.9 what is left of a bounce is 5e-19 of it
SLIDES = 1e-6  # m/s: a granule that bounces slower than that slides
STRIDE = 0.2  # rad of the vibration over which a shaken face is looked at in one step
HALVINGS = 40  # of such a step: to round-off
NEVER = 1e3  # s, to a blow that there is not


@dataclass(frozen=True)
class Curtain:
    """A curtain of granules as it comes: its ``width`` and the ``position`` of its middle (m); the ``height`` (m) it
    falls to the top of the body from rest, or its ``speed`` (m/s) where there is no body.
    """

    width: float
    position: float
    height: float = 0.0
    speed: float = 0.0

    def places(self, count: int) -> Array:
        """x (count,) m of granules that are spread evenly over it."""
        return np.asarray(self.position + self.width * ((np.arange(count) + 0.5) / count - 0.5))


@dataclass(frozen=True)
class Slope:
    """A rhombus, or a prism with its apex up, of ``width`` (m) with faces at ``angle`` (rad) from the horizontal; the
    ``floor`` (y, m); shaken up and down by ``amplitude`` (m) at ``omega`` (rad/s).
    """

    shape: str
    width: float
    angle: float
    floor: float
    amplitude: float = 0.0
    omega: float = 0.0

    @property
    def top(self) -> float:
        """y (m) of the apex: the centre of a prism is its centroid."""
        rise = 0.5 * self.width * math.tan(self.angle)
        return rise if self.shape == "rhombus" else 2.0 * rise / 3.0

    @property
    def length(self) -> float:
        """Of a face (m)."""
        return 0.5 * self.width / math.cos(self.angle)

    def lift(self, time: Array) -> Array:
        """How far (m) the body is above its place."""
        return np.asarray(self.amplitude * np.sin(self.omega * time))

    def climb(self, time: Array) -> Array:
        """How fast (m/s) it moves up."""
        return np.asarray(self.amplitude * self.omega * np.cos(self.omega * time))


@dataclass(frozen=True)
class Granule:
    """Granules of one fraction: ``restitution``, ``friction``, ``diameter`` (m), or in air the ends ``low`` to ``high``
    (m) of diameters that are spread evenly by mass, their ``density`` (kg/m3), the factor on their terminal velocity.
    """

    restitution: float = 0.5
    friction: float = 0.3
    diameter: float = 5e-5
    low: float = 0.0
    high: float = 0.0
    density: float = 2000.0
    faster: float = 1.0


@dataclass(frozen=True)
class Stream:
    """Air without a body: it moves down at ``speed`` (m/s; 0: it rests); granules come in at the ``level`` (y, m) at an
    ``angle`` (rad) from the x axis and land on the ``floor`` (y, m).
    """

    speed: float
    level: float
    angle: float
    floor: float


# -- A body ------------------------------------------------------------------------------------------------------------
@dataclass
class _Flight:
    """Granules on or above the right face: ``s`` (n,) m down the face from the apex, ``u`` (n,) m/s along it, ``w``
    (n,) m/s off it, as seen from a room at rest, at ``time`` (n,) s; all at contact.
    """

    s: Array
    u: Array
    w: Array
    time: Array

    def of(self, some: NDArray[np.bool_]) -> _Flight:
        """Some of them."""
        return _Flight(self.s[some], self.u[some], self.w[some], self.time[some])

    def put(self, some: NDArray[np.bool_], other: _Flight) -> None:
        """``other`` in the place of some of them."""
        for name in ("s", "u", "w", "time"):
            getattr(self, name)[some] = getattr(other, name)


def landed_on_floor(slope: Slope, curtain: Curtain, granule: Granule, count: int) -> Array:
    """x (count,) m at which granules of one fraction come to the floor; nan for those that stay on the body."""
    x, radius = curtain.places(count), 0.5 * granule.diameter
    side, away = np.where(x < 0.0, -1.0, 1.0), np.abs(x)
    found = away.copy()
    down, up = math.sin(slope.angle), math.cos(slope.angle)
    foot = away - radius * down  # where the face is touched
    on = np.flatnonzero((foot > 0.0) & (foot < 0.5 * slope.width))
    if not len(on):
        return np.asarray(side * found)
    centre = slope.top - foot[on] * math.tan(slope.angle) + radius * up
    passing = 0.0 * centre
    if slope.omega:
        passing = 2.0 * math.pi / slope.omega * ((np.arange(count)[on] * GOLDEN) % 1.0)
    fall = np.sqrt(2.0 * GRAVITY * (slope.top + max(curtain.height, radius) - centre))
    time, fall = _first_contact(slope, fall, passing)
    flight = _struck(slope, granule, _Flight(foot[on] / up, fall * down, -fall * up, time))
    rests = _off_the_face(slope, granule, flight)
    out = _parabola(slope, radius, flight)
    found[on] = np.where(rests, np.nan, out)
    return np.asarray(side * found)


def _first_contact(slope: Slope, fall: Array, passing: Array) -> tuple[Array, Array]:
    """When (n,) s granules meet the face, and how fast (n,) m/s they fall then, that would meet it at ``passing`` with
    ``fall`` if it were at rest. A body that is nowhere faster than they fall is met once.
    """
    if not slope.omega:
        return passing, fall
    far = 3.0 * slope.amplitude / fall
    low, high = -far, far.copy()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = -(fall + 0.5 * GRAVITY * middle) * middle > slope.lift(passing + middle)
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return passing + high, fall + GRAVITY * high


def _struck(slope: Slope, granule: Granule, flight: _Flight) -> _Flight:
    """The same after the blow: eq. (1)-(2) as the moving face sees it."""
    climb = slope.climb(flight.time) if slope.omega else 0.0
    along, off = -climb * math.sin(slope.angle), climb * math.cos(slope.angle)
    slip, approach = flight.u - along, np.maximum(off - flight.w, 0.0)
    impulse = (1.0 + granule.restitution) * approach
    grip = np.minimum(granule.friction * impulse, np.abs(slip))
    u = flight.u - np.copysign(grip, slip)
    return _Flight(flight.s, u, flight.w + impulse, flight.time)


def _off_the_face(slope: Slope, granule: Granule, flight: _Flight) -> NDArray[np.bool_]:
    """Follow granules from blow to blow until their next one would lie beyond the face; whether each stays on it."""
    going, rests = np.ones(len(flight.s), dtype=bool), np.zeros(len(flight.s), dtype=bool)
    pull, press = GRAVITY * math.sin(slope.angle), GRAVITY * math.cos(slope.angle)
    for _ in range(BLOWS):
        if not slope.omega:
            slow = going & (flight.w < SLIDES)
            rests[slow] = _slide(slope, granule, flight, slow)
            going &= ~slow
        if not going.any():
            return rests
        now = flight.of(going)
        span = 2.0 * now.w / press if not slope.omega else _next_blow(slope, now)
        s = now.s + (now.u + 0.5 * pull * span) * span
        lift = (slope.lift(now.time + span) - slope.lift(now.time)) if slope.omega else 0.0
        s += lift * math.sin(slope.angle)  # seen from the face, which has moved
        again = s < slope.length
        hit = _Flight(s, now.u + pull * span, now.w - press * span, now.time + span).of(again)
        going[going] = again
        flight.put(going, _struck(slope, granule, hit))
    raise ArithmeticError(f"{going.sum()} of {len(going)} granules still bounce after {BLOWS} blows")


def _next_blow(slope: Slope, now: _Flight) -> Array:
    """After what time (n,) s granules meet a shaken face again, NEVER where they are past its end before: steps short
    against its motion, the last one halved.
    """
    down, up = math.sin(slope.angle), math.cos(slope.angle)
    start = slope.lift(now.time)

    def risen(span: Array, some: NDArray[np.intp]) -> Array:
        return np.asarray(slope.lift(now.time[some] + span) - start[some])

    def above(span: Array, some: NDArray[np.intp]) -> NDArray[np.bool_]:
        return np.asarray((now.w[some] - 0.5 * GRAVITY * up * span) * span > up * risen(span, some))

    found, step = np.full(len(now.s), NEVER), STRIDE / slope.omega
    left, low = np.arange(len(now.s)), np.zeros(len(now.s))
    while len(left):
        high = low + step
        met = ~above(high, left)
        a, b, some = low[met], high[met], left[met]
        for _ in range(HALVINGS if len(some) else 0):
            middle = 0.5 * (a + b)
            flies = above(middle, some)
            a, b = np.where(flies, middle, a), np.where(flies, b, middle)
        found[some] = b
        along = now.s[left] + (now.u[left] + 0.5 * GRAVITY * down * high) * high + down * risen(high, left)
        going = ~met & (along < slope.length)
        left, low = left[going], high[going]
    return found


def _slide(slope: Slope, granule: Granule, flight: _Flight, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Let some granules slide to the end of the face at rest; whether each comes to rest on the way."""
    pull = GRAVITY * (math.sin(slope.angle) - granule.friction * math.cos(slope.angle))
    left = flight.u[some] ** 2 + 2.0 * pull * (slope.length - flight.s[some])
    flight.put(some, _Flight(np.full(left.shape, slope.length), np.sqrt(np.maximum(left, 0.0)), 0.0 * left,
                             flight.time[some]))  # fmt: skip
    return (left < 0.0) | ((flight.u[some] == 0.0) & (pull <= 0.0))


def _parabola(slope: Slope, radius: float, flight: _Flight) -> Array:
    """x (n,) m at the floor of granules that leave the face for good."""
    down, up = math.sin(slope.angle), math.cos(slope.angle)
    lift = slope.lift(flight.time) if slope.omega else 0.0
    x, y = flight.s * up + radius * down, slope.top - flight.s * down + radius * up + lift
    vx, vy = flight.u * up + flight.w * down, flight.w * up - flight.u * down
    return np.asarray(x + vx * (vy + np.sqrt(vy**2 + 2.0 * GRAVITY * (y - slope.floor))) / GRAVITY)


# -- Air ---------------------------------------------------------------------------------------------------------------
def carried_to_floor(stream: Stream, curtain: Curtain, granule: Granule, count: int) -> Array:
    """How far (count,) m from where they come in granules of evenly spread diameters land in uniform air.

    Linear drag: v -> the air's speed and the terminal velocity with the time tau; the time of landing is the root of y,
    which falls ever faster or slower but has one maximum at most, by halving.
    """
    diameter = granule.low + (granule.high - granule.low) * (np.arange(count) + 0.5) / count
    knudsen = 2.0 * MEAN_FREE_PATH / diameter
    slip = 1.0 + knudsen * (1.257 + 0.4 * np.exp(-1.1 / knudsen))
    tau = granule.density * diameter**2 / (18.0 * AIR_VISCOSITY) * slip * granule.faster
    falls = -stream.speed - GRAVITY * (1.0 - AIR_DENSITY / granule.density) * tau
    vx, vy = curtain.speed * math.cos(stream.angle), curtain.speed * math.sin(stream.angle)
    low, high = np.zeros(count), np.full(count, 1e-3)

    def above(time: Array) -> NDArray[np.bool_]:
        y = falls * time + (vy - falls) * tau * -np.expm1(-time / tau)
        return np.asarray(stream.level + y > stream.floor)

    while above(high).any():
        high = np.where(above(high), 2.0 * high, high)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        flies = above(middle)
        low, high = np.where(flies, middle, low), np.where(flies, high, middle)
    return np.asarray(vx * tau * -np.expm1(-high / tau))


# -- Shares ------------------------------------------------------------------------------------------------------------
Machine = Slope | Stream


def places(machine: Machine, curtain: Curtain, granule: Granule, count: int) -> tuple[Array, float]:
    """Middles x (count,) m of where granules land, nan where they do not, and the width (m) over which each of these is
    spread evenly: that of the curtain where all of it is carried alike, else 0.
    """
    if isinstance(machine, Stream):
        return curtain.position + carried_to_floor(machine, curtain, granule, count), curtain.width
    return landed_on_floor(machine, curtain, granule, count), 0.0


def shares(landed: tuple[Array, float], bins: dict[str, tuple[float, float]]) -> dict[str, float]:
    """The share of granules between the ends (m) of each of the ``bins``, which do not overlap, and elsewhere."""
    x, width = landed
    found = {}
    for name, (low, high) in bins.items():
        if width > 0.0:
            inside = (np.minimum(x + 0.5 * width, high) - np.maximum(x - 0.5 * width, low)) / width
            found[name] = float(np.mean(np.clip(inside, 0.0, 1.0)))
        else:
            found[name] = float(np.mean((x >= low) & (x < high)))
    return {**found, "elsewhere": 1.0 - sum(found.values())}


def as_drawn(granule: Granule, curtain: Curtain, drawn: dict[str, float]) -> tuple[Granule, Curtain]:
    """Granules and curtain with the ``drawn`` numbers of a scene: those of a fraction by their name, "feed.width" and
    the like of the curtain; size, density and terminal velocity are factors.
    """
    size, density = drawn.get("size", 1.0), drawn.get("density", 1.0)
    grain = replace(
        granule, restitution=drawn.get("restitution", granule.restitution),
        friction=drawn.get("friction", granule.friction), low=granule.low * size, high=granule.high * size,
        density=granule.density * density, faster=granule.faster * drawn.get("terminal_velocity", 1.0),
    )  # fmt: skip
    fed = {key: drawn.get(f"feed.{key}", getattr(curtain, key)) for key in ("width", "position", "height", "speed")}
    return grain, Curtain(**fed)
