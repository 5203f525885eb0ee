"""What nobody knows exactly of a scene, and draws of it: each unknown with half of its 95 % interval and its source.

An unknown is one registered kind with everything it needs: where it is in a scene, how far off it may be, and how a
draw of it varies the run. One draw varies all of them at once, so that the interval over many draws holds what they do
together; numbers that fractions share, as the air's speed, are drawn once for all fractions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..core.number import Number
from ..core.quantities import split_quantity
from ..core.registry import Registry
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity
from ..laws.forces.lift import SPIN_LIFT
from ..laws.lift import MAGNUS_RANGE
from ..laws.material import default_margins, materials
from ..laws.restitution import Restitution
from ..scene import Fraction, Scene
from .airflow import AirflowPlan
from .plan import Plan
from .variation import Variation

Array = NDArray[np.float64]
SIGMAS = 1.959964  # standard deviations to either end of a normal distribution's middle 95 %
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
    ``fraction`` whose alone it is (None: of all).
    """

    key: str
    kind: str
    value: float
    low: float
    high: float
    unit: str
    why: str
    fraction: str | None = None

    def at(self, z: float) -> float:
        """The number ``z`` standard deviations off."""
        z = float(np.clip(z, -FARTHEST, FARTHEST))
        return self.value + z / SIGMAS * (self.high if z > 0.0 else self.low)

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its 95 % interval, none beyond what the number can be."""
        least, most = unknown_kinds[self.kind].span
        return max(self.value - self.low, least), min(self.value + self.high, most)


@dataclass(frozen=True)
class UnknownKind:
    """A kind of unknown: those of a scene under a plan (``found``), how a draw with the number ``x`` of one varies
    (``vary``), whether it varies the air, and between which numbers (``span``) every draw of it stays: what is drawn
    beyond is taken as the end.
    """

    found: Callable[[Scene, Plan], Iterator[Unknown]]
    vary: Callable[[Variation, Unknown, float, Scene, Plan], Variation]
    of_air: bool = False
    span: tuple[float, float] = (0.0, math.inf)


unknown_kinds: Registry[UnknownKind] = Registry("unknown")


def unknowns(scene: Scene, plan: Plan) -> list[Unknown]:
    """Everything that is not known exactly of ``scene`` under ``plan``."""
    found = (one for name in unknown_kinds for one in unknown_kinds[name].found(scene, plan))
    return [one for one in found if one.low > 0.0 or one.high > 0.0]


def variation_at(scene: Scene, plan: Plan, known: Sequence[Unknown], z: Array) -> Variation:
    """The draw in which each unknown lies ``z`` (K,) standard deviations off."""
    made = Variation()
    for one, off in zip(known, z, strict=True):
        made = unknown_kinds[one.kind].vary(made, one, one.at(float(off)), scene, plan)
    return made


def _unknown(
    scene: Scene, key: str, entry: str, value: float, unit: str, confidence: str = "all", fraction: str | None = None
) -> Unknown:
    """The number at ``key``, as far off on either side as the scene says or by the default for the ``entry``."""
    own, why = scene.uncertainty.get(key), "the scene"
    if own is None:
        default = default_margins()[entry]
        how = "given without" if confidence == GIVEN else f"confidence {confidence},"
        own = default.half(value, confidence, scene.width)
        why = f"default ({how} uncertainty; {default.status})"
    elif isinstance(own, str):
        own = 0.01 * known(split_quantity(own))[0] * abs(value)
    return Unknown(key, entry, value, own, own, unit, why, fraction)


# -- what a draw makes of a number -------------------------------------------------------------------------------------
Vary = Callable[[Variation, Unknown, float, Scene, Plan], Variation]


def _factor(one: Unknown, x: float) -> float:
    return max(x / one.value, MIN_FACTOR)


def _shift(one: Unknown, x: float) -> float:
    return x - one.value


def _portion(_: Unknown, x: float) -> float:
    return min(max(x, 0.0), 1.0)


def _of_granules(name: str, number: Callable[[Unknown, float], float] = _factor) -> Vary:
    """Varies ``name`` of a fraction's granules to the ``number`` that an unknown's x means."""
    return lambda made, one, x, _scene, _plan: made.with_granules(known(one.fraction), **{name: number(one, x)})


def _of_the_air(name: str, number: Callable[[Unknown, float], float] = _factor) -> Vary:
    """The same of the air."""
    return lambda made, one, x, _scene, _plan: made.with_air(**{name: number(one, x)})


def _vary_settling(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
    """By the factor on the drag coefficient that makes the median granule fall so fast, in the standard air to which
    the same factor applies at a terminal velocity as much off.
    """
    name = known(one.fraction)
    how, granule = plan.fractions[name], scene.fraction[name].properties
    own, other = (
        float(
            drag_factor_for_terminal_velocity(
                granule.diameter, granule.density, speed, *STANDARD_AIR, GRAVITY, how.drag
            )
        )
        for speed in known(how.terminal_velocity) * np.array([1.0, _factor(one, x)])
    )
    return made.with_granules(name, drag=other / own)


# -- of a fraction -----------------------------------------------------------------------------------------------------


def _confidence(fraction: Fraction, name: str) -> str:
    """How well a fraction's number is known: that of its material's, or given."""
    if getattr(fraction, name) is not None or fraction.material is None:
        return GIVEN
    material = materials[fraction.material]
    evidence = material.evidence.get(name)
    return material.confidence if evidence is None else evidence.confidence


def _how_known(fraction: Fraction, _name: str) -> str:
    """How well it is known how granules turn: as their material's impact model is, or given."""
    own = fraction.impact is not None or fraction.own_inertia is not None
    return GIVEN if own or fraction.material is None else materials[fraction.material].evidence["impact"].confidence


def _add_of_fractions(
    entry: str,
    unit: str,
    value: Callable[[Fraction], float | None],
    vary: Vary,
    confidence: Callable[[Fraction, str], str] = _confidence,
    span: tuple[float, float] = UnknownKind.span,
) -> None:
    """Register an unknown of every fraction, under its own name in a scene."""

    def found(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        for name in plan.fractions:
            fraction = scene.fraction[name]
            number, key = value(fraction), f"fraction.{name}.{entry}"
            if number is not None and number > 0.0:
                yield _unknown(scene, key, entry, number, unit, confidence(fraction, entry), name)

    unknown_kinds.add(entry, UnknownKind(found, vary, span=span))


def _restitution(fraction: Fraction) -> float:
    own = fraction.properties.restitution
    return float(own(np.ones(1))[0]) if isinstance(own, Restitution) else float(own)


def _inverse_inertia(fraction: Fraction) -> float | None:
    """m r^2 / I of granules that turn."""
    return None if fraction.inertia is None else 1.0 / fraction.inertia


def _settling(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """Terminal velocities, in the scene's own air; in a vacuum nothing settles."""
    for name, how in plan.fractions.items():
        fraction, value = scene.fraction[name], how.terminal_velocity
        if value is None or not _has_air(scene, plan):
            continue
        if (
            value > 0.0 and fraction.properties.density > STANDARD_AIR[0]
        ):  # else it rises: no drag is calibrated to that
            key, confidence = f"fraction.{name}.terminal_velocity", _confidence(fraction, "terminal_velocity")
            yield _unknown(scene, key, "terminal_velocity", value, "m/s", confidence, name)


def _spin_lift(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """The coefficient of spin lift, of all fractions that have it."""
    if not any(SPIN_LIFT.name in how.forces for how in plan.fractions.values()):
        return
    if SPIN in scene.uncertainty:
        yield _unknown(scene, SPIN, SPIN, 1.0, "1")
    else:
        low, high = MAGNUS_RANGE
        yield Unknown(SPIN, SPIN, 1.0, 1.0 - low, high - 1.0, "1", "measured lifts (laws/lift.py)")


def _vary_spin_lift(made: Variation, one: Unknown, x: float, _scene: Scene, plan: Plan) -> Variation:
    for name in plan.fractions:
        made = made.with_granules(name, spin_lift=_factor(one, x))
    return made


def _has_air(scene: Scene, plan: Plan) -> bool:
    """Whether granules fly in the scene's air."""
    return scene.air is not None and plan.airflow.kind != "none"


_add_of_fractions("restitution", "1", _restitution, _of_granules("restitution", _shift), span=PORTION)
_add_of_fractions("friction", "1", lambda f: f.properties.friction, _of_granules("friction"))
_add_of_fractions("rebound_scatter", "rad", lambda f: f.properties.rebound_scatter, _of_granules("scatter"))
unknown_kinds.add("terminal_velocity", UnknownKind(_settling, _vary_settling))
_add_of_fractions("size", "m", lambda f: f.properties.diameter, _of_granules("size"))
_add_of_fractions("inverse_inertia", "1", _inverse_inertia, _of_granules("inverse_inertia"), _how_known)


# -- of the curtain and the air ----------------------------------------------------------------------------------------


def _of_scene(
    key: str,
    entry: str,
    unit: str,
    value: Callable[[Scene], float],
    acts: Callable[[Scene, Plan], bool] = lambda _scene, _plan: True,
) -> Callable[[Scene, Plan], Iterator[Unknown]]:
    """Finds the unknown at ``key`` where it ``acts``."""

    def found(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        if acts(scene, plan):
            yield _unknown(scene, key, entry, value(scene), unit)

    return found


def _disperses(scene: Scene, plan: Plan) -> bool:
    """Whether turbulence disperses any granules."""
    return _has_air(scene, plan) and any(DISPERSES in how.forces for how in plan.fractions.values())


def _wake_number(name: str) -> Callable[[Scene, Plan], Iterator[Unknown]]:
    """Finds theta or the strength of a best estimate's wake, with the range that its measurements leave."""
    key = f"wake.{name}"

    def found(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        airflow: AirflowPlan = plan.airflow
        if airflow.wake is None or not airflow.brackets:
            return
        own: Number = getattr(airflow.wake, name)
        if key in scene.uncertainty:
            yield _unknown(scene, key, key, own.value, "1")
        else:
            why = "measured wakes (laws/wakes.toml)"
            yield Unknown(key, key, own.value, own.value - own.low, own.high - own.value, "1", why)

    return found


unknown_kinds.add(SPIN, UnknownKind(_spin_lift, _vary_spin_lift))
unknown_kinds.add("feed_width", UnknownKind(
    _of_scene("feed.width", "feed_width", "m", lambda scene: scene.feed.width),
    lambda made, one, x, _scene, _plan: replace(made, feed_width=_factor(one, x)),
))  # fmt: skip
unknown_kinds.add("feed_position", UnknownKind(
    _of_scene("feed.position", "feed_position", "m", lambda scene: scene.feed.position),
    lambda made, one, x, _scene, _plan: replace(made, feed_shift=_shift(one, x)),
    span=(-math.inf, math.inf),
))  # fmt: skip
unknown_kinds.add("air_speed", UnknownKind(
    _of_scene("air.speed", "air_speed", "m/s", lambda scene: scene.airstream.speed, _has_air),
    _of_the_air("speed"), of_air=True,
))  # fmt: skip
unknown_kinds.add("air_turbulence", UnknownKind(
    _of_scene("air.turbulence", "air_turbulence", "1", lambda scene: scene.airstream.turbulence, _disperses),
    _of_the_air("energy", lambda one, x: _factor(one, x) ** 2), of_air=True,
))  # fmt: skip
unknown_kinds.add("dispersion", UnknownKind(
    _of_scene("dispersion", "dispersion", "1", lambda _: 1.0, _disperses), _of_the_air("lifetime"), of_air=True
))  # fmt: skip
for _name in ("theta", "strength"):
    unknown_kinds.add(
        f"wake.{_name}", UnknownKind(_wake_number(_name), _of_the_air(_name, _portion), of_air=True, span=PORTION)
    )
