"""The reference runs in three dimensions, beside the steady, the time-resolved and the blended wake of the same scene.

.venv/bin/python cases/studies/three_dimensions.py [rhombus] [prism-up] [prism-down] [--set KEY=VALUE ...]
.venv/bin/python cases/studies/three_dimensions.py --analyse FOLDER... [--beside]

The first form runs (hours a body; what stands in the cache goes on or is read) and prints the tables of
docs/three-dimensions.md: the shipped scene with a rhombus, a prism apex up, a prism apex down, 12.5 % blocked, Re
16 500, downward air. The second one analyses folders of runs made by hand: ``flat`` the one-layer case, ``deep`` the
extruded one, ``packed`` and ``layers.npz`` as of ``wakeflow.foam.span_record``; a folder's name begins with the body's.
``--count 0`` flies no granules.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wakeflow as wf
from wakeflow.core.errors import known
from wakeflow.core.number import Number
from wakeflow.core.store import Store, cache_root
from wakeflow.field import FlowField
from wakeflow.field.cross_fade import cross_faded
from wakeflow.foam.airflow_result import AirflowResult
from wakeflow.foam.case import FlowSpec, axis_points
from wakeflow.foam.case_fields import CaseFields
from wakeflow.foam.cost import core_seconds
from wakeflow.foam.span_measure import measure_span
from wakeflow.foam.span_read import lead_of, read_layers
from wakeflow.foam.span_record import SpanRecord
from wakeflow.injection.feed import feedstock
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.solved_air import TimeResolvedAir
from wakeflow.pipeline.specs import flow_spec, mesh_spec
from wakeflow.pipeline.tracks import Flight, landing_columns
from wakeflow.planning.plan import REPLICATES
from wakeflow.scene.overrides import changes_of
from wakeflow.tracking.residence import residence_time

Array = NDArray[np.float64]
SCENE = Path(__file__).parent.parent / "rhombus.toml"
PRISM = {"body.rhombus.shape": "prism", "body.rhombus.slope_angle": "60 deg"}
BODIES: dict[str, dict[str, Any]] = {
    "rhombus": {},
    "prism-up": {**PRISM, "body.rhombus.apex": "up"},
    "prism-down": {**PRISM, "body.rhombus.apex": "down"},
}
START_UP = 25.0  # convective times of a run made by hand that are no part of its means
COUNT = 4096  # granules of each fraction
PLACES = np.array([0.5, 1.0, 1.5, 2.0, 3.0, 4.0])  # widths behind the body, in the profiles
PAIRED = 2.36  # Student's t of the 8 pairs of replicates, 95 %
SHOWN = {"dust": ("middle",), "chaff": ("middle",), "wheat": ("outer-left", "outer-right")}
Shares = dict[str, dict[str, Number]]


@dataclass(frozen=True, eq=False)
class Column:
    """One airflow of a body: its numbers, the fields that granules fly in, core-hours."""

    name: str
    found: AirflowResult
    fields: Sequence[FlowField]
    core_hours: float


def scene_of(body: str, count: int = COUNT, changes: dict[str, Any] | None = None) -> wf.Scene:
    """The shipped scene with one of the BODIES."""
    return wf.Scene.load(SCENE).replace({**BODIES[body], "feed.count": count, **(changes or {})})


def spec_of(scene: wf.Scene) -> FlowSpec:
    """Its airflow in three dimensions."""
    plan = wf.plan(scene, rung="3d")
    return flow_spec(scene, plan, mesh_spec(scene, plan))


def analysed(folder: Path, spec: FlowSpec, begin: float | None = None) -> Column:
    """A run made by hand, from ``begin`` (s) on."""
    record = SpanRecord(folder, CaseFields(folder / "flat"))
    since = START_UP * spec.convective_time if begin is None else begin
    found = measure_span(spec, record, folder / "deep", since)
    assert found.span is not None
    fields = []
    for arrays in read_layers(record, found.span["flown"], since, spec.density):
        field = FlowField.from_arrays(**arrays)
        assert field.times is not None
        fields.append(cross_faded(field, lead_of(spec, field.times)))
    return Column("3D", found, fields, core_seconds(folder / "deep") / 3600)


def tell(stage: str, text: str) -> None:
    """How far it is, on a terminal."""
    if sys.stderr.isatty():
        print(f"\r{stage}: {text}\033[K", end="", file=sys.stderr)


def pipeline_at(scene: wf.Scene, rung: str) -> Pipeline:
    """The scene's pipeline at a rung; what it makes stands in the cache afterwards."""
    return Pipeline(scene, wf.plan(scene, rung=rung, force={"air-loading": False}), tell, store=Store(cache_root()))


def plane(scene: wf.Scene) -> Iterator[Column]:
    """The steady end, the time-resolved end, and the best estimate between them."""
    draft, standard = pipeline_at(scene, "draft"), pipeline_at(scene, "standard")
    steady, spent = draft.solution[1] / "case", core_seconds(standard.solution[1] / "case") / 3600
    yield Column("steady", draft.airflow, [draft.field[1]], core_seconds(steady) / 3600)
    air = standard.kind
    assert isinstance(air, TimeResolvedAir)
    yield Column("2D", air.measured, [air.resolved[1]], spent)
    yield Column("blended", standard.airflow, [standard.field[1]], spent)


def deep(scene: wf.Scene) -> Column:
    """The airflow in three dimensions."""
    pipeline = pipeline_at(scene, "3d")
    case, airs = pipeline.solution[1] / "case", pipeline.kind.realisations
    fields = [made for i in range(len(airs)) if (made := airs.make(i)) is not None]
    return Column("3D", pipeline.airflow, fields, (core_seconds(case) + core_seconds(case / "span")) / 3600)


def shares(scene: wf.Scene, fields: Sequence[FlowField]) -> Shares:
    """Share of every fraction in every bin with its 95 % interval. Pairs of replicates fly in turn in ``fields``, the
    second of each pair in the mirror image; all airflows get the same granules, forces and random numbers.
    """
    plan = wf.plan(scene, rung="standard", force={"air-loading": False})
    bins = [*scene.bin, "elsewhere"]
    found: Shares = {}
    for name in scene.fraction:
        rows = np.zeros((REPLICATES, len(bins)))
        for number, field in enumerate(fields):
            for mirrored in (0, 1):
                mine = [r for r in range(REPLICATES) if r // 2 % len(fields) == number and r % 2 == mirrored]
                if not mine:
                    continue
                flown = field.reflected() if mirrored else field
                feed = feedstock(scene, plan, name, flown.period, mine)
                flight = Flight(scene, plan, Realisations(flown), scene.numerics.tolerance)
                columns = landing_columns(feed, flight.fly(name, feed.granules, stream=number), len(scene.bin))
                place = np.where(columns["bin"] < 0, len(scene.bin), columns["bin"])
                for replicate in mine:
                    rows[replicate] = np.bincount(place[feed.replicate == replicate], minlength=len(bins))
        rows /= rows.sum(axis=1, keepdims=True)
        pairs = 0.5 * (rows[::2] + rows[1::2])
        half = PAIRED * pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs))
        mean = rows.mean(axis=0)
        found[name] = {
            bin_: Number(float(m), float(m - h), float(m + h)) for bin_, m, h in zip(bins, mean, half, strict=True)
        }
    return found


def on_axis(spec: FlowSpec, fields: Sequence[FlowField]) -> tuple[Array, Array, Array]:
    """Mean speed along the air, and rms along (u') and across (v') it, at PLACES on the axis, over the inlet's speed.

    What is resolved and what a model adds, 2k/3, together.
    """
    middle, _, rear = axis_points(spec)
    x = np.column_stack([np.full(len(PLACES), middle), spec.along * (rear + PLACES * spec.mesh.projected_width)])
    velocities, modelled = [], []
    for field in fields:
        times = [0.0] if field.period is None else np.linspace(0.0, field.period, 400, endpoint=False)
        velocities += [field.sample(x, float(t))[0] for t in times]
        mean = field.mean()
        if mean.k is not None:
            as_speed = FlowField.from_arrays(mean.points, mean.triangles, np.stack([mean.k, mean.k], axis=1))
            modelled.append(as_speed.sample(x)[0][:, 0])
    u, k = np.array(velocities), np.mean(modelled, axis=0) if modelled else 0.0
    across, along = np.sqrt(u.var(axis=0).T + 2 / 3 * k) / spec.speed
    return spec.along * u.mean(axis=0)[:, 1] / spec.speed, along, across


def told(part: Number | None, digits: int = 2) -> str:
    """A number with its interval."""
    return "–" if part is None else f"{part.value:.{digits}f} ({part.low:.{digits}f} to {part.high:.{digits}f})"


def percent(row: dict[str, Number], bins: Sequence[str]) -> str:
    """The share in some bins together, %."""
    value = sum(row[name].value for name in bins)
    half = np.sqrt(sum((row[name].high - row[name].value) ** 2 for name in bins))
    return f"{100 * value:.1f} ± {100 * half:.1f}"


def print_table(body: str, spec: FlowSpec, scene: wf.Scene, columns: Sequence[Column], *, fly: bool) -> None:
    """All airflows of a body side by side."""
    width = spec.mesh.projected_width
    assert scene.first_outline is not None
    assert scene.air is not None
    rows: dict[str, list[str]] = {}

    def add(name: str, value: str) -> None:
        rows.setdefault(name, []).append(value)

    for column in columns:
        one = column.found
        add("cells", str(one.cells))
        for name, key, digits in (("Cd", "cd", 2), ("Cl rms", "cl_rms", 2), ("St", "strouhal", 3)):
            add(name, told(getattr(one, key), digits))
        add("Cp base", told(one.cp_base))
        add("reversal length / D", f"{known(known(one.suction).reversal_length) / width:.2f}")
        speed, along, across = on_axis(spec, column.fields)
        for i, place in enumerate(PLACES):
            add(f"axis, {place:g} D behind: speed, u', v'", f"{speed[i]:.2f}, {along[i]:.2f}, {across[i]:.2f}")
        stay = residence_time(column.fields, scene.first_outline, scene.air.direction, scene.air.speed)
        add("residence time, D / U", f"{stay.value:.1f} ({stay.low:.1f} to {stay.high:.1f})")
        if fly:
            found = shares(scene, column.fields)
            for name, bins in SHOWN.items():
                add(f"{name} in {bins[0].split('-')[0]}, %", percent(found[name], bins))
        add("core-hours", f"{column.core_hours:.2f}")
    print(f"\n## {body}\n\n| | {' | '.join(column.name for column in columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for name, values in rows.items():
        print(f"| {name} | {' | '.join(values)} |")


def print_proof(column: Column, spec: FlowSpec) -> None:
    """That the flow is three-dimensional, and how long it was looked at."""
    span, width = known(column.found.span), spec.mesh.projected_width
    quarters = ", ".join(f"{part:.3f}" for part in span.quarters)
    lengths = ", ".join(f"{length / width:.2f}" for length in span.integral_lengths)
    averaged = column.found.statistics
    periods = "–" if averaged is None else averaged.periods
    print(
        f"\nSpan {span.depth / width:.3g} D in {span.layers} layers, {len(span.flown)} of them flown in; "
        f"{span.recorded / spec.convective_time:.0f} D/U recorded ({periods} sheddings averaged). Rms of w in the "
        f"near wake {span.w_rms:.3f} U, in quarters of the time {quarters}; of u, v about the span's mean "
        f"{span.uv_rms:.3f} U. Integral lengths along the span of v', u', w': {lengths} D."
    )
    for note in column.found.notes or ():
        print(f"Note: {note}.")
    axis = span.axis
    print("\n| behind / D | speed | u' | v' | v' along the whole span | w' | modelled |\n|---|---|---|---|---|---|---|")
    for i, place in enumerate(axis.behind):
        parts = (getattr(axis, name)[i] for name in ("speed", "along", "across", "coherent", "spanwise", "modelled"))
        print(f"| {place:g} | {' | '.join(f'{part:.2f}' for part in parts)} |")


def main() -> None:
    """Print the tables of what the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("bodies", nargs="*", metavar="BODY", help=f"of {', '.join(BODIES)}; default: all")
    parser.add_argument("--analyse", nargs="+", type=Path, metavar="FOLDER", help="runs made by hand")
    parser.add_argument("--beside", action="store_true", help="the plane airflows beside them")
    parser.add_argument("--count", type=int, default=COUNT, help="granules of each fraction; 0: fly none")
    parser.add_argument("--begin", type=float, help="s: where the means of --analyse begin")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="changes of the scene")
    asked = parser.parse_args()
    runs = [(folder.name, folder) for folder in asked.analyse or ()] or [(b, None) for b in asked.bodies or BODIES]
    for name, folder in runs:
        body = next((known for known in BODIES if name.startswith(known)), None)
        if body is None:
            parser.error(f"{name}: its name begins with none of {', '.join(BODIES)}")
        scene = scene_of(body, asked.count or COUNT, changes_of(asked.set))
        spec = spec_of(scene)
        last = analysed(folder, spec, asked.begin) if folder is not None else deep(scene)
        others = plane(scene) if folder is None or asked.beside else ()
        print_table(name, spec, scene, [*others, last], fly=asked.count > 0)
        print_proof(last, spec)


if __name__ == "__main__":
    main()
