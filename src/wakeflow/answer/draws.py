"""An ensemble of joint draws of all shares: what everything that is not known does to the answer, draw by draw.

Each of the DRAWS has its own value of everything that is not known: of every input, and of what every source of error
does to the shares. A draw of an input belongs to its key: it is the same one in every run, so that two runs are
compared draw by draw. What is read off the draws is in :mod:`.joint`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..core.lazy import cached_property
from ..core.record import columns as columns_of
from ..planning.unknowns import FARTHEST, SIGMAS
from ..scene.bins import SIDES
from .cells import LandingCells
from .shares import JointRecord, JointSource, Prices

Array = NDArray[np.float64]
DRAWS = 2048
LEVEL = 0.95  # of every interval
END = 1e-6  # of p (1 - p): that of a share which is nothing, or all
LEAST = 1e-12  # of a variance that is one
SAID = tuple(head.name for head in columns_of(JointSource))  # of a source in result.json
INPUTS, LACK, SAMPLING = "inputs", "lack of fit", "sampling"


# -- columns of independent numbers ------------------------------------------------------------------------------------
@lru_cache(maxsize=4096)
def column(key: str) -> Array:
    """DRAWS standard normal numbers that belong to a ``key``: one of each of as many equal parts of the distribution,
    in an order of its own (a Latin hypercube: McKay, Beckman & Conover 1979, Technometrics 21, 239).
    """
    from scipy.special import ndtri

    chance = np.random.default_rng([20110, *key.encode()])
    numbers: Array = ndtri((chance.permutation(DRAWS) + chance.random(DRAWS)) / DRAWS)
    numbers.setflags(write=False)
    return numbers


def columns(keys: Iterable[str]) -> Array:
    """Columns of several keys (DRAWS, keys), cut off where draws of inputs are."""
    drawn = [np.clip(column(key), -FARTHEST, FARTHEST) for key in keys]
    return np.stack(drawn, axis=1) if drawn else np.zeros((DRAWS, 0))


@dataclass(frozen=True)
class ErrorSource:
    """What one source of error does to the shares of all fractions: ``roots`` (fractions, bins + 1, rank) of their
    covariance, times numbers of each fraction's own, or where it moves all fractions ``together`` of all; or what is
    ``given`` (DRAWS, fractions, bins + 1) of each draw. ``shared``: the same draw in every run, not one of this run's.
    ``bounded``: nothing is known of it between two bounds. ``computing``: whether finer computing makes it smaller.
    """

    name: str
    roots: Array
    computing: bool = True
    bounded: bool = False
    shared: bool = False
    together: bool = False
    given: Array = field(default_factory=lambda: np.zeros(0))

    def draws(self, fractions: Sequence[str], salt: str) -> Array:
        """What it adds to every share (DRAWS, fractions, bins + 1)."""
        if self.given.size:
            return self.given
        errors = np.zeros((DRAWS, *self.roots.shape[:2]))
        for number, name in enumerate(fractions):
            root = self.roots[number]
            used = [i for i in range(root.shape[1]) if np.any(root[:, i])]
            whose = "" if self.shared else f"{salt}.{'' if self.together else name}"
            for i in used:
                errors[:, number] += column(f"{self.name}.{whose}.{i}")[:, None] * root[:, i]
            if self.bounded:
                errors[:, number] = _rectangular(errors[:, number], np.sqrt((root**2).sum(axis=1)))
        return errors


def _rectangular(z: Array, apart: Array) -> Array:
    """Normal numbers (n, bins + 1) of standard deviations ``apart`` (bins + 1,) as rectangular ones of the same."""
    from scipy.special import ndtr

    return np.asarray(np.sqrt(3.0) * apart * (2.0 * ndtr(z / np.where(apart > 0.0, apart, 1.0)) - 1.0))


def less_at_ends(shares: Array, usual: Array) -> Array:
    """The factor (..., bins + 1) on errors of ``shares`` (..., bins + 1) that are those of shares p with a ``usual``
    p (1 - p): what is nothing of a fraction, or all of it, can hardly be off. At most 1.
    """
    variance = np.clip(shares * (1.0 - shares), 0.0, None)
    return np.asarray(np.minimum(1.0, np.sqrt((variance + END) / (np.clip(usual, 0.0, None) + END))))


def tied_root(halves: Array) -> Array:
    """A root (bins + 1, bins + 1) of the covariance of errors of a fraction's shares, of which ``halves`` (bins + 1,)
    of 95 % intervals are known: what one bin has too much, the others lack, and each keeps its own variance.
    """
    variances = (halves / SIGMAS) ** 2
    if (total := float(variances.sum())) <= 0.0:
        return np.zeros((len(variances), len(variances)))
    block = np.diag(variances) - np.outer(variances, variances) / total
    left = np.diag(block)
    scale = np.sqrt(np.divide(variances, left, out=np.zeros_like(variances), where=left > LEAST * total))
    sizes, ways = np.linalg.eigh(block * np.outer(scale, scale))
    return np.asarray(ways * np.sqrt(np.clip(sizes, 0.0, None)))


# -- the ensemble ------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class JointDraws:
    """All shares of an answer, jointly: by fraction and cell what the answer is, ``base`` (fractions, cells), and what
    the inputs change in every draw, ``change`` (DRAWS, fractions, cells); ``z`` (DRAWS, keys) of the inputs, in
    standard deviations; what every other source adds, ``sources``. ``mass``: share of every fraction in the feed;
    ``targets`` of each; ``images`` of bins in a machine with two equal sides; ``salt``: of this run alone;
    ``prices``: of a scene that has some.
    """

    fractions: tuple[str, ...]
    mass: Array
    targets: Mapping[str, tuple[str, ...]]
    flow: float  # kg/s
    cells: LandingCells
    images: tuple[int, ...]
    keys: tuple[str, ...]
    z: Array
    base: Array
    change: NDArray[np.float32]
    sources: tuple[ErrorSource, ...] = ()
    salt: str = ""
    prices: Prices | None = None

    def record(self) -> JointRecord:
        """What result.json says of it."""
        sources = tuple(JointSource(**{key: getattr(source, key) for key in SAID}) for source in self.sources)
        ends = {name: (float(low), float(high)) for name, (low, high) in self.cells.ends.items()}
        return JointRecord(
            DRAWS, self.fractions, dict(self.targets), self.keys, self.cells.bins, dict(self.cells.on), ends,
            self.images, self.flow, sources, self.salt, self.prices,
        )  # fmt: skip

    def arrays(self) -> dict[str, Any]:
        """What joint.npz holds."""
        arrays = {"mass": self.mass, "z": self.z.astype(np.float32), "base": self.base,
                 "change": self.change.astype(np.float16)}  # fmt: skip
        arrays |= {f"edges.{side}": edges for side, edges in self.cells.edges.items()}
        for number, source in enumerate(self.sources):
            arrays[f"root.{number}"] = source.roots
            if source.given.size:
                arrays[f"given.{number}"] = source.given.astype(np.float32)
        return arrays

    @classmethod
    def of(cls, record: JointRecord, arrays: Mapping[str, Any]) -> Self:
        """What :meth:`record` and :meth:`arrays` told. Raises KeyError and ValueError where the two do not fit."""
        edges = {side: arrays[f"edges.{side}"] for side in dict.fromkeys(record.on.values())}
        edges = {side: edges[side] for side in SIDES if side in edges}
        cells = LandingCells(record.bins, record.on, record.ends, edges)
        sources = tuple(
            ErrorSource(**vars(source), roots=arrays[f"root.{i}"], given=_wide(arrays, f"given.{i}"))
            for i, source in enumerate(record.sources)
        )
        fractions, bins = len(record.fractions), len(record.bins) + 1
        shapes = {"mass": (fractions,), "z": (DRAWS, len(record.inputs)), "base": (fractions, cells.count),
                  "change": (DRAWS, fractions, cells.count)}  # fmt: skip
        for i, source in enumerate(sources):
            shapes[f"root.{i}"] = (fractions, bins, source.roots.shape[-1])
            if source.given.size:
                shapes[f"given.{i}"] = (DRAWS, fractions, bins)
        if not (
            set(record.ends) == set(record.on) <= set(record.bins)
            and sorted(record.images or range(bins)) == list(range(bins))
            and record.draws == DRAWS
            and set(arrays) == {*shapes, *(f"edges.{side}" for side in edges)}
            and all(arrays[name].shape == shape and np.isfinite(arrays[name]).all() for name, shape in shapes.items())
        ):
            raise ValueError("a record of other arrays")
        mass, z, base, change = (_wide(arrays, name) for name in ("mass", "z", "base", "change"))
        return cls(record.fractions, mass, record.targets, record.flow, cells, record.images, record.inputs, z,
                   base, np.asarray(change, dtype=np.float32), sources, record.salt, record.prices)  # fmt: skip

    @cached_property
    def errors(self) -> dict[str, Array]:
        """What every source adds to every share (DRAWS, fractions, bins + 1), by its name."""
        return {source.name: source.draws(self.fractions, self.salt) for source in self.sources}

    @property
    def computing(self) -> frozenset[str]:
        """The sources that finer computing makes smaller."""
        return frozenset(source.name for source in self.sources if source.computing)

    def acting(self, fraction: str) -> list[int]:
        """The places of the inputs that act on a fraction, without a name: on any."""
        return [i for i, key in enumerate(self.keys)
                if not fraction or not key.startswith("fraction.") or key.split(".")[1] == fraction]  # fmt: skip


def _wide(arrays: Mapping[str, Any], name: str) -> Any:
    """An array as double numbers; empty where there is none."""
    return np.asarray(arrays.get(name, ()), dtype=float)
