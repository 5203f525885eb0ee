"""What nobody knows exactly of a scene, and draws of it: each unknown with half of its 95 % interval and its source.

An unknown is one registered kind with everything it needs: where it is in a scene, how far off it may be, and how a
draw of it varies the run. One draw varies all of them at once, so that the interval over many draws holds what they do
together; numbers that fractions share, as the air's speed, are drawn once for all fractions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError, known
from ..core.number import Number
from ..core.quantities import say, split_quantity
from ..core.registry import Registry
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity
from ..laws.driven_jet import ENTRAINMENT
from ..laws.forces.records import SPIN_LIFT
from ..laws.lift import MAGNUS_RANGE
from ..laws.material import WET, Moisture, default_margins, materials
from ..laws.restitution import Restitution
from ..laws.turbulence import LIFETIME, LIFETIMES
from ..scene import Fraction, Scene
from ..scene.changes import GranuleVariation, Variation
from ..scene.uncertainty import SIGMAS as SIGMAS
from ..scene.uncertainty import correlation_of, margins_of, orders_of, said_of
from .airflow_choice import AirflowPlan
from .plan import Plan

Array = NDArray[np.float64]
MOST_COMMON = 0.95  # of a number's variance that others have too: what is left is its own; chosen
FARTHEST = 2.5  # standard deviations at which a draw is cut off: 1.2 % lie beyond
MIN_FACTOR = 1e-3  # a factor is no smaller, however wide its interval
PORTION = (0.0, 1.0)  # what a part of a whole can be
GIVEN = "given"
SPIN = "spin_lift"
DISPERSES = "dispersion"  # the force that the turbulence's unknowns act through


@dataclass(frozen=True)
class Unknown:
    """One number of a scene: its dotted ``key``, its ``value`` where it has one, ``low`` and ``high`` the distances
    (not negative) from it to the ends of the 95 % interval, its ``unit``, ``why``: what the interval rests on, the
    ``fraction`` whose alone it is (empty: of all), ``causes`` that others have too: each with its part of the standard
    deviation.
    """

    key: str
    kind: str
    value: float
    low: float
    high: float
    unit: str
    why: str
    fraction: str = ""
    causes: tuple[tuple[str, float], ...] = ()

    def at(self, z: float) -> float:
        """The number ``z`` standard deviations off."""
        return float(self.all_at(np.array(z)))

    def all_at(self, z: Array) -> Array:
        """The numbers ``z`` (N,) standard deviations off."""
        z = np.clip(z, -FARTHEST, FARTHEST)
        return np.asarray(self.value + z / SIGMAS * np.where(z > 0.0, self.high, self.low))

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its 95 % interval, none beyond what the number can be."""
        least, most = unknown_kinds[self.kind].span
        return max(self.value - self.low, least), min(self.value + self.high, most)


@dataclass(frozen=True)
class UnknownKind:
    """A kind of unknown: those of a scene under a plan (``acting_in``), how one that is ``Drawn`` varies a run
    (``vary``), whether it varies the air, between which numbers (``span``) every draw of it stays: what is drawn beyond
    is taken as the end; whether it is ``lateral``: the mirror image of a machine has it with the other sign.
    """

    acting_in: Callable[[Scene, Plan], Iterator[Unknown]]
    vary: Callable[[Drawn], Variation]
    of_air: bool = False
    span: tuple[float, float] = (0.0, math.inf)
    lateral: bool = False


@dataclass(frozen=True)
class Drawn:
    """The number ``x`` of an ``unknown`` of a ``scene`` under a ``plan``, in a draw that is ``made`` so far."""

    made: Variation
    unknown: Unknown
    x: float
    scene: Scene
    plan: Plan

    @property
    def factor(self) -> float:
        """The number over the unknown's value."""
        return max(self.x / self.unknown.value, MIN_FACTOR)

    @property
    def granules(self) -> GranuleVariation:
        """What the draw changes so far of the granules of the unknown's fraction."""
        return self.made.of(self.unknown.fraction)

    def with_granules(self, **changes: float) -> Variation:
        """The draw with something more changed of the granules of the unknown's fraction."""
        return self.made.with_granules(self.unknown.fraction, **changes)


unknown_kinds: Registry[UnknownKind] = Registry("unknown")


def unknowns(scene: Scene, plan: Plan) -> list[Unknown]:
    """Everything that is not known exactly of ``scene`` under ``plan``."""
    return [unknown for unknown in numbers(scene, plan) if unknown.low > 0.0 or unknown.high > 0.0]


def numbers(scene: Scene, plan: Plan) -> list[Unknown]:
    """All numbers of ``scene`` under ``plan``, with what is exact: an unknown that is off by nothing."""
    return [unknown for name in unknown_kinds for unknown in unknown_kinds[name].acting_in(scene, plan)]


def variation_at(scene: Scene, plan: Plan, known: Sequence[Unknown], z: Array) -> Variation:
    """The draw in which each unknown lies ``z`` (K,) standard deviations off."""
    made = Variation()
    for unknown, off in zip(known, z, strict=True):
        made = unknown_kinds[unknown.kind].vary(Drawn(made, unknown, unknown.at(float(off)), scene, plan))
    return made


def _unknown(
    scene: Scene, key: str, entry: str, value: float, unit: str, confidence: str = "all", fraction: str = ""
) -> Unknown:
    """The number at ``key``, as far off on either side as the scene says or by the default for the ``entry``."""
    margin, why = margins_of(scene.uncertainty).get(key), "the scene"
    causes: tuple[tuple[str, float], ...] = ()
    if margin is None:
        default = default_margins()[entry]
        how = "given without" if confidence == GIVEN else f"confidence {confidence},"
        margin = default.half(value, confidence, scene.width)
        why = f"default ({how} uncertainty; {default.status})"
        lot = (scene.fraction[fraction].material or "") if fraction and confidence != GIVEN else ""
        if lot and not math.isnan(half := materials[lot].half_of(entry)):
            margin, why = half * value / getattr(materials[lot], entry), f"material {lot}"
        causes = _causes(entry, lot, margin, default.of_plate(value), lambda how: default.half(value, how, scene.width))
    elif isinstance(margin, str):
        margin = 0.01 * known(split_quantity(margin))[0] * abs(value)
    return Unknown(key, entry, value, margin, margin, unit, why, fraction, causes)


Half = Callable[[str], float]  # of the 95 % interval of a number that is known with a confidence


def _causes(
    entry: str, lot: str, half: float, plate: float = 0.0, at: Half = lambda _: math.inf
) -> tuple[tuple[str, float], ...]:
    """Why numbers of several fractions are too large together, with its part of the standard deviation of one whose
    interval's half is ``half``: there is one ``plate``, which makes so much of it, and one ``lot`` of a material, whose
    number all that are of it have; nothing where it is not a material's.
    """
    shared = min(plate / half, math.sqrt(MOST_COMMON)) if half > 0.0 else 0.0
    of_plate = ((f"{entry} on the plate", shared),) if shared > 0.0 else ()
    rest = math.sqrt(MOST_COMMON - shared**2)
    quantity = {"size": "diameter", "inverse_inertia": "impact"}.get(entry, entry)
    lots = _lots(quantity, lot, half, at) if lot else ()
    return (*of_plate, *((f"{entry} of {material}", rest * part) for material, part in lots if part > 0.0))


def _lots(quantity: str, lot: str, half: float, at: Half) -> Iterator[tuple[str, float]]:
    """The materials that a number rests on, each with its part of the standard deviation: one that is "as wheat" is
    wheat's and how far it is off that, which makes its interval as much wider.
    """
    model = materials[lot].like(quantity)
    common = 0.0 if not model or half == 0.0 else min(1.0, at(materials[model].confidence_in(quantity)) / half)
    yield lot, math.sqrt(1.0 - common**2)
    if common > 0.0:
        yield from ((name, common * part) for name, part in _lots(quantity, model, common * half, at))


def _ranged(scene: Scene, key: str, number: Number, why: str) -> Unknown:
    """The ``number`` at ``key``, which brings its default interval with it; that rests on ``why``."""
    if key in scene.uncertainty:
        return _unknown(scene, key, key, number.value, "1")
    return Unknown(key, key, number.value, number.value - number.low, number.high - number.value, "1", why)


def half_of(scene: Scene, key: str, entry: str, value: float) -> float:
    """How far the number at ``key`` may be off, as the scene says or by the default for the ``entry``."""
    return _unknown(scene, key, entry, value, "1").high


# -- what a draw makes of a number -------------------------------------------------------------------------------------
def _factor_on(name: str) -> Callable[[Drawn], Variation]:
    """Varies ``name`` of a fraction's granules by the number's factor."""
    return lambda drawn: drawn.with_granules(**{name: drawn.factor})


def _vary_settling(drawn: Drawn) -> Variation:
    """Vary drag by the factor on its coefficient that makes the median granule fall so fast, in the standard air to
    which the same factor applies at a terminal velocity as much off.
    """
    return drawn.with_granules(drag=drawn.granules.drag * _drag(drawn, drawn.factor))


def _drag(drawn: Drawn, faster: float, size: float = 1.0, density: float = 1.0) -> float:
    """The factor on the drag of a fraction's granules with which the median one falls ``faster``, where its ``size``
    and ``density`` are others too; all are factors.
    """
    how, fraction = drawn.plan.fractions[drawn.unknown.fraction], drawn.scene.fraction[drawn.unknown.fraction]
    granule, law = fraction.properties, (*STANDARD_AIR, GRAVITY, how.drag, fraction.roundness)
    before, after = (
        float(drag_factor_for_terminal_velocity(d * granule.diameter, rho * granule.density, v * speed, *law))
        for speed in [known(how.terminal_velocity)]
        for d, rho, v in ((1.0, 1.0, 1.0), (size, density, faster))
    )
    return after / before


def _vary_size(drawn: Drawn) -> Variation:
    """Vary the size on top of what water makes of it."""
    return drawn.with_granules(size=drawn.granules.size * drawn.factor)


def _vary_density(drawn: Drawn) -> Variation:
    """Vary the density; where the terminal velocity is known of itself, drag goes with it."""
    kept = 1.0 if drawn.scene.fraction[drawn.unknown.fraction].measured_settling is None else drawn.factor
    return drawn.with_granules(density=drawn.factor, drag=drawn.granules.drag * kept)


def _vary_moisture(drawn: Drawn) -> Variation:
    """What was measured of the material at both ends, where the scene gives no number of its own for it."""
    scene, plan, name, base = drawn.scene, drawn.plan, drawn.unknown.fraction, drawn.granules
    fraction = scene.fraction[name]
    wet = _water(fraction)
    moved = dict.fromkeys(WET, 1.0) | {
        key: wet.factor(key, drawn.x) / wet.factor(key, drawn.unknown.value)
        for key in _moved_by_water(scene, plan, name)
    }
    size, density, faster, friction = (moved[key] for key in WET)
    timed = None not in (fraction.measured_settling, plan.fractions[name].terminal_velocity)
    drag = _drag(drawn, faster, size, density) if timed and _has_air(scene, plan) else 1.0
    return drawn.with_granules(
        size=base.size * size, density=base.density * density, friction=base.friction * friction, drag=base.drag * drag
    )


def _moved_by_water(scene: Scene, plan: Plan, name: str) -> list[str]:
    """The quantities of a fraction that its moisture changes: those of its material that the scene does not give."""
    fraction = scene.fraction[name]
    given = {"diameter": fraction.size, "density": fraction.density, "friction": fraction.friction}
    wet = _water(fraction)
    return [
        key for key in wet.ends if (_settles(scene, plan, name) if key == "terminal_velocity" else given[key] is None)
    ]


NO_WATER = Moisture((0.0, 1.0), "", {})


def _water(fraction: Fraction) -> Moisture:
    """What water does to a fraction's material; NO_WATER where that was not measured."""
    measured = materials[fraction.material].moisture if fraction.material else None
    return measured or NO_WATER


def _settles(scene: Scene, plan: Plan, name: str) -> bool:
    """Whether the granules of a fraction fall as its material's do, in air."""
    given, here = scene.fraction[name].terminal_velocity, plan.fractions[name].terminal_velocity
    return _has_air(scene, plan) and given is None and here is not None


# -- of a fraction -----------------------------------------------------------------------------------------------------


def _how_known(fraction: Fraction, _name: str) -> str:
    """How well it is known how granules turn: as their material's impact model is, or given."""
    given = fraction.impact or fraction.own_inertia
    return GIVEN if given or not fraction.material else materials[fraction.material].evidence["impact"].confidence


def _add_of_fractions(
    entry: str,
    unit: str,
    value: Callable[[Fraction], float],
    vary: Callable[[Drawn], Variation],
    confidence: Callable[[Fraction, str], str] = Fraction.confidence_in,
    span: tuple[float, float] = UnknownKind.span,
    acts: Callable[[Scene, Plan], bool] = lambda _scene, _plan: True,
) -> None:
    """Register an unknown of every fraction whose ``value`` is above 0, under its own name in a scene, where it
    ``acts``.
    """

    def acting_in(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        for name in plan.fractions if acts(scene, plan) else ():
            fraction = scene.fraction[name]
            number, key = value(fraction), f"fraction.{name}.{entry}"
            if number > 0.0:
                yield _unknown(scene, key, entry, number, unit, confidence(fraction, entry), name)

    unknown_kinds.add(entry, UnknownKind(acting_in, vary, span=span))


def _restitution(fraction: Fraction) -> float:
    restitution = fraction.properties.restitution
    return float(restitution(np.ones(1))[0]) if isinstance(restitution, Restitution) else float(restitution)


def _inverse_inertia(fraction: Fraction) -> float:
    """m r^2 / I; 0 of granules that do not turn."""
    return 1.0 / fraction.inertia


def _settling(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """Terminal velocities, in the scene's own air; in a vacuum nothing settles."""
    for name, how in plan.fractions.items():
        fraction, value = scene.fraction[name], how.terminal_velocity
        if value is None or not _has_air(scene, plan):
            continue
        if value > 0.0 and fraction.properties.density > STANDARD_AIR[0]:  # what rises has no drag calibrated to that
            key, confidence = f"fraction.{name}.terminal_velocity", fraction.confidence_in("terminal_velocity")
            yield _unknown(scene, key, "terminal_velocity", value, "m/s", confidence, name)


METER = 0.01  # share of water to which a moisture that a scene gives is known, 95 %: a usual meter's; chosen


def _moistures(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """The share of water of each fraction whose numbers were measured by it, over all that was measured: what follows
    it moves together.
    """
    for name in plan.fractions:
        fraction, key = scene.fraction[name], f"fraction.{name}.moisture"
        wet = _water(fraction)
        if _moved_by_water(scene, plan, name):
            share = fraction.moisture or wet.middle
            causes = _causes("moisture", fraction.material, METER)
            if key in scene.uncertainty:
                yield _unknown(scene, key, "moisture", share, "1", fraction=name)
            elif fraction.moisture:
                why = "a moisture meter (chosen)"
                yield Unknown(key, "moisture", share, METER, METER, "1", why, name, causes)
            else:
                half, why = wet.share[1] - wet.middle, "measured range (laws/materials.toml)"
                yield Unknown(key, "moisture", wet.middle, half, half, "1", why, name, causes)


def _spin_lift(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """The coefficient of spin lift, of all fractions that have it."""
    if any(SPIN_LIFT.name in how.forces for how in plan.fractions.values()):
        yield _ranged(scene, SPIN, Number(1.0, *MAGNUS_RANGE), "measured lifts (laws/lift.py)")


def _vary_spin_lift(drawn: Drawn) -> Variation:
    made = drawn.made
    for name in drawn.plan.fractions:
        made = made.with_granules(name, spin_lift=drawn.factor)
    return made


def _has_air(scene: Scene, plan: Plan) -> bool:
    """Whether granules fly in the scene's air."""
    return scene.air is not None and plan.airflow.kind != "none"


def _blows(scene: Scene, plan: Plan) -> bool:
    """Whether granules fly in air that moves."""
    return _has_air(scene, plan) and not scene.airstream.still


_add_of_fractions(
    "restitution", "1", _restitution, lambda drawn: drawn.with_granules(restitution=drawn.x - drawn.unknown.value),
    span=PORTION,
)  # fmt: skip
_add_of_fractions("friction", "1", lambda f: f.properties.friction, _factor_on("friction"))
_add_of_fractions("rebound_scatter", "rad", lambda f: f.properties.rebound_scatter, _factor_on("scatter"))
unknown_kinds.add("terminal_velocity", UnknownKind(_settling, _vary_settling))
_add_of_fractions("density", "kg/m3", lambda f: f.properties.density, _vary_density, acts=_has_air)
unknown_kinds.add("moisture", UnknownKind(_moistures, _vary_moisture, span=PORTION))
_add_of_fractions("size", "m", lambda f: f.properties.diameter, _vary_size)
_add_of_fractions("inverse_inertia", "1", _inverse_inertia, _factor_on("inverse_inertia"), _how_known)


# -- of the curtain and the air ----------------------------------------------------------------------------------------


def _of_scene(
    key: str,
    entry: str,
    unit: str,
    value: Callable[[Scene], float],
    acts: Callable[[Scene, Plan], bool] = lambda _scene, _plan: True,
) -> Callable[[Scene, Plan], Iterator[Unknown]]:
    """Finds the unknown at ``key`` where it ``acts``."""

    def acting_in(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        if acts(scene, plan):
            yield _unknown(scene, key, entry, value(scene), unit)

    return acting_in


def _fall(scene: Scene, _: Plan) -> Iterator[Unknown]:
    """The height of the feed, or the speed that is given instead."""
    start, unit = ("height", "m") if scene.feed.height else ("speed", "m/s")
    if value := getattr(scene.feed, start):
        yield _unknown(scene, f"feed.{start}", "feed_fall", value, unit)


def _vary_fall(drawn: Drawn) -> Variation:
    """A height goes as the square of the speed that it gives."""
    return replace(drawn.made, feed_fall=drawn.factor ** (1.0 if drawn.scene.feed.height else 2.0))


def _entrainment(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """How fast air that the granules alone drive draws in other air."""
    if plan.airflow.loaded and plan.airflow.kind == "analytic":
        yield _ranged(scene, "entrainment", ENTRAINMENT, "measured jets and plumes (laws/driven_jet.py)")


def _vary_entrainment(drawn: Drawn) -> Variation:
    """The speed of air under a uniform force goes with its inverse root."""
    return drawn.made.with_air(speed=drawn.made.air.speed * drawn.factor**-0.5)


def _disperses(scene: Scene, plan: Plan) -> bool:
    """Whether turbulence disperses any granules."""
    return _has_air(scene, plan) and any(DISPERSES in how.forces for how in plan.fractions.values())


def _dispersion(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """How long the eddies live that disperse granules, over the law's own."""
    if _disperses(scene, plan):
        low, high = (end / LIFETIME for end in LIFETIMES)
        yield _ranged(scene, DISPERSES, Number(1.0, low, high), "lifetimes in use (laws/turbulence.py)")


def _brings_eddies(scene: Scene, plan: Plan) -> bool:
    """Whether turbulence that the air brings disperses any granules."""
    return _blows(scene, plan) and _disperses(scene, plan)


def _add_of_wake(name: Literal["theta", "strength"]) -> None:
    """Register theta or the strength of a best estimate's wake, with the range that its measurements leave."""

    def acting_in(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        airflow: AirflowPlan = plan.airflow
        if airflow.wake and airflow.brackets:
            yield _ranged(scene, f"wake.{name}", getattr(airflow.wake, name), "measured wakes (laws/wakes.toml)")

    def vary(drawn: Drawn) -> Variation:
        return drawn.made.with_air(**{name: min(max(drawn.x, 0.0), 1.0)})

    unknown_kinds.add(f"wake.{name}", UnknownKind(acting_in, vary, of_air=True, span=PORTION))


unknown_kinds.add(SPIN, UnknownKind(_spin_lift, _vary_spin_lift))
unknown_kinds.add("feed_width", UnknownKind(
    _of_scene("feed.width", "feed_width", "m", lambda scene: scene.feed.width),
    lambda drawn: replace(drawn.made, feed_width=drawn.factor),
))  # fmt: skip
unknown_kinds.add("feed_position", UnknownKind(
    _of_scene("feed.position", "feed_position", "m", lambda scene: scene.feed.position),
    lambda drawn: replace(drawn.made, feed_shift=drawn.x - drawn.unknown.value),
    span=(-math.inf, math.inf), lateral=True,
))  # fmt: skip
unknown_kinds.add("feed_fall", UnknownKind(_fall, _vary_fall))
unknown_kinds.add("air_speed", UnknownKind(
    _of_scene("air.speed", "air_speed", "m/s", lambda scene: scene.airstream.speed, _blows),
    lambda drawn: drawn.made.with_air(speed=drawn.factor), of_air=True,
))  # fmt: skip
unknown_kinds.add("entrainment", UnknownKind(_entrainment, _vary_entrainment, of_air=True))
unknown_kinds.add("air_turbulence", UnknownKind(
    _of_scene("air.turbulence", "air_turbulence", "1", lambda scene: scene.airstream.turbulence, _brings_eddies),
    lambda drawn: drawn.made.with_air(energy=drawn.factor**2), of_air=True,
))  # fmt: skip
unknown_kinds.add(
    DISPERSES, UnknownKind(_dispersion, lambda drawn: drawn.made.with_air(lifetime=drawn.factor), of_air=True)
)
_add_of_wake("theta")
_add_of_wake("strength")


# -- How the unknowns depend on each other: what moves together, and what is never above another -----------------------


@dataclass(frozen=True)
class Dependence:
    """The ``correlation`` (K, K) of the ``unknowns`` (K), and each pair of numbers of which the first is never above
    the second, ``orders``: either may be exact.
    """

    unknowns: tuple[Unknown, ...]
    correlation: Array
    orders: tuple[tuple[Unknown, Unknown], ...] = ()

    @property
    def of_air(self) -> NDArray[np.bool_]:
        """Which unknowns (K,) are the air's, shared by several draws."""
        return np.array([unknown_kinds[unknown.kind].of_air for unknown in self.unknowns], dtype=bool)

    def joined(self, xi: Array) -> Array:
        """Independent standard normal numbers ``xi`` (N, K) as standard normal ones that move together; those of the
        air by each other alone, so that they stay shared. Without any correlation ``xi`` itself.
        """
        tied = np.count_nonzero(self.correlation) > len(self.unknowns)
        return correlated(xi, self.correlation, self.of_air) if tied else xi

    def kept(self, z: Array) -> NDArray[np.bool_]:
        """Which draws (N,), each unknown ``z`` (N, K) standard deviations off, keep to the orders."""
        column = {unknown.key: z[:, i] for i, unknown in enumerate(self.unknowns)}
        exact, kept = np.zeros(len(z)), np.ones(len(z), dtype=bool)
        for low, high in self.orders:
            kept &= low.all_at(column.get(low.key, exact)) <= high.all_at(column.get(high.key, exact))
        return kept

    def among(self, which: NDArray[np.bool_]) -> Dependence:
        """This dependence with the orders of ``which`` unknowns (K,) and exact numbers alone."""
        others = {unknown.key for unknown, kept in zip(self.unknowns, which, strict=True) if not kept}
        return replace(
            self, orders=tuple(pair for pair in self.orders if not others & {unknown.key for unknown in pair})
        )


def dependence(scene: Scene, plan: Plan, unknowns: Sequence[Unknown]) -> Dependence:
    """How the ``unknowns`` of ``scene`` under ``plan`` depend on each other: as the scene says of those that it names
    in any tie, the others by their common causes. Raises SceneError as :func:`orders`.
    """
    correlation = correlation_of(scene.uncertainty, [unknown.key for unknown in unknowns])
    said = said_of(scene.uncertainty)
    causes = [{} if unknown.key in said else dict(unknown.causes) for unknown in unknowns]
    every = sorted(set().union(*causes))
    parts = np.array([[part.get(cause, 0.0) for cause in every] for part in causes]).reshape(len(causes), len(every))
    common = parts @ parts.T
    np.fill_diagonal(common, 0.0)
    return Dependence(tuple(unknowns), correlation + common, orders(scene, plan))


def orders(scene: Scene, plan: Plan) -> tuple[tuple[Unknown, Unknown], ...]:
    """Each pair of numbers that act under ``plan`` of which the first is never above the second.

    Raises SceneError where the scene's own first number is above the second.
    """
    pairs = orders_of(scene.uncertainty)
    acting = {unknown.key: unknown for unknown in numbers(scene, plan)} if pairs else {}
    acting_pairs = tuple((acting[low], acting[high]) for low, high in pairs if low in acting and high in acting)
    for low, high in acting_pairs:
        if low.value > high.value:
            first, second = (f"{unknown.key} = {say(unknown.value, unknown.unit, 4)}" for unknown in (low, high))
            raise SceneError(f"uncertainty.never_above: {first} is above {second}; change one, or leave this order out")
    return acting_pairs


def correlated(xi: Array, covariance: Array, first: NDArray[np.bool_]) -> Array:
    """Independent standard normal numbers ``xi`` (N, K) as numbers with a ``covariance`` (K, K). Those that are
    ``first`` (K,) go with each other alone: what several rows have in common of them, they have in common still.
    """
    order = np.argsort(~first, kind="stable")
    drawn = np.empty_like(xi)
    drawn[:, order] = xi[:, order] @ np.linalg.cholesky(covariance[np.ix_(order, order)]).T
    return drawn
