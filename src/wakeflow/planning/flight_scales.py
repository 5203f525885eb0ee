"""The scales of a fraction's flight, which the bounds are made of: times, speeds, meetings, before anything is flown.

One-dimensional falls through the channel's uniform air with the fraction's own drag; kinetic theory for meetings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import normals
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity, drag_laws, slip_correction, terminal_velocity
from ..laws.material import Material
from ..laws.restitution import restitution_at
from ..scene import Air, Fraction, Scene
from .bounds import NEAR, Flight

__all__ = ["CROSSED", "arrival_speed", "fall_speeds", "flights", "meetings", "packing"]

Array = NDArray[np.float64]
SIZES = (0.05, 0.5, 0.95)  # mass quantiles of the granules that the bounds are taken over
RECIRCULATION = 0.2  # of U: how fast air that granules fall into leaves the wake
CROSSED = 3.0  # curtain's widths of way across other granules: in, out again, and among those that linger on the slope
NEARLY = 1.001  # of the air speed: terminal velocity of a granule that hangs in upward air for long
MARCH = 0.01  # step of the one-dimensional fall, of the time it takes about


def flights(scene: Scene, name: str, law: str, scale: float, *, straight: bool, turbulent: bool) -> list[Flight]:
    """The scales of a fraction's flight in the scene's air, for a small, a median and a large granule.

    ``law`` of drag times ``scale``; ``straight``: it meets the body nearly as if there were no air. One-dimensional
    falls through uniform air with the fraction's drag: from the feed to the body, and from rest at the body (an impact
    may take all of its speed) to the channel's end.
    """
    air, fraction = scene.air, scene.fraction[name]
    assert air is not None
    density, phi = fraction.properties.density, fraction.sphericity or 1.0
    _, omega = scene.motion
    upward = air.direction == "up"
    sideways = not scene.body or any(b.points is not None or b.on in ("left", "right") for b in scene.bin.values())
    found = []
    for diameter, factor in _granules(scene, fraction, law, scale):
        fall = _Fall(scene, air, diameter, density, law, phi, factor)
        whole, time, near, arrival, landing, tau = fall.times()
        arrival = max(arrival, scene.feed.fall_speed)
        slip = max(abs(arrival - fall.along), air.speed, abs(landing) - abs(fall.along))
        if scene.body and upward and fall.settling < air.speed:  # it falls into the wake, and leaves with the air
            stays = NEAR * scene.width / (RECIRCULATION * air.speed) / (1.0 + tau * air.speed / scene.width)
            whole, time, near = whole + stays, time + stays, near + stays
        thrown = arrival * _thrown(scene, fraction, arrival) if scene.body else abs(float(scene.entry[0]))
        found.append(Flight(
            diameter=diameter, density=density, tau=tau, calm=not scene.body,
            arrival=arrival, thrown=thrown, slip=slip, settling=fall.settling,
            landing=landing, whole=whole, time=time, near=near,
            beside=straight and not upward,
            sideways_bins=sideways,
            air_density=air.density, viscosity=air.viscosity, air_speed=air.speed, width=scene.width,
            intensity=air.turbulence, turbulent=turbulent, shaking=float(np.linalg.norm(scene.shaking)),
            omega=omega, meetings=meetings(scene, diameter, density),
        ))  # fmt: skip
    return found


def _granules(scene: Scene, fraction: Fraction, law: str, scale: float) -> Iterator[tuple[float, float]]:
    """Diameters (m) and factors on the drag law, slip correction included, of small, median and large granules; where
    measured terminal velocities spread, of slow and fast ones of each size, and of those that hang in the air longest.
    """
    density, speeds = fraction.properties.density, fraction.settling(np.array(SIZES))
    if speeds is not None and not scene.body and scene.air is not None:
        speeds = np.append(speeds, np.clip(NEARLY * scene.air.speed, speeds[0], speeds[-1]))
    for diameter in dict.fromkeys(fraction.diameters(np.array(SIZES)).tolist()):
        if speeds is None:
            yield diameter, scale / float(slip_correction(diameter))
            continue
        for factor in drag_factor_for_terminal_velocity(diameter, density, speeds, *STANDARD_AIR, GRAVITY, law):
            yield diameter, float(factor)


def _thrown(scene: Scene, fraction: Fraction, arrival: float) -> float:
    """Largest sideways speed after an impact over the fall speed before it: (1 + R) n_y (n_x - f n_y) on any face."""
    granule = fraction.properties
    across, up = np.abs(np.concatenate([normals(body.outline()) for body in scene.body.values()])).T
    kick = (1.0 + restitution_at(granule.restitution, arrival * up)) * up
    return float((kick * np.maximum(across - granule.friction * up, 0.0)).max())


def arrival_speed(scene: Scene, name: str, law: str, scale: float) -> float:
    """Fall speed (m/s) of a fraction's median granule at the top of the first body, its drag in the channel's uniform
    air included; negative where that carries it up.
    """
    assert scene.air is not None
    fraction = scene.fraction[name]
    size, phi = fraction.properties.diameter, fraction.sphericity or 1.0
    fall = _Fall(scene, scene.air, size, fraction.properties.density, law, phi, scale / float(slip_correction(size)))
    return fall.arrival()[1]


@dataclass(frozen=True)
class _Fall:
    """A vertical fall of one granule through the channel's uniform air; downward is positive."""

    scene: Scene
    air: Air
    diameter: float
    density: float
    law: str
    sphericity: float
    scale: float  # of the drag law, this granule's slip correction included

    @property
    def along(self) -> float:
        return self.air.speed if self.air.direction == "down" else -self.air.speed

    @property
    def settling(self) -> float:
        """Terminal speed (m/s), up or down."""
        law = (self.air.density, self.air.viscosity, GRAVITY, self.law, self.sphericity, self.scale)
        return abs(float(terminal_velocity(self.diameter, self.density, *law)))

    def tau(self, slip: Array) -> Array:
        """Relaxation times (n,) s at slips (n,) m/s."""
        reynolds = self.air.density * slip * self.diameter / self.air.viscosity
        factor = self.scale * drag_laws[self.law].factor(reynolds, self.sphericity)
        return self.density * self.diameter**2 / (18.0 * self.air.viscosity) / factor

    def times(self) -> tuple[float, float, float, float, float, float]:
        """Seconds from release to the end, from the body to the end, of that near it; speeds (m/s) of arrival at the
        body and at the end; the mean relaxation time (s) after the body. Without a body from its entry to the end.
        """
        scene, channel = self.scene, self.scene.channel
        top = scene.level
        speed = scene.release[1]
        if not scene.body:
            down, up = top - channel.bottom, max(channel.top - top, channel.width)
            rows = list(self._march(speed, down, up))
            tau = float(np.mean(self.tau(np.abs(self.along - np.array(rows)[:, 2]))))
            return rows[-1][0], rows[-1][0], rows[-1][0], abs(speed), max(abs(rows[-1][2]), 0.1 * abs(self.along)), tau
        before, arrival = self.arrival()
        rows = list(self._march(0.0, -channel.bottom, channel.top))
        time, _, landing = rows[-1]
        near = next((t for t, y, _ in rows if abs(y) >= NEAR * scene.width), time)
        tau = float(np.mean(self.tau(np.abs(self.along - np.array(rows)[:, 2]))))
        return before + time, time, near, arrival, max(abs(landing), 0.1 * abs(self.along)), tau

    def arrival(self) -> tuple[float, float]:
        """Seconds from the release to the top of the first body, and the speed (m/s) there; without one at once."""
        above, speed = self.scene.release
        if above == 0.0:
            return 0.0, speed
        room = max(self.scene.channel.top - self.scene.level - above, self.scene.width)
        time, _, arrival = _last(self._march(speed, above, room))
        return time, arrival

    def _march(self, speed: float, down: float, up: float) -> Iterator[tuple[float, float, float]]:
        """Time (s), way (m) and speed (m/s) from ``speed`` until it has come ``down`` or ``up`` (m): exponential
        steps with the drag of their beginning.
        """
        pull = GRAVITY * (1.0 - self.air.density / self.density)
        way = min(down, up)
        step = MARCH * min(math.sqrt(2.0 * way / GRAVITY), way / abs(self.along))
        t = y = 0.0
        for _ in range(3000):
            tau = float(self.tau(np.array([abs(self.along - speed)]))[0])
            final = self.along + pull * tau
            left = math.exp(-step / tau)
            y += final * step + (speed - final) * tau * (1.0 - left)
            speed = final + (speed - final) * left
            t += step
            yield t, y, speed
            if y >= down or y <= -up:
                return


def _last(rows: Iterator[tuple[float, float, float]]) -> tuple[float, float, float]:
    *_, last = rows
    return last


def fall_speeds(scene: Scene, name: str, law: str, factor: float, diameter: float, drop: Array) -> Array:
    """Fall speeds (n,) m/s of a granule of ``diameter`` (m) after falling ``drop`` (n,) m from the feed, drag in the
    channel's uniform air (``factor`` times the ``law``) included; NaN where that carries it up before.
    """
    _, speed = scene.release
    if scene.air is None:
        return np.sqrt(speed**2 + 2.0 * GRAVITY * drop)
    fraction = scene.fraction[name]
    phi, density = fraction.sphericity or 1.0, fraction.properties.density
    fall = _Fall(scene, scene.air, diameter, density, law, phi, factor)
    room = scene.channel.top - scene.channel.bottom + scene.release[0]
    rows = np.array([(0.0, 0.0, speed), *fall._march(speed, float(drop.max()), room)])
    down = rows[: int(rows[:, 1].argmax()) + 1]
    return np.interp(drop, down[:, 1], down[:, 2], right=np.nan)


def meetings(scene: Scene, diameter: float, density: float) -> float:
    """How many granules one of ``diameter`` (m) and ``density`` (kg/m3) meets as it crosses the curtain, each counted
    by the share of momentum that it takes, m_j / (m_i + m_j).

    Kinetic theory: number density n_j times pi/4 (d_i + d_j)^2 times a relative way of CROSSED curtain's widths.
    """
    feed, total = scene.feed, 0.0
    for share, other in packing(scene):
        cross = 1.5 * share * (diameter + other.diameter) ** 2 / other.diameter**3
        mass, its = density * diameter**3, other.density * other.diameter**3
        total += cross * CROSSED * feed.width * its / (mass + its)
    return feed.crowding * total


def packing(scene: Scene, speeds: Mapping[str, float] | None = None) -> Iterator[tuple[float, Material]]:
    """Volume fraction of every fraction in the curtain at the body, mean over its width, and the fraction's properties.

    ``speeds`` (m/s) of the fractions there; without, that of free fall for all.
    """
    feed = scene.feed
    for name, share in scene.mass_shares().items():
        granule = scene.fraction[name].properties
        speed = max(feed.fall_speed, 0.1) if speeds is None else speeds[name]
        yield feed.mass_flow * share / granule.density / (feed.width * feed.depth * speed), granule
