"""The reference runs in three dimensions, next to the steady, the time-resolved and the blended wake of the scene.

The shipped scene with each of the BODIES, 12.5 % blocked, Re 16 500, downward air: three core-hours a body with the
defaults, 40 minutes with --set numerics.mesh_scale=1.6; what is in the cache goes on or is read. --second-span: all
of them on another depth for longer, after which the first depth is known to be enough, or not. --analyse FOLDER reads
a run made by hand instead: ``flat`` the one-layer case, ``deep`` the extruded one, ``packed`` and ``layers.npz`` as
of ``wakeflow.air.foam.spanwise.span_record``; its name begins with the body's. The tables of docs/model.md.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

import wakeflow as wf
from proofs.airflow.measured import core_seconds
from proofs.airflow.residence import residence_time
from support import shipped
from wakeflow.air.field import FlowField
from wakeflow.air.field.combined import cross_faded
from wakeflow.air.foam.airflow_result import AirflowResult
from wakeflow.air.foam.case import FlowSpec, axis_points
from wakeflow.air.foam.read import CaseFields
from wakeflow.air.foam.spanwise.span_measure import measure_span
from wakeflow.air.foam.spanwise.span_record import SpanRecord, lead_of, read_layers
from wakeflow.air.kinds.airflow_kinds import Realisations, flow_spec, mesh_spec
from wakeflow.core.number import Number
from wakeflow.core.store import Store, cache_root
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight, landing_columns
from wakeflow.planning.plan import REPLICATES
from wakeflow.scene.overrides import changes_of

from .common import BARE, Pipeline, Row, make_plan, show

Array = NDArray[np.float64]
PRISM = {"body.rhombus.shape": "prism", "body.rhombus.slope_angle": "60 deg"}
BODIES: dict[str, dict[str, Any]] = {
    "rhombus": {},
    "prism-up": {**PRISM, "body.rhombus.apex": "up"},
    "prism-down": {**PRISM, "body.rhombus.apex": "down"},
    "square": {
        "body.rhombus.shape": "polygon", "body.rhombus.width": None, "body.rhombus.slope_angle": None,
        "body.rhombus.points": [[-0.025, -0.025], [0.025, -0.025], [0.025, 0.025], [-0.025, 0.025]],
    },
    "steep-rhombus": {"body.rhombus.slope_angle": "60 deg"},
}  # fmt: skip
SECOND_SPAN = ("numerics.span.depth=4.0", "numerics.span.shedding_cycles=40", "numerics.mesh_scale=1.6")
START_UP = 25.0  # convective times of a run made by hand that are no part of its means
COUNT = 4096  # granules of each fraction
PLACES = np.array([0.5, 1.0, 1.5, 2.0, 3.0, 4.0])  # widths behind the body, in the profiles
PAIRED = 2.36  # Student's t of the 8 pairs of replicates, 95 %
AXIS = {
    "speed": "speed", "u'": "along", "v'": "across", "v' along the whole span": "coherent", "w'": "spanwise",
    "modelled": "modelled",
}  # fmt: skip
SHOWN = {"dust": ("middle",), "chaff": ("middle",), "wheat": ("outer-left", "outer-right")}
Shares = dict[str, dict[str, tuple[float, float]]]  # and half of the interval


@dataclass(frozen=True, eq=False)
class Column:
    """One airflow of a body: its numbers, the fields that granules fly in, core-hours."""

    name: str
    found: AirflowResult
    fields: Sequence[FlowField]
    core_hours: float


def scene_of(body: str, count: int = COUNT, changes: dict[str, Any] | None = None) -> wf.Scene:
    """The shipped scene with one of the BODIES."""
    return shipped("rhombus", {**BODIES[body], "feed.count": count, **(changes or {})})


def spec_of(scene: wf.Scene) -> FlowSpec:
    """Its airflow in three dimensions."""
    plan = wf.plan(scene, rung="3d")
    return flow_spec(scene, plan, mesh_spec(scene, plan))


def analysed(folder: Path, spec: FlowSpec, begin: float | None = None) -> Column:
    """A run made by hand, from ``begin`` (s) on."""
    record = SpanRecord(folder, CaseFields(folder / "flat"))
    since = START_UP * spec.convective_time if begin is None else begin
    found = measure_span(spec, record, folder / "deep", since)
    fields = []
    for arrays in read_layers(record, found.span.flown, since, spec.density):
        field = FlowField.from_arrays(**arrays)
        fields.append(cross_faded(field, lead_of(spec, field.times)))
    return Column("3D", found, fields, core_seconds(folder / "deep") / 3600)


def tell(stage: str, text: str) -> None:
    """How far it is, on a terminal."""
    if sys.stderr.isatty():
        print(f"\r{stage}: {text}\033[K", end="", file=sys.stderr)


def pipeline_at(scene: wf.Scene, rung: str, *, loaded: bool = False) -> Pipeline:
    """The scene's pipeline at a rung, its air under the granules' force or not; what it makes is in the cache then."""
    return Pipeline(scene, make_plan(scene, rung=rung, force={"air-loading": loaded}), tell, store=Store(cache_root()))


def plane(scene: wf.Scene, *, loaded: bool = False) -> Iterator[Column]:
    """The steady end, the time-resolved end, and the best estimate between them."""
    draft, standard = (pipeline_at(scene, rung, loaded=loaded) for rung in ("draft", "standard"))
    steady, spent = (
        draft.air.in_case.solution[1] / "case",
        core_seconds(standard.air.in_case.solution[1] / "case") / 3600,
    )
    yield Column("steady", draft.airflow, [draft.field[1]], core_seconds(steady) / 3600)
    air = standard.kind
    yield Column("2D", air.measured, [air.resolved[1]], spent)
    yield Column("blended", standard.airflow, [standard.field[1]], spent)


def deep(scene: wf.Scene, *, loaded: bool = False) -> Column:
    """The airflow in three dimensions."""
    pipeline = pipeline_at(scene, "3d", loaded=loaded)
    case, airs = pipeline.air.in_case.solution[1] / "case", pipeline.air.realisations
    fields = [made for i in range(len(airs)) if (made := airs.make(i)) is not None]
    return Column("3D", pipeline.airflow, fields, (core_seconds(case) + core_seconds(case / "span")) / 3600)


def shares(scene: wf.Scene, fields: Sequence[FlowField]) -> Shares:
    """Share of every fraction in every bin with its 95 % interval. Pairs of replicates fly in turn in ``fields``, the
    second of each pair in the mirror image; all airflows get the same granules, forces and random numbers.
    """
    plan, bins = make_plan(scene, rung="standard", force=BARE), [*scene.bin, "elsewhere"]
    found: Shares = {}
    for name in scene.fraction:
        rows = np.zeros((REPLICATES, len(bins)))
        for number, mirrored in np.ndindex(len(fields), 2):
            mine = [r for r in range(REPLICATES) if r // 2 % len(fields) == number and r % 2 == mirrored]
            if not mine:
                continue
            flown = fields[number].reflected() if mirrored else fields[number]
            feed = feedstock(scene, plan, name, flown.period, mine)
            flight = Flight(scene, plan, Realisations(flown), scene.numerics.tolerance)
            columns = landing_columns(feed, flight.fly(name, feed.granules, stream=number), len(scene.bin))
            place = np.where(columns["bin"] < 0, len(scene.bin), columns["bin"])
            for replicate in mine:
                rows[replicate] = np.bincount(place[feed.replicate == replicate], minlength=len(bins))
        rows /= rows.sum(axis=1, keepdims=True)
        pairs, mean = 0.5 * (rows[::2] + rows[1::2]), rows.mean(axis=0)
        half = PAIRED * pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs))
        found[name] = {place: (float(m), float(h)) for place, m, h in zip(bins, mean, half, strict=True)}
    return found


def on_axis(spec: FlowSpec, fields: Sequence[FlowField]) -> tuple[Array, Array, Array]:
    """Mean speed along the air, and rms along (u') and across (v') it, at PLACES on the axis, over the inlet's speed.

    What is resolved and what a model adds, 2k/3, together.
    """
    middle, _, rear = axis_points(spec)
    x = np.column_stack([np.full(len(PLACES), middle), spec.along * (rear + PLACES * spec.mesh.projected_width)])
    velocities, modelled = [], []
    for field in fields:
        times = np.linspace(0.0, field.period, 400, endpoint=False) if field.period else [0.0]
        velocities += [field.sample(x, float(t))[0] for t in times]
        mean = field.mean()
        if mean.has("k"):
            as_speed = FlowField.from_arrays(mean.points, mean.triangles, np.stack([mean.k, mean.k], axis=1))
            modelled.append(as_speed.sample(x)[0][:, 0])
    u, k = np.array(velocities), np.mean(modelled, axis=0) if modelled else 0.0
    across, along = np.sqrt(u.var(axis=0).T + 2 / 3 * k) / spec.speed
    return spec.along * u.mean(axis=0)[:, 1] / spec.speed, along, across


def told(part: Number | None, digits: int = 2) -> str:
    """A number with its interval."""
    return "–" if part is None else f"{part.value:.{digits}f} ({part.low:.{digits}f} to {part.high:.{digits}f})"


def percent(row: dict[str, tuple[float, float]], bins: Sequence[str]) -> str:
    """The share in some bins together, %."""
    half = np.sqrt(sum(row[name][1] ** 2 for name in bins))
    return f"{100 * sum(row[name][0] for name in bins):.1f} ± {100 * half:.1f}"


def numbers(spec: FlowSpec, scene: wf.Scene, column: Column, *, fly: bool) -> dict[str, str]:
    """What is compared of one airflow."""
    one, width = column.found, spec.mesh.projected_width
    found = {"cells": str(one.cells)}
    for name, key, digits in (
        ("Cd", "cd", 2),
        ("Cl rms", "cl_rms", 2),
        ("St", "strouhal", 3),
        ("Cp base", "cp_base", 2),
    ):
        found[name] = told(getattr(one, key), digits)
    found["reversal length / D"] = f"{one.suction.reversal_length / width:.2f}"
    for place, *parts in zip(PLACES, *on_axis(spec, column.fields), strict=True):
        found[f"axis, {place:g} D behind: speed, u', v'"] = ", ".join(f"{part:.2f}" for part in parts)
    stay = residence_time(column.fields, scene.first_outline, scene.air.direction, scene.air.speed)
    found["residence time, D / U"] = f"{stay.value:.1f} ({stay.low:.1f} to {stay.high:.1f})"
    flown = shares(scene, column.fields) if fly else {}
    for name, bins in SHOWN.items() if fly else ():
        found[f"{name} in {bins[0].split('-')[0]}, %"] = percent(flown[name], bins)
    return found | {"core-hours": f"{column.core_hours:.2f}"}


def print_table(body: str, spec: FlowSpec, scene: wf.Scene, columns: Sequence[Column], *, fly: bool) -> list[Row]:
    """All airflows of a body side by side."""
    found = {column.name: numbers(spec, scene, column, fly=fly) for column in columns}
    rows = ({"": name, **{title: cells[name] for title, cells in found.items()}} for name in next(iter(found.values())))
    return show(("", *found), rows, f"## {body}")


def print_proof(column: Column, spec: FlowSpec) -> None:
    """That the flow is three-dimensional, and how long it was looked at."""
    span, width = column.found.span, spec.mesh.projected_width
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
    axis = vars(span.axis)
    heads = {"behind / D": "{behind:g}", **{head: f"{{{key}:.2f}}" for head, key in AXIS.items()}}
    print()
    show(heads, (dict(zip(axis, row, strict=False)) for row in zip(*axis.values(), strict=False)))


def main(
    *bodies: str, analyse: tuple[Path, ...] = (), beside: bool = False, count: int = COUNT, begin: float | None = None,
    second_span: bool = False, flat: bool = False, loaded: bool = False,
    changes: Annotated[tuple[str, ...], Parameter(name="--set")] = (),
) -> None:  # fmt: skip
    """Reference runs in three dimensions: rhombus, prism-up, prism-down, square, steep-rhombus; all unless named.

    Parameters
    ----------
    analyse: runs made by hand
    beside: the plane airflows next to them
    count: granules of each fraction; 0: none fly
    begin: s, where the means of --analyse begin
    second_span: 4 widths deep for 40 sheddings, on a mesh of scale 1.6
    flat: the plane airflows and the best estimate alone, a minute or two a body
    loaded: under the granules' force on the air
    changes: KEY=VALUE, changes of the scene
    """
    runs = [(folder.name, folder) for folder in analyse] or [(body, None) for body in bodies or BODIES]
    for name, folder in runs:
        body = next((known for known in BODIES if name.startswith(known)), None)
        if body is None:
            raise SystemExit(f"{name}: its name begins with none of {', '.join(BODIES)}")
        scene = scene_of(body, count or COUNT, changes_of((*(SECOND_SPAN if second_span else ()), *changes)))
        spec = spec_of(scene)
        others = list(plane(scene, loaded=loaded)) if folder is None or beside else []
        if flat:
            print_table(name, spec, scene, others, fly=count > 0)
            continue
        last = analysed(folder, spec, begin) if folder is not None else deep(scene, loaded=loaded)
        print_table(name, spec, scene, [*others, last], fly=count > 0)
        print_proof(last, spec)
