"""Granules: what is tracked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..laws.drag import slip_correction
from ..laws.flake import SPREAD
from ..laws.restitution import Restitution

Array = NDArray[np.float64]
SCALARS: dict[str, tuple[str, Callable[[Array], Any]]] = {  # name: (what it may be, in words; test)
    "diameter": ("positive", lambda x: x > 0),
    "density": ("positive", lambda x: x > 0),
    "sphericity": ("above 0 and at most 1", lambda x: (x > 0) & (x <= 1)),
    "restitution": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "friction": ("not negative", lambda x: x >= 0),
    "scatter": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "tangential_restitution": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "capture_speed": ("not negative", lambda x: x >= 0),
    "spin": ("finite", lambda x: x == x),
    "weight": ("not negative", lambda x: x >= 0),
    "drag_scale": ("positive", lambda x: x > 0),
    "time": ("finite", lambda x: x == x),
    "spin_lift": ("not negative", lambda x: x >= 0),
}


def _clean(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(np.broadcast_to(np.asarray(values, dtype=float), shape), order="C")
    except (TypeError, ValueError):
        raise SceneError(f"granule {name}: shape {np.shape(values)} does not fit {shape}") from None
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    _refuse(name, array, bad, "finite")
    return array


def _refuse(name: str, array: Array, bad: NDArray[np.bool_], allowed: str) -> None:
    if bad.any():
        first = int(bad.argmax())
        raise SceneError(
            f"granule {name}: {int(bad.sum())} of {len(array)} must be {allowed}, first {array[first]} at index {first}"
        )


@dataclass(frozen=True, eq=False)
class Granules:
    """n granules: ``position`` (n, 2) m, ``velocity`` (n, 2) m/s; all else (n,) or one number for all. SI units.

    ``diameter`` that of the sphere of equal volume; ``spin`` rad/s, counter-clockwise positive; ``fraction`` index of
    the fraction; ``weight`` what a granule represents; ``drag_scale`` factor on the drag law (a calibrated terminal
    velocity), None: 1 / Cc, the slip of the finest dust (``laws.drag.slip_correction``); ``restitution`` a number
    each, or one :class:`~wakeflow.laws.restitution.Restitution` law of the normal approach speed for all;
    ``inertia`` I / (m r^2), None or inf for a point mass; ``time`` s, when it is born;
    ``scatter`` rad, rms angle by which its shape turns the wall's normal at an impact (``laws.collision``);
    ``tangential_restitution`` part of its slip that a contact which sticks gives back (``laws.collision``);
    ``capture_speed`` m/s, what comes to a wall with a slower normal velocity stays there, 0: nothing does;
    ``spin_lift`` factor on the coefficient of its spin lift; ``shape`` (n, 3) length, width and thickness over the
    diameter, by which granules meet each other, 1: a ball; ``flake`` (n,): it is such a plate (``laws.flake``);
    ``depth`` m, its place across the slab of a crowd, None: drawn evenly; ``arrival`` (n, 2) m/s, the velocity with
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
    spin_lift: Any = 1.0
    shape: Any = 1.0
    flake: Any = False
    depth: Any = None
    arrival: Any = None

    def __post_init__(self) -> None:
        shape = np.shape(self.position)
        if len(shape) != 2 or shape[1] != 2:
            raise SceneError(f"granule position: shape {shape}, expected (n, 2)")
        for name in ("position", "velocity"):
            object.__setattr__(self, name, _clean(name, getattr(self, name), shape))
        for name, (allowed, test) in SCALARS.items():
            if isinstance(getattr(self, name), Restitution):
                continue
            array = _clean(name, self._given(name), shape[:1])
            _refuse(name, array, ~test(array), allowed)
            object.__setattr__(self, name, array)
        object.__setattr__(
            self, "fraction", np.array(np.broadcast_to(np.asarray(self.fraction, dtype=np.int64), shape[:1]))
        )
        inertia = np.inf if self.inertia is None else self.inertia
        inertia = np.array(np.broadcast_to(np.asarray(inertia, dtype=float), shape[:1]))
        _refuse("inertia", inertia, ~(inertia > 0), "positive")
        object.__setattr__(self, "inertia", inertia)
        object.__setattr__(self, "shape", _clean("shape", self.shape, (*shape[:1], 3)))
        _refuse("shape", self.shape, ~(self.shape > 0.0).all(axis=1), "positive")
        object.__setattr__(self, "flake", np.array(np.broadcast_to(np.asarray(self.flake, dtype=bool), shape[:1])))
        if self.depth is not None:
            object.__setattr__(self, "depth", _clean("depth", self.depth, shape[:1]))
        if self.arrival is not None:
            object.__setattr__(self, "arrival", _clean("arrival", self.arrival, shape))

    def _given(self, name: str) -> Any:
        slips = name == "drag_scale" and self.drag_scale is None  # after the diameter, which is checked by then
        return 1.0 / slip_correction(self.diameter) if slips else getattr(self, name)

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, chosen: Any) -> Granules:
        """The chosen granules: a slice, indices or a mask."""
        own: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        whole = {name: v for name, v in own.items() if v is not None and not isinstance(v, Restitution)}
        return self.replace(**{name: v[chosen] for name, v in whole.items()})

    def replace(self, **changes: Any) -> Granules:
        """The same granules with some properties replaced."""
        return Granules(**({f.name: getattr(self, f.name) for f in fields(self)} | changes))


def toss_of(grains: Granules) -> Array:
    """Rms spin that a normal impulse gives a flake (n,) 1/m (``laws.flake.flung``); 0 of others."""
    scale = np.sqrt(grains.shape[:, 0] * grains.shape[:, 1]) * grains.diameter
    return np.where(grains.flake, SPREAD / scale, 0.0)
