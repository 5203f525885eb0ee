"""The granules flown again under many draws of what nobody knows exactly: what that does to their shares.

Every draw flies a part of the answer's own granules, with the answer's own random numbers but for what the draw varies,
so that what it moves is seen between the same granules: its error is that of the difference. Each granule flies alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.tables import AnyArray, Columns, save_arrays
from ...laws.size import normal_points
from ...laws.turbulence import entering_energy
from ...planning.plan import INPUT_SAMPLES, REPLICATES, SAME_AIR, replicate_size
from ...planning.unknowns import FARTHEST, Dependence, Unknown, correlated, dependence, unknowns, variation_at
from ...scene.changes import AirVariation, Variation
from .landings import BLOCKS, block_of

if TYPE_CHECKING:
    from ...air.kinds.airflow_kinds import Realisations
    from ...planning.plan import Plan
    from ...scene import Scene
    from .fraction_flights import Flight
    from .landings import Tracked

CODE = "flight.stages.input_samples", "air.field.combined"  # what computes it


Array = NDArray[np.float64]
Joined = Callable[[Dependence, Array], Array]
MOST_POINTS = 2**14  # of which INPUT_SAMPLES keep to the orders of a scene, or hardly any do


@dataclass(frozen=True)
class DrawnLandings:
    """Where the granules of one fraction land in every draw: ``position`` (R, M, 2) m and index of the ``bin`` (R, M),
    -1 for elsewhere.
    """

    position: NDArray[np.float32]
    bin: NDArray[np.int16]


@dataclass(frozen=True)
class InputSamples:
    """``unknowns`` (K) and where each draw lies in them, ``z`` (R, K) in standard deviations; by fraction the landings
    of the granules of every draw, ``varied``, and of the same ones in the answer, ``own``.
    """

    unknowns: tuple[Unknown, ...]
    z: Array
    varied: Mapping[str, DrawnLandings]
    own: Mapping[str, DrawnLandings]


NOT_DRAWN = InputSamples((), np.zeros((INPUT_SAMPLES, 0)), {}, {})  # where everything is known exactly


@dataclass(frozen=True)
class Ensemble:
    """Where the unknowns lie once something was measured, in standard deviations of what was known before: ``mean``
    (K,) and ``spread`` (K, K).
    """

    mean: Array
    spread: Array

    def joined(self, ties: Dependence, xi: Array) -> Array:
        """Independent standard normal numbers ``xi`` (N, K) as draws of this, in place of :meth:`Dependence.joined`."""
        return np.clip(self.mean + correlated(xi, self.spread, ties.of_air), -FARTHEST, FARTHEST)


@dataclass
class DrawStage:
    """The draws of one scene under one plan, by as many ``workers``; each granule in a ``flight`` as of the answer, in
    the air ``in_wake`` of a theta and a strength, or as it is. ``joined`` makes the draws of independent standard
    normal numbers: as the scene ties them, or as an ``Ensemble`` does.
    """

    scene: Scene
    plan: Plan
    workers: int
    tell: Callable[[str], None]
    flight: Callable[[Scene, Realisations], Flight]
    in_wake: Callable[[tuple[float, ...]], Realisations]
    joined: Joined = Dependence.joined

    @cached_property
    def unknowns(self) -> list[Unknown]:
        """What is drawn."""
        return unknowns(self.scene, self.plan)

    @cached_property
    def design(self) -> Array:
        """Where every draw lies (INPUT_SAMPLES, K), all in the orders of the scene. Raises SceneError where hardly any
        draw is.
        """
        ties, points = dependence(self.scene, self.plan, self.unknowns), INPUT_SAMPLES
        while points <= MOST_POINTS:
            z = self._in_order(ties, *self._points(points, ties.of_air))
            if len(z) == INPUT_SAMPLES:
                return z
            points *= 2
        raise SceneError("uncertainty.never_above: hardly any draw keeps to these orders; leave out some of them")

    def _points(self, count: int, shared: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Scrambled Sobol points as independent standard normal ones: ``count`` (count, K), and those of what is
        ``shared`` by SAME_AIR of them; each 0 in the columns of the other.
        """
        seed, each, air = (
            self.scene.feed.seed,
            *(np.zeros((n, len(shared))) for n in (count, count // SAME_AIR)),
        )
        each[:, ~shared] = normal_points(int((~shared).sum()), len(each), seed, 0)
        air[:, shared] = normal_points(int(shared.sum()), len(air), seed, 1)
        return each, air

    def _in_order(self, ties: Dependence, each: Array, air: Array) -> Array:
        """The first draws (INPUT_SAMPLES, K) that keep to the orders, or fewer; all of one air before those of the
        next. A point that does not is left out, so that those that are taken fill what is left evenly.
        """
        if not ties.orders:
            return self.joined(ties, each + np.repeat(air, SAME_AIR, axis=0))
        air = air[ties.among(ties.of_air).kept(self.joined(ties, air))]
        kept_draws: list[Array] = []
        for point in each:
            if len(kept_draws) == min(INPUT_SAMPLES, SAME_AIR * len(air)):
                break
            z = self.joined(ties, (point + air[len(kept_draws) // SAME_AIR])[None])
            kept_draws += list(z[ties.kept(z)])
        return np.array(kept_draws)

    def read(self, folder: Path) -> InputSamples:
        """What :meth:`fly_all` kept in a folder."""
        with np.load(folder / "draws.npz") as data:
            names = list(self.scene.fraction)
            varied, answer = (
                {name: DrawnLandings(data[f"{which}.{name}.position"], data[f"{which}.{name}.bin"]) for name in names}
                for which in ("varied", "own")
            )
        return InputSamples(tuple(self.unknowns), self.design, varied, answer)

    def fly_all(self, tracked: Tracked, folder: Path) -> None:
        """All draws, those of one air by one thread: granules of a draw are too few for several."""
        columns: dict[str, list[AnyArray]] = {}
        pool = ThreadPoolExecutor(self.workers)
        try:
            jobs = [pool.submit(self._fly_in_one_air, first, tracked) for first in range(0, INPUT_SAMPLES, SAME_AIR)]
            for number, job in enumerate(jobs):
                self.tell(f"{number * SAME_AIR} of {INPUT_SAMPLES}")
                for draw in job.result():
                    for which, column in draw.items():
                        columns.setdefault(which, []).append(column)
        finally:
            pool.shutdown(cancel_futures=True)
        save_arrays(folder / "draws.npz", {key: np.array(rows) for key, rows in columns.items()})

    def _fly_in_one_air(self, first: int, tracked: Tracked) -> list[Columns]:
        """The draws from ``first`` on that share its air: each granule's landing as drawn, and its own."""
        landed, airs = [], None
        for number in range(first, first + SAME_AIR):
            made = self.variation(number)
            airs = airs or self.air(made.air)
            replicate = number % REPLICATES
            part = _part(self.scene.feed.count, number // REPLICATES)
            landed.append(self.fly_under(made, airs, tracked, replicate, part))
        return landed

    def variation(self, number: int) -> Variation:
        """Variation of the draw ``number``."""
        return variation_at(self.scene, self.plan, self.unknowns, self.design[number])

    def fly_under(self, made: Variation, airs: Realisations, tracked: Tracked, replicate: int, part: range) -> Columns:
        """The landing of each granule in a ``part`` of a replicate under the draw ``made``, whose air is in ``airs``
        ("varied.NAME.position", "varied.NAME.bin"), and its own ("own.NAME.position", "own.NAME.bin").
        """
        flight = replace(self.flight(made.fed(self.scene), airs), workers=1)
        columns: Columns = {}
        block, kept = block_of(replicate_size(self.scene.feed.count))
        first = part.start // block * kept
        for name in self.scene.fraction:
            landing = tracked.landings[name]
            mine = np.flatnonzero(landing.replicate == replicate)[first : first + len(part)]
            ends = {"own": (landing.position[mine], landing.bin[mine])}
            ends["varied"] = flight.fly_part(name, replicate, part, made.of(name))
            for which, (position, bin_) in ends.items():
                columns[f"{which}.{name}.position"], columns[f"{which}.{name}.bin"] = position.astype(np.float32), bin_
        return columns

    def air(self, air: AirVariation) -> Realisations:
        """The airflow as a draw has it."""
        from ...air.field.combined import varied

        airs = self.in_wake(())
        wake = self.plan.airflow.wake
        if wake and (air.theta is not None or air.strength is not None):
            theta = wake.theta.value if air.theta is None else air.theta
            strength = wake.strength.value if air.strength is None else air.strength
            airs = self.in_wake((theta, strength))
        entering = _entering(self.scene)
        return airs.mapped(lambda field: varied(field, air.speed, air.energy, air.lifetime, entering=entering))


def _entering(scene: Scene) -> float:
    """Energy (m2/s2) of the turbulence that the stream brings; infinite where a case of the user's does."""
    air = scene.air
    return math.inf if air is None or air.case else entering_energy(air.turbulence, air.speed)


def _part(count: int, number: int) -> range:
    """What of block ``number`` of a replicate is kept; all of a replicate that is too small to be parted."""
    size = replicate_size(count)
    if size < BLOCKS:
        return range(size)
    block, kept = block_of(size)
    return range(number * block, number * block + kept)
