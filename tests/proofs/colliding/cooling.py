"""A gas of granules that cools by its collisions, beside kinetic theory: how often they meet, and Haff's law.

N smooth inelastic spheres of diameter s and mass m in a box lose their temperature T = m <v_x^2> as
T0 / (1 + z t / 2)^2 (Haff, P.K. 1983, J. Fluid Mech. 134, 401), while each meets others w times a second:

    w = 4 sqrt(pi) chi n s^2 sqrt(T / m),     z = (1 - e^2) w / 3 (1 + 3 a / 16),     chi = (1 - phi / 2) / (1 - phi)^3

Enskog's frequency with Carnahan & Starling's value of the pair distribution at contact, and the correction a of the
velocities' fourth moment, 16 (1 - e)(1 - 2 e^2) / (81 - 17 e + 30 e^2 (1 - e)) (van Noije, T.P.C. & Ernst, M.H. 1998,
Granular Matter 1, 57; cited from memory). It holds while the gas is uniform and isotropic: for some ten collisions a
granule, before clusters grow.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.report import mean_interval
from wakeflow.flight import Body, Collisions, Granules, track

Array = NDArray[np.float64]
DIAMETER, DENSITY, SPEED = 4e-3, 1000.0, 1.0  # m, kg/m3, and the rms of v_x and v_y at the beginning, m/s
WALL = 0.02  # m: thickness of the box's walls
MIXED = 10.0  # collisions a granule, after which the third component is as warm as the others, to exp(-0.4 x 10)
WATCHED = 10.0  # more of them, over which the gas is watched
LOOKS = 5  # at its temperature in that time


@dataclass(frozen=True)
class Gas:
    """``count`` granules of one ``restitution``; their volume is the share ``filled`` of what their centres reach."""

    count: int = 4000
    filled: float = 0.02
    restitution: float = 0.9

    @property
    def side(self) -> float:
        """Of the cube that centres reach (m): in the picture walls stand a radius outside it, across it is periodic."""
        return float((self.count * math.pi / 6.0 * DIAMETER**3 / self.filled) ** (1.0 / 3.0))

    @property
    def crowding(self) -> float:
        """The pair distribution of hard spheres at contact (Carnahan & Starling 1969)."""
        return (1.0 - 0.5 * self.filled) / (1.0 - self.filled) ** 3

    def frequency(self, speed: float) -> float:
        """Collisions a granule and second at the rms ``speed`` (m/s) of one component."""
        dense = self.count / self.side**3
        return 4.0 * math.sqrt(math.pi) * self.crowding * self.beside_walls * dense * DIAMETER**2 * speed

    @property
    def beside_walls(self) -> float:
        """Mean of (1 - s |n_x| / L)(1 - s |n_y| / L) over all directions n: nobody is met from behind a wall."""
        thin = DIAMETER / self.side
        return 1.0 - thin + 2.0 / (3.0 * math.pi) * thin**2

    @property
    def loss(self) -> float:
        """Rate of the temperature over the collision frequency: (1 - e^2) / 3 (1 + 3 a / 16)."""
        e = self.restitution
        fourth = 16.0 * (1.0 - e) * (1.0 - 2.0 * e**2) / (81.0 - 17.0 * e + 30.0 * e**2 * (1.0 - e))
        return (1.0 - e**2) / 3.0 * (1.0 + 3.0 * fourth / 16.0)

    def seconds(self, collisions: float) -> float:
        """When each has met so many (s), by Haff's law: C = 2 / loss ln(1 + loss w t / 2)."""
        rate = self.frequency(SPEED * math.sqrt(2.0 / 3.0))  # shared among three components
        return math.expm1(0.5 * self.loss * collisions) / (0.5 * self.loss * rate)


def _granules(gas: Gas, seed: int) -> tuple[Granules, list[Body]]:
    """The gas at its beginning, on a shaken lattice, and the walls of its box."""
    rng = np.random.default_rng(seed)
    side, lines = gas.side, math.ceil(gas.count ** (1.0 / 3.0))
    gap = side / lines
    cells = np.stack(np.unravel_index(rng.permutation(lines**3)[: gas.count], (lines,) * 3), axis=1)
    places = gap * (cells + 0.5) + 0.5 * (gap - DIAMETER) * rng.uniform(-1.0, 1.0, cells.shape)
    velocity = rng.normal(0.0, SPEED, (gas.count, 2))
    velocity -= velocity.mean(axis=0)
    grains = Granules(places[:, :2], velocity, DIAMETER, DENSITY, restitution=1.0, friction=0.0, depth=places[:, 2])
    low, high = -0.5 * DIAMETER, side + 0.5 * DIAMETER
    spans = ((low - WALL, low), (low - WALL, high + WALL), (high, high + WALL))
    boxes = [(spans[0], spans[1]), (spans[2], spans[1]), (spans[1], spans[0]), (spans[1], spans[2])]
    walls = [Body(np.array([(a, c), (b, c), (b, d), (a, d)])) for (a, b), (c, d) in boxes]
    return grains, walls


def cooling_coefficients(gas: Gas, seed: int) -> tuple[float, float, float]:
    """Measured over theory: collision frequency, cooling rate; and processor seconds.

    With s the rms speed of a component, 1 / s grows by loss w / (2 s) a second, which is constant: the cooling rate is
    from a straight line through LOOKS values. w / s is from the meetings between the first and the last look, over the
    time integral of the speed on that line.
    """
    grains, walls = _granules(gas, seed)
    times = np.linspace(gas.seconds(MIXED), gas.seconds(MIXED + WATCHED), LOOKS)
    begun, speeds, met = time.process_time(), np.zeros(LOOKS), np.zeros(LOOKS)
    for look, until in enumerate(times):
        tracks = track(
            None, grains, until=float(until), forces=("gravity",), gravity=(0.0, 0.0), bodies=walls, workers=1,
            length=gas.side, collisions=Collisions(gas.side, gas.restitution, 0.0, step=0.1 * DIAMETER / SPEED),
        )  # fmt: skip
        assert tracks.meetings is not None
        speeds[look] = math.sqrt(float((tracks.velocity**2).mean()))
        met[look] = tracks.meetings.mean()
    seconds = time.process_time() - begun
    slope, start = np.polyfit(times - times[0], 1.0 / speeds, 1)
    way = math.log1p(slope / start * (times[-1] - times[0])) / slope  # the time integral of the speed
    unit = gas.frequency(1.0)
    return float(met[-1] - met[0]) / (unit * way), float(2.0 * slope) / (gas.loss * unit), seconds


def cooling_row(gas: Gas, replicates: int) -> dict[str, Any]:
    """Both ratios, (value, low, high) with 95 % intervals over the replicates, and the seconds of all."""
    found = np.array([cooling_coefficients(gas, seed) for seed in range(replicates)])
    frequency, rate = (mean_interval(found[:, i]) for i in (0, 1))
    return {
        "restitution": gas.restitution, "filled": gas.filled, "granules": gas.count, "frequency": frequency,
        "cooling": rate, "loss": gas.loss, "seconds": float(found[:, 2].sum()),
    }  # fmt: skip
