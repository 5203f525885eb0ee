"""Granules: what is tracked."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import numbers, truths, whole
from ..core.errors import SceneError
from ..core.tables import AnyArray
from ..laws.flake import SPREAD
from ..laws.restitution import Restitution

Array = NDArray[np.float64]
ALLOWED: dict[str, tuple[str, Callable[[Array], Any]]] = {  # name: (what it may be, in words; test)
    "diameter": ("positive", lambda x: x > 0),
    "density": ("positive", lambda x: x > 0),
    "sphericity": ("above 0 and at most 1", lambda x: (x > 0) & (x <= 1)),
    "restitution": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "friction": ("not negative", lambda x: x >= 0),
    "scatter": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "tangential_restitution": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "capture_speed": ("not negative", lambda x: x >= 0),
    "sticks": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "spin": ("finite", lambda x: x == x),
    "weight": ("not negative", lambda x: x >= 0),
    "drag_scale": ("positive", lambda x: x > 0),
    "time": ("finite", lambda x: x == x),
    "spin_lift": ("not negative", lambda x: x >= 0),
    "inertia": ("positive", lambda x: x > 0),
    "shape": ("positive", lambda x: x > 0),
}
ENDLESS = ("inertia", "capture_speed")  # may be inf: a point mass, and any speed
VECTORS = {"position": 2, "velocity": 2, "shape": 3, "arrival": 2}  # how many numbers each granule has
KINDS: dict[str, Callable[[str, ArrayLike], AnyArray]] = {"fraction": whole, "flake": truths}  # of no real numbers
UNITS = {
    "position": "m", "velocity": "m/s", "diameter": "m", "density": "kg/m^3", "spin": "rad/s", "time": "s",
    "scatter": "rad", "capture_speed": "m/s", "depth": "m", "arrival": "m/s",
}  # fmt: skip


def _sound(name: str, values: ArrayLike, count: int) -> AnyArray:
    """The array of a property of ``count`` granules. Raises SceneError for values that it cannot have."""
    if name in KINDS:
        return _shaped(name, KINDS[name](f"granule {name}", values), (count,))
    array = numbers(f"granule {name}", values, UNITS.get(name, "1"))
    array = _shaped(name, array, (count, VECTORS[name]) if name in VECTORS else (count,))
    if name not in ENDLESS:
        _refuse(name, array, ~np.isfinite(array), "finite")
    if name in ALLOWED:
        allowed, test = ALLOWED[name]
        _refuse(name, array, ~test(array), allowed)
    return array


def _shaped(name: str, values: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    try:
        return np.array(np.broadcast_to(values, shape), order="C")
    except ValueError:
        raise SceneError(f"granule {name}: shape {values.shape} does not fit {shape}") from None


def _refuse(name: str, array: Array, bad: NDArray[np.bool_], allowed: str) -> None:
    if bad.any():
        off = bad if bad.ndim == 1 else bad.any(axis=1)
        first = int(off.argmax())
        raise SceneError(
            f"granule {name}: {int(off.sum())} of {len(array)} must be {allowed}, first {array[first]} at index {first}"
        )


@dataclass(frozen=True, eq=False)
class Granules:
    """n granules: ``position`` (n, 2) m, ``velocity`` (n, 2) m/s; all else (n,) or one number for all. SI units.

    ``diameter`` that of the sphere of equal volume; ``spin`` rad/s, counter-clockwise positive; ``fraction`` index of
    the fraction; ``weight`` what a granule represents; ``drag_scale`` factor on the drag law (a calibrated terminal
    velocity), None: 1 / Cc, the slip of the finest dust in the gas that it flies in; ``restitution`` a number
    each, or one :class:`~wakeflow.laws.restitution.Restitution` law of the normal approach speed for all;
    ``inertia`` I / (m r^2), None or inf for a point mass; ``time`` s, when it is born;
    ``scatter`` rad, rms angle by which its shape turns the wall's normal at an impact (``laws.collision``);
    ``tangential_restitution`` part of its slip that a contact which sticks gives back (``laws.collision``);
    ``capture_speed`` m/s, of what comes to a wall with a slower normal velocity the part ``sticks`` stays there, 0:
    nothing does, inf: at any speed;
    ``spin_lift`` factor on the coefficient of its spin lift; ``shape`` (n, 3) length, width and thickness over the
    diameter, by which granules meet each other, 1: a ball; ``flake`` (n,): it is such a plate (``laws.flake``);
    ``depth`` m, its place across the slab, None: drawn evenly; ``arrival`` (n, 2) m/s, the velocity with
    which it came to the impact that it is born of, which the history force remembers, None: no impact. Raises
    SceneError, naming the count and the first index, for values that are not finite or out of range.
    """

    position: Array
    velocity: Array
    diameter: Any
    density: Any
    sphericity: Any = 1.0
    restitution: Any = 0.5
    friction: Any = 0.3
    spin: Any = 0.0
    fraction: Any = 0
    weight: Any = 1.0
    drag_scale: Any = None
    inertia: Any = None
    time: Any = 0.0
    scatter: Any = 0.0
    tangential_restitution: Any = 0.0
    capture_speed: Any = 0.0
    sticks: Any = 1.0
    spin_lift: Any = 1.0
    shape: Any = 1.0
    flake: Any = False
    depth: Any = None
    arrival: Any = None

    def __post_init__(self) -> None:
        position = numbers("granule position", self.position, "m")
        if position.ndim != 2 or position.shape[1] != 2:
            raise SceneError(f"granule position: shape {position.shape}, expected (n, 2)")
        object.__setattr__(self, "position", position)
        self._check(PROPERTIES)

    def _check(self, names: Iterable[str]) -> None:
        """Make an array of each of the properties ``names``, the diameter before what follows from it."""
        for name in names:
            given = self._given(name)
            if given is not None and not isinstance(given, Restitution):
                object.__setattr__(self, name, _sound(name, given, len(self.position)))

    def _given(self, name: str) -> Any:
        """A property as it was given; where it was not, what that means, None: nothing."""
        given = getattr(self, name)
        return np.inf if given is None and name == "inertia" else given

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, chosen: Any) -> Granules:
        """The chosen granules: a slice, indices or a mask."""
        if np.ndim(self.position[chosen]) != 2:
            raise SceneError(f"granules[{chosen!r}]: choose by a slice, indices or a mask")
        return self._unchecked({name: v[chosen] for name, v in vars(self).items() if isinstance(v, np.ndarray)})

    def replace(self, **changes: Any) -> Granules:
        """These granules with some properties replaced, which alone are checked where their number stays."""
        if np.shape(changes.get("position", self.position)) != self.position.shape or changes.keys() - set(PROPERTIES):
            return Granules(**(vars(self) | changes))
        made = self._unchecked(changes)
        made._check(name for name in PROPERTIES if name in changes)
        return made

    def _unchecked(self, changes: dict[str, Any]) -> Granules:
        """The granules with ``changes`` that are sound already: draws of the inputs take parts of very few granules
        hundreds of times, and checking all of each took longer than their flight.
        """
        made = object.__new__(Granules)
        for name, value in (vars(self) | changes).items():
            object.__setattr__(made, name, np.array(value, order="C") if isinstance(value, np.ndarray) else value)
        return made


PROPERTIES = tuple(f.name for f in fields(Granules))


def toss_of(grains: Granules) -> Array:
    """Rms spin that a normal impulse gives a flake (n,) 1/m (``laws.flake.flung``); 0 of others."""
    scale = np.sqrt(grains.shape[:, 0] * grains.shape[:, 1]) * grains.diameter
    return np.where(grains.flake, SPREAD / scale, 0.0)
