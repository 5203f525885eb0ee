"""From where granules ended to one row of the table: errors, rates; and what an error costs on a curve of such rows."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .benchmark_cases import BenchmarkCase
from .reference import Reference

Array = NDArray[np.float64]
ERROR = 1e-4  # body widths, where speeds are compared


@dataclass(frozen=True)
class Ends:
    """Where a method's granules ended: ``position`` (n, 2) m, ``landed`` (n,), ``impacts`` (n,) or None where they are
    not known.
    """

    position: Array
    landed: NDArray[np.bool_]
    impacts: NDArray[np.int64] | None


@dataclass(frozen=True)
class CurvePoint:
    """One method at one setting: landing errors in body widths, cost, rates. None where a number is not known."""

    kind: str
    air: str
    method: str
    setting: str
    median: float | None
    p95: float | None
    judged: int  # granules whose landing the reference knows
    others: float  # share of them with other contacts than the reference's, or not landed; without a count of contacts
    # (OpenFOAM's tracker): with any contact in the reference
    bin_error: float  # largest error of a bin's share
    seconds: float  # per granule, on the clock, with the cores it uses
    cpu: float  # processor seconds per granule, over all cores: other work on the machine disturbs them least
    steps: float | None  # per granule
    evaluations: float | None  # per granule
    own_median: float | None = None  # error against the method's own finest setting

    @property
    def rate(self) -> float:
        """Granules a second."""
        return 1.0 / self.seconds

    @property
    def evaluation_rate(self) -> float | None:
        """Stage evaluations a second and core."""
        return None if self.evaluations is None else self.evaluations / self.cpu


def score(case: BenchmarkCase, reference: Reference, ends: Ends, **known: Any) -> CurvePoint:
    """Errors over the granules that fly freely in the reference and in the method, the rest as a share."""
    free = reference.landed & (reference.impacts == 0)
    same = free & ends.landed if ends.impacts is None else free & ends.landed & (ends.impacts == 0)
    error = np.linalg.norm(ends.position[same] - reference.position[same], axis=1) / case.problem.length
    alike = same if ends.impacts is None else ends.landed & (reference.impacts == ends.impacts)
    judged = int(reference.landed.sum())
    return CurvePoint(
        kind=case.kind,
        air=case.air,
        median=float(np.median(error)) if len(error) else None,
        p95=float(np.percentile(error, 95)) if len(error) else None,
        judged=judged,
        others=1.0 - float(alike[reference.landed].mean()) if judged else 0.0,
        bin_error=_bin_error(case.bins, reference, ends),
        **known,
    )


def _bin_error(edges: Array, reference: Reference, ends: Ends) -> float:
    """Largest difference of a bin's share, over the granules that the reference lands."""
    count = int(reference.landed.sum())
    if not count:
        return 0.0

    def shares(position: Array, landed: NDArray[np.bool_]) -> Array:
        return np.histogram(position[reference.landed & landed, 0], edges)[0] / count

    return float(np.abs(shares(reference.position, reference.landed) - shares(ends.position, ends.landed)).max())


def timed(work: Callable[[], object], repeats: int = 3) -> tuple[float, float]:
    """Median wall seconds and median processor seconds (of all threads) of a call."""
    wall, cpu = [], []
    for _ in range(repeats):
        begun, busy = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - begun)
        cpu.append(time.process_time() - busy)
    return statistics.median(wall), statistics.median(cpu)


def cost_at(rows: Iterable[CurvePoint], error: float, which: str = "median", clock: str = "seconds") -> float | None:
    """Seconds a granule for which a method's best setting reaches ``error``; None when none does.

    ``which`` error: median or p95; which ``clock``: seconds or cpu.

    Read off the lower envelope of the points (error, seconds), straight between them in logarithms; a method whose
    cheapest setting is more accurate costs what that setting costs.
    """
    points = sorted(
        (float(value), float(getattr(row, clock)))
        for row in rows
        if (value := getattr(row, which)) is not None and value > 0
    )
    envelope: list[tuple[float, float]] = []
    for value, seconds in points:  # from the smallest error on: only those cheaper than all more accurate ones
        if not envelope or seconds < envelope[-1][1]:
            envelope.append((value, seconds))
    better = [point for point in envelope if point[0] <= error]
    worse = [point for point in envelope if point[0] > error]
    if not better:
        return None
    if not worse:
        return better[-1][1]
    (e0, s0), (e1, s1) = better[-1], worse[0]
    w = (np.log(error) - np.log(e0)) / (np.log(e1) - np.log(e0))
    return float(np.exp((1 - w) * np.log(s0) + w * np.log(s1)))


def times_faster(rows: Sequence[CurvePoint]) -> list[dict[str, Any]]:
    """How many times faster than its rivals the tracker is at ERROR: median error and the 95th percentile on the
    clock, and the median for each core's time; None where one of both does not get there.
    """
    found = []
    for kind, air in dict.fromkeys((row.kind, row.air) for row in rows):
        here = [row for row in rows if (row.kind, row.air) == (kind, air)]
        for than in ("OpenFOAM", "explicit RK4"):
            if theirs := [row for row in here if row.method.startswith(than)]:
                ours = [row for row in here if row.method == "wakeflow"]
                costs = {
                    name: [cost_at(some, ERROR, which, clock) for some in (theirs, ours)]
                    for name, which, clock in (
                        ("median", "median", "seconds"), ("cpu", "median", "cpu"), ("p95", "p95", "seconds")
                    )
                }  # fmt: skip
                ratios = {name: one / other if one and other else None for name, (one, other) in costs.items()}
                found.append({"kind": kind, "air": air, "than": than, **ratios})
    return found


def with_own(rows: Sequence[CurvePoint], own: Sequence[float | None]) -> list[CurvePoint]:
    """The rows with their errors against the method's own finest setting."""
    return [replace(row, own_median=value) for row, value in zip(rows, own, strict=True)]
