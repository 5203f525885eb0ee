"""What a granule is given at birth: random numbers, and what a draw of the unknowns changes."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...laws.restitution import Restitution
from ...planning.plan import REPLICATES, replicate_size
from ...scene.variation import GranuleVariation
from .. import Granules

# -- Random numbers of granules at birth -------------------------------------------------------------------------------
Array = NDArray[np.float64]
ROUND_OFF = 1e-12  # quantiles keep that far from 0 and 1, where a distribution may be infinite
PLACED = 5  # random numbers of a granule at most that say where, when and how large: dimensions of its Sobol set
REMEMBERED = 2**13  # of such numbers, of as many granules at most: 20 MB in all
EVERY = slice(None)  # granule of a replicate
TRAITS = 4  # and those of what else is its own: restitution, friction, terminal velocity, angle at its first impact


def samples(
    name: str,
    count: int,
    seed: int,
    replicates: Sequence[int] = range(REPLICATES),
    dimensions: int = 4,
    part: slice = EVERY,
) -> tuple[Array, NDArray[np.int64]]:
    """Scrambled Sobol points (n, dimensions) in the unit cube of some ``replicates``, and the one each belongs to; of
    each replicate all granules, or a ``part``.

    The stream depends on the fraction's own name and on the replicate, not on the other fractions.
    """
    rows = range(replicate_size(count))[part]
    make = _remembered if len(rows) <= REMEMBERED else _points
    parts = [make(name, rows, seed, replicate, dimensions) for replicate in replicates]
    return np.concatenate(parts), np.repeat(np.asarray(replicates), len(rows))


def traits_of(name: str, count: int, seed: int, replicates: Sequence[int], part: slice = EVERY) -> Array:
    """Points (n, TRAITS) in the unit cube for what each granule has of its own, beside the first of ``samples``.

    They are the next dimensions of a Sobol set of their own: where and when granules are released is the same with them
    and without, so that the effect of a spread is seen between the same granules.
    """
    rows = range(replicate_size(count))[part]
    return np.concatenate([_points(name, rows, seed, one, PLACED + TRAITS, 1)[:, PLACED:] for one in replicates])


def blows_of(name: str, count: int, seed: int, replicates: Sequence[int], part: slice = EVERY) -> Array:
    """Standard normal numbers (n,), by which a flake is turned at its first impact."""
    size, own = replicate_size(count), zlib.crc32(name.encode())
    streams = (np.random.default_rng([seed, own, one, 2]) for one in replicates)
    return np.concatenate([stream.standard_normal(size)[part] for stream in streams])


def _points(name: str, rows: range, seed: int, replicate: int, dimensions: int, *apart: int) -> Array:
    """The points ``rows`` of one set; ``apart`` tells sets of one fraction and replicate from each other."""
    from scipy.stats import qmc

    source = np.random.default_rng([seed, zlib.crc32(name.encode()), replicate, *apart])
    found = qmc.Sobol(dimensions, scramble=True, rng=source)
    if rows.start:
        found.fast_forward(rows.start)
    points = found.random(len(rows))
    return np.asarray(np.clip(points, ROUND_OFF, 1 - ROUND_OFF))


_remembered = lru_cache(maxsize=64)(_points)  # a search flies the same granules through many scenes


# -- Granules as a draw of what is unknown has them --------------------------------------------------------------------
MAX_SCATTER = 1.0  # rad, as the tracker takes it


def varied_granules(grains: Granules, variation: GranuleVariation) -> Granules:
    """``grains`` with the variation's shift and factors; what leaves the range of a quantity ends at it."""
    own = grains.restitution
    by_law, change = isinstance(own, Restitution), variation.restitution
    return grains.replace(
        diameter=grains.diameter * variation.size,
        density=grains.density * variation.density,
        restitution=own.shifted(change) if by_law else np.clip(own + change, 0.0, 1.0),
        friction=grains.friction * variation.friction,
        scatter=np.minimum(grains.scatter * variation.scatter, MAX_SCATTER),
        drag_scale=grains.drag_scale * variation.drag,
        inertia=grains.inertia / variation.inverse_inertia,
        spin_lift=grains.spin_lift * variation.spin_lift,
    )
