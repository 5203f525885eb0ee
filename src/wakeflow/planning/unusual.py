"""Numbers that no machine has: most likely another unit was meant, or none was written."""

from __future__ import annotations

from collections.abc import Iterator

from ..core.graded import Notice, less_sure
from ..scene import Scene

__all__ = ["unusual_lines"]

AIRY = (0.1, 10.0)  # kg/m3: hot or thin air to heavy gases
FASTEST = 500.0  # Hz: no sieve or feeder shakes so fast; 3000 rpm are 50 Hz
LIGHTEST, HEAVIEST = 25.0, 23000.0  # kg/m3 of granules: foam beads, and no matter is denser


def unusual_lines(scene: Scene) -> Iterator[Notice]:
    """A notice of each number of the air, the vibration and the granules that is beyond what machines have."""
    air, vibration = scene.air, scene.vibration
    if air is not None and not AIRY[0] <= air.density <= AIRY[1]:
        yield less_sure(f"air.density = {air.density:.4g} kg/m3, of air about 1.2: unit forgotten? Check air.density")
    if vibration is not None and (often := vibration.frequency or 0.0) > FASTEST:
        yield less_sure(f"{often:.4g} Hz is faster than machines shake; vibration.frequency = '{often:.4g} rpm'?")
    for name, fraction in scene.fraction.items():
        density = float(fraction.properties.density)
        if scene.air is not None and density < scene.air.density <= AIRY[1]:
            why = f"lighter than the air ({scene.air.density:.3g}), so that it rises"
        elif not LIGHTEST <= density <= HEAVIEST:
            why = "lighter than foam" if density < LIGHTEST else "denser than any matter"
        else:
            continue
        meant = f" ('{density:.3g} g/cm3' if that was meant)" if density < LIGHTEST else ""
        yield less_sure(f"{name}: {density:.3g} kg/m3, {why}; check fraction.{name}.density{meant}")
