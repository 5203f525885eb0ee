"""The stage of a film: the granules that are in the machine over a short while, with their tracks, on one clock.

Where granules meet each other, a thin slab is flown as the answer's is, at the true feed rate, and recorded. Elsewhere
each flies alone, released above the bodies at the true rate. Flown only when a film is asked for.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...answer.result import request_in
from ...core.errors import SceneError
from ...core.files import write_json
from ...core.lazy import cached_property
from ...core.registry import did_you_mean
from ...core.store import cache_in_use, cache_root
from ...core.tables import Columns
from ...flight import Granules, Tracks
from ...flight.feed.feedstock import feedstock
from ...flight.stages.gathered_force import resolved
from ...flight.stages.landings import paths_of, recorded_tracks, save_recorded_tracks
from ...flight.stages.pipeline import Work
from ...flight.stages.slab_stage import SlabFlight, late_in, steady_after
from ...planning.collisions import CollisionPlan, number_rates
from ...planning.plan import REPLICATES, Plan
from ...planning.stage_cache import Listener, code_of, null_listener
from ...runs.run_stages import one_thread_of_blas, stages_of
from ...scene import Scene

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...flight.stages.pipeline import Pipeline

CODE = "extras.motion.film_stage", "flight.stages.slab_stage", "flight.stages.gathered_force"  # what computes it


IN_VIEW = 400.0  # granules of a slab that are in flight at a time; chosen: more hide each other
THINNEST = 0.2  # of the answer's slab: depth; three widths of its coarsest granules
SINGLY = 120.0  # of a fraction in flight at a time, where each flies alone
LATE = 0.9  # share of a fraction's granules, each alone, that are down when the machine counts as full
MAX_TRACK_POINTS = 256  # kept of a track
TOLERANCE = 1e-2  # body widths: nobody sees less
STREAM = 5 * REPLICATES  # of the random forces, apart from those of other flights
FILE = "film.json"


@dataclass(frozen=True)
class Film:
    """Tracks on the airflow's clock, by fraction, of all granules that are there from ``begin`` (s) on for ``span``
    (s), in a slice of the machine of ``depth`` (m); of a fraction that is too many to be drawn ``one_in`` so many.
    ``met``: they met each other.
    """

    begin: float
    span: float
    depth: float
    one_in: dict[str, float]
    met: bool
    paths: Mapping[str, list[Columns]]


def film_of(
    folder: Path | str,
    span: float = 0.0,
    fractions: Sequence[str] = (),
    listener: Listener = null_listener,
) -> tuple[Scene, FlowField | None, Film]:
    """The scene of a finished run as it was flown, its air, and its granules over ``span`` (s), flown for a film; of
    all ``fractions``, or of those alone.

    What the run's own cache still holds is not computed again. Raises SceneError where the folder holds no such run,
    and for a fraction that it has not.
    """
    tables, request = request_in(folder)
    for name in fractions:
        if name not in tables["fraction"]:
            known = list(tables["fraction"])
            raise SceneError(f"unknown fraction {name!r}{did_you_mean(name, known)} (known: {', '.join(known)})")
    with cache_in_use(cache_root()), one_thread_of_blas():
        pipeline, _ = stages_of(Scene.parse(tables), request, None, listener)
        air = None if pipeline.scene.air is None else pipeline.field[1]
        film = flown_film(pipeline, span)
    return pipeline.scene, air, replace(film, paths={name: film.paths[name] for name in fractions or film.paths})


def flown_film(pipeline: Pipeline, span: float = 0.0) -> Film:
    """The granules that are in the machine of a ``pipeline`` over ``span`` (s), on one clock; 0: one long flight."""
    return pipeline.made("film", FilmStage(pipeline).work(span))


@dataclass(frozen=True)
class FilmStage:
    """Films of the scene, the plan and the airflow in which all granules of a ``pipeline`` have flown."""

    pipeline: Pipeline

    @property
    def scene(self) -> Scene:
        """The machine and its feed."""
        return self.pipeline.scene

    @property
    def plan(self) -> Plan:
        """How the granules are flown."""
        return self.pipeline.plan

    @cached_property
    def start_up(self) -> float:
        """Seconds until the machine is as full as it stays: a long flight."""
        landings, collisions = self.pipeline.tracks().landings, self.plan.collisions
        if collisions is not None:
            return steady_after(collisions, late_in(landings))
        return max(float(np.quantile(landings[name].time, LATE)) for name in self.scene.fraction)

    def work(self, span: float) -> Work[Film]:
        """A film of ``span`` (s) of the machine's time, 0: as long as the slowest granules fly."""
        lasting = span or self.start_up
        rate = self.scene.feed.mass_flow, self.scene.feed.depth, self.scene.mass_shares()
        collisions = None if self.plan.collisions is None else (repr(self.plan.collisions), repr(self.scene.collisions))
        key = lasting, rate, collisions, code_of(*CODE)
        return Work(key, partial(self._fly, lasting), self._read, meet=collisions is not None)

    def _read(self, folder: Path) -> Film:
        kept = json.loads((folder / FILE).read_text())
        return Film(**kept, paths=recorded_tracks(folder, self.scene.fraction))

    def _fly(self, span: float, folder: Path) -> None:
        collisions = self.plan.collisions
        film, flown = self._alone(span) if collisions is None else self._slab(span, collisions)
        for name, tracks, grains in flown:
            paths = paths_of(tracks, grains, len(self.scene.bin))
            shown = [path for path in paths if path["time"][0] < film.begin + span and path["time"][-1] > film.begin]
            save_recorded_tracks(folder / f"{name}.drawn.npz", shown)
        write_json(folder / FILE, {key: value for key, value in asdict(film).items() if key != "paths"})

    # -- granules that meet --------------------------------------------------------------------------------------------

    def _slab(self, span: float, collisions: CollisionPlan) -> tuple[Film, Iterator[tuple[str, Tracks, Granules]]]:
        depth = collisions.depth * max(THINNEST, min(1.0, IN_VIEW / max(sum(collisions.in_flight.values()), 1.0)))
        tell = partial(self.pipeline.cache.tell, "film")
        tell(f"granules meet in a slab of {1e3 * depth:.3g} mm")
        flight = SlabFlight(
            self.scene, self.plan, self.pipeline.air.realisations, depth, self.start_up, span, TOLERANCE,
            workers=self.pipeline.threads, tell=tell,
        )  # fmt: skip
        stream, tracks = flight.record(MAX_TRACK_POINTS)
        begin = float(stream.granules.time.min()) + self.start_up
        fed = self.start_up + span + self.start_up
        drawn = np.bincount(stream.fraction, minlength=len(self.scene.fraction)) / fed
        one_in = {
            name: _whole(self._rate(name, depth) / rate) if collisions.tracers[name] and rate else 1.0
            for name, rate in zip(self.scene.fraction, drawn.tolist(), strict=True)
        }

        def parts() -> Iterator[tuple[str, Tracks, Granules]]:
            for number, name in enumerate(self.scene.fraction):
                mine = np.flatnonzero(stream.fraction == number)
                yield name, tracks.some(mine), stream.granules[mine]

        return Film(begin, span, depth, one_in, True, {}), parts()

    # -- granules that fly alone ---------------------------------------------------------------------------------------

    def _alone(self, span: float) -> tuple[Film, Iterator[tuple[str, Tracks, Granules]]]:
        names, whole = list(self.scene.fraction), self.start_up + span
        fewest = min(self._rate(name, self.scene.feed.depth) for name in names)
        depth = self.scene.feed.depth * min(1.0, SINGLY / (fewest * self.start_up))
        real = {name: self._rate(name, depth) for name in names}
        drawn = {name: min(rate, SINGLY / self.start_up) for name, rate in real.items()}
        film = Film(self.start_up, span, depth, {n: _whole(real[n] / drawn[n]) for n in names}, False, {})
        return film, (self._released(name, max(1, round(drawn[name] * whole)), whole) for name in names)

    def _released(self, name: str, count: int, whole: float) -> tuple[str, Tracks, Granules]:
        """``count`` granules of the feed, released at any moment of ``whole`` (s)."""
        resting = self.scene.feed.start == "resting"
        plan = self.plan if resting else resolved(self.plan)
        flight = replace(
            self.pipeline.flight(self.scene, self.pipeline.air.realisations), plan=plan, tolerance=TOLERANCE
        )
        feed = feedstock(self.scene, plan, name, self.pipeline.air.realisations.period, range(1)).granules
        rng = np.random.default_rng([self.scene.feed.seed, STREAM, list(self.scene.fraction).index(name)])
        rows = rng.permutation(np.arange(count) % len(feed))
        when, vibration = whole * np.sort(rng.random(count)), self.scene.vibration
        if resting and vibration is not None:  # one that lies on the body must begin at the phase that put it there
            when = when + (feed.time[rows] - when) % vibration.period
        grains = feed[rows].replace(time=when)
        self.pipeline.cache.tell("film", f"{name}: {count} granules")
        return name, flight.fly(name, grains, record=MAX_TRACK_POINTS, stream=STREAM), grains

    def _rate(self, name: str, depth: float) -> float:
        """Granules (1/s) of a fraction into a slice of ``depth`` (m)."""
        return float(number_rates(self.scene, name).sum()) * depth / self.scene.feed.depth


def _whole(number: float) -> float:
    """Round to two digits a number that is reported, not computed with."""
    return float(f"{number:.2g}")
