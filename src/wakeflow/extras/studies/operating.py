"""What an operator turns, air speed (of a fan: its turns) and feed rate: the map of every recovery, purity, loss and
dirt over both, and the capacity curve over the rate alone, each in one figure.

Each air speed's airflow is solved once and kept; the feed rates fly in it. Both are sweeps like any other, so that what
they computed is found again by them and by runs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from ...answer.result_table import ResultTable
from ...answer.shares import MET, NOT_MET, OPEN
from ...core import own_files
from ...core.errors import SceneError
from ...core.files import path_of
from ...core.quantities import say
from ...many.compute import Sweep, sweep
from ...many.variant import variants
from ...runs.planned import make_plan
from ...scene import Scene
from ...scene.scene_tables import switched

SPEED, RATE, TURNS = "air.speed", "feed.rate", "air.fan.speed_ratio"
TOTAL = "money.total"
AROUND = (0.8, 1.0, 1.2)  # times the scene's own, where no values are given
RATES = (0.25, 0.5, 1.0, 1.5, 2.0)  # of a capacity curve likewise
DRAWN = Callable[[Path, ResultTable], None]


def operating_map(
    scene: Scene | Path | str,
    out: Path | str,
    *,
    air: Sequence[object] = (),
    feed: Sequence[object] = (),
    **how: Any,
) -> tuple[Sweep, Path]:
    """Sweep ``scene`` over air speeds and feed rates, by default four fifths, once and six fifths of its own, and draw
    the map; returns both. Of air that a fan blows, ``air`` is the fan's speed_ratio. ``how``: as of
    :func:`wakeflow.sweep`.

    Raises SceneError where the scene has no air or no feed rate, where no fraction has a target, and where plans say
    that every answer would be void.
    """
    from ...show.many_figures import draw_map, main_quantities

    machine = Scene.of(scene)
    if machine.air is None or machine.air.still or not machine.feed.rate:
        raise SceneError("a map needs an air.speed above 0 and a feed.rate in the scene")
    fan = machine.air.fan
    key, now = (SPEED, machine.air.speed) if fan is None else (TURNS, fan.speed_ratio)
    speeds = list(air) if air else [part * now for part in AROUND]
    rates = list(feed) if feed else [part * machine.feed.rate for part in AROUND]
    if min(len(speeds), len(rates)) < 2:
        raise SceneError("a map needs two air speeds and two feed rates at least")

    def draw(figure: Path, table: ResultTable) -> None:
        draw_map(figure, table, main_quantities(table), key, RATE)

    return _swept(machine, {key: speeds, RATE: rates}, out, "map", draw, how)


def capacity(
    scene: Scene | Path | str, out: Path | str, *, feed: Sequence[object] = (), **how: Any
) -> tuple[Sweep, Path]:
    """Sweep ``scene`` over feed rates, by default a quarter to twice its own, and draw what is lost of every fraction
    with a target, the dirt in its bins and what a scene with prices earns over the rate; returns both. ``how`` and
    errors: as of :func:`operating_map`.
    """
    from ...show.many_figures import draw_lines

    machine = Scene.of(scene)
    if not machine.feed.rate:
        raise SceneError("a capacity curve needs a feed.rate in the scene")
    rates = list(feed) if feed else [part * machine.feed.rate for part in RATES]
    if len(rates) < 2:
        raise SceneError("a capacity curve needs two feed rates at least")

    def draw(figure: Path, table: ResultTable) -> None:
        draw_lines(figure, table, [name for name in table.names if name.startswith(("loss.", "dirt.", TOTAL))], RATE)

    return _swept(machine, {RATE: rates}, out, "capacity", draw, how)


def met_up_to(table: ResultTable, limits: Mapping[str, float]) -> dict[str, float]:
    """The feed rate (kg/s) up to which every answer of a capacity curve meets each of the ``limits``; 0 where not even
    the least does.
    """
    rows = sorted(table.done, key=lambda entry: float(entry.inputs[RATE]))
    rates = {}
    for name, most in limits.items():
        met = list(takewhile(lambda row, n=name, m=most: not row.reason and row.by_name[n].high <= m, rows))  # type: ignore[misc]
        rates[name] = float(met[-1].inputs[RATE]) if met else 0.0
    return rates


def met_at(table: ResultTable, limits: Mapping[str, float]) -> dict[str, Counter[str]]:
    """Number of settings of a map at which each of the ``limits`` is met, not met or open: as of a single run, it is
    open where the limit lies within the interval, and where anything is against the answer.
    """
    return {
        name: Counter(
            OPEN if row.reason or (quantity := row.by_name.get(name)) is None or quantity.low <= most < quantity.high
            else MET if quantity.high <= most else NOT_MET
            for row in table.done
        )
        for name, most in limits.items()
    }  # fmt: skip


def _swept(
    scene: Scene, axes: Mapping[str, Sequence[object]], out: Path | str, name: str, draw: DRAWN, how: Mapping[str, Any]
) -> tuple[Sweep, Path]:
    """The scenes of a grid of ``axes`` swept, and the figure called ``name`` that is drawn of those worth something."""
    from ...show.canvas import saved
    from ...show.many_figures import of_worth

    if not any(fraction.targets for fraction in scene.fraction.values()):
        raise SceneError("no fraction has a target, so that nothing is recovered: give fraction.NAME.target, a bin")
    grid = variants(scene, axes)
    scenes = [member.scene for member in grid if member.scene is not None]
    reasons = (make_plan(member, rung=how.get("rung"), force=switched(how.get("force"))).why_void for member in scenes)
    if len(void := list(takewhile(bool, reasons))) == len(scenes) > 0:
        raise SceneError(f"every answer of the {name} would be void: {void[0]}")
    folder = path_of(out, "out")
    figure = folder / "figures" / f"{name}.png"
    own_files.refuse_foreign(folder, saved(figure), name)
    made = sweep(grid, folder, figures=False, **how)
    table = of_worth(made.table)
    if not table.done:
        raise SceneError("every answer is void, so that there is nothing to draw; the first: see the table's reasons")
    with own_files.writing(folder, lambda: saved(figure), name):
        draw(figure, table)
    return made, figure


def met_lines(met: Mapping[str, float], limits: Mapping[str, float]) -> list[str]:
    """Words on the feed rate (kg/s) up to which each limit is met, a line each."""
    rates = {name: f"up to {say(3600.0 * rate, 'kg/h', 4)}" if rate else "at none of these rates"
             for name, rate in met.items()}  # fmt: skip
    return [f"{name} at most {100 * limits[name]:.4g} %: met {until}" for name, until in rates.items()]


def counted_lines(counts: Mapping[str, Mapping[str, int]], limits: Mapping[str, float]) -> list[str]:
    """Words on the number of settings at which each limit is met, not met and open, a line each."""
    verdicts = {
        name: ", ".join(f"{verdict} at {count}" for verdict, count in row.items()) for name, row in counts.items()
    }
    return [f"{name} at most {100 * limits[name]:.4g} %: {verdicts[name]} of {sum(row.values())} settings"
            for name, row in counts.items()]  # fmt: skip
