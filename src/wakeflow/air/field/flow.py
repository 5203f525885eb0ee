"""FlowField: velocity and pressure on a triangle mesh, steady or in time; linear inside every triangle.

Three forms, told apart by what is given with the nodal arrays: nothing (steady), ``times`` (snapshots, between which
the field is linear in time; with a ``period`` it repeats, without one it stands still before the first and after the
last), or ``times``, ``period`` and ``coefficients`` (a mean and modes, whose functions of time are periodic cubic
splines).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any
from weakref import ref

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core import own_files
from ...core.arrays import number, numbers, truths, whole
from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.tables import load_arrays, save_arrays
from ...laws.gas import MEAN_FREE_PATH, PRESSURE, TEMPERATURE
from ...laws.gas import mean_free_path as path_in_gas
from .modes import AT_REST, KEPT_WHOLE, MIN_KNOTS, MeshOscillation, TimeAxis, Truncation, compress, design
from .triangles import VECTORS, Divergence, Triangles, divergence_of, double_area, gradient_operators, mirrored

Array = NDArray[np.float64]
EMPTY: Array = np.zeros(0)
STEADY: dict[str, Any] = {"times": EMPTY, "period": 0.0, "coefficients": EMPTY, "truncation": KEPT_WHOLE}
POSITIVE = ("k", "dissipation")
GAS = ("density", "viscosity", "temperature", "mean_free_path")
NODAL = ("velocity", "pressure", *POSITIVE, "given_gradient")  # the arrays with a value at every node
# Of their means: k and dissipation of a compressed field are no smaller. Chosen: a lifetime stays finite
MIN_TURBULENCE_RATIO = 0.05


def _empty() -> Array:
    return EMPTY


@dataclass(frozen=True, eq=False)
class FlowField(Triangles):
    """Arrays on N nodes and M triangles; SI units. Make one with :meth:`from_arrays` or :meth:`from_openfoam`.

    ``points`` (N, 2) m, ``triangles`` (M, 3) counter-clockwise, ``velocity`` (.., N, 2) m/s, ``pressure`` (.., N) Pa,
    ``k`` (.., N) m2/s2, ``dissipation`` (.., N) m2/s3, ``times`` (T,) s, ``density`` kg/m3, ``viscosity`` dynamic, Pa
    s, ``temperature`` K, ``mean_free_path`` of the gas's molecules m, 0 in a liquid. Nodal arrays have a leading axis T
    when ``times`` is given: the snapshots; or R, when ``coefficients`` (T, R) is given too: the mean and R - 1 modes,
    ``times`` being the splines' uniform knots, and ``truncation`` what was cut off. ``motion``: the mesh swings as a
    rigid whole, ``points`` being its middle position; velocities are absolute. What a field has not (:meth:`has`) is an
    empty array, a period of 0, a motion of 0.
    """

    velocity: Array
    pressure: Array = field(default_factory=_empty)
    times: Array = field(default_factory=_empty)
    period: float = 0.0
    k: Array = field(default_factory=_empty)
    dissipation: Array = field(default_factory=_empty)
    density: float = 1.2
    viscosity: float = 1.8e-5
    given_gradient: Array = field(default_factory=_empty)
    coefficients: Array = field(default_factory=_empty)
    motion: MeshOscillation = field(default_factory=lambda: AT_REST)
    truncation: Truncation = field(default_factory=lambda: KEPT_WHOLE)
    temperature: float = TEMPERATURE
    mean_free_path: float = MEAN_FREE_PATH

    @classmethod
    def from_arrays(
        cls,
        points: ArrayLike,
        triangles: ArrayLike,
        velocity: ArrayLike,
        pressure: ArrayLike | None = None,
        times: ArrayLike | None = None,
        period: float | None = None,
        k: ArrayLike | None = None,
        dissipation: ArrayLike | None = None,
        density: float | None = None,
        viscosity: float | None = None,
        pressure_gradient: ArrayLike | None = None,
        coefficients: ArrayLike | None = None,
        motion: ArrayLike | None = None,
        truncation: ArrayLike | None = None,
        walls: ArrayLike | None = None,
        temperature: float = TEMPERATURE,
        mean_free_path: float | None = None,
    ) -> FlowField:
        """A checked field; clockwise triangles are turned round. Shapes and units as in the class.

        ``pressure_gradient`` (.., N, 2) Pa/m replaces the one recovered from ``pressure``. ``walls`` (N,) tells which
        nodes lie on no-slip walls: whatever ``k`` says, it is 0 there. Those on the boundary whose air rests while
        other air moves are known without it. Density and viscosity are 1.2 and 1.8e-5 by default; ``mean_free_path``
        is then that of air, and 0 where one of them is given, so that fine granules do not slip; ``wakeflow.laws.gas``
        has that of other gases. Raises SceneError for wrong shapes, NaN, indices out of range, degenerate triangles,
        times that do not increase, a period shorter than the time they span, density, viscosity and temperature that
        are not positive, or a mean free path that is negative.
        """
        nodes = _points(points)
        cells = _cells(triangles, nodes)
        length = 0.0 if period is None else _period(period, timed=times is not None)
        clock = EMPTY if times is None else _times(times, length)
        parts = EMPTY if coefficients is None else _coefficients(coefficients, clock, length)
        lead = (*(parts.shape[1:] or clock.shape), len(nodes)) if len(clock) else (len(nodes),)
        given = (
            ("velocity", velocity, (*lead, 2), "m/s"), ("pressure", pressure, lead, "Pa"), ("k", k, lead, "m^2/s^2"),
            ("dissipation", dissipation, lead, "m^2/s^3"), ("pressure_gradient", pressure_gradient, (*lead, 2), "Pa/m"),
        )  # fmt: skip
        nodal: dict[str, Any] = {n: _of_shape(n, v, shape, unit) for n, v, shape, unit in given if v is not None}
        if walls is not None and "k" in nodal:
            nodal["k"][..., _flags("walls", walls, (len(nodes),))] = 0.0
        lost = KEPT_WHOLE if truncation is None else Truncation.from_array(_finite("truncation", truncation))
        field = cls(
            nodes, cells, times=clock, period=length, coefficients=parts, truncation=lost,
            given_gradient=nodal.pop("pressure_gradient", EMPTY), **nodal,
            **_gas(temperature, density=density, viscosity=viscosity, mean_free_path=mean_free_path),
        )  # fmt: skip
        return field if motion is None else field.moving(*_motion(motion))

    @classmethod
    def from_openfoam(
        cls, case_dir: Path | str, time: str | float = "latest", density: float | None = None
    ) -> FlowField:
        """Read an OpenFOAM case: one ``time`` ("latest" or s), "mean", or "all"; p becomes Pa with ``density`` (kg/m3).

        Without a density it is that of air, 1.2, and the mean free path is that of a gas of the case's viscosity; with
        one it is 0, as for :meth:`from_arrays`. Raises FoamError for a case that cannot be read, see
        :func:`wakeflow.air.foam.read_flow`.
        """
        from ..foam.read import read_flow

        flow = read_flow(Path(case_dir), time, 1.2 if density is None else density)
        path = path_in_gas(flow["density"], flow["viscosity"], TEMPERATURE, PRESSURE) if density is None else 0.0
        return cls.from_arrays(**flow, mean_free_path=path)

    def __getstate__(self) -> dict[str, Any]:
        """What a copy and another process get: nothing that was made on first use, such as a weak reference."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    # -- values ----------------------------------------------------------------------------------------------------

    def has(self, name: str) -> bool:
        """Whether there is what the class calls ``name``."""
        value = getattr(self, name)
        return value.size > 0 if isinstance(value, np.ndarray) else bool(value)

    @property
    def in_time(self) -> bool:
        """Whether the field is one in time."""
        return len(self.times) > 0

    @cached_property
    def pressure_gradient(self) -> Array:
        """Pressure gradient at the nodes (.., N, 2) Pa/m, second order up to the boundary; none without pressure."""
        if self.has("given_gradient") or not self.has("pressure"):
            return self.given_gradient
        along_x, along_y = gradient_operators(self.points, self.triangles)
        flat = np.atleast_2d(self.pressure).T
        gradient = np.stack([(along_x @ flat).T, (along_y @ flat).T], axis=-1)
        return np.ascontiguousarray(gradient.reshape(*self.pressure.shape, 2))

    @cached_property
    def time_axis(self) -> TimeAxis:
        """The field's functions of time."""
        return TimeAxis(self.times, self.period or np.inf, self.coefficients)

    def weights(self, t: float) -> Array:
        """The weight of each snapshot or part (R,) in the field at time ``t`` (s); a lone 1 when steady."""
        return self.time_axis.weights(number("t", t, "s"))

    def polynomial(self, t: float) -> tuple[float, float, Array]:
        """The piece of time from ``t`` (s) on in which the field is a polynomial: its origin and end (s), and the
        weights (P, R) of the snapshots or parts in the coefficient of each power of the time since the origin.
        """
        return self.time_axis.polynomial(t)

    def sample(self, x: ArrayLike, t: float = 0.0) -> tuple[Array, Array, Array]:
        """Velocity (n, 2), pressure (n,) and pressure gradient (n, 2) at points (n, 2) and time ``t``; NaN outside.

        The tracker's interpolant: linear in triangles, in time as the class says; in a moving mesh where it is then.
        """
        points, t = np.atleast_2d(numbers("x", x, "m")), number("t", t, "s")
        if self.motion:
            points = points - self.motion.displacement(t)
        triangle = self.locate(points)
        inside = triangle >= 0
        weight = self.barycentric(triangle[inside], points[inside])
        corner = self.triangles[triangle[inside]]
        shares = self.weights(t)

        velocity, pressure, gradient = (np.full((len(points), *shape), np.nan) for shape in ((2,), (), (2,)))
        parts = (self.velocity, self.pressure, self.pressure_gradient)
        for result, nodal in zip((velocity, pressure, gradient), parts, strict=True):
            if nodal.size:
                now = np.tensordot(shares, nodal, axes=1) if self.in_time else nodal
                result[inside] = np.einsum("nk,nk...->n...", weight, now[corner])
        return velocity, pressure, gradient

    def divergence(self) -> Divergence:
        """Divergence of the interpolated velocity in every triangle, and how large it is against U / h."""
        if self.has("coefficients"):
            return self.snapshots().divergence()
        return divergence_of(self, self.velocity)

    # -- other fields ----------------------------------------------------------------------------------------------

    def mean(self) -> FlowField:
        """The time mean as a steady field: trapezoidal rule over the snapshots, round the period if there is one."""
        return still(self, self.time_axis.mean_weights()) if self.in_time else self

    def compressed(self, error: float = 0.01, knots: int | None = None) -> FlowField:
        """Snapshots over a period as mean and modes with smooth functions of time; see :mod:`.modes`.

        ``error``: rms error of velocity and of pressure over the rms of their fluctuations; ``truncation`` says what it
        became, and what k and the dissipation lost. ``knots`` of the functions of time, as few as needed by default.
        Nodal values are rounded to single precision. Raises SceneError without a period or with fewer than eight
        snapshots. A field that is compressed already, or steady, comes back as it is.
        """
        if not self.in_time or self.has("coefficients"):
            return self
        axis = self.time_axis
        tried = range(MIN_KNOTS, len(axis.times) + 1) if knots is None else [knots]
        parts, coefficients, lost = compress(axis, nodal(self), self.node_area, error=error, knots=tried)
        start = axis.times[0] + np.arange(len(coefficients)) * (axis.period / len(coefficients))
        changes: dict[str, Any] = {**parts, "truncation": replace(lost, knots=len(coefficients))}
        return self.with_values(**changes, times=start, coefficients=coefficients)

    def snapshots(self) -> FlowField:
        """Mean and modes as snapshots at the knots; other fields as they are."""
        if not self.has("coefficients"):
            return self
        values: dict[str, Any] = {name: self.at_knots(name) for name in nodal(self)}
        return self.with_values(**values, coefficients=EMPTY, truncation=KEPT_WHOLE)

    def at_knots(self, name: str) -> Array:
        """A nodal array (T, N, ..) at the knots of a field of mean and modes.

        k and dissipation, of which a truncation may leave nothing or less where they are small, are kept above a
        twentieth of their means: an eddy's lifetime is their quotient.
        """
        axis, parts = self.time_axis, getattr(self, name)
        drawn = design(axis.times, float(axis.times[0]), axis.period, len(axis.times)) @ axis.coefficients
        values: Array = np.tensordot(drawn, parts, axes=1)
        return np.maximum(values, MIN_TURBULENCE_RATIO * parts[0]) if name in POSITIVE else values

    def moving(self, amplitude: ArrayLike, omega: float, phase: float = 0.0) -> FlowField:
        """The field on a mesh that swings by ``amplitude`` (2,) m times sin(``omega`` t + ``phase``), rad/s and rad.

        The points are those of the middle position; velocities stay what they are, absolute. A field in time must
        repeat after a whole number of swings, which is a SceneError otherwise.
        """
        across, along = _of_shape("amplitude", amplitude, (2,), "m").tolist()
        swing = MeshOscillation(across, along, number("omega", omega, "rad/s"), number("phase", phase, "rad"))
        swing.check(self.in_time, self.time_axis.period)
        return self.with_values(motion=swing)

    def mirrored(self, x: float = 0.0) -> FlowField:
        """The whole field of a half domain (all points on one side of the vertical line at ``x``); nodes on it are
        shared.

        The x components of velocity and pressure gradient change sign across the axis and are zero on it.
        Raises SceneError when points lie on both sides, or none on the axis.
        """
        points, triangles, whole = mirrored(self.points, self.triangles, nodal(self), x)
        if self.motion.x != 0.0:
            raise SceneError("mirrored: the mesh moves across the axis")
        return replace(self, points=points, triangles=triangles, **whole)

    def reflected(self, x: float = 0.0) -> FlowField:
        """The mirror image of the field about the vertical line at ``x``."""
        points = (2 * x, 0.0) + self.points * (-1.0, 1.0)
        image: dict[str, Any] = {n: values * (-1.0, 1.0) for n, values in nodal(self).items() if n in VECTORS}
        motion = self.motion._replace(x=-self.motion.x)
        triangles = np.ascontiguousarray(self.triangles[:, ::-1])
        return replace(self, points=points, triangles=triangles, motion=motion, **image)

    @cached_property
    def image(self) -> FlowField:
        """The mirror image about x = 0, made once."""
        made = self.reflected()
        made.__dict__.update(geometry=self.geometry.setdefault("image", {}), original=ref(self))
        return made

    @cached_property
    def original(self) -> ref[FlowField] | None:
        """The field that this one is the ``image`` of, node by node; it may be gone by now."""
        return None

    def mapped(self, function: Callable[[Array], Array]) -> FlowField:
        """This field with ``function`` applied to every nodal array."""
        return self.with_values(**{name: function(values) for name, values in nodal(self).items()})

    def with_values(self, **changes: Any) -> FlowField:
        """This field with ``changes`` of its values, on the same mesh."""
        made = replace(self, **changes)
        made.__dict__["geometry"] = self.geometry
        return made

    # -- files -----------------------------------------------------------------------------------------------------

    def save(self, path: Path | str) -> None:
        """Write all arrays to one .npz file, whole or not at all; nodal arrays of modes in single precision."""
        short = NODAL if self.has("coefficients") else ()
        kept = (name for name in self.__dataclass_fields__ if self.has(name) or name in GAS)
        arrays = {name: getattr(self, name) for name in kept}
        if self.truncation:
            arrays["truncation"] = astuple(self.truncation)
        save_arrays(path, {n: np.asarray(a, dtype=np.float32 if n in short else None) for n, a in arrays.items()})

    @classmethod
    def load(cls, path: Path | str) -> FlowField:
        """Read what :meth:`save` wrote. Raises SceneError when the file is missing or is no field."""
        file = Path(path)
        try:
            content: dict[str, Any] = load_arrays(file, AGAIN)
        except OSError as problem:
            raise SceneError(f"{path}: cannot be read as a flow field ({problem.strerror})") from None
        if not {"points", "triangles", "velocity"} <= set(content) <= set(cls.__dataclass_fields__):
            raise SceneError(f"{path}: is not a flow field written by wakeflow")
        own_files.check(file.parent, file.name, AGAIN)
        try:
            scalars = {n: float(content.pop(n)) for n in ("period", *GAS) if n in content}
            gradient = content.pop("given_gradient", None)
            return cls.from_arrays(**content, pressure_gradient=gradient, **scalars)
        except (TypeError, IndexError, ValueError) as problem:
            raise SceneError(f"{path}: is damaged ({problem}); {AGAIN}") from None


AGAIN = "it cannot be read as a flow field; the run that wrote it writes it anew"


def nodal(field: FlowField) -> dict[str, Any]:
    """The nodal arrays that a ``field`` has, by name."""
    return {name: getattr(field, name) for name in NODAL if field.has(name)}


def still(field: FlowField, weights: Array) -> FlowField:
    """A steady field: the snapshots or parts of one in time, with these ``weights`` (R,)."""
    return field.mapped(lambda nodal: np.tensordot(weights, nodal, axes=1)).with_values(**STEADY)


def _gas(temperature: float, **numbers: Any) -> dict[str, Any]:
    """What the air is, checked: its density and viscosity by default, and its mean free path where both are."""
    given = {name: value for name, value in numbers.items() if value is not None}
    path = 0.0 if given else MEAN_FREE_PATH
    return {
        "density": _positive("density", given.get("density", 1.2), "kg/m^3"),
        "viscosity": _positive("viscosity", given.get("viscosity", 1.8e-5), "Pa*s"),
        "temperature": _positive("temperature", temperature, "K"),
        "mean_free_path": _positive("mean_free_path", given.get("mean_free_path", path), "m", or_zero=True),
    }


# -- What follows from a field's velocity ------------------------------------------------------------------------------
def vorticity(field: FlowField) -> Array:
    """dv/dx - du/dy at the nodes (.., N), 1/s: second order up to the boundary; counter-clockwise is positive."""
    along_x, along_y = gradient_operators(field.points, field.triangles)
    flat = field.velocity.reshape(-1, len(field.points), 2)
    turning = (along_x @ flat[..., 1].T - along_y @ flat[..., 0].T).T
    return np.asarray(turning.reshape(field.velocity.shape[:-1]))


def stream_function(field: FlowField) -> Array:
    """psi at the nodes (N,) of a steady field, m2/s, with u = dpsi/dy and v = -dpsi/dx; zero at the first node.

    Least squares in the triangles, linear finite elements: the one whose lines run nearest to along the velocity, also
    where that is not quite free of divergence. Between two of its lines flows the difference of their psi.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import spsolve

    if field.velocity.ndim != 2:
        raise ValueError("the stream function is of a steady field; take its mean()")
    corners, area = field.triangles, field.area
    slopes = field.gradients  # (M, 3, 2)
    mean = field.velocity[corners].mean(axis=1)
    wanted = np.stack([-mean[:, 1], mean[:, 0]], axis=1)
    stiffness = np.einsum("m,mid,mjd->mij", area, slopes, slopes)
    load = np.einsum("m,mid,md->mi", area, slopes, wanted)
    rows, columns = (np.broadcast_to(part, stiffness.shape) for part in (corners[:, :, None], corners[:, None, :]))
    size = len(field.points)
    matrix = coo_matrix((stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsc()
    right = np.bincount(corners.ravel(), load.ravel(), minlength=size)
    psi = np.zeros(size)
    psi[1:] = spsolve(matrix[1:, 1:], right[1:])
    return psi


# -- Checks of what a flow field is made of; SceneError names what is wrong --------------------------------------------
Index = NDArray[np.int64]
FLAT = 1e-12  # area over the square of its longest edge below which a triangle has none: round-off


def _finite(name: str, values: ArrayLike, unit: str = "1") -> Array:
    """A contiguous copy in double precision, in ``unit``; every value is finite."""
    array = numbers(name, values, unit)
    bad = ~np.isfinite(array)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise SceneError(f"{name}: {int(bad.sum())} of {array.size} values are not finite, the first at {first}")
    return array


def _points(values: ArrayLike) -> Array:
    """Points (N, 2) m, at least three."""
    nodes = _finite("points", values, "m")
    if nodes.ndim != 2 or nodes.shape[1] != 2 or len(nodes) < 3:
        raise SceneError(f"points: shape {nodes.shape}, expected (N, 2) with N of at least 3")
    return nodes


def _positive(name: str, value: float, unit: str = "1", *, or_zero: bool = False) -> float:
    """A number in ``unit`` that is positive, or ``or_zero``, and finite."""
    result = number(name, value, unit)
    if not (np.isfinite(result) and (result > 0 or (or_zero and result == 0))):
        raise SceneError(f"{name} = {result:g} must be positive{' or 0' if or_zero else ''} and finite")
    return result


def _of_shape(name: str, values: ArrayLike, shape: tuple[int, ...], unit: str = "1") -> Array:
    """Numbers in ``unit`` of exactly this shape."""
    return _shaped(name, _finite(name, values, unit), shape)


def _flags(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Truth values, or numbers that are one where they are not 0, of exactly this shape."""
    return _shaped(name, truths(name, values), shape)


def _shaped(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if array.shape != shape:
        raise SceneError(f"{name}: shape {array.shape}, expected {shape}")
    return array


def _cells(triangles: ArrayLike, nodes: Array) -> Index:
    """Triangles (M, 3) of numbers of the ``nodes`` (N, 2), each with an area; clockwise ones are turned round."""
    cells = whole("triangles", triangles)
    if cells.ndim != 2 or cells.shape[1] != 3 or not len(cells):
        raise SceneError(f"triangles: shape {cells.shape}, expected (M, 3) of integers")
    if cells.min() < 0 or cells.max() >= len(nodes):
        raise SceneError(f"triangles: node {int(cells.max())} and {int(cells.min())}, allowed 0 to {len(nodes) - 1}")
    double = double_area(nodes, cells)
    cells[double < 0] = cells[double < 0][:, ::-1]
    p = nodes[cells]
    longest = np.max(np.sum((p - np.roll(p, 1, axis=1)) ** 2, axis=2), axis=1)
    flat = np.abs(double) <= FLAT * longest
    if flat.any():
        raise SceneError(
            f"triangles: {int(flat.sum())} of {len(cells)} have no area, the first is {int(flat.argmax())}"
        )
    return np.ascontiguousarray(cells)


def _period(value: float, *, timed: bool) -> float:
    """A period (s), which goes with the times of snapshots."""
    length = number("period", value, "s")
    if not timed:
        raise SceneError(f"period = {length} s needs the times of the snapshots")
    return length


def _times(values: ArrayLike, period: float) -> Array:
    """Increasing times (T,) s that span no more than the ``period`` (s), where it is not 0."""
    clock = _finite("times", values, "s")
    if clock.ndim != 1 or not len(clock):
        raise SceneError(f"times: shape {clock.shape}, expected (T,)")
    if np.any(np.diff(clock) <= 0):
        raise SceneError(f"times: must increase, but do not after entry {int(np.argmax(np.diff(clock) <= 0))}")
    if period and not (np.isfinite(period) and period >= clock[-1] - clock[0]):
        raise SceneError(f"period = {period:g} s is shorter than the {clock[-1] - clock[0]:g} s the times span")
    return clock


def _coefficients(values: ArrayLike, knots: Array, period: float) -> Array:
    """Coefficients (T, R) of splines whose ``knots`` (T,) s are the times: uniform over the ``period`` (s; 0 without
    one), at least four.
    """
    array = _finite("coefficients", values)
    if not period or len(knots) < 4:
        raise SceneError("coefficients: need a period and at least four times, the knots of the splines")
    if array.ndim != 2 or array.shape[0] != len(knots) or array.shape[1] < 1:
        raise SceneError(f"coefficients: shape {array.shape}, expected ({len(knots)}, R), a row for each time")
    if not np.allclose(np.diff(knots), period / len(knots), rtol=1e-6, atol=0.0):
        raise SceneError("coefficients: the times, the knots of the splines, must be uniform over the period")
    if not (np.allclose(array[:, 0], 1.0) and np.allclose(array[:, 1:].mean(axis=0), 0.0, atol=1e-9)):
        raise SceneError("coefficients: the first column must be 1, for the mean, and the others have the mean 0")
    return array


def _motion(values: ArrayLike) -> tuple[tuple[float, float], float, float]:
    """Amplitude (x, y) m, omega (rad/s) and, where it is given, phase (rad) of a moving mesh from a flat list."""
    x, y, omega, *phase = _finite("motion", values).ravel().tolist()
    return (x, y), omega, phase[0] if phase else 0.0
