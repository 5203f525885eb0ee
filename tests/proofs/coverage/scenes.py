"""Varied scenes whose truth is known, in groups: drawn at random, the same ones every time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.coverage.stored_air import StoredFlow, oval
from wakeflow.scene import Scene

Array = NDArray[np.float64]
SEED = 7
WIDTH = 0.05  # m, of the bodies
SINGLE = {"collisions": False, "air-loading": False, "vibration-of-the-air": False}
# No plan knows the swirl of stored cells: what depends on how the air changes is switched on, not bounded
IN_SWIRL = {"lift": True, "pressure-gradient": True, "basset-history": True}
TOLERANCE = 1e-3  # body widths: granules land within a hundredth of what their inputs move them
BINS, MIN_BIN = 4, 0.02  # of the floor; their least width, in half channels
OVALS = (0.01, 0.03)  # strengths of the dipoles: bodies of about a tenth to a fifth of the channel
Tables = dict[str, Any]
Chance = np.random.Generator


@dataclass(frozen=True)
class VariedScene:
    """A scene, the ``group`` it is counted in, and the stored ``air`` in place of one that would have to be solved."""

    name: str
    group: str
    scene: Scene
    air: StoredFlow | None = None


def varied_scenes(count: int, *, seed: int = SEED) -> Iterator[VariedScene]:
    """``count`` scenes, the groups in turn; number n is the same whatever the count."""
    names = list(GROUPS)
    for number in range(count):
        group = names[number % len(names)]
        chance = np.random.default_rng([seed, number])
        tables, air = GROUPS[group](chance)
        tables["feed"] |= {"count": int(2 ** chance.integers(10, 12)), "seed": int(chance.integers(1000))}
        tables["numerics"] = {"tolerance": TOLERANCE} | tables.get("numerics", {})
        yield VariedScene(f"{group} {number}", group, Scene.parse(_floor(tables)), air)


# -- what they are made of ---------------------------------------------------------------------------------------------


def _between(chance: Chance, low: float, high: float) -> float:
    return float(chance.uniform(low, high))


def _log(chance: Chance, low: float, high: float) -> float:
    return float(math.exp(chance.uniform(math.log(low), math.log(high))))


def _channel(width: float = 0.5) -> Tables:
    return {"width": width, "top": 0.15, "bottom": -0.2}


def _feed(chance: Chance, width: tuple[float, float] = (0.005, 0.04)) -> Tables:
    beside = _between(chance, -0.4, 0.4) * WIDTH if chance.random() < 0.5 else 0.0
    return {"height": _between(chance, 0.05, 0.2), "width": _between(chance, *width), "position": beside}


def _vibration(chance: Chance) -> Tables:
    return {"frequency": _between(chance, 15.0, 40.0), "gamma": _between(chance, 0.5, 3.0)}


def _floor(tables: Tables) -> Tables:
    """One bin that is the whole floor: where the dividers stand is decided when it is known where granules land."""
    half = 0.5 * tables["channel"]["width"]
    return tables | {"bin": {"floor": {"from": -half, "to": half}}}


def divided(one: VariedScene, landed: Mapping[str, Array]) -> VariedScene:
    """The scene with BINS bins in place of its floor, dividers among the places x (n,) m where granules of each
    fraction ``landed``, and a target for each fraction; at least MIN_BIN between two dividers.
    """
    chance = np.random.default_rng([one.scene.feed.seed, BINS])
    tables, half = one.scene.tables(), 0.5 * one.scene.channel.width
    every = [x for x in landed.values() if len(x)]
    dividers: list[float] = []
    for _ in range(BINS - 1):
        x = chance.choice(every[chance.integers(len(every))]) if every else chance.uniform(-half, half)
        x = float(np.clip(x + chance.normal() * 0.01 * half, -0.98 * half, 0.98 * half))
        if all(abs(x - other) > MIN_BIN * half for other in dividers):
            dividers.append(x)
    edges = [-half, *sorted(dividers), half]
    tables["bin"] = {f"bin-{i}": {"from": a, "to": b} for i, (a, b) in enumerate(itertools.pairwise(edges))}
    for fraction in tables["fraction"].values():
        fraction["target"] = f"bin-{chance.integers(len(edges) - 1)}"
    return replace(one, scene=Scene.parse(tables))


def _fractions(chance: Chance, make: Callable[[Chance], Tables], count: int = 2) -> Tables:
    return {name: make(chance) for name in ("first", "second", "third")[:count]}


def _bouncing(chance: Chance) -> Tables:
    """Granules of which the scene says most numbers, some of them with how well they are known."""
    made: Tables = {
        "size": _log(chance, 0.5e-3, 5e-3),
        "density": _between(chance, 400.0, 2500.0),
        "restitution": _between(chance, 0.15, 0.8),
        "friction": _between(chance, 0.1, 0.6),
    }
    if chance.random() < 0.5:
        made["rebound_scatter"] = _between(chance, 0.02, 0.2)
    if chance.random() < 0.4:
        made["restitution"] = {"value": made["restitution"], "uncertainty": _between(chance, 0.01, 0.15)}
    return made


def _grain(chance: Chance) -> Tables:
    """Granules of a built-in material."""
    material = str(chance.choice(["wheat", "barley", "rapeseed", "glass-beads"]))
    return {"material": material, "size": _log(chance, 1e-3, 5e-3)}


def _airborne(chance: Chance) -> Tables:
    """Granules that air moves: from dust to light grain, of one size or of many; spheres, whose spin is known."""
    median = _log(chance, 30e-6, 1.5e-3)
    made = _bouncing(chance) | {"size": median, "impact": "sphere"}
    if chance.random() < 0.6:
        spread = _between(chance, 1.1, 1.5)
        made["size"] = {"distribution": "lognormal", "median": median, "geometric_std": spread}
    return made


def _air(chance: Chance, direction: str, speed: tuple[float, float] = (1.0, 5.0)) -> Tables:
    return {"speed": _between(chance, *speed), "direction": direction, "turbulence": _between(chance, 0.02, 0.1)}


def _vacuum(body: Callable[[Chance], Tables]) -> Callable[[Chance], tuple[Tables, StoredFlow | None]]:
    def made(chance: Chance) -> tuple[Tables, StoredFlow | None]:
        kind = _grain if chance.random() < 0.3 else _bouncing
        tables: Tables = {"body": {"one": body(chance)}, "channel": _channel(), "feed": _feed(chance)}
        tables["fraction"] = _fractions(chance, kind)
        if chance.random() < 0.6:
            tables["vibration"] = _vibration(chance)
        return tables, None

    return made


def _sloped(shape: str) -> Callable[[Chance], Tables]:
    return lambda chance: {"shape": shape, "width": WIDTH, "slope_angle": math.radians(_between(chance, 30.0, 60.0))}


def _polygon(chance: Chance) -> Tables:
    """A convex one of five to eight corners."""
    corners = int(chance.integers(5, 9))
    angle = 2.0 * np.pi * (np.arange(corners) + chance.uniform(0.1, 0.9, corners)) / corners
    points = 0.5 * WIDTH * np.stack([np.cos(angle), chance.uniform(0.6, 1.2) * np.sin(angle)], axis=1)
    return {"shape": "polygon", "points": points.tolist()}


def _in_air(scene: Tables, chance: Chance, flow: str, low: float, high: float, *, turbulent: bool) -> StoredFlow:
    scene["force"] = dict(SINGLE) | (IN_SWIRL if flow == "cells" else {})
    return StoredFlow(flow, _between(chance, low, high), scene["air"]["turbulence"] if turbulent else 0.0)


def _about_a_body(flow: str, *, turbulent: bool = False) -> Callable[[Chance], tuple[Tables, StoredFlow | None]]:
    def made(chance: Chance) -> tuple[Tables, StoredFlow | None]:
        amount = _between(chance, *OVALS)
        body = (
            {"shape": "polygon", "points": oval(amount, 0.4).tolist()} if flow == "potential"
            else _sloped(str(chance.choice(["rhombus", "prism"])))(chance)
        )  # fmt: skip
        tables: Tables = {"body": {"one": body}, "channel": _channel(0.4), "feed": _feed(chance)}
        tables["fraction"] = _fractions(chance, _airborne)
        tables |= {"air": _air(chance, "down"), "numerics": {"rung": "draft"}}
        ends = (amount, amount) if flow == "potential" else (0.0, 0.8)
        return tables, _in_air(tables, chance, flow, *ends, turbulent=turbulent)

    return made


def _without_body(flow: str | None, *, turbulent: bool = False) -> Callable[[Chance], tuple[Tables, StoredFlow | None]]:
    """A channel in which nothing stands: a jet of granules across air that falls or rises."""

    def made(chance: Chance) -> tuple[Tables, StoredFlow | None]:
        level, up = 0.1, chance.random() < 0.2
        feed = {"speed": _between(chance, 0.5, 2.0), "direction": _between(chance, -1.2, -0.2), "level": level}
        feed |= {"width": _between(chance, 0.01, 0.05), "position": -0.1}
        tables: Tables = {"channel": _channel(), "feed": feed, "fraction": _fractions(chance, _airborne)}
        tables["air"] = _air(chance, "up" if up else "down", (0.3, 0.8 if up else 3.0))
        tables["force"] = dict(SINGLE)
        if flow is None:
            tables["air"]["profile"] = "uniform" if turbulent else "parabolic"
            tables["channel"]["walls"] = "slip" if turbulent else "no-slip"
            return tables, None
        return tables, _in_air(tables, chance, flow, 0.2, 1.2, turbulent=turbulent)

    return made


GROUPS: dict[str, Callable[[Chance], tuple[Tables, StoredFlow | None]]] = {
    "vacuum, rhombus": _vacuum(_sloped("rhombus")),
    "vacuum, prism": _vacuum(_sloped("prism")),
    "vacuum, polygon": _vacuum(_polygon),
    "duct": _without_body(None),
    "duct, dispersion": _without_body(None, turbulent=True),
    "cells": _without_body("cells"),
    "cells, dispersion": _without_body("cells", turbulent=True),
    "potential flow": _about_a_body("potential"),
    "made wake": _about_a_body("wake"),
    "made wake, dispersion": _about_a_body("wake", turbulent=True),
}
