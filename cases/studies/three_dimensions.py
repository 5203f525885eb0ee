"""The reference runs in three dimensions, beside the steady and the time-resolved wake in two.

.venv/bin/python cases/studies/three_dimensions.py --analyse FOLDER...

FOLDER holds a run as ``wakeflow.foam.span_record`` describes it, its one-layer case in ``flat`` and the solver's in
``deep``; its name begins with that of a body: rhombus, prism-up or prism-down.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wakeflow as wf
from wakeflow.field import FlowField
from wakeflow.field.cross_fade import cross_faded
from wakeflow.foam.case import FlowSpec
from wakeflow.foam.case_fields import CaseFields
from wakeflow.foam.cost import core_seconds
from wakeflow.foam.history import Interval, Tail
from wakeflow.foam.measure import mean_pressure
from wakeflow.foam.read import nodes_of
from wakeflow.foam.reconstruction import triangulate
from wakeflow.foam.span_means import AxisProfile, SpanMeans, axis_profile, span_means
from wakeflow.foam.span_read import apart, read_layers
from wakeflow.foam.span_record import SpanRecord
from wakeflow.foam.statistics import Statistics, evaluate
from wakeflow.foam.suction import Suction, suction_zone
from wakeflow.injection.feed import feedstock
from wakeflow.pipeline.specs import flow_spec, mesh_spec
from wakeflow.pipeline.tracks import Flight, landing_columns
from wakeflow.planning.plan import REPLICATES

Array = NDArray[np.float64]
SCENE = Path(__file__).parent.parent / "rhombus.toml"
PRISM = {"body.rhombus.shape": "prism", "body.rhombus.slope_angle": "60 deg"}
BODIES: dict[str, dict[str, Any]] = {
    "rhombus": {},
    "prism-up": {**PRISM, "body.rhombus.apex": "up"},
    "prism-down": {**PRISM, "body.rhombus.apex": "down"},
}
START_UP = 25.0  # convective times at least, in which the plane wake that a run starts from breaks up
LEAD = 3.0  # convective times of the cross-fade: half a usual shedding period
COUNT = 4096  # granules of each fraction
SHOWN = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)  # widths behind the body, in the profiles


def scene_of(body: str, count: int = COUNT) -> wf.Scene:
    """The shipped scene with one of the BODIES."""
    return wf.Scene.load(SCENE).replace({**BODIES[body], "feed.count": count})


def spec_of(scene: wf.Scene) -> FlowSpec:
    """Its time-resolved airflow."""
    plan = wf.plan(scene, rung="standard")
    return flow_spec(scene, plan, mesh_spec(scene, plan))


@dataclass(frozen=True, eq=False)
class Found:
    """What one run in three dimensions says; coefficients as ``AirflowResult`` has them."""

    name: str
    statistics: Statistics | None
    cd: Interval
    cl_rms: Interval
    strouhal: Interval | None
    cp_base: Interval
    suction: Suction
    profile: AxisProfile
    means: SpanMeans
    core_hours: float
    recorded: float  # s
    layers: int
    cells: int


def analyse(folder: Path, spec: FlowSpec, begin: float | None = None) -> tuple[Found, SpanRecord]:
    """Means over time and span of a run, and its record; ``begin`` (s) of the averages, by default START_UP."""
    record = SpanRecord(folder, CaseFields(folder / "flat"))
    scale = spec.convective_time
    rows = Tail(folder / "deep").update()
    rows = rows[rows[:, 0] >= (START_UP * scale if begin is None else begin)]
    found = evaluate(rows, spec.accuracy)
    since = float(rows[0, 0])
    means = span_means(spec, record, since)
    drag, lift, base = (_of(rows, i) for i in (1, 2, 3))
    rms = float(np.sqrt(np.trapezoid((rows[:, 2] - lift.value) ** 2, rows[:, 0]) / np.ptp(rows[:, 0])))
    layers, cells = record.order.shape
    return Found(
        name=folder.name,
        statistics=found,
        cd=found.cd if found else drag,
        cl_rms=found.cl_rms if found else Interval(rms, 0.0, float(np.ptp(rows[:, 2]))),
        strouhal=None if found is None or found.frequency is None else Interval(
            *(scale * x for x in (found.frequency.value, found.frequency.low, found.frequency.high))
        ),
        cp_base=found.cp_base if found else base,
        suction=_suction(spec, record, means),
        profile=axis_profile(spec, record, means),
        means=means,
        core_hours=core_seconds(folder / "deep") / 3600,
        recorded=float(np.ptp(rows[:, 0])),
        layers=layers,
        cells=layers * cells,
    ), record  # fmt: skip


def _of(rows: Array, column: int) -> Interval:
    mean = float(np.trapezoid(rows[:, column], rows[:, 0]) / np.ptp(rows[:, 0]))
    return Interval(mean, float(rows[:, column].min()), float(rows[:, column].max()))


def _suction(spec: FlowSpec, record: SpanRecord, means: SpanMeans) -> Suction:
    plane, latest = record.plane.mesh.plane, record.plane.folder("latest")
    shot = record.snapshot(means.mean)
    nodes = nodes_of(record.plane, latest, [shot]).mean()
    cp = (nodes.pressure - mean_pressure(plane, [shot], plane.on("inlet"))) / (0.5 * spec.speed**2)
    body = plane.on(*(name for name in plane.patches if name.startswith("body_")))
    triangles = triangulate(plane.points, plane.cells)
    return suction_zone(spec, plane.points, triangles, cp, nodes.velocity, np.unique(plane.faces[body]))


def fields_of(record: SpanRecord, found: Found, spec: FlowSpec) -> list[FlowField]:
    """Layers apart from each other, each as one long period."""
    width = spec.mesh.projected_width
    chosen = apart(record, width, found.means.integral_lengths[1])
    step = float(np.median(np.diff(found.means.times)))
    lead = max(1, round(LEAD * spec.convective_time / step))
    made = []
    for arrays in read_layers(record, chosen, found.means.begin, spec.density):
        made.append(cross_faded(FlowField.from_arrays(**arrays), lead))
    return made


def shares(scene: wf.Scene, fields: list[FlowField], workers: int | None = None) -> dict[str, dict[str, Interval]]:
    """Share of every fraction in every bin and its 95 % interval over the replicates, which fly in turn in ``fields``
    and, every other one, in their mirror images.
    """
    plan = wf.plan(scene, rung="standard")
    found: dict[str, dict[str, Interval]] = {}
    for name in scene.fraction:
        rows = np.zeros((REPLICATES, len(scene.bin) + 1))
        for number, field in enumerate(fields):
            for mirrored in (False, True):
                mine = [r for r in range(REPLICATES) if r // 2 % len(fields) == number and r % 2 == int(mirrored)]
                if not mine:
                    continue
                flown = field.reflected() if mirrored else field
                flight = Flight(scene, plan, flown, scene.numerics.tolerance, workers)
                feed = feedstock(scene, plan, name, field.period, mine)
                columns = landing_columns(feed, flight.fly(name, feed.granules, stream=number), len(scene.bin))
                for replicate in mine:
                    bins = columns["bin"][columns["replicate"] == replicate]
                    rows[replicate] = np.bincount(np.where(bins < 0, len(scene.bin), bins), minlength=rows.shape[1])
        rows /= rows.sum(axis=1, keepdims=True)
        pairs = 0.5 * (rows[::2] + rows[1::2])
        half = 2.36 * pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs))  # Student's t of 8 pairs
        means = rows.mean(axis=0)
        found[name] = {
            bin_: Interval(float(m), float(m - h), float(m + h))
            for bin_, m, h in zip([*scene.bin, "elsewhere"], means, half, strict=True)
        }
    return found


def told(part: Interval | None, digits: int = 2) -> str:
    """A number with its interval."""
    return "-" if part is None else f"{part.value:.{digits}f} ({part.low:.{digits}f} to {part.high:.{digits}f})"


def print_found(found: Found, spec: FlowSpec) -> None:
    """Everything measured on one run."""
    width, speed, means = spec.mesh.projected_width, spec.speed, found.means
    spanwise, other = means.three_dimensional
    rows = [
        ("cells, layers", f"{found.cells}, {found.layers}"),
        ("averaged, D/U", f"{found.recorded / spec.convective_time:.1f}"),
        ("shedding periods averaged", "-" if found.statistics is None else str(found.statistics.periods)),
        ("Cd", told(found.cd)),
        ("Cl rms", told(found.cl_rms)),
        ("St", told(found.strouhal, 3)),
        ("Cp base", told(found.cp_base)),
        ("reversal length / D", f"{found.suction.reversal_length / width:.2f}"),
        ("Cp < -0.5: length, width / D", f"{found.suction.length / width:.2f}, {found.suction.width / width:.2f}"),
        ("rms of w, and of u, v about the span's mean, / U", f"{spanwise / speed:.3f}, {other / speed:.3f}"),
        ("the same in quarters of the time", "; ".join(f"{a / speed:.3f}, {b / speed:.3f}" for a, b in means.parts())),
        (
            "integral lengths of u, v, w along the span / D",
            ", ".join(f"{x / width:.2f}" for x in means.integral_lengths),
        ),
        ("core-hours", f"{found.core_hours:.2f}"),
    ]
    print(f"\n## {found.name}\n\n| quantity | three-dimensional |\n|---|---|")
    for name, value in rows:
        print(f"| {name} | {value} |")
    print("\n| behind the body / D | mean speed | u' | v' | w' | modelled |\n|---|---|---|---|---|---|")
    p = found.profile
    for i, behind in enumerate(p.behind):
        if behind in SHOWN:
            cells = (p.speed, p.along, p.across, p.spanwise, p.modelled)
            print(f"| {behind:g} | " + " | ".join(f"{column[i]:.2f}" for column in cells) + " |")


def print_shares(found: dict[str, dict[str, Interval]]) -> None:
    """Shares in per cent."""
    bins = list(next(iter(found.values())))
    print("\n| % | " + " | ".join(bins) + " |\n|---" * 1 + "|---" * len(bins) + "|")
    for fraction, row in found.items():
        cells = (f"{100 * x.value:.1f} ± {100 * (x.high - x.value):.1f}" for x in row.values())
        print(f"| {fraction} | " + " | ".join(cells) + " |")


def report(folder: Path, count: int, begin: float | None) -> None:
    """Analyse one run and print what it says."""
    body = next((name for name in BODIES if folder.name.startswith(name)), None)
    if body is None:
        raise SystemExit(f"{folder}: its name begins with none of {', '.join(BODIES)}")
    scene = scene_of(body, count or COUNT)
    spec = replace(spec_of(scene), accuracy=0.05)
    found, record = analyse(folder, spec, begin)
    print_found(found, spec)
    if count:
        started = time.monotonic()
        print_shares(shares(scene, fields_of(record, found, spec)))
        print(f"flown in {time.monotonic() - started:.0f} s", file=sys.stderr)


def main() -> None:
    """Print the tables of the runs named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--analyse", nargs="+", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--count", type=int, default=COUNT, help="granules of each fraction; 0: fly none")
    parser.add_argument("--begin", type=float, help="of the averages, s")
    asked = parser.parse_args()
    for folder in asked.analyse:
        report(folder, asked.count, asked.begin)


if __name__ == "__main__":
    main()
