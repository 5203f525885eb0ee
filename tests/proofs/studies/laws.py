"""Studies of the paper's laws, of the data, and of what granules and air do to each other.

best_estimate: For each entry of src/wakeflow/laws/wakes.toml theta, strength or lift by it with its own error; then
for each source, and as the range of that body if this source did not exist; held: the two meet. docs/model.md.

printed_form: What eq. (2) of the paper gives as printed, next to what follows from eq. (1), in the body's frame (Spade,
Vaicis, Vutukuru & Irbe 2020, doi 10.22616/ERDev.2020.19.TF365): velocity down the slope over the closing speed W. An
energy (after over before) above 1 is energy from nothing.

rebound: Shares of the shipped rhombus with one part of a real rebound after the other, from the paper's point mass to
what the materials say. docs/model.md: rebound --count 2048

labyrinth: What the air does in cases/labyrinth.toml: shares without air and in the steady airflow of all bodies; how
far landings move next to the bound of the plan that leaves the air out. docs/validation.md: labyrinth 512 2

air_loading: What the granules' force on the air does: pass by pass in the steady airflow, and in the answer's own next
to one that does not feel them. docs/model.md.

settled_passes: The force found in airflows that need not settle, next to that found where all do. docs/model.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import wakeflow as wf
from support import CASES, shipped
from wakeflow.air.field import FlowField
from wakeflow.air.foam.airflow_result import AirflowResult
from wakeflow.air.foam.momentum_source import SOURCE
from wakeflow.air.foam.steady import MOST
from wakeflow.answer.budget.flown_again import shares_of
from wakeflow.core.record import load
from wakeflow.flight.stages import air_loading as air_loading_stage
from wakeflow.flight.stages.air_loading import AirLoading
from wakeflow.flight.stages.pipeline import PerturbedRerun
from wakeflow.laws.best_estimate import NUMBER_OF, by_source, wakes
from wakeflow.laws.best_estimate import best_estimate as estimated
from wakeflow.laws.material import materials

from .common import ALONE, BARE, Pipeline, Row, piped, separation, show

# -- best_estimate -----------------------------------------------------------------------------------------------------
NUMBER = "{{{0}.value:.2f}} ({{{0}.low:.2f}} to {{{0}.high:.2f}})"
ESTIMATE_COLUMNS = {
    "entry": "{entry.name}", "shape": "{entry.family}", "blockage": "{entry.blockage:g}",
    "quantity": "{entry.quantity}", "at that blockage": "{entry.value[0]:.2f} to {entry.value[1]:.2f}",
    "ends": "{entry.steady:g}, {entry.resolved:g}", "gives": "{entry.number} " + NUMBER.format("entry.given"),
    "source": "{entry.datum}", "status, checked": "{entry.status}, {entry.checked}",
}  # fmt: skip
SOURCE_COLUMNS = {
    "source": "{datum}", "number": "{number}", "gives": NUMBER.format("own"),
    "by the others": NUMBER.format("others"), "held": "{held:yes|NO}",
}  # fmt: skip


def left_one_out() -> list[Row]:
    """What each source gives, and what the others give for its body."""
    found = []
    for number in dict.fromkeys(NUMBER_OF.values()):
        for datum, own in by_source([entry for entry in wakes() if entry.number == number]).items():
            one = next(entry for entry in wakes() if entry.datum == datum and entry.number == number)
            rest = [entry for entry in wakes() if entry.datum != datum]
            others = getattr(estimated(one.family, one.blockage, max(one.reynolds), rest, slope=one.slope), number)
            held = own.low <= others.high and own.high >= others.low
            found.append({"datum": datum, "number": number, "own": own, "others": others, "held": held})
    return found


def best_estimate() -> list[Row]:
    """The best estimate's data, then its sources with one left out at a time."""
    rows = show(ESTIMATE_COLUMNS, ({"entry": entry} for entry in wakes()))
    show(SOURCE_COLUMNS, left_one_out(), "One source left out at a time:")
    return rows


# -- printed_form ------------------------------------------------------------------------------------------------------
SLOPES = (  # slope angle (deg), restitution, friction
    (45, 0.5, 0.3), (45, 0.1, 0.6), (45, 0.5, 0.0), (30, 0.5, 0.2), (60, 0.5, 0.35), (60, 0.9, 0.2), (60, 0.0, 0.0),
    (30, 0.5, 0.6),
)  # fmt: skip
FORM_COLUMNS = {
    "b, deg": "{degrees}", "R": "{restitution:g}", "f": "{friction:g}",
    "derived: v_x / W": "{along[0]:.4f}", "energy": "{energy[0]:.3f}",
    "eq. (2), printed": "{along[1]:.4f}", "energy by (2)": "{energy[1]:.3f}",
    "eq. (1), printed sign": "{along[2]:.4f}", "energy by (1)": "{energy[2]:.3f}",
}  # fmt: skip


def forms(slope_angle: float, restitution: float, friction: float) -> tuple[float, float, float]:
    """Velocity down the slope over W: as derived (slip or stick), eq. (2) as printed, eq. (1) with its printed sign."""
    derived = wf.impact(slope_angle, 1.0, 0.0, restitution, friction).tangential
    sine, cosine = math.sin(slope_angle), math.cos(slope_angle)
    printed = math.sin(slope_angle - friction * cosine) * (1.0 + restitution)
    return float(derived), printed, -(sine + friction * (1.0 + restitution) * cosine)


def form_row(degrees: float, restitution: float, friction: float) -> Row:
    """Velocities and energies of the three forms."""
    angle = math.radians(degrees)
    along = forms(angle, restitution, friction)
    energy = [speed**2 + (restitution * math.cos(angle)) ** 2 for speed in along]
    return {"degrees": degrees, "restitution": restitution, "friction": friction, "along": along, "energy": energy}


def printed_form() -> list[Row]:
    """Energy by eq. (1) and (2) of the paper as printed, and as derived."""
    return show(FORM_COLUMNS, (form_row(*slope) for slope in SLOPES))


# -- rebound -----------------------------------------------------------------------------------------------------------
PLACES = {  # columns of the table: fraction, bins that count together
    "wheat, outer": ("wheat", ("outer-left", "outer-right")),
    "chaff, middle": ("chaff", ("middle",)),
    "chaff, inner": ("chaff", ("inner-left", "inner-right")),
    "dust, middle": ("dust", ("middle",)),
}
Keys = dict[str, Any]


def spreads(part: str) -> Callable[[str], Keys]:
    """A number of the material, and how it spreads."""
    return lambda name: {part: {"mean": getattr(materials[name], part), "std": getattr(materials[name], f"{part}_std")}}


def terminal_velocity(name: str) -> Keys:
    """How it spreads, where it does."""
    known = materials[name]
    spread = {"distribution": "normal", "mean": known.terminal_velocity, "std": known.terminal_velocity_std}
    return {"terminal_velocity": spread} if known.terminal_velocity_std else {}


def spin(name: str) -> Keys:
    """Granules of a material that turn, and are alike otherwise."""
    known = materials[name]
    alike = {"restitution": known.restitution, "friction": known.friction, "rebound_scatter": 0.0}
    return {} if known.impact == "paper" else {"impact": known.impact, **alike, "tangential_restitution": 0.0}


ROWS: dict[str, Callable[[str], Keys] | None] = {
    "the paper's point mass": lambda _: {},
    "restitution spreads": spreads("restitution"),
    "friction spreads": spreads("friction"),
    "scatter by shape": lambda name: {"rebound_scatter": materials[name].rebound_scatter},
    "spin": spin,
    "terminal velocity spreads": terminal_velocity,
    "all, by material": None,
}


def scene_of(scene: wf.Scene, keys: Callable[[str], Keys] | None) -> wf.Scene:
    """The scene with the paper's granules and one part of the rebound; None: with the materials' own."""
    if keys is None:
        return scene
    changes: Keys = {}
    for name, fraction in scene.fraction.items():
        own = {"impact": "paper", **keys(str(fraction.material))}
        changes.update({f"fraction.{name}.{key}": value for key, value in own.items()})
    return scene.replace(changes)


def rebound_row(title: str, scene: wf.Scene, rung: str) -> Row:
    """Share and half of its 95 % interval, in percent, of every column."""
    found = wf.chain(scene).shares if rung == "none" else separation(piped(scene, rung, ALONE))
    cells = {}
    for column, (fraction, places) in PLACES.items():
        parts = [found.fractions[fraction][place] for place in places]
        error = sum(part.half**2 for part in parts) ** 0.5
        cells[column] = f"{100 * sum(part.value for part in parts):.1f} +- {100 * error:.1f}"
    return {"percent": title, **cells}


def rebound(*, count: int = 4096, rung: str = "none") -> list[Row]:
    """What each part of a real rebound moves."""
    scene = shipped("rhombus", {"feed.count": count})
    return show(("percent", *PLACES), (rebound_row(title, scene_of(scene, keys), rung) for title, keys in ROWS.items()))


# -- labyrinth ---------------------------------------------------------------------------------------------------------
SHARE = "{0.value:.1f*100} ({0.low:.1f*100} to {0.high:.1f*100})"
SHARES = {
    "fraction": "{fraction}", "bin": "{bin}", "without air": SHARE.replace("{0", "{still"),
    "in the airflow": SHARE.replace("{0", "{air"),
}  # fmt: skip
MOVED = {
    "fraction": "{fraction}", "moved by the air, median": "{median:.2g}", "95 %": "{most:.2g}",
    "bound of the plan (body widths)": "{bound:.2g}",
}  # fmt: skip


def moved(still: Any, air: Pipeline) -> Iterator[Row]:
    """How far the air moves landings of each fraction."""
    bounds = {row.fraction: row.bound for row in still.plan.left_out if row.name == "air"}
    for name, landing in air.tracks().landings.items():
        off = np.linalg.norm(landing.position - still.landings[name].position, axis=1) / air.scene.width
        yield {"fraction": name, "median": np.median(off), "most": np.percentile(off, 95), "bound": bounds[name]}


def labyrinth(count: int = 1024, mesh_scale: float = 2.0) -> list[Row]:
    """Shares in the labyrinth without air and with it, of ``count`` granules a fraction."""
    scene = shipped("labyrinth", {"feed.count": count})
    still, air = wf.chain(scene), piped(scene.replace({"numerics.mesh_scale": mesh_scale}), "draft", BARE)
    found = separation(air).fractions
    show(SHARES, (
        {"fraction": name, "bin": place, "still": own, "air": found[name][place]}
        for name, row in still.shares.fractions.items() for place, own in row.items()
    ))  # fmt: skip
    print()
    rows = show(MOVED, moved(still, air))
    spent = ", ".join(f"{stage} {took.seconds:.1f}" for stage, took in air.seconds.items())
    print(f"\nstages with air, s on the clock: {spent}")
    return rows


# -- air_loading -------------------------------------------------------------------------------------------------------
PASSES = {
    "pass": "{number}", "force, N/m": "{force:.4g}", "Cd": "{cd:.4g}", "speed 1 D before the body, m/s": "{speed:.4g}",
}  # fmt: skip
Moved = Mapping[str, tuple[str, int]]  # by fraction: a bin and its number


def axis_speed(scene: wf.Scene, field: FlowField) -> float:
    """Speed (m/s) of the air one body width before the first body, on its axis."""
    outline, down = next(iter(scene.body.values())).outline(), scene.air.direction == "down"
    place = outline[:, 1].max() + scene.width if down else outline[:, 1].min() - scene.width
    return float(abs(field.sample([[outline[:, 0].mean(), place]])[0][0, 1]))


def most_moved(scene: wf.Scene, loading: AirLoading) -> Moved:
    """For each fraction the name and number of the bin whose share all passes together move most."""
    first, last = loading.first.shares, loading.passes[-1].gathered.shares
    numbers = {name: int(np.abs(np.subtract(last[name], first[name])).argmax()) for name in first}
    return {name: ([*scene.bin, "elsewhere"][number], number) for name, number in numbers.items()}


def passes(pipeline: Pipeline, bins: Moved) -> Iterator[Row]:
    """The steady airflow, pass by pass."""
    loading, scene = pipeline.loading, pipeline.scene
    both = 2.0 if loading.steady.half else 1.0

    def row(number: int, force: float, cd: float, field: FlowField, found: Mapping[str, list[float]]) -> Row:
        shares = {name: 100 * found[name][place] for name, (_, place) in bins.items()}
        return {"number": number, "force": force, "cd": cd, "speed": axis_speed(scene, field), **shares}

    steady = loading.steady
    yield row(0, 0.0, steady.measured.cd.value, steady.field[1], loading.first.shares)
    for number, one in enumerate(loading.passes, 1):
        cd = load(AirflowResult, one.air.case / "airflow.json").cd.value
        given = both * json.loads((one.air.case / SOURCE).read_text())["force"][1]
        air = one.air.field
        yield row(number, given, cd, air, one.gathered.shares)


def answers(pipeline: Pipeline, bins: Moved) -> Iterator[Row]:
    """The shares of the granules of a comparison in the answer's airflow, which does not feel them, and which does."""
    plan = pipeline.plan
    bare = Pipeline(
        pipeline.scene, replace(plan, airflow=replace(plan.airflow, loaded=False)), seconds=pipeline.seconds
    )
    for title, air in (("without the force", bare), ("both ends solved under it", pipeline)):
        shares = shares_of(air, air.run(PerturbedRerun("tracks of the comparison")))
        yield {"airflow": title, "cd": air.airflow.cd.value,
               **{name: 100 * float(shares[name][:, number].mean()) for name, (_, number) in bins.items()}}  # fmt: skip


def tables(scene: wf.Scene, **options: Any) -> tuple[list[Row], list[Row]]:
    """Print both tables; ``options`` of ``wf.plan``."""
    plan = wf.plan(scene, **options)
    pipeline = Pipeline(scene, replace(plan, airflow=replace(plan.airflow, loaded=True)), workers=None)
    bins = most_moved(scene, pipeline.loading)
    shares = {f"{name} in {place}, %": f"{{{name}:.4g}}" for name, (place, _) in bins.items()}
    first = show({**PASSES, **shares}, passes(pipeline, bins))
    print()
    second = show({"airflow": "{airflow}", "Cd": "{cd:.4g}", **shares}, answers(pipeline, bins))
    print()
    spent = ({"stage": stage, "seconds": took.seconds} for stage, took in pipeline.seconds.items())
    show({"stage": "{stage}", "s": "{seconds:.4g}"}, spent)
    return first, second


def air_loading(scene: Path = CASES / "rhombus.toml") -> None:
    """What the granules' force on the air does."""
    tables(wf.Scene.load(scene))


# -- settled_passes ----------------------------------------------------------------------------------------------------
SETTLED = {
    "scene": "{scene}", "seed": "{seed}", "iterations of a pass on the way, at most": "{most}",
    "of all passes": "{iterations}", "force, N/m": "{force:.4f}", "Cd": "{cd:.4f}", "Cd off, %": "{cd_off:.2f}",
    "share off, points": "{share_off:.2f}",
}  # fmt: skip


def _settled(name: str, changes: Mapping[str, Any], seeds: int, most: tuple[int, ...]) -> Iterator[Row]:
    for seed in range(seeds):
        scene, first = shipped(name, {**changes, "feed.seed": seed}), None
        for allowed in (MOST, *most):
            with patch.object(air_loading_stage, "ON_THE_WAY", allowed):
                last, *others = reversed(Pipeline(scene, wf.plan(scene)).loading.passes)
            cases = [one.air.case for one in (last, *others)]
            cd = load(AirflowResult, cases[0] / "airflow.json").cd.value
            first = first or (cd, last.gathered.shares)
            off = [np.subtract(last.gathered.shares[one], shares) for one, shares in first[1].items()]
            yield {
                "scene": name, "seed": seed, "most": allowed, "force": last.force.total[1], "cd": cd,
                "iterations": sum(load(AirflowResult, case / "airflow.json").steps for case in cases),
                "cd_off": 100 * abs(cd / first[0] - 1.0), "share_off": 100 * float(np.abs(off).max()),
            }  # fmt: skip


def settled_passes(
    *scenes: str, seeds: int = 2, most: tuple[int, ...] = (300, 200, 100), mesh_scale: float | None = None
) -> list[Row]:
    """Passes of the granules' force in airflows that take ``most`` iterations, next to those where all settle."""
    changes = {} if mesh_scale is None else {"numerics.mesh_scale": mesh_scale}
    named = scenes or ("rhombus", "wheat-straw-dust")
    return show(SETTLED, (row for name in named for row in _settled(name, changes, seeds, most)))
