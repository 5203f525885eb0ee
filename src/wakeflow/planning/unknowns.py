"""What nobody knows exactly of a scene, and draws of it: each unknown with half of its 95 % interval and its source.

An unknown is one registered kind with everything it needs: where it stands in a scene, how far off it may be, and how a
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
from ..laws.material import default_margins, materials
from ..laws.restitution import Restitution
from ..scene import Fraction, Scene
from .airflow import AirflowPlan
from .plan import FractionPlan, Plan
from .variation import Variation

Array = NDArray[np.float64]
SIGMAS = 1.959964  # standard deviations to either end of a normal distribution's middle 95 %
FARTHEST = 2.5  # standard deviations at which a draw is cut off: 1.2 % lie beyond
LEAST = 1e-3  # a factor is no smaller, however wide its interval
PORTION = (0.0, 1.0)  # what a part of a whole can be
GIVEN = "given"
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


def _half(scene: Scene, key: str, entry: str, value: float, confidence: str) -> tuple[float, str]:
    """Half of the interval of the number at ``key``, as the scene says it or by default, and what it rests on."""
    own = scene.uncertainty.get(key)
    if own is None:
        default = default_margins()[entry]
        how = "given without" if confidence == GIVEN else f"confidence {confidence},"
        return default.half(value, confidence, scene.width), f"default ({how} uncertainty; {default.status})"
    if isinstance(own, str):
        parts = known(split_quantity(own))
        return 0.01 * parts[0] * abs(value), "the scene"
    return own, "the scene"


# -- of a fraction -----------------------------------------------------------------------------------------------------


def _confidence(fraction: Fraction, name: str) -> str:
    """How well a fraction's number is known: that of its material's, or given."""
    if getattr(fraction, name) is not None or fraction.material is None:
        return GIVEN
    material = materials[fraction.material]
    evidence = material.evidence.get(name)
    return material.confidence if evidence is None else evidence.confidence


def _of_fractions(
    entry: str,
    unit: str,
    value: Callable[[Fraction], float | None],
    confidence: Callable[[Fraction, str], str] = _confidence,
) -> Callable[..., Iterator[Unknown]]:
    """Finds one unknown a fraction, under its own name in a scene."""

    def found(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        for name in plan.fractions:
            fraction = scene.fraction[name]
            number, key = value(fraction), f"fraction.{name}.{entry}"
            if number is not None and number > 0.0:
                half, why = _half(scene, key, entry, number, confidence(fraction, entry))
                yield Unknown(key, entry, number, half, half, unit, why, name)

    return found


def _inverse_inertia(fraction: Fraction) -> float | None:
    """m r^2 / I of granules that turn."""
    return None if fraction.inertia is None else 1.0 / fraction.inertia


def _how_known(fraction: Fraction, name: str) -> str:
    """How well it is known how granules turn: as their material's impact model is, or given."""
    del name
    own = fraction.impact is not None or fraction.own_inertia is not None
    return GIVEN if own or fraction.material is None else materials[fraction.material].evidence["impact"].confidence


def _restitution(fraction: Fraction) -> float:
    own = fraction.properties.restitution
    return float(own(np.ones(1))[0]) if isinstance(own, Restitution) else float(own)


def _settling(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    """Terminal velocities, in the scene's own air; in a vacuum nothing settles."""
    for name, how in plan.fractions.items():
        if how.terminal_velocity is None or not _has_air(scene, plan):
            continue
        if how.terminal_velocity <= 0.0 or scene.fraction[name].properties.density <= STANDARD_AIR[0]:
            continue  # it rises: no drag is calibrated to that
        fraction, key, value = scene.fraction[name], f"fraction.{name}.terminal_velocity", how.terminal_velocity
        half, why = _half(scene, key, "terminal_velocity", value, _confidence(fraction, "terminal_velocity"))
        yield Unknown(key, "terminal_velocity", value, half, half, "m/s", why, name)


def _vary_settling(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
    """By the factor on the drag coefficient that makes the median granule fall so fast, in the standard air to which
    the same factor applies at a terminal velocity as much off.
    """
    how, granule = plan.fractions[known(one.fraction)], scene.fraction[known(one.fraction)].properties
    return made.with_granules(
        known(one.fraction), drag=_drag_factor(granule.diameter, granule.density, how, x / one.value)
    )


def _drag_factor(diameter: float, density: float, plan: FractionPlan, ratio: float) -> float:
    """Factor on the drag that changes the terminal velocity by the factor ``ratio``."""
    speeds = known(plan.terminal_velocity) * np.array([1.0, max(ratio, LEAST)])
    first, second = (
        float(drag_factor_for_terminal_velocity(diameter, density, speed, *STANDARD_AIR, GRAVITY, plan.drag))
        for speed in speeds
    )
    return second / first


def _of_granules(name: str) -> Callable[[Variation, Unknown, float, Scene, Plan], Variation]:
    """Varies a fraction's granules by the factor ``name``."""

    def vary(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
        del scene, plan
        return made.with_granules(known(one.fraction), **{name: max(x / one.value, LEAST)})

    return vary


def _vary_restitution(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
    del scene, plan
    return made.with_granules(known(one.fraction), restitution=x - one.value)


unknown_kinds.add(
    "restitution", UnknownKind(_of_fractions("restitution", "1", _restitution), _vary_restitution, span=PORTION)
)
unknown_kinds.add(
    "friction", UnknownKind(_of_fractions("friction", "1", lambda f: f.properties.friction), _of_granules("friction"))
)
unknown_kinds.add(
    "rebound_scatter",
    UnknownKind(
        _of_fractions("rebound_scatter", "rad", lambda f: f.properties.rebound_scatter), _of_granules("scatter")
    ),
)
unknown_kinds.add("terminal_velocity", UnknownKind(_settling, _vary_settling))
unknown_kinds.add(
    "size", UnknownKind(_of_fractions("size", "m", lambda f: f.properties.diameter), _of_granules("size"))
)
unknown_kinds.add(
    "inverse_inertia",
    UnknownKind(_of_fractions("inverse_inertia", "1", _inverse_inertia, _how_known), _of_granules("inverse_inertia")),
)


# -- of the curtain and the air ----------------------------------------------------------------------------------------


def _feed_width(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    del plan
    half, why = _half(scene, "feed.width", "feed_width", scene.feed.width, "all")
    yield Unknown("feed.width", "feed_width", scene.feed.width, half, half, "m", why)


def _feed_position(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    del plan
    half, why = _half(scene, "feed.position", "feed_position", scene.feed.position, "all")
    yield Unknown("feed.position", "feed_position", scene.feed.position, half, half, "m", why)


def _has_air(scene: Scene, plan: Plan) -> bool:
    """Whether granules fly in the scene's air."""
    return scene.air is not None and plan.airflow.kind != "none"


def _air_speed(scene: Scene, plan: Plan) -> Iterator[Unknown]:
    if _has_air(scene, plan):
        half, why = _half(scene, "air.speed", "air_speed", scene.airstream.speed, "all")
        yield Unknown("air.speed", "air_speed", scene.airstream.speed, half, half, "m/s", why)


def _of_turbulence(key: str, entry: str, value: Callable[[Scene], float]) -> Callable[..., Iterator[Unknown]]:
    """Finds an unknown of the turbulence, where it disperses any granules."""

    def found(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        if _has_air(scene, plan) and any(DISPERSES in how.forces for how in plan.fractions.values()):
            half, why = _half(scene, key, entry, value(scene), "all")
            yield Unknown(key, entry, value(scene), half, half, "1", why)

    return found


def _intensity(scene: Scene) -> float:
    return scene.airstream.turbulence


def _wake_number(name: str) -> Callable[..., Iterator[Unknown]]:
    """Finds theta or the strength of a best estimate's wake, with the range that its measurements leave."""

    def found(scene: Scene, plan: Plan) -> Iterator[Unknown]:
        airflow: AirflowPlan = plan.airflow
        if airflow.wake is None or not airflow.brackets:
            return
        own: Number = getattr(airflow.wake, name)
        key = f"wake.{name}"
        low, high, why = own.value - own.low, own.high - own.value, "measured wakes (laws/wakes.toml)"
        if key in scene.uncertainty:
            low, why = _half(scene, key, "", own.value, "all")
            high = low
        yield Unknown(key, key, own.value, low, high, "1", why)

    return found


def _vary_feed_width(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
    del scene, plan
    return replace(made, feed_width=max(x / one.value, LEAST))


def _vary_feed_position(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
    del scene, plan
    return replace(made, feed_shift=x - one.value)


def _of_the_air(name: str, number: Callable[[Unknown, float], float]) -> Callable[..., Variation]:
    """Varies the air's ``name`` to the ``number`` that an unknown's x means."""

    def vary(made: Variation, one: Unknown, x: float, scene: Scene, plan: Plan) -> Variation:
        del scene, plan
        return made.with_air(**{name: number(one, x)})

    return vary


def _factor(one: Unknown, x: float) -> float:
    return max(x / one.value, LEAST)


def _portion(_: Unknown, x: float) -> float:
    return min(max(x, 0.0), 1.0)


unknown_kinds.add("feed_width", UnknownKind(_feed_width, _vary_feed_width))
unknown_kinds.add("feed_position", UnknownKind(_feed_position, _vary_feed_position, span=(-math.inf, math.inf)))
for _name, _found, _vary in (
    ("air_speed", _air_speed, _of_the_air("speed", _factor)),
    (
        "air_turbulence",
        _of_turbulence("air.turbulence", "air_turbulence", _intensity),
        _of_the_air("energy", lambda one, x: _factor(one, x) ** 2),
    ),
    ("dispersion", _of_turbulence("dispersion", "dispersion", lambda _: 1.0), _of_the_air("lifetime", _factor)),
    ("wake.theta", _wake_number("theta"), _of_the_air("theta", _portion)),
    ("wake.strength", _wake_number("strength"), _of_the_air("strength", _portion)),
):
    unknown_kinds.add(
        _name, UnknownKind(_found, _vary, True, PORTION if _name.startswith("wake.") else UnknownKind.span)
    )
