"""Scenes whose shares begin only beyond some restitution, speed or place: skewed answers whose truth is a closed form.

A divider stands where hardly any granules of the first fraction land at the numbers as given, so that its shares are
hockey sticks of the unknown inputs. A plate is a rhombus or a prism, at rest or shaken slowly, with granules of
``impact = "paper"`` in a vacuum; or there is no body, and air at rest or in uniform motion with Stokes' drag. The
uncertainty of every number is stated. What a draw of the inputs is follows docs/uncertainty.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.coverage.closed_form import Curtain, Granule, Machine, Slope, Stream, as_drawn, places, shares
from wakeflow.scene import Scene

Array = NDArray[np.float64]
Tables = dict[str, Any]
Bins = dict[str, tuple[float, float]]
SEED = 20261127
FRACTIONS = ("grain", "chaff")
SIGMAS, FARTHEST = 1.959964, 2.5  # standard deviations to the end of a 95 % interval, and at which a draw is cut off
LEAST_FACTOR = 1e-3
HALF = 1.0  # m, of a channel so wide that nothing comes to its walls
CALM = 1e-3  # turbulence of air that moves, the least that there can be: it shifts granules by 0.3 mm at most
FEW = 2000  # granules that say where dividers go
COUNT, TOLERANCE = 2048, 1e-3  # granules a fraction that the program flies, and its steps in body widths
KINDS = (  # how a machine stands, and what it is; about the top: granules fall to both sides of it
    "rhombus", "shaken prism", "still air", "about the top, rhombus", "prism",
    "moving air", "about the top, prism", "shaken rhombus", "rhombus", "prism",
)  # fmt: skip
TAILS = ((0.003, 0.2), (0.003, 0.2), (0.8, 0.98), (0.3, 0.7))  # how much of the grain flies past the first divider
OF_GRANULES = ("restitution", "friction", "size", "density", "terminal_velocity")
FACTORS = ("size", "density", "terminal_velocity")  # numbers that a draw changes by a factor of the closed form


@dataclass(frozen=True)
class Design:
    """A machine with its bins."""

    machine: Machine
    bins: Bins
    curtain: Curtain
    granules: Mapping[str, Granule]

    def shares(self, drawn: Mapping[str, float], count: int) -> dict[str, dict[str, float]]:
        """Of each fraction by bin, of ``count`` granules, where the inputs are as ``drawn``, by their keys."""
        return self.divided([self.bins], drawn, count)[0]

    def divided(
        self, many: list[Bins], drawn: Mapping[str, float], count: int
    ) -> list[dict[str, dict[str, float]]]:  # fmt: skip
        """The same for several sets of bins under the same flights."""
        found: list[dict[str, dict[str, float]]] = [{} for _ in many]
        for name, granule in self.granules.items():
            start = f"fraction.{name}."
            own = {key.removeprefix(start): value for key, value in drawn.items()}
            landed = places(self.machine, *reversed(as_drawn(granule, self.curtain, own)), count)
            for one, bins in zip(found, many, strict=True):
                one[name] = shares(landed, bins)
        return found


@dataclass(frozen=True)
class Threshold:
    """A scene: its ``tables``, its ``design``, another design (``changes`` of the scene) to compare it with, the
    ``dividers`` that move (keys of the scene, SI) and the ``bins`` that this makes; of every input by its key the
    ``value`` and half of its 95 % interval.
    """

    name: str
    tables: Tables
    design: Design
    changes: Mapping[str, float]
    other: Design
    dividers: Mapping[str, float]
    moved: Bins
    inputs: Mapping[str, tuple[float, float]]

    @property
    def scene(self) -> Scene:
        """As the program takes it."""
        return Scene.parse(self.tables)

    @property
    def rung(self) -> str | None:
        """Nothing flies in air where there is none."""
        return "none" if isinstance(self.design.machine, Slope) else None

    def drawn(self, chance: np.random.Generator) -> dict[str, float]:
        """One draw of all inputs: normal, cut off, within what each can be; sizes and the like as factors."""
        made = {}
        for key, (value, half) in self.inputs.items():
            x = value + half / SIGMAS * float(np.clip(chance.standard_normal(), -FARTHEST, FARTHEST))
            last = key.rpartition(".")[2]
            if last == "restitution":
                x = min(max(x, 0.0), 1.0)
            elif last != "position":
                x = max(x, LEAST_FACTOR * value)
            made[key] = x / value if last in FACTORS else x
        return made

    def scene_at(self, drawn: Mapping[str, float]) -> Scene:
        """The scene with the ``drawn`` numbers in its tables: what the closed form says of that draw."""
        changes = {key: x for key, x in drawn.items() if key.rpartition(".")[2] not in FACTORS}
        for name, granule in self.design.granules.items():
            start = f"fraction.{name}"
            if f"{start}.size" in drawn:
                size = drawn[f"{start}.size"]
                changes |= {f"{start}.size.low": granule.low * size, f"{start}.size.high": granule.high * size}
                changes[f"{start}.density"] = granule.density * drawn[f"{start}.density"]
        return self.scene.replace(changes)

    @property
    def mass(self) -> dict[str, float]:
        """Share of the feed's mass of each fraction."""
        return {name: one["mass_share"] for name, one in self.tables["fraction"].items()}

    @property
    def targets(self) -> dict[str, list[str]]:
        """Bins where each fraction should land."""
        return {name: one["target"] for name, one in self.tables["fraction"].items()}


def threshold_scenes(count: int) -> Iterator[Threshold]:
    """``count`` scenes, the kinds in turn; number n is the same whatever the count."""
    for number in range(count):
        chance = np.random.default_rng([SEED, number])
        kind = KINDS[number % len(KINDS)]
        air = kind.endswith("air")
        machine, curtain = _stream(kind, chance) if air else _slope(kind, chance)
        granules = {name: (_fine if air else _hard)(chance, name) for name in FRACTIONS}
        yield _scene(f"{number} {kind}", machine, curtain, granules, chance)


def _between(chance: np.random.Generator, low: float, high: float) -> float:
    return float(chance.uniform(low, high))


def _slope(kind: str, chance: np.random.Generator) -> tuple[Slope, Curtain]:
    """A body and its curtain: shaken ones are hit near the lower end, where few granules come back to the face."""
    shaken, shape = kind.startswith("shaken"), kind.split()[-1]
    angle = math.radians(_between(chance, 38.0, 52.0))
    omega = 2.0 * math.pi * _between(chance, 8.0, 14.0) if shaken else 0.0
    amplitude = _between(chance, 0.12, 0.3) / omega if shaken else 0.0
    height = _between(chance, 0.05, 0.15)
    slope = Slope(shape, 0.05, angle, -_between(chance, 0.1, 0.2), amplitude, omega)
    if kind.startswith("about"):
        return slope, Curtain(_between(chance, 0.02, 0.04), 0.0 if shape == "prism" else 0.002, height)
    place = _between(chance, 0.014, 0.019) if shaken else _between(chance, 0.01, 0.013)
    return slope, Curtain(_between(chance, 0.006, 0.012 if shaken else 0.02), place, height)


def _stream(kind: str, chance: np.random.Generator) -> tuple[Stream, Curtain]:
    speed = 0.0 if kind.startswith("still") else _between(chance, 0.5, 1.5)
    stream = Stream(speed, 0.1, _between(chance, -0.6, 0.3), -_between(chance, 0.1, 0.25))
    return stream, Curtain(_between(chance, 0.005, 0.02), -0.1, speed=_between(chance, 0.8, 2.0))


def _hard(chance: np.random.Generator, name: str) -> Granule:
    """Granules that rebound: the grain mostly more than the chaff."""
    low, high = (0.35, 0.55) if name == "grain" else (0.3, 0.45)
    return Granule(_between(chance, low, high), _between(chance, 0.15, 0.5))


def _fine(chance: np.random.Generator, name: str) -> Granule:
    """Granules that the air slows."""
    middle = _between(chance, 120e-6, 200e-6) if name == "grain" else _between(chance, 100e-6, 170e-6)
    wide = _between(chance, 0.05, 0.4) * middle
    density = round(_between(chance, 900.0, 2500.0))
    return Granule(low=middle - wide, high=middle + wide, density=density)


def _scene(
    name: str, machine: Machine, curtain: Curtain, granules: dict[str, Granule], chance: np.random.Generator
) -> Threshold:  # fmt: skip
    inputs = _inputs(machine, curtain, granules, chance)
    one, two = _dividers(machine, curtain, granules, chance)
    left = -one if name.split()[1] == "about" else min(one, curtain.position) - 0.05
    bins = _bins(left, one, two)
    shift = _between(chance, 0.1, 0.5) * (two - one) * (1.0 if chance.random() < 0.5 else -1.0)
    shift = max(shift, 0.5 * (left - one))
    dividers = {"bin.near.to": one + shift, "bin.middle.from": one + shift}
    design = Design(machine, bins, curtain, granules)
    moved = _bins(left, one + shift, two)
    if chance.random() < 0.5 or isinstance(machine, Stream):
        changes, other = dividers, replace(design, bins=moved)
    else:
        turned = machine.angle + math.radians(_between(chance, -3.0, 3.0))
        changes = {"body.one.slope_angle": turned}
        other = replace(design, machine=replace(machine, angle=turned))
    tables = _tables(design, inputs, chance)
    return Threshold(name, tables, design, changes, other, dividers, moved, inputs)


def _bins(left: float, one: float, two: float) -> Bins:
    return {"left": (-HALF, left), "near": (left, one), "middle": (one, two), "far": (two, HALF)}


def _dividers(
    machine: Machine, curtain: Curtain, granules: dict[str, Granule], chance: np.random.Generator
) -> tuple[float, float]:
    """Where the bin in the middle begins and ends: it begins where a tail of the grain lands farther, to the right."""
    x, width = places(machine, curtain, granules["grain"], FEW)
    x = np.sort(x[x > 0.0] if isinstance(machine, Slope) else x)
    low, high = TAILS[chance.integers(len(TAILS))]
    first = float(np.quantile(x, 1.0 - math.exp(_between(chance, math.log(low), math.log(high)))))
    first += _between(chance, 0.2, 0.5) * width
    return first, first + _between(chance, 0.1, 0.6) * max(float(x[-1] - x[0]) + width, 0.01)


def _inputs(
    machine: Machine, curtain: Curtain, granules: dict[str, Granule], chance: np.random.Generator
) -> dict[str, tuple[float, float]]:
    """Every unknown: its value, and half of its 95 % interval."""
    found = {"feed.width": (curtain.width, _between(chance, 0.05, 0.2) * curtain.width)}
    found["feed.position"] = curtain.position, _between(chance, 0.2e-3, 1.5e-3)
    if isinstance(machine, Stream):
        found["feed.speed"] = curtain.speed, _between(chance, 0.02, 0.06) * curtain.speed
        if machine.speed > 0.0:
            found["air.speed"] = machine.speed, _between(chance, 0.02, 0.1) * machine.speed
    else:
        found["feed.height"] = curtain.height, _between(chance, 0.02, 0.1) * curtain.height
    for name, one in granules.items():
        start = f"fraction.{name}"
        if isinstance(machine, Stream):
            for key, value in (("size", 0.5 * (one.low + one.high)), ("density", one.density)):
                found[f"{start}.{key}"] = value, _between(chance, 0.02, 0.08) * value
        else:
            found[f"{start}.restitution"] = one.restitution, _between(chance, 0.02, 0.1)
            found[f"{start}.friction"] = one.friction, _between(chance, 0.05, 0.3) * one.friction
    return found


def _tables(design: Design, inputs: Mapping[str, tuple[float, float]], chance: np.random.Generator) -> Tables:
    """What the program is asked."""
    machine, curtain = design.machine, design.curtain
    feed: Tables = {"width": curtain.width, "position": curtain.position, "count": COUNT,
                    "seed": int(chance.integers(1000))}  # fmt: skip
    tables: Tables = {
        "channel": {"width": 2.0 * HALF, "top": 0.3, "bottom": machine.floor}, "feed": feed,
        "numerics": {"tolerance": TOLERANCE},
        "bin": {name: {"from": low, "to": high} for name, (low, high) in design.bins.items()},
        "uncertainty": {**_exact(machine), **{key: half for key, (_, half) in inputs.items()}},
    }  # fmt: skip
    share = round(_between(chance, 0.3, 0.8), 2)
    tables["fraction"] = {
        name: {**_granule(machine, one), "mass_share": part, "target": target}
        for (name, one), part, target in zip(
            design.granules.items(), (share, 1.0 - share), (["middle", "far"], ["left", "near"]), strict=True
        )
    }
    if isinstance(machine, Slope):
        tables["body"] = {"one": {"shape": machine.shape, "width": machine.width, "slope_angle": machine.angle}}
        feed["height"] = curtain.height
        if machine.omega:
            tables["vibration"] = {"frequency": machine.omega / (2.0 * math.pi), "amplitude": machine.amplitude}
        return tables
    feed |= {"speed": curtain.speed, "direction": machine.angle, "level": machine.level}
    tables["air"] = {"speed": machine.speed, "turbulence": CALM}
    tables["force"] = {"collisions": False, "air-loading": False, "magnus": True, "dispersion": machine.speed > 0.0}
    return tables


def _exact(machine: Machine) -> dict[str, float]:
    """Numbers that are known exactly: those that a closed form does without."""
    if isinstance(machine, Slope):
        return {f"fraction.{name}.size": 0.0 for name in FRACTIONS}
    known = ("restitution", "friction", "terminal_velocity", "inverse_inertia")
    air = dict.fromkeys(("spin_lift", "dispersion", "air.turbulence"), 0.0)
    return {**air, **{f"fraction.{name}.{key}": 0.0 for name in FRACTIONS for key in known}}


def _granule(machine: Machine, one: Granule) -> Tables:
    """A point mass on a slope; in air, where it meets nothing, a sphere, so that nothing is unknown of its spin."""
    made: Tables = {"restitution": one.restitution, "friction": one.friction, "density": one.density}
    if isinstance(machine, Slope):
        return made | {"impact": "paper", "size": one.diameter}
    size = {"distribution": "uniform", "low": one.low, "high": one.high}
    return made | {"impact": "sphere", "size": size, "drag": "stokes"}
