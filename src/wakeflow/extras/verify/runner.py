"""What ``wakeflow verify`` runs: a scene and the stability matrix; all else is in the room of proofs.

The room is ``tests/proofs`` of a checkout, which also adds rows to the stability matrix, judges airflows of which
something is published, has OpenFOAM's parcels beside a scene, and needs no installation of its own; a wheel has no
room.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from ...core.errors import SceneError
from ...core.registry import did_you_mean
from .report import FOLDER, WIDE, Report, Tell

TESTS = Path(__file__).parents[4] / "tests"
Proof = Callable[[bool, Tell], Report]


def _extremes(slow: bool, tell: Tell) -> Report:
    from .extremes import run_extremes

    if room() is not None:
        import_module("proofs.extremes")  # more rows
    return run_extremes(slow=slow, tell=tell)


OWN: dict[str, Proof] = {"extremes": _extremes}
OF_THE_ROOM = (
    "tracker", "problems", "airflow", "meshes", "shares", "coverage", "tails", "calibration", "measured", "funnel",
    "crowd",
)  # fmt: skip
OPTIONAL = ("funnel", "crowd")  # each needs a program of its own: only when it is named


def room() -> Any:
    """The module ``proofs.commands`` of a checkout; None in a wheel."""
    if not (TESTS / "proofs" / "commands.py").is_file():
        return None
    if str(TESTS) not in sys.path:
        sys.path.append(str(TESTS))
    return import_module("proofs.commands")


def prove(what: str | None, *, slow: bool, tell: Tell) -> dict[str, Report]:
    """Reports by name, written into ``runs/verify``: of ``what`` (a proof, or a scene file), or of every proof but the
    optional ones. Raises SceneError for one that there is not, or that needs a checkout.
    """
    if what is not None and what.endswith(".toml"):
        reports = _of_scene(Path(what), slow, tell)
    else:
        found = room()
        proofs: Mapping[str, Proof] = OWN if found is None else {**OWN, **found.PROOFS}
        names = [what] if what is not None else [name for name in proofs if name not in OPTIONAL]
        reports = [_proof(name, proofs)(slow, tell) for name in names]
    return {report.name: report.write(FOLDER) for report in reports}


def _proof(name: str, proofs: Mapping[str, Proof]) -> Proof:
    if name in proofs:
        return proofs[name]
    if name in OF_THE_ROOM:
        raise SceneError(f"verify {name}: needs a checkout of wakeflow's repository: the proof is in its tests/proofs")
    known = [*OWN, *OF_THE_ROOM]
    raise SceneError(f"verify {name!r}: unknown{did_you_mean(name, known)} (known: {', '.join(known)})")


def _of_scene(path: Path, slow: bool, tell: Tell) -> list[Report]:
    """The airflow next to published values of a scene of which there are any; of another its error against run time,
    and with ``slow`` its airflow, where it has one about a body, on three grids.
    """
    from ...scene import Scene
    from .scene_curves import run_curves

    scene, found = Scene.load(path), room()
    if found is not None and found.is_published(path):
        return [found.of_scene(path, tell)]
    reports = [run_curves(path, FOLDER, slow=slow, tell=tell, beside=found and found.beside)]
    if slow and found and scene.air and scene.body and scene.air.case is None and scene.numerics.rung != "none":
        reports.append(found.of_scene(path, tell))
    return reports


def verdict_code(reports: Mapping[str, Report]) -> int:
    """That of the command: 1 where a row of the stability matrix was missed, or a gate that is not known to fail."""
    return int(any(report.missed for report in reports.values()))


def show(reports: Mapping[str, Report]) -> None:
    """Print every report."""
    from rich.console import Console

    console = Console()
    console.width = max(console.width, WIDE) if not console.is_terminal else console.width
    for report in reports.values():
        report.show(console)
