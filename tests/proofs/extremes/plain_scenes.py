"""Rows of whole scenes that start no OpenFOAM: sorted in channels whose air is known, and refused."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from proofs.extremes.matrix import Happened, add_row
from wakeflow.answer.result import Result
from wakeflow.core.files import scene_templates
from wakeflow.core.record import JsonMapping
from wakeflow.flight.stages.compilation import COMPILED
from wakeflow.laws.constants import STANDARD_AIR
from wakeflow.laws.drag import terminal_velocity
from wakeflow.runs import run
from wakeflow.scene import Scene

OUT = Path("runs", "verify", "extremes")  # each row's run has a folder there
MIN_REPLICATES = 16  # replicates, whose granules are a power of two: what feed.count is rounded up to
PLAIN = {"restitution": 0.5, "friction": 0.3}
TRICKLE = 1e-9  # kg/s: a feed of granules each alone
WATER = {"air.density": 998.2, "air.viscosity": 1.002e-3}
Options = JsonMapping


@lru_cache
def shipped_scene(name: str) -> Scene:
    """A scene that the program ships."""
    return Scene.load(scene_templates()[name])


def happened_in(scene: Scene, result: Result, error: float | None, note: str = "") -> Happened:
    """What happened in the run of a ``scene``. Its time is that of all stages when they were computed, but for the
    compilation of the tracker.
    """
    assert result.flights is not None
    fates: Counter[str] = sum((Counter(counted) for counted in result.flights.fates.values()), Counter())
    fed = MIN_REPLICATES * 2 ** math.ceil(math.log2(max(1.0, scene.feed.count / MIN_REPLICATES)))
    shares = [[result.share(fraction, place) for place in (*scene.bin, "elsewhere")] for fraction in scene.fraction]
    numbers = np.array(shares)
    whole = np.allclose(numbers[..., 0].sum(axis=1), 1.0, atol=1e-9)
    finite = bool(np.isfinite(numbers).all() and whole)
    seconds = sum(stage.seconds for name, stage in result.seconds.items() if name != str(COMPILED))
    return Happened(fed * len(scene.fraction), dict(+fates), finite, error, None, seconds, note)


def run_in(name: str, scene: Scene, **options: Any) -> Result:
    """Run a scene into the folder of its row."""
    return run(scene, OUT / name, report=False, **options)


# -- in known air, sorted by terminal velocity -------------------------------------------------------------------------


def _classified(
    name: str, fractions: Mapping[str, Options], changes: Options, sinks: Mapping[str, float], **options: object
) -> Happened:
    """The shipped aspirator with other fractions: upward air keeps what falls more slowly. ``sinks``: the share of each
    that reaches the floor, as terminal velocities have it.
    """
    tables = shipped_scene("aspirator").tables()
    tables["fraction"] = {name: {**PLAIN, "mass_share": 1.0 / len(fractions), **one} for name, one in fractions.items()}
    tables["feed"] |= {"rate": TRICKLE, "count": 256}
    scene = Scene.parse(tables).replace(dict(changes))
    result = run_in(name, scene, **options)
    errors = [abs(result.share(fraction, "heavy")[0] - share) for fraction, share in sinks.items()]
    return happened_in(scene, result, max(errors))


def _four_decades() -> Happened:
    """1 um to 10 mm, as much mass in every decade: carried over up to the size that falls as fast as the air rises."""
    low, high, speed = 1e-6, 1e-2, 6.0
    sizes = np.geomspace(low, high, 4001)
    falls = terminal_velocity(sizes, 1300.0, *STANDARD_AIR)
    cut = float(np.interp(speed, falls, np.log(sizes)))
    share = (math.log(high) - cut) / math.log(high / low)
    size = {"distribution": "table", "diameters": [low, high], "passing": [0.0, 1.0]}
    fraction = {"all": {"size": size, "density": 1300.0, "target": "heavy"}}
    return _classified("four-decades", fraction, {"feed.count": 1024}, {"all": share})


def _sorted(
    name: str, falls: Mapping[str, Options], rises: Mapping[str, Options], changes: Options, **options: object
) -> Happened:
    return _classified(name, {**falls, **rises}, changes, {**dict.fromkeys(falls, 1.0), **dict.fromkeys(rises, 0.0)},
                       **options)  # fmt: skip


def _grain(size: float, density: float, **more: object) -> Options:
    return {"size": size, "density": density, **more}


BY_SPEED = "terminal velocity over the air's speed, all or nothing"
for _group, _value, _name, _falls, _rises, _changes in (
    ("density over the air's", "0.5 and 1e4, one scene", "density", {"heavy": _grain(1e-3, 1.2e4)},
     {"light": _grain(2e-3, 0.6)}, {}),
    ("density over water's", "0.6, 1, 2.65, one scene", "water", {"quartz": _grain(1e-3, 2650.0)},
     {"wood": _grain(2e-3, 600.0), "neutral": _grain(2e-3, 998.2)}, {**WATER, "air.speed": 0.05}),
    ("sphericity", "0.1 and 1, one scene", "sphericity", {"spheres": _grain(3e-3, 1300.0)},
     {"flakes": _grain(3e-3, 1300.0, sphericity=0.1)}, {}),
    ("sizes", "50 mm, in a channel of 200 mm", "coarse", {"balls": _grain(5e-2, 1300.0)}, {}, {}),
    ("air at rest", "1e-6 m/s, it has no body", "rest-free", {"all": _grain(1e-3, 1300.0)}, {},
     {"air.speed": 1e-6}),
    ("air at rest", "0 m/s, it has no body", "calm-free", {"all": _grain(1e-3, 1300.0)}, {}, {"air.speed": 0.0}),
    ("air speed", "60 m/s, it has no body", "storm-free", {}, {"all": _grain(5e-3, 1300.0)},
     {"air.speed": 60.0}),
):  # fmt: skip
    add_row(_group, _value, partial(_sorted, _name, _falls, _rises, _changes), BY_SPEED, unit="share", allowed=1e-3)
add_row("sizes", "1 um to 10 mm, one scene", _four_decades, "share of the mass that falls faster than the air rises",
     unit="share", allowed=0.01)  # fmt: skip
add_row("sizes", "1 nm, Brownian motion, one scene",
     partial(_sorted, "nanometre", {}, {"all": _grain(1e-9, 1000.0)}, {"feed.count": 64}, force={"brownian": True}),
     BY_SPEED, unit="share", allowed=1e-3)  # fmt: skip


# -- what is refused ---------------------------------------------------------------------------------------------------


def _asked_for(template: str, changes: Options, force: Mapping[str, bool] | None = None) -> Happened:
    """A scene that must not run. Should it run all the same, the row is missed."""
    scene = shipped_scene(template).replace(dict(changes))
    return happened_in(scene, run_in("refused", scene, force=force), None)


DENSE = {"feed.rate": "50 t/hour"}
TOUCHING = {"shape": "rhombus", "width": "50 mm", "slope_angle": "45 deg", "at": ["50 mm", "0 mm"]}
_REFUSED: tuple[tuple[str, str, str, Options, Mapping[str, bool] | None], ...] = (
    ("granules", "1, a scene", "vacuum", {"feed.count": 1}, None),
    ("granules", "2e7, a scene", "vacuum", {"feed.count": 20_000_000}, None),
    ("Gamma", "51", "rhombus", {"vibration.gamma": 51.0}, None),
    ("slope", "0 deg, a rhombus", "rhombus", {"body.rhombus.slope_angle": 0.0}, None),
    ("slope", "89 deg, a rhombus", "rhombus", {"body.rhombus.slope_angle": "89 deg"}, None),
    ("restitution", "1.5", "vacuum", {"fraction.hard.restitution": 1.5}, None),
    ("sizes", "0.5 nm", "vacuum", {"fraction.hard.size": "0.5 nm"}, None),
    ("sizes", "60 mm, on a body of 50 mm", "vacuum", {"fraction.hard.size": "60 mm"}, None),
    ("sphericity", "0.04", "rhombus", {"fraction.wheat.sphericity": 0.04}, None),
    ("density over the air's", "3e4", "vacuum", {"fraction.hard.density": 3.6e4}, None),
    (
        "density over the air's",
        "0.5, with a terminal velocity",
        "vacuum",
        {"fraction.hard.density": 0.6, "fraction.hard.terminal_velocity": 1.0},
        None,
    ),
    ("bins", "that overlap", "rhombus", {"bin.inner-left.to": "-79 mm"}, None),
    ("bodies", "that touch", "rhombus", {"body.second": TOUCHING}, None),
    ("air at rest", "1e-7 m/s", "rhombus", {"air.speed": 1e-7}, None),
    ("air speed", "101 m/s", "rhombus", {"air.speed": 101.0}, None),
    ("feed", "500 t/h", "rhombus", {"feed.rate": "500 t/hour"}, None),
    ("feed", "50 t/h, collisions forced on", "vacuum", DENSE, {"collisions": True}),
)
for _what, _how, _template, _asked, _force in _REFUSED:
    add_row(_what, _how, partial(_asked_for, _template, _asked, _force), refused=True)
