"""OpenFOAM's own parcels in its own steady airflow, for the scene whose error against run time is shown.

Granules are given to it as they leave the body, with the velocity that the vibrating one gave them, since its bodies
stand still; from there on its parcels know drag and gravity, fall through the mean air, meet nobody, and are points at
walls. Its error holds what that leaves out, and no setting of it brings it back.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from proofs.idle_clock import IdleClock
from proofs.report import Row, Tell
from proofs.scene_curves import BinShares, largest_error, one_cache
from proofs.tracker.curves import BenchmarkCase, benchmark_case
from proofs.tracker.foam import FINE_PARCELS, FoamInterpolant, fly_parcels, make_foam_interpolant
from wakeflow.air.field import FlowField
from wakeflow.core.process import cores
from wakeflow.flight import Tracks, track
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.terms import LOADING
from wakeflow.runs.planned import make_plan
from wakeflow.scene import RESERVED_BIN, Scene

Array = NDArray[np.float64]
PEER = "OpenFOAM's parcels"
COUNTS = (256, 1024, 4096)  # granules a fraction
TOLERANCE = 1e-4  # body widths, as in the shipped scene
LONGER = 1.05  # of the longest flight: how long OpenFOAM runs


def beside(scene: Scene, truth: BinShares, tell: Tell) -> tuple[list[Row], list[str]]:
    """The peer's rows next to those of a scene, and a note where it cannot compute that."""
    obstacle = why_no_peer(scene)
    return (list(peer_rows(scene, truth, tell)), []) if obstacle is None else ([], [f"not beside {PEER}: {obstacle}"])


def why_no_peer(scene: Scene) -> str | None:
    """Why the peer cannot compute a scene; None where it can."""
    if scene.air is None or not scene.body or scene.numerics.rung == "none":
        return "no airflow about a body is solved"
    if not scene.plumb.upright:
        return "gravity is at an angle to the channel"
    if len(scene.on_sides("floor")) < len(scene.bin):
        return "its parcels are counted where they cross the channel's floor, and other bins are there"
    return None


def peer_rows(scene: Scene, truth: BinShares, tell: Tell = lambda _: None) -> Iterator[Row]:
    """Rows (knob, setting, error, seconds) at growing numbers of granules: error of the largest bin share against the
    ``truth`` by fraction and bin, seconds of mesh, airflow and parcels on idle cores.

    Raises MeshError and FoamError as Gmsh and OpenFOAM do.
    """
    plain = scene.replace({f"fraction.{name}.impact": "paper" for name in scene.fraction})
    plan = make_plan(plain, rung="draft", force={LOADING: False})
    with TemporaryDirectory(prefix="wakeflow-peer-") as room, one_cache(Path(room, "cache")):
        pipeline = Pipeline(plain, plan)
        with IdleClock(cores()) as clock:
            field = pipeline.field[1]
        before = clock.now
        ends = plain.channel.top, plain.channel.bottom
        foam = make_foam_interpolant(field, pipeline.air.in_case.mesh_spec, *ends, Path(room))
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
