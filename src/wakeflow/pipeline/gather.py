"""The granules' force on the air of one field, gathered along the tracks of part of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.boxes import Boxes, ForceDensity
from ..core.errors import known
from ..core.files import atomic_write, write_json
from ..field import FlowField
from ..injection.feed import feedstock
from ..laws.constants import GRAVITY
from ..planning.plan import COMPARED, GATHERED, REPLICATES, Plan
from ..scene import Scene
from ..tracking import Granules, Tracks
from ..tracking.momentum import force_on_the_air
from .realisations import Realisations
from .tracks import Flight

__all__ = ["Gathered", "gather_force", "gathered_in", "resolved"]

Array = NDArray[np.float64]
POINTS = 512  # kept of a track
ACROSS = 16  # boxes across the first body
STREAM = 4 * REPLICATES  # of the random forces, apart from those of other calls


@dataclass(frozen=True)
class Gathered:
    """The ``force`` on the air; ``lost`` (2,) N/m: what all granules lost to the air, from the ends of their tracks
    alone; ``shares`` {fraction: share of its granules in every bin, elsewhere last}.
    """

    force: ForceDensity
    lost: Array
    shares: dict[str, list[float]]

    @property
    def imbalance(self) -> float:
        """How far the force in all boxes is from what the granules lost, over the latter."""
        return float(np.linalg.norm(self.force.total - self.lost) / max(float(np.linalg.norm(self.lost)), 1e-300))


def resolved(plan: Plan) -> Plan:
    """The plan with every fraction released above the body, where the curtain's force on the air begins."""
    return replace(plan, fractions={name: replace(how, mode="resolved") for name, how in plan.fractions.items()})


def gather_force(
    scene: Scene, plan: Plan, field: FlowField, workers: int | None, tell: Callable[[str], None], folder: Path
) -> None:
    """Fly GATHERED of each fraction through the steady ``field`` and keep what they exert on the air in ``folder``.

    In a scene that is its own mirror image the force is the mean of both images.
    """
    few = scene.replace({"feed.count": GATHERED * REPLICATES // COMPARED})
    flight = Flight(few, resolved(plan), Realisations(field), scene.numerics.tolerance, workers, tell)
    channel, shares = scene.channel, scene.mass_shares()
    boxes = Boxes.across(channel.width, channel.bottom, channel.top, scene.width / ACROSS)
    density, lost, landed = np.zeros((boxes.rows, boxes.columns, 2)), np.zeros(2), {}
    for name in scene.fraction:
        tell(f"{name}: {GATHERED} granules, for their force on the air")
        grains = feedstock(few, flight.plan, name, None, range(COMPARED)).granules
        tracks = flight.fly(name, grains, record=POINTS, stream=STREAM)
        flow, forces = scene.feed.mass_flow / scene.feed.depth * shares[name], plan.fractions[name].forces
        how: dict[str, Any] = {"air_density": field.density, "forces": forces}
        density += force_on_the_air(tracks, grains, flow, boxes, **how).density
        lost += flow * _lost(tracks, grains, **how)
        bins = np.where((tracks.line >= 0) & (tracks.line < len(scene.bin)), tracks.line, len(scene.bin))
        landed[name] = (np.bincount(bins, minlength=len(scene.bin) + 1) / len(grains)).tolist()
    force = ForceDensity(boxes, density)
    if plan.airflow.symmetric:
        force, lost = force.mirrored(), lost * (0.0, 1.0)
    with atomic_write(folder / "force.npz", "wb") as stream:
        box = [boxes.left, boxes.bottom, boxes.pitch]
        np.savez(stream, density=force.density, lost=lost, boxes=np.array(box))
    write_json(folder / "shares.json", landed)


def _lost(tracks: Tracks, grains: Granules, air_density: float, forces: tuple[str, ...]) -> Array:
    """Velocity (2,) m/s that a granule gave to the air on its whole way, mean over all: what gravity gave it less what
    all but walls did, told from the ends of the tracks alone.
    """
    gain = np.array([path[-1, 5:7] - path[0, 5:7] for path in known(tracks.recorded)])
    lasted = np.array([path[-1, 0] - path[0, 0] for path in known(tracks.recorded)])
    lift = air_density / grains.density if "buoyancy" in forces else 0.0
    fallen = -GRAVITY * (1.0 - lift) * lasted
    return np.asarray(np.stack([-gain[:, 0], fallen - gain[:, 1]], axis=1).mean(axis=0))


def gathered_in(folder: Path) -> Gathered:
    """What :func:`gather_force` kept in a folder."""
    with np.load(folder / "force.npz") as data:
        density, lost, (left, bottom, pitch) = data["density"], data["lost"], data["boxes"].tolist()
    boxes = Boxes(left, bottom, pitch, density.shape[1], density.shape[0])
    return Gathered(ForceDensity(boxes, density), lost, json.loads((folder / "shares.json").read_text()))
