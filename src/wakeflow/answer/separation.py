"""Shares out of landings: what the granules say of them, and what the flown draws say of the inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..flight.stages.input_samples import DrawnLandings, InputSamples
from ..flight.stages.landings import Landings
from ..planning.unknowns import Dependence, Unknown, unknown_kinds
from ..scene import Scene
from .cells import LandingCells
from .draws import DRAWS, LACK, ErrorSource, column, columns, less_at_ends
from .joint import JointAnswer
from .response import Places, Response, response
from .shares import Separation
from .spread import sample_errors, shares_in

Array = NDArray[np.float64]
NONE_MEET: Mapping[str, float] = {}  # granules that fly alone
LOTS = 64  # of draws among which one is looked for that keeps an order


def acting(unknowns: Sequence[Unknown], fraction: str) -> list[int]:
    """The places of the unknowns that act on a fraction."""
    return [i for i, unknown in enumerate(unknowns) if unknown.fraction in ("", fraction)]


def responses(scene: Scene, draws: InputSamples, cells: LandingCells | None = None) -> dict[str, Response]:
    """How the landings of every fraction go with what was drawn, in the ``cells`` of an answer; in cells of their own
    without one.
    """
    if cells is None:
        landed = [landing for lot in (draws.own, draws.varied) for landing in lot.values()]
        cells = LandingCells.of(scene, len(scene.fraction), [(landing.position, landing.bin) for landing in landed])
    by_fraction = {}
    for name in draws.varied:
        before, then = (_places(cells, scene, landed[name]) for landed in (draws.own, draws.varied))
        by_fraction[name] = response(cells, draws.z[:, acting(draws.unknowns, name)], before, then)
    return by_fraction


def _places(cells: LandingCells, scene: Scene, landed: DrawnLandings) -> Places:
    side, place = cells.along(scene, landed.position.astype(float), landed.bin)
    return Places(side, place, cells.at(side, place, cells.off_sides(landed.bin)))


def draws_of(unknowns: Sequence[Unknown], ties: Dependence) -> Array:
    """Every input (DRAWS, keys) in standard deviations, as they move together. A draw that breaks an order is drawn
    anew; where hardly any keeps them, one that does takes its place.
    """
    keys = [unknown.key for unknown in unknowns]
    z = ties.joined(columns(keys))
    kept = ties.kept(z)
    for lot in range(1, LOTS):
        if kept.all():
            return z
        again = ties.joined(columns(f"{key} {lot}" for key in keys))
        taken = ~kept & ties.kept(again)
        z[taken], kept = again[taken], kept | taken
    if kept.any():
        z[~kept] = np.resize(z[kept], (int((~kept).sum()), z.shape[1]))
    return z


class Changed(NamedTuple):
    """What the inputs change: ``z`` (DRAWS, keys) of the inputs called ``keys``; of every fraction the change (DRAWS,
    cells) of its shares from what they were ``before`` (cells,), and the ``lack`` of fit (DRAWS, bins + 1).
    """

    keys: tuple[str, ...]
    z: Array
    cells: LandingCells
    of: Mapping[str, FractionChange]


class FractionChange(NamedTuple):
    """What :class:`Changed` says of a fraction."""

    change: Array
    before: Array
    lack: Array


def changed(scene: Scene, unknowns: Sequence[Unknown], ties: Dependence, how: Mapping[str, Response]) -> Changed:
    """What the ``unknowns`` of a ``scene`` change of fractions whose landings go with them as ``how`` says."""
    from scipy.special import ndtr

    z = draws_of(unknowns, ties).astype(np.float32).astype(float)  # as they are kept in the run's folder
    effects = {}
    for name, fit in how.items():
        change, doubt = change_of(scene, unknowns, name, fit, z)
        before = 0.5 * (fit.before + fit.before[fit.cells.mirrored(scene.images)]) if scene.images else fit.before
        flown = (ndtr(column(f"{LACK} {name}")) * len(fit.off)).astype(int)  # as one of these is off, so is a draw
        effects[name] = FractionChange(change, before, doubt[:, None] * fit.off[flown])
    return Changed(tuple(unknown.key for unknown in unknowns), z, next(iter(how.values())).cells, effects)


def change_of(
    scene: Scene, unknowns: Sequence[Unknown], name: str, how: Response, z: Array, *, by_bin: bool = False
) -> tuple[Array, Array]:
    """The change (n, cells) of a fraction's shares in draws at ``z`` (n, keys) of all unknowns, or ``by_bin`` (n,
    bins + 1), which takes less time; and the standard deviation (n,) of what is not known of it. In a machine with two
    equal sides the mean of what the flown draws say of it and of its image, which has its lateral inputs with the other
    sign.
    """
    mine = acting(unknowns, name)
    moved, doubt = how(z[:, mine], by_bin=by_bin)
    if not scene.images:
        return moved, doubt
    side = np.array([-1.0 if unknown_kinds[unknowns[i].kind].lateral else 1.0 for i in mine])
    images = list(scene.images) if by_bin else how.cells.mirrored(scene.images)
    return 0.5 * (moved + how(side * z[:, mine], by_bin=by_bin)[0][:, images]), doubt


def joint_answer(
    scene: Scene,
    landings: Mapping[str, Landings],
    *,
    inputs: Changed | None = None,
    factors: Mapping[str, float] = NONE_MEET,
    sources: Sequence[ErrorSource] = (),
    salt: str = "",
) -> JointAnswer:
    """The joint answer of the ``landings`` by fraction, and what ``inputs`` change of it, with a factor for each
    fraction; ``sources``: of error beside; ``salt``: of this run alone.
    """
    names, feed = list(landings), scene.mass_shares()
    lots = [(landing.position, landing.bin) for landing in landings.values()]
    cells = LandingCells.of(scene, len(names), lots) if inputs is None else inputs.cells
    targets = {name: tuple(scene.fraction[name].targets) for name in names}
    base, parts = _base(scene, cells, landings), cells.parts()
    # As few digits as are kept in the run's folder: what is read there again says the same
    change, lack = np.zeros((DRAWS, len(names), cells.count), np.float16), np.zeros((DRAWS, *(base @ parts).shape))
    drawn: Mapping[str, FractionChange] = {} if inputs is None else inputs.of
    for number, name in enumerate(names if drawn else ()):
        effect = drawn[name]
        if not factors:  # the answer's granules, of which the draws have a part
            off, usual = base[number] - effect.before, base[number] @ parts
            able = less_at_ends((effect.before + effect.change) @ parts, usual * (1.0 - usual))[:, parts.argmax(axis=1)]
            change[:, number], lack[:, number] = effect.change + (able - 1.0) * off, np.float32(effect.lack)
        else:
            change[:, number], lack[:, number] = factors[name] * effect.change, np.float32(factors[name] * effect.lack)
    roots = np.zeros((*lack.shape[1:], 0))
    own_sources = () if inputs is None else (ErrorSource(LACK, roots, computing=False, given=lack),)
    keys, z = ((), np.zeros((DRAWS, 0))) if inputs is None else (inputs.keys, inputs.z)
    return JointAnswer(
        tuple(names), np.array([feed[name] for name in names]), targets, scene.feed.mass_flow, cells,
        scene.images or (), keys, z, base, change.astype(np.float32), (*own_sources, *sources), salt,
    )  # fmt: skip


def _base(scene: Scene, cells: LandingCells, landings: Mapping[str, Landings]) -> Array:
    """The answer's share (fractions, cells) in every cell: that of every bin, parted as the landings in it that are
    kept.
    """
    shares, parts = shares_in(scene, landings), cells.parts()
    base = np.zeros((len(landings), cells.count))
    for number, (name, landing) in enumerate(landings.items()):
        side, place = cells.along(scene, landing.position, landing.bin)
        cell = cells.at(side, place, cells.off_sides(landing.bin))
        mass = np.asarray(np.bincount(cell, landing.mass_shares, minlength=cells.count), dtype=float)
        if scene.images:
            mass = np.asarray(0.5 * (mass + mass[cells.mirrored(scene.images)]))
        inside = mass @ parts
        even = parts / np.maximum(parts.sum(axis=0), 1e-300)
        within = np.where(inside > 0.0, mass[:, None] * parts / np.where(inside > 0.0, inside, 1.0), even)
        base[number] = within @ shares[name]
    return base


def separate(scene: Scene, landings: Mapping[str, Landings]) -> Separation:
    """Shares, purity, recovery and throughput (kg/h) of every bin from the ``landings`` of each fraction, with the
    interval that the finite numbers of granules and of shedding cycles make.
    """
    return sampled(scene, landings).own.separation()


def sampled(scene: Scene, landings: Mapping[str, Landings]) -> JointAnswer:
    """The joint answer whose only errors are the finite numbers of granules and of shedding cycles."""
    errors = sample_errors(landings, len(scene.bin), scene.images or ())._asdict()
    return joint_answer(scene, landings, sources=[ErrorSource(*error, together=True) for error in errors.items()])
