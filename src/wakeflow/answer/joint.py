"""One answer, one interval: what is read off the joint draws of all shares (:mod:`.draws`), in whatever bins.

A number is a function of the table of shares; its 95 % interval is the middle 95 % of that function over the draws, so
that a share, a recovery, a purity, a difference of two runs, a bin that was moved and what a tray leaves agree with
each other whatever bends and bounds there are.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, isnan, nan
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.lazy import cached_property
from ..core.number import Number
from ..planning.unknowns import SIGMAS
from ..scene import RESERVED_BIN
from ..scene.uncertainty import EITHER_SIGN
from .cells import Ends
from .draws import DRAWS, INPUTS, LACK, LEAST, LEVEL, SAMPLING, JointDraws, less_at_ends
from .shares import InputPart, Money, Separation

Array = NDArray[np.float64]
Made = TypeVar("Made")
Of = Callable[[Array], Array]  # a number of tables (..., fractions, bins + 1), elsewhere last
PAIRED = 0.5  # of the error of few granules that is left in a change seen between the same ones. Chosen
BENT = 3  # order of the polynomial in an input that says what it does alone
MOST_TOLD = 64  # of more inputs than that
MOST_TOGETHER = 128  # inputs that are told apart by one set of lines; of more each is taken by itself
TIED = 0.15  # correlation of draws from which two inputs move together: of independent ones it is 0.02
HOUR = 3600.0  # s
TONNE = 1e3  # kg
Parts = dict[str, InputPart]  # what each input does to a number
Bounds = tuple[float, float]
WHOLE: Bounds = (0.0, 1.0)  # what a share is between
ANY: Bounds = (-inf, inf)
EVERYTHING = frozenset({"everything that is not known"})  # inputs and sources
PRODUCT = "product"  # a bin made of stretches of a side


@dataclass(frozen=True)
class JointAnswer(JointDraws):
    """The draws of an answer, and its numbers in its own bins or in others."""

    _read: dict[Any, Bins] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def own(self) -> Bins:
        """Numbers of the answer in its own bins."""
        return self.moved({})

    def moved(self, ends: Ends) -> Bins:
        """Numbers with some bins between other ``ends`` (m). Raises SceneError as :meth:`.LandingCells.moved`."""
        whole = self.cells.moved(ends)
        names = (*self.cells.bins, RESERVED_BIN)
        return _lately(self._read, tuple(whole.items()), 5, lambda: Bins(self, self.cells.parts(whole), names))

    def between(self, side: str, stretches: Sequence[tuple[float, float]]) -> Bins:
        """Numbers of the answer in the bin PRODUCT, all that lands between the ends (m) of some ``stretches`` of a side
        that has bins: landings on others are not told apart.
        """
        inside = self.cells.along_side(side, stretches)
        return Bins(self, np.stack([inside, 1.0 - inside], axis=1), (PRODUCT, RESERVED_BIN))


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
        shares = np.asarray(self.joint.base @ self.parts)
        shares[np.abs(shares - 1.0) < LEAST] = 1.0  # sums of cells
        return 0.5 * (shares + shares[:, list(self.joint.images)]) if self._alike else shares

    @cached_property
    def _turned(self) -> Array:
        """The parts in the mirror image of a machine that has one."""
        return self.parts[self.joint.cells.mirrored(self.joint.images)]

    @cached_property
    def _alike(self) -> bool:
        """Whether each bin is in the mirror image where its own image is here."""
        images = list(self.joint.images)
        return self.parts.shape[1] == len(images) and np.array_equal(self._turned, self.parts[:, images])

    @cached_property
    def _passed(self) -> Array:
        """Part (fractions, bins + 1, bins + 1) of what each source adds to a bin of the run that is in each bin here:
        as the mass in the run's bin is; where that is empty, as its cells are.
        """
        run_parts = self.joint.cells.parts()
        mass = self.joint.base[:, :, None] * run_parts
        total = mass.sum(axis=1)
        even = np.broadcast_to(run_parts / np.maximum(run_parts.sum(axis=0), LEAST), mass.shape)
        within = np.where(total[:, None] > LEAST, mass / np.maximum(total[:, None], LEAST), even)
        return np.asarray(np.einsum("fcb,cd->fbd", within, self.parts))

    def tables(self, used: frozenset[str] = EVERYTHING) -> Array:
        """The shares of every draw (copies, DRAWS, fractions, bins + 1): by all that is not known, or by what is
        ``used`` alone (INPUTS, names of sources). Copies: one, or the machine and its mirror image.
        """
        every = frozenset({INPUTS, *(source.name for source in self.joint.sources)})
        acting = every if used is EVERYTHING else used & every
        return _lately(self._tables, acting, 4, lambda: self._made(acting))

    def _made(self, used: frozenset[str]) -> Array:
        tables, images = [self._drawn(self.parts, slice(None), used)], list(self.joint.images)
        if images:
            tables.append(tables[0][..., images] if self._alike else self._drawn(self._turned, images, used))
        return np.stack(tables)

    def _drawn(self, parts: Array, images: list[int] | slice, used: frozenset[str]) -> Array:
        """The shares (DRAWS, fractions, bins + 1) in ``parts`` of the cells, of a machine or its image."""
        joint = self.joint
        shares = np.broadcast_to(joint.base @ parts, (DRAWS, len(joint.fractions), parts.shape[1])).copy()
        if INPUTS in used:
            shares += joint.change @ parts.astype(np.float32)
        sources = [source for source in joint.sources if source.name in used]
        free = [joint.errors[source.name] for source in sources if not source.bounded]
        if free:
            usual = np.asarray(joint.base @ parts)
            able = less_at_ends(shares, usual * (1.0 - usual))
            shares += self._passed_on(sum(free, np.zeros(free[0].shape)), images) * able
        bounded(shares, self.value)
        within = [source for source in sources if source.bounded]
        if within:
            most = sum(((source.roots**2).sum(axis=2) for source in within), np.zeros(within[0].roots.shape[:2]))
            moved = sum((joint.errors[source.name] for source in within), np.zeros(free[0].shape if free else ()))
            settle(shares, self._passed_on(moved, images), self._passed_on(most[None], images)[0])
        return shares

    def _passed_on(self, errors: Array, images: list[int] | slice) -> Array:
        """What is added to the bins of the run (n, fractions, bins + 1), in the bins here."""
        return np.asarray(np.einsum("nfb,fbd->nfd", errors[:, :, images], self._passed))

    # -- numbers -------------------------------------------------------------------------------------------------------
    def values(self, of: Of, used: frozenset[str] = EVERYTHING) -> Array:
        """A number in every draw (copies, DRAWS); the answer's own where the draw has none, as of an empty bin."""
        drawn = of(self.tables(used))
        return np.where(np.isfinite(drawn), drawn, of(self.value))

    def number(self, of: Of, *, value: float = nan, bounds: Bounds = WHOLE) -> Number:
        """A function ``of`` tables with its 95 % interval: the one maker of intervals. ``value``: where it is known
        better than from the cells. ``bounds``: what it is between.
        """
        stated = float(of(self.value)) if isnan(value) else value
        interval = middle(self.values(of), stated, bounds)
        computed = middle(self.values(of, self.joint.computing), stated, bounds)
        return replace(interval, numerical=computed.half if self.joint.computing else None)

    def share(self, fraction: str, place: str) -> Number:
        """Share of a fraction in a bin."""
        return self.number(self.of_share(fraction, [place]))

    def of_share(self, fraction: str, places: Collection[str]) -> Of:
        """The share of a fraction in any of ``places``."""
        row, columns = self.joint.fractions.index(fraction), [self.names.index(place) for place in places]
        return lambda table: np.asarray(table[..., row, columns].sum(axis=-1))

    def of_purity(self, place: str, *fractions: str) -> Of:
        """The share of a bin's mass that is of some fractions."""
        chosen = [self.joint.fractions.index(fraction) for fraction in fractions]
        return partial(_purity, self.joint.mass, chosen, self.names.index(place))

    @cached_property
    def flows(self) -> dict[str, float]:
        """kg/h of each fraction in the feed."""
        return dict(zip(self.joint.fractions, (HOUR * self.joint.flow * self.joint.mass).tolist(), strict=True))

    def separation(self) -> Separation:
        """Every number with its interval, and the throughput (kg/h) of every bin."""
        joint, places = self.joint, self.names
        held = {place: float((joint.mass * self.value[:, i]).sum()) for i, place in enumerate(places)}
        return Separation(
            tuple(places),
            {name: {place: self.share(name, place) for place in places} for name in joint.fractions},
            {place: {name: self.number(self.of_purity(place, name)) for name in joint.fractions} if held[place] > 0.0
             else None for place in places},
            {name: self._named(f"recovery.{name}") for name in joint.fractions},
            {place: HOUR * joint.flow * mass for place, mass in held.items()},
            loss={name: self._named(f"loss.{name}") for name in joint.fractions},
            lost={name: self._named(f"lost.{name}", (0.0, flow)) for name, flow in self.flows.items()},
            dirt={place: self._named(f"dirt.{place}") if held[place] > 0.0 else None for place in places},
            money=self._money(),
        )  # fmt: skip

    def _named(self, name: str, bounds: Bounds = WHOLE) -> Number | None:
        of = self.of_name(name)
        return None if of is None else self.number(of, bounds=bounds)

    def _money(self) -> Money | None:
        prices, products = self.joint.prices, self._named("money.products", ANY)
        if prices is None or products is None:
            return None
        return Money(products, prices.fan, prices.fan_power, self._named("money.total", ANY))

    def of_name(self, name: str) -> Of | None:
        """The number called share.FRACTION.BIN, purity.BIN.FRACTION, recovery.FRACTION, loss.FRACTION, dirt.BIN,
        lost.FRACTION or throughput.BIN (kg/h), money.products or money.total (EUR/h); None of another, and of what has
        no target or no price.
        """
        kind, *rest = name.split(".")
        fractions, targets = self.joint.fractions, self.joint.targets
        match kind, rest:
            case "share", [fraction, place] if fraction in fractions and place in self.names:
                return self.of_share(fraction, [place])
            case "purity", [place, fraction] if fraction in fractions and place in self.names:
                return self.of_purity(place, fraction)
            case "recovery", [fraction] if targets.get(fraction):
                return self.of_share(fraction, targets[fraction])
            case "loss" | "lost", [fraction] if targets.get(fraction):
                beside = [place for place in self.names if place not in targets[fraction]]
                of = self.of_share(fraction, beside)
                return of if kind == "loss" else lambda table: self.flows[fraction] * of(table)
            case "dirt", [place] if place in self.names and any(place in aimed for aimed in targets.values()):
                return self.of_purity(place, *(foreign for foreign in fractions if place not in targets[foreign]))
            case "money", ["products" | "total" as what] if (prices := self.joint.prices) is not None:
                return self._of_money(prices.value, 0.0 if what == "products" else prices.fan)
            case "throughput", [place] if place in self.names:
                flow, column = HOUR * self.joint.flow * self.joint.mass, self.names.index(place)
                return lambda table: np.asarray((flow * table[..., column]).sum(axis=-1))
        return None

    def _of_money(self, value: Mapping[str, Mapping[str, float]], spent: float | None) -> Of | None:
        """EUR/h of every fraction by bin at its ``value`` (EUR/t), less what is ``spent``; None where that is unknown,
        and in other bins than those that have prices.
        """
        priced = [(name, place, price) for name, row in value.items() for place, price in row.items()]
        if spent is None or any(place not in self.names for _, place, _ in priced):
            return None
        worth = np.zeros((len(self.joint.fractions), len(self.names)))
        for name, place, price in priced:
            worth[self.joint.fractions.index(name), self.names.index(place)] = self.flows[name] * price / TONNE
        return lambda table: np.asarray((worth * table).sum(axis=(-2, -1)) - spent)

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

    def _alone(self, key: str, y: Array) -> Callable[[Array], Array]:
        """What an input does to a number at z (n,) standard deviations, about 0 at z = 0: a polynomial through the
        draws ``y`` (DRAWS,) by the inputs, once all that goes with the inputs that are independent of it in a straight
        line is taken off them.
        """
        place = self.joint.keys.index(key)
        z = self.joint.z[:, place]
        if len(self.joint.keys) <= MOST_TOGETHER:
            design, inverse = self._lines
            line = inverse @ y
            line[1:][self._tied[place]] = 0.0
            y = y - design[:, 1:] @ line[1:]
        powers = np.stack([z**order for order in range(BENT + 1)], axis=1)
        coefficients, *_ = np.linalg.lstsq(powers, y, rcond=None)
        return lambda at: np.asarray(sum(coefficients[order] * at**order for order in range(1, BENT + 1)))

    def effects(self, of: Of, fraction: str = "") -> dict[str, InputPart]:
        """What each input alone does to a number of a ``fraction`` (by default of all), the largest first."""
        values = self.values(of, frozenset({INPUTS}))
        keys = [self.joint.keys[i] for i in self.joint.acting(fraction)]
        lack, sampled = (float(self.values(of, frozenset({name})).var()) for name in (LACK, SAMPLING))
        variance, doubt = float(values.var()), lack / max(1, len(keys)) + PAIRED**2 * sampled
        if variance < LEAST or not keys:
            return {}
        effects = {}
        if len(keys) > MOST_TOGETHER:  # those that a straight line finds first
            towards = np.abs(self.joint.z.T @ (values[0] - values[0].mean()))
            keys = sorted(keys, key=lambda key: -towards[self.joint.keys.index(key)])[:MOST_TOLD]
        for key in keys:
            does = self._alone(key, values[0])
            low, high = (float(does(np.array(side * SIGMAS))) for side in (-1.0, 1.0))
            half, part = 0.5 * (high - low), float(does(self.joint.z[:, self.joint.keys.index(key)]).var())
            index, error = min(1.0, part / variance), SIGMAS * np.sqrt(doubt)
            apart = 2.0 * error * index / max(abs(half), error, LEAST)
            effects[key] = InputPart(abs(half), index, float(apart), half)
        return dict(sorted(effects.items(), key=lambda item: -item[1].variance))

    def known_better(self, of: Of, parts: Mapping[str, float], value: float = nan) -> Number:
        """A number once the inputs in ``parts`` are known to that part of the interval that they have now, each still
        where it is expected: what they do alone shrinks, all else stays. Never less than computing adds, nor more than
        is unknown now.
        """
        stated = float(of(self.value)) if isnan(value) else value
        inputs, values = self.values(of, frozenset({INPUTS})), self.values(of)
        now, computed = (middle(drawn, stated, WHOLE) for drawn in (values, self.values(of, self.joint.computing)))
        for key, part in parts.items():
            z, does = self.joint.z[:, self.joint.keys.index(key)], self._alone(key, inputs[0])
            for copy, side in enumerate((1.0, -1.0 if key in EITHER_SIGN else 1.0)[: len(values)]):
                less = does(part * side * z) - does(side * z)
                values[copy], inputs[copy] = values[copy] + less, inputs[copy] + less
        narrower = middle(values, stated, WHOLE)
        low, high = max(narrower.low, now.low), min(narrower.high, now.high)
        return Number(stated, min(low, computed.low), max(high, computed.high))


def effects_in(bins: Bins) -> tuple[dict[str, dict[str, Parts]], dict[str, Parts]]:
    """What each input alone does to every share, by fraction and bin; and to every recovery and purity of targets."""
    shares = {
        name: {place: parts for place in bins.names if (parts := bins.effects(bins.of_share(name, [place]), name))}
        for name in bins.joint.fractions
    }
    of_targets: dict[str, Parts] = {}
    for name, targets in bins.joint.targets.items():
        if targets:
            of_targets[f"recovery.{name}"] = bins.effects(bins.of_share(name, targets), name)
        for place in targets:
            if (bins.joint.mass * bins.value[:, bins.names.index(place)]).sum() > 0.0:
                of_targets[f"purity.{place}.{name}"] = bins.effects(bins.of_purity(place, name))
    return shares, of_targets


def bounded(shares: Array, answer: Array | float = 0.0) -> Array:
    """Shares (..., fractions, bins + 1) that are none below 0 and sum to 1, in place; the ``answer`` (fractions,
    bins + 1) where errors leave nothing of a fraction.
    """
    np.clip(shares, 0.0, None, out=shares)
    total = shares.sum(axis=-1, keepdims=True)
    np.divide(shares, total, out=shares, where=total > 0.0)
    np.copyto(shares, answer, where=total <= 0.0)
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


def middle(values: Array, value: float, bounds: Bounds = ANY) -> Number:
    """A number with the middle 95 % of its ``values`` (copies, DRAWS), of the mean of the copies' ends."""
    level = 0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)
    ends = np.mean([np.quantile(of_copy, level) for of_copy in np.atleast_2d(values)], axis=0)
    low, high = min(float(ends[0]), value), max(float(ends[1]), value)
    return Number(value, max(low, min(bounds[0], value)), min(high, max(bounds[1], value)))


def difference(answer: Bins, against: Bins, name: str) -> Number | None:
    """The number called ``name`` of an ``answer`` less that of the one it is held ``against``: the same draw of every
    input that both have, and of what else is common to both; None where either has no such number.
    """
    ofs = answer.of_name(name), against.of_name(name)
    if ofs[0] is None or ofs[1] is None:
        return None
    values = answer.values(ofs[0]) - against.values(ofs[1])
    return middle(values, float(ofs[0](answer.value) - ofs[1](against.value)))


def _purity(mass: Array, fractions: Sequence[int], place: int, table: Array) -> Array:
    here = mass * table[..., place]
    total = here.sum(axis=-1)
    empty = np.full(np.shape(total), np.nan)
    return np.asarray(np.divide(here[..., list(fractions)].sum(axis=-1), total, out=empty, where=total > 0.0))


def _lately(made: dict[Any, Made], key: object, most: int, make: Callable[[], Made]) -> Made:
    """What is ``made`` under a key, of which the last ones are kept: somebody may drag a bin on a page."""
    if key not in made:
        if len(made) >= most:
            made.pop(next(iter(made)))
        made[key] = make()
    return made[key]
