"""``wakeflow verify SCENE``: error against run time, for each knob of a scene alone, for a target error and for a peer.

The error is that of the bin shares against a reference of its own: other random numbers, sixteen times the granules, a
hundredth of the tolerance. It is compared with what a run says of itself, its half width by computing alone.

The peer's chain is OpenFOAM's own parcels in its own steady airflow. Granules are given to it as they leave the body,
with the velocity that the vibrating one gave them, since its bodies stand still; from there on its parcels know drag
and gravity, fall through the mean air, meet nobody, and are points at walls. Its error holds what that leaves out, and
no setting of it brings it back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..answer.provenance import RefinedSettings
from ..answer.result import Result
from ..answer.shares import Separation
from ..core.process import cores
from ..field import FlowField
from ..pipeline.compilation import COMPILED
from ..pipeline.pipeline import Pipeline
from ..planning.make import make_plan
from ..planning.terms import LOADING
from ..runs.settings import applied, knobs, own_settings
from ..scene import RESERVED_BIN, Scene
from ..statistics.separation import separate
from ..tracking import Tracks, track
from .curves import BenchmarkCase, benchmark_case
from .foam import FINE_PARCELS, FoamInterpolant, fly_parcels, make_foam_interpolant
from .report import Report, Table, Tell

# -- Each knob of a scene alone ----------------------------------------------------------------------------------------
STEPS = {"granules": -2, "tolerance": -1, "mesh": -1, "averaging": -1, "slab": -1}  # of a knob, in its own steps
POINTS = {"granules": 4, "tolerance": 3, "mesh": 3, "averaging": 3, "slab": 3}  # settings tried of each, scene's last
TARGETS = (0.05, 0.03)  # half widths of every bin share
BinShares = Mapping[tuple[str, str], float]  # by fraction and bin
MORE_GRANULES, FINER_STEPS, FINER_MESH = 16, 0.01, 0.5  # of the reference, times the settings it is for
MORE_MEETING = 4  # the same of granules that meet, which cost the most
OTHER_SEED = 1009  # added to the scene's: the reference is another sample
LED = "--target-error"
COLUMNS = {
    "knob": "{knob}", "setting": "{setting}", "error, points": "{error:.2g*100}",
    "half width, points": "{half:.2g*100}", "s": "{seconds:.3g}",
}  # fmt: skip
COARSEST = {"mesh": 4.0, "tolerance": 0.1}  # that a scene may ask for


def run_curves(path: Path, folder: Path, *, slow: bool, tell: Tell = lambda _: None) -> Report:
    """Rows (knob, setting, error, half, seconds) of the scene in a file: errors of the largest bin share against a
    reference that is finer in every knob, seconds of the stages when they were computed. An airflow in time is
    computed with ``slow`` alone, else its draft. Beside them the peer's chain (``peer_rows``), where it can
    compute the scene. Written to ``folder`` as CSV, PNG and SVG.
    """
    from ..report.curves import draw_settings, write_settings

    scene = Scene.load(path)
    rung = None if slow or make_plan(scene).airflow.stepping != "time-resolved" else "draft"
    own = own_settings(scene, make_plan(scene, rung=rung))
    tell("the reference")
    truth, rows = reference_shares(scene, own, rung), []
    with TemporaryDirectory(prefix="wakeflow-") as scratch:
        for knob, settings in _tried(own):
            tell(f"{knob} {knobs[knob].of(settings):.6g}")
            result = runs.run(applied(scene, settings), Path(scratch, "run"), rung=rung, report=False)
            rows.append(_row(knob, f"{knobs[knob].of(settings):.6g}", result, truth))
        for target in TARGETS:
            tell(f"{LED} {target:g}")
            result = runs.run(scene, Path(scratch, "led"), rung=rung, target_error=target, report=False)
            rows.append(_row(LED, f"{target:g}", result, truth))
    obstacle, notes = why_no_peer(scene), [_note(rung, slow=slow)]
    if obstacle is None:
        rows += peer_rows(scene, truth, tell)
    else:
        notes.append(f"not beside {PEER}: {obstacle}")
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


# -- The peer's chain --------------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
PEER = "OpenFOAM's parcels"
COUNTS = (256, 1024, 4096)  # granules a fraction
TOLERANCE = 1e-4  # body widths, as in the shipped scene
LONGER = 1.05  # of the longest flight: how long OpenFOAM runs


def why_no_peer(scene: Scene) -> str | None:
    """Why the peer cannot compute a scene; None where it can."""
    if scene.air is None or not scene.body or scene.numerics.rung == "none":
        return "no airflow about a body is solved"
    if not scene.plumb.upright:
        return "gravity is at an angle to the channel"
    if any(place.on != "floor" or place.points is not None for place in scene.bin.values()):
        return "its parcels are counted where they cross the channel's floor, and other bins are there"
    return None


def peer_rows(
    scene: Scene, truth: Mapping[tuple[str, str], float], tell: Callable[[str], None] = lambda _: None
) -> Iterator[dict[str, object]]:
    """Rows (knob, setting, error, seconds) at growing numbers of granules: error of the largest bin share against the
    ``truth`` by fraction and bin, seconds of mesh, airflow and parcels.

    Raises MeshError and FoamError as Gmsh and OpenFOAM do.
    """
    plain = scene.replace({f"fraction.{name}.impact": "paper" for name in scene.fraction})
    plan = make_plan(plain, rung="draft", force={LOADING: False})
    pipeline = Pipeline(plain, plan)
    field = pipeline.field[1]
    before = pipeline.spent("mesh") + pipeline.spent("airflow")
    with TemporaryDirectory(prefix="wakeflow-peer-") as room:
        ends = plain.channel.top, plain.channel.bottom
        foam = make_foam_interpolant(field, pipeline.mesh_spec, *ends, Path(room))
        for count in COUNTS:
            tell(f"{PEER} {count}")
            found, seconds = _landed_shares(plain, foam, count, Path(room, "run"))
            error = largest_error(found, truth)
            yield {"knob": PEER, "setting": f"{count}", "error": error, "half": None, "seconds": before + seconds}


def _landed_shares(
    scene: Scene, foam: FoamInterpolant, count: int, folder: Path
) -> tuple[dict[tuple[str, str], float], float]:
    """The share of every fraction in every bin, of ``count`` parcels each, and OpenFOAM's processor time (s)."""
    places = [*sorted(scene.bin, key=lambda name: float(scene.bin[name].start or 0.0)), RESERVED_BIN]
    found: dict[tuple[str, str], float] = {}
    seconds = 0.0
    for name in scene.fraction:
        case = benchmark_case(name, "steady", scene, foam.field, count, (name, {}))
        longest = float(np.nanmax(landed_time(flown_here(case, scene, foam.field))))
        until = LONGER * longest
        run, spent = fly_parcels(foam, case.grains, **FINE_PARCELS, until=until, folder=folder)
        bins: NDArray[np.int64] = bins_of(case, run.position[:, 0])
        shares = np.bincount(bins, minlength=len(places)) / len(bins)
        found |= {(name, place): float(share) for place, share in zip(places, shares, strict=True)}
        seconds += spent
    return found, seconds


def flown_here(case: BenchmarkCase, scene: Scene, air: FlowField) -> Tracks:
    """The case's granules flown by this tracker through ``air`` down to the scene's floor."""
    half = scene.channel.width
    floor = np.array([(-half, scene.channel.bottom), (half, scene.channel.bottom)])
    return track(air, case.grains, tolerance=TOLERANCE, lines=(floor,), **case.problem.arguments)


def landed_time(tracks: Tracks) -> Array:
    """When granules crossed the floor (n,) s, NaN where they did not."""
    return np.where(tracks.line == 0, tracks.time, np.nan)


def bins_of(case: BenchmarkCase, x: Array) -> NDArray[np.int64]:
    """The place of each granule among the bins from left to right; their number where it reached none."""
    place = np.searchsorted(case.bins, x, side="right") - 1
    last = len(case.bins) - 1
    return np.where(np.isfinite(x) & (place >= 0) & (place < last), place, last)
