"""Error against run time of one scene: each knob of a run alone, and the way of a run with a target error.

The error is that of the bin shares against a reference of its own: other random numbers, sixteen times the granules, a
hundredth of the tolerance. It is compared with what a run says of itself, its half width by computing alone.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from .. import runs
from ..pipeline.pipeline import Pipeline
from ..planning.make import make_plan
from ..refining.knobs import applied, cheapest, knobs, own_settings
from ..results.landing_results import Separation
from ..results.refinement import KnobSettings
from ..results.result import Result
from ..results.separation import separate
from ..scene import Scene

__all__ = [
    "BinShares",
    "TimedRun",
    "at_settings",
    "best_fixed",
    "bin_shares",
    "largest_error",
    "largest_half",
    "processor_seconds",
    "reference_shares",
    "to_target",
]  # fmt: skip

BinShares = Mapping[tuple[str, str], float]  # by fraction and bin
MORE_GRANULES, FINER_STEPS, FINER_MESH = 16, 0.01, 0.5  # of the reference, times the settings it is for
MORE_MEETING = 4  # the same of granules that meet, which cost the most
OTHER_SEED = 1009  # added to the scene's: the reference is another sample


@dataclass(frozen=True)
class TimedRun:
    """One run: its ``settings``, the ``shares`` that it found, its own largest ``half`` width by computing alone, and
    the processor time (s) that it took, with all programs that it started, in how many ``rounds``.
    """

    settings: KnobSettings
    shares: BinShares
    half: float
    seconds: float
    rounds: int = 1

    def error(self, truth: BinShares) -> float:
        """The largest error of a bin share against the ``truth``."""
        return largest_error(self.shares, truth)


def reference_shares(scene: Scene, settings: KnobSettings, rung: str | None = None) -> BinShares:
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


def at_settings(scene: Scene, settings: KnobSettings, rung: str | None = None) -> TimedRun:
    """A run of ``scene`` with fixed ``settings`` in an empty cache."""
    return _timed(applied(scene, settings), None, rung)


def to_target(scene: Scene, target: float, rung: str | None = None) -> TimedRun:
    """A run of ``scene`` with a target error in an empty cache."""
    return _timed(scene, target, rung)


def best_fixed(scene: Scene, target: float, tolerances: Sequence[float], rung: str | None = None) -> TimedRun:
    """The quickest of fixed settings whose own half width meets the ``target``: at each of the ``tolerances`` the
    granules are doubled until it does, from the fewest on that can.
    """
    found: list[TimedRun] = []
    own = own_settings(scene, make_plan(scene, rung=rung))
    for tolerance in tolerances:
        settings = replace(own, granules=cheapest(own, target).granules, tolerance=tolerance)
        while (point := at_settings(scene, settings, rung)).half > target:
            further = knobs["granules"].next(settings)
            assert further is not None
            settings = further
        found.append(point)
    return min(found, key=lambda point: point.seconds)


def _timed(scene: Scene, target: float | None, rung: str | None) -> TimedRun:
    with _empty_cache() as folder:
        started = processor_seconds()
        result = runs.run(scene, folder / "run", rung=rung, target_error=target, report=False)
        seconds = processor_seconds() - started
    table = result.refinement
    settings = own_settings(scene, make_plan(scene, rung=rung)) if table is None else table.rounds[-1].settings
    rounds = 1 if table is None else len(table.rounds)
    return TimedRun(settings, bin_shares(result), largest_half(result), seconds, rounds)


def processor_seconds() -> float:
    """Processor time (s) of this process and all that it waited for: what else the machine does disturbs it least."""
    return sum(os.times()[:4])


@contextmanager
def _empty_cache() -> Iterator[Path]:
    """A cache in which nothing stands, for the time of a run; its folder. The compiled tracker is in memory."""
    before = os.environ.get("WAKEFLOW_CACHE")
    with TemporaryDirectory(prefix="wakeflow-") as folder:
        os.environ["WAKEFLOW_CACHE"] = folder
        try:
            yield Path(folder)
        finally:
            if before is None:
                del os.environ["WAKEFLOW_CACHE"]
            else:
                os.environ["WAKEFLOW_CACHE"] = before
