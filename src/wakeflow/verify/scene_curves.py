"""``wakeflow verify SCENE``: error against run time, for each knob of a scene alone and for a target error.

The error is that of the bin shares against a reference of its own: other random numbers, sixteen times the granules, a
hundredth of the tolerance. It is compared with what a run says of itself, its half width by computing alone. In a
checkout it is compared with OpenFOAM's own parcels too (``tests/proofs/tracker``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from .. import runs
from ..answer.provenance import RefinedSettings
from ..answer.result import Result
from ..answer.shares import Separation
from ..core.process import cores
from ..pipeline.compilation import COMPILED
from ..pipeline.pipeline import Pipeline
from ..planning.make import make_plan
from ..runs.settings import applied, knobs, own_settings
from ..scene import Scene
from ..statistics.separation import separate
from .report import Report, Row, Table, Tell

STEPS = {"granules": -2, "tolerance": -1, "mesh": -1, "averaging": -1, "slab": -1}  # of a knob, in its own steps
POINTS = {"granules": 4, "tolerance": 3, "mesh": 3, "averaging": 3, "slab": 3}  # settings tried of each, scene's last
TARGETS = (0.05, 0.03)  # half widths of every bin share
BinShares = Mapping[tuple[str, str], float]  # by fraction and bin
Beside = Callable[[Scene, BinShares, Tell], tuple[list[Row], list[str]]]  # rows of another program, and notes
MORE_GRANULES, FINER_STEPS, FINER_MESH = 16, 0.01, 0.5  # of the reference, times the settings it is for
MORE_MEETING = 4  # the same of granules that meet, which cost the most
OTHER_SEED = 1009  # added to the scene's: the reference is another sample
LED = "--target-error"
COLUMNS = {
    "knob": "{knob}", "setting": "{setting}", "error, points": "{error:.2g*100}",
    "half width, points": "{half:.2g*100}", "s": "{seconds:.3g}",
}  # fmt: skip
COARSEST = {"mesh": 4.0, "tolerance": 0.1}  # that a scene may ask for


def run_curves(
    path: Path, folder: Path, *, slow: bool, tell: Tell = lambda _: None, beside: Beside | None = None
) -> Report:
    """Rows (knob, setting, error, half, seconds) of the scene in a file: errors of the largest bin share against a
    reference that is finer in every knob, seconds of the stages when they were computed. An airflow in time is
    computed with ``slow`` alone, else its draft. ``beside``: what another program makes of the scene. Written to
    ``folder`` as CSV, PNG and SVG.
    """
    from ..report.curves import draw_settings, write_settings

    scene = Scene.load(path)
    rung = None if slow or make_plan(scene).airflow.stepping != "time-resolved" else "draft"
    own = own_settings(scene, make_plan(scene, rung=rung))
    tell("the reference")
    truth, rows, notes = reference_shares(scene, own, rung), list[Row](), [_note(rung, slow=slow)]
    with TemporaryDirectory(prefix="wakeflow-") as scratch:
        for knob, settings in _tried(own):
            tell(f"{knob} {knobs[knob].of(settings):.6g}")
            result = runs.run(applied(scene, settings), Path(scratch, "run"), rung=rung, report=False)
            rows.append(_row(knob, f"{knobs[knob].of(settings):.6g}", result, truth))
        for target in TARGETS:
            tell(f"{LED} {target:g}")
            result = runs.run(scene, Path(scratch, "led"), rung=rung, target_error=target, report=False)
            rows.append(_row(LED, f"{target:g}", result, truth))
    if beside is not None:
        theirs, more = beside(scene, truth, tell)
        rows, notes = rows + theirs, notes + more
    name, facts = f"curves-{path.stem}", {"scene": str(path), "rung": rung, "cores": cores(), "rows": rows}
    folder.mkdir(parents=True, exist_ok=True)
    write_settings(folder / f"{name}.csv", rows)
    draw_settings(folder / f"{name}.png", rows, path.stem)
    return Report(name, [Table("error against run time", COLUMNS, rows)], facts, notes)


def _tried(own: RefinedSettings) -> Iterator[tuple[str, RefinedSettings]]:
    """RefinedSettings with one knob coarser than the scene's ``own``, the others as they are; the own ones last."""
    for name in knobs:
        value = knobs[name].of(own)
        if value is None:
            continue
        for number in reversed(range(POINTS[name])):
            coarser = float(f"{value * knobs[name].step ** (STEPS[name] * number):.12g}")
            if coarser > COARSEST.get(name, math.inf):
                continue
            yield name, knobs[name].at(own, coarser)


def _row(knob: str, setting: str, result: Result, truth: BinShares) -> dict[str, object]:
    stages = (stage.seconds for name, stage in result.seconds.items() if name != str(COMPILED))
    led = result.refinement
    return {
        "knob": knob,
        "setting": setting,
        "error": largest_error(bin_shares(result), truth),
        "half": largest_half(result),
        "seconds": sum(stages) if led is None else sum(one.seconds for one in led.rounds),
    }


def _note(rung: str | None, *, slow: bool) -> str:
    air = "" if rung is None and not slow else f"rung {rung or 'of the scene'}; "
    return f"{air}errors against other random numbers, 16 times the granules, a hundredth of the tolerance, finer cells"


def reference_shares(scene: Scene, settings: RefinedSettings, rung: str | None = None) -> BinShares:
    """The shares of another sample of ``scene``, far finer than ``settings``, on cells of half the edge: of granules
    that meet where they do.
    """
    mesh, slab = settings.mesh_scale, settings.slab
    finer = replace(
        settings,
        granules=(MORE_GRANULES if slab is None else 1) * settings.granules,
        slab=None if slab is None else MORE_MEETING * slab,
        tolerance=FINER_STEPS * settings.tolerance,
        mesh_scale=None if mesh is None else max(FINER_MESH * mesh, knobs["mesh"].finest),
    )
    other = applied(scene, finer).replace({"feed.seed": scene.feed.seed + OTHER_SEED})
    plan = make_plan(other, rung=rung)
    pipeline = Pipeline(plan.airflow.flown(other), plan)
    crowd = pipeline.crowd()
    return _shares(separate(other, pipeline.tracks().landings if crowd is None else crowd.landings))


def bin_shares(result: Result) -> BinShares:
    """The shares of a finished run."""
    assert result.landings is not None
    return _shares(result.landings.separation)


def _shares(found: Separation) -> BinShares:
    return {(name, place): share.value for name, row in found.fractions.items() for place, share in row.items()}


def largest_error(shares: BinShares, truth: BinShares) -> float:
    """The largest error of a bin share against the ``truth``."""
    return max(abs(shares[place] - share) for place, share in truth.items())


def largest_half(result: Result) -> float:
    """The largest half width of a bin share by computing alone."""
    return max((row.total.numerical or 0.0 for row in result.budget), default=0.0)
