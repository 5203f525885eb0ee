"""The joint answer of a scene: what its granules say of all shares, and what the flown draws say of its inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.cells import Cells
from ..answer.joint import DRAWS, LACK, JointAnswer, Source, columns
from ..pipeline.input_samples import DrawnLandings, InputSamples
from ..pipeline.landings import Landings
from ..planning.dependence import Dependence
from ..planning.unknowns import Unknown, unknown_kinds
from ..scene import Scene
from .response import Places, Response, response
from .separation import shares_in

Array = NDArray[np.float64]
LOTS = 64  # of draws among which one is looked for that keeps an order


def acting(unknowns: Sequence[Unknown], fraction: str) -> list[int]:
    """The places of the unknowns that act on a fraction."""
    return [i for i, one in enumerate(unknowns) if one.fraction in (None, fraction)]


def responses(scene: Scene, draws: InputSamples) -> dict[str, Response]:
    """How the landings of every fraction go with what was drawn."""
    cells = Cells.of(scene, len(scene.fraction))
    lateral = np.array([unknown_kinds[one.kind].lateral for one in draws.unknowns])
    found = {}
    for name in draws.varied:
        mine = acting(draws.unknowns, name)
        z = draws.z[:, mine]
        own, then = (_places(cells, scene, landed[name]) for landed in (draws.own, draws.varied))
        if scene.images is None:
            found[name] = response(cells, z, own, then)
            continue
        other = (_places(cells, scene, _image(landed[name], scene.images)) for landed in (draws.own, draws.varied))
        own, then = (_both(a, b) for a, b in zip((own, then), other, strict=True))
        found[name] = response(cells, np.vstack([z, np.where(lateral[mine], -z, z)]), own, then, copies=2)
    return found


def _places(cells: Cells, scene: Scene, landed: DrawnLandings) -> Places:
    side, place = cells.along(scene, landed.position.astype(float), landed.bin)
    return Places(side, place, cells.at(side, place, cells.off_sides(landed.bin)))


def _both(one: Places, other: Places) -> Places:
    found: list[Any] = [np.concatenate(pair) for pair in zip(one, other, strict=True)]
    return Places(*found)


def _image(landed: DrawnLandings, images: Sequence[int]) -> DrawnLandings:
    """The landings in the mirror image of a machine with two equal sides."""
    turned = np.array([*images[:-1], -1], dtype=landed.bin.dtype)  # the last place is elsewhere
    return DrawnLandings(landed.position * np.array([-1.0, 1.0], dtype=np.float32), turned[landed.bin])


def draws_of(unknowns: Sequence[Unknown], ties: Dependence | None) -> Array:
    """Every input (DRAWS, keys) in standard deviations, as they move together. A draw that breaks an order is drawn
    anew; where hardly any keeps them, one that does stands for it.
    """
    keys = [one.key for one in unknowns]
    z = columns(keys)
    if ties is None:
        return z
    z = ties.joined(z)
    kept = ties.kept(z)
    for lot in range(1, LOTS):
        if kept.all():
            return z
        again = ties.joined(columns(f"{key} {lot}" for key in keys))
        taken = ~kept & ties.kept(again)
        z[taken], kept = again[taken], kept | taken
    return in_order(z, ties)


def in_order(z: Array, ties: Dependence) -> Array:
    """The draws ``z`` (DRAWS, keys), those that break an order replaced by others that keep it."""
    kept = ties.kept(z)
    if kept.all() or not kept.any():
        return z
    found = z.copy()
    found[~kept] = np.resize(z[kept], (int((~kept).sum()), z.shape[1]))
    return found


def joint_answer(
    scene: Scene,
    landings: Mapping[str, Landings],
    *,
    draws: InputSamples | None = None,
    ties: Dependence | None = None,
    how: Mapping[str, Response] | None = None,
    factors: Mapping[str, float] | None = None,
    sources: Sequence[Source] = (),
    salt: str = "",
) -> JointAnswer:
    """The joint answer of the ``landings`` by fraction, whose inputs ``draws`` say, how these depend on each other
    (``ties``) and how the landings go with them (``how``), with a
    factor for each fraction on what those change; ``sources``: of error beside; ``salt``: of this run alone.
    """
    names, cells = list(landings), Cells.of(scene, len(landings))
    feed = scene.mass_shares()
    targets = {name: tuple(scene.fraction[name].targets) for name in names}
    keys = [] if draws is None else [one.key for one in draws.unknowns]
    # As few digits as are kept in the run's folder: what is read there again says the same
    drawn = np.zeros((DRAWS, 0)) if draws is None else draws_of(draws.unknowns, ties)
    z, change = drawn.astype(np.float32).astype(float), np.zeros((DRAWS, len(names), cells.count), np.float16)
    scale, roots = np.ones((DRAWS, len(names))), np.zeros((len(names), len(scene.bin) + 1, len(scene.bin) + 1))
    for number, name in enumerate(names if draws is not None and how is not None else ()):
        factor, one = (factors or {}).get(name, 1.0), (how or {})[name]
        moved, doubt = one(z[:, acting((draws.unknowns if draws else ()), name)])
        change[:, number], scale[:, number], roots[number] = factor * moved, np.float32(factor * doubt), one.root
    own = () if draws is None else (Source(LACK, roots, computing=False, scale=scale),)
    return JointAnswer(
        tuple(names), np.array([feed[name] for name in names]), targets, scene.feed.mass_flow, cells, scene.images,
        tuple(keys), z, _base(scene, cells, landings), change.astype(np.float32), (*own, *sources), salt,
    )  # fmt: skip


def _base(scene: Scene, cells: Cells, landings: Mapping[str, Landings]) -> Array:
    """The answer's share (fractions, cells) in every cell: that of every bin, parted as the landings in it that are
    kept.
    """
    shares, parts = shares_in(scene, landings), cells.parts()
    found = np.zeros((len(landings), cells.count))
    for number, (name, landing) in enumerate(landings.items()):
        side, place = cells.along(scene, landing.position, landing.bin)
        cell = cells.at(side, place, cells.off_sides(landing.bin))
        mass = np.asarray(np.bincount(cell, landing.mass_shares, minlength=cells.count), dtype=float)
        if scene.images is not None:
            mass = np.asarray(0.5 * (mass + mass[cells.mirrored(scene.images)]))
        inside = mass @ parts
        even = parts / np.maximum(parts.sum(axis=0), 1e-300)
        within = np.where(inside > 0.0, mass[:, None] * parts / np.where(inside > 0.0, inside, 1.0), even)
        found[number] = within @ shares[name]
    return found
