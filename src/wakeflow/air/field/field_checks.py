"""Checks of what a flow field is made of; SceneError names what is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import number, numbers, truths, whole
from ...core.errors import SceneError
from .triangles import double_area

Array = NDArray[np.float64]
Index = NDArray[np.int64]
FLAT = 1e-12  # area over the square of its longest edge below which a triangle has none: round-off


def finite(name: str, values: ArrayLike, unit: str = "1") -> Array:
    """A contiguous copy in double precision, in ``unit``; every value is finite."""
    array = numbers(name, values, unit)
    bad = ~np.isfinite(array)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise SceneError(f"{name}: {int(bad.sum())} of {array.size} values are not finite, the first at {first}")
    return array


def points(values: ArrayLike) -> Array:
    """Points (N, 2) m, at least three."""
    nodes = finite("points", values, "m")
    if nodes.ndim != 2 or nodes.shape[1] != 2 or len(nodes) < 3:
        raise SceneError(f"points: shape {nodes.shape}, expected (N, 2) with N of at least 3")
    return nodes


def positive(name: str, value: float, unit: str = "1", *, or_zero: bool = False) -> float:
    """A number in ``unit`` that is positive, or ``or_zero``, and finite."""
    result = number(name, value, unit)
    if not (np.isfinite(result) and (result > 0 or (or_zero and result == 0))):
        raise SceneError(f"{name} = {result:g} must be positive{' or 0' if or_zero else ''} and finite")
    return result


def of_shape(name: str, values: ArrayLike, shape: tuple[int, ...], unit: str = "1") -> Array:
    """Numbers in ``unit`` of exactly this shape."""
    return _shaped(name, finite(name, values, unit), shape)


def flags(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Truth values, or numbers that are one where they are not 0, of exactly this shape."""
    return _shaped(name, truths(name, values), shape)


def _shaped(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if array.shape != shape:
        raise SceneError(f"{name}: shape {array.shape}, expected {shape}")
    return array


def cells(triangles: ArrayLike, nodes: Array) -> Index:
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


def period(value: float, *, timed: bool) -> float:
    """A period (s), which goes with the times of snapshots."""
    length = number("period", value, "s")
    if not timed:
        raise SceneError(f"period = {length} s needs the times of the snapshots")
    return length


def times(values: ArrayLike, period: float) -> Array:
    """Increasing times (T,) s that span no more than the ``period`` (s), where it is not 0."""
    clock = finite("times", values, "s")
    if clock.ndim != 1 or not len(clock):
        raise SceneError(f"times: shape {clock.shape}, expected (T,)")
    if np.any(np.diff(clock) <= 0):
        raise SceneError(f"times: must increase, but do not after entry {int(np.argmax(np.diff(clock) <= 0))}")
    if period and not (np.isfinite(period) and period >= clock[-1] - clock[0]):
        raise SceneError(f"period = {period:g} s is shorter than the {clock[-1] - clock[0]:g} s the times span")
    return clock


def coefficients(values: ArrayLike, knots: Array, period: float) -> Array:
    """Coefficients (T, R) of splines whose ``knots`` (T,) s are the times: uniform over the ``period`` (s; 0 without
    one), at least four.
    """
    array = finite("coefficients", values)
    if not period or len(knots) < 4:
        raise SceneError("coefficients: need a period and at least four times, the knots of the splines")
    if array.ndim != 2 or array.shape[0] != len(knots) or array.shape[1] < 1:
        raise SceneError(f"coefficients: shape {array.shape}, expected ({len(knots)}, R), a row for each time")
    if not np.allclose(np.diff(knots), period / len(knots), rtol=1e-6, atol=0.0):
        raise SceneError("coefficients: the times, the knots of the splines, must be uniform over the period")
    if not (np.allclose(array[:, 0], 1.0) and np.allclose(array[:, 1:].mean(axis=0), 0.0, atol=1e-9)):
        raise SceneError("coefficients: the first column must be 1, for the mean, and the others have the mean 0")
    return array


def motion(values: ArrayLike) -> tuple[tuple[float, float], float, float]:
    """Amplitude (x, y) m, omega (rad/s) and, where it is given, phase (rad) of a moving mesh from a flat list."""
    x, y, omega, *phase = finite("motion", values).ravel().tolist()
    return (x, y), omega, phase[0] if phase else 0.0
