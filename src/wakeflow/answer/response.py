"""How a fraction's landings go with the inputs that nobody knows exactly, from the few draws of them that were flown.

A share bends where the inputs carry granules over the end of a bin; where they land does so far less. So the landings
are followed, not the shares. (1) The displacement of granules along a side, from where they land in the answer to where
they land in a draw, is fitted in every draw over the place, robustly: granules that meet another face are set aside.
(2) The fits go with the inputs as a Gaussian process (Rasmussen & Williams 2006, Gaussian Processes for Machine
Learning, ch. 2): straight and bent, each input by what it does. (3) In any draw of the ensemble every granule is moved
so, and by what granules near it in the draws nearest to that one were moved beyond the fit; the cells are counted
again. (4) What the flown draws have beyond that, jumps to other faces and to other sides, goes with the inputs as a
second Gaussian process. Its noise is that of few granules, one for all draws; what varies by more than this noise and
goes with no input is lack of fit, as is what the process does not know of a draw: small where draws were flown, large
where none was.

Where the air scatters granules otherwise in every flight, (1) has little to say and (4) is a regression of shares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.lazy import cached_property
from ..planning.unknowns import FARTHEST
from .cells import LandingCells
from .draws import less_at_ends

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
KNOTS = 8  # of the displacement along a side, between as many equal parts of the granules; chosen
GAP = 0.05  # of the stretch where granules land: the displacement may jump over one so wide
SMOOTH = 0.3  # granules by which neighbouring knots count as one
ROUNDS = 3  # of fits, each without the granules that the one before shows to have met another face
SCATTERED = 5.0  # robust standard deviations of all displacements from which one is a jump
OFF = 6.0  # robust standard deviations from the fit, likewise
USUAL = 1.4826  # of a median absolute deviation: a normal distribution's standard deviation
LEAST_JUMP = 0.3  # of the usual displacement: what is less beside the fit is none
FEWEST = 0.3  # of a side's granules: where the fit leaves out more, none are left out
NEAREST = (4, 16, 64)  # flown draws whose granules say how the displacement scatters: what predicts a draw best
REPEATS = 4  # of a scatter's choice where a flown draw is predicted from its neighbours
MOST_MOVED = 1024  # granules of a fraction that are moved in every draw of the ensemble
LOT = 2**17  # places of granules in draws that are moved at once: as many as a processor holds near
BENDS, WAVES, REACH = (0.0, 0.1, 0.5), (0.0, 0.3, 1.0), 0.7  # kernels that are tried: squares, and short waves
KNOWN = 0.3  # of the variance of independent granules: what balanced ones scatter by at least
SIZES = tuple(np.geomspace(1e-3, 1e3, 13).tolist())  # variances over that of the noise
SURE = 2.0  # standard deviations by which squares of normal numbers exceed their mean before more than noise is seen
STEADY = 0.3  # part of the kernel of what the flown draws have beyond the prediction that is the same in all
SEED = 20110  # of the choices of a scatter: any, but always the same


class Places(NamedTuple):
    """Landings (R, M) of R draws: the ``side`` (-1: on none), the ``place`` (m) along it, the ``cell``."""

    side: Whole
    place: Array
    cell: Whole


@dataclass(frozen=True)
class Process:
    """A Gaussian process over the inputs: ``z`` (R, K) of the flown draws, the ``weight`` of each input (K,) in the
    kernel of ``bend``, ``wave`` and ``steady``, its ``size``, the ``inverse`` (R, R) of the covariance.
    """

    z: Array
    weight: Array
    bend: float
    wave: float
    steady: float
    size: float
    inverse: Array

    def kernel(self, at: Array) -> Array:
        """Covariance (n, R) of draws at ``at`` (n, K) with those that were flown."""
        return np.asarray(self.size * _kernel(at, self.z, self.weight, self.bend, self.wave, self.steady))

    def predicted(self, at: Array, outputs: Array) -> tuple[Array, Array]:
        """``outputs`` (R, O) of the flown draws as they are expected (n, O) at ``at`` (n, K), and the variance (n,)
        that is left there, in units of the outputs' own.
        """
        line, kernel = (at**2) @ self.weight + self.steady, self.kernel(at)
        gain, prior = kernel @ self.inverse, self.size * (line + self.bend * line**2 + self.wave)
        return gain @ outputs, np.clip(prior - np.einsum("nr,nr->n", gain, kernel), 0.0, None)


Judge = Callable[[Array, Array, Array], float]


def _kernel(a: Array, b: Array, weight: Array, bend: float, wave: float, steady: float) -> Array:
    line = (a * weight) @ b.T + steady
    kernel = line + bend * line**2
    if wave:
        apart = ((a**2) @ weight)[:, None] + (b**2) @ weight - 2.0 * (line - steady)
        kernel += wave * np.exp(-0.5 * np.clip(apart, 0.0, None) / REACH**2)
    return np.asarray(kernel)


def likelihood(inverse: Array, spread: Array, outputs: Array) -> float:
    """How likely ``outputs`` (R, O) are where their covariance has the ``inverse`` (R, R), and over that of the noise
    the eigenvalues ``spread`` (R,): the logarithm, for the scale that suits best, no smaller than the noise lets it.
    """
    scatter = float(np.einsum("ro,rs,so->", outputs, inverse, outputs)) / len(outputs)
    scale = max(scatter, KNOWN)
    return float(-0.5 * len(outputs) * (np.log(scale) + scatter / scale) - 0.5 * np.log(spread).sum())


def left_out(inverse: Array, _: Array, outputs: Array) -> float:
    """How near each of ``outputs`` (R, O) is to what all others let expect of it, as a number that is larger where it
    is nearer (Rasmussen & Williams 2006, eq. 5.12).
    """
    return -float(((inverse @ outputs / np.diag(inverse)[:, None]) ** 2).sum())


def process(
    z: Array, outputs: Array, noise: Array, weight: Array, steady: float = 0.0, by: Judge = likelihood
) -> Process:
    """The best process, ``by`` the likelihood, through ``outputs`` (R, O), each draw with a ``noise`` (R,), whose
    inputs count by ``weight`` (K,).

    The outputs are shares of a whole, and count as one number, whose ``noise`` is that of all of them together.
    """
    tried: dict[tuple[float, float], list[float]] = {}
    root, sizes = np.sqrt(noise), float(noise.mean()) * np.array(SIZES)
    kernels = {(bend, wave): _kernel(z, z, weight, bend, wave, steady) for bend in BENDS for wave in WAVES}
    for kind, kernel in kernels.items():
        values, ways = np.linalg.eigh(kernel / np.outer(root, root))
        spreads = [size * np.clip(values, 0.0, None) + 1.0 for size in sizes]
        made = (((ways / spread) @ ways.T / np.outer(root, root), spread) for spread in spreads)
        tried[kind] = [by(inverse, spread, outputs) for inverse, spread in made]
    bend, wave = max(tried, key=lambda kind: max(tried[kind]))
    good = np.array(tried[bend, wave])
    size = sizes[good.argmax()]
    if by is likelihood:  # which alone is too sure of itself where few draws tell it: the mean, none likelier before
        size = float(np.average(sizes, weights=sizes * np.exp(good - good.max())))
    inverse = np.linalg.inv(size * kernels[bend, wave] + np.diag(noise))
    return Process(z, weight, bend, wave, steady, size, inverse)


def weights_of(z: Array, outputs: Array) -> Array:
    """How much every input (K,) moves ``outputs`` (R, O), together 1: its slopes' squares less their noise, and a tenth
    of that noise, so that none counts for nothing.
    """
    draws, many = z.shape
    if many < draws // 2:
        design = np.column_stack([np.ones(draws), z])
        line, *_ = np.linalg.lstsq(design, outputs, rcond=None)
        scatter = ((outputs - design @ line) ** 2).sum(axis=0) / (draws - many - 1)
        slopes, unit = line[1:], np.diag(np.linalg.pinv(design.T @ design))[1:]
    else:
        unit = 1.0 / np.maximum((z**2).sum(axis=0), 1.0)
        slopes, scatter = unit[:, None] * (z.T @ (outputs - outputs.mean(axis=0))), outputs.var(axis=0)
    noise = unit[:, None] * scatter
    weights = np.clip(slopes**2 - noise, 0.0, None).sum(axis=1) + 0.1 * noise.sum(axis=1)
    total = float(weights.sum())
    return weights / total if total > 0.0 else np.full(many, 1.0 / max(1, many))


# -- the displacement along a side -------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Displacement:
    """Displacements along a side at its ``knots`` (J,), ``fitted`` (R, J) in every flown draw and followed by
    ``going``, which says of each draw ``without`` it (R, J); ``kept`` (R, M) granules that go with the fit, and what
    each has ``beyond`` it (R, M).
    """

    knots: Array
    fitted: Array
    without: Array
    going: Process
    kept: NDArray[np.bool_]
    beyond: Array

    def at(self, z: Array) -> Array:
        """The displacement (n, J) at the knots in draws at ``z`` (n, K)."""
        return self.going.kernel(z) @ (self.going.inverse @ self.fitted)


def _hats(place: Array, knots: Array) -> tuple[Whole, Array]:
    """The knot before each place, and how far it is on the way to the next."""
    before = np.clip(np.searchsorted(knots, place) - 1, 0, len(knots) - 2)
    return before, np.clip((place - knots[before]) / (knots[before + 1] - knots[before]), 0.0, 1.0)


def _between(values: Array, place: Array, knots: Array) -> Array:
    """``values`` (..., J) at knots, at places (...) or (G,)."""
    before, part = _hats(place, knots)
    if values.ndim == place.ndim == 2 and values.shape[0] == place.shape[0]:
        low, high = (np.take_along_axis(values, before + more, axis=1) for more in (0, 1))
    else:
        low, high = values[..., before], values[..., before + 1]
    return np.asarray(low * (1.0 - part) + high * part)


def displaced(z: Array, landed: Array, then: Array, here: NDArray[np.bool_]) -> Displacement | None:
    """How granules that ``landed`` at places (R, M) in the answer and land at ``then`` (R, M) in draws at ``z`` (R, K)
    are moved, of those that land on the side in both (``here``); None where they are too few or all in one place.
    """
    if here.sum() < 2 * len(z) or np.ptp(landed[here]) <= 0.0:
        return None
    knots = _knots(landed[here])
    moved, kept = np.where(here, then - landed, 0.0), here
    usual = USUAL * float(np.median(np.abs(moved[here])))
    for _ in range(ROUNDS):
        fitted, _ = _fitted(landed, moved, kept, knots)
        beyond = moved - _between(fitted, landed, knots)
        scale = USUAL * float(np.median(np.abs(beyond[here])))
        fits = here & (np.abs(moved) <= SCATTERED * usual + 1e-9)
        fits &= np.abs(beyond) <= OFF * scale + LEAST_JUMP * usual + 1e-9
        kept = fits if fits.sum() > FEWEST * here.sum() else here
    fitted, noise = _fitted(landed, moved, kept, knots)
    going = process(z, fitted, noise, weights_of(z, fitted), by=left_out)
    beyond = moved - _between(going.kernel(z) @ (going.inverse @ fitted), landed, knots)
    without = fitted - going.inverse @ fitted / np.diag(going.inverse)[:, None]
    return Displacement(knots, fitted, without, going, kept, beyond)


def _knots(landed: Array) -> Array:
    """Places of knots: as many granules between each two, of those that ``landed`` (n,), and both ends of wide gaps."""
    places = np.sort(landed)
    wide = np.flatnonzero(np.diff(places) > GAP * (places[-1] - places[0]))
    return np.unique([*np.quantile(places, np.linspace(0.0, 1.0, KNOTS)), *places[wide], *places[wide + 1]])


def _fitted(landed: Array, moved: Array, kept: NDArray[np.bool_], knots: Array) -> tuple[Array, Array]:
    """The displacement (R, J) at the knots that fits each draw's granules best, and the variance (R,) of all knots
    together that these granules' scatter about it makes.
    """
    before, part = _hats(landed, knots)
    hats = np.zeros((*landed.shape, len(knots)))
    np.put_along_axis(hats, before[..., None], (1.0 - part)[..., None], axis=2)
    np.put_along_axis(hats, before[..., None] + 1, part[..., None], axis=2)
    hats *= kept[..., None]
    together = np.histogram(landed[kept], knots)[0] > 2  # more than both ends of a gap
    steps = np.diff(np.eye(len(knots)), axis=0)[together]
    matrix = np.einsum("rmj,rmk->rjk", hats, hats) + SMOOTH * steps.T @ steps + 1e-6 * np.eye(len(knots))
    inverse = np.linalg.inv(matrix)
    fitted = np.einsum("rjk,rmk,rm->rj", inverse, hats, moved, optimize=True)
    beyond = np.where(kept, moved - _between(fitted, landed, knots), 0.0)
    scatter = (beyond**2).sum() / max(1, int(kept.sum()))
    return fitted, scatter * np.trace(inverse, axis1=1, axis2=2) + 1e-18


# -- the response of a fraction's landings -----------------------------------------------------------------------------
@dataclass(frozen=True)
class Response:
    """How the landings of a fraction go with its inputs: draws at ``z`` (R, K) of granules that land at ``own`` in the
    answer; the displacement on every side; what the draws have ``beyond`` it (R, cells), which goes as ``rest``;
    whose noise has some variance that granules do not explain, ``unexplained``; what each flown draw is ``off`` (R,
    bins + 1) from what all others let expect of it, over its standard deviation; the ``usual`` p (1 - p) of shares
    (bins + 1,); the ``weight`` (K,) of each input in how near draws are; of how many of the ``nearest`` flown draws the
    scatter is.
    """

    cells: LandingCells
    z: Array
    own: Places
    sides: Mapping[int, Displacement]
    beyond: Array
    rest: Process
    unexplained: float
    off: Array
    usual: Array
    weight: Array
    nearest: int

    def __call__(self, z: Array, *, by_bin: bool = False) -> tuple[Array, Array]:
        """The change (n, cells) of the share in every cell in draws at ``z`` (n, K), or ``by_bin`` (n, bins + 1), which
        takes less time; and the standard deviation (n,) of its lack of fit, in units of :attr:`off`.
        """
        bins = self.cells.parts().argmax(axis=1)
        label = bins if by_bin else np.arange(self.cells.count)
        each = np.eye(self.usual.size if by_bin else self.cells.count)
        rest, doubt = self.rest.predicted(z, self.beyond @ each[label])
        change, before = np.zeros(rest.shape), self.before @ each[label]
        nearest, every = _apart(z, self.z, self.weight).argmin(axis=1), len(self._places.cell)
        for side, (scattered, hats, cell) in self._scatter.items():
            edges = list(self.cells.edges.values())[side]
            along = label[self.cells.first[list(self.cells.edges)[side]] + np.arange(len(edges) - 1)]
            ends = np.flatnonzero(np.diff(along)) + 1
            inside, shifts = each[along[np.r_[0, ends]]], self.sides[side].at(z)
            change -= np.bincount(label[cell], minlength=len(each)) / every
            for rows in np.array_split(np.arange(len(z)), 1 + len(z) * len(cell) // LOT):
                place = shifts[rows] @ hats + scattered[nearest[rows]]
                number = np.searchsorted(edges[ends], place.ravel(), side="right").reshape(place.shape)
                change[rows] += _shares(number, len(inside)) @ inside * (len(cell) / every)
        shares = change + before if by_bin else (change + before) @ self.cells.parts()
        able = less_at_ends(shares, self.usual)
        return change + rest * (able if by_bin else able[:, bins]), np.sqrt(doubt + self.unexplained)

    @cached_property
    def before(self) -> Array:
        """The share (cells,) of the granules in every cell in the answer."""
        return np.bincount(self._places.cell, minlength=self.cells.count) / len(self._places.cell)

    @property
    def root(self) -> Array:
        """A root (bins + 1, R) of the covariance of the lack of fit where its standard deviation is 1."""
        return np.asarray(self.off.T / np.sqrt(len(self.off)))

    @cached_property
    def _places(self) -> Places:
        return _some(self.own)

    @cached_property
    def _scatter(self) -> dict[int, tuple[Array, Array, Whole]]:
        """Places (R, G) of the granules (G) on each side as they scatter near each flown draw, what each knot's
        displacement counts for (J, G), and their cells (G,). The same choice for every draw, so that the cells change
        with z alone.
        """
        places, scatter = self._places, {}
        neighbours = _nearest(self.z, self.z, self.weight, self.nearest)
        near = [(like, np.random.default_rng(SEED)) for like in neighbours]
        for side, fit in self.sides.items():
            here = places.side == side
            at = places.place[here]
            scattered = at + [_scattered(at, self.own, fit, like, 1, chance)[0] for like, chance in near]
            if len(at):
                scatter[side] = scattered, _between(np.eye(len(fit.knots)), at, fit.knots), places.cell[here]
        return scatter


def _scattered(
    at: Array, landed: Places, fit: Displacement, like: Whole, count: int, chance: np.random.Generator
) -> Array:
    """What granules near ``at`` (G,) were moved beyond the fit, chosen (count, G) among those of the draws ``like``."""
    place, beyond = landed.place[like][fit.kept[like]], fit.beyond[like][fit.kept[like]]
    if not len(place):
        return np.zeros((count, len(at)))
    order = np.argsort(place)
    near = np.searchsorted(place[order], at) + chance.integers(-2, 3, (count, len(at)))
    return np.asarray(beyond[order][np.clip(near, 0, len(place) - 1)])


def _some(places: Places) -> Places:
    """At most MOST_MOVED of all granules, evenly taken along the sides."""
    side, place, cell = (values.ravel() for values in places)
    order, every = np.lexsort((place, cell)), cell.size
    few = min(every, MOST_MOVED)
    rows = order[((np.arange(few) + 0.5) * every / few).astype(int)]
    return Places(side[rows], place[rows], cell[rows])


def _shares(cell: Whole, count: int) -> Array:
    """The share (n, count) of every cell among the granules' (n, G)."""
    rows = np.arange(len(cell))[:, None] * count
    counts = np.bincount((cell + rows).ravel(), minlength=len(cell) * count).reshape(len(cell), count)
    return np.asarray(counts / cell.shape[1])


def _nearest(a: Array, b: Array, weight: Array, count: int) -> Whole:
    """The ``count`` draws of ``b`` (R, K) that are nearest to each of ``a`` (n, K), each input by its ``weight``."""
    return np.argsort(_apart(a, b, weight), axis=1, kind="stable")[:, :count]


def _apart(a: Array, b: Array, weight: Array) -> Array:
    """The square (n, R) of how far each of ``a`` (n, K) is from each of ``b`` (R, K), each input by its ``weight``."""
    return np.asarray(((a**2) @ weight)[:, None] + (b**2) @ weight - 2.0 * (a * weight) @ b.T)


def response(cells: LandingCells, z: Array, landed: Places, then: Places) -> Response:
    """The response of granules that ``landed`` in the answer and land at ``then`` in draws at ``z`` (R, K)."""
    z = np.clip(z, -FARTHEST, FARTHEST)
    sides = {}
    for side in np.unique(landed.side[landed.side >= 0]):
        displacement = displaced(z, landed.place, then.place, (landed.side == side) & (then.side == side))
        if displacement is not None:
            sides[int(side)] = displacement
    weight = np.mean([fit.going.weight for fit in sides.values()], axis=0) if sides else np.zeros(z.shape[1])
    tried = [_predicted(cells, z, landed, then, sides, _nearest(z, z, weight, count + 1)) for count in NEAREST]
    missed = [float((beyond.cumsum(axis=1) ** 2).sum()) for beyond, _ in tried]  # wherever a bin may end
    best = int(np.argmin(missed))
    beyond, each = tried[best]
    outputs = beyond @ cells.parts()
    noise = each.var(axis=1).sum(axis=1) / landed.cell.shape[1]
    noise = np.full(len(z), float(noise.mean()) + 1e-12)  # a draw's own is large where it shows something
    rest = process(z, outputs, noise, weights_of(z, outputs), STEADY)
    squares, certain = (_off(rest, outputs) ** 2).sum(axis=1), np.diag(rest.inverse)
    beyond_chance = squares.mean() > 1.0 + SURE * np.sqrt(2.0 / len(z))
    unexplained = float(np.mean((squares - 1.0) / certain)) if beyond_chance else 0.0
    if unexplained > 0.0:
        rest = process(z, outputs, noise + unexplained, weights_of(z, outputs), STEADY)
    shares = _shares(then.cell, cells.count) @ cells.parts() - outputs
    usual = np.clip(shares * (1.0 - shares), 0.0, None).mean(axis=0)
    off = _off(rest, outputs)
    return Response(cells, z, landed, sides, beyond, rest, unexplained, off, usual, weight, NEAREST[best])


def _off(rest: Process, outputs: Array) -> Array:
    """What each of ``outputs`` (R, O) is off from what all others let expect of it, over its standard deviation
    (Rasmussen & Williams 2006, eq. 5.12).
    """
    return np.asarray(rest.inverse @ outputs / np.sqrt(np.diag(rest.inverse))[:, None])


def _predicted(
    cells: LandingCells, z: Array, landed: Places, then: Places, sides: Mapping[int, Displacement], neighbours: Whole
) -> tuple[Array, Array]:
    """What every flown draw has (R, cells) beyond what all others predict of it, its granules scattering as those of
    its ``neighbours`` (R, n), itself the first; and the same of each granule by bin (R, M, bins + 1).
    """
    bins = cells.parts().argmax(axis=1)
    many = cells.parts().shape[1]
    beyond, each = np.zeros((len(z), cells.count)), np.zeros((*landed.cell.shape, many))
    for draw in range(len(z)):
        like, chance = neighbours[draw][neighbours[draw] != draw], np.random.default_rng(SEED)
        moved_to = np.repeat(landed.cell[draw : draw + 1], REPEATS, axis=0)
        for side, fit in sides.items():
            here = landed.side[draw] == side
            at = landed.place[draw, here]
            moved = at + _between(fit.without[draw], at, fit.knots) + _scattered(at, landed, fit, like, REPEATS, chance)
            moved_to[:, here] = cells.at(np.full(moved.shape, side), moved, np.zeros_like(moved, dtype=np.int64))
        beyond[draw] = _shares(then.cell[draw : draw + 1], cells.count)[0] - _shares(moved_to, cells.count).mean(axis=0)
        each[draw] = _inside(bins[then.cell[draw]], many) - _inside(bins[moved_to], many).mean(axis=0)
    return beyond, each


def _inside(bins: Whole, many: int) -> Array:
    return np.asarray(bins[..., None] == np.arange(many), dtype=float)
