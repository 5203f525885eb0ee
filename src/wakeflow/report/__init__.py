"""The report of a run: pictures, VTK files, tables and one HTML page. Draws what it is handed and computes no physics.

The only package that imports pyvista, matplotlib and jinja2, each inside the function that needs it.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from ..field import FlowField
    from ..scene import Scene

__all__ = ["Outcome", "clear", "draw_discharge", "is_whole", "pictures_of", "write_report"]


class Outcome(Protocol):
    """What a run hands to its report.

    ``field`` and ``airflow`` are None in a vacuum; ``tracks``: fraction to dicts of time (m,) s, position (m, 2) m,
    velocity (m, 2) m/s, diameter () m; ``landings``: fraction to x, y (n,) m, weight (n,), bin (n,); ``result``: the
    dict that result.json holds; ``shown``: the tracks of each [picture.NAME], as ``tracks``.
    """

    @property
    def scene(self) -> Scene: ...
    @property
    def field(self) -> FlowField | None: ...
    @property
    def airflow(self) -> Mapping[str, Any] | None: ...
    @property
    def tracks(self) -> Mapping[str, Sequence[Mapping[str, Any]]]: ...
    @property
    def landings(self) -> Mapping[str, Mapping[str, Any]]: ...
    @property
    def result(self) -> Mapping[str, Any]: ...
    @property
    def shown(self) -> Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]: ...


def write_report(folder: Path | str, outcome: Outcome) -> Path:
    """Write figures/ (those of [picture.NAME] too), field and tracks for ParaView, separation.csv, budget.csv and
    report.html into ``folder``.

    Every file is whole or absent; what an earlier run left and this one does not write is removed. Returns the path
    of report.html.
    """
    from . import figures, html, pictures, tables, vtk

    folder = Path(folder)
    clear(folder)
    drawings = folder / "figures"
    scene, field, result = outcome.scene, outcome.field, outcome.result
    positions = {name: [track["position"] for track in part] for name, part in outcome.tracks.items()}
    if scene.body and field is not None and field.pressure is not None and outcome.airflow is not None:
        figures.draw_pressure(drawings / "pressure.png", field, scene, outcome.airflow)
    figures.draw_tracks(drawings / "tracks.png", field, scene, positions)
    figures.draw_landing(drawings / "landing.png", scene, outcome.landings, result.get("separation"))
    if result.get("funnel") is not None:
        draw_discharge(drawings / "discharge.png", result["funnel"])
    pictures.draw_all(drawings, outcome)
    if field is not None:
        vtk.write_field(folder, field)
    vtk.write_tracks(folder, outcome.tracks)
    if "separation" in result:
        tables.write_separation_csv(folder / "separation.csv", result)
    if "budget" in result:
        tables.write_budget_csv(folder / "budget.csv", result)
    if tables.impact_rows(result):
        tables.write_impact_csv(folder / "impact.csv", result)
    return html.write_html(folder, result)


def draw_discharge(path: Path | str, poured: Mapping[str, Any]) -> None:
    """The mass left in the feed funnel over time; ``poured``: the ``funnel`` table of result.json."""
    from . import discharge

    discharge.draw_discharge(path, poured)


def pictures_of(folder: Path) -> dict[str, Any]:
    """What the [picture.NAME] of a finished report hold: kind, files, text and numbers by name; empty without any, or
    when a file of them is gone.
    """
    from . import pictures

    return pictures.found(folder / "figures")


def is_whole(folder: Path, names: Iterable[str] = ()) -> bool:
    """Whether every file that each finished report has is still there, and those of the pictures ``names``."""
    files = ("tracks.vtp", "separation.csv", "budget.csv", "report.html", "figures/tracks.png", "figures/landing.png")
    return all((folder / file).exists() for file in files) and set(pictures_of(folder)) == set(names)


def clear(folder: Path) -> None:
    """Remove what an earlier report left here, so that nothing of another scene stands beside the new one."""
    from . import pictures

    names = ("field.vtu", "field.pvd", "tracks.vtp", "separation.csv", "budget.csv", "impact.csv", "report.html")
    for name in names:
        (folder / name).unlink(missing_ok=True)
    for name in ("pressure", "tracks", "landing", "discharge"):
        (folder / "figures" / f"{name}.png").unlink(missing_ok=True)
    pictures.clear(folder / "figures")
    shutil.rmtree(folder / "field", ignore_errors=True)
