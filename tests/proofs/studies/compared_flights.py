"""The flights by which kernel_speed compares two checkouts, and the process that flies them.

They use public names only, so that checkouts with other modules inside can be compared: this file is a program of its
own, run with one checkout's wakeflow on its path. Each flight takes some hundredths of a second.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

import wakeflow as wf

Array = NDArray[np.float64]
Flight = Callable[[], Any]

WIDTH, HEIGHT = 0.10, 0.30  # m, of the channel
BODY = 0.025  # m, half width of the rhombus in it
SPEED = 4.0  # m/s, of the air
PERIOD = 0.035  # s, of the waves in the wake
DENSITY, VISCOSITY = 1.2, 1.8e-5  # kg/m3, Pa s, of the air
SWING = (0.0, 1e-3)  # m, amplitude of the vibration
PACE = 2.0 / PERIOD  # Hz, of the vibration: a whole number of swings a period
KINDS: dict[str, dict[str, Any]] = {
    "heavy": {"diameter": 3e-3, "density": 1300.0, "inertia": 0.4},
    "chaff": {"diameter": 2e-3, "density": 150.0, "sphericity": 0.6, "drag_scale": 1.5},
    "dust": {"diameter": 2e-5, "density": 1500.0},
    "fine": {"diameter": 1e-6, "density": 1500.0},
}
ALL = ("drag", "gravity", "buoyancy", "pressure-gradient", "added-mass", "lift", "magnus")
RANDOM = ("drag", "gravity", "dispersion", "brownian")
COLUMNS = ("position", "velocity", "time", "spin", "fate", "steps", "impacts", "line", "evaluations")


def rhombus(half: float = BODY) -> Array:
    return np.array([(half, 0.0), (0.0, half), (-half, 0.0), (0.0, -half)])


def mesh(step: float) -> tuple[Array, NDArray[np.int64]]:
    """A channel with a rhombus in it, in triangles of about ``step`` (m) whose nodes are not in rows."""
    x = np.linspace(-WIDTH / 2, WIDTH / 2, round(WIDTH / step) + 1)
    y = np.linspace(-HEIGHT / 2, HEIGHT / 2, round(HEIGHT / step) + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inner = (np.abs(points) < [WIDTH / 2 - 1e-9, HEIGHT / 2 - 1e-9]).all(axis=1)
    points[inner] += np.random.default_rng(1).uniform(-0.25, 0.25, (int(inner.sum()), 2)) * step
    points = points[np.abs(points).sum(axis=1) > BODY + 0.6 * step]
    corner, share = rhombus(), np.linspace(0, 1, round(1.4 * BODY / step), endpoint=False)[:, None]
    sides = [a + share * (b - a) for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True)]
    points = np.concatenate([points, *sides])
    cells = np.asarray(Delaunay(points).simplices, dtype=np.int64)
    return points, cells[np.abs(points[cells].mean(axis=1)).sum(axis=1) > BODY]


def air(points: Array, phase: float) -> dict[str, Array]:
    """A smooth downward stream that stands still on the rhombus, and waves behind it."""
    x, y = points.T
    away = 1.0 - np.exp(-np.maximum(np.abs(points).sum(axis=1) - BODY, 0.0) / 0.01)
    behind = np.exp(-((x / 0.03) ** 2)) / (1.0 + np.exp(y / 0.01))
    wave = 2 * np.pi * (y / 0.08 + phase)
    velocity = np.stack([1.2 * behind * np.sin(wave), -SPEED + 2.0 * behind * (1.0 + 0.3 * np.cos(wave))], axis=1)
    return {
        "velocity": away[:, None] * velocity,
        "pressure": 5.0 * behind * np.cos(wave),
        "k": 0.02 + 0.4 * behind * (1.0 + 0.2 * np.sin(wave)),
        "dissipation": 3.0 + 20.0 * behind,
    }


def fields() -> dict[str, Any]:
    """The air: none, steady, snapshots, a smooth period, and both smooth ones on a mesh that swings."""
    points, cells = mesh(5e-3)
    gas = {"density": DENSITY, "viscosity": VISCOSITY}
    steady = wf.FlowField.from_arrays(points, cells, **air(points, 0.0), **gas)
    times = PERIOD * np.arange(16) / 16
    shots = [air(points, t / PERIOD) for t in times]
    parts = {name: np.stack([shot[name] for shot in shots]) for name in shots[0]}
    waves = wf.FlowField.from_arrays(points, cells, **parts, times=times, period=PERIOD, **gas)
    smooth = waves.compressed(1e-3)
    omega = 2 * np.pi * PACE
    return {
        "vacuum": None, "steady": steady, "snapshots": waves, "smooth": smooth,
        "swinging": steady.moving(SWING, omega, 0.3), "smooth swinging": smooth.moving(SWING, omega, 0.3),
    }  # fmt: skip


def shower(kind: str, count: int, **more: Any) -> Any:
    """Granules that enter above the rhombus at about the air's speed, at times spread over a period."""
    rng = np.random.default_rng(7)
    place = np.stack([rng.uniform(-0.03, 0.03, count), rng.uniform(0.05, 0.1, count)], axis=1)
    speed = np.stack([rng.uniform(-0.2, 0.2, count), rng.uniform(-4.0, -1.0, count)], axis=1)
    own = {"restitution": 0.5, "friction": 0.2, **KINDS[kind], **more}
    return wf.Granules(place, speed, time=rng.uniform(0, PERIOD, count), **own)


def motions() -> dict[str, Any]:
    """The rhombus' vibration: none, harmonic, by samples."""
    t = np.array([0.0, 0.01, 0.03, 0.04, 0.06])
    return {
        "rest": None,
        "harmonic": wf.Motion(SWING, PACE, 0.3),
        "samples": wf.Motion.sampled(t, [0.0, 60.0, -40.0, -50.0, 0.0], (0.1, 1.0)),
    }


def scene(field: Any, grains: Any, body: Any = None, **how: Any) -> Flight:
    """A flight past the rhombus and between the channel's walls to the bins below."""
    side, low, high = WIDTH / 2, -HEIGHT / 2, HEIGHT / 2
    walls = [
        wf.Body(np.array([(-side, low), (-side, high)]), open=True, restitution=0.3),
        wf.Body(np.array([(side, high), (side, low)]), open=True, friction=0.5),
    ]
    bins = [np.array([(-side, low), (0.0, low)]), np.array([(0.0, low), (side, low)])]
    given = {"until": 0.6, "tolerance": 1e-3, "workers": 1, "seed": 5, **how}
    bodies = [wf.Body(rhombus(), motion=body), *walls]
    return lambda: wf.track(field, grains, bodies=bodies, lines=bins, length=2 * BODY, **given)


def contact(kind: str) -> Flight:
    """Flights in a vacuum that are mostly contact: a notch that shakes, one that does not, and rolling on slopes."""
    notch = np.array([(-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (0.0, 0.0), (-0.02, 0.02)])
    count = 256
    place = np.stack([np.linspace(-0.018, 0.018, count), np.full(count, 0.06)], axis=1)
    law = wf.Restitution("power", value=0.5, at=1.0) if kind == "rolling" else 0.3
    grains = wf.Granules(
        place, np.zeros((count, 2)), diameter=2e-3, density=1e3, restitution=law, friction=0.6,
        inertia=0.4 if kind == "rolling" else None,
    )  # fmt: skip
    moved = motions()
    body = {
        "notch": wf.Body(notch, motion=moved["harmonic"]), "sampled notch": wf.Body(notch, motion=moved["samples"]),
        "notch at rest": wf.Body(notch), "rolling": wf.Body(rhombus(0.02), motion=moved["harmonic"]),
        "captured": wf.Body(rhombus(0.02), motion=moved["samples"], capture=True),
    }[kind]  # fmt: skip
    floor = [np.array([(-1.0, -0.1), (1.0, -0.1)])]
    return lambda: wf.track(None, grains, until=0.6, tolerance=1e-4, bodies=[body], lines=floor, workers=1)


def flights() -> dict[str, Flight]:
    """All flights by name; each takes some hundredths of a second."""
    known, moved = fields(), motions()
    found: dict[str, Flight] = {}
    for kind, count in (("heavy", 400), ("chaff", 300), ("dust", 120), ("fine", 80)):
        some, few = shower(kind, count), 3 if kind == "fine" else count // 4
        found[f"{kind}, steady, loose"] = scene(known["steady"], some)
        found[f"{kind}, steady, tight"] = scene(known["steady"], some[: count // 2], tolerance=1e-5)
        found[f"{kind}, smooth"] = scene(known["smooth"], some)
        found[f"{kind}, smooth swinging"] = scene(known["smooth swinging"], some[:few], moved["harmonic"])
    heavy, chaff, dust = shower("heavy", 200), shower("chaff", 200), shower("dust", 60)
    found |= {
        "chaff, snapshots": scene(known["snapshots"], chaff),
        "dust, snapshots, tight": scene(known["snapshots"], dust, tolerance=1e-5),
        "heavy, vibrating wall": scene(known["steady"], heavy, moved["harmonic"]),
        "chaff, vibrating wall, smooth": scene(known["smooth"], chaff, moved["harmonic"]),
        "dust, sampled wall": scene(known["steady"], dust, moved["samples"]),
        "chaff, swinging, rest": scene(known["swinging"], chaff[:100]),
        "heavy, all forces": scene(known["steady"], heavy, forces=ALL),
        "chaff, all forces, smooth": scene(known["smooth"], chaff[:100], forces=ALL),
        "dust, all forces, swinging": scene(known["smooth swinging"], dust[:40], moved["harmonic"], forces=ALL),
        "chaff, random": scene(known["steady"], chaff[:10], forces=RANDOM),
        "dust, random, smooth": scene(known["smooth"], dust[:30], forces=RANDOM),
        "dust, random, swinging": scene(known["smooth swinging"], dust[:30], moved["harmonic"], forces=RANDOM),
        "fine, random, snapshots": scene(known["snapshots"], shower("fine", 20), forces=RANDOM),
        "chaff, pressure": scene(known["steady"], chaff, forces=("drag", "gravity", "buoyancy", "pressure-gradient")),
        "chaff, confined": scene(known["steady"], chaff, march=False),
        "chaff, drawn": scene(known["steady"], chaff[:60], record=64),
    }
    for kind in ("notch", "sampled notch", "notch at rest", "rolling", "captured"):
        found[f"contact, {kind}"] = contact(kind)
    return found


def child() -> None:
    """Answer each line ``{"name": .., "save": path or null}`` by the processor time (s) of that flight."""
    known = flights()
    print(json.dumps(list(known)), flush=True)
    for line in sys.stdin:
        told = json.loads(line)
        start = time.process_time()
        tracks = known[told["name"]]()
        spent = time.process_time() - start
        if told["save"]:
            kept = {name: getattr(tracks, name) for name in COLUMNS}
            if tracks.recorded:
                kept["recorded"] = np.concatenate(tracks.recorded)
            np.savez(told["save"], **kept)
        print(json.dumps(spent), flush=True)


if __name__ == "__main__":
    child()
