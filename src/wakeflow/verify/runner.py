"""What ``wakeflow verify`` runs: each proof writes its report into ``runs/verify`` and prints it as tables."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import SceneError
from ..core.files import write_json
from ..core.registry import did_you_mean

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

__all__ = ["PROOFS", "prove", "show", "verdict_code"]

Tell = Callable[[str], None]
FOLDER = Path("runs", "verify")
WIDE = 150  # columns of a table that goes into a file


def _tracker(slow: bool, tell: Tell) -> dict[str, Any]:
    from .trackers.benchmark import run_benchmark

    return run_benchmark(FOLDER, slow=slow, tell=tell)


def _problems(slow: bool, tell: Tell) -> dict[str, Any]:
    from .problems.tolerances import run_problems

    rows = run_problems(lambda done, total: tell(f"exact problems: {done} of {total}"))
    report = {"rows": rows}
    write_json(FOLDER / "problems.json", json.loads(json.dumps(report)))
    return report


def _airflow(slow: bool, tell: Tell) -> dict[str, Any]:
    from .airflow.airflow import run_airflow

    return run_airflow(FOLDER, slow=slow, tell=tell)


def _meshes(slow: bool, tell: Tell) -> dict[str, Any]:
    from .airflow.meshes import FLOWS, SCALES, run_meshes

    if slow:
        return run_meshes(FOLDER, tell=tell)
    return run_meshes(FOLDER, tell=tell, scales=SCALES[:2], finest=SCALES[2:], flows=FLOWS[:1])


def _funnel(slow: bool, tell: Tell) -> dict[str, Any]:
    from .funnel import run_funnel

    return run_funnel(FOLDER, slow=slow, tell=tell)


def _shares(slow: bool, tell: Tell) -> dict[str, Any]:
    from .trackers.shares import run_shares

    return run_shares(FOLDER, slow=slow, tell=tell)


def _crowd(slow: bool, tell: Tell) -> dict[str, Any]:
    from .crowd.report import run_crowd

    return run_crowd(FOLDER, slow=slow, tell=tell)


def _extremes(slow: bool, tell: Tell) -> dict[str, Any]:
    from .extremes.report import run_extremes

    return run_extremes(FOLDER, slow=slow, tell=tell)


def _coverage(slow: bool, tell: Tell) -> dict[str, Any]:
    from .coverage.report import run_coverage

    return run_coverage(FOLDER, slow=slow, tell=tell)


PROOFS: dict[str, Callable[[bool, Tell], dict[str, Any]]] = {
    "tracker": _tracker,
    "problems": _problems,
    "airflow": _airflow,
    "meshes": _meshes,
    "funnel": _funnel,
    "shares": _shares,
    "crowd": _crowd,
    "extremes": _extremes,
    "coverage": _coverage,
}
OPTIONAL = ("funnel", "crowd")  # each needs a program of its own: only when it is named


def prove(what: str | None, *, slow: bool, tell: Tell) -> dict[str, dict[str, Any]]:
    """Reports by name: of ``what`` (a proof, or a scene file), or of every proof but the optional ones.

    Raises SceneError for one that there is not.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    if what is not None and what.endswith(".toml"):
        return _of_scene(Path(what), slow, tell)
    if what is not None and what not in PROOFS:
        raise SceneError(f"verify {what!r}: unknown{did_you_mean(what, list(PROOFS))} (known: {', '.join(PROOFS)})")
    return {name: PROOFS[name](slow, tell) for name in ([what] if what else [p for p in PROOFS if p not in OPTIONAL])}


def _of_scene(path: Path, slow: bool, tell: Tell) -> dict[str, dict[str, Any]]:
    """The airflow beside published values of a scene of which there are any; of another its error against run time, and
    with ``slow`` its airflow, where it has one about a body, on three grids.
    """
    from ..scene import Scene
    from .airflow.airflow import is_published, run_scene
    from .scene_curves import run_curves

    if is_published(path):
        return {f"scene-{path.stem}": run_scene(path, FOLDER, tell=tell)}
    reports = {f"curves-{path.stem}": run_curves(path, FOLDER, slow=slow, tell=tell)}
    scene = Scene.load(path)
    if slow and scene.air is not None and scene.body and scene.air.case is None and scene.numerics.rung != "none":
        reports[f"scene-{path.stem}"] = run_scene(path, FOLDER, tell=tell)
    return reports


def verdict_code(reports: dict[str, dict[str, Any]]) -> int:
    """That of the command: 1 where a row of the stability matrix was missed, or a gate that is not known to fail."""
    return int(any(report.get("missed") for report in reports.values()))


def show(reports: dict[str, dict[str, Any]]) -> None:
    """Print the tables of every report, and where it lies."""
    from rich.console import Console

    from .proof_tables import goal_table, mesh_tables, problem_table, row_tables, share_table

    console = Console()
    console.width = max(console.width, WIDE) if not console.is_terminal else console.width
    for name, report in reports.items():
        if name == "tracker":
            tables = [*row_tables(report), goal_table(report)]
        elif name == "meshes":
            tables = mesh_tables(report)
        elif name == "funnel":
            from .funnel import funnel_tables

            tables = funnel_tables(report)
        elif name == "crowd":
            from .crowd.report import crowd_tables

            tables = crowd_tables(report)
        elif name == "extremes":
            from .extremes.report import extreme_tables

            tables = extreme_tables(report)
        elif name == "shares":
            tables = [share_table(report)]
        elif name == "coverage":
            tables = _coverage_tables(report)
        else:
            tables = [problem_table(report)] if name == "problems" else _scene_tables(name, report)
        _print(console, tables)
        for note in report.get("notes", []):
            console.print(note, highlight=False)
        console.print(f"report: {FOLDER / name}.json", highlight=False, soft_wrap=True)


def _coverage_tables(report: dict[str, Any]) -> list[Table]:
    from .coverage.report import coverage_tables

    return coverage_tables(report)


def _print(console: Console, tables: list[Table]) -> None:
    for table in tables:
        console.print(table)
        console.print()


def _scene_tables(name: str, report: dict[str, Any]) -> list[Table]:
    """Of airflows, or of one scene's error against run time."""
    from .proof_tables import airflow_tables
    from .scene_curves import curve_table

    return [curve_table(report)] if name.startswith("curves-") else airflow_tables(report)
