"""The feed funnel's proofs: a bead on a vibrating plate, and the discharge against Beverloo's law, step, stiffness.

It needs LIGGGHTS. Every bed and discharge is cached, so that an interrupted study can go on.

One bead on a vibrating plate: the funnel's engine, contact law and moving walls, where the exact answer is known.

The plate moves as z = a sin(omega t), Gamma = a omega^2 / g. A bead that lies on it leaves where the plate's
acceleration falls below -g: sin(phase) = 1 / Gamma. A bead that bounces once a period T meets the plate with the speed
gT / 2 in the laboratory, at the phase cos(phase) = pi (1 - e) / ((1 + e) Gamma): the rebound (1 + e) w + e gT / 2, w
the plate's speed, must send it up with gT / 2 again. That orbit exists above Gamma = pi (1 - e) / (1 + e), and stable
up to sqrt((pi (1 - e) / (1 + e))^2 + (2 (1 + e^2) / (1 + e)^2)^2) (Luck & Mehta 1993, Phys. Rev. E 48, 3988).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.report import NOTHING, Column, Report, Row, Table, Tell, mean_interval
from wakeflow.core.record import to_json
from wakeflow.core.store import Store, cache_root
from wakeflow.extras.funnel.engine import run_script, write_beads, write_settings, write_triangles
from wakeflow.extras.funnel.pour import Liggghts, contact_settings, steps_of
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


def write_plate(folder: Path, size: float) -> None:
    """Write ``plate.stl``, a level square at z = 0 with sides of 2 ``size`` (m)."""
    corners = size * np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
    write_triangles(folder / "plate.stl", "plate", [corners[[0, 1, 2]], corners[[0, 2, 3]]])


def on_plate(
    funnel: Funnel, folder: Path, periods: int, *, height: float = 0.0, speed: float = 0.0, every: int = 1
) -> Contacts:
    """Follow one bead of size ``funnel.low`` on a plate that moves as the ``funnel`` does, for so many ``periods``.

    It begins ``height`` (m) above the plate's middle position, upwards at ``speed`` (m/s); one step in ``every`` is
    kept. Raises ProgramError as LIGGGHTS does.
    """
    steps, omega = steps_of(funnel), 2 * math.pi * funnel.frequency
    folder.mkdir(parents=True, exist_ok=True)
    write_plate(folder, SIZE)
    highest = height + 0.01 + 4 * funnel.amplitude + (speed + 3 * omega * funnel.amplitude) ** 2 / GRAVITY
    box = np.array([(-SIZE, SIZE), (-SIZE, SIZE), (-2 * funnel.amplitude - 0.005, highest)])
    centre = np.array([[0.1 * SIZE, 0.2 * SIZE, 0.5 * funnel.low + height]])
    velocity = np.array([[0.0, 0.0, speed]])
    write_beads(folder, centre, np.array([funnel.low]), velocity, funnel.density, box)
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


BASE: dict[str, Any] = {"orifice": 0.0096, "count": 1000}  # an outlet of 8 diameters
MANY_BEADS = 3000  # beads: enough for several periods of 20 Hz
VIBRATIONS = ((20.0, (1.0, 2.0, 3.4)), (35.0, (1.0, 2.0, 3.4)))  # Hz and Gammas; the paper: 5 to 35 Hz, Gamma below 3.5
SEEDS = (0, 1, 2)
STEPS = (12, 25, 50)  # in a collision
MODULI = (5e6, 2e7, 8e7)
PLATES = (5e6, 5e7, 5e8)
TITLES = {
    "rates": "discharge against Beverloo's law",
    "steps": "error against the time step, steps in a collision",
    "moduli": "error against the softening",
    "large": "a larger bed, one pouring",
    "full": "the paper's 35 g",
}
NOTES = (
    "intervals: Student's from three pourings (seeds); above 1000 beads: the scatter within one discharge",
    "the paper's trend is not judged: its conclusion 3 and its discussion contradict each other",
)


def _over(law: str) -> Column:
    return lambda row: f"{row['rate'] / row[law]:.3f}" if row["rate"] and row[law] else NOTHING


RATES: dict[str, Column] = {
    "case": "{case}", "rate g/s": "{rate:.2f*1e3}", "95 % low": "{low:.2f*1e3}", "high": "{high:.2f*1e3}",
    "over Beverloo": _over("beverloo"), "with cone": _over("beverloo_cone"), "empty s": "{time_to_empty:.3f}",
    "beads left": "{left}", "overlap %": "{overlap:.1f*100}",
}  # fmt: skip
ON_PLATE: dict[str, Column] = {"Young's modulus Pa": "{modulus:.0e}"}
ON_PLATE |= {
    head: f"{{{key}:.4f}}, {{{key}_exact:.4f}}"
    for head, key in {
        "lift-off phase rad": "lift_off", "bounce phase rad": "bounce", "impact speed m/s": "impact",
        "e": "restitution",
    }.items()
}  # fmt: skip


def run_funnel(folder: Path, *, slow: bool, tell: Tell) -> Report:
    """Compute every row; ``slow``: 3000 beads as well, and the paper's 35 g. Raises ProgramError as LIGGGHTS does."""
    store = Store(cache_root())

    def discharge(**changes: Any) -> Row:
        funnel = Funnel(**{**BASE, **changes})
        row: Row = to_json(Liggghts().compute(funnel, lambda stage, key, work: store.make(stage, key, work)[0], tell))
        return row

    facts: dict[str, list[Row]] = {
        "plate": [_plate(folder / "plate", modulus, tell) for modulus in PLATES],
        "rates": [_row(name, [discharge(seed=seed, **how) for seed in SEEDS]) for name, how in _VIBRATIONS],
        "steps": [
            _row(f"{name}, {steps} steps", [discharge(steps_per_contact=steps, seed=s, **how) for s in SEEDS])
            for name, how in _STUDIED
            for steps in STEPS
        ],
        "moduli": [
            _row(f"{name}, {modulus:.0e} Pa", [discharge(youngs_modulus=modulus, seed=s, **how) for s in SEEDS])
            for name, how in _STUDIED
            for modulus in MODULI
        ],
    }
    if slow:
        facts["large"] = [_row(name, [discharge(count=MANY_BEADS, **how)]) for name, how in _VIBRATIONS]
        facts["full"] = [_row(name, [discharge(count=None, mass=0.035, **how)]) for name, how in _FULL]
    tables = [
        Table(f"{TITLES[key]} ({facts[key][0]['beads']} beads)", RATES, facts[key]) for key in TITLES if key in facts
    ]
    return Report("funnel", [Table("a bead on a plate: ours, exact", ON_PLATE, facts["plate"]), *tables], facts, NOTES)


_Cases = tuple[tuple[str, dict[str, Any]], ...]
_VIBRATIONS: _Cases = (
    ("at rest", {}),
    *(
        (f"{frequency:g} Hz, Gamma {gamma:g}", {"frequency": frequency, "gamma": gamma})
        for frequency, gammas in VIBRATIONS
        for gamma in gammas
    ),
)
_STUDIED: _Cases = (("at rest", {}), ("35 Hz, Gamma 2", {"frequency": 35.0, "gamma": 2.0}))
_FULL: _Cases = (
    ("35 g, 10 mm, at rest", {"orifice": 0.01}),
    ("35 g, 10 mm, 30 Hz, Gamma 2", {"orifice": 0.01, "frequency": 30.0, "gamma": 2.0}),
)


def _row(name: str, tables: Sequence[Row]) -> Row:
    """Means over pourings, and Student's interval of the rate."""
    rates = [table["rate"] for table in tables]
    mean = low = high = None
    if None not in rates:
        mean, low, high = mean_interval([rate["value"] for rate in rates])
        low, high = (low, high) if len(rates) > 1 else (rates[0]["low"], rates[0]["high"])
    keys = ("beverloo", "beverloo_cone", "time_to_empty", "packing", "time_step")
    means = {key: _mean([table[key] for table in tables]) for key in keys}
    worst = {key: max(table[key] for table in tables) for key in ("left", "overlap")}
    return {"case": name, "beads": tables[0]["beads"], "rate": mean, "low": low, "high": high, **means, **worst}


def _mean(values: Sequence[float | None]) -> float | None:
    """None where a pouring has no value: a flow that stopped has no rate."""
    return None if None in values else float(np.mean(np.array(values, dtype=float)))


def _plate(folder: Path, modulus: float, tell: Tell) -> Row:
    """A lying bead's lift-off and a bouncing one's orbit at Gamma 1.3 and 30 Hz, e = 0.5, against the exact answers."""
    tell(f"a bead on a plate, {modulus:.0e} Pa")
    gamma, e, frequency = 1.3, 0.5, 30.0
    funnel = Funnel(count=10, frequency=frequency, gamma=gamma, restitution=e, youngs_modulus=modulus)
    lying = on_plate(funnel, folder, 6)
    long = (lying.end - lying.start) > 0.3 / frequency
    phase, omega, up = bounce_phase(gamma, e), 2 * math.pi * frequency, GRAVITY / (2 * frequency)
    since = 1 / frequency - phase / omega
    height = funnel.amplitude * math.sin(phase) + up * since - GRAVITY * since**2 / 2
    bouncing = on_plate(funnel, folder, 20, height=height, speed=up - GRAVITY * since)
    return {
        "modulus": modulus, "lift_off": float(lying.phase(lying.pressed[long])[-1]),
        "lift_off_exact": lift_off_phase(gamma), "bounce": float(bouncing.phase(bouncing.middle).mean()),
        "bounce_exact": phase, "impact": float(-bouncing.before.mean()), "impact_exact": up,
        "restitution": float(bouncing.restitution.mean()), "restitution_exact": e,
    }  # fmt: skip
