"""One draw of everything that is unknown: what it changes of the granules, of the air, of the curtain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from .scene import Scene

ONE = 1.0


@dataclass(frozen=True)
class GranuleVariation:
    """What a draw changes of a fraction's granules: added to the restitution, factors on the rest. ``drag``: on the
    drag coefficient; ``size``: on the diameter; ``density``: on the density; ``inverse_inertia``: on m r^2 / I, how
    easily a blow turns it; ``spin_lift``: on the coefficient of its spin lift.
    """

    restitution: float = 0.0
    friction: float = ONE
    scatter: float = ONE
    drag: float = ONE
    size: float = ONE
    density: float = ONE
    inverse_inertia: float = ONE
    spin_lift: float = ONE


@dataclass(frozen=True)
class AirVariation:
    """What a draw changes of the air: factors on its ``speed``, on the ``energy`` of its turbulence, on the
    ``lifetime`` of the eddies; ``theta`` and ``strength`` of the wake instead of the plan's (None: the plan's).
    """

    speed: float = ONE
    energy: float = ONE
    lifetime: float = ONE
    theta: float | None = None
    strength: float | None = None


@dataclass(frozen=True)
class Variation:
    """One draw: of the granules by fraction, of the air, of the curtain (factors on its width and on the height that it
    has fallen, a shift in m).
    """

    granules: Mapping[str, GranuleVariation] = field(default_factory=dict)
    air: AirVariation = AirVariation()
    feed_width: float = ONE
    feed_shift: float = 0.0
    feed_fall: float = ONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "granules", MappingProxyType(dict(self.granules)))

    def of(self, name: str) -> GranuleVariation:
        """What changes of fraction ``name``."""
        return self.granules.get(name, GranuleVariation())

    def with_granules(self, name: str, **changes: float) -> Variation:
        """The same draw with something more changed of fraction ``name``."""
        return replace(self, granules={**self.granules, name: replace(self.of(name), **changes)})

    def with_air(self, **changes: float) -> Variation:
        """The same draw with something more changed of the air."""
        return replace(self, air=replace(self.air, **changes))

    def fed(self, scene: Scene) -> Scene:
        """The scene with the curtain and the air's speed of this draw."""
        feed = scene.feed
        changed = {"width": feed.width * self.feed_width, "position": feed.position + self.feed_shift}
        if feed.height:
            changed["height"] = feed.height * self.feed_fall
        if feed.speed is not None:
            changed["speed"] = feed.speed * math.sqrt(self.feed_fall)
        feed = feed.model_copy(update=changed)
        air = scene.air and scene.air.model_copy(update={"speed": scene.air.speed * self.air.speed})
        return scene.model_copy(update={"feed": feed, "air": air})


AS_GIVEN = Variation()  # the scene's own numbers
