"""The granules' force on the air of a steady field: of granules that fly alone, and of those that meet in the slab.

In steady operation a mass flow M of granules that pass along a track exerts on the air, between two of its points,

    F = -M (dv - g' dt),   g' = g (1 - rho_air / rho) with buoyancy, else g,

with dv the velocity that all but walls and other granules gave it in between and dt the time that it took: the
track-length estimate of particle-source-in-cell (Crowe, Sharma & Stock 1977, J. Fluids Eng. 99, 325). The tracker keeps
that velocity with every point of a path, impacts and collisions left out, so that the forces of all boxes add up to
what the granules lost to the air, to round-off, however coarse the boxes are. All forces of the air count, not drag
alone.

Range: granules that fill little of the volume; the force of a whole step lies on the straight line between its ends.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...air.field import FlowField
from ...air.kinds.airflow_kinds import Realisations
from ...core.errors import SceneError
from ...core.files import write_json
from ...core.geometry import Boxes, ForceDensity
from ...core.number import student
from ...core.tables import save_arrays
from ...laws.constants import GRAVITY
from ...planning.collisions import CollisionPlan
from ...planning.plan import COMPARED, REPLICATES, Plan, gathered
from ...scene import Scene
from ...scene.machine import Plumb
from .. import Granules, Tracks
from ..feed.feedstock import feedstock
from ..feed.stream import SlabFeed, slab_top
from .fraction_flights import Flight
from .slab_stage import LATE, SlabFlight

Array = NDArray[np.float64]
POINTS, RECORDED = 512, 128  # kept of a track: alone, and in the slab
ACROSS = 16  # boxes across the first body, or the channel where none is
ALONG = 64  # boxes along a channel without a body at least: granules' force varies along their fall
STREAM = 4 * REPLICATES  # of the random forces, apart from those of other calls
TOGETHER = 128  # tracks that are laid into the boxes at a time
PIECES = 4  # a track is laid into the boxes in pieces of at most this part of a box's edge; chosen
TOLERANCE = 3e-3  # of a landing place, body widths: a twentieth of a box


# -- What was gathered -------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Gathered:
    """The ``force`` on the air; ``losses`` (r, 2) N/m: what the granules of each replicate lost to the air, from the
    ends of their tracks alone, as if all were like them. Of granules alone: the part of the force above the slab
    (``before``), by fraction the ``shares`` in every bin, elsewhere last, and after how many seconds all but few have
    landed (``late``).
    """

    force: ForceDensity
    losses: Array
    before: ForceDensity
    shares: Mapping[str, list[float]] = field(default_factory=dict)
    late: Mapping[str, float] = field(default_factory=dict)

    @property
    def imbalance(self) -> float:
        """How far the force in all boxes is from what the granules lost, over the latter."""
        lost = self.losses.mean(axis=0)
        return float(np.linalg.norm(self.force.total - lost) / max(float(np.linalg.norm(lost)), 1e-300))

    @property
    def sampling(self) -> float:
        """Half of the 95 % interval of the force by the granules that it is gathered from, over the force."""
        count, mostly = len(self.losses), int(np.abs(self.losses.mean(axis=0)).argmax())
        along = self.losses[:, mostly]
        half = student(count - 1) * float(along.std(ddof=1)) / count**0.5
        return float(half / max(abs(along.mean()), 1e-300))

    def save(self, folder: Path) -> None:
        """Keep it in a folder."""
        boxes = [self.force.boxes.left, self.force.boxes.bottom, self.force.boxes.pitch]
        densities = {"density": self.force.density, "before": self.before.density}
        save_arrays(folder / "force.npz", {**densities, "losses": self.losses, "boxes": boxes})
        write_json(folder / "landed.json", {"shares": self.shares, "late": self.late})

    @classmethod
    def load(cls, folder: Path) -> Gathered:
        """What :meth:`save` kept."""
        with np.load(folder / "force.npz") as data:
            density, before, losses = (data[name] for name in ("density", "before", "losses"))
            left, bottom, pitch = data["boxes"].tolist()
        boxes = Boxes(left, bottom, pitch, density.shape[1], density.shape[0])
        both = ForceDensity(boxes, density), losses, ForceDensity(boxes, before)
        return cls(*both, **json.loads((folder / "landed.json").read_text()))


# -- Who gathers it ----------------------------------------------------------------------------------------------------
def resolved(plan: Plan) -> Plan:
    """The plan with every fraction released above the body, where the curtain's force on the air begins."""
    return replace(plan, fractions={name: replace(how, mode="resolved") for name, how in plan.fractions.items()})


def boxes_of(scene: Scene) -> Boxes:
    """Boxes in which the force on the air of a scene is gathered, over the whole channel."""
    channel, pitch = scene.channel, scene.width / ACROSS
    if not scene.body:
        pitch = min(pitch, (channel.top - channel.bottom) / ALONG)
    return Boxes.across(channel.width, channel.bottom, channel.top, pitch)


@dataclass(frozen=True)
class Gatherer:
    """Gathers the force on the air of one steady ``air``. In a scene that is its own mirror image the force is the mean
    of both images.
    """

    scene: Scene
    plan: Plan
    air: FlowField
    workers: int
    tell: Callable[[str], None]

    @property
    def boxes(self) -> Boxes:
        """Boxes over the whole channel, in which the force is gathered."""
        return boxes_of(self.scene)

    def alone(self, count: int, folder: Path) -> None:
        """Gather the force of ``count`` granules of each fraction, each of which flies alone; keep it in ``folder``."""
        few = self.scene.replace({"feed.count": count * REPLICATES // COMPARED})
        flight = Flight(few, resolved(self.plan), Realisations(self.air), TOLERANCE, self.workers, self.tell)
        bins, shares, late = len(self.scene.bin), {}, {}
        density, losses = np.zeros((self.boxes.rows, self.boxes.columns, 2)), np.zeros((COMPARED, 2))
        before = density.copy()
        for name in self.scene.fraction:
            self.tell(f"{name}: {count} granules, for their force on the air")
            feed = feedstock(few, flight.plan, name, 0.0, range(COMPARED))
            tracks = flight.fly(name, feed.granules, record=POINTS, stream=STREAM)
            flow, how = self._flow(name), self._how(self.plan.fractions[name].forces)
            density += force_on_the_air(tracks, feed.granules, flow, self.boxes, **how).density
            falling = _down_to(tracks, self._slab_begins(feed.granules), self.scene.plumb)
            before += force_on_the_air(falling, feed.granules, flow, self.boxes, **how).density
            lost = flow * _lost(tracks, feed.granules, **how)
            losses += [lost[feed.replicate == number].mean(axis=0) for number in range(COMPARED)]
            place, _ = tracks.ends(bins)
            shares[name] = (np.bincount(place % (bins + 1), minlength=bins + 1) / len(place)).tolist()
            late[name] = float(np.quantile(tracks.time - feed.granules.time, LATE))
        self._both_images(density, losses, before, shares, late).save(folder)

    def among_others(self, slab: CollisionPlan, start_up: float, before: ForceDensity, folder: Path) -> None:
        """Gather the force of granules that meet in COMPARED replicates of the ``slab``, which is steady after the
        ``start_up`` (s) and counts for as long, beside that on their way there (``before``); keep it in ``folder``.

        Of each fraction the force is that of the granules fed over their mass, times the mass flow of the feed: how
        many come by chance does not matter.
        """
        count = gathered(self.scene.feed.count)
        collisions = replace(slab, replicates=COMPARED, operation=start_up, count=count)
        plan, airs = replace(resolved(self.plan), collisions=collisions), Realisations(self.air)
        flight = SlabFlight(
            self.scene, plan, airs, collisions.depth, start_up, start_up, TOLERANCE, workers=self.workers,
            tell=self.tell, recorded=RECORDED,
            also=lambda number, feed, tracks: save_arrays(folder / f"given-{number}.npz", self._given(feed, tracks)),
        )  # fmt: skip
        flight.fly_all(folder, COMPARED)
        flight.load(folder, COMPARED)  # for what it raises where none of a fraction came
        parts = [dict(np.load(folder / f"given-{number}.npz")) for number in range(COMPARED)]
        given, lost, mass = (np.stack([part[key] for part in parts]) for key in ("given", "lost", "mass"))
        flow = np.array([self._flow(name) for name in self.scene.fraction]) / mass.mean(axis=0)
        ratio = lost.sum(axis=0) / mass.sum(axis=0)[:, None]
        losses = np.einsum("f,rfk->rk", flow, lost + ratio * (mass.mean(axis=0) - mass)[..., None])
        density = np.einsum("f,fyxk->yxk", flow, given.mean(axis=0)) + before.density
        self._both_images(density, losses + before.total, before.density).save(folder)

    def _given(self, feed: SlabFeed, tracks: Tracks) -> dict[str, Array]:
        """Mass (kg) of each fraction's granules that came in steady operation, what they gave to the air in each box (N
        s/m3 a metre) and in all (N s).
        """
        how = self._how({force for fraction in self.plan.fractions.values() for force in fraction.forces})
        given, lost, mass = [], [], []
        for number in range(len(self.scene.fraction)):
            mine = np.flatnonzero(feed.counted & (feed.fraction == number))
            grains, paths, masses = feed.granules[mine], tracks.some(mine), feed.mass[mine]
            given.append(force_on_the_air(paths, grains, masses, self.boxes, **how).density)
            lost.append(masses @ _lost(paths, grains, **how))
            mass.append(masses.sum())
        return {"given": np.stack(given), "lost": np.stack(lost), "mass": np.array(mass)}

    def _slab_begins(self, grains: Granules) -> float:
        """Height (m) at which the first of a fraction's granules enter a slab; as if the channel stood upright."""
        return float(slab_top(self.scene, grains, self.scene.plumb.seen(grains.position)[:, 0]).min())

    def _flow(self, name: str) -> float:
        """Mass flow of a fraction, kg/s per metre across the plane."""
        return self.scene.feed.mass_flow / self.scene.feed.depth * self.scene.mass_shares()[name]

    def _how(self, forces: Collection[str]) -> dict[str, Any]:
        return {"air_density": self.air.density, "forces": forces, "gravity": self.scene.plumb.gravity}

    def _both_images(self, density: Array, losses: Array, before: Array, *landed: Any) -> Gathered:
        force, above = ForceDensity(self.boxes, density), ForceDensity(self.boxes, before)
        if not self.plan.airflow.symmetric:
            return Gathered(force, losses, above, *landed)
        return Gathered(force.mirrored(), losses * (0.0, 1.0), above.mirrored(), *landed)


def _down_to(tracks: Tracks, level: float, plumb: Plumb) -> Tracks:
    """Recorded tracks as far as they first come down to a ``level`` (m), as if the channel stood upright; nothing of
    those that never do.
    """
    cut = []
    for path in tracks.recorded:
        height = plumb.seen(path[:, 1:3])[:, 1]
        end = int(np.argmax(height <= level))  # 0 where none is
        high, low = path[max(end - 1, 0)], path[end]
        top, bottom = height[max(end - 1, 0)], height[end]
        share = (top - level) / (top - bottom) if end else 0.0
        cut.append(np.vstack([path[: max(end, 1)], high + share * (low - high)]))
    return replace(tracks, recorded=cut)


def _lost(
    tracks: Tracks, grains: Granules, air_density: float, forces: Collection[str], gravity: tuple[float, float]
) -> Array:
    """Velocity (n, 2) m/s that each granule gave to the air on its whole way: what gravity gave it less what all but
    walls and others did, derived from the ends of the tracks alone.
    """
    gain = np.array([path[-1, 5:7] - path[0, 5:7] for path in tracks.recorded]).reshape(-1, 2)
    lasted = np.array([path[-1, 0] - path[0, 0] for path in tracks.recorded])
    lift = air_density / grains.density if "buoyancy" in forces else 0.0
    fallen = np.stack([pull * (1.0 - lift) * lasted for pull in gravity], axis=1)
    return np.asarray(fallen - gain)


# -- The force along tracks --------------------------------------------------------------------------------------------
def force_on_the_air(
    tracks: Tracks,
    grains: Granules,
    mass_flow: float | Array,
    boxes: Boxes,
    *,
    air_density: float = 0.0,
    forces: Sequence[str] = ("drag", "gravity"),
    gravity: Sequence[float] = (0.0, -GRAVITY),
) -> ForceDensity:
    """What ``tracks`` of ``grains``, kept with their paths, exert on the air when a ``mass_flow`` (kg/s per metre
    across the plane) comes along all of them together, each granule standing for the same part of it; or along each
    its own (n,).

    ``air_density`` (kg/m3) and ``forces`` as flown, for the buoyancy. What lies outside the ``boxes`` goes to those on
    their edge. Raises SceneError where no paths were kept.
    """
    if len(tracks.recorded) < len(grains):
        raise SceneError("force_on_the_air: no paths were kept; call track(..., record=True)")
    lift = air_density / grains.density if "buoyancy" in forces else np.zeros(len(grains))
    weight = (1.0 - lift)[:, None] * np.asarray(gravity, dtype=float)
    count = boxes.rows * boxes.columns
    force = np.zeros((count, 2))
    flow = mass_flow if isinstance(mass_flow, np.ndarray) else np.full(len(grains), mass_flow / max(len(grains), 1))
    for low in range(0, len(grains), TOGETHER):
        some = slice(low, low + TOGETHER)
        place, given = _laid(tracks.recorded[some], weight[some], flow[some], boxes)
        for axis in (0, 1):
            force[:, axis] -= np.bincount(place, given[:, axis], count)
    return ForceDensity(boxes, force.reshape(boxes.rows, boxes.columns, 2) / boxes.pitch**2)


def _laid(paths: Sequence[Array], pull: Array, flow: Array, boxes: Boxes) -> tuple[NDArray[np.int64], Array]:
    """Boxes (k,) along ``paths``, and what the air gave the granules in each (k, 2), N/m: ``flow`` (n,) kg/s a metre of
    each times the velocity.
    """
    lengths = np.array([len(path) for path in paths])
    points = np.concatenate(paths)
    owner = np.repeat(np.arange(len(paths)), np.maximum(lengths - 1, 0))
    begins = np.delete(np.arange(len(points)), np.cumsum(lengths) - 1)
    start = points[begins]
    change = points[begins + 1] - start
    given = (change[:, 5:7] - change[:, :1] * pull[owner]) * flow[owner, None]
    way = np.hypot(change[:, 1], change[:, 2])
    pieces = np.maximum(1, np.ceil(PIECES * way / boxes.pitch).astype(np.int64))
    step = np.repeat(np.arange(len(pieces)), pieces)
    number = np.arange(len(step)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    along = ((number + 0.5) / pieces[step])[:, None]
    return boxes.holding(start[step, 1:3] + along * change[step, 1:3]), (given / pieces[:, None])[step]
