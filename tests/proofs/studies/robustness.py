"""The robustness matrix of the airflow: cases in which every pair of properties meets at least once.

What is missing is computed; a finished case is kept in the cache, under its content. docs/validation.md.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wakeflow.air.foam import time_resolved
from wakeflow.air.foam.airflow import solve_airflow
from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.mesh import MeshSpec, build_mesh, plan_mesh
from wakeflow.core.code_key import code_key
from wakeflow.core.errors import FoamError, MeshError
from wakeflow.core.files import case_template, write_json
from wakeflow.core.record import to_json
from wakeflow.core.store import Store, cache_root, content_key, digest_files
from wakeflow.laws.shape import shapes
from wakeflow.planning.airflow_choice import LAMINAR_BELOW

from .common import Row, show, solver_seconds

D, SPEED, DENSITY = 0.05, 2.0, 1.2
MAX_CELLS = 3000
LONGEST_START, LONGEST, ACCURACY = 40.0, 60.0, 0.1  # convective times, relative: enough to shed or to fail
SHAPES = {
    "rhombus 45": ("rhombus", {"slope_angle": np.radians(45)}),
    "rhombus 10": ("rhombus", {"slope_angle": np.radians(10)}),
    "rhombus 75": ("rhombus", {"slope_angle": np.radians(75)}),
    "prism up": ("prism", {"slope_angle": np.radians(60)}),
    "prism down": ("prism", {"slope_angle": np.radians(30), "apex": "down"}),
    "square": ("polygon", {"points": [(-D / 2, -D / 2), (D / 2, -D / 2), (D / 2, D / 2), (-D / 2, D / 2)]}),
}
FACTORS: dict[str, tuple[Any, ...]] = {
    "shape": tuple(SHAPES),
    "reynolds": (1.0, 1e2, 1e3, 3e4, 1e6),
    "blockage": (0.02, 0.1, 0.3, 0.5),
    "bodies": (1, 2, 3),
    "stepping": ("steady", "time-resolved"),
    "walls": ("slip", "no-slip"),
    "direction": ("down", "up"),
}
COLUMNS = {
    "case": "{name}", "cells": "{cells}", "verdict": "{verdict}", "settings that served": "{settings}",
    "Cd": "{cd:.3g}", "mass error": "{mass_error:.0e}", "nearest limit, share of it": "{limit}",
    "CPU s": "{processor_seconds:.0f}",
}  # fmt: skip
Case = dict[str, Any]


def pairwise_cover(factors: Mapping[str, Sequence[Any]]) -> list[Case]:
    """Cases in which every two values of two factors meet (all-pairs, greedy: each case begins with a pair that is
    still missing and takes, factor by factor, the value that covers most of the others).
    """
    names = list(factors)

    def pair(a: str, x: Any, b: str, y: Any) -> frozenset[tuple[str, Any]]:
        return frozenset({(a, x), (b, y)})

    missing = [pair(a, x, b, y) for a, b in itertools.combinations(names, 2) for x in factors[a] for y in factors[b]]
    left = set(missing)
    cases: list[Case] = []
    while left:
        case: Case = dict(next(entry for entry in missing if entry in left))
        for name in names:
            if name not in case:
                taken = dict(case)
                gain = [sum(pair(name, v, b, y) in left for b, y in taken.items()) for v in factors[name]]
                uses = [sum(c[name] == v for c in cases) for v in factors[name]]
                case[name] = min(zip(factors[name], gain, uses, strict=True), key=lambda t: (-t[1], t[2]))[0]
        left -= {pair(a, case[a], b, case[b]) for a, b in itertools.combinations(names, 2)}
        cases.append({name: case[name] for name in names})
    return cases


CASES = pairwise_cover(FACTORS)


def name_of(case: Case) -> str:
    """A short name of a case."""
    return ", ".join(
        [
            case["shape"],
            f"Re {case['reynolds']:.0e}".replace("e+0", "e"),
            f"{100 * case['blockage']:.0f} %",
            f"{case['bodies']} bod{'y' if case['bodies'] == 1 else 'ies'}",
            *(case[name] for name in ("stepping", "walls", "direction")),
        ]
    )


def mesh_of(case: Case, scale: float) -> MeshSpec:
    """Bodies one behind the other, the second and third to the sides, in a channel of the case's width."""
    kind, how = SHAPES[case["shape"]]
    outline = shapes[kind](**how) if kind == "polygon" else shapes[kind](width=D, **how)
    width = D / case["blockage"]
    aside = min(0.2 * (width - D), 0.75 * D)
    behind = (-1.0 if case["direction"] == "down" else 1.0) * (float(np.ptp(outline[:, 1])) + D)
    places = [(0.0, 0.0), (aside, behind), (-aside, 2 * behind)][: case["bodies"]]
    bodies = [outline + place for place in places]
    return plan_mesh(
        bodies,
        width=width,
        top=max(float(body[:, 1].max()) for body in bodies) + D,
        bottom=min(float(body[:, 1].min()) for body in bodies) - D,
        walls=case["walls"],
        direction=case["direction"],
        rung="draft" if case["stepping"] == "steady" else "standard",
        scale=scale,
    )


def coarse_mesh(case: Case, folder: Path) -> MeshSpec:
    """Build the finest mesh, of a few sizes tried, that stays within MAX_CELLS."""
    scale = 1.5
    while True:
        spec = mesh_of(case, scale)
        try:
            cells = build_mesh(spec, folder).cells
        except MeshError as problem:
            if "angle" not in str(problem) or scale > 4:
                raise
            cells = 2 * MAX_CELLS  # an unlucky size: another one
        if cells <= MAX_CELLS:
            return spec
        scale *= max(1.08, (cells / MAX_CELLS) ** 0.5)


def flow_of(case: Case, mesh: MeshSpec) -> FlowSpec:
    """The case's airflow, with the turbulence model that the plan would choose."""
    flow = FlowSpec(mesh, SPEED, DENSITY, DENSITY * SPEED * D / case["reynolds"], turbulence="laminar")
    model = "laminar" if case["reynolds"] < LAMINAR_BELOW else "kOmegaSST"
    return replace(flow, turbulence=model, stepping=case["stepping"], accuracy=ACCURACY)


@contextmanager
def short_runs() -> Iterator[None]:
    """Time-resolved airflows end early for a while."""
    limits = time_resolved.LONGEST_START, time_resolved.MAX_CONVECTIVE_TIMES
    time_resolved.LONGEST_START, time_resolved.MAX_CONVECTIVE_TIMES = LONGEST_START, LONGEST
    try:
        yield
    finally:
        time_resolved.LONGEST_START, time_resolved.MAX_CONVECTIVE_TIMES = limits


def outcome(case: Case) -> dict[str, Any]:
    """Solve a case, or take its outcome from the cache: the airflow's table, or ``error`` with the one line said."""
    code = [code_key("wakeflow.air.mesh", "wakeflow.air.foam.airflow"), digest_files([case_template(), Path(__file__)])]

    def work(folder: Path) -> None:
        before = solver_seconds()
        with short_runs():
            try:
                flow = flow_of(case, coarse_mesh(case, folder))
                table = to_json(solve_airflow(flow, folder / "mesh.msh", folder / "case"))
            except (MeshError, FoamError) as problem:
                table = {"error": str(problem), "kind": type(problem).__name__}
        write_json(folder / "outcome.json", {**table, "processor_seconds": solver_seconds() - before})

    folder, _ = Store(cache_root()).make("robustness", content_key(case, code), work)
    result: dict[str, Any] = json.loads((folder / "outcome.json").read_text())
    return result


def row(case: Case) -> Row:
    """A row of the table."""
    found = outcome(case)
    row = {**dict.fromkeys(("cells", "settings", "cd", "mass_error", "limit")), "name": name_of(case), **found}
    if "error" in found:
        return row | {"verdict": found["error"]}
    tightest, used = max(found["checks"].items(), key=lambda item: item[1])
    failed = "".join(f"; {attempt['settings']}: {attempt['cause']}" for attempt in found["attempts"])
    told = {"settings": found["settings"] + failed, "limit": f"{tightest.split(',')[0]} {used:.2f}"}
    return row | told | {"cd": found["cd"]["value"]}


def main(*numbers: int) -> list[Row]:
    """The robustness matrix of the airflow, rows as they come, or only the cases of these numbers."""
    return show(COLUMNS, (row(CASES[number]) for number in numbers or range(len(CASES))))
