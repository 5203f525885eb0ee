"""What ``wakeflow verify`` runs: the proofs of this room by their names, and scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from proofs.report import FOLDER, WIDE, Report, Row, Table, Tell
from proofs.scene_curves import BinShares
from wakeflow.core.errors import SceneError
from wakeflow.core.registry import did_you_mean
from wakeflow.scene import Scene


def extremes(slow: bool, tell: Tell) -> Report:
    """What happens at the ends of what can be asked for."""
    from proofs.extremes.matrix import run_extremes

    return run_extremes(slow=slow, tell=tell)


def tracker(slow: bool, tell: Tell) -> Report:
    """The tracker's error against run time, next to an explicit one and OpenFOAM's."""
    from proofs.tracker.benchmark import run_benchmark

    return run_benchmark(FOLDER, slow=slow, tell=tell)


def problems(slow: bool, tell: Tell) -> Report:
    """Exact problems at six tolerances, and exact numbers of whole ensembles."""
    from proofs.problems.tolerances import COLUMNS, NUMBERS, run_numbers, run_problems

    rows = run_problems(lambda done, total: tell(f"exact problems: {done} of {total}"))
    numbers = run_numbers(lambda done, total: tell(f"exact numbers: {done} of {total}"))
    tables = [Table("exact problems, worst granule", COLUMNS, rows), Table("exact numbers", NUMBERS, numbers)]
    missed = [f"{row['number']}, {row['label']}: {row['value']:g}" for row in numbers if not row["holds"]]
    return Report("problems", tables, {"rows": rows, "numbers": numbers}, missed=missed)


def airflow(slow: bool, tell: Tell) -> Report:
    """Airflows next to published values."""
    from proofs.airflow.airflow import run_airflow

    return run_airflow(FOLDER, slow=slow, tell=tell)


def meshes(slow: bool, tell: Tell) -> Report:
    """Errors of steady airflows against core-seconds, by meshing strategy."""
    from proofs.airflow.meshes import FLOWS, SCALES, run_meshes

    if slow:
        return run_meshes(tell=tell)
    return run_meshes(tell=tell, scales=SCALES[:2], finest=SCALES[2:], flows=FLOWS[:1])


def shares(slow: bool, tell: Tell) -> Report:
    """Bin shares next to those of OpenFOAM's parcels."""
    from proofs.shares import run_shares

    return run_shares(slow=slow, tell=tell)


def coverage(slow: bool, tell: Tell) -> Report:
    """How often the intervals hold a known truth."""
    from proofs.coverage.report import run_coverage

    return run_coverage(slow=slow, tell=tell)


def tails(slow: bool, tell: Tell) -> Report:
    """On which side the intervals of skewed answers miss a truth in closed form."""
    from proofs.coverage.tails import run_tails

    return run_tails(slow=slow, tell=tell)


def funnel(slow: bool, tell: Tell) -> Report:
    """The feed funnel: a bead on a plate, the discharge."""
    from proofs.funnel import run_funnel

    return run_funnel(FOLDER, slow=slow, tell=tell)


def collisions(slow: bool, tell: Tell) -> Report:
    """Granules that meet, next to LIGGGHTS, OpenFOAM and kinetic theory."""
    from proofs.colliding.report import run_collisions

    return run_collisions(slow=slow, tell=tell)


def calibration(slow: bool, tell: Tell) -> Report:
    """What calibrations say of inputs and shares, where the truth is known."""
    from proofs.coverage.calibrated import run_calibration

    return run_calibration(slow=slow, tell=tell)


def measured(slow: bool, tell: Tell) -> Report:
    """Experiments with granules next to what is computed of them."""
    from proofs.experiments.report import run_measured

    return run_measured(FOLDER, slow=slow, tell=tell)


PROOFS: dict[str, Callable[[bool, Tell], Report]] = {
    proof.__name__: proof
    for proof in (
        extremes, tracker, problems, airflow, meshes, shares, coverage, tails, calibration, measured, funnel,
        collisions,
    )
}  # fmt: skip
OPTIONAL = ("funnel", "collisions")  # each needs a program of its own: only when it is named


def is_published(scene: Path) -> bool:
    """Whether something is published of the airflow of the scene in a file."""
    from proofs.airflow.airflow import is_published as known

    return known(scene)


def beside(scene: Scene, truth: BinShares, tell: Tell) -> tuple[list[Row], list[str]]:
    """What OpenFOAM's parcels make of a scene: rows, and notes."""
    from proofs.tracker.peer import beside as rows_beside

    return rows_beside(scene, truth, tell)


def of_scene(scene: Path, tell: Tell) -> Report:
    """The airflow of a scene next to published values, or on three grids."""
    from proofs.airflow.airflow import run_scene

    return run_scene(scene, FOLDER, tell=tell)


def prove(what: str | None, *, slow: bool, tell: Tell) -> dict[str, Report]:
    """Reports by name, written into ``runs/verify``: of ``what`` (a proof, or a scene file), or of every proof but the
    optional ones. Raises SceneError for one that there is not.
    """
    if what is not None and what.endswith(".toml"):
        reports = _of_scene(Path(what), slow, tell)
    elif what == "crowd":
        raise SceneError("verify crowd: is called verify collisions now")
    elif what is not None and what not in PROOFS:
        raise SceneError(f"verify {what!r}: unknown{did_you_mean(what, PROOFS)} (known: {', '.join(PROOFS)})")
    else:
        names = [what] if what is not None else [name for name in PROOFS if name not in OPTIONAL]
        reports = [PROOFS[name](slow, tell) for name in names]
    return {report.name: report.write(FOLDER) for report in reports}


def _of_scene(path: Path, slow: bool, tell: Tell) -> list[Report]:
    """The airflow next to published values of a scene of which there are any; of another its error against run time,
    and with ``slow`` its airflow, where it has one about a body, on three grids.
    """
    from proofs.scene_curves import run_curves

    scene = Scene.load(path)
    if is_published(path):
        return [of_scene(path, tell)]
    reports = [run_curves(path, FOLDER, slow=slow, tell=tell, beside=beside)]
    if slow and scene.air and scene.body and not scene.air.case and scene.numerics.rung != "none":
        reports.append(of_scene(path, tell))
    return reports


def show(reports: Mapping[str, Report]) -> None:
    """Print every report."""
    from rich.console import Console

    console = Console()
    console.width = max(console.width, WIDE) if not console.is_terminal else console.width
    for report in reports.values():
        report.show(console)
