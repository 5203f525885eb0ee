"""All that a person reads of a run: figures, VTK files, CSV files, one HTML page. It computes no physics.

Comes in: a Result, an Outcome, a table of results. Goes out: files, drawings, words.
May call it: ``runs`` and those after it. The only package that imports pyvista, matplotlib and jinja2, each inside the
function that needs it.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.files import atomic_write, link_or_copy
from .outcome import AirAndTracks, Landed, Outcome, page_additions

warnings.filterwarnings("ignore", "IProgress not found")  # pyvista brings a bar for downloads, of which there are none

if TYPE_CHECKING:
    from ..answer.result import PictureSummary
    from ..planning.feed_funnel import FunnelSummary

__all__ = [
    "AirAndTracks", "Landed", "Outcome", "added_files", "clear_report", "draw_ahead", "draw_discharge", "is_whole",
    "pictures_of", "report_files", "write_report",
]  # fmt: skip

# every finished report has them
LASTING = ("tracks.vtp", "machine.vtm", "landings.vtp", "separation.csv", "budget.csv", "report.html")
AT_TIMES = ("impact.csv",)  # where a body is met


def write_report(folder: Path | str, outcome: Outcome, ahead: Sequence[Path] = (), *, pdf: bool = False) -> Path:
    """Write figures/ (those of [picture.NAME] too), the files for ParaView, separation.csv, budget.csv and report.html
    into ``folder``. ``ahead``: the folders with what :func:`draw_ahead` and ``vtk.write_field`` have left; without any
    it is written here. ``pdf``: every figure as PDF as well.

    Every file is whole or absent; what an earlier run left and this one does not write is removed. Returns the path
    of report.html.
    """
    from . import asked_pictures as pictures
    from . import html, vtk
    from .canvas import pdf_too
    from .figures import draw_figures
    from .words import write_tables

    folder = Path(folder)
    clear_report(folder, added=False)
    for source in ahead:
        _show_too(source, folder)
    if not ahead:
        draw_ahead(folder, outcome, pdf=pdf)
        if outcome.field is not None:
            vtk.write_field(folder, outcome.field, outcome.scene, outcome.airflow)
    with pdf_too(pdf):
        draw_figures(folder / "figures", outcome, of_answer=True)
        pictures.draw_all(folder / "figures", outcome)
    vtk.write_landings(folder, outcome.granules, outcome.scene)
    write_tables(folder, outcome.result)
    return html.write_html(folder, outcome)


def draw_ahead(folder: Path, seen: AirAndTracks, *, pdf: bool = False) -> None:
    """Write into ``folder`` what of a report is there before the answer, but for the field's files: the figures of the
    machine, the air and the tracks, and machine and tracks for ParaView.
    """
    from . import vtk
    from .canvas import pdf_too
    from .figures import draw_figures

    with pdf_too(pdf):
        draw_figures(folder / "figures", seen, of_answer=False)
    vtk.write_machine(folder, seen.scene)
    vtk.write_tracks(folder, seen.tracks, seen.scene, seen.field)
    vtk.write_moving(folder, seen.tracks, seen.scene, seen.field)


def _show_too(source: Path, folder: Path) -> None:
    """Show in ``folder`` what of a report is in ``source``: files for ParaView without copying them where that can be;
    pictures, which a user may go on drawing in, as copies.
    """
    for file in report_files(source):
        target = folder / file.relative_to(source)
        if file.parent.name != "figures":
            link_or_copy(file, target)
            continue
        with atomic_write(target, "wb") as stream:
            stream.write(file.read_bytes())


def draw_discharge(path: Path | str, poured: FunnelSummary) -> None:
    """Draw the mass left in the feed funnel over time."""
    from .figures.flights import draw_discharge as draw

    draw(path, poured)


def pictures_of(folder: Path) -> dict[str, PictureSummary]:
    """What the [picture.NAME] of a finished report hold, by name; empty without any, or when a file of them is gone."""
    from . import asked_pictures as pictures

    return pictures.finished_pictures(folder / "figures")


def is_whole(folder: Path, names: Iterable[str] = ()) -> bool:
    """Whether every file that each finished report has is still there, and those of the pictures ``names``."""
    from .figures import lasting_figures

    files = [folder / file for file in LASTING] + [folder / "figures" / file for file in lasting_figures()]
    return all(file.exists() for file in files) and set(pictures_of(folder)) == set(names)


def report_files(folder: Path) -> list[Path]:
    """What is in ``folder`` of all that a report replaces there."""
    from . import vtk
    from .figures import figure_files

    files = (folder / name for name in (*LASTING, *AT_TIMES, *vtk.FILES))
    return [*(path for path in files if path.exists()), *vtk.pieces(folder), *figure_files(folder / "figures")]


def added_files(folder: Path) -> list[Path]:
    """What extras may have added to the report in ``folder``, such as a film."""
    return [folder / file for name in page_additions for file in page_additions[name].files]


def clear_report(folder: Path, *, added: bool = True) -> None:
    """Remove what an earlier report left here, so that nothing of another scene is next to the new one; without
    ``added`` what extras made of the same answer stays.
    """
    from . import asked_pictures as pictures
    from . import vtk

    for path in (*report_files(folder), *(added_files(folder) if added else ())):
        path.unlink(missing_ok=True)
    vtk.clear_pieces(folder)
    pictures.clear_pictures(folder / "figures")
