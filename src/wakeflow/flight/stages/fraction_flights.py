"""Every fraction's granules from the feed to their landing: what they meet, where they end, kept in one folder."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ... import flight as tracking
from ...air.kinds.airflow_kinds import Realisations
from ...core.errors import SceneError
from ...core.geometry import wall_edge
from ...core.process import cores
from ...core.tables import Columns
from ...planning.plan import AT_ONCE, REPLICATES, Plan, replicate_size
from ...scene import Scene
from ...scene.changes import GranuleVariation
from ...scene.pictures import TRACKS_RECORDED
from .. import Body, Granules, Tracks
from ..feed.feedstock import Feedstock, feedstock
from ..feed.first_contact import motion_of
from .landings import LandingCount, Landings, paths_of, save_recorded_tracks

if TYPE_CHECKING:
    from ...air.field import FlowField

Array = NDArray[np.float64]
COARSE, DETAIL = 1024, 8192  # points kept of a track; of the few that a picture of its own asks for
WALL = 0.05  # thickness of the channel's walls in channel widths; only their inner faces are ever met
STREAMS = 4  # of random numbers that the replicates have each: of landings, pictures, mirror images, own pictures
PATIENCE = 40.0  # channel heights at air speed before a granule counts as airborne
MIN_TERMINAL_VELOCITY = 1e-6  # m/s, taken for a terminal velocity: one that neither falls nor rises
HOVERING = 1e4  # the same where there is no body: granules of almost the air speed hang in it, and steps are cheap


@dataclass(frozen=True)
class Flight:
    """How granules of a scene are flown: the replicates in turn in the airflow's realisations ``airs``; ``tell`` hears
    of progress.
    """

    scene: Scene
    plan: Plan
    airs: Realisations
    tolerance: float
    workers: int = field(default_factory=cores)
    tell: Callable[[str], None] = lambda _: None
    replicates: int = REPLICATES  # the first of them; all, but for a comparison
    noises: int = 1  # as of ``track``
    of_all: str = ""  # which part of all granules these are, in words

    def fly_all(self, folder: Path, *, drawn: bool) -> None:
        """Fly every fraction and keep its landings in ``folder``, in the order of the replicates, and the tracks for
        pictures; fractions that are there already are left alone.
        """
        for name in self.scene.fraction:
            if (folder / f"{name}.npz").exists():
                continue
            count = LandingCount(self._size, self.replicates, len(self.scene.bin), self.airs.cycles)
            shown = [path for paths in self._fly_parts(name, count, drawn=drawn) for path in paths]
            if drawn:
                save_recorded_tracks(folder / f"{name}.drawn.npz", shown)
            count.save(folder / f"{name}.npz")

    @property
    def _size(self) -> int:
        """Granules of a replicate."""
        return replicate_size(self.scene.feed.count)

    def _fly_parts(self, name: str, landed: LandingCount, *, drawn: bool) -> Iterator[list[Columns]]:
        """Tracks for pictures, and all landings of a fraction into ``landed``: of one realisation of the airflow after
        the other, and AT_ONCE granules at a time, so that memory grows neither with the number of fields nor with that
        of granules.
        """
        airs, size, done = len(self.airs), self._size, 0
        step, whole, count = max(1, AT_ONCE // size), range(size), self.replicates * size
        parts = [whole[i : i + AT_ONCE] for i in range(0, size, AT_ONCE)]
        chosen = np.linspace(0, count - 1, min(TRACKS_RECORDED, count)).astype(int) if drawn else np.zeros(0, dtype=int)
        for number in range(min(airs, self.replicates)):
            flight = replace(self, airs=Realisations(self.airs.make(number)))
            mine = range(number, self.replicates, airs)
            for replicates, part in product((mine[i : i + step] for i in range(0, len(mine), step)), parts):
                self.tell(f"{name}: injecting {done} of {count}")
                rows = slice(part.start, part.stop)
                feed = feedstock(self.scene, self.plan, name, self.airs.period, replicates, part=rows)
                stream = replicates[0] + STREAMS * REPLICATES * parts.index(part)
                yield flight._drawn(name, feed, chosen, replicates, part, stream)
                of_all = f" after {done}, of {count}" if len(feed.replicate) < count else ""
                second = _second_half(feed, size, replicates, part.start)
                tracks = replace(flight, of_all=of_all)._fly_halves(name, feed.granules, second, stream)
                cycle = self.airs.cycle_of(feed.granules.time)
                landed.add(landing_columns(feed, tracks, len(self.scene.bin), number, cycle), part.start)
                done += len(feed.replicate)

    def landings(self, name: str) -> Landings:
        """Where all granules of a fraction land, in air that does not vary."""
        feed = feedstock(self.scene, self.plan, name, 0.0)
        cycle = self.airs.cycle_of(feed.granules.time)
        parts = landing_columns(feed, self.fly(name, feed.granules), len(self.scene.bin), 0, cycle)
        parts.pop("injected")
        return Landings(**parts)

    def _drawn(
        self, name: str, feed: Feedstock, chosen: Iterable[int], replicates: range, part: range, stream: int
    ) -> list[Columns]:
        """Tracks for pictures of those of the ``chosen`` granules, numbered through all replicates, that are here: in
        this ``part`` of each of the ``replicates``.
        """
        of = [divmod(int(g), self._size) for g in chosen]
        here = [
            i * len(part) + k - part.start for i, r in enumerate(replicates) for its, k in of if its == r and k in part
        ]
        grains = feed.granules[np.array(here, dtype=int)]
        tracks = self.fly(name, grains, record=COARSE, stream=REPLICATES + stream)
        return paths_of(tracks, grains, len(self.scene.bin))

    def fly_pictured(self, folder: Path, names: Sequence[str], count: int, body_speed: float | None) -> None:
        """Keep ``count`` tracks of each fraction in ``names``; with ``body_speed`` (m/s, upward) the first of them is
        that of the granule, among all that are fed, that met the body at the speed nearest to it.
        """
        for name in names:
            parts = range(min(REPLICATES, -(-count // self._size))) if body_speed is None else range(REPLICATES)
            self.tell(f"{name}: {count} tracks for a picture")
            feed = feedstock(self.scene, self.plan, name, self.airs.period, parts)
            chosen = np.linspace(0, len(feed.replicate) - 1, min(count, len(feed.replicate))).astype(int)
            if body_speed is not None:
                chosen = np.concatenate([[self._meeting(name, feed, body_speed)], chosen])
            detail = DETAIL if len(chosen) <= 2 * TRACKS_RECORDED else COARSE
            tracks = self.fly(name, feed.granules[chosen], record=detail, stream=3 * REPLICATES)
            save_recorded_tracks(
                folder / f"{name}.drawn.npz", paths_of(tracks, feed.granules[chosen], len(self.scene.bin))
            )

    def fly_part(
        self, name: str, replicate: int, part: range, variation: GranuleVariation
    ) -> tuple[Array, NDArray[np.int16]]:
        """Where (m, 2) m each granule of a ``part`` of a ``replicate`` lands, those of the answer but for the
        ``variation``, and the index of its bin (m,), -1 for elsewhere.
        """
        alone = range(replicate, replicate + 1, len(self.airs))
        flight = replace(self, airs=Realisations(self.airs.make(replicate % len(self.airs))))
        rows = slice(part.start, part.stop)
        feed = feedstock(self.scene, self.plan, name, self.airs.period, alone, variation, rows)
        second = _second_half(feed, self._size, alone, part.start)
        tracks = flight._fly_halves(name, feed.granules, second, replicate)
        return tracks.position, tracks.ends(len(self.scene.bin))[0].astype(np.int16)

    def _meeting(self, name: str, feed: Feedstock, body_speed: float) -> int:
        """The injected granule that met the body at the upward speed (m/s) nearest to the one given."""
        rising = motion_of(self.scene).at(feed.granules.time)[1][:, 1]
        met = np.where(feed.injected, rising, np.inf)
        if not feed.injected.any():
            raise SceneError(
                f"fraction.{name}: its impacts are resolved; a picture with body_speed needs feed.mode = 'injected'"
            )
        return int(np.argmin(np.abs(met - body_speed)))

    def _fly_halves(self, name: str, grains: Granules, second: NDArray[np.bool_], stream: int) -> Tracks:
        """``grains``, of which the ``second`` half flies in the mirror image of the airflow where that is as likely: in
        a symmetric channel that is computed whole.

        A few periods of shedding are a small sample, and their mean wake may lean to one side; so may a steady one of
        several bodies. The mean over both images does not lean. Half of every replicate, so that these are alike:
        between an airflow and its image there is no sampling error to find.
        """
        field = self.airs.field
        if field is None or not self.plan.airflow.mirrored:
            return self.fly(name, grains, stream=stream)
        tracks = Tracks.empty(len(grains))
        for part, apart in ((~second, 0), (second, 2 * REPLICATES)):
            if part.any():  # else no air is packed for it
                flight = replace(self, airs=Realisations(field.image)) if apart else self
                for column, values in vars(flight.fly(name, grains[part], stream=apart + stream)).items():
                    if isinstance(values, np.ndarray):
                        getattr(tracks, column)[part] = values
        return tracks

    def fly(self, name: str, grains: Granules, *, record: int = 0, stream: int = 0) -> Tracks:
        """Track granules of one fraction through the first realisation, keeping ``record`` points of each; ``stream``
        tells the random forces of calls apart.
        """
        how, heights = self.plan.fractions[name], PATIENCE if self.scene.body else HOVERING
        patience = max(5.0, passage(self.scene, self.plan, [name], heights))
        return track_in(
            self.scene, self.airs.field, grains, (name, stream), patience, tolerance=self.tolerance, forces=how.forces,
            drag=how.drag, noises=self.noises, record=record, workers=self.workers,
            progress=None if record else lambda done, total: self.tell(f"{name}: {done} of {total}{self.of_all}"),
        )  # fmt: skip


def track_in(
    scene: Scene, field: FlowField | None, grains: Granules, stream: tuple[str, int], patience: float, **how: Any
) -> Tracks:
    """Track granules through the ``field``, past the bodies of a ``scene`` into its bins, until ``patience`` (s) after
    the last is born. ``stream``: name and number of the random forces' stream; ``how``: as of :func:`wakeflow.track`.
    """
    until = float(np.max(grains.time, initial=0.0)) + patience
    return tracking.track(
        field, grains, until=until, length=scene.width, seed=seed_of(scene.feed.seed, *stream),
        bodies=bodies_and_walls(scene), lines=end_lines(scene), gravity=scene.plumb.gravity, **how,
    )  # fmt: skip


def passage(scene: Scene, plan: Plan, fractions: Iterable[str], heights: float) -> float:
    """Seconds in which the ``fractions`` come through so many ``heights`` of the channel, at least about: at the air's
    speed; in air at rest at the slowest terminal velocity, in a vacuum at that of a free fall.
    """
    height, air = scene.channel.top - scene.channel.bottom, scene.air
    speed = float(np.sqrt(scene.gravity * height)) if air is None or air.still else air.speed
    if air is not None and air.still:
        speed = min(
            speed,
            *(max(abs(plan.fractions[name].terminal_velocity or 0.0), MIN_TERMINAL_VELOCITY) for name in fractions),
        )
    return heights * height / speed


def seed_of(seed: int, name: str, stream: int) -> int:
    """A number of the tracker's random streams, of the scene's ``seed``, the fraction and a part of its granules."""
    state = np.random.SeedSequence([seed, zlib.crc32(name.encode()), stream]).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(1))


def _second_half(feed: Feedstock, size: int, replicates: range, first: int = 0) -> NDArray[np.bool_]:
    """The second half of each of some ``replicates`` of ``size`` granules, from number ``first`` on; of single granules
    every other one.

    Both halves of a Sobol sample of 2^m points are balanced samples themselves, in every coordinate (blocks of a
    (t, s)-sequence are nets: Niederreiter 1987, Monatsh. Math. 104, 273).
    """
    if size == 1:
        return np.asarray((feed.replicate // replicates.step) % 2 == 1)
    return (first + np.arange(len(feed.replicate))) % size >= size // 2


def bodies_and_walls(scene: Scene) -> list[Body]:
    """What granules bounce off: the bodies, vibrating or at rest, the channel's walls where no bin opens and no stream
    enters, and walls that keep a part.
    """
    motion = motion_of(scene)
    places, bins = scene.collecting, list(scene.bin.values())
    solids = [
        Body(
            _into_the_wall(body.outline(), scene), motion=motion, line=places.get(name, -1),
            capture=(bins[places[name]].keeps_part or 0.0) if name in places else 0.0,
        )
        for name, body in scene.body.items()
    ]  # fmt: skip
    half, thick = scene.channel.width / 2, WALL * scene.channel.width
    for side, inner, outer in (("left", -half, -half - thick), ("right", half, half + thick)):
        level = scene.channel.bottom - thick
        for start, end in [*_openings(scene, side), (scene.channel.top + thick, None)]:
            if start > level:
                low, high = sorted((inner, outer))
                solids.append(Body(np.array([(low, level), (high, level), (high, start), (low, start)])))
            level = end if end is not None else level
    for i, bin_ in enumerate(bins):
        if (corners := bin_.wall(scene, thick)) is not None:
            solids.append(Body(corners, capture=bin_.keeps_part or 0.0, line=i))
    return solids


def _into_the_wall(outline: Array, scene: Scene) -> Array:
    """The outline of a body; one that stands on a wall goes on in it, so that no gap is between the two."""
    edge = wall_edge(outline, 0.5 * scene.channel.width)
    if edge is None:
        return outline
    corners = outline[[edge.first, (edge.first + 1) % len(outline)]] * (1.0 + WALL, 1.0)
    return np.insert(outline, edge.first + 1, corners, axis=0)


def _openings(scene: Scene, side: str) -> list[tuple[float, float]]:
    """Where a wall is another, (from, to) along y in order: open at bins and where a secondary stream enters, or one
    that keeps a part of what meets it.
    """
    streams = [inlet.span for inlet in scene.channel.inlet.values() if inlet.side == side]
    return sorted([*streams, *(opening.ends for opening in scene.on_sides(side).values())])


def end_lines(scene: Scene) -> list[Array]:
    """Lines that end a track: the bins in the scene's order, then the floor and the top of the channel. That of a bin
    on a wall lies where no granule comes: the wall ends the track.
    """
    channel = scene.channel
    half, slack = 0.5 * channel.width, 1e-6 * channel.width
    across = np.array([-half - WALL * channel.width, half + WALL * channel.width])
    borders = [np.stack([across, np.full(2, y)], axis=1) for y in (channel.bottom - slack, channel.top + slack)]
    nowhere = borders[0] - (0.0, channel.width)
    return [bin_.line(scene) if bin_.keeps_part is None else nowhere for bin_ in scene.bin.values()] + borders


def landing_columns(feed: Feedstock, tracks: Tracks, bins: int, realisation: int, cycle: NDArray[np.uint16]) -> Columns:
    """What is kept of a landing, 40 bytes a granule; ``cycle`` (n,) of the shedding at its release."""
    bin_, fate = tracks.ends(bins)
    return {
        "position": tracks.position,
        "bin": bin_.astype(np.int16),
        "replicate": feed.replicate.astype(np.uint8),
        "diameter": feed.granules.diameter.astype(np.float32),
        "fate": fate.astype(np.int8),
        "time": (tracks.time - feed.granules.time).astype(np.float32),
        "impacts": (tracks.impacts + feed.injected).astype(np.int32),  # the tracker did not see these' first impact
        "injected": feed.injected,
        "realisation": np.full(len(feed.replicate), realisation, dtype=np.uint8),
        "cycle": cycle,
        "drag": feed.granules.drag_scale.astype(np.float32),
    }
