"""Studies of the paper's laws, of the data, and of what granules and air do to each other.

best_estimate: For each entry of src/wakeflow/laws/wakes.toml theta or strength by it with its own error, and by the
range of that body if this entry did not exist; held: the two meet. docs/model.md.

printed_form: What eq. (2) of the paper gives as printed, next to what follows from eq. (1), in the body's frame (Spade,
Vaicis, Vutukuru & Irbe 2020, doi 10.22616/ERDev.2020.19.TF365): velocity down the slope over the closing speed W. An
energy (after over before) above 1 is energy from nothing.

rebound: Shares of the shipped rhombus with one part of a real rebound after the other, from the paper's point mass to
what the materials say. docs/rebound.md: rebound --count 2048

labyrinth: What the air does in cases/labyrinth.toml: shares without air and in the steady airflow of all bodies; how
far landings move next to the bound of the plan that leaves the air out. docs/validation.md: labyrinth 512 2

air_loading: What the granules' force on the air does, pass by pass, in the steady airflow and in the answer's own.
--both solves the time-resolved end under the last force as well, which the program does not do, and flies in the wake
between both loaded ends. docs/model.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from support import CASES, shipped
from wakeflow.budget.air_loading import UNLOADED
from wakeflow.budget.comparison import Shares, shares_of
from wakeflow.core.geometry import ForceDensity
from wakeflow.core.number import Number
from wakeflow.core.record import load
from wakeflow.field import FlowField, blended_wake
from wakeflow.foam.airflow import solve_airflow
from wakeflow.foam.airflow_result import AirflowResult
from wakeflow.foam.momentum_source import SOURCE, write_source
from wakeflow.foam.prepare import prepare_case
from wakeflow.laws.best_estimate import WakeEntry, wakes
from wakeflow.laws.best_estimate import best_estimate as estimated
from wakeflow.laws.material import materials
from wakeflow.pipeline.air_loading import AirLoading
from wakeflow.pipeline.case_field import case_field
from wakeflow.pipeline.landings import load_tracked
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.track_stage import PerturbedRerun
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.plan import COMPARED

from .common import ALONE, BARE, Pipeline, Row, piped, separation, show

# -- best_estimate -----------------------------------------------------------------------------------------------------
NUMBER = "{{{0}.value:.2f}} ({{{0}.low:.2f}} to {{{0}.high:.2f}})"
ESTIMATE_COLUMNS = {
    "entry": "{entry.name}", "shape": "{entry.family}", "blockage": "{entry.blockage:g}",
    "quantity": "{entry.quantity}", "at that blockage": "{entry.here[0]:.2f} to {entry.here[1]:.2f}",
    "ends": "{entry.steady:g}, {entry.resolved:g}", "gives": NUMBER.format("own"),
    "by the others": NUMBER.format("others"), "held": "{held:yes|NO}",
    "status, checked": "{entry.status}, {entry.checked}",
}  # fmt: skip


def left_one_out() -> list[tuple[WakeEntry, Number, Number]]:
    """Each entry, what it gives, and what the others give for its body."""
    known = wakes()
    found = []
    for entry in known:
        rest = [other for other in known if other is not entry]
        others = estimated(entry.family, entry.blockage, max(entry.reynolds), rest, slope=entry.slope)
        found.append((entry, entry.given, others.theta if entry.of_mean_weight else others.strength))
    return found


def best_estimate() -> list[Row]:
    """The best estimate's data, one entry left out at a time."""
    return show(ESTIMATE_COLUMNS, [
        {"entry": entry, "own": own, "others": others, "held": own.low <= others.high and own.high >= others.low}
        for entry, own, others in left_one_out()
    ])  # fmt: skip


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
        cd = load(AirflowResult, one.folder / "case" / "airflow.json").cd.value
        given = both * json.loads((one.folder / "case" / SOURCE).read_text())["force"][1]
        yield row(number, given, cd, loading.field_in(one.folder), one.gathered.shares)


def solved_both(pipeline: Pipeline, force: ForceDensity, folder: Path) -> FlowField:
    """The wake between both ends, each solved under ``force``; the time-resolved one in ``folder``."""
    air, loading = pipeline.kind, pipeline.loading
    spec, case = air.solved_spec, folder / "case"
    case.mkdir(parents=True, exist_ok=True)
    msh = air.mesh[1] / "mesh.msh"
    prepare_case(spec, msh, case)
    write_source(case, force, spec.density)
    last = loading.passes[-1].folder
    solved = solve_airflow(spec, msh, case, start=last / "case")
    loaded = case_field(case, solved.field_time, spec.density, half=False)
    wake = pipeline.plan.airflow.wake
    theta, strength = (1.0, 1.0) if wake is None else (wake.theta.value, wake.strength.value)
    return blended_wake(loaded, loading.field_in(last), theta, strength)


def flown(pipeline: Pipeline, field: FlowField, folder: Path) -> Shares:
    """Shares of the granules of a comparison in ``field``."""
    scene, airs = pipeline.scene, Realisations(field, cycles=pipeline.kind.realisations.cycles)
    folder.mkdir(parents=True, exist_ok=True)
    Flight(scene, pipeline.plan, airs, scene.numerics.tolerance, replicates=COMPARED).fly_all(folder, drawn=False)
    return shares_of(pipeline, load_tracked(folder, scene))


def answers(pipeline: Pipeline, bins: Moved, both: Path | None) -> Iterator[Row]:
    """The shares in the answer's airflow: without the force, with the steady end's change, with both ends solved."""
    effect = UNLOADED.fly(pipeline, pipeline.tracks(PerturbedRerun("tracks of the comparison")))
    found = {"without": effect.without, "with the steady end's change": effect.loaded}
    if both is not None:
        field = solved_both(pipeline, pipeline.loading.passes[-1].force, both)
        found["with both ends solved"] = flown(pipeline, field, both / "tracks")
    for title, shares in found.items():
        means = {name: 100 * float(shares[name][:, number].mean()) for name, (_, number) in bins.items()}
        yield {"airflow": title, **means}


def tables(scene: wf.Scene, both: Path | None = None, **options: Any) -> tuple[list[Row], list[Row]]:
    """Print both tables; ``both``: a folder for the time-resolved end under the force; ``options`` of ``wf.plan``."""
    plan = wf.plan(scene, **options)
    pipeline = Pipeline(scene, replace(plan, airflow=replace(plan.airflow, loaded=True)), workers=None)
    bins = most_moved(scene, pipeline.loading)
    shares = {f"{name} in {place}, %": f"{{{name}:.4g}}" for name, (place, _) in bins.items()}
    first = show({**PASSES, **shares}, passes(pipeline, bins))
    print()
    second = show({"airflow": "{airflow}", **shares}, answers(pipeline, bins, both))
    print()
    spent = ({"stage": stage, "seconds": took.seconds} for stage, took in pipeline.seconds.items())
    show({"stage": "{stage}", "s": "{seconds:.4g}"}, spent)
    return first, second


def air_loading(scene: Path = CASES / "rhombus.toml", *, both: bool = False) -> None:
    """What the granules' force on the air does."""
    tables(wf.Scene.load(scene), both=Path("runs", "air-loading") if both else None)
