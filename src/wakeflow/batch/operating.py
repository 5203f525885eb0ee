"""The operator's map: recovery and purity of every target over the air's speed and the feed rate, in one figure.

Each air speed's airflow is solved once and kept; the feed rates fly in it. The map is a sweep like any other, so that
what it computed is found again by it and by runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from ..core import sums
from ..core.errors import SceneError
from ..core.files import path_of
from ..planning.make import make_plan
from ..scene import Scene
from ..scene.whole import switched
from .compute import Sweep, sweep
from .variant import variants

SPEED, RATE = "air.speed", "feed.rate"
AROUND = (0.8, 1.0, 1.2)  # times the scene's own, where no values are given
FIGURE = "map.png"


def operating_map(
    scene: Scene | Path | str,
    out: Path | str,
    *,
    air: Sequence[object] | None = None,
    feed: Sequence[object] | None = None,
    **how: Any,
) -> tuple[Sweep, Path]:
    """Sweep ``scene`` over air speeds and feed rates, by default four fifths, once and six fifths of its own, and draw
    the map; returns both. ``how``: as of :func:`wakeflow.sweep`.

    Raises SceneError where the scene has no air or no feed rate, and where no fraction has a target.
    """
    asked = Scene.of(scene)
    if asked.air is None or asked.air.still or asked.feed.rate is None:
        raise SceneError("a map needs an air.speed above 0 and a feed.rate in the scene")
    if not any(fraction.targets for fraction in asked.fraction.values()):
        raise SceneError("no fraction has a target, so that nothing is recovered: give fraction.NAME.target, a bin")
    speeds = list(air) if air else [part * asked.air.speed for part in AROUND]
    rates = list(feed) if feed else [part * asked.feed.rate for part in AROUND]
    if min(len(speeds), len(rates)) < 2:
        raise SceneError("a map needs two air speeds and two feed rates at least")
    grid = variants(asked, {SPEED: speeds, RATE: rates})
    scenes = [one.scene for one in grid if one.scene is not None]
    told = (make_plan(one, rung=how.get("rung"), force=switched(how.get("force"))).why_void for one in scenes)
    if len(void := list(takewhile(bool, told))) == len(scenes) > 0:
        raise SceneError(f"every answer of the map would be void: {void[0]}")
    from ..report.canvas import saved
    from ..report.many import draw_map, main_quantities
    from ..report.table_figures import of_worth

    folder = path_of(out, "out")
    figure = folder / "figures" / FIGURE
    sums.refuse_foreign(folder, saved(figure), "map")
    found = sweep(grid, folder, figures=False, **how)
    table = of_worth(found.table)
    if not table.done:
        raise SceneError("every answer is void, so that there is nothing to draw; the first: see the table's reasons")
    with sums.writing(folder, lambda: saved(figure), "map"):
        draw_map(figure, table, main_quantities(table), SPEED, RATE)
    return found, figure
