"""Airflows known in closed form, stored on triangles: potential flow about a body, a manufactured wake, cells.

Each is a stream function psi (m2/s), velocity (d psi / dy, -d psi / dx), so that it keeps volume; what granules fly
through is its values at the nodes. That stored field is the truth: error of the airflow there is none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import FlownAir
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.core.code_key import code_key
from wakeflow.core.geometry import distance_to
from wakeflow.core.lazy import cached_property
from wakeflow.core.store import content_key, digest_files
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.airflow_choice import AirflowPlan
from wakeflow.planning.plan import Plan
from wakeflow.scene import Scene

Array = NDArray[np.float64]
Stream = Callable[[Array], Array]
DISPERSION = "dispersion"
RAYS, LAYERS, GROWTH = 72, 24, 1.12  # of the mesh about a body
COLUMNS, ROWS = 32, 48  # of the one where nothing stands
SLACK = 2e-6  # channel widths: how far the field reaches beyond the lines at which tracks end
DIFFERENCE_STEP = 1e-7  # of the channel's width: step of the differences that take velocities from psi
CORNER = 2e-2  # rad: rays so near to one through a corner are left out
LAYER = 0.12  # thickness of the manufactured wall layer, in widths of the body
EDDY = 0.1  # size of eddies in channel widths


@dataclass(frozen=True)
class StoredFlow:
    """What air a scene has: the ``flow``'s name, the strength ``amount`` of what is not uniform in it, over the mean
    speed, and the ``intensity`` of its turbulence, 0 for air without any.
    """

    flow: str
    amount: float = 0.0
    intensity: float = 0.0


# -- stream functions --------------------------------------------------------------------------------------------------


def stream(air: StoredFlow, scene: Scene) -> Stream:
    """psi of points (n, 2). Raises KeyError for a flow that there is not."""
    return FLOWS[air.flow](air, scene)


def _signed(scene: Scene) -> float:
    assert scene.air is not None
    return scene.air.speed if scene.air.direction == "down" else -scene.air.speed


def _dipole(points: Array, width: float) -> Array:
    """That of a row of dipoles of unit strength along the channel, one a width apart: sin a / (cosh b - cos a)."""
    a, b = 2.0 * np.pi * points.T / width
    return np.asarray(np.sin(a) / np.maximum(np.cosh(b) - np.cos(a), 1e-12))


def _potential(air: StoredFlow, scene: Scene) -> Stream:
    """Uniform stream with a row of dipoles: exact potential flow between walls about the :func:`oval`."""
    speed, width = _signed(scene), scene.channel.width
    return lambda x: speed * (x[:, 0] - air.amount * width * _dipole(x, width))


def oval(amount: float, width: float, corners: int = 32) -> Array:
    """Corners (k, 2) m, anticlockwise, of the closed streamline psi = 0 about dipoles of strength ``amount`` in a
    channel of ``width`` (m).
    """
    angle = 2.0 * np.pi * (np.arange(corners) + 0.5) / corners
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low, high = np.full(corners, 1e-4 * width), np.full(corners, 0.45 * width)
    for _ in range(60):
        middle = 0.5 * (low + high)
        x = middle[:, None] * ray
        inside = (x[:, 0] - amount * width * _dipole(x, width)) * np.sign(x[:, 0]) < 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.asarray(low[:, None] * ray)


def _wake(air: StoredFlow, scene: Scene) -> Stream:
    """A stream that is at rest on the body, with a pair of eddies behind it: manufactured, of no equation's."""
    outline, speed = scene.first_outline, _signed(scene)
    assert outline is not None
    width, behind = scene.width, float(outline[:, 1].min() if speed > 0.0 else outline[:, 1].max())

    def psi(x: Array) -> Array:
        rest = 1.0 - np.exp(-((distance_to(x, outline) / (LAYER * width)) ** 2))
        along = (x[:, 1] - behind) * (-1.0 if speed > 0.0 else 1.0) / width
        eddies = np.exp(-((x[:, 0] / (0.5 * width)) ** 2) - (along - 0.7) ** 2)
        return np.asarray(speed * x[:, 0] * rest * (1.0 - (1.0 + air.amount) * eddies))

    return psi


def _cells(air: StoredFlow, scene: Scene) -> Stream:
    """A uniform stream with square cells of swirl in it, three across the channel."""
    speed, width = _signed(scene), scene.channel.width
    wave = 3.0 * np.pi / width

    def psi(x: Array) -> Array:
        swirl = np.sin(wave * (x[:, 0] + 0.5 * width)) * np.sin(wave * x[:, 1])
        return np.asarray(speed * (x[:, 0] + air.amount / wave * swirl))

    return psi


FLOWS: dict[str, Callable[[StoredFlow, Scene], Stream]] = {"potential": _potential, "wake": _wake, "cells": _cells}


# -- fields ------------------------------------------------------------------------------------------------------------


def field_of(air: StoredFlow, scene: Scene) -> FlowField:
    """The air of the whole channel, with k and its dissipation where it is turbulent."""
    assert scene.air is not None
    points, triangles = _grid(scene) if scene.first_outline is None else _about(scene, scene.first_outline)
    psi, step = stream(air, scene), DIFFERENCE_STEP * scene.channel.width
    across, along = np.array([step, 0.0]), np.array([0.0, step])
    x, y = ((psi(points + d) - psi(points - d)) / (2.0 * step) for d in (across, along))
    velocity = np.stack([y, -x], axis=1)
    pressure = -0.5 * scene.air.density * (velocity**2).sum(axis=1)
    k = dissipation = None
    if air.intensity > 0.0:
        k = np.full(len(points), 1.5 * (air.intensity * scene.air.speed) ** 2)
        dissipation = k**1.5 / (EDDY * scene.channel.width)
    return FlowField.from_arrays(
        points, triangles, velocity, pressure, k=k, dissipation=dissipation, density=scene.air.density,
        viscosity=scene.air.viscosity,
    )  # fmt: skip


def _box(scene: Scene) -> tuple[Array, Array]:
    channel = scene.channel
    slack = SLACK * channel.width
    low = np.array([-0.5 * channel.width, channel.bottom - slack])
    return low, np.array([0.5 * channel.width, channel.top + slack])


def _grid(scene: Scene) -> tuple[Array, NDArray[np.int64]]:
    """Points and triangles of the whole channel."""
    low, high = _box(scene)
    x, y = (np.linspace(low[i], high[i], n + 1) for i, n in enumerate((COLUMNS, ROWS)))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    return points.reshape(-1, 2), _halved(np.arange((COLUMNS + 1) * (ROWS + 1)).reshape(COLUMNS + 1, ROWS + 1))


def _halved(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles of a grid of numbered points, each of its cells cut in two."""
    one, two, three, four = (number[i:j, k:m].ravel() for i, j, k, m in (
        (None, -1, None, -1), (1, None, None, -1), (1, None, 1, None), (None, -1, 1, None)))  # fmt: skip
    return np.concatenate([np.stack([one, two, three], axis=1), np.stack([one, three, four], axis=1)])


def _about(scene: Scene, outline: Array) -> tuple[Array, NDArray[np.int64]]:
    """Points and triangles between a body, every point of whose outline is seen from its middle, and the channel."""
    middle = outline.mean(axis=0)
    (left, bottom), (right, top) = _box(scene)
    box = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    corners = np.concatenate([_angles(outline - middle), _angles(box - middle)])
    even = np.linspace(-np.pi, np.pi, RAYS, endpoint=False)
    apart = np.abs(np.angle(np.exp(1j * (even[:, None] - corners)))).min(axis=1)
    angle = np.unique(np.concatenate([corners, even[apart > CORNER]]))
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner, outer = (middle + _reach(polygon - middle, ray)[:, None] * ray for polygon in (outline, box))
    part = (GROWTH ** np.arange(LAYERS + 1) - 1.0) / (GROWTH**LAYERS - 1.0)
    points = inner + part[:, None, None] * (outer - inner)
    number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    return points.reshape(-1, 2), _halved(np.concatenate([number, number[:, :1]], axis=1))


def _angles(x: Array) -> Array:
    return np.asarray(np.arctan2(x[:, 1], x[:, 0]))


def _reach(polygon: Array, ray: Array) -> Array:
    """How far (n,) a polygon about the origin reaches along each unit vector (n, 2)."""
    start, along = polygon, np.roll(polygon, -1, axis=0) - polygon
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = ray[:, None, 0] * along[:, 1] - ray[:, None, 1] * along[:, 0]
        far = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / turn
        part = (start[:, 0] * ray[:, None, 1] - start[:, 1] * ray[:, None, 0]) / turn
    meets = (part > -1e-9) & (part < 1.0 + 1e-9) & (far > 0.0)
    return np.asarray(np.where(meets, far, np.inf).min(axis=1))


# -- as a run has them -------------------------------------------------------------------------------------------------


@dataclass
class StoredAir(FlownAir):
    """The kind of airflow of an :class:`StoredFlow`: nothing of it is unknown."""

    flow: StoredFlow = field(kw_only=True)
    at_once = True

    @property
    def key(self) -> str:
        tables = (repr(table) for table in (self.flow, self.scene.air, self.scene.channel, self.scene.body))
        return content_key("stored", *tables, digest_files([Path(__file__)]), code_key("wakeflow.air.field"))

    def make_field(self) -> FlowField:
        return field_of(self.flow, self.scene)

    def make_numbers(self) -> Airflow:
        return Airflow(verdict=self.flow.flow)


@dataclass
class StoredPipeline(Pipeline):
    """A pipeline through a ``stored`` flow in place of what its plan would solve; None: as the plan has it."""

    stored: StoredFlow | None = None

    @cached_property
    def air(self) -> FlownAir:
        if self.stored is None:
            return super().air
        return StoredAir(self.scene, self.plan, self.cache, flow=self.stored)


def plan_in(air: StoredFlow | None, plan: Plan) -> Plan:
    """``plan`` with the stored ``air`` in place of one to be solved; in air without turbulence nothing is dispersed."""
    if air is None:
        return plan
    chosen = AirflowPlan(plan.airflow.rung, f"stored: {air.flow}", "", plan.airflow.turbulence, False, False)
    if air.intensity > 0.0:
        return replace(plan, airflow=chosen)
    fractions = {
        name: replace(how, forces=tuple(force for force in how.forces if force != DISPERSION))
        for name, how in plan.fractions.items()
    }
    left_out = tuple(row for row in plan.left_out if row.name != DISPERSION)
    return replace(plan, airflow=chosen, fractions=fractions, left_out=left_out)
