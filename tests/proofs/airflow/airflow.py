"""The airflow beside published values: scenes of ``cases/verify``, computed by the pipeline of every other scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from proofs.airflow.measured import RESIDENCE, SolvedAirflow, estimate_without, measured, quantities, within_estimate
from proofs.airflow.published import Case, Published, cases, verification_scenes
from proofs.report import NOTHING, Column, Report, Row, Table, Tell, cell
from support import as_computed
from wakeflow.air.kinds.airflow_table import GridEstimate
from wakeflow.answer.budget.mesh import cell_size, estimate
from wakeflow.core.errors import FoamError, MeshError, SceneError
from wakeflow.core.number import Number
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.laws.momentum import momentum_pressure
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

REPORTED = "reported"  # in place of a gate
COLUMNS: dict[str, Column] = {
    "case": "{title}", "rung": "{rung}", "quantity": "{quantity}",
    "published": lambda row: " to ".join(f"{one:.5g}" for one in dict.fromkeys(row["theirs"] or ())) or NOTHING,
    "ours": "{ours:.4g}", "95 % or mesh error": lambda row: NOTHING if row["low"] is None else cell(BAND, row),
    "deviation %": lambda row: _percent(row["deviation"]), "gate": "{gate}",
    "met": lambda row: NOTHING if row["met"] is None else cell("{met:yes|NO}", row), "order": "{order:.2f}",
    "cells": "{cells}", "core-s": "{core_seconds:.0f}", "date": "{date}",
    "status": lambda row: row["status"] or NOTHING,
    "source": lambda row: "; ".join(filter(None, (row["source"], row["why"] and f"reported: {row['why']}"))) or NOTHING,
}  # fmt: skip
BAND = "{low:.4g} to {high:.4g}"
MOMENTUM: dict[str, Column] = {
    "case": "{title}", "front Cp: 2 cos^2 beta": "{cp_model:.2f}", "computed": "{cp_computed:.2f}",
    "base Cp": "{cp_base:.2f}", "Cd by momentum": "{cd_model:.2f}", "Cd computed": "{cd_computed:.2f}",
    "ratio": lambda row: f"{row['cd_model'] / row['cd_computed']:.2f}",
}  # fmt: skip
GRIDS = (1.0, 1.5, 2.25)  # mesh scales of the study of a scene that nothing is published of
AIR_TABLES = ("body", "channel", "air", "vibration")  # what an airflow depends on, its numerics apart
SHARED = ("cd", "cl_rms", "strouhal", "cp_base", "reversal")  # what is studied there


# Each is one number of one case. ``low`` .. ``high`` holds the 95 % interval of the finest mesh, or, where several were
# computed, the mesh error with it (``error`` says how, ``order`` the observed one). ``theirs``: low and high of what is
# published; ``deviation`` relative to its nearer end. ``met``: None where nothing is asked, and ``why`` is the reason.
Rows = list[Row]


def run_airflow(folder: Path, *, slow: bool = False, tell: Tell = lambda _: None) -> Report:
    """Compute the quick cases, with ``slow`` all.

    Everything is cached: the same call goes on after an interruption. Where the mesh or airflow of a case fails the
    others are still computed; FoamError is raised at the end, after the report is written.
    """
    chosen = [case for case in cases().values() if case.quick or (slow and not case.alone)]
    apart = [
        f"{case.title}: not computed here but by `wakeflow verify cases/verify/{case.name}.toml`; {case.note}"
        for case in cases().values()
        if case.alone
    ]
    return _run(folder, "airflow", [(case, _scene(case)) for case in chosen], tell, apart)


def run_scene(path: Path, folder: Path, *, tell: Tell = lambda _: None) -> Report:
    """The same for one scene, ``scene-NAME``: the case of its file's name where the body,
    the channel and the air are that case's; a study on three grids of any other, since nothing is published of it.
    """
    scene = Scene.load(path)
    if scene.air is None:
        raise SceneError(f"{path}: no [air] table: there is no airflow to verify")
    known = _published(path, scene) or Case(path.stem, path.stem, scales=GRIDS)
    return _run(folder, f"scene-{path.stem}", [(known, scene)], tell)


def is_published(path: Path) -> bool:
    """Whether something is published of the airflow of the scene in a file."""
    return _published(path, Scene.load(path)) is not None


def _published(path: Path, scene: Scene) -> Case | None:
    """The case of a file's name, where the body, the channel and the air are that case's."""
    known = cases().get(path.stem)
    if known is None or any(getattr(_scene(known), table) != getattr(scene, table) for table in AIR_TABLES):
        return None
    return known


def _scene(case: Case) -> Scene:
    return Scene.load(verification_scenes()[case.name])


def _run(
    folder: Path, name: str, chosen: Sequence[tuple[Case, Scene]], tell: Tell, apart: Sequence[str] = ()
) -> Report:
    facts: dict[str, Any] = {"rows": [], "momentum": [], "failed": []}
    notes = [f"{case.title}: {case.note}" for case, _ in chosen if case.note] + list(apart)
    for case, scene in chosen:
        tell(case.title)
        try:
            rows, beside = compare_case(case, scene, tell)
        except (FoamError, MeshError) as problem:
            facts["failed"].append({"case": case.name, "why": str(problem)})
            continue
        facts["rows"] += rows
        facts["momentum"].append(beside)
    failed = facts["failed"]
    notes += [f"failed: {failure['case']}: {failure['why']}" for failure in failed]
    tables = [
        Table("airflow: published and computed", COLUMNS, facts["rows"]),
        Table("the momentum model and the computed airflow", MOMENTUM, facts["momentum"]),
    ]
    report = Report(name, tables, facts, notes)
    if failed:
        report.write(folder)
        names = ", ".join(failure["case"] for failure in failed)
        raise FoamError(f"failed: {names}; {failed[0]['why']}; the others: {folder / name}.md")
    return report


def _percent(value: float | None) -> str:
    return NOTHING if value is None else f"{100 * value:{'+.0f' if abs(value) >= 0.995 else '+.2g'}}"


def compare_case(case: Case, scene: Scene, tell: Tell = lambda _: None) -> tuple[Rows, Row]:
    """All rows of one case, and the momentum model beside it. Drags published without walls are brought to the
    scene's blockage first.
    """
    case = case.between_walls(scene.width / scene.channel.width)
    asked = tuple(dict.fromkeys(v.quantity for v in case.values)) or SHARED
    grids = [solve(scene, scale, None, tell) for scale in sorted(case.scales)]
    rung, finest = grids[0]
    numbers = {name: quantities[name].of(finest) for name in asked}
    studies = grid_study([airflow for _, airflow in grids], asked, scene)
    rows = [
        _row(case, rung, finest, v, numbers[v.quantity], studies.get(v.quantity), _an_end(case, v.quantity))
        for v in case.values
    ]
    if not case.values:
        rows = [_plain(case, rung, finest, name, numbers[name], studies.get(name)) for name in asked if numbers[name]]
    rows += _order_row(case, rung, finest, studies)
    if case.beside is not None:
        beside = solve(scene, min(case.scales), case.beside, tell)
        rows += _beside_rows(case, rows, *beside)
        if case.blend is not None:
            rows += _blended_rows(case, scene, finest, beside[1])
    return rows, momentum(case, scene, finest)


def solve(scene: Scene, scale: float, rung: str | None, tell: Tell) -> tuple[str, SolvedAirflow]:
    """The rung that was computed, and the airflow on a mesh ``scale`` times as coarse as the scene's own."""
    changed = scene if scale == 1.0 else scene.replace({"numerics.mesh_scale": scale * scene.numerics.mesh_scale})
    plan = as_computed(make_plan(changed, rung=rung))
    pipeline = Pipeline(changed, plan, listener=lambda stage, text: tell(f"{stage} at mesh scale {scale:g}: {text}"))
    return plan.rung, measured(pipeline)


def grid_study(airflows: Sequence[SolvedAirflow], names: Sequence[str], scene: Scene) -> dict[str, GridEstimate]:
    """Grid convergence of the quantities that all grids have; empty for one grid."""
    if len(airflows) < 2:
        return {}
    area = scene.channel.width * (scene.channel.top - scene.channel.bottom)  # of any size: only ratios count
    sizes = [cell_size(area, airflow.cells) for airflow in airflows]
    studies = {}
    for name in names:
        found = [quantities[name].of(airflow) for airflow in airflows]
        numbers = [number for number in found if number is not None]
        if len(numbers) == len(airflows):
            studies[name] = estimate(sizes, [n.value for n in numbers], [n.half for n in numbers])
    return studies


def _plain(
    case: Case, rung: str, airflow: SolvedAirflow, name: str, number: Number | None, study: GridEstimate | None
) -> Row:
    shown = study or number
    value, low, high = (None, None, None) if shown is None else (shown.value, shown.low, shown.high)
    return {
        "case": case.name, "title": case.title, "rung": rung, "quantity": quantities[name].label, "ours": value,
        "low": low, "high": high, "theirs": None, "deviation": None, "within": None, "gate": REPORTED,
        "why": "nothing is published of it", "met": None, "cells": airflow.cells, "core_seconds": airflow.cost,
        "date": airflow.day, "error": "one grid" if study is None else study.kind,
        "order": None if study is None or math.isnan(study.order) else study.order, "source": "", "status": "",
    }  # fmt: skip


def _row(
    case: Case, rung: str, airflow: SolvedAirflow, known: Published, number: Number | None, study: GridEstimate | None,
    reported: str = "",
) -> Row:  # fmt: skip
    deviation = None if number is None else known.deviation(number.value)
    why = reported or known.reported
    within = None if why else known.within
    met = None if within is None else deviation is not None and abs(deviation) <= within
    gate = REPORTED if within is None else f"{100 * within:.2g} %" if within > 0.0 else "in the range"
    known_of = {"theirs": (known.low, known.high), "source": known.source, "status": known.status}
    judged = {"deviation": deviation, "within": within, "gate": gate, "why": why, "met": met}
    return {**_plain(case, rung, airflow, known.quantity, number, study), **known_of, **judged}


def _order_row(case: Case, rung: str, airflow: SolvedAirflow, studies: dict[str, GridEstimate]) -> Iterator[Row]:
    for name, least in case.order.items():
        study = studies[name]
        shown = {
            "quantity": f"order of {quantities[name].label}", "ours": study.order, "low": None, "high": None, "why": "",
            "gate": f"at least {least:g}", "met": study.order >= least, "source": study.why,
        }  # fmt: skip
        yield {**_plain(case, rung, airflow, name, None, study), **shown}


def _an_end(case: Case, quantity: str) -> str:
    """Why a value is not judged in the own rung of a case that is blended; empty where it is."""
    return "an end of the blend, which is judged" if case.blend is not None and quantity == RESIDENCE else ""


def _beside_rows(case: Case, own: Rows, rung: str, airflow: SolvedAirflow) -> Iterator[Row]:
    """The other rung's numbers, only reported; whether the scene's own rung is closer where it has to be, and whether
    what is published lies between the two.
    """
    why = f"rung {rung}, beside the scene's own"
    rows = [_row(case, rung, airflow, v, quantities[v.quantity].of(airflow), None, why) for v in case.values]
    yield from (row for row in rows if row["ours"] is not None)
    pairs = [(v, mine, beside) for v, mine, beside in zip(case.values, own, rows, strict=False)]
    if case.closer is not None:
        mine, beside = next((mine, beside) for v, mine, beside in pairs if v.quantity == case.closer)
        distances = [float("inf") if row["deviation"] is None else abs(row["deviation"]) for row in (mine, beside)]
        yield _asked(mine, f"closer than {rung}", distances[0] < distances[1])
    for known, mine, beside in pairs:
        if known.checked(case.between) and mine["ours"] is not None and beside["ours"] is not None:
            low, high = sorted((mine["ours"], beside["ours"]))
            yield _asked(mine, f"between {rung} and {mine['rung']}", low <= known.low and known.high <= high)


def _blended_rows(case: Case, scene: Scene, own: SolvedAirflow, beside: SolvedAirflow) -> Iterator[Row]:
    """The residence time in the best estimate between the two rungs, which knows nothing of what it is judged by.

    Its interval holds those at both ends of the ranges of theta and of the strength.
    """
    assert case.blend is not None
    assert scene.reynolds is not None
    assert own.wake is not None
    assert beside.wake is not None
    blockage = scene.width / scene.channel.width
    estimate = estimate_without(RESIDENCE, case.blend, blockage, scene.reynolds)
    found = list(within_estimate(own.wake, beside.wake, estimate))
    band = min(one.low for one in found), max(one.high for one in found)
    number = None if found[0].closed else Number(found[0].value, *band)
    rung = f"blend {estimate.theta.value:.2f}, {estimate.strength.value:.2f}"
    yield from (_row(case, rung, own, v, number, None) for v in case.values if v.quantity == RESIDENCE)


def _asked(row: Row, gate: str, met: bool) -> Row:
    """The row once more, judged by another gate."""
    return {**row, "within": None, "error": "", "gate": gate, "why": "", "met": met}


def momentum(case: Case, scene: Scene, airflow: SolvedAirflow) -> dict[str, Any]:
    """The paper's momentum model beside the computed front pressure and drag of the first body."""
    assert scene.air is not None
    model = momentum_pressure(next(iter(scene.body.values())).outline(), scene.air.direction)
    front, base, drag = (quantities[name].of(airflow) for name in ("cp_front", "cp_base", "cd"))
    assert front is not None
    assert base is not None
    assert drag is not None
    return {
        "case": case.name, "title": case.title, "cp_model": float(model.cp.max()), "cp_computed": front.value,
        "cd_model": model.drag(base.value), "cd_computed": drag.value, "cp_base": base.value,
    }  # fmt: skip
