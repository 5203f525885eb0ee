"""Twenty cheap laminar wakes: does the interval at the stop cover the value of a run eight times as long?

Each wake is run once, eight times as long as the rule asks; the stop is replayed on its record. Records are kept in the
test cache, so that an interrupted session goes on with the next wake.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.foam.solver import purge, run_segment
from wakeflow.air.foam.start import perturb, prepare_case
from wakeflow.air.foam.statistics import Statistics, Stopping, Tail, evaluate
from wakeflow.air.foam.watch import Watch
from wakeflow.air.mesh import build_mesh, plan_mesh
from wakeflow.core.number import Number
from wakeflow.core.store import Store, cache_root, content_key

WIDTH, ACCURACY, LONGER = 1.0, 0.02, 8.0
MAX_TIMES, SPARE = (
    130.0,
    60.0,
)  # convective times that a case may take to its stop; that its record lasts beyond 8 times it
ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
SHAPES = {
    "circle": 0.5 * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]),
    "square": np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]),
    "diamond": np.array([(0, -0.5), (0.5, 0), (0, 0.5), (-0.5, 0)]),
    "triangle": np.array([(0, -0.433), (0.5, 0.433), (-0.5, 0.433)]),  # its apex meets the air
    "wedge": np.array([(-0.5, -0.433), (0.5, -0.433), (0, 0.433)]),  # its base does
}
WAKES = [  # shape, Reynolds number, share of the channel that the body blocks
    *product(("circle", "square", "diamond", "triangle"), (100.0, 200.0), (0.08, 0.25)),
    ("circle", 70.0, 0.08), ("triangle", 60.0, 0.08), ("wedge", 100.0, 0.08), ("wedge", 150.0, 0.2),
]  # fmt: skip


def wake(shape: str, reynolds: float, blockage: float) -> FlowSpec:
    """Upward air at 1 m/s past a body 1 m wide; about 2000 cells."""
    mesh = plan_mesh(
        [SHAPES[shape]], width=WIDTH / blockage, top=9.0, bottom=-4.0, direction="up", rung="standard", scale=2.2
    )
    return FlowSpec(mesh, 1.0, 1.0, WIDTH / reynolds, turbulence="laminar", stepping="time-resolved")


def stop_of(rows: np.ndarray) -> float | None:
    """When the rule ends the run (s), looking once a convective time; None while it does not."""
    stopping = Stopping(ACCURACY)
    looks = np.arange(15.0, rows[-1, 0] + 1e-9)
    return next((float(t) for t in looks if stopping.look(rows[rows[:, 0] <= t])), None)


def long_record(spec: FlowSpec, folder: Path) -> None:
    """Run to eight times the stop and leave record.npy (n, 4): time, Cd, Cl, base pressure coefficient."""
    shutil.rmtree(folder / "case", ignore_errors=True)
    build_mesh(spec.mesh, folder)
    case = folder / "case"
    prepare_case(spec, folder / "mesh.msh", case)
    perturb(spec, case)
    watch = Watch(case, "start-up", lambda _: None, expected=MAX_TIMES)
    end, now = LONGER * MAX_TIMES, 20.0
    while now < end:
        run_segment(case, "pimpleFoam", now, {"deltaT": 1e-3}, watch)
        purge(case)
        found = stop_of(Tail(case).update())
        end = LONGER * found + SPARE if found else end
        now += 20.0
    np.save(folder / "record.npy", Tail(case).update())
    shutil.rmtree(case)


def record_of(shape: str, reynolds: float, blockage: float) -> tuple[FlowSpec, np.ndarray]:
    spec = wake(shape, reynolds, blockage)
    store = Store(cache_root())
    key = content_key("stopping", repr(spec), LONGER)
    folder, _ = store.make("stopping", key, lambda part: long_record(spec, part))
    return spec, np.load(folder / "record.npy")


QUANTITIES: dict[str, Callable[[Statistics], Number | None]] = {
    "Cd": lambda s: s.cd, "Cl rms": lambda s: s.cl_rms, "St": lambda s: s.frequency, "Cp base": lambda s: s.cp_base,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.openfoam
@pytest.mark.timeout(7200)
def test_the_interval_at_the_stop_covers_a_run_eight_times_as_long() -> None:
    table, hits = [], {name: [] for name in QUANTITIES}  # type: ignore[var-annotated]
    for shape, reynolds, blockage in WAKES:
        _, rows = record_of(shape, reynolds, blockage)
        end = stop_of(rows)
        assert end is not None, (shape, reynolds, blockage)
        assert rows[-1, 0] >= LONGER * end * 0.999
        short, long = (evaluate(rows[rows[:, 0] <= t], ACCURACY) for t in (end, LONGER * end))
        assert long is not None
        cells = [f"{shape} | {reynolds:.0f} | {blockage:.2f} | {end:.0f} | {short.begin:.0f} | {short.periods}"]
        for name, of in QUANTITIES.items():
            at_stop, later = of(short), of(long)
            covered = at_stop.low <= later.value <= at_stop.high
            hits[name].append(covered)
            half = 0.5 * (at_stop.high - at_stop.low)
            cells.append(f"{at_stop.value:.4g} ± {half:.2g} | {later.value:.4g}{'' if covered else ' (missed)'}")
        table.append("| " + " | ".join(cells) + " |")
    heads = ["body", "Re", "blockage", "stop, D/U", "start-up, D/U", "periods"]
    heads += [text for name in QUANTITIES for text in (name, "8 times as long")]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|", *table]
    lines.append("\ncovered: " + ", ".join(f"{name} {sum(hit)} of {len(hit)}" for name, hit in hits.items()))
    print("\n" + "\n".join(lines))
    Path(os.environ["WAKEFLOW_CACHE"], "stopping.md").write_text("\n".join(lines) + "\n")
    for name, hit in hits.items():
        assert sum(hit) >= 0.9 * len(WAKES), name
