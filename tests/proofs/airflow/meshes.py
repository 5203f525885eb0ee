"""Error against core-seconds of the meshing strategies: the same steady airflows on meshes of every strategy and size.

Two flows: a triangle at Re = 30, laminar, where the steady solution is the truth; and the rhombus of the shipped scene
at Re = 16 500, k-omega SST, on the half domain, as the rung ``draft`` solves it. The truth of each number is the
Richardson extrapolation (or, where the grids do not converge at a plausible order, the finest value) of the quads'
finest grids.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from proofs.airflow.measured import core_seconds
from proofs.report import Report, Row, Table, Tell
from wakeflow.air.foam import FlowSpec, solve_airflow
from wakeflow.air.mesh import build_mesh, plan_mesh
from wakeflow.air.mesh.spec import Strategy
from wakeflow.answer.budget.mesh import cell_size, estimate
from wakeflow.core.code_key import code_key
from wakeflow.core.errors import known
from wakeflow.core.files import case_template, write_json
from wakeflow.core.store import Store, cache_root, content_key, digest_files
from wakeflow.laws.shape import shapes

NUMBERS = ("cd", "cp_base", "reversal")  # drag and base pressure coefficients, length of the reversed flow in widths
FLOWS = ("triangle at Re 30", "rhombus at Re 16 500")
SCALES = (2.0, 2**0.5, 1.0)
FINEST = (0.5**0.5, 0.5)  # of the reference alone: quads
WIDTH = 0.05
COLUMNS = {
    "strategy": "{strategy}", "cells": "{cells}", "core-s": "{seconds:.1f}", "Cd": "{cd_error:.2g*100} %",
    "base Cp": "{cp_base_error:.2g*100} %", "reversal length": "{reversal_error:.2g*100} %",
}  # fmt: skip


def flow_of(name: str, strategy: Strategy, scale: float) -> FlowSpec:
    """One of :data:`FLOWS` on a mesh of a strategy, its cell edges ``scale`` times those of the rung draft."""
    if name == FLOWS[0]:
        body = shapes["prism"](width=WIDTH, slope_angle=math.pi / 3)  # apex upstream, inlet 10, outlet 25 widths away
        mesh = plan_mesh([body], width=1.0, top=0.5, bottom=-1.25, scale=scale, strategy=strategy)
        return FlowSpec(mesh, speed=1.0, density=1.2, viscosity=1.2 * WIDTH / 30, turbulence="laminar")
    body = shapes["rhombus"](width=WIDTH, slope_angle=math.pi / 4)
    mesh = plan_mesh([body], width=0.4, top=0.2, bottom=-0.2, scale=scale, strategy=strategy)
    return FlowSpec(mesh, speed=5.0, density=1.204, viscosity=1.825e-5, turbulence="kOmegaSST")


def solve_row(spec: FlowSpec, store: Store) -> Row:
    """Mesh and solve once, or take from the cache: cells, solver's core-seconds, iterations, the measured numbers."""

    def work(folder: Path) -> None:
        built = build_mesh(spec.mesh, folder)
        found = solve_airflow(spec, folder / "mesh.msh", folder / "case")
        smallest, reversal = known(built.smallest_edge), known(known(found.suction).reversal_length)
        row = {
            "cells": built.cells, "smallest": smallest / spec.mesh.projected_width, "steps": found.steps,
            "seconds": core_seconds(folder / "case"),
            "cd": known(found.cd).value, "cp_base": known(found.cp_base).value,
            "reversal": reversal / spec.mesh.projected_width, "verdict": found.verdict,
        }  # fmt: skip
        write_json(folder / "row.json", row)
        shutil.rmtree(folder / "case")

    code = content_key(code_key("wakeflow.air.mesh.spec", "wakeflow.air.foam.airflow"), digest_files([case_template()]))
    folder, _ = store.make("meshes", content_key("meshes", asdict(spec), code), work)
    row: Row = json.loads((folder / "row.json").read_text())
    return row


def errors(rows: Sequence[Row], reference: Sequence[Row]) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Truth of each number from the reference rows (two or more of one strategy); the rows with relative errors."""
    sizes = [cell_size(1.0, row["cells"]) for row in reference]
    truth = {}
    for name in NUMBERS:
        found = estimate(sizes, [row[name] for row in reference])
        truth[name] = found.extrapolated if math.isfinite(found.extrapolated) else found.value
    return truth, [
        {**row} | {f"{name}_error": abs(row[name] - truth[name]) / abs(truth[name]) for name in NUMBERS} for row in rows
    ]


def run_meshes(
    *,
    tell: Tell,
    scales: Sequence[float] = SCALES,
    finest: Sequence[float] = FINEST,
    flows: Sequence[str] = FLOWS,
) -> Report:
    """Solve every flow by every strategy at every scale.

    Every solution is cached, so that an interrupted study can go on. Raises MeshError and FoamError as meshing and
    solving do.
    """
    store = Store(cache_root())
    found: dict[str, Any] = {}
    for flow in flows:
        rows: list[dict[str, Any]] = []
        for strategy in get_args(Strategy):
            for scale in (*scales, *(finest if strategy == "quads" else ())):
                tell(f"{flow}: {strategy}, cells of {scale:.2g} times the draft's edge")
                rows.append({"strategy": strategy, "scale": scale, **solve_row(flow_of(flow, strategy, scale), store)})
        quads = sorted((row for row in rows if row["strategy"] == "quads"), key=lambda row: float(row["scale"]))
        truth, judged = errors(rows, quads[:3])
        found[flow] = {"truth": truth, "rows": judged}
    title = "relative errors of steady airflows against core-seconds"
    tables = [Table(f"{flow}: {title}", COLUMNS, part["rows"]) for flow, part in found.items()]
    return Report("meshes", tables, {"flows": found})
