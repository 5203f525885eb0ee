"""The vibrating body in the air: the mesh moves with it along the channel, as one rigid piece."""

from __future__ import annotations

import math
from dataclasses import dataclass

SNAPSHOTS = 12  # a vibration, at least: the field between them is interpolated
ROUND_OFF = 1e-6  # rad: of a time that is meant to be whole vibrations
STEPS = 48  # time steps a vibration period, at least: a second-order step follows the motion to 0.3 % there


@dataclass(frozen=True)
class MeshMotion:
    """Harmonic motion of bodies and mesh along the channel: d(t) = (0, ``amplitude`` sin(``omega`` t)).

    ``amplitude`` m, ``omega`` rad/s, t the case's own clock (s). The ends of the channel move with the mesh: where air
    comes in uniform and leaves undisturbed, that changes nothing.
    """

    amplitude: float
    omega: float

    @property
    def period(self) -> float:
        """Length of a vibration (s)."""
        return 2.0 * math.pi / self.omega

    @property
    def peak_speed(self) -> float:
        """Largest speed of the body, a w (m/s)."""
        return self.amplitude * self.omega

    def displacement(self, time: float) -> float:
        """Where the mesh is at ``time`` (s), along y from its reference position (m)."""
        return self.amplitude * math.sin(self.omega * time)

    def speed(self, time: float) -> float:
        """Velocity of the mesh along y at ``time`` (s), in m/s."""
        return self.amplitude * self.omega * math.cos(self.omega * time)

    def cadence(self, longest: float) -> float:
        """Time between snapshots (s): at most ``longest``, a whole number of at least SNAPSHOTS a vibration."""
        return self.period / max(SNAPSHOTS, math.ceil(self.period / longest - 1e-9))

    def motion(self, begin: float) -> dict[str, list[float] | float]:
        """The motion against a clock that starts at ``begin`` (s): amplitude (x, y) m, omega rad/s, phase rad.

        Displacement at time t of that clock: amplitude sin(omega t + phase).
        """
        phase = math.remainder(self.omega * begin, 2.0 * math.pi)
        phase = 0.0 if abs(phase) < ROUND_OFF else phase
        return {"amplitude": [0.0, self.amplitude], "omega": self.omega, "phase": phase}

    def parameters(self) -> dict[str, str | float]:
        """What the case template leaves open for a moving mesh."""
        return {
            "bodyWall": "movingWallVelocity",
            "amplitude": self.amplitude,
            "omega": self.omega,
            "maxDeltaT": self.period / STEPS,
        }
