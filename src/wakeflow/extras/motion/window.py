"""The machine in a window of its own, by PyVista: bodies, bins, and of a finished run the air and granules in time."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core import own_files
from ...core.errors import SceneError
from ...core.files import atomic_write
from ...show.canvas import BARS, BODY, fraction_colours
from ...show.plan_words import feed_corners
from ...show.vtk import machine_blocks

if TYPE_CHECKING:
    from ...scene import Scene

SIZE = (1200, 900)  # pixels
ENDED_PART = 0.98  # of the tracks have ended at the slider's end
TRACK, BAR = 2.0, 8.0  # pixels wide
PALE = 0.5  # opacity of the air
FRONT = (0.0, 0.0, 1e-4)  # m: before the air
SINCE = "time since release (s)"
ANEW = "draw it anew with: wakeflow report RUN"


def look(scene: Scene, run: Path | None = None, picture: Path | None = None) -> None:
    """Open a window on a scene, and on what is in the folder of its finished ``run``: the air's speed on its mesh,
    and the tracks up to a time since release that a slider sets. Returns when it is closed.

    With ``picture`` no window opens, and a PNG of what it would show goes there. Raises SceneError for another file.
    """
    import pyvista
    from PIL import Image

    if picture is not None and picture.suffix.lower() != ".png":
        raise SceneError(f"{picture}: the picture of a window is a PNG; name it so")
    quiet: Any = nullcontext() if picture is None else pyvista.vtk_verbosity("off")  # VTK misses a screen, aloud
    with quiet:
        plotter: Any = pyvista.Plotter(off_screen=picture is not None, window_size=SIZE)
        plotter.set_background("white")
        if run is not None:
            _add_air(plotter, run)
            _add_tracks(plotter, scene, run, slider=picture is None)
        _add_machine(plotter, scene)
        plotter.view_xy()
        _frame(plotter, scene)
        if picture is None:
            plotter.show(title="wakeflow")
        else:
            drawn = Image.fromarray(plotter.screenshot(None, return_img=True))
            plotter.close()
            with atomic_write(picture, "wb") as stream:
                drawn.save(stream, "PNG")


def _add_machine(plotter: Any, scene: Scene) -> None:
    """Bodies, walls, bins with their names."""
    blocks = machine_blocks(scene)
    for body in blocks["bodies"].values():
        plotter.add_mesh(body.translate(FRONT).triangulate(), color=BODY, lighting=False)
        plotter.add_mesh(body.translate(FRONT).extract_all_edges(), color="black", line_width=1.5)
    for wall in blocks["walls"].values():
        plotter.add_mesh(wall.translate(FRONT), color="black", line_width=2.0)
    for number, line in enumerate(blocks["bins"].values()):
        plotter.add_mesh(line.translate(FRONT), color=BARS[number % 2], line_width=BAR)
    middles = np.array([line.points.mean(axis=0) + FRONT for line in blocks["bins"].values()])
    plotter.add_point_labels(middles, list(scene.bin), font_size=14, shape_opacity=0.7, show_points=False)


def _add_air(plotter: Any, run: Path) -> None:
    """The air's speed: the steady field, or the mean of the one in time; nothing where the run has no air."""
    import pyvista

    files = [file for file in (run / "field.vtu", run / "mean.vtu") if file.exists()]
    if not files:
        return
    own_files.check(run, files[0].name, ANEW)
    grid: Any = pyvista.read(files[0])
    velocity = np.asarray(grid.point_data["velocity (m/s)"])
    grid.point_data["air speed (m/s)"] = np.linalg.norm(velocity, axis=1)
    bar = {"title": "air speed (m/s)", "vertical": True, "height": 0.4, "color": "black"}
    plotter.add_mesh(grid, scalars="air speed (m/s)", cmap="Blues", opacity=PALE, lighting=False, scalar_bar_args=bar)


def _add_tracks(plotter: Any, scene: Scene, run: Path, *, slider: bool) -> None:
    """The granules' tracks, a colour a fraction; with a ``slider`` up to a time since release."""
    import pyvista

    if not (run / "tracks.vtp").exists():
        return
    own_files.check(run, "tracks.vtp", ANEW)
    tracks: Any = pyvista.read(run / "tracks.vtp").translate(FRONT)
    flown = [tracks.get_cell(number).point_ids for number in range(tracks.n_cells)]
    ends = [float(tracks.point_data[SINCE][ids[-1]]) for ids in flown if len(ids) > 1]
    if not ends:
        return
    fraction, colours = tracks.cell_data["fraction"], fraction_colours(list(scene.fraction))
    parts = {name: tracks.extract_cells(np.flatnonzero(fraction == i)) for i, name in enumerate(scene.fraction)}

    def shown(until: float) -> None:
        for name, part in parts.items():
            here = part.clip_scalar(scalars=SINCE, value=until) if part.n_cells else part
            if here.n_cells:
                plotter.add_mesh(
                    here, color=colours[name], line_width=TRACK, lighting=False, name=f"tracks {name}", label=name
                )

    shown(max(ends))
    plotter.add_legend(bcolor="white", face="line", size=(0.15, 0.12))
    if slider:
        last = float(np.quantile(ends, ENDED_PART))
        plotter.add_slider_widget(shown, (0.0, last), value=last, title=SINCE, color="black")


def _frame(plotter: Any, scene: Scene) -> None:
    """The channel fills the window, whatever is computed beyond its ends."""
    channel, margin = scene.channel, 0.06
    low, high = channel.bottom, max(channel.top, float(feed_corners(scene)[:, 1].max()))
    plotter.enable_parallel_projection()
    camera = plotter.camera
    middle = (low + high) / 2
    camera.focal_point, camera.position = (0.0, middle, 0.0), (0.0, middle, 1.0)
    camera.parallel_scale = (0.5 + margin) * max(high - low, channel.width * SIZE[1] / SIZE[0])
