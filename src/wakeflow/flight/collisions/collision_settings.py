"""What granules do when they meet: ``wf.Collisions``."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import number, numbers
from ...core.errors import SceneError
from ..granules import Granules
from ..tracks import ClockStep

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Collisions:
    """Granules fly together and meet, in a slab of the machine that is periodic across the picture.

    ``depth`` of the slab (m), some ten to twenty diameters of the largest granules. Coefficients of ``restitution``,
    ``friction`` and ``tangential_restitution`` between granules: numbers, or symmetric tables (k, k) by ``fraction`` of
    the two. ``tracers`` are fractions too fine and too many to be simulated one by one: those that fly are a sample;
    the crowd can hit them, with the efficiency of impaction (:mod:`wakeflow.laws.impaction`), and does not notice, nor
    do they meet each other. ``forces``: those of each fraction among those of all; none: all. ``step`` (s) of the
    clock; None: as long as ``tolerance`` allows, found by flights of a sample (docs/model.md); ``measured`` hears
    it then, before the crowd flies. Raises SceneError for values out of range.
    """

    depth: float
    restitution: Any = 0.5
    friction: Any = 0.3
    tangential_restitution: Any = 0.0
    tracers: Sequence[int] = ()
    step: float | None = None
    measured: Callable[[ClockStep], object] | None = None
    forces: Sequence[Collection[str]] = ()

    def __post_init__(self) -> None:
        for name, unit in (("depth", "m"), ("step", "s")):
            if getattr(self, name) is None and name == "step":
                continue
            value = number(f"collisions: {name}", getattr(self, name), unit)
            if not (np.isfinite(value) and value > 0):
                raise SceneError(f"collisions: {name} = {value:g} must be positive and finite")
            object.__setattr__(self, name, value)
        for name, top in (("restitution", 1.0), ("friction", np.inf), ("tangential_restitution", 1.0)):
            values = numbers(f"collisions: {name}", getattr(self, name))
            if values.ndim not in (0, 2) or (values.ndim == 2 and values.shape[0] != values.shape[1]):
                raise SceneError(f"collisions: {name} of shape {values.shape}, expected a number or a table (k, k)")
            if not np.all((values >= 0) & (values <= top)):
                raise SceneError(f"collisions: {name} = {getattr(self, name)}: allowed 0 to {top:g}")
            if values.ndim == 2 and not np.array_equal(values, values.T):
                raise SceneError(f"collisions: {name} is not symmetric: two granules meet either way round")
            object.__setattr__(self, name, values)

    def tables(self, grains: Granules) -> tuple[Array, Array, Array]:
        """Restitution, friction and tangential restitution (k, k) for the fractions of ``grains``; raises SceneError
        where a table has too few of them, or the slab is thinner than a granule that others can hit.
        """
        most = int(grains.fraction.max(initial=0)) + 1
        if len(grains) and grains.fraction.min() < 0:
            raise SceneError("collisions: granule fraction: must not be negative")
        found = []
        for name in ("restitution", "friction", "tangential_restitution"):
            values = getattr(self, name)
            if values.ndim == 2 and len(values) < most:
                raise SceneError(f"collisions: {name} is a table of {len(values)} fractions, the granules have {most}")
            found.append(np.array(np.broadcast_to(values, (most, most)) if values.ndim == 0 else values, order="C"))
        solid = ~np.isin(grains.fraction, np.asarray(self.tracers, dtype=np.int64))
        thick = float(grains.diameter[solid].max(initial=0.0))
        if self.depth < thick:
            raise SceneError(
                f"collisions: depth = {self.depth:g} m is less than the largest granule, {thick:g} m: take ten of them"
            )
        return found[0], found[1], found[2]
