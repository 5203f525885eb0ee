"""The report of a run: pictures, VTK files, CSV files and one HTML page. Draws what it is handed, computes no physics.

The only package that imports pyvista, matplotlib and jinja2, each inside the function that needs it.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from .outcome import Landed, Outcome

if TYPE_CHECKING:
    from ..results.funnel_summary import FunnelSummary
    from ..results.result import PictureSummary

__all__ = ["Landed", "Outcome", "clear_report", "draw_discharge", "is_whole", "pictures_of", "write_report"]

LASTING = ("tracks.vtp", "separation.csv", "budget.csv", "report.html")  # every finished report has them
AT_TIMES = ("field.npz", "field.vtu", "field.pvd", "impact.csv")  # with air, and where a body is met


def write_report(folder: Path | str, outcome: Outcome, field_files: Path | None = None) -> Path:
    """Write figures/ (those of [picture.NAME] too), field and tracks for ParaView, separation.csv, budget.csv and
    report.html into ``folder``. The field's files are linked from ``field_files``, where they stand already, else
    written.

    Every file is whole or absent; what an earlier run left and this one does not write is removed. Returns the path
    of report.html.
    """
    from . import csv, html, pictures, vtk
    from .figures import draw_figures

    folder = Path(folder)
    clear_report(folder)
    draw_figures(folder / "figures", outcome)
    pictures.draw_all(folder / "figures", outcome)
    if field_files is not None:
        vtk.link_field(field_files, folder)
    elif outcome.field is not None:
        vtk.write_field(folder, outcome.field)
    vtk.write_tracks(folder, outcome.tracks)
    csv.write_tables(folder, outcome.result)
    return html.write_html(folder, outcome)


def draw_discharge(path: Path | str, poured: FunnelSummary) -> None:
    """Draw the mass left in the feed funnel over time."""
    from .figures.discharge import draw_discharge as draw

    draw(path, poured)


def pictures_of(folder: Path) -> dict[str, PictureSummary]:
    """What the [picture.NAME] of a finished report hold, by name; empty without any, or when a file of them is gone."""
    from . import pictures

    return pictures.found(folder / "figures")


def is_whole(folder: Path, names: Iterable[str] = ()) -> bool:
    """Whether every file that each finished report has is still there, and those of the pictures ``names``."""
    from .figures import lasting_figures

    files = [folder / file for file in LASTING] + [folder / "figures" / file for file in lasting_figures()]
    return all(file.exists() for file in files) and set(pictures_of(folder)) == set(names)


def clear_report(folder: Path) -> None:
    """Remove what an earlier report left here, so that nothing of another scene stands beside the new one."""
    from . import pictures
    from .figures import clear_figures

    for name in (*LASTING, *AT_TIMES):
        (folder / name).unlink(missing_ok=True)
    clear_figures(folder / "figures")
    pictures.clear_pictures(folder / "figures")
    shutil.rmtree(folder / "field", ignore_errors=True)
