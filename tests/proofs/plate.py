"""One bead on a vibrating plate: the funnel's engine, contact law and moving walls, where the exact answer is known.

The plate moves as z = a sin(omega t), Gamma = a omega^2 / g. A bead that lies on it leaves where the plate's
acceleration falls below -g: sin(phase) = 1 / Gamma. A bead that bounces once a period T meets the plate with the speed
gT / 2 in the laboratory, at the phase cos(phase) = pi (1 - e) / ((1 + e) Gamma): the rebound (1 + e) w + e gT / 2, w
the plate's speed, must send it up with gT / 2 again. That orbit exists above Gamma = pi (1 - e) / (1 + e), and stable
up to sqrt((pi (1 - e) / (1 + e))^2 + (2 (1 + e^2) / (1 + e)^2)^2) (Luck & Mehta 1993, Phys. Rev. E 48, 3988).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakeflow.funnel.cone import write_plate
from wakeflow.funnel.engine import run_script, write_beads, write_settings
from wakeflow.funnel.pour import contact_settings, steps_of
from wakeflow.laws.constants import GRAVITY
from wakeflow.scene import Funnel

Array = NDArray[np.float64]
SIZE = 0.01  # m: of the plate
FORCELESS = 1e-5  # of the weight: a smaller force is round-off


@dataclass(frozen=True)
class Contacts:
    """Collisions (k,): when each begins, the plate last presses, it ends (s); ``before`` and ``after``: velocity (m/s).

    ``force`` (n,): the contact force over the bead's weight at ``time`` (n,) s. ``omega`` (rad/s) and ``speed`` a omega
    (m/s) of the plate. A contact lasts as long as there is a force; just before its end the damping pulls a little.
    """

    start: Array
    pressed: Array
    end: Array
    before: Array
    after: Array
    time: Array
    force: Array
    omega: float
    speed: float

    def phase(self, time: Array) -> Array:
        """Of the vibration at ``time`` (s), in [0, 2 pi)."""
        return np.mod(self.omega * time, 2 * math.pi)

    @property
    def middle(self) -> Array:
        """Times (k,) s of the middle of each contact."""
        return 0.5 * (self.start + self.end)

    @property
    def restitution(self) -> Array:
        """Departure over approach speed (k,), relative to the plate's speed in the middle of the contact; gravity's
        part is taken off.
        """
        wall = self.speed * np.cos(self.omega * self.middle)
        drop = GRAVITY * 0.5 * (self.end - self.start)
        return (self.after + drop - wall) / (wall - (self.before - drop))


def lift_off_phase(gamma: float) -> float:
    """Phase (rad) at which a lying bead leaves the plate, Gamma > 1."""
    return math.asin(1 / gamma)


def bounce_phase(gamma: float, restitution: float) -> float:
    """Phase (rad) at which a bead that bounces once a period meets the plate."""
    return math.acos(math.pi * (1 - restitution) / ((1 + restitution) * gamma))


def on_plate(
    funnel: Funnel, folder: Path, periods: int, *, height: float = 0.0, speed: float = 0.0, every: int = 1
) -> Contacts:
    """Follow one bead of size ``funnel.low`` on a plate that moves as the ``funnel`` does, for so many ``periods``.

    It begins ``height`` (m) above the plate's middle position, upwards at ``speed`` (m/s); one step in ``every`` is
    kept. Raises ProgramError as LIGGGHTS does.
    """
    assert funnel.frequency is not None
    steps, omega = steps_of(funnel), 2 * math.pi * funnel.frequency
    folder.mkdir(parents=True, exist_ok=True)
    write_plate(folder, SIZE)
    highest = height + 0.01 + 4 * funnel.amplitude + (speed + 3 * omega * funnel.amplitude) ** 2 / GRAVITY
    box = np.array([(-SIZE, SIZE), (-SIZE, SIZE), (-2 * funnel.amplitude - 0.005, highest)])
    centre = np.array([[0.1 * SIZE, 0.2 * SIZE, 0.5 * funnel.low + height]])
    velocity = np.array([[0.0, 0.0, speed]])
    write_beads(folder, centre, np.array([funnel.low]), velocity, funnel.bead_density, box)
    period = 1 / funnel.frequency
    settings = {"amplitude": funnel.amplitude, "period": period, "every": every, "turns": steps.of(periods * period)}
    write_settings(folder, contact_settings(funnel, steps) | settings)
    run_script(folder, Path(__file__).with_name("plate.liggghts"))
    time, _, v = np.loadtxt(folder / "path.txt").T
    return _contacts(time, v, omega, omega * funnel.amplitude)


def _contacts(time: Array, v: Array, omega: float, speed: float) -> Contacts:
    force = 1 + np.diff(v) / np.diff(time) / GRAVITY  # over the weight, from step i to i + 1
    touching = np.abs(force) > FORCELESS
    change = np.diff(touching.astype(int), prepend=0)
    start, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    pushes = np.array([(force[i:j] > 0).any() for i, j in zip(start, end, strict=False)], dtype=bool)
    start, end = start[: len(end)][pushes], end[pushes]  # a graze that only pulls is no contact
    pressed = np.array([i + int(np.flatnonzero(force[i:j] > 0)[-1]) for i, j in zip(start, end, strict=True)])
    return Contacts(time[start], time[pressed], time[end], v[start], v[end], time[:-1], force, omega, speed)
