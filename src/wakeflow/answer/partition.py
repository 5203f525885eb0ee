"""Partition (Tromp) curves: of granules that are alike in size or in terminal velocity, the share in each product.

The curve is that of mineral processing and classifying (Tromp 1937, Gluckauf 73, 125; ISO 923). Granules of all
fractions are counted together, each with its share of the feed's mass; classes hold as many granules of every fraction,
so that a fraction of little mass has its points too.

Bands and cuts are read off the joint answer: in every draw the curve of each fraction is shifted, in the logit of the
share, until the fraction's whole share in the product is that of the draw; each class scatters beside by its few
granules, as its replicates show. That takes what is not known of a property for a shift of the cut by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number, student
from ..flight.stages.landings import Landings
from ..planning.plan import Plan
from ..planning.uniform_fall import settling_air, settling_velocities
from ..planning.unknowns import SIGMAS
from ..scene import RESERVED_BIN, Scene
from .draws import INPUTS, SAMPLING, column
from .joint import Bins, middle
from .shares import PartitionCurve
from .spread import wilson

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
CLASSES = 24  # of a curve, at most
ALIKE = 1.02  # a property whose largest value is within that factor of its smallest has no curve
GAP = 2.0  # between two classes: a cut in it is interpolated where nothing is
MAX_GRANULES = 2**16  # granules of a fraction that are looked at
SHIFTS = np.linspace(-20.0, 20.0, 801)  # of a fraction's curve, in the logit of its shares


class _Fed(NamedTuple):
    """Granules of all fractions: ``mass`` (n,) of the feed that each represents, ``bin`` (n,), its ``sample`` (n,):
    the number of its replicate, its ``fraction`` (n,), and ``by`` property its value (n,).
    """

    mass: Array
    bin: Numbers
    sample: Numbers
    fraction: Numbers
    by: dict[str, Array]


def partition_curves(
    scene: Scene, plan: Plan, landings: Mapping[str, Landings], answer: Bins | None = None
) -> tuple[PartitionCurve, ...]:
    """Curve of every product by size and by terminal velocity; none by a property that all granules share. Without the
    joint ``answer`` bands are of the finite number of granules alone.

    Products are the targets of the fractions; in a scene without targets every bin.
    """
    fed = _fed(scene, plan, landings)
    places = {name: i for i, name in enumerate(scene.bin)} | {RESERVED_BIN: -1}
    wanted = dict.fromkeys(fraction.targets for fraction in scene.fraction.values() if fraction.targets)
    products = list(wanted) or [(name,) for name in scene.bin]
    return tuple(
        _curve(fed, values, np.isin(fed.bin, [places[place] for place in product]), product, by, answer)
        for product in products
        for by, values in fed.by.items()
        if np.all(values > 0.0) and values.max() > ALIKE * values.min()  # nan compares false
    )


def _fed(scene: Scene, plan: Plan, landings: Mapping[str, Landings]) -> _Fed:
    """The granules that count, at most MAX_GRANULES of a fraction, evenly chosen from all replicates."""
    air = settling_air(scene)
    shares, parts = scene.mass_shares(), []
    by: dict[str, list[Array]] = {"size": [], "terminal velocity": []}
    for number, name in enumerate(landings):
        landing, fraction, how = landings[name], scene.fraction[name], plan.fractions[name]
        kept = slice(None, None, -(-len(landing.bin) // MAX_GRANULES) | 1)  # odd: an even part of a Sobol set
        mass, diameter = landing.mass_shares[kept], landing.diameter[kept].astype(float)
        by["size"].append(diameter)
        if landing.drag is not None:
            drag, density = landing.drag[kept].astype(float), fraction.properties.density
            falls = settling_velocities(diameter, density, drag, how.drag, fraction.roundness, air, scene.gravity)
            by["terminal velocity"].append(falls)
        columns = landing.bin[kept], landing.replicate[kept], np.full(len(mass), number)
        parts.append((shares[name] * mass / mass.sum(), *(column.astype(np.int64) for column in columns)))
    whole = [np.concatenate(column) for column in zip(*parts, strict=True)]
    by_property = {key: np.concatenate(values) for key, values in by.items() if len(values) == len(parts)}
    return _Fed(whole[0], whole[1], whole[2], whole[3], by_property)


def _curve(
    fed: _Fed, values: Array, inside: NDArray[np.bool_], product: tuple[str, ...], by: str, answer: Bins | None
) -> PartitionCurve:
    group = _classes(values, fed.fraction)
    count, samples, fractions = int(group.max()) + 1, int(fed.sample.max()) + 1, int(fed.fraction.max()) + 1

    def masses(weight: Array, of: Numbers, many: int) -> Array:
        """Masses by class, and by what ``of`` says."""
        return np.asarray(np.bincount(group * many + of, weight, count * many).reshape(count, many), dtype=float)

    whole, landed = masses(fed.mass, fed.sample, samples), masses(fed.mass * inside, fed.sample, samples)
    mass = whole.sum(axis=1)
    at, share = np.bincount(group, fed.mass * values, count) / mass, landed.sum(axis=1) / mass
    drawn = _scattered(share, whole, landed, np.bincount(group, minlength=count), f"{product}.{by}")
    if answer is not None:
        lots = [masses(part, fed.fraction, fractions) for part in (fed.mass, fed.mass * inside, np.ones_like(fed.mass))]
        drawn = drawn + _shifted(answer, product, *lots)
    drawn = np.clip(drawn, 0.0, 1.0)
    bands = [middle(drawn[..., i], float(share[i])) for i in range(count)]
    cut, ep, why = _cut(at, share, drawn, by)
    imperfection = None if ep is None or cut is None or not cut.value else ep / cut.value
    ends = {"low": [band.low for band in bands], "high": [band.high for band in bands]}
    table = {"at": at, "mass": mass, "share": share, **ends}
    numbers = {key: tuple(map(float, values)) for key, values in table.items()}
    return PartitionCurve(
        product, by, "m" if by == "size" else "m/s", **numbers, cut=cut, ep=ep, imperfection=imperfection, why=why
    )


def _classes(values: Array, fraction: Numbers) -> Numbers:
    """The class (n,) of each value: quantiles of all, every fraction counting alike; equal values stand together."""
    order = np.argsort(values, kind="stable")
    weight = 1.0 / np.bincount(fraction)[fraction[order]]
    rank = np.cumsum(weight) / weight.sum()
    edges = np.unique(values[order][np.searchsorted(rank, np.arange(1, CLASSES) / CLASSES)])
    return np.unique(np.searchsorted(edges, values, side="left"), return_inverse=True)[1].astype(np.int64)


def _scattered(share: Array, fed: Array, landed: Array, count: Numbers, key: str) -> Array:
    """Draws (1, DRAWS, k) of the shares (k,), ratios of means over the samples of the masses (k, R), which scatter by
    the finite number of granules; of a class that goes one way whole, by Wilson's interval for its ``count`` (k,).
    """
    samples = fed.shape[1]
    off = (landed - share[:, None] * fed) / fed.mean(axis=1, keepdims=True)
    half = student(max(samples - 1, 1)) * off.std(axis=1, ddof=1 if samples > 1 else 0) / np.sqrt(samples)
    z = np.stack([column(f"partition.{key}.{i}") for i in range(len(share))], axis=1)
    for i in np.flatnonzero((share <= 0.0) | (share >= 1.0)):
        low, high = wilson(round(share[i] * count[i]), int(count[i]))
        half[i] = high - low
        z[:, i] = np.abs(z[:, i]) * (1.0 if share[i] <= 0.0 else -1.0)
    return np.asarray(share + half / SIGMAS * z)[None]


def _shifted(answer: Bins, product: tuple[str, ...], mass: Array, landed: Array, count: Array) -> Array:
    """What the draws (copies, DRAWS, k) change of the share of every class: ``mass`` (k, fractions) of each fraction in
    it, what of that ``landed`` in the product, ``count`` of its granules.
    """
    from scipy.special import expit, logit

    every = frozenset({INPUTS, *(source.name for source in answer.joint.sources)}) - {SAMPLING}
    places = [answer.names.index(place) for place in product]
    change = (answer.tables(every) - answer.value)[..., places].sum(axis=-1)
    moved = np.zeros((*change.shape[:2], len(mass)))
    for number in range(mass.shape[1]):
        n, fed = count[:, number], mass[:, number]
        part = (np.divide(landed[:, number], fed, out=np.zeros_like(fed), where=fed > 0.0) * n + 0.5) / (n + 1.0)
        mean = expit(logit(part) + SHIFTS[:, None]) @ fed / fed.sum()
        shift = np.interp(part @ fed / fed.sum() + change[..., number], mean, SHIFTS)
        moved += (expit(logit(part) + shift[..., None]) - part) * fed / mass.sum(axis=1)
    return moved


def _cut(at: Array, share: Array, drawn: Array, by: str) -> tuple[Number | None, float | None, str]:
    """The cut with its interval, Ep, and why there is no cut or how far apart its neighbours are, of a curve at the
    values ``at`` (k,) with the draws (copies, DRAWS, k) of its shares (k,).
    """
    passes = _passes(at, share, 0.5)
    if len(passes) != 1:
        level = "less" if float(share.max()) < 0.5 else "more" if float(share.min()) > 0.5 else ""
        return None, None, f"{level} than a half of every class" if level else f"passes a half {len(passes)} times"
    cut = _drawn_cut(at, share, drawn, passes[0])
    quarters = [_passes(at, share, level) for level in (0.25, 0.75)]
    ep = 0.5 * abs(quarters[1][0] - quarters[0][0]) if all(len(passed) == 1 for passed in quarters) else None
    turn = int(np.flatnonzero((share[1:] >= 0.5) != (share[:-1] >= 0.5))[0])
    apart = at[turn + 1] > GAP * at[turn]
    scale, unit = (1e3, "mm") if by == "size" else (1.0, "m/s")
    between = f"no granules between {scale * at[turn]:.2g} and {scale * at[turn + 1]:.2g} {unit}"
    return cut, ep, between if apart else ""


def _drawn_cut(at: Array, share: Array, drawn: Array, cut: float) -> Number:
    """The cut with its interval: in a draw whose curve passes a half several times, their mean; beyond all classes
    where it never does, so that an end is not known where that is likely.
    """
    way = np.sign(share[-1] - share[0])
    turns = np.diff(drawn >= 0.5, axis=-1)
    never = np.where(way * (drawn[..., 0] - 0.5) < 0.0, at[-1], at[0])
    steps = np.where(turns, np.diff(drawn, axis=-1), 1.0)
    places = np.log(at[:-1]) + (0.5 - drawn[..., :-1]) / steps * np.diff(np.log(at))
    mean = np.where(turns, places, 0.0).sum(axis=-1) / np.maximum(turns.sum(axis=-1), 1)
    values = np.where(turns.any(axis=-1), np.exp(mean), never)
    ends = middle(values, cut)
    return Number(cut, ends.low if ends.low > at[0] else -np.inf, ends.high if ends.high < at[-1] else np.inf)


def _passes(at: Array, share: Array, level: float) -> list[float]:
    """Where a curve passes a level, linear in the logarithm of the property."""
    above = share >= level
    turns = np.flatnonzero(above[1:] != above[:-1])
    parts = (level - share[turns]) / (share[turns + 1] - share[turns])
    return [float(x) for x in np.exp(np.log(at[turns]) + parts * np.log(at[turns + 1] / at[turns]))]
