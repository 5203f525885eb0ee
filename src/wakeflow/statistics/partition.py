"""Partition (Tromp) curves: of granules that are alike in size or in terminal velocity, the share in each product.

The curve is that of mineral processing and classifying (Tromp 1937, Gluckauf 73, 125; ISO 923). Granules of all
fractions are counted together, each with its share of the feed's mass; classes hold as many granules of every fraction,
so that a fraction of little mass has its points too. A band is the 95 % interval by the finite number of granules,
from their replicates; shedding cycles, and what the scene does not say exactly, are not in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..answer.shares import PartitionCurve
from ..core.number import Number, student
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_laws
from ..pipeline.landings import Landings
from ..planning.plan import Plan
from ..scene import RESERVED_BIN, Scene
from .spread import wilson

Array = NDArray[np.float64]
CLASSES = 24  # of a curve, at most
ALIKE = 1.02  # a property whose largest value is within that factor of its smallest has no curve
GAP = 2.0  # between two classes: a cut in it is interpolated where nothing is
MAX_GRANULES = 2**16  # granules of a fraction that are looked at
REYNOLDS = np.geomspace(1e-9, 1e8, 4096)  # of the table of terminal velocities; its error is below 1e-5


class _Fed(NamedTuple):
    """Granules of all fractions: ``mass`` (n,) of the feed that each represents, ``bin`` (n,), its ``sample`` (n,):
    the number of its replicate, its ``fraction`` (n,), and ``by`` property its value (n,).
    """

    mass: Array
    bin: NDArray[np.int64]
    sample: NDArray[np.int64]
    fraction: NDArray[np.int64]
    by: dict[str, Array]


def settling_velocities(
    diameter: Array, density: float, drag: Array, law: str, sphericity: float, air: tuple[float, float]
) -> Array:
    """Terminal velocities (n,) m/s of granules of ``diameter`` (n,) m with the factors ``drag`` (n,) on their drag
    ``law``, in ``air`` of a density (kg/m3) and a viscosity (Pa s); nan of what does not sink.

    The same root as :func:`wakeflow.laws.drag.terminal_velocity`, from a table of f(Re) Re, for very many granules.
    """
    rho, mu = air
    table = np.log(drag_laws[law].factor(REYNOLDS, np.full(REYNOLDS.shape, sphericity)) * REYNOLDS)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.log(rho * (density - rho) * GRAVITY * diameter**3 / (18.0 * mu**2 * drag))
    return np.asarray(np.exp(np.interp(weight, table, np.log(REYNOLDS))) * mu / (rho * diameter))


def partition_curves(scene: Scene, plan: Plan, landings: Mapping[str, Landings]) -> tuple[PartitionCurve, ...]:
    """Of every product the curve by size and by terminal velocity; none by a property that all granules share.

    Products are the targets of the fractions; in a scene without targets every bin.
    """
    fed = _fed(scene, plan, landings)
    places = {name: i for i, name in enumerate(scene.bin)} | {RESERVED_BIN: -1}
    wanted = dict.fromkeys(fraction.targets for fraction in scene.fraction.values() if fraction.targets)
    products = list(wanted) or [(name,) for name in scene.bin]
    return tuple(curve for product in products for curve in _curves(fed, product, [places[one] for one in product]))


def _fed(scene: Scene, plan: Plan, landings: Mapping[str, Landings]) -> _Fed:
    """The granules that count, at most MAX_GRANULES of a fraction, evenly chosen from all replicates."""
    air = STANDARD_AIR if scene.air is None else (scene.air.density, scene.air.viscosity)
    shares, parts = scene.mass_shares(), []
    by: dict[str, list[Array]] = {"size": [], "terminal velocity": []}
    for number, name in enumerate(landings):
        landing, fraction, how = landings[name], scene.fraction[name], plan.fractions[name]
        kept = slice(None, None, -(-len(landing.bin) // MAX_GRANULES) | 1)  # odd: an even part of a Sobol set
        mass, diameter = landing.mass_shares[kept], landing.diameter[kept].astype(float)
        by["size"].append(diameter)
        if landing.drag is not None:
            drag, density = landing.drag[kept].astype(float), fraction.properties.density
            shape = fraction.sphericity or 1.0
            by["terminal velocity"].append(settling_velocities(diameter, density, drag, how.drag, shape, air))
        columns = landing.bin[kept], landing.replicate[kept], np.full(len(mass), number)
        parts.append((shares[name] * mass / mass.sum(), *(column.astype(np.int64) for column in columns)))
    whole = [np.concatenate(column) for column in zip(*parts, strict=True)]
    found = {key: np.concatenate(values) for key, values in by.items() if len(values) == len(parts)}
    return _Fed(whole[0], whole[1], whole[2], whole[3], found)


def _curves(fed: _Fed, product: tuple[str, ...], places: list[int]) -> Iterator[PartitionCurve]:
    inside = np.isin(fed.bin, places)
    for by, values in fed.by.items():
        if np.all(values > 0.0) and values.max() > ALIKE * values.min():  # nan compares false
            yield _curve(fed, values, inside, product, by)


def _curve(fed: _Fed, values: Array, inside: NDArray[np.bool_], product: tuple[str, ...], by: str) -> PartitionCurve:
    group = _classes(values, fed.fraction)
    count, samples = int(group.max()) + 1, int(fed.sample.max()) + 1
    cell = group * samples + fed.sample

    def masses(weight: Array) -> Array:
        return np.asarray(np.bincount(cell, weight, count * samples).reshape(count, samples), dtype=float)

    whole, landed = masses(fed.mass), masses(fed.mass * inside)
    mass = whole.sum(axis=1)
    at = np.bincount(group, fed.mass * values, count) / mass
    curve = _shares(whole, landed, np.bincount(group, minlength=count))
    cut, ep, why = _cut(at, *curve, by)
    return PartitionCurve(
        product=product,
        by=by,
        unit="m" if by == "size" else "m/s",
        at=tuple(at.tolist()),
        mass=tuple(mass.tolist()),
        share=tuple(curve[0].tolist()),
        low=tuple(curve[1].tolist()),
        high=tuple(curve[2].tolist()),
        cut=cut,
        ep=ep,
        imperfection=None if ep is None or cut is None or not cut.value else ep / cut.value,
        why=why,
    )


def _classes(values: Array, fraction: NDArray[np.int64]) -> NDArray[np.int64]:
    """The class (n,) of each value: quantiles of all, every fraction counting alike; equal values stand together."""
    order = np.argsort(values, kind="stable")
    weight = 1.0 / np.bincount(fraction)[fraction[order]]
    rank = np.cumsum(weight) / weight.sum()
    edges = np.unique(values[order][np.searchsorted(rank, np.arange(1, CLASSES) / CLASSES)])
    return np.unique(np.searchsorted(edges, values, side="left"), return_inverse=True)[1].astype(np.int64)


def _shares(fed: Array, landed: Array, count: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Ratio of means over the samples, from masses (k, R) of every class and sample, with its 95 % interval; of a class
    that goes one way whole, Wilson's for its ``count`` (k,) of granules.
    """
    share = landed.sum(axis=1) / fed.sum(axis=1)
    samples = fed.shape[1]
    off = (landed - share[:, None] * fed) / fed.mean(axis=1, keepdims=True)
    half = student(max(samples - 1, 1)) * off.std(axis=1, ddof=1 if samples > 1 else 0) / np.sqrt(samples)
    low, high = np.clip(share - half, 0.0, 1.0), np.clip(share + half, 0.0, 1.0)
    for i in np.flatnonzero((share <= 0.0) | (share >= 1.0)):
        low[i], high[i] = wilson(round(share[i] * count[i]), int(count[i]))
    return share, low, high


def _cut(at: Array, share: Array, low: Array, high: Array, by: str) -> tuple[Number | None, float | None, str | None]:
    """The cut with its interval, Ep, and why there is no cut or how far apart its neighbours are."""
    found = _passes(at, share, 0.5)
    if len(found) != 1:
        level = "less" if float(share.max()) < 0.5 else "more" if float(share.min()) > 0.5 else None
        told = f"passes a half {len(found)} times" if level is None else f"{level} than a half of every class"
        return None, None, told
    ends = sorted(x for band in (low, high) for x in _passes(at, band, 0.5))
    known = len(_passes(at, low, 0.5)) == 1 and len(_passes(at, high, 0.5)) == 1
    cut = Number(found[0], ends[0], ends[-1]) if known else Number(found[0])
    quarters = [_passes(at, share, level) for level in (0.25, 0.75)]
    ep = 0.5 * abs(quarters[1][0] - quarters[0][0]) if all(len(one) == 1 for one in quarters) else None
    turn = int(np.flatnonzero((share[1:] >= 0.5) != (share[:-1] >= 0.5))[0])
    apart = at[turn + 1] > GAP * at[turn]
    scale, unit = (1e3, "mm") if by == "size" else (1.0, "m/s")
    between = f"no granules between {scale * at[turn]:.2g} and {scale * at[turn + 1]:.2g} {unit}"
    return cut, ep, between if apart else None


def _passes(at: Array, share: Array, level: float) -> list[float]:
    """Where a curve passes a level, linear in the logarithm of the property."""
    above = share >= level
    turns = np.flatnonzero(above[1:] != above[:-1])
    parts = (level - share[turns]) / (share[turns + 1] - share[turns])
    return [float(x) for x in np.exp(np.log(at[turns]) + parts * np.log(at[turns + 1] / at[turns]))]
