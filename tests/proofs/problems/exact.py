"""What an exact problem is, the registries of problems and numbers, and the meshes that they fly on.

A problem is one function that takes the fineness of the mesh and returns the setting (field, granules, walls, end) and
the exact answer. A number is what a whole ensemble of granules gives (an efficiency, a threshold), with the interval in
which the truth lies. What is registered is tested.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from support import without_slip
from wakeflow.air.field import FlowField
from wakeflow.core.registry import Registry
from wakeflow.flight import Granules, Tracks, track

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flow = Callable[[Array], Array]
DENSITY, VISCOSITY = 1.2, 1.8e-5  # kg/m3, Pa s: air at 20 C, rounded
G = 9.81  # m/s2
TAGS = frozenset({
    "affine",  # the air is linear in place: the mesh must not matter
    "curved",  # every face bends the track
    "time-dependent", "walls", "lines", "stiff", "ballistic", "nonlinear",
    "judged",  # no closed form: the answer is scipy's on the same interpolant (``reference_end_states``)
})  # fmt: skip


@dataclass(frozen=True, eq=False)
class Setting:
    """What is flown: ``field`` (None: vacuum), ``grains``, ``until`` (s) and further ``arguments`` of track."""

    field: FlowField | None
    grains: Granules
    until: float
    arguments: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Answer:
    """Where granules end: ``position`` (n, 2) m; and where the problem says so ``velocity`` (n, 2) m/s, ``time`` (n,)
    s, ``fate`` (n,) and ``spin`` (n,) rad/s.
    """

    position: Array
    velocity: Array | None = None
    time: Array | None = None
    fate: Any = None
    spin: Array | None = None


@dataclass(frozen=True, eq=False)
class ExactProblem:
    """``make(cells)`` gives setting and answer; ``order`` is that of the error in the step, None where the tracker's
    formula is exact; ``cells`` across the mesh by default; ``tags`` from TAGS and names of forces.
    """

    means: str
    source: str
    tags: frozenset[str]
    make: Callable[[int], tuple[Setting, Answer]]
    order: float | None = 3.0
    cells: int = 6

    @lru_cache(maxsize=128)  # noqa: B019 - registered problems live as long as the program
    def at(self, cells: int | None = None) -> tuple[Setting, Answer]:
        """Setting and answer on a mesh of ``cells`` across (default: the problem's own)."""
        return self.make(self.cells if cells is None else cells)

    @property
    def forces(self) -> tuple[str, ...]:
        """Names of the forces that the problem needs."""
        return tuple(sorted(self.tags - TAGS))


@dataclass(frozen=True, eq=False)
class ExactNumber:
    """``measure(tolerance)`` gives numbers (m,) that must lie between ``low`` and ``high`` (m,); ``exact`` (m,) where
    known; ``labels`` say what each belongs to.
    """

    means: str
    source: str
    tags: frozenset[str]
    measure: Callable[[float], Array]
    low: Array
    high: Array
    labels: tuple[str, ...]
    exact: Array | None = None

    @property
    def forces(self) -> tuple[str, ...]:
        """Names of the forces that the number needs."""
        return tuple(sorted(self.tags - TAGS))


exact_problems: Registry[ExactProblem] = Registry("exact problem")
exact_numbers: Registry[ExactNumber] = Registry("exact number")


def problem(
    name: str, means: str, source: str, tags: str, order: float | None = 3.0, cells: int = 6
) -> Callable[[Callable[[int], tuple[Setting, Answer]]], Callable[[int], tuple[Setting, Answer]]]:
    """Decorator that registers a function ``make(cells) -> (Setting, Answer)``; ``tags`` are words with spaces
    between.
    """

    def add(make: Callable[[int], tuple[Setting, Answer]]) -> Callable[[int], tuple[Setting, Answer]]:
        exact_problems.add(name, ExactProblem(means, source, frozenset(tags.split()), make, order, cells))
        return make

    return add


def fly(setting: Setting, tolerance: float, **more: Any) -> Tracks:
    """Track a setting; ``more`` arguments of track replace those of the setting."""
    arguments = dict(setting.arguments) | more
    return track(setting.field, setting.grains, until=setting.until, tolerance=tolerance, **arguments)


@lru_cache(maxsize=64)
def accepts(force: str) -> bool:
    """Whether the tracker computes a force."""
    from wakeflow.core.errors import SceneError

    nobody = without_slip(np.zeros((0, 2)), np.zeros((0, 2)), diameter=1.0, density=1.0)
    points, cells = box(1)
    air = FlowField.from_arrays(
        points, cells, 0 * points, pressure=points[:, 0], k=np.ones(len(points)), dissipation=np.ones(len(points))
    )
    try:
        track(air, nobody, until=1.0, forces=(force,))
    except SceneError:
        return False
    return True


# -- granules and meshes -----------------------------------------------------------------------------------------------


def of_tau(tau: ArrayLike, position: ArrayLike, velocity: ArrayLike, density: float = 1000.0, **more: Any) -> Granules:
    """Granules whose Stokes relaxation time in the air of ``field_on`` is ``tau`` (s)."""
    diameter = np.sqrt(18 * VISCOSITY * np.asarray(tau, dtype=float) / density)
    return without_slip(position, velocity, diameter=diameter, density=density, **more)  # type: ignore[arg-type]


def box(
    cells: int, low: ArrayLike = (-1.0, -1.0), high: ArrayLike = (1.0, 1.0), jitter: float = 0.2, seed: int = 1
) -> tuple[Array, Index]:
    """Nodes and triangles of a rectangle, ``cells`` squares along each side cut by alternating diagonals.

    Inner nodes are moved at random by up to ``jitter`` of a square (below 0.25 no triangle turns over; 0: regular).
    """
    line = np.arange(cells + 1)
    lattice = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2).astype(float)
    inner = np.all((lattice > 0) & (lattice < cells), axis=1)
    lattice[inner] += np.random.default_rng(seed).uniform(-jitter, jitter, (int(inner.sum()), 2))
    column, row = (a.ravel() for a in np.meshgrid(np.arange(cells), np.arange(cells)))
    a = row * (cells + 1) + column
    b, c, d = a + 1, a + cells + 2, a + cells + 1
    even = ((row + column) % 2 == 0)[:, None]
    first = np.where(even, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(even, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    start, end = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return start + lattice / cells * (end - start), np.concatenate([first, second])


def ring(radii: ArrayLike, angles: ArrayLike) -> tuple[Array, Index]:
    """Nodes and triangles between circles of given ``radii`` (k,) m over ``angles`` (m,) rad, both increasing."""
    r, theta = np.asarray(radii, dtype=float), np.asarray(angles, dtype=float)
    across, around = np.meshgrid(r, theta, indexing="ij")
    points = np.stack([across * np.cos(around), across * np.sin(around)], axis=-1).reshape(-1, 2)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(len(r) - 1), np.arange(len(theta) - 1), indexing="ij"))
    a = i * len(theta) + j
    b, c, d = a + len(theta), a + len(theta) + 1, a + 1
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def field_on(mesh: tuple[Array, Index], flow: Flow | ArrayLike, **more: Any) -> FlowField:
    """Air on a mesh; ``flow`` a function of the nodes (N, 2) or nodal velocities; ``more`` arguments of from_arrays."""
    points, cells = mesh
    velocity = flow(points) if callable(flow) else flow
    return FlowField.from_arrays(points, cells, velocity, **({"density": DENSITY, "viscosity": VISCOSITY} | more))
