"""One answer, one interval: an ensemble of joint draws of all shares, and the one maker of every interval.

Each of the DRAWS has its own value of everything that is not known: of every input, and of what every source of error
does to the shares. A number is a function of the table of shares; its 95 % interval is the middle 95 % of that function
over the draws, so that a share, a recovery, a purity, a difference of two runs, a bin that was moved and what a tray
leaves agree with each other whatever bends and bounds there are. A draw of an input belongs to its key: it is the same
one in every run, so that two runs are compared draw by draw.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.lazy import cached_property
from ..core.number import Number
from ..planning.unknowns import FARTHEST, SIGMAS
from ..scene import RESERVED_BIN
from ..scene.machine import SIDES
from ..scene.uncertainty import EITHER_SIGN
from .cells import Ends, LandingCells
from .shares import InputPart, JointRecord, JointSource, Separation

Array = NDArray[np.float64]
Of = Callable[[Array], Array]  # a number of tables (..., fractions, bins + 1), elsewhere last
DRAWS = 2048
LEVEL = 0.95  # of every interval
PAIRED = 0.5  # of the error of few granules that is left in a change seen between the same ones. Chosen
BENT = 3  # order of the polynomial in an input that says what it does alone
MOST_TOLD = 64  # of more inputs than that
MOST_TOGETHER = 128  # inputs that are told apart by one regression; of more each is taken by itself
TIED = 0.15  # correlation of draws from which two inputs move together: of independent ones it is 0.02
LEAST = 1e-12  # of a variance that is one
HOUR = 3600.0  # s
PRODUCT = "product"  # a bin made of stretches of a side
INPUTS, LACK, SAMPLING = "inputs", "lack of fit", "sampling"


# -- columns of independent numbers ------------------------------------------------------------------------------------
@lru_cache(maxsize=4096)
def column(key: str) -> Array:
    """DRAWS standard normal numbers that belong to a ``key``: one of each of as many equal parts of the distribution,
    in an order of its own (a Latin hypercube: McKay, Beckman & Conover 1979, Technometrics 21, 239).
    """
    from scipy.special import ndtri

    chance = np.random.default_rng([20110, *key.encode()])
    found: Array = ndtri((chance.permutation(DRAWS) + chance.random(DRAWS)) / DRAWS)
    found.setflags(write=False)
    return found


def columns(keys: Iterable[str]) -> Array:
    """Those of several keys (DRAWS, keys), cut off where draws of inputs are."""
    found = [np.clip(column(key), -FARTHEST, FARTHEST) for key in keys]
    return np.stack(found, axis=1) if found else np.zeros((DRAWS, 0))


@dataclass(frozen=True)
class ErrorSource:
    """What one source of error does to the shares of all fractions: ``roots`` (fractions, bins + 1, rank) of their
    covariance, times numbers of each fraction's own, or where it moves all fractions ``together`` of all; ``scale``
    (DRAWS, fractions) of each draw, 1 where there is none. ``shared``: the same draw in every run, not one of this
    run's. ``bounded``: nothing is known of it between two bounds. ``computing``: whether finer computing makes it
    smaller.
    """

    name: str
    roots: Array
    computing: bool = True
    bounded: bool = False
    shared: bool = False
    together: bool = False
    scale: Array | None = None

    def draws(self, fractions: Sequence[str], salt: str) -> Array:
        """What it adds to every share (DRAWS, fractions, bins + 1)."""
        found = np.zeros((DRAWS, *self.roots.shape[:2]))
        for number, name in enumerate(fractions):
            root = self.roots[number]
            used = [i for i in range(root.shape[1]) if np.any(root[:, i])]
            own = "" if self.shared else f"{salt}.{'' if self.together else name}"
            for i in used:
                found[:, number] += column(f"{self.name}.{own}.{i}")[:, None] * root[:, i]
            if self.bounded:
                found[:, number] = _rectangular(found[:, number], np.sqrt((root**2).sum(axis=1)))
        return found if self.scale is None else found * self.scale[:, :, None]


def _rectangular(z: Array, apart: Array) -> Array:
    """Normal numbers (n, bins + 1) of standard deviations ``apart`` (bins + 1,) as rectangular ones of the same."""
    from scipy.special import ndtr

    return np.asarray(np.sqrt(3.0) * apart * (2.0 * ndtr(z / np.where(apart > 0.0, apart, 1.0)) - 1.0))


def tied_root(halves: Array) -> Array:
    """A root (bins + 1, bins + 1) of the covariance of errors of a fraction's shares, of which ``halves`` (bins + 1,)
    of 95 % intervals are known: what one bin has too much, the others lack, and each keeps its own variance.
    """
    own = (halves / SIGMAS) ** 2
    if (total := float(own.sum())) <= 0.0:
        return np.zeros((len(own), len(own)))
    block = np.diag(own) - np.outer(own, own) / total
    scale = np.sqrt(np.divide(own, np.diag(block), out=np.zeros_like(own), where=np.diag(block) > LEAST * total))
    sizes, ways = np.linalg.eigh(block * np.outer(scale, scale))
    return np.asarray(ways * np.sqrt(np.clip(sizes, 0.0, None)))


# -- the ensemble ------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class JointAnswer:
    """All shares of an answer, jointly: by fraction and cell what the answer is, ``base`` (fractions, cells), and what
    the inputs change in every draw, ``change`` (DRAWS, fractions, cells); ``z`` (DRAWS, keys) of the inputs, in
    standard deviations; what every other source adds, ``sources``. ``mass``: share of every fraction in the feed;
    ``targets`` of each; ``images`` of bins in a machine with two equal sides; ``salt``: of this run alone; ``weight``
    (DRAWS,) of every draw once something was measured.
    """

    fractions: tuple[str, ...]
    mass: Array
    targets: Mapping[str, tuple[str, ...]]
    flow: float  # kg/s
    cells: LandingCells
    images: tuple[int, ...] | None
    keys: tuple[str, ...]
    z: Array
    base: Array
    change: NDArray[np.float32]
    sources: tuple[ErrorSource, ...] = ()
    salt: str = ""
    weight: Array | None = None
    _read: dict[Any, Bins] = field(default_factory=dict, init=False, repr=False, compare=False)

    def record(self) -> JointRecord:
        """What result.json says of it."""
        sources = tuple(
            JointSource(one.name, one.computing, one.bounded, one.shared, one.together) for one in self.sources
        )
        ends = {name: (float(low), float(high)) for name, (low, high) in self.cells.ends.items()}
        return JointRecord(
            DRAWS, self.fractions, dict(self.targets), self.keys, self.cells.bins, dict(self.cells.on), ends,
            self.images, self.flow, sources, self.salt,
        )  # fmt: skip

    def arrays(self) -> dict[str, Any]:
        """What joint.npz holds."""
        found = {"mass": self.mass, "z": self.z.astype(np.float32), "base": self.base,
                 "change": self.change.astype(np.float16)}  # fmt: skip
        found |= {f"edges.{side}": edges for side, edges in self.cells.edges.items()}
        for number, one in enumerate(self.sources):
            found[f"root.{number}"] = one.roots
            if one.scale is not None:
                found[f"scale.{number}"] = one.scale.astype(np.float32)
        return found

    @classmethod
    def of(cls, record: JointRecord, arrays: Mapping[str, Any]) -> JointAnswer:
        """What :meth:`record` and :meth:`arrays` told. Raises KeyError and ValueError where the two do not fit."""
        edges = {side: arrays[f"edges.{side}"] for side in dict.fromkeys(record.on.values())}
        edges = {side: edges[side] for side in SIDES if side in edges}
        cells = LandingCells(record.bins, record.on, record.ends, edges)
        sources = tuple(
            ErrorSource(
                one.name,
                arrays[f"root.{i}"],
                one.computing,
                one.bounded,
                one.shared,
                one.together,
                _wide(arrays, f"scale.{i}"),
            )
            for i, one in enumerate(record.sources)
        )
        shapes = {"mass": (len(record.fractions),), "z": (record.draws, len(record.inputs)),
                  "base": (len(record.fractions), cells.count),
                  "change": (record.draws, len(record.fractions), cells.count)}  # fmt: skip
        bins = len(record.bins) + 1
        for i, one in enumerate(sources):
            shapes[f"root.{i}"] = (len(record.fractions), bins, one.roots.shape[-1])
            if one.scale is not None:
                shapes[f"scale.{i}"] = (record.draws, len(record.fractions))
        fits = set(record.ends) == set(record.on) <= set(record.bins) and set(arrays) == {*shapes, *(
            f"edges.{side}" for side in edges)}  # fmt: skip
        if not fits or (record.images is not None and sorted(record.images) != list(range(bins))):
            raise ValueError("a record of other arrays")
        if record.draws != DRAWS or any(arrays[name].shape != shape for name, shape in shapes.items()):
            raise ValueError("arrays of another shape")
        if not all(np.isfinite(arrays[name]).all() for name in shapes):
            raise ValueError("arrays that are no numbers")
        mass, z, base, change = (_wide(arrays, name) for name in ("mass", "z", "base", "change"))
        return cls(record.fractions, mass, record.targets, record.flow, cells, record.images, record.inputs, z, base,
                   np.asarray(change, dtype=np.float32), sources, record.salt)  # fmt: skip

    @property
    def own(self) -> Bins:
        """Its numbers in its own bins."""
        return self.moved({})

    def moved(self, ends: Ends) -> Bins:
        """Its numbers with some bins between other ``ends`` (m). Raises SceneError as :meth:`.LandingCells.moved`."""
        whole = self.cells.moved(ends)
        key = tuple(whole.items())
        if key not in self._read:
            if len(self._read) > 4:  # of a page on which somebody drags
                self._read.pop(next(iter(self._read)))
            self._read[key] = Bins(self, self.cells.parts(whole), (*self.cells.bins, RESERVED_BIN))
        return self._read[key]

    def between(self, side: str, stretches: Sequence[tuple[float, float]]) -> Bins | None:
        """Its numbers in the bin PRODUCT, all that lands between the ends (m) of some ``stretches`` of a side; None of
        one that has no bins, whose landings are not told apart.
        """
        inside = self.cells.along_side(side, stretches)
        return None if inside is None else Bins(self, np.stack([inside, 1.0 - inside], axis=1), (PRODUCT, RESERVED_BIN))

    @cached_property
    def errors(self) -> dict[str, Array]:
        """What every source adds to every share (DRAWS, fractions, bins + 1), by its name."""
        return {one.name: one.draws(self.fractions, self.salt) for one in self.sources}

    @property
    def computing(self) -> frozenset[str]:
        """The sources that finer computing makes smaller."""
        return frozenset(one.name for one in self.sources if one.computing)

    def acting(self, fraction: str | None) -> list[int]:
        """The places of the inputs that act on a fraction, None: on any."""
        return [i for i, key in enumerate(self.keys) if fraction is None or _owner(key) in (None, fraction)]


def _owner(key: str) -> str | None:
    return key.split(".")[1] if key.startswith("fraction.") else None


@dataclass(frozen=True)
class Bins:
    """A joint answer read in bins: ``parts`` (cells, bins + 1) of every cell that are in each; their ``names``."""

    joint: JointAnswer
    parts: Array
    names: tuple[str, ...]
    _tables: dict[Any, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def value(self) -> Array:
        """The answer's shares (fractions, bins + 1); a bin and its image have one."""
        found, images = np.asarray(self.joint.base @ self.parts), self.joint.images
        found[np.abs(found - 1.0) < LEAST] = 1.0  # sums of cells
        if images is None or self.parts.shape[1] != len(images):
            return found
        turned = self.parts[self.joint.cells.mirrored(images)]
        alike = np.array_equal(turned, self.parts[:, list(images)])
        return 0.5 * (found + found[:, list(images)]) if alike else found

    @cached_property
    def _passed(self) -> Array:
        """Of what each source adds to a bin of the run, the part (fractions, bins + 1, bins + 1) that is in each bin
        here: as the mass in the run's bin is; where that is empty, as its cells are.
        """
        own = self.joint.cells.parts()
        mass = self.joint.base[:, :, None] * own
        total = mass.sum(axis=1)
        even = np.broadcast_to(own / np.maximum(own.sum(axis=0), LEAST), mass.shape)
        within = np.where(total[:, None] > LEAST, mass / np.maximum(total[:, None], LEAST), even)
        return np.asarray(np.einsum("fcb,cd->fbd", within, self.parts))

    def tables(self, used: frozenset[str] | None = None) -> Array:
        """The shares of every draw (copies, DRAWS, fractions, bins + 1): by all that is not known, or by what is
        ``used`` alone (INPUTS, names of sources). Copies: one, or the machine and its mirror image.
        """
        every = frozenset({INPUTS, *(one.name for one in self.joint.sources)})
        asked = every if used is None else used & every
        if asked not in self._tables:
            if len(self._tables) > 3:
                self._tables.pop(next(iter(self._tables)))
            self._tables[asked] = self._made(asked)
        return self._tables[asked]

    def _made(self, used: frozenset[str]) -> Array:
        joint = self.joint
        own = [self._drawn(self.parts, None, used)]
        if joint.images is not None:
            images = list(joint.images)
            turned = self.parts[joint.cells.mirrored(images)]
            alike = self.parts.shape[1] == len(images) and np.array_equal(turned, self.parts[:, images])
            own.append(own[0][..., images] if alike else self._drawn(turned, images, used))
        return np.stack(own)

    def _drawn(self, parts: Array, images: Sequence[int] | None, used: frozenset[str]) -> Array:
        """The shares (DRAWS, fractions, bins + 1) in ``parts`` of the cells, of a machine or its image."""
        joint = self.joint
        found = np.broadcast_to(joint.base @ parts, (DRAWS, len(joint.fractions), parts.shape[1])).copy()
        if INPUTS in used:
            found += joint.change @ parts.astype(np.float32)
        sources = [one for one in joint.sources if one.name in used]
        free = [joint.errors[one.name] for one in sources if not one.bounded]
        if free:
            found += self._passed_on(sum(free, np.zeros(free[0].shape)), images)
        bounded(found, self.value)
        within = [one for one in sources if one.bounded]
        if within:
            most = sum(((one.roots**2).sum(axis=2) for one in within), np.zeros(within[0].roots.shape[:2]))
            moved = sum((joint.errors[one.name] for one in within), np.zeros(free[0].shape if free else ()))
            settle(found, self._passed_on(moved, images), self._passed_on(most[None], images)[0])
        return found

    def _passed_on(self, errors: Array, images: Sequence[int] | None) -> Array:
        """What is added to the bins of the run (n, fractions, bins + 1), in the bins here."""
        mine = errors if images is None else errors[:, :, list(images)]
        return np.asarray(np.einsum("nfb,fbd->nfd", mine, self._passed))

    # -- numbers -------------------------------------------------------------------------------------------------------
    def values(self, of: Of, used: frozenset[str] | None = None) -> Array:
        """A number in every draw (copies, DRAWS); the answer's own where the draw has none, as of an empty bin."""
        found = of(self.tables(used))
        return np.where(np.isfinite(found), found, of(self.value))

    def number(self, of: Of, *, value: float | None = None, bounds: tuple[float, float] | None = (0.0, 1.0)) -> Number:
        """A function ``of`` tables with its 95 % interval: the one maker of intervals. ``value``: where it is known
        better than from the cells.
        """
        own = float(of(self.value)) if value is None else value
        found = middle(self.values(of), own, self.joint.weight, bounds)
        computed = middle(self.values(of, self.joint.computing), own, None, bounds)
        return replace(found, numerical=computed.half if self.joint.computing else None)

    def share(self, fraction: str, place: str, value: float | None = None) -> Number:
        """Share of a fraction in a bin."""
        return self.number(self.of_share(fraction, [place]), value=value)

    def of_share(self, fraction: str, places: Collection[str]) -> Of:
        """The share of a fraction in any of ``places``."""
        return partial(_share, self.joint.fractions.index(fraction), [self.names.index(one) for one in places])

    def of_purity(self, place: str, fraction: str) -> Of:
        """The share of a bin's mass that is of a fraction."""
        return partial(_purity, self.joint.mass, self.joint.fractions.index(fraction), self.names.index(place))

    def separation(self) -> Separation:
        """Every number with its interval, and the throughput (kg/h) of every bin."""
        joint, places = self.joint, self.names
        held = {place: float((joint.mass * self.value[:, i]).sum()) for i, place in enumerate(places)}
        return Separation(
            tuple(places),
            {name: {place: self.share(name, place) for place in places} for name in joint.fractions},
            {place: {name: self.number(self.of_purity(place, name)) for name in joint.fractions} if held[place] > 0.0
             else None for place in places},
            {name: self.number(self.of_share(name, joint.targets[name])) if joint.targets[name] else None
             for name in joint.fractions},
            {place: HOUR * joint.flow * mass for place, mass in held.items()},
        )  # fmt: skip

    def of_name(self, name: str) -> Of | None:
        """The number called share.FRACTION.BIN, purity.BIN.FRACTION, recovery.FRACTION or throughput.BIN (kg/h); None
        of another.
        """
        kind, *rest = name.split(".")
        fraction = rest[1] if kind == "purity" and len(rest) == 2 else rest[0] if rest else ""
        place = rest[0] if kind in ("purity", "throughput") and rest else rest[1] if len(rest) == 2 else None
        known = place in self.names if kind in ("purity", "throughput", "share") else True
        if not known or (kind != "throughput" and fraction not in self.joint.fractions):
            return None
        if kind == "share":
            return self.of_share(fraction, [str(place)])
        if kind == "purity":
            return self.of_purity(str(place), fraction)
        if kind == "throughput":
            return partial(_throughput, HOUR * self.joint.flow * self.joint.mass, self.names.index(str(place)))
        targets = self.joint.targets.get(fraction) or ()
        return self.of_share(fraction, targets) if kind == "recovery" and targets else None

    # -- what inputs do ------------------------------------------------------------------------------------------------
    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        """The regressors of all inputs together (DRAWS, keys + 1), and their pseudo-inverse."""
        design = np.column_stack([np.ones(DRAWS), self.joint.z])
        return design, np.linalg.pinv(design)

    @cached_property
    def _tied(self) -> NDArray[np.bool_]:
        """Which inputs (keys, keys) move together; each with itself."""
        if len(self.joint.keys) < 2:
            return np.ones((len(self.joint.keys),) * 2, dtype=bool)
        return np.abs(np.corrcoef(self.joint.z.T)) > TIED

    def alone(self, of: Of, key: str, values: Array | None = None) -> Callable[[Array], Array]:
        """What an input does to a number at z (n,) standard deviations, about 0 at z = 0: a polynomial through the
        draws, once all that goes with the inputs that are independent of it in a straight line is taken off them.
        """
        y = (self.values(of, frozenset({INPUTS})) if values is None else values)[0]
        place = self.joint.keys.index(key)
        z = self.joint.z[:, place]
        if len(self.joint.keys) <= MOST_TOGETHER:
            design, inverse = self._lines
            line = inverse @ y
            line[1:][self._tied[place]] = 0.0
            y = y - design[:, 1:] @ line[1:]
        powers = np.stack([z**order for order in range(BENT + 1)], axis=1)
        found, *_ = np.linalg.lstsq(powers, y, rcond=None)
        return lambda at: np.asarray(sum(found[order] * at**order for order in range(1, BENT + 1)))

    def effects(self, of: Of, fraction: str | None = None) -> dict[str, InputPart]:
        """What each input alone does to a number of a ``fraction`` (None: of all), the largest first."""
        values = self.values(of, frozenset({INPUTS}))
        keys = [self.joint.keys[i] for i in self.joint.acting(fraction)]
        lack, sampled = (float(self.values(of, frozenset({name})).var()) for name in (LACK, SAMPLING))
        variance, doubt = float(values.var()), lack / max(1, len(keys)) + PAIRED**2 * sampled
        if variance < LEAST or not keys:
            return {}
        found = {}
        if len(keys) > MOST_TOGETHER:  # those that a straight line finds first
            towards = np.abs(self.joint.z.T @ (values[0] - values[0].mean()))
            keys = sorted(keys, key=lambda key: -towards[self.joint.keys.index(key)])[:MOST_TOLD]
        for key in keys:
            does = self.alone(of, key, values)
            low, high = (float(does(np.array(side * SIGMAS))) for side in (-1.0, 1.0))
            half, part = 0.5 * (high - low), float(does(self.joint.z[:, self.joint.keys.index(key)]).var())
            index, error = min(1.0, part / variance), SIGMAS * np.sqrt(doubt)
            apart = 2.0 * error * index / max(abs(half), error, LEAST)
            found[key] = InputPart(abs(half), index, float(apart), half)
        return dict(sorted(found.items(), key=lambda one: -one[1].variance))

    def known_better(self, of: Of, parts: Mapping[str, float], value: float | None = None) -> Number:
        """A number once the inputs in ``parts`` are known to that part of the interval that they have now, each still
        where it is expected: what they do alone shrinks, all else stays. Never less than computing adds, nor more than
        is unknown now.
        """
        own = float(of(self.value)) if value is None else value
        inputs, values = self.values(of, frozenset({INPUTS})), self.values(of)
        now, computed = (middle(one, own, None, (0.0, 1.0)) for one in (values, self.values(of, self.joint.computing)))
        for key, part in parts.items():
            z, does = self.joint.z[:, self.joint.keys.index(key)], self.alone(of, key, inputs)
            for copy, side in enumerate((1.0, -1.0 if key in EITHER_SIGN else 1.0)[: len(values)]):
                less = does(part * side * z) - does(side * z)
                values[copy], inputs[copy] = values[copy] + less, inputs[copy] + less
        found = middle(values, own, self.joint.weight, (0.0, 1.0))
        low, high = max(found.low, now.low), min(found.high, now.high)
        return Number(own, min(low, computed.low), max(high, computed.high))


def _wide(arrays: Mapping[str, Any], name: str) -> Any:
    """An array as double numbers; None where there is none."""
    return np.asarray(arrays[name], dtype=float) if name in arrays else None


def bounded(shares: Array, own: Array | None = None) -> Array:
    """Shares (..., fractions, bins + 1) that are none below 0 and sum to 1, in place; the answer's ``own`` (fractions,
    bins + 1) where errors leave nothing of a fraction.
    """
    np.clip(shares, 0.0, None, out=shares)
    total = shares.sum(axis=-1, keepdims=True)
    np.divide(shares, total, out=shares, where=total > 0.0)
    if own is not None:
        np.copyto(shares, own, where=total <= 0.0)
    return shares


def settle(shares: Array, errors: Array, most: Array) -> None:
    """Add ``errors`` (n, fractions, bins + 1) of which only bounds are known to shares of the same shape, in place. The
    bin that gains most gains all of it, and the others share what is left as they would; what cannot be off (``most``
    (fractions, bins + 1) is 0 there) stays.
    """
    free = np.broadcast_to(most > 0.0, shares.shape)
    total = np.where(free, shares, 0.0).sum(axis=-1, keepdims=True)
    aimed = np.where(free, np.clip(shares + errors, 0.0, None), 0.0)
    first = np.argmax(np.where(free, errors, -np.inf), axis=-1)[..., None]
    gains = np.minimum(np.take_along_axis(aimed, first, axis=-1), total)
    np.put_along_axis(aimed, first, 0.0, axis=-1)
    others = aimed.sum(axis=-1, keepdims=True)
    aimed *= np.divide(total - gains, others, out=np.zeros_like(others), where=others > 0.0)
    np.put_along_axis(aimed, first, np.where(others > 0.0, gains, total), axis=-1)
    np.copyto(shares, aimed, where=free)
    bounded(shares)


def middle(values: Array, own: float, weight: Array | None = None, bounds: tuple[float, float] | None = None) -> Number:
    """A number with the middle 95 % of its ``values`` (copies, DRAWS), of the mean of the copies' ends."""
    level = 0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)
    ends = np.mean([quantiles(one, level, weight) for one in np.atleast_2d(values)], axis=0)
    low, high = min(float(ends[0]), own), max(float(ends[1]), own)
    if bounds is not None:
        low, high = max(low, min(bounds[0], own)), min(high, max(bounds[1], own))
    return Number(own, low, high)


def quantiles(values: Array, levels: Sequence[float], weight: Array | None = None) -> Array:
    """Quantiles of ``values`` (n,), each of a ``weight`` (n,)."""
    if weight is None:
        return np.asarray(np.quantile(values, levels))
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.asarray(np.interp(np.asarray(levels) * weight.sum(), reached, values[order]))


def difference(one: Bins, other: Bins, name: str) -> Number | None:
    """The number called ``name`` of ``one`` answer less that of the ``other``: the same draw of every input that both
    have, and of what else is common to both; None where either has no such number.
    """
    ofs = one.of_name(name), other.of_name(name)
    if ofs[0] is None or ofs[1] is None:
        return None
    values = one.values(ofs[0]) - other.values(ofs[1])
    return middle(values, float(ofs[0](one.value) - ofs[1](other.value)))


def _share(fraction: int, places: Sequence[int], table: Array) -> Array:
    return np.asarray(table[..., fraction, list(places)].sum(axis=-1))


def _purity(mass: Array, fraction: int, place: int, table: Array) -> Array:
    here = mass * table[..., place]
    total = here.sum(axis=-1)
    empty = np.full(np.shape(total), np.nan)
    return np.asarray(np.divide(here[..., fraction], total, out=empty, where=total > 0.0))


def _throughput(flow: Array, place: int, table: Array) -> Array:
    return np.asarray((flow * table[..., place]).sum(axis=-1))
