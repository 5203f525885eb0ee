"""A fan and what it pushes the air through: the flow at which its pressure is what the machine takes.

The machine's part is quadratic in the flow, but for the weight of the feed that the air bears. The flow is looked for
in rows of flows, each row inside one step of the row before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number
from ..core.quantities import say
from ..core.record import column

Array = NDArray[np.float64]
OfFlow = Callable[[Array], Array]  # Pa at flows (n,) m3/s
BLUNT = 2.2  # loss of a bluff body over b / (1 - b)^2, b the part of the channel that it takes: between the 1.0 of a
# cylinder (b = 0.05) and the 6 of a zigzag (0.38); rhombus 2.3 (0.13), prism 3.3 (0.25), labyrinth 3.1. Computed here
OFF = 3.0  # by which factor that may be off, as these are
FLOWS, ROWS = 257, 4  # of a row, and rows: the flow is found to the 256^4th part of the range
HOUR = 3600.0  # s
PRESSURE_ROUNDING = 1e-12  # of the fan's pressure: rounding
STEPS, HANGING = 60, 10  # of a crossing of the channel; crossings after which a granule is taken to hang in the air


@dataclass(frozen=True)
class FanPoint:
    """Where a fan's curve meets the machine's pressure drop."""

    speed: Number = column("m/s", "mean of the air in the channel; from the least to the largest drop of the channel")
    flow: float = column("m3/s", "flow through the fan")
    pressure: float = column("Pa", "pressure that the fan gives")
    channel: float = column("Pa", "part of that for the channel and its bodies")
    rest: float = column("Pa", "part of that for what else the air passes")
    feed: float = column("Pa", "part for the weight of the feed that the air bears; negative where that drives it")
    others: int = column("1", "lower flows at which the curves meet too: there the fan may stall, or the feed settle")

    @property
    def words(self) -> str:
        """Where they meet, and what the drop is made of."""
        speed = say(self.speed.value, "m/s", 3)
        if self.speed.low != self.speed.high:
            ends = f"{self.speed.low:.3g} to {self.speed.high:.3g}"
            speed += f" ({ends} with {OFF:g} times, or a {OFF:g}rd, of the channel's estimated drop; a run computes it)"
        parts = [
            f"{say(drop, 'Pa', 3)} for {what}"
            for what, drop in (("the channel", self.channel), ("the rest", self.rest), ("the feed", self.feed))
            if drop
        ]
        of_which = f", of which {', '.join(parts)}" if parts else ""
        return f"{speed} at {HOUR * self.flow:.4g} m3/h and {say(self.pressure, 'Pa', 3)}{of_which}"


def bluff_loss(blocked: Array) -> float:
    """Loss coefficient on the channel's mean speed of bodies one behind the other, each of which takes a part
    ``blocked`` (k,) of the channel's width: right within a factor OFF.
    """
    return float(BLUNT * np.sum(blocked / (1.0 - blocked) ** 2))


def meeting(gives: OfFlow, takes: OfFlow, most: float) -> tuple[float, int]:
    """The largest flow (m3/s) up to ``most`` at which what a fan ``gives`` is what the machine ``takes``, and at how
    many lower ones the two are equal as well. A fan that runs before it is fed comes down to the largest.

    Raises ValueError where they are equal nowhere, saying which of them is larger.
    """
    low, high, others, nothing = 0.0, most, 0, PRESSURE_ROUNDING * float(gives(np.zeros(1)).max())
    for row in range(ROWS):
        flows = np.linspace(low, high, FLOWS)
        left = gives(flows) - takes(flows)
        falls = np.flatnonzero((left[:-1] > nothing) & (left[1:] <= nothing))
        if row == 0:
            if left[-1] > nothing:
                raise ValueError(f"at its end, {most:.4g} m3/s, the fan still gives {left[-1]:.3g} Pa too much")
            if not len(falls):
                raise ValueError(f"the fan gives at least {-left.max():.3g} Pa too little at every flow")
            others = 2 * (len(falls) - 1) + int(left[0] <= nothing)
        low, high = flows[falls[-1]], flows[falls[-1] + 1]
    return float(low + high) / 2.0, others


def borne(settling: Array, air: Array, start: float, down: float, up: float, gravity: float) -> Array:
    """Velocity (n, k) m/s that drag takes from granules between their entry and the channel's end: their weight over
    their mass, times the time, less what they gained. Of granules of terminal velocity ``settling`` (k,) in ``air``
    (n,) m/s, which begin with ``start``; ``down`` and ``up`` (m) to the ends. Downward is positive.

    Drag as of turbulent flow, with the square of the slip. Exponential steps with the drag of their beginning: exact
    at the terminal velocity, else good to about 1 %.
    """
    slowest = np.minimum(np.sqrt(2.0 * down / gravity), down / np.maximum(np.abs(air), 1e-6))
    step = np.broadcast_to((slowest / STEPS)[:, None], (len(air), len(settling)))
    wind, speed = np.broadcast_to(air[:, None], step.shape), np.full(step.shape, start)
    time, way, inside = np.zeros(step.shape), np.zeros(step.shape), np.ones(step.shape, dtype=bool)
    for _ in range(STEPS * HANGING):
        slip = np.maximum(np.abs(speed - wind), 1e-6 * settling)
        tau = settling**2 / (gravity * slip)
        final, left = wind + gravity * tau, np.exp(-step / tau)
        further = final * step + (speed - final) * tau * (1.0 - left)
        ahead = np.where(further > 0.0, down - way, up + way) / np.maximum(np.abs(further), 1e-30)
        part = np.clip(ahead, 0.0, 1.0)  # of the last step, up to the end
        speed = speed + np.where(inside, part * (final - speed) * (1.0 - left), 0.0)
        way += np.where(inside, part * further, 0.0)
        time += np.where(inside, part * step, 0.0)
        inside &= ahead > 1.0
        if not inside.any():
            break
    return np.asarray(gravity * time - (speed - start))
