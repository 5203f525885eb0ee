"""What a finished run shows of itself in Python: its pictures on axes (``Result.plot``), and its card in a notebook."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..answer.result import Result, accessors, kept_granules
from ..core.errors import SceneError
from ..core.lazy import cached_property
from ..core.registry import did_you_mean
from ..core.tables import load_arrays
from ..flight.stages.solved_case import PlaneCells
from ..scene import Scene
from ..scene.pictures import STANDARD_FIGURES
from .html.rows import page_template
from .many_figures import main_quantities
from .outcome import Landed, Outcome, Track
from .plan_words import UNITS
from .vtk import ARRIVING
from .words import bins_in_words, holds

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes

    from ..answer.result_table import ResultTable
    from .canvas import AnyFigure

__all__ = ["Result", "result_card", "table_card"]  # a Result with what it shows

WARNINGS = 3  # on a card, the gravest
ROWS = 50  # of a card's table; all are in its frame


def result_card(result: Result) -> str:
    """The shares of a finished run as HTML, with their intervals, bold in a fraction's targets; the gravest warnings;
    links to the report.
    """
    landings, page = result.landings, result.folder / "report.html"
    bins = [] if landings is None else list(bins_in_words(result, landings.separation))
    card = page_template("cards.html.j2").module.result
    return str(card(result, landings, bins, result.warnings[:WARNINGS], holds(result), page))


def table_card(table: ResultTable) -> str:
    """A row a scene as HTML: its inputs, and what the table is made for, in percent with 95 % intervals."""
    return str(page_template("cards.html.j2").module.scenes(table.read_in(UNITS), main_quantities(table), ROWS))


OF_A_TRACK = {"diameter": "diameter (m)", "bin": "bin", "fate": "fate"}  # columns of tracks.vtp


@dataclass(frozen=True, repr=False)
class Plot:
    """The pictures of a finished run: ``result.plot.tracks()``, each called like its file in the folder ``figures``.

    ``result.plot.tracks(axes)`` draws on given matplotlib axes, or in a figure; a picture of several panels takes the
    place that one axes has in the grid of ``pyplot.subplots``. Without axes a new pyplot figure is made. Returns the
    axes drawn on, one or an array. ``dir(result.plot)`` names what this run has. Raises SceneError for a picture that
    it has not, and for anything but one axes or a figure to draw on.
    """

    result: Result

    @cached_property
    def outcome(self) -> Outcome:
        """What the run left in its folder to be drawn."""
        return outcome_of(self.result)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in STANDARD_FIGURES:
            if name.startswith("_"):  # asked for by notebooks and copies, not by people
                raise AttributeError(name)
            near = did_you_mean(name, list(STANDARD_FIGURES))
            raise AttributeError(f"no picture {name!r}{near} (known: {', '.join(self._known())})")
        from .figures import figures

        draw = partial(self._draw, name)
        draw.__doc__ = figures[name].caption
        return draw

    def _known(self) -> list[str]:
        """The pictures that this run has; where it left nothing to draw from, all that runs can have."""
        try:
            return self._there()
        except SceneError:
            return list(STANDARD_FIGURES)

    def __dir__(self) -> list[str]:
        return self._there()

    def __repr__(self) -> str:
        return f"pictures: {', '.join(self._there())}"

    def _there(self) -> list[str]:
        """The pictures that this run has something for, in the order of the page."""
        from .figures import figures

        return [name for name in STANDARD_FIGURES if figures[name].parts(self.outcome)]

    def _draw(self, name: str, paper: Axes | AnyFigure | None = None, *more: object, **unknown: object) -> Any:
        from matplotlib.axes import Axes
        from matplotlib.figure import Figure, SubFigure

        from .figures import figures

        wrong = [type(extra).__name__ for extra in more] + [f"{key}=" for key in unknown]
        if paper is not None and not isinstance(paper, Axes | Figure | SubFigure):
            wrong.insert(0, type(paper).__name__)
        if wrong:
            place = f"in the place of one matplotlib axes, or in a figure, plot.{name}(axes)"
            raise SceneError(f"plot.{name} draws {place}, not on {', '.join(wrong)}")
        if name not in self._there():
            raise SceneError(self._why_not(name))
        if paper is None:
            from matplotlib import pyplot

            paper = pyplot.figure(layout="constrained")
        return figures[name].draw(paper, *figures[name].parts(self.outcome))

    def _why_not(self, name: str) -> str:
        """Why a picture cannot be drawn here: there is nothing to show, or it is not kept."""
        folder = self.result.folder
        file = folder / "figures" / f"{name}.png"
        if file.exists():
            anew = f"wakeflow report {folder} draws it anew"
            return f"{name} shows more of the solved airflow than the run keeps: see {file}; {anew}"
        return f"{folder} has nothing to draw as {name}; it has {', '.join(self._there())}"


def outcome_of(result: Result) -> Outcome:
    """What a finished run has left in its folder for pictures: its air, tracks, and landings.

    Landings are those of granules.npz, ``numerics.keep`` of each fraction. Raises SceneError where the run has none, or
    drew no report.
    """
    folder, scene = result.folder, Scene.parse(dict(result.scene)).fed()
    scene = scene.without_air() if result.airflow is None else scene.with_top()
    tracks, air = folder / "tracks.vtp", folder / "field.npz"
    if result.landings is None:
        raise SceneError(f"{folder} has no pictures: the run ended before its shares")
    if not tracks.exists() or (scene.air is not None and not air.exists()):
        raise SceneError(f"{folder} holds no report to draw from; make it with: wakeflow report {folder}")
    field = None
    if scene.air is not None:
        from ..air.field import FlowField

        field = FlowField.load(air)
    granules = {head: values for head, values in kept_granules(folder).items() if head != "names"}
    cells = None if field is None else cells_left(folder / "figures" / "mesh.npz")
    return Outcome(
        scene, field, result.airflow, _tracks(tracks), cells, None, _landings(result, scene), result, {}, granules
    )


def cells_left(file: Path) -> PlaneCells | None:
    """The cells that the mesh's picture left beside itself; None where there is none."""
    if not file.exists():
        return None
    cure = f"wakeflow report {file.parent.parent} writes it anew"
    data = load_arrays(file, cure)
    try:
        points = np.stack([data["x (m)"], data["y (m)"]], axis=1)
        return PlaneCells(points, np.split(data["cell corners"], data["cell ends"][:-1]))
    except (ValueError, KeyError, IndexError, TypeError):
        raise SceneError(f"{file} is damaged; {cure}") from None


def _tracks(path: Path) -> dict[str, list[Track]]:
    """The tracks that a report left for ParaView."""
    import pyvista

    data: Any = pyvista.read(path)
    tracks: dict[str, list[Track]] = {str(name): [] for name in data.field_data["fraction_names"]}
    if not data.n_cells:
        return tracks
    names, points, cells = list(tracks), data.point_data, data.cell_data
    arriving = ARRIVING if ARRIVING in points else "velocity (m/s)"  # a report of an earlier version
    for number in range(data.n_cells):
        on = data.get_cell(number).point_ids
        track = {
            "time": cells["release (s)"][number] + np.asarray(points["time since release (s)"][on], dtype=float),
            "position": np.asarray(data.points[on, :2], dtype=float),
            "velocity": np.asarray(points["velocity (m/s)"][on, :2], dtype=float),
            "arriving": np.asarray(points[arriving][on, :2], dtype=float),
            **{key: cells[head][number] for key, head in OF_A_TRACK.items()},
        }
        tracks[names[int(cells["fraction"][number])]].append(track)
    return tracks


def _landings(result: Result, scene: Scene) -> dict[str, Landed]:
    """Where the granules that a run keeps have landed."""
    table = {head: np.asarray(column) for head, column in result.granules().items()}
    numbers = {name: number for number, name in enumerate(scene.bin)}
    bins = np.array([numbers.get(name, -1) for name in table["bin"]])
    landed = {}
    for name in scene.fraction:
        mine = table["fraction"] == name
        weight = table["weight"][mine].astype(float)
        landed[name] = Landed(table["x"][mine], table["y"][mine], weight / weight.sum(), bins[mine])
    return landed


accessors.add("plot", Plot)
accessors.add("html", result_card)
