"""Studies of granules that meet each other.

collision_draws: How far the unknown numbers of a scene move the shares of granules that meet, next to those of granules
alone. The slope is that of the slab's changes of all bin shares over those of granules alone: 1 where what an answer
takes for it holds. Changes alone are of two halves of the granules, one the other's instrument, so that their sampling
does not lower the slope; its interval is a jackknife's over the draws. *Taken* is the factor that an answer takes
(src/wakeflow/answer/budget/flown_again.py). docs/uncertainty.md.

collision_speed: How fast granules that meet fly, and in how much memory: a stream of wheat and chaff through air that
rises in a channel past the rhombus. docs/model.md: --granules 3000

crowding: The plan's estimate of collisions and its bound on what they change, next to slabs that were flown; the bound
holds where the change of no share exceeds it by more than sampling explains. docs/validation.md.

throughput: Recovery and purity against the feed rate, of granules that meet in air that feels them, printed and drawn.
The first row has each granule alone in air that does not feel it. docs/model.md: docs/pictures/throughput.png
"""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

import wakeflow as wf
from support import shipped
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.answer.budget.flown_again import AmongOthers
from wakeflow.answer.separation import separate
from wakeflow.answer.shares import Separation
from wakeflow.core.number import student
from wakeflow.core.store import content_key
from wakeflow.core.tables import Columns
from wakeflow.flight.stages.input_samples import CODE
from wakeflow.flight.stages.landings import Landings
from wakeflow.flight.stages.pipeline import InputRerun, Pipeline, SlabRerun
from wakeflow.planning.collision_rates import encounters
from wakeflow.planning.plan import INPUT_SAMPLES, SAME_AIR, replicate_size
from wakeflow.planning.stage_cache import code_of
from wakeflow.planning.terms import COLLISIONS, LOADING, limit_of
from wakeflow.scene.changes import Variation
from wakeflow.show.canvas import fraction_colours
from wakeflow.show.words import percent

from .common import COARSE, HOUR, MEET, Row, collisions_of, picture, piped, separation, show

# -- collision_draws ---------------------------------------------------------------------------------------------------
SCENES = ("rhombus", "labyrinth", "vacuum")
DRAWS_ALONE = 4  # replicates that fly alone under a draw, two in each half
REPLICATES_DRAWN = 4  # of the slab under a draw
DRAWS_COLUMNS = {
    "scene": "{scene}", "kg/h": "{rate:g}", "fraction": "{fraction}", "moved alone, points": "{alone:.1f}",
    "moved among others": "{meet:.1f}", "slope": "{slope:.2f} ± {half:.2f}", "taken": "{taken}",
}  # fmt: skip
Array = NDArray[np.float64]


class Moved(NamedTuple):
    """Changes (draws, bins + 1) of one fraction's shares: among granules that ``meet``, and alone in two halves."""

    meet: Array
    first: Array
    second: Array

    @property
    def alone(self) -> Array:
        """The mean over both halves."""
        return np.asarray(0.5 * (self.first + self.second))


def moved(scene: wf.Scene, draws: Sequence[int]) -> Iterator[tuple[str, Moved, float]]:
    """What the numbered ``draws`` change of each fraction's shares, and the factor that is taken for it."""
    pipeline = piped(scene, force=MEET)
    collisions, tracked, stage, bins = (
        pipeline.collisions(),
        pipeline.tracks(),
        InputRerun().stage(pipeline),
        len(scene.bin),
    )
    size = replicate_size(scene.feed.count)
    meet: dict[str, list[Array]] = {name: [] for name in scene.fraction}
    alone: dict[str, list[Array]] = {name: [] for name in scene.fraction}
    for number in draws:
        made = stage.variation(number)
        airs = stage.air(made.air)
        drawn = _flown_drawn(pipeline, number, made, airs)
        flown = [stage.fly_under(made, airs, tracked, replicate, range(size)) for replicate in range(DRAWS_ALONE)]
        for name in scene.fraction:
            one, other = (landings[name].counts(bins).mean(axis=0) for landings in (drawn, collisions.landings))
            meet[name].append(one - other)
            alone[name].append(np.array([_change(part, name, bins) for part in flown]))
    among = AmongOthers(scene, tracked.landings, collisions.landings)
    for name in scene.fraction:
        each = np.array(alone[name])
        halves = each[:, ::2].mean(axis=1), each[:, 1::2].mean(axis=1)
        yield name, Moved(np.array(meet[name]), *halves), among.factor(name)


def _flown_drawn(pipeline: Pipeline, number: int, made: Variation, airs: Realisations) -> Mapping[str, Landings]:
    """Landings of granules that meet, from some replicates under draw ``number``: ``made``, in its ``airs``."""
    stage, rerun = pipeline.collision_stage, SlabRerun(f"slab-draw-{number}")
    flown = {"scene": made.fed(pipeline.scene), "airs": airs, "variation": made}
    flight = replace(stage.flight(rerun), step=pipeline.collisions().clock.step, **flown)
    key = content_key(
        stage.key,
        "draw",
        number,
        repr(made),
        REPLICATES_DRAWN,
        code_of(*CODE),
    )
    folder = pipeline.cache.make(rerun.name, key, partial(flight.fly_all, replicates=REPLICATES_DRAWN))
    return flight.load(folder, REPLICATES_DRAWN).landings


def chosen_draws(count: int) -> list[int]:
    """Numbers of ``count`` draws at random, each in an air of its own while there are such; every so many of Sobol's
    points would lie on one side of some unknowns.
    """
    chance = np.random.default_rng(0)
    first = SAME_AIR * chance.permutation(INPUT_SAMPLES // SAME_AIR) + chance.integers(
        SAME_AIR, size=INPUT_SAMPLES // SAME_AIR
    )
    return [*first.tolist(), *sorted(set(range(INPUT_SAMPLES)) - set(first.tolist()))][:count]


def _change(part: Columns, name: str, bins: int) -> Array:
    landed = ([*range(bins), -1] == part[f"{which}.{name}.bin"][:, None] for which in ("varied", "own"))
    varied, own = (inside.mean(axis=0) for inside in landed)
    return np.asarray(varied - own)


def slope(draws_rows: Sequence[Moved]) -> float:
    """Of the changes among granules that meet, over those of granules alone; NaN where these change nothing."""
    above = below = 0.0
    for row in draws_rows:
        meet, first, second = (part - part.mean(axis=0) for part in row)
        above += float(np.sum(meet * (first + second)) / 2.0)
        below += float(np.sum(first * second))
    return above / below if below else float("nan")


def with_interval(draws_rows: Sequence[Moved]) -> tuple[float, float]:
    """The slope and half of its 95 % interval."""
    draws = len(draws_rows[0].meet)
    left = np.array([
        slope([Moved(*(np.delete(part, draw, axis=0) for part in row)) for row in draws_rows]) for draw in range(draws)
    ])  # fmt: skip
    spread = np.sqrt((draws - 1) / draws * np.sum((left - left.mean()) ** 2))
    return slope(draws_rows), float(student(draws - 1) * spread)


def _rms(changes: Sequence[Array]) -> float:
    """Of changes about their mean over the draws, in points."""
    about = np.concatenate([(change - change.mean(axis=0)).ravel() for change in changes])
    return float(100.0 * np.sqrt(np.mean(about**2)))


def draws_rows(which: str, draws: int, count: int, rate: float | None) -> Iterator[Row]:
    """A row for every fraction of a scene, and one for all."""
    fed = {} if rate is None else {"feed.rate": rate / HOUR}
    scene = shipped(which, {"feed.count": count, **COARSE[which], **fed})
    found = list(moved(scene, chosen_draws(draws)))
    parts = [(name, [row], f"{taken:.2f}") for name, row, taken in found]
    for name, some, taken in (*parts, ("all", [row for _, row, _ in found], "")):
        value, half = with_interval(some)
        yield {
            "scene": which, "rate": HOUR * (scene.feed.rate or 0.0), "fraction": name, "taken": taken, "slope": value,
            "half": half, "alone": _rms([row.alone for row in some]), "meet": _rms([row.meet for row in some]),
        }  # fmt: skip


def collision_draws(*scenes: str, draws: int = 32, count: int = 1024, rate: float | None = None) -> list[Row]:
    """Draws among granules that meet, at the scenes' own feed rate or at another (kg/h): rhombus, labyrinth, vacuum."""
    return show(DRAWS_COLUMNS, (row for which in scenes or SCENES for row in draws_rows(which, draws, count, rate)))


# -- collision_speed ---------------------------------------------------------------------------------------------------
WIDTH, HEIGHT, SPEED = 0.48, 0.5, 1.5
RHOMBUS = np.array([[-0.03, 0.0], [0.0, -0.03], [0.03, 0.0], [0.0, 0.03]])
FORCES = {
    "drag, gravity": ("drag", "gravity"), "all four": ("drag", "gravity", "pressure-gradient", "dispersion"),
}  # fmt: skip
SPEED_RATES = (3e3, 3e4)  # 1/s
SPEED_COLUMNS = {
    "forces": "{forces}", "rate 1/s": "{rate:.0f}", "at once": "{at_once:.0f}", "granule steps": "{steps}",
    "million/s/core": "{speed:.2f*1e-6}", "collisions": "{collisions:.2f}",
}  # fmt: skip


def channel(cells: int = 96) -> wf.FlowField:
    """Air that rises past a round obstacle (ideal flow), with pressure and even turbulence, on triangles."""
    x, y = np.meshgrid(np.linspace(-WIDTH / 2, WIDTH / 2, cells + 1), np.linspace(-HEIGHT / 2, HEIGHT / 2, cells + 1))
    points = np.column_stack([x.ravel(), y.ravel()])
    z = points[:, 0] + 1j * points[:, 1]
    z = np.where(np.abs(z) < 0.03, 0.03 * np.exp(1j * np.angle(z)), z)
    w = -1j * SPEED * (1 + (0.03**2) / z**2)
    velocity = np.column_stack([w.real, -w.imag])
    pressure = 0.6 * (SPEED**2 - (velocity**2).sum(axis=1))
    k = np.full(len(points), 0.1)
    cells_of = Delaunay(points).simplices
    return wf.FlowField.from_arrays(points, cells_of, velocity, pressure=pressure, k=k, dissipation=k * 20.0)


def feed(count: int, rate: float, seed: int = 1) -> wf.Granules:
    """Wheat, and ten of chaff for each, ``rate`` granules a second, over 40 mm above the rhombus."""
    rng = np.random.default_rng(seed)
    chaff = rng.random(count) < 10 / 11
    position = np.column_stack([rng.uniform(-0.02, 0.02, count), np.full(count, 0.2)])
    velocity = np.column_stack([np.zeros(count), np.full(count, -1.0)])
    return wf.Granules(
        position, velocity, np.where(chaff, 2e-3, 4e-3), np.where(chaff, 250.0, 1300.0), fraction=chaff.astype(int),
        inertia=0.4, time=np.sort(rng.uniform(0, count / rate, count)),
    )  # fmt: skip


def flown(count: int, rate: float, forces: str) -> Row:
    """One slab of 60 mm."""
    field = channel()
    exits = [np.array([[-1.0, y], [1.0, y]]) for y in (-0.24, 0.24)]
    law = wf.Collisions(0.06, [[0.5, 0.3], [0.3, 0.3]], 0.3, step=1e-4)
    laws = {
        "until": count / rate + 1.0, "bodies": [RHOMBUS], "lines": exits, "forces": FORCES[forces], "tolerance": 1e-3,
        "collisions": law,
    }  # fmt: skip
    wf.track(field, feed(8, 1e3), **laws)  # compiles
    began = time.process_time()
    tracks = wf.track(field, feed(count, rate), **laws)
    speed = tracks.collisions.flown / (time.process_time() - began)
    return {
        "forces": forces, "rate": rate, "at_once": tracks.collisions.flown / tracks.collisions.steps, "speed": speed,
        "steps": tracks.collisions.flown, "collisions": tracks.meetings.mean(),
    }  # fmt: skip


def collision_speed(granules: int = 20_000) -> list[Row]:
    """Granule steps a second and core where granules meet."""
    found = show(SPEED_COLUMNS, (flown(granules, rate, forces) for forces, rate in product(FORCES, SPEED_RATES)))
    print(f"memory of the process at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    return found


# -- crowding ----------------------------------------------------------------------------------------------------------
BOUND_RATES = (20.0, 100.0, 500.0)  # kg/h
COUNT = 1024  # granules of the fraction of most mass
BOUND_COLUMNS = {
    "scene": "{scene}", "kg/h": "{rate:g}", "fraction": "{fraction}", "collisions counted": "{counted:.2g}",
    "estimated": "{estimated:.2g}",
    "largest change of a share, points": "{change:.1f*100} ± {error:.1f*100}",
    "bound": "{bound:.2g*100}{holds:| **exceeded**}",
}  # fmt: skip


def bound_rows(which: str, rates: Sequence[float] = BOUND_RATES, count: int = COUNT) -> Iterator[Row]:
    """A row for every fraction and rate of one of the COARSE scenes."""
    for rate in rates:
        scene = shipped(which, {"feed.count": count, "feed.rate": rate / HOUR, **COARSE[which]})
        pipeline = piped(scene, force=MEET)
        plan, collisions = pipeline.plan, pipeline.collisions()
        met, alone = separate(scene, collisions.landings), separation(pipeline)
        one_by_one = [name for name in scene.fraction if not plan.collisions.tracers[name]]
        found = encounters(scene, {name: (how.drag, how.drag_scale) for name, how in plan.fractions.items()})
        for name, landing in collisions.landings.items():
            pairs = [(met.fractions[name][place], alone.fractions[name][place]) for place in met.bins]
            change, error = max((abs(a.value - b.value), (a.half**2 + b.half**2) ** 0.5) for a, b in pairs)
            bound = min(1.0, plan.fractions[name].bounds[COLLISIONS] / limit_of(scene, 1.0))
            yield {
                "scene": which, "rate": rate, "fraction": name, "counted": collisions_of(landing),
                "estimated": sum(found[name].by[other] for other in one_by_one), "change": change, "error": error,
                "bound": bound, "holds": change - error <= bound,
            }  # fmt: skip


def crowding(*scenes: str, count: int = COUNT) -> list[Row]:
    """Collisions estimated and flown: rhombus, prism, labyrinth, aspirator, vacuum."""
    return show(BOUND_COLUMNS, (row for which in scenes or COARSE for row in bound_rows(which, count=count)))


# -- throughput --------------------------------------------------------------------------------------------------------
FEED_RATES = (10.0, 50.0, 125.0, 500.0, 1000.0)  # kg/h
FEED_ALONE = {COLLISIONS: False, LOADING: False, "basset-history": False}  # granules that meet leave out the last
QUICK = {"feed.count": 16, "numerics.target_error": 0.5, "collisions.depth": "20 mm"}


def purity(scene: wf.Scene, found: Separation, name: str) -> float | None:
    """Share of the fraction in the mass of its target bins together; None where they stay empty."""
    shares, targets = scene.mass_shares(), scene.fraction[name].targets
    inside = {one: shares[one] * sum(found.fractions[one][place].value for place in targets) for one in scene.fraction}
    return inside[name] / sum(inside.values()) if sum(inside.values()) else None


def _row(scene: wf.Scene, rate: float, found: Separation, alone: Separation, meetings: dict[str, float]) -> Row:
    numbers: dict[str, object] = {"rate": rate, "what": f"{rate:g}" if rate else "each alone"}
    for name, fraction in scene.fraction.items():
        if fraction.targets:
            recovery = found.recovery[name]
            part = {"recovery": percent(recovery), "value": recovery.value, "half": recovery.half}
            part["alone"] = alone.recovery[name].value
            numbers[name] = {**part, "purity": purity(scene, found, name), "meetings": meetings.get(name, 0.0)}
    return numbers


def feed_rows(scene: wf.Scene, rates: Sequence[float], rung: str | None = None) -> Iterator[Row]:
    """Granules alone in air that does not feel them, then at each of the ``rates`` (kg/h)."""
    still = separation(piped(scene, rung, FEED_ALONE))
    yield _row(scene, 0.0, still, still, {})
    for rate in rates:
        fed = scene.replace({"feed.rate": rate / HOUR})
        pipeline = piped(fed, rung, {COLLISIONS: True})
        landings = pipeline.collisions().landings
        met = {name: collisions_of(landing) for name, landing in landings.items()}
        yield _row(fed, rate, separate(fed, landings), separation(pipeline), met)


def draw(path: Path, found: dict[str, list[Row]]) -> None:
    """Recovery (full) and purity (dashed) against the feed rate, a panel a scene; at the left edge each alone."""
    with picture(path, len(found), 4.8, 3.4) as panels:
        for axes, (title, (alone, *met)) in zip(panels, found.items(), strict=True):
            rates = [row["rate"] for row in met]
            names = list(shipped(title).fraction)
            for name, colour in fraction_colours(names).items():
                if name not in alone:
                    continue
                value, error = (100.0 * np.array([row[name][key] for row in met]) for key in ("value", "half"))
                pure = 100.0 * np.array([row[name]["purity"] for row in met], dtype=float)
                axes.errorbar(rates, value, error, color=colour, marker="o", markersize=4, capsize=2, label=name)
                axes.plot(0.5 * rates[0], 100.0 * alone[name]["value"], "<", color=colour, markersize=6)
                axes.plot(rates, pure, "--", color=colour, linewidth=1.0)
            axes.set(xscale="log", xlabel="feed (kg/h)", ylim=(0.0, 103.0))
            axes.set_title(title, fontsize=9, loc="left")
            axes.grid(alpha=0.25)
        panels[0].set_ylabel("recovery (full), purity (dashed), %")
        panels[-1].legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))


def throughput(
    image: Path | None = None, *, scene: tuple[str, ...] = ("rhombus", "prism", "labyrinth"), rung: str | None = None,
    count: int | None = None, quick: bool = False,
) -> dict[str, list[Row]]:  # fmt: skip
    """Recovery and purity against the feed rate; ``count``: granules of the fraction of most mass at each rate."""
    found = {}
    for name in scene:
        made = shipped(name, QUICK if quick else {} if count is None else {"feed.count": count})
        columns = {"kg/h": "{what}"}
        for one in (one for one, fraction in made.fraction.items() if fraction.targets):
            columns[f"{one}: recovery, %"] = f"{{{one}[recovery]}}"
            columns[f"{one}: alone in that air, %"] = f"{{{one}[alone]:.1f*100}}"
            columns[f"{one}: purity, %"] = f"{{{one}[purity]:.1f*100}}"
            columns[f"{one}: meetings"] = f"{{{one}[meetings]:.2g}}"
        found[name] = show(columns, feed_rows(made, FEED_RATES[1::2] if quick else FEED_RATES, rung), name)
    if image is not None:
        draw(image, found)
    return found
