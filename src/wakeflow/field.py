"""FlowField: velocity and pressure on a triangle mesh, steady or as snapshots in time; linear inside every triangle.

Between snapshots the field is linear in time; with a ``period`` it repeats, without one it stands still before the
first and after the last snapshot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .files import atomic_write

__all__ = ["Divergence", "FlowField"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
INSIDE = -1e-9  # smallest barycentric coordinate that still counts as inside a triangle


@dataclass(frozen=True)
class Divergence:
    """Discrete divergence: ``values`` (M,) or (T, M) 1/s, and rms and max of |div u| h / U.

    h is the root of twice a triangle's area, U the rms speed over the mesh.
    """

    values: Array
    rms: float
    max: float


@dataclass(frozen=True, eq=False)
class FlowField:
    """Arrays on N nodes and M triangles; nodal arrays have a leading axis T when ``times`` is given. SI units.

    ``points`` (N, 2) m, ``triangles`` (M, 3) counter-clockwise, ``velocity`` (.., N, 2) m/s, ``pressure`` (.., N) Pa,
    ``k`` (.., N) m2/s2, ``dissipation`` (.., N) m2/s3, ``times`` (T,) s, ``density`` kg/m3, ``viscosity`` dynamic, Pa
    s. Make one with :meth:`from_arrays` or :meth:`from_openfoam`, which check it.
    """

    points: Array
    triangles: Index
    velocity: Array
    pressure: Array | None = None
    times: Array | None = None
    period: float | None = None
    k: Array | None = None
    dissipation: Array | None = None
    density: float = 1.2
    viscosity: float = 1.8e-5
    given_gradient: Array | None = None

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
        density: float = 1.2,
        viscosity: float = 1.8e-5,
        pressure_gradient: ArrayLike | None = None,
    ) -> FlowField:
        """A checked field; clockwise triangles are turned round. Shapes and units as in the class.

        ``pressure_gradient`` (.., N, 2) Pa/m replaces the one recovered from ``pressure``. Raises SceneError for
        wrong shapes, NaN, indices out of range, degenerate triangles, times that do not increase, a period shorter
        than the time they span, or density and viscosity that are not positive.
        """
        nodes = _numbers("points", points)
        if nodes.ndim != 2 or nodes.shape[1] != 2 or len(nodes) < 3:
            raise SceneError(f"points: shape {nodes.shape}, expected (N, 2) with N of at least 3")
        cells = _cells(triangles, nodes)
        clock = None if times is None else _clock(times, period)
        if clock is None and period is not None:
            raise SceneError(f"period = {period:g} s needs the times of the snapshots")
        lead = (len(nodes),) if clock is None else (len(clock), len(nodes))
        for name, value in (("density", density), ("viscosity", viscosity)):
            if not (np.isfinite(value) and value > 0):
                raise SceneError(f"{name} = {value:g} must be positive and finite")
        return cls(
            points=nodes,
            triangles=cells,
            velocity=_nodal("velocity", velocity, (*lead, 2)),
            pressure=_optional("pressure", pressure, lead),
            times=clock,
            period=None if period is None else float(period),
            k=_optional("k", k, lead),
            dissipation=_optional("dissipation", dissipation, lead),
            density=float(density),
            viscosity=float(viscosity),
            given_gradient=_optional("pressure_gradient", pressure_gradient, (*lead, 2)),
        )

    @classmethod
    def from_openfoam(
        cls, case_dir: Path | str, time: str | float = "latest", density: float = 1.2
    ) -> FlowField:  # "latest" | "mean" | "all" | a time in s
        """Read an OpenFOAM case: one time, the mean, or all stored times; pressure becomes Pa with ``density``
        (kg/m3).
        """
        from .foam.read import read_flow

        return cls.from_arrays(**read_flow(Path(case_dir), time, density))

    # -- geometry --------------------------------------------------------------------------------------------------

    @cached_property
    def area(self) -> Array:
        """Area of every triangle (M,), m2."""
        return 0.5 * _double_area(self.points, self.triangles)

    @cached_property
    def neighbours(self) -> Index:
        """Triangle across each edge (M, 3); edge k lies opposite corner k; -1 on the boundary.

        Raises SceneError when an edge belongs to more than two triangles.
        """
        cells = self.triangles
        ends = np.sort(np.concatenate([cells[:, [1, 2]], cells[:, [2, 0]], cells[:, [0, 1]]]), axis=1)
        key = ends[:, 0] * np.int64(len(self.points)) + ends[:, 1]
        order = np.argsort(key, kind="stable")
        same = key[order][1:] == key[order][:-1]
        if np.any(same[1:] & same[:-1]):
            raise SceneError("triangles: an edge belongs to more than two triangles")
        first, second = order[:-1][same], order[1:][same]
        across = np.full(len(key), -1, dtype=np.int64)
        across[first], across[second] = second % len(cells), first % len(cells)
        return np.ascontiguousarray(across.reshape(3, -1).T)

    @cached_property
    def gradients(self) -> Array:
        """Gradient of every triangle's three barycentric coordinates (M, 3, 2), 1/m."""
        p = self.points[self.triangles]
        across = np.roll(p, -2, axis=1) - np.roll(p, -1, axis=1)
        return np.stack([-across[..., 1], across[..., 0]], axis=2) / (2 * self.area)[:, None, None]

    @cached_property
    def _centres(self) -> Any:
        """Tree of the triangles' centroids."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points[self.triangles].mean(axis=1))

    def locate(self, points: ArrayLike) -> Index:
        """The triangle that holds each point (n, 2); -1 outside the mesh. A point on the boundary is inside."""
        x = np.atleast_2d(np.asarray(points, dtype=float))
        found = np.full(len(x), -1, dtype=np.int64)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        slack = 1e-9 * (high - low)
        todo = np.flatnonzero(np.all((x >= low - slack) & (x <= high + slack), axis=1))
        if not len(todo):
            return found
        at = self._centres.query(x[todo])[1].astype(np.int64)
        for _ in range(len(self.triangles)):
            coordinate = self.barycentric(at, x[todo])
            lowest = coordinate.argmin(axis=1)
            inside = coordinate[np.arange(len(todo)), lowest] >= INSIDE
            found[todo[inside]] = at[inside]
            onward = self.neighbours[at, lowest]
            go = ~inside & (onward >= 0)
            lost = todo[~inside & (onward < 0)]
            found[lost] = -2  # met the boundary: outside, or behind a body
            todo, at = todo[go], onward[go]
            if not len(todo):
                break
        found[todo] = -2
        lost = np.flatnonzero(found == -2)
        found[lost] = self._search(x[lost])
        return found

    def _search(self, x: Array) -> Index:
        """Every triangle that may hold them tried, for points whose walk met the boundary: those whose boxes do.

        Boxes are looked up on a regular grid, about one triangle a cell.
        """
        start, member, low, pitch, side = self._grid
        place = np.clip(((x - low) / pitch).astype(np.int64), 0, side - 1)
        cell = place[:, 1] * side + place[:, 0]
        count = start[cell + 1] - start[cell]
        point = np.repeat(np.arange(len(x)), count)
        inner = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
        near = member[np.repeat(start[cell], count) + inner]
        least = self.barycentric(near, x[point]).min(axis=1)
        found = np.full(len(x), -1, dtype=np.int64)
        order = np.argsort(least, kind="stable")  # the last one written, the deepest inside, stays
        order = order[least[order] >= INSIDE]
        found[point[order]] = near[order]
        return found

    @cached_property
    def _grid(self) -> tuple[Index, Index, Array, Array, int]:
        """Triangles by the cells of a regular grid that their boxes touch: first member of each cell, members, corner
        and pitch of the grid, cells a side.
        """
        p = self.points[self.triangles]
        corner, top = self.points.min(axis=0), self.points.max(axis=0)
        side = max(1, int(np.sqrt(len(p))))
        pitch = (top - corner) / side
        slack = 1e-9 * np.ptp(p, axis=1).max(axis=1, keepdims=True)
        low = np.clip(((p.min(axis=1) - slack - corner) / pitch).astype(np.int64), 0, side - 1)
        high = np.clip(((p.max(axis=1) + slack - corner) / pitch).astype(np.int64), 0, side - 1)
        wide = high - low + 1
        count = wide.prod(axis=1)
        owner = np.repeat(np.arange(len(p)), count)
        inner = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        column = low[owner, 0] + inner % wide[owner, 0]
        row = low[owner, 1] + inner // wide[owner, 0]
        cell = row * side + column
        order = np.argsort(cell, kind="stable")
        start = np.searchsorted(cell[order], np.arange(side * side + 1))
        return start, owner[order], corner, pitch, side

    def barycentric(self, triangle: Index, x: Array) -> Array:
        """Barycentric coordinates (n, 3) of points ``x`` (n, 2) in the given triangles (n,)."""
        offset = x - self.points[self.triangles[triangle, 0]]
        result: Array = np.einsum("nkd,nd->nk", self.gradients[triangle], offset)
        result[:, 0] += 1.0
        return result

    # -- values ----------------------------------------------------------------------------------------------------

    @cached_property
    def pressure_gradient(self) -> Array | None:
        """Pressure gradient at the nodes (.., N, 2) Pa/m, second-order accurate up to the boundary; None without
        pressure.
        """
        if self.given_gradient is not None or self.pressure is None:
            return self.given_gradient
        along_x, along_y = _gradient_operators(self.points, self.triangles)
        flat = np.atleast_2d(self.pressure).T
        gradient = np.stack([(along_x @ flat).T, (along_y @ flat).T], axis=-1)
        return np.ascontiguousarray(gradient.reshape(*self.pressure.shape, 2))

    def at_time(self, t: float) -> tuple[int, int, float]:
        """Indices of the two snapshots around time ``t`` (s) and the weight of the second; (0, 0, 0.0) when steady."""
        if self.times is None:
            return 0, 0, 0.0
        times, last = self.times, len(self.times) - 1
        if self.period is not None:
            t = times[0] + (t - times[0]) % self.period
            gap = times[0] + self.period - times[last]
            if t >= times[last] and gap > 0:
                return last, 0, float((t - times[last]) / gap)
        i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(last - 1, 0)))
        j = min(i + 1, last)
        return i, j, float(np.clip((t - times[i]) / (times[j] - times[i]), 0.0, 1.0)) if j > i else 0.0

    def sample(self, x: ArrayLike, t: float = 0.0) -> tuple[Array, Array, Array]:
        """Velocity (n, 2), pressure (n,) and pressure gradient (n, 2) at points (n, 2) and time ``t``; NaN outside.

        The tracker's interpolant: linear in triangles and between snapshots.
        """
        points = np.atleast_2d(np.asarray(x, dtype=float))
        triangle = self.locate(points)
        inside = triangle >= 0
        weight = self.barycentric(triangle[inside], points[inside])
        corner = self.triangles[triangle[inside]]
        i, j, w = self.at_time(t)

        def value(nodal: Array | None, shape: tuple[int, ...]) -> Array:
            result = np.full((len(points), *shape), np.nan)
            if nodal is not None:
                now = nodal if self.times is None else (1 - w) * nodal[i] + w * nodal[j]
                result[inside] = np.einsum("nk,nk...->n...", weight, now[corner])
            return result

        return value(self.velocity, (2,)), value(self.pressure, ()), value(self.pressure_gradient, (2,))

    def divergence(self) -> Divergence:
        """Divergence of the interpolated velocity in every triangle, and how large it is against U / h."""
        values = np.einsum("mkd,...mkd->...m", self.gradients, self.velocity[..., self.triangles, :])
        speed = float(np.sqrt(np.mean(np.sum(self.velocity**2, axis=-1))))
        relative = np.abs(values) * np.sqrt(2 * self.area) / (speed or 1.0)
        rms = float(np.sqrt(np.average(np.atleast_2d(relative**2).mean(axis=0), weights=self.area)))
        return Divergence(values, rms, float(relative.max()))

    # -- other fields ----------------------------------------------------------------------------------------------

    def mean(self) -> FlowField:
        """The time mean as a steady field (trapezoidal rule over the snapshots, over the whole period when there is
        one).
        """
        if self.times is None:
            return self
        weight = np.zeros(len(self.times))
        step = np.diff(self.times)
        weight[:-1] += step / 2
        weight[1:] += step / 2
        if self.period is not None:
            gap = self.times[0] + self.period - self.times[-1]
            weight[0] += gap / 2
            weight[-1] += gap / 2
        weight = weight / weight.sum() if weight.sum() > 0 else np.full(len(weight), 1.0 / len(weight))
        return replace(self._mapped(lambda nodal: np.tensordot(weight, nodal, axes=1)), times=None, period=None)

    def mirrored(self, x: float = 0.0) -> FlowField:
        """The whole field of a half domain (all points on one side of the vertical line at ``x``); nodes on it are
        shared.

        The x components of velocity and pressure gradient change sign across the axis and are zero on it.
        Raises SceneError when points lie on both sides, or none on the axis.
        """
        offset = self.points[:, 0] - x
        slack = 1e-9 * float(np.ptp(self.points, axis=0).max())
        axis = np.abs(offset) <= slack
        if offset.min() < -slack and offset.max() > slack:
            raise SceneError(f"mirrored: points lie on both sides of x = {x:g} m")
        if not axis.any():
            raise SceneError(f"mirrored: no points on the axis x = {x:g} m")
        count, off = len(self.points), ~axis
        image = np.arange(count)
        image[off] = count + np.arange(off.sum())
        points = self.points.copy()
        points[axis, 0] = x

        def double(nodal: Array) -> Array:
            if nodal.ndim == self.velocity.ndim:  # a vector
                near = nodal.copy()
                near[..., axis, 0] = 0.0
                return np.concatenate([near, near[..., off, :] * (-1.0, 1.0)], axis=-2)
            return np.concatenate([nodal, nodal[..., off]], axis=-1)

        whole = self._mapped(double)
        return replace(
            whole,
            points=np.concatenate([points, (2 * x, 0.0) + points[off] * (-1.0, 1.0)]),
            triangles=np.concatenate([self.triangles, image[self.triangles[:, ::-1]]]),
        )

    def reflected(self, x: float = 0.0) -> FlowField:
        """The mirror image of the field about the vertical line at ``x``."""

        def flip(nodal: Array) -> Array:
            return nodal * (-1.0, 1.0) if nodal.ndim == self.velocity.ndim else nodal

        points = (2 * x, 0.0) + self.points * (-1.0, 1.0)
        return replace(self._mapped(flip), points=points, triangles=np.ascontiguousarray(self.triangles[:, ::-1]))

    def _mapped(self, function: Any) -> FlowField:
        """The same field with ``function`` applied to every nodal array."""
        names = ("velocity", "pressure", "k", "dissipation", "given_gradient")
        return replace(self, **{n: function(v) for n in names if (v := getattr(self, n)) is not None})

    # -- files -----------------------------------------------------------------------------------------------------

    def save(self, path: Path | str) -> None:
        """Write all arrays to one .npz file, whole or not at all."""
        names = [f for f in self.__dataclass_fields__ if getattr(self, f) is not None]
        with atomic_write(path, "wb") as stream:
            np.savez(stream, **{name: getattr(self, name) for name in names})

    @classmethod
    def load(cls, path: Path | str) -> FlowField:
        """Read what :meth:`save` wrote. Raises SceneError when the file is missing or is no field."""
        try:
            with np.load(path, allow_pickle=False) as data:
                content = {name: data[name] for name in data.files}
        except (OSError, ValueError) as error:
            raise SceneError(f"{path}: cannot be read as a flow field ({error})") from None
        if not {"points", "triangles", "velocity"} <= set(content) <= set(cls.__dataclass_fields__):
            raise SceneError(f"{path}: is not a flow field written by wakeflow")
        scalars = {n: float(content.pop(n)) for n in ("period", "density", "viscosity") if n in content}
        gradient = content.pop("given_gradient", None)
        return cls.from_arrays(**content, pressure_gradient=gradient, **scalars)


# -- checks ------------------------------------------------------------------------------------------------------------


def _numbers(name: str, values: ArrayLike) -> Array:
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise SceneError(f"{name}: not an array of numbers") from None
    bad = ~np.isfinite(array)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise SceneError(f"{name}: {int(bad.sum())} of {array.size} values are not finite, the first at {first}")
    return array


def _nodal(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = _numbers(name, values)
    if array.shape != shape:
        raise SceneError(f"{name}: shape {array.shape}, expected {shape}")
    return array


def _optional(name: str, values: ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
    return None if values is None else _nodal(name, values, shape)


def _double_area(points: Array, triangles: Index) -> Array:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _cells(triangles: ArrayLike, points: Array) -> Index:
    cells = np.array(triangles)
    if cells.ndim != 2 or cells.shape[1] != 3 or not len(cells) or not np.issubdtype(cells.dtype, np.integer):
        raise SceneError(f"triangles: shape {cells.shape} of {cells.dtype}, expected (M, 3) of integers")
    cells = cells.astype(np.int64)
    if cells.min() < 0 or cells.max() >= len(points):
        raise SceneError(f"triangles: node {int(cells.max())} and {int(cells.min())}, allowed 0 to {len(points) - 1}")
    double = _double_area(points, cells)
    cells[double < 0] = cells[double < 0][:, ::-1]
    p = points[cells]
    longest = np.max(np.sum((p - np.roll(p, 1, axis=1)) ** 2, axis=2), axis=1)
    flat = np.abs(double) <= 1e-12 * longest
    if flat.any():
        raise SceneError(
            f"triangles: {int(flat.sum())} of {len(cells)} have no area, the first is {int(flat.argmax())}"
        )
    return np.ascontiguousarray(cells)


def _clock(times: ArrayLike, period: float | None) -> Array:
    clock = _numbers("times", times)
    if clock.ndim != 1 or not len(clock):
        raise SceneError(f"times: shape {clock.shape}, expected (T,)")
    if np.any(np.diff(clock) <= 0):
        raise SceneError(f"times: must increase, but do not after entry {int(np.argmax(np.diff(clock) <= 0))}")
    if period is not None and not (np.isfinite(period) and period > 0 and period >= clock[-1] - clock[0]):
        raise SceneError(f"period = {period:g} s is shorter than the {clock[-1] - clock[0]:g} s the times span")
    return clock


# -- gradient recovery -------------------------------------------------------------------------------------------------


def _gradient_operators(points: Array, triangles: Index) -> tuple[Any, Any]:
    """Sparse (N, N) matrices that take nodal values to their x and y derivatives at the nodes.

    Least-squares quadratics over the nodes around each node (polynomial preserving recovery, Zhang & Naga 2005, SIAM
    J. Sci. Comput. 26, 1192): exact for quadratics, second order up to the boundary. A patch is the node's
    neighbours, and theirs where the fit would not be well posed; coordinates are whitened by the patch's own shape,
    so flat cells do no harm. Where even wide patches are too small a linear fit is made.
    """
    from scipy.sparse import coo_matrix, csr_matrix, identity

    count = len(points)
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    ring = csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count)) + identity(count)
    todo = np.arange(count)
    reach, pieces = csr_matrix(ring), []
    for terms, condition in ((6, 1e4), (6, 1e5), (6, 1e6), (3, np.inf)):
        rows, columns, weights, good = _fit(points, csr_matrix(reach[todo]), todo, terms, condition)
        pieces.append((rows, columns, weights))
        todo = todo[~good]
        if not len(todo):
            break
        reach = csr_matrix(reach @ ring)
    rows, columns = (np.concatenate([piece[i] for piece in pieces]) for i in range(2))
    weights = np.concatenate([piece[2] for piece in pieces])
    return tuple(coo_matrix((weights[:, i], (rows, columns)), shape=(count, count)).tocsr() for i in range(2))


def _fit(
    points: Array, patches: Any, centres: Index, terms: int, worst: float
) -> tuple[Index, Index, Array, NDArray[np.bool_]]:
    """Weights of the gradient at ``centres`` from least-squares polynomials of 6 or 3 terms over their patches.

    Returns rows, columns and weights (.., 2) for the centres whose fit has a condition number below ``worst``, and
    which.
    """
    size = np.diff(patches.indptr)
    width = int(size.max())
    filled = np.arange(width) < size[:, None]
    member = np.zeros((len(centres), width), dtype=np.int64)
    member[filled] = patches.indices
    offset = np.where(filled[..., None], points[member] - points[centres][:, None], 0.0)
    spread = np.einsum("nkd,nke->nde", offset, offset) / np.maximum(size - 1, 1)[:, None, None]
    root = np.linalg.cholesky(spread + 1e-12 * np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(2))
    whiten = np.linalg.inv(root)
    xi, eta = np.moveaxis(np.einsum("nde,nke->nkd", whiten, offset), 2, 0)
    basis = np.stack([np.ones_like(xi), xi, eta, xi**2, xi * eta, eta**2][:terms], axis=2)
    basis *= (filled * np.exp(-0.125 * (xi**2 + eta**2)))[..., None]
    normal = np.einsum("nki,nkj->nij", basis, basis)
    values = np.linalg.eigvalsh(normal)
    enough = size >= (terms + 1 if terms > 3 else 3)
    good = enough & (values[:, 0] * worst > values[:, -1])
    inverse = np.linalg.inv(normal[good])
    weight = np.exp(-0.125 * (xi**2 + eta**2))[good] * filled[good]
    local = np.einsum("nij,nkj->nki", inverse[:, 1:3], basis[good]) * weight[..., None]
    gradient = np.einsum("nde,nkd->nke", whiten[good], local)
    inside = filled[good]
    rows = np.broadcast_to(centres[good][:, None], inside.shape)[inside]
    return rows, member[good][inside], gradient[inside], good
