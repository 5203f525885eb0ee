"""What the landings say: shares with their intervals, the budget's rows, and the slab."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from math import nan
from operator import eq
from typing import Annotated, Any, Self, TypeVar

from ..core.errors import SceneError, known
from ..core.number import Number
from ..core.record import Null, column
from ..core.registry import did_you_mean
from ..flight.stages.landings import fates_of
from ..flight.stages.slab_stage import SlabFound
from ..planning.collisions import CollisionPlan
from ..planning.unknowns import Unknown


def optional(unit: str, meaning: str, default: object = None) -> Any:
    """A column whose ``default``, a value or ``dict`` for an empty one, leaves the key out of the JSON."""
    metadata = dict(column(unit, meaning, absent=True, default=default).metadata)
    if default is dict:
        return field(default_factory=dict, metadata=metadata | {"exclude_if": partial(eq, {})})
    return field(default=default, metadata=metadata | {"exclude_if": partial(eq, default)})


# -- The slab in which granules meet -----------------------------------------------------------------------------------
@dataclass(frozen=True)
class CollisionSummary:
    """The slab of hard spheres that the shares with collisions come from."""

    depth: float = column("m", "depth of the slab across the picture, periodic")
    replicates: int = column("1", "independent runs of the slab that flew, of those of the plan")
    start_up: float = column("s", "time dropped at the beginning of each")
    granules: dict[str, int] = column("1", "granules, or tracers, of each fraction that landed and count")
    tracers: dict[str, float] = column("1", "share of each fraction's mass, its finest granules, that flew as tracers")
    meetings: dict[str, float] = column("1", "meetings with other granules on a flight, mean over each fraction's mass")
    fates: dict[str, dict[str, int]] = column("1", "granules of each fraction by how their track ended")
    step: float = column("s", "step of its clock")
    step_error: Annotated[float, Null(nan)] = column(
        "as plan.unit", "how far nine of ten granules that meet nobody land from where far finer flights do, at most"
    )
    jammed: int = column("1", "replicates in which granules that lie still became more as long as it was fed")
    step_asked: Annotated[float, Null(nan)] = column(
        "as plan.unit", "such a distance as was asked for: a larger one is a notice", default=nan
    )
    step_trials: int | None = column("1", "steps that were tried", default=None)


def collisions_of(plan: CollisionPlan, collisions: SlabFound) -> CollisionSummary:
    """What the slab was, and what granules met in it."""
    landings = collisions.landings
    return CollisionSummary(
        depth=collisions.depth,
        replicates=collisions.replicates,
        start_up=collisions.start_up,
        granules={name: len(landing.bin) for name, landing in landings.items()},
        tracers=dict(plan.tracers),
        meetings={name: float(known(landing.meetings) @ landing.mass_shares) for name, landing in landings.items()},
        fates={name: fates_of(landing.fate) for name, landing in landings.items()},
        step=collisions.clock.step,
        step_error=collisions.clock.step_error,
        step_asked=collisions.clock.asked,
        step_trials=collisions.clock.trials,
        jammed=collisions.jammed,
    )


# -- What the landings say ---------------------------------------------------------------------------------------------
Entry = TypeVar("Entry")

KILO = 1e3
SHARE_UNIT = "1"  # unit of the error of a share: a fraction of 1, absolute


class How(StrEnum):
    """How an error is known: from this run, from flying granules again, from a bound and what was found, or not."""

    MEASURED = "measured"
    PERTURBED_RERUN = "companion"
    CALIBRATED = "calibrated"
    UNKNOWN = "unknown"


MEASURED, PERTURBED_RERUN, CALIBRATED, UNKNOWN = How
LEFT_OUT, NOT_COMPUTED = "left-out", "not-computed"  # kinds of a term: small enough for the accuracy, or not


@dataclass(frozen=True)
class PartitionCurve:
    """The partition (Tromp) curve of a product: of the granules of all fractions that are alike in one property, by
    mass, the share that lands in it. The cut is where the share passes a half; Ep is half of the distance between the
    places where it passes a quarter and three quarters; the imperfection is Ep over the cut.
    """

    product: tuple[str, ...] = column("", "the bins that make it: targets of a fraction, or one bin")
    by: str = column("", "the property: size or terminal velocity")
    unit: str = column("", "unit of the property: m or m/s")
    at: tuple[float, ...] = column("as unit", "the property's mean, by mass, in each class of granules")
    mass: tuple[float, ...] = column("1", "share of the feed's mass in each class")
    share: tuple[float, ...] = column("1", "part of each class that lands in the product")
    low: tuple[float, ...] = column("1", "lower end of its 95 % interval")
    high: tuple[float, ...] = column("1", "upper end of it")
    cut: Number | None = column("as unit", "x50, with the interval that the band gives; null where there is none")
    ep: float | None = column("as unit", "Ep; null where the curve does not pass both quarters")
    imperfection: float | None = column("1", "Ep over the cut; null as Ep")
    why: str = optional("", "why there is no cut, or between which values no granules are; else left out", default="")

    @property
    def overlaps(self) -> bool:
        """Whether granules of several fractions are alike in the property, so that the curve tells of a cut by it and
        not of a gap between two fractions.
        """
        return "no granules between" not in self.why


@dataclass(frozen=True)
class Prices:
    """What the answer is valued with."""

    value: dict[str, dict[str, float]] = column("EUR/t", "worth of each fraction by bin; nothing where left out")
    fan_power: float | None = column("W", "power of the fan; null where it is not known, and without a price of it")
    electricity: float | None = column("EUR/kWh", "price of the fan's electricity; null without one")

    @property
    def fan(self) -> float | None:
        """EUR/h of the fan; 0 without a price of it, None where its power is not known."""
        if self.electricity is None:
            return 0.0
        return None if self.fan_power is None else self.electricity * self.fan_power / KILO


@dataclass(frozen=True)
class Money:
    """What the setting earns an hour: the shares as the prices of the scene value them."""

    products: Number = column("EUR/h", "worth of what lands where it has a price")
    fan: float | None = column("EUR/h", "electricity of the fan; null where its pressure drop is not known")
    fan_power: float | None = column("W", "power of the fan; null as fan, and without a price of electricity")
    total: Number | None = column("EUR/h", "the products less the fan; null as fan")


@dataclass(frozen=True)
class Separation:
    """Which share of each fraction lands in which bin, by mass; ``elsewhere`` is the last bin."""

    bins: tuple[str, ...] = column("", "bins in the scene's order, then elsewhere")
    fractions: dict[str, dict[str, Number]] = column("1", "share of each fraction in each bin; they sum to 1")
    purity: dict[str, dict[str, Number] | None] = column("1", "share of each fraction in a bin's mass; null if empty")
    recovery: dict[str, Number | None] = column("1", "share of each fraction in its targets; null without a target")
    throughput: dict[str, float] = column("kg/h", "mass flow of all fractions into each bin")
    loss: dict[str, Number | None] = column(
        "1", "share of each fraction outside its targets, elsewhere too; null without a target", default=dict
    )
    lost: dict[str, Number | None] = column("kg/h", "loss as a rate", default=dict)
    dirt: dict[str, Number | None] = column(
        "1", "share of a bin's mass that is of fractions whose target it is not; null where it is nobody's target, or "
        "empty", default=dict,
    )  # fmt: skip
    cut: tuple[PartitionCurve, ...] = column("", "which granules go into each product", default=())
    money: Money | None = optional("", "earnings of the setting; left out of a scene without prices")

    def share(self, fraction: str, place: str) -> Number:
        """Share of a fraction in a bin, by mass, with its 95 % interval: (value, low, high).

        Raises SceneError, naming the nearest, for a fraction or bin that there is not.
        """
        return _known("bin", _known("fraction", self.fractions, fraction), place)


class WithShares:
    """What has shares, and gives each number of them with its 95 % interval: (value, low, high)."""

    @property
    def _shares(self) -> Separation:
        raise NotImplementedError

    def share(self, fraction: str, place: str) -> Number:
        """Share as of :meth:`Separation.share`; raises SceneError also where there are no shares."""
        return self._shares.share(fraction, place)

    def recovery(self, fraction: str) -> Number:
        """Share of a fraction in its targets.

        Raises SceneError, naming the nearest, for a fraction that there is not, for one without a target, and where
        there are no shares.
        """
        return self._of_target(self._shares.recovery, fraction)

    def loss(self, fraction: str) -> Number:
        """Share of a fraction outside its targets, as :meth:`recovery`."""
        return self._of_target(self._shares.loss, fraction)

    def _of_target(self, numbers: Mapping[str, Number | None], fraction: str) -> Number:
        if (number := _known("fraction", numbers, fraction)) is None:
            raise SceneError(f"{fraction} has no target to be recovered in: give fraction.{fraction}.target, a bin")
        return number

    def dirt(self, place: str) -> Number:
        """Share of a bin's mass that is of fractions whose target it is not.

        Raises SceneError for a bin that there is not, naming the nearest, for one that is nobody's target or empty, and
        where there are no shares.
        """
        if (number := _known("bin", self._shares.dirt, place)) is None:
            raise SceneError(f"no dirt in {place}: it is no fraction's target, or nothing lands there")
        return number

    def purity(self, place: str, fraction: str) -> Number:
        """Share of a bin's mass that is of a fraction.

        Raises SceneError for a bin or fraction that there is not, naming the nearest, for a bin that stays empty, and
        where there are no shares.
        """
        here = _known("bin", self._shares.purity, place)
        _known("fraction", self._shares.fractions, fraction)
        if here is None:
            raise SceneError(f"nothing lands in {place}: an empty bin has no purity")
        return here[fraction]


def _known(kind: str, table: Mapping[str, Entry], name: str) -> Entry:
    if not isinstance(name, str) or name not in table:
        raise SceneError(f"no {kind} {name!r}{did_you_mean(name, list(table))} (known: {', '.join(table)})")
    return table[name]


@dataclass(frozen=True)
class BudgetPart:
    """One source's part of an error."""

    source: str = column("", "name of the source", default="")
    error: float | None = column("1 or the row's unit", "size of the error; null where unknown", default=None)
    seconds: float = column("s", "run time that knowing it took", default=0.0)
    how: How = column("", "measured, companion, calibrated or unknown", default=UNKNOWN)
    kind: str = optional("", "kind of a term: left-out (small enough) or not-computed; else left out", default="")
    low: float | None = optional("1", "lower end of what inputs change; else left out")
    high: float | None = optional("1", "upper end of what inputs change; else left out")
    of_granules: float | None = optional(
        "1", "part of the mesh's error that a finite number of granules makes; else left out"
    )
    of_sheddings: float | None = optional(
        "1", "part of the mesh's error that a finite number of shedding cycles makes; else left out"
    )
    note: str = optional("", "how the error is known; left out where nothing does", default="")

    @property
    def size(self) -> float:
        """The error, 0 where it is unknown."""
        return self.error or 0.0


@dataclass(frozen=True)
class BudgetTotal:
    """All parts of a row together, as the half and the ends of a 95 % interval."""

    error: float | None = column("1 or the row's unit", "null: a part is of unknown size, and `note` says what to do")
    seconds: float = column("s", "run time of everything that the row rests on")
    low: float | None = optional("1", "lower end of a share's interval, of all known parts")
    high: float | None = optional("1", "upper end of a share's interval, of all known parts")
    numerical: float | None = optional("1", "half of a share's interval by computing alone")
    note: str = optional("", "what is unknown or only a bound; else left out", default="")


@dataclass(frozen=True)
class BudgetRow:
    """The error of one quantity by its sources."""

    quantity: str = column("", "share.FRACTION.BIN or landing.FRACTION")
    unit: str | None = column("", "unit of the errors; null where it is 1")
    parts: tuple[BudgetPart, ...] = column("", "what each source contributes")
    total: BudgetTotal = column("", "the sum")

    @property
    def measure(self) -> str:
        """The unit of the row's errors: "1" for shares."""
        return SHARE_UNIT if self.unit is None else self.unit


@dataclass(frozen=True)
class LoadingEffect:
    """A share of the same granules in the steady airflow without their force on it, and with it."""

    without: float = column("1", "share in air that does not feel the granules")
    loaded: float = column("1", "share in air that does")


@dataclass(frozen=True)
class InputPart:
    """What one number of the scene that is not known exactly does to a share."""

    half: float = column("1", "half of the 95 % range of the share that it alone gives")
    variance: float = column("1", "its part of the share's variance over all unknowns: first-order index")
    error: float = column("1", "how far that index may be off, 95 %")
    rise: float = column("1", "change of the share where the number alone goes to its upper end: the half, signed")

    @property
    def uncertainty(self) -> float:
        """Half of the 95 % interval of ``half``: a square's relative error is twice its root's."""
        return 0.5 * self.half * self.error / self.variance if self.variance > 0.0 else self.half

    @property
    def tells(self) -> bool:
        """Whether how far the number moves the share is twice what that is known to, or more."""
        return 2.0 * self.uncertainty <= self.half

    @property
    def points(self) -> str:
        """The half with its own 95 % interval, in points."""
        low, high = max(0.0, self.half - self.uncertainty), self.half + self.uncertainty
        return f"{100 * self.half:.2g} ({100 * low:.2g} to {100 * high:.2g})"


@dataclass(frozen=True, kw_only=True)
class InputSummary(Number):
    """A number of the scene that is not known exactly, as it was drawn."""

    unit: str = column("", "unit of the number and its interval")
    why: str = column("", "what the interval rests on")

    @classmethod
    def of(cls, unknown: Unknown) -> Self:
        """An unknown with its interval."""
        return cls(unknown.value, *unknown.ends, unit=unknown.unit, why=unknown.why)


@dataclass(frozen=True)
class JointSource:
    """A source of error in the joint answer."""

    name: str = column("", "name as in the budget; lack of fit: of the response to the inputs, between the flown draws")
    computing: bool = column("", "whether finer computing makes it smaller")
    bounded: bool = column("", "whether only its bounds are known")
    shared: bool = column("", "whether its draw is the same in every run")
    together: bool = column("", "whether it moves all fractions by the same draw")


@dataclass(frozen=True)
class JointRecord:
    """What the arrays of joint.npz are of: some thousand joint draws of all shares, from which every interval is
    taken.
    """

    draws: int = column("1", "number of the draws")
    fractions: tuple[str, ...] = column("", "fractions in the order of the arrays")
    targets: dict[str, tuple[str, ...]] = column("", "bins where each fraction should land")
    inputs: tuple[str, ...] = column("", "keys of the inputs, in the order of the arrays")
    bins: tuple[str, ...] = column("", "bins in the order of the arrays; elsewhere comes last")
    on: dict[str, str] = column("", "side of the channel of each bin that lies on one")
    ends: dict[str, tuple[float, float]] = column("m", "from and to of the bins that lie on a side")
    images: Annotated[tuple[int, ...], Null(())] = column("", "place of each bin's mirror image; null without one")
    flow: float = column("kg/s", "mass flow of the feed")
    sources: tuple[JointSource, ...] = column("", "what adds to the shares beside the inputs")
    salt: str = column("", "what makes this run's draws of them its own")
    prices: Prices | None = optional("", "prices of the scene; left out of a scene without prices")


@dataclass(frozen=True)
class LandingResults:
    """What the landings of all granules amount to."""

    separation: Separation = column("", "the answer: with the granules' collisions where there is a `slab`")
    bracket: Annotated[dict[str, dict[str, dict[str, float]]], Null({})] = column(
        "1",
        "share by fraction, bin and wake, each granule alone, the answer's own wake last; null where the wakes are "
        "not compared",
    )
    budget: tuple[BudgetRow, ...] = column("", "the error of every share and landing place")
    without_collisions: Separation | None = optional(
        "", "answer of granules that meet no others; left out where the answer is that"
    )
    slab: CollisionSummary | None = optional("", "slab where granules meet; left out where granules fly alone")
    air_loading: dict[str, dict[str, LoadingEffect]] = optional(
        "1", "effect of the granules' force in the steady airflow by fraction and bin, each granule alone; left out "
        "where the air does not feel them", default=dict,
    )  # fmt: skip
    three_dimensions: dict[str, dict[str, Number]] = optional(
        "1", "share by fraction and bin in a run in three dimensions of the same machine, each granule alone, "
        "under the granules' force on the air where that was run; how far it is from the plane air's is in the "
        "interval; left out where there is none", default=dict,
    )  # fmt: skip
    inputs: dict[str, InputSummary] = optional(
        "", "numbers of the scene that are not known exactly, by key; left out where all are", default=dict
    )
    measure_next: dict[str, dict[str, dict[str, InputPart]]] = optional(
        "", "what each of them does to the share by fraction and bin, the largest first", default=dict
    )
    of_targets: dict[str, dict[str, InputPart]] = optional(
        "", "what each of them does to recovery.FRACTION and purity.BIN.FRACTION of targets, the 64 largest "
        "first", default=dict,
    )  # fmt: skip
    joint: JointRecord | None = optional("", "names of the ensemble in joint.npz")


class Standing(StrEnum):
    """Whether a limit is kept."""

    MET = "met"
    NOT_MET = "not met"
    OPEN = "open"

    @classmethod
    def of(cls, low: float, high: float, most: float) -> Standing:
        """Standing of a number whose interval ends at ``low`` and ``high`` and that is to be at most so much."""
        return cls.MET if high <= most else cls.NOT_MET if low > most else cls.OPEN


MET, NOT_MET, OPEN = Standing


@dataclass(frozen=True)
class Verdict:
    """What an answer says of one limit of its scene."""

    limit: str = column("", "what is limited: loss.FRACTION or dirt.BIN")
    most: float = column("1", "the limit")
    value: Number | None = column("1", "what the answer says of it; null where nothing lands in the bin")
    verdict: Standing = column("", "met: the whole interval is below the limit; not met: above; open: neither is known")
    decides: str = column("", "what would decide an open one; empty of the others")


WEIGHTY, MAX_NAMED = 0.1, 3  # part of the variance from which an unknown is named, and how many are


def weightiest(parts: Mapping[str, InputPart]) -> list[tuple[str, InputPart]]:
    """The unknowns that a share is known to depend most on, the largest first; none whose part may be chance."""
    return [(key, part) for key, part in parts.items() if part.variance >= WEIGHTY and part.tells][:MAX_NAMED]


def least_certain(landings: LandingResults) -> dict[str, tuple[str, dict[str, InputPart]]]:
    """The bin, by fraction, whose share the unknown numbers move most, and what each of them does, largest first."""
    return {
        name: max(places.items(), key=lambda item: sum(part.half**2 for part in item[1].values()))
        for name, places in landings.measure_next.items()
        if places
    }
