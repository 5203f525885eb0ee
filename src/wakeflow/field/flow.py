"""FlowField: velocity and pressure on a triangle mesh, steady or in time; linear inside every triangle.

Three forms, told apart by what is given with the nodal arrays: nothing (steady), ``times`` (snapshots, between which
the field is linear in time; with a ``period`` it repeats, without one it stands still before the first and after the
last), or ``times``, ``period`` and ``coefficients`` (a mean and modes, whose functions of time are periodic cubic
splines).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..core.files import atomic_write
from . import checks
from .mirror import mirrored, reflected
from .modes import Truncation, compress, time_shares
from .recovery import gradient_operators
from .splines import POWERS, around, design
from .triangles import Triangles

__all__ = ["Divergence", "FlowField", "Swing", "Truncation"]

Array = NDArray[np.float64]
NODAL = ("velocity", "pressure", "k", "dissipation", "given_gradient")
LEAST = 0.05  # of their means: k and dissipation of a compressed field are no smaller
WHOLE = 0.01  # vibrations by which a moving field's period may miss a whole number of them


@dataclass(frozen=True)
class Divergence:
    """Discrete divergence: ``values`` (M,) or (T, M) 1/s, and rms and max of |div u| h / U.

    h is the root of twice a triangle's area, U the rms speed over the mesh.
    """

    values: Array
    rms: float
    max: float


class Swing(NamedTuple):
    """Harmonic motion of the whole mesh: displacement (x, y) sin(omega t + phase); m, rad/s, rad."""

    x: float
    y: float
    omega: float
    phase: float = 0.0

    def displacement(self, t: ArrayLike) -> Array:
        """Where the mesh is (.., 2) m at times ``t`` (..,) s, from where its points say."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.sin(angle)[..., None] * np.array([self.x, self.y]))

    def velocity(self, t: ArrayLike) -> Array:
        """How fast the mesh moves (.., 2) m/s."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.cos(angle)[..., None] * np.array([self.x, self.y]) * self.omega)


@dataclass(frozen=True, eq=False)
class FlowField(Triangles):
    """Arrays on N nodes and M triangles; SI units. Make one with :meth:`from_arrays` or :meth:`from_openfoam`.

    ``points`` (N, 2) m, ``triangles`` (M, 3) counter-clockwise, ``velocity`` (.., N, 2) m/s, ``pressure`` (.., N) Pa,
    ``k`` (.., N) m2/s2, ``dissipation`` (.., N) m2/s3, ``times`` (T,) s, ``density`` kg/m3, ``viscosity`` dynamic, Pa
    s. Nodal arrays have a leading axis T when ``times`` is given: the snapshots; or R, when ``coefficients`` (T, R) is
    given too: the mean and R - 1 modes, ``times`` being the splines' uniform knots, and ``truncation`` what was cut
    off. ``motion``: the mesh swings as a rigid whole, ``points`` being its middle position; velocities are absolute.
    """

    velocity: Array
    pressure: Array | None = None
    times: Array | None = None
    period: float | None = None
    k: Array | None = None
    dissipation: Array | None = None
    density: float = 1.2
    viscosity: float = 1.8e-5
    given_gradient: Array | None = None
    coefficients: Array | None = None
    motion: Swing | None = None
    truncation: Truncation | None = None

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
        coefficients: ArrayLike | None = None,
        motion: ArrayLike | None = None,
        truncation: ArrayLike | None = None,
    ) -> FlowField:
        """A checked field; clockwise triangles are turned round. Shapes and units as in the class.

        ``pressure_gradient`` (.., N, 2) Pa/m replaces the one recovered from ``pressure``. Raises SceneError for
        wrong shapes, NaN, indices out of range, degenerate triangles, times that do not increase, a period shorter
        than the time they span, or density and viscosity that are not positive.
        """
        nodes = checks.numbers("points", points)
        if nodes.ndim != 2 or nodes.shape[1] != 2 or len(nodes) < 3:
            raise SceneError(f"points: shape {nodes.shape}, expected (N, 2) with N of at least 3")
        cells = checks.cells(triangles, nodes)
        clock = None if times is None else checks.clock(times, period)
        if clock is None and period is not None:
            raise SceneError(f"period = {period:g} s needs the times of the snapshots")
        parts = None if coefficients is None else checks.coefficients(coefficients, clock, period)
        lead = (len(nodes),) if clock is None else ((clock if parts is None else parts.T).shape[0], len(nodes))
        for name, value in (("density", density), ("viscosity", viscosity)):
            if not (np.isfinite(value) and value > 0):
                raise SceneError(f"{name} = {value:g} must be positive and finite")
        field = cls(
            points=nodes,
            triangles=cells,
            velocity=checks.nodal("velocity", velocity, (*lead, 2)),
            pressure=checks.optional("pressure", pressure, lead),
            times=clock,
            period=None if period is None else float(period),
            k=checks.optional("k", k, lead),
            dissipation=checks.optional("dissipation", dissipation, lead),
            density=float(density),
            viscosity=float(viscosity),
            given_gradient=checks.optional("pressure_gradient", pressure_gradient, (*lead, 2)),
            coefficients=parts,
            truncation=None if truncation is None else _truncation(truncation),
        )
        if motion is None:
            return field
        x, y, omega, *phase = checks.numbers("motion", motion).ravel().tolist()
        return field.moving((x, y), omega, *phase)

    @classmethod
    def from_openfoam(
        cls, case_dir: Path | str, time: str | float = "latest", density: float = 1.2
    ) -> FlowField:  # "latest" | "mean" | "all" | a time in s
        """Read an OpenFOAM case: one time, the mean, or all stored times; pressure becomes Pa with ``density``
        (kg/m3).
        """
        from ..foam.read import read_flow

        return cls.from_arrays(**read_flow(Path(case_dir), time, density))

    # -- values ----------------------------------------------------------------------------------------------------

    @cached_property
    def pressure_gradient(self) -> Array | None:
        """Pressure gradient at the nodes (.., N, 2) Pa/m, second-order accurate up to the boundary; None without
        pressure.
        """
        if self.given_gradient is not None or self.pressure is None:
            return self.given_gradient
        along_x, along_y = gradient_operators(self.points, self.triangles)
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

    def weights(self, t: float) -> Array:
        """What of each snapshot or part (R,) makes up the field at time ``t`` (s); a lone 1 when steady."""
        if self.times is None:
            return np.ones(1)
        if self.coefficients is not None:
            assert self.period is not None
            index, share = around(t, float(self.times[0]), self.period, len(self.times))
            return np.asarray(share @ self.coefficients[index])
        i, j, w = self.at_time(t)
        weight = np.zeros(len(self.times))
        weight[i] += 1.0 - w
        weight[j] += w
        return weight

    def polynomial(self, t: float) -> tuple[float, float, Array]:
        """The piece of time from ``t`` (s) on in which the field is a polynomial: its origin and end (s), and what of
        each snapshot or part (P, R) makes up the coefficient of each power of the time since the origin.
        """
        if self.times is None:
            return t, np.inf, np.ones((1, 1))
        if self.coefficients is not None:
            assert self.period is not None
            step = self.period / len(self.times)
            first = np.floor((t - self.times[0]) / step)
            around = (int(first) + np.arange(-1, 3)) % len(self.times)
            shares = POWERS @ self.coefficients[around] / step ** np.arange(4)[:, None]
            return float(self.times[0] + first * step), float(self.times[0] + (first + 1) * step), shares
        i, j, w = self.at_time(t)
        rise = np.zeros(len(self.times))
        if i == j:
            return t, np.inf, np.stack([self.weights(t), rise])
        step = self.times[j] - self.times[i] + (0.0 if j > i else self.period or 0.0)
        rise[i], rise[j] = -1.0 / step, 1.0 / step
        return t, t + (1.0 - w) * float(step), np.stack([self.weights(t), rise])

    def sample(self, x: ArrayLike, t: float = 0.0) -> tuple[Array, Array, Array]:
        """Velocity (n, 2), pressure (n,) and pressure gradient (n, 2) at points (n, 2) and time ``t``; NaN outside.

        The tracker's interpolant: linear in triangles, in time as the class says; in a moving mesh where it is then.
        """
        points = np.atleast_2d(np.asarray(x, dtype=float))
        if self.motion is not None:
            points = points - self.motion.displacement(t)
        triangle = self.locate(points)
        inside = triangle >= 0
        weight = self.barycentric(triangle[inside], points[inside])
        corner = self.triangles[triangle[inside]]
        shares = self.weights(t)

        def value(nodal: Array | None, shape: tuple[int, ...]) -> Array:
            result = np.full((len(points), *shape), np.nan)
            if nodal is not None:
                now = nodal if self.times is None else np.tensordot(shares, nodal, axes=1)
                result[inside] = np.einsum("nk,nk...->n...", weight, now[corner])
            return result

        return value(self.velocity, (2,)), value(self.pressure, ()), value(self.pressure_gradient, (2,))

    def divergence(self) -> Divergence:
        """Divergence of the interpolated velocity in every triangle, and how large it is against U / h."""
        if self.coefficients is not None:
            return self.snapshots().divergence()
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
        share = self._shares()
        steady: dict[str, Any] = {"times": None, "period": None, "coefficients": None, "truncation": None}
        return replace(self.mapped(lambda nodal: np.tensordot(share, nodal, axes=1)), **steady)

    def _shares(self) -> Array:
        """The time mean of every snapshot's or part's weight."""
        assert self.times is not None
        return time_shares(self.times, self.period) if self.coefficients is None else self.coefficients.mean(axis=0)

    def blended(self, lam: float) -> FlowField:
        """The field with the fluctuations of velocity and pressure about their time mean times ``lam``, from 0 to 1.

        k and the dissipation stay: what the resolved fluctuation loses is not added to k, so that between a mean wake
        and the full shedding nothing else changes. Raises SceneError for a ``lam`` out of range.
        """
        if not 0.0 <= lam <= 1.0:
            raise SceneError(f"blended: lam = {lam:g}, allowed 0 to 1")
        if self.times is None or lam == 1.0:
            return self
        share = self._shares()

        def blend(nodal: Array) -> Array:
            mean = np.tensordot(share, nodal, axes=1)
            if self.coefficients is None:
                return np.asarray(mean + lam * (nodal - mean))
            return np.concatenate([mean[None], lam * nodal[1:]])  # part 0 is the mean

        scaled: dict[str, Any] = {
            n: blend(v) for n in ("velocity", "pressure", "given_gradient") if (v := getattr(self, n)) is not None
        }
        return replace(self, **scaled)

    def compressed(self, error: float = 0.01, knots: int | None = None) -> FlowField:
        """Snapshots over a period as mean and modes with smooth functions of time; see :mod:`.compress`.

        ``error``: rms error of velocity and of pressure over the rms of their fluctuations; ``truncation`` says what it
        became, and what k and the dissipation lost. ``knots`` of the functions of time, as few as needed by default.
        Nodal values are rounded to single precision. Raises SceneError without a period or with fewer than eight
        snapshots. A field that is compressed already, or steady, comes back as it is.
        """
        if self.times is None or self.coefficients is not None:
            return self
        parts, coefficients, lost = compress(self, error, knots)
        assert self.period is not None
        start = self.times[0] + np.arange(len(coefficients)) * (self.period / len(coefficients))
        changes: dict[str, Any] = {**parts, "truncation": lost._replace(knots=len(coefficients))}
        return replace(self, **changes, times=start, coefficients=coefficients)

    def snapshots(self) -> FlowField:
        """Mean and modes as snapshots at the knots; other fields as they are.

        k and dissipation, of which a truncation may leave nothing or less where they are small, are kept above a
        twentieth of their means: an eddy's lifetime is their quotient.
        """
        if self.coefficients is None:
            return self
        assert self.times is not None
        assert self.period is not None
        drawn = design(self.times, float(self.times[0]), self.period, len(self.times)) @ self.coefficients
        whole = self.mapped(lambda nodal: np.tensordot(drawn, nodal, axes=1))
        limited: dict[str, Any] = {
            name: np.maximum(values, LEAST * getattr(self, name)[0])
            for name in ("k", "dissipation")
            if (values := getattr(whole, name)) is not None
        }
        return replace(whole, **limited, coefficients=None, truncation=None)

    def moving(self, amplitude: ArrayLike, omega: float, phase: float = 0.0) -> FlowField:
        """The field on a mesh that swings by ``amplitude`` (2,) m times sin(``omega`` t + ``phase``), rad/s and rad.

        The points are those of the middle position; velocities stay what they are, absolute. A field in time must
        repeat after a whole number of swings, which is a SceneError otherwise.
        """
        across, along = np.asarray(amplitude, dtype=float).tolist()
        swing = Swing(across, along, float(omega), float(phase))
        if not (np.all(np.isfinite(swing)) and swing.omega > 0):
            raise SceneError(f"motion: amplitude, omega and phase {tuple(swing)} must be finite, and omega positive")
        if self.times is not None:
            turns = np.inf if self.period is None else self.period * swing.omega / (2 * np.pi)
            if not abs(turns - np.round(turns)) <= WHOLE:
                raise SceneError(f"motion: the field repeats after {turns:.4g} swings of its mesh, not a whole number")
        return replace(self, motion=swing)

    def mirrored(self, x: float = 0.0) -> FlowField:
        """The whole field of a half domain (all points on one side of the vertical line at ``x``); nodes on it are
        shared.

        The x components of velocity and pressure gradient change sign across the axis and are zero on it.
        Raises SceneError when points lie on both sides, or none on the axis.
        """
        return mirrored(self, x)

    def reflected(self, x: float = 0.0) -> FlowField:
        """The mirror image of the field about the vertical line at ``x``."""
        return reflected(self, x)

    def mapped(self, function: Any) -> FlowField:
        """The same field with ``function`` applied to every nodal array."""
        return replace(self, **{n: function(v) for n in NODAL if (v := getattr(self, n)) is not None})

    # -- files -----------------------------------------------------------------------------------------------------

    def save(self, path: Path | str) -> None:
        """Write all arrays to one .npz file, whole or not at all; nodal arrays of modes in single precision."""
        names = [f for f in self.__dataclass_fields__ if getattr(self, f) is not None]
        short = NODAL if self.coefficients is not None else ()
        with atomic_write(path, "wb") as stream:
            arrays = {n: np.asarray(getattr(self, n), dtype=np.float32 if n in short else None) for n in names}
            np.savez(stream, **arrays)  # type: ignore[arg-type]

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


def _truncation(values: ArrayLike) -> Truncation:
    modes, knots, snapshots, *lost = checks.numbers("truncation", values).ravel().tolist()
    return Truncation(int(modes), int(knots), int(snapshots), *lost)
