"""``wakeflow verify SCENE``: error against run time, as a person who has so much time meets it.

The scene is answered within each budget, from an empty cache and once more with its airflows there, report included.
The error is that of the bin shares, model and all, against the best that the program has: the airflow of the reference
rung, other random numbers, four times the granules, a tenth of the tolerance. It is shown beside the interval that the
answer states. Seconds are those of idle cores, so that other programs may run meanwhile. In a checkout OpenFOAM's own
parcels are on the same axes (``tests/proofs/tracker``).
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from proofs.idle_clock import IdleClock
from proofs.report import Report, Row, Table, Tell
from wakeflow import runs
from wakeflow.answer.result import Result
from wakeflow.answer.shares import Separation
from wakeflow.core.errors import SceneError
from wakeflow.core.process import cores
from wakeflow.core.quantities import duration
from wakeflow.core.store import cache_root
from wakeflow.core.tables import CellTable
from wakeflow.flight.stages.compilation import compile_ahead
from wakeflow.planning.stages import stages
from wakeflow.runs import time_budget
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.show.canvas import COLOURS, new_figure, save

BUDGETS = (5.0, 15.0, 30.0, 60.0, 120.0, 300.0, 1200.0)  # s
EMPTY, WITH_AIR = "empty cache", "airflows in the cache"
AIR = ("airflow", "air loading")  # headings of the stages that stay in it then
BinShares = Mapping[tuple[str, str], float]  # by fraction and bin
Beside = Callable[[Scene, BinShares, Tell], tuple[list[Row], list[str]]]  # rows of another program, and notes
MORE, FINER = 4, 0.1  # of the best answer: granules and tolerance, times the scene's
OTHER_SEED = 1009  # added to the scene's: the best answer is another sample
COLUMNS = {
    "": "{knob}", "budget, granules": "{setting}", "chosen": "{chosen}", "error, points": "{error:.2g*100}",
    "half of the interval, points": "{half:.2g*100}", "shares inside": "{inside}", "s": "{seconds:.3g}",
}  # fmt: skip


def run_curves(
    path: Path, folder: Path, *, slow: bool, tell: Tell = lambda _: None, beside: Beside | None = None
) -> Report:
    """Rows (knob, setting, chosen, error, half, inside, seconds) of the scene in a file: with what in the cache, the
    budget, the settings that it bought, the largest error of a bin share against the best answer, the largest half of
    the intervals, how many of these hold the best answer, and the seconds of the whole run on idle cores. Without
    ``slow`` the best answer is the scene's own, of another sample, as it is on the rung that the plan chooses.
    ``beside``: what another program makes of the scene. Written to ``folder`` as CSV, PNG and SVG.
    """
    scene, rows, notes = Scene.load(path), list[Row](), list[str]()
    with TemporaryDirectory(prefix="wakeflow-") as scratch, one_cache(Path(scratch, "cache")):
        compile_ahead()
        tell("the best answer")
        truth = best_shares(scene, Path(scratch, "best"), slow=slow)
        for budget in BUDGETS:
            finest = [row for row in rows if row["chosen"] == time_budget.EFFORTS[-1].name]
            if len(finest) == 2:  # more time buys the same
                rows += [{**row, "setting": duration(budget)} for row in finest]
                continue
            shutil.rmtree(cache_root(), ignore_errors=True)
            for known in (EMPTY, WITH_AIR):
                tell(f"{duration(budget)}, {known}")
                rows.append({"knob": known, **_within(scene, budget, Path(scratch, "run"), truth)})
                forget_all_but_air()
    if beside is not None:
        theirs, more = beside(scene, truth, tell)
        rows, notes = rows + [{"chosen": "", "inside": "", **row} for row in theirs], notes + more
    rows.sort(key=lambda row: (EMPTY, WITH_AIR).index(str(row["knob"])) if row["knob"] in (EMPTY, WITH_AIR) else 2)
    name, facts = f"curves-{path.stem}", {"scene": str(path), "cores": cores(), "rows": rows}
    folder.mkdir(parents=True, exist_ok=True)
    write_settings(folder / f"{name}.csv", rows)
    draw_settings(folder / f"{name}.png", [row for row in rows if row["error"] is not None], path.stem)
    return Report(name, [Table("error against run time", COLUMNS, rows)], facts, notes)


@contextmanager
def one_cache(folder: Path) -> Iterator[None]:
    """While the block runs this process keeps its stages in ``folder``."""
    before = os.environ.get("WAKEFLOW_CACHE")
    os.environ["WAKEFLOW_CACHE"] = str(folder)
    try:
        yield
    finally:
        del os.environ["WAKEFLOW_CACHE"]
        if before is not None:
            os.environ["WAKEFLOW_CACHE"] = before


def best_shares(scene: Scene, folder: Path, *, slow: bool) -> BinShares:
    """The shares of another sample of ``scene``, of more granules in finer steps; with ``slow`` in the airflow of the
    reference rung, where the plan's is one in time.
    """
    count = MORE * scene.collisions.count  # 0 where the plan chooses
    plan = make_plan(scene)
    if plan.collisions is not None:
        count = MORE * plan.collisions.count
    finer = scene.replace({
        "feed.seed": scene.feed.seed + OTHER_SEED,
        "feed.count": MORE * scene.feed.count,
        "numerics.tolerance": FINER * scene.numerics.tolerance,
    } | ({"collisions.count": count} if count else {}))  # fmt: skip
    rung = "reference" if slow and plan.airflow.stepping == "time-resolved" else None
    return bin_shares(runs.run(finer, folder, rung=rung, report=False))


def _within(scene: Scene, budget: float, folder: Path, truth: BinShares) -> Row:
    """What a ``budget`` (s) buys."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        result, clock = timed_run(scene, folder, budget=budget)
    except SceneError as problem:
        if not str(problem).startswith("budget = "):
            raise
        refused = str(problem).partition(": ")[2].partition(";")[0]
        return {
            "setting": duration(budget), "chosen": f"refused: {refused}", "error": None, "half": None, "inside": "",
            "seconds": None,
        }  # fmt: skip
    found = {(name, place): result.share(name, place) for name, place in truth}
    inside = sum(one.low <= truth[place] <= one.high for place, one in found.items())
    return {
        "setting": duration(budget),
        "chosen": result.options.effort,
        "error": largest_error({place: one.value for place, one in found.items()}, truth),
        "half": max(0.5 * (one.high - one.low) for one in found.values()),
        "inside": f"{inside} of {len(found)}",
        "seconds": clock.now,
    }


def timed_run(scene: Scene, folder: Path, **how: Any) -> tuple[Result, IdleClock]:
    """A run of a scene by ``how``, with the clock by which its budget was measured. The cache learns nothing of how
    fast this machine is, which may be busy.
    """
    with IdleClock(cores()) as clock:
        before = time_budget.CLOCK.set(clock)
        try:
            return runs.run(scene, folder, workers=cores(), listener=lambda *_: None, **how), clock
        finally:
            time_budget.CLOCK.reset(before)


def forget_all_but_air() -> None:
    """Leave in the cache only what computes an airflow."""
    for name in stages:
        if stages[name].heading not in AIR:
            shutil.rmtree(cache_root() / name, ignore_errors=True)


def bin_shares(result: Result) -> BinShares:
    """The shares of a finished run."""
    assert result.landings is not None
    return shares_of(result.landings.separation)


def shares_of(found: Separation) -> BinShares:
    """All shares of a separation."""
    return {(name, place): share.value for name, row in found.fractions.items() for place, share in row.items()}


def largest_error(shares: BinShares, truth: BinShares) -> float:
    """The largest error of a bin share against the ``truth``."""
    return max(abs(shares[place] - share) for place, share in truth.items())


# -- Error against run time --------------------------------------------------------------------------------------------
HEADS = ("knob", "setting", "chosen", "error", "half", "inside", "seconds")
SETTING_MARKERS = "os^Dv*"
MIN_ERROR = 1e-5  # of a share: an error that is drawn no smaller


def draw_settings(path: Path, rows: Sequence[Mapping[str, Any]], title: str) -> None:
    """Write ``path`` as PNG and beside it as SVG: the error of each setting of a knob full, what the answer says of
    itself dotted, in percentage points over the seconds that it took.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = new_figure(7.0, 4.0)
    axes = figure.add_subplot(xlabel="run time, s", ylabel="largest error of a bin share, points", title=title)
    for number, knob in enumerate(dict.fromkeys(row["knob"] for row in rows)):
        mine = [row for row in rows if row["knob"] == knob]
        seconds = [row["seconds"] for row in mine]
        look: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            "marker": SETTING_MARKERS[number % len(SETTING_MARKERS)],
            "ms": 4.0,
        }
        axes.plot(seconds, [100 * max(row["error"], MIN_ERROR) for row in mine], "-", label=knob, **look)
        if all(row["half"] is not None for row in mine):
            axes.plot(seconds, [100 * max(row["half"], MIN_ERROR) for row in mine], ":", alpha=0.7, **look)
    for style, told in (("-", "error, against the best answer"), (":", "half of the stated interval")):
        axes.plot([], [], style, color="0.4", label=told)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7.5, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    save(figure, path)


def write_settings(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write what :func:`draw_settings` draws as CSV: errors and half widths as shares, seconds."""
    CellTable(HEADS, [[row[head] for head in HEADS] for row in rows]).write_csv(path)
