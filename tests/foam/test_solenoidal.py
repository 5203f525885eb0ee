"""A layer of a three-dimensional airflow loses its divergence in the plane, and keeps the rest."""

from __future__ import annotations

import numpy as np

from wakeflow.foam.reconstruction import PlaneMesh, triangulate
from wakeflow.foam.solenoidal import solenoidal


def channel(count: int = 12) -> PlaneMesh:
    """The unit square as quadrilaterals: inlet above, outlet below, walls left and right."""
    side = np.linspace(0.0, 1.0, count + 1)
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    cells = np.stack([corner, corner + 1, corner + count + 2, corner + count + 1], axis=1)
    edge = np.arange(count)
    sides = {
        "outlet": (np.stack([edge, edge + 1], axis=1), edge),
        "inlet": (np.stack([edge, edge + 1], axis=1) + count * (count + 1), edge + count * (count - 1)),
        "left": (np.stack([edge, edge + 1], axis=1) * (count + 1), edge * count),
        "right": (np.stack([edge, edge + 1], axis=1) * (count + 1) + count, edge * count + count - 1),
    }
    faces, owner = (np.concatenate([part[i] for part in sides.values()]) for i in (0, 1))
    patch = np.repeat(np.arange(4), count)
    centres = points[cells].mean(axis=1)
    return PlaneMesh(points, list(cells), centres, faces, owner, patch, tuple(sides))


def test_a_layers_divergence_is_taken_off_and_nothing_else() -> None:
    plane = channel()
    triangles = triangulate(plane.points, plane.cells)
    project = solenoidal(plane, triangles, np.zeros(0, dtype=int))
    x, y = plane.points.T
    free = np.stack([np.sin(np.pi * x) * np.cos(np.pi * y), -np.cos(np.pi * x) * np.sin(np.pi * y) - 1.0], axis=1)
    hump, slope = (lambda s: (s * (1 - s)) ** 2), (lambda s: 2 * s * (1 - s) * (1 - 2 * s))
    source = 400.0 * np.stack([slope(x) * hump(y), hump(x) * slope(y)], axis=1)  # the gradient of a potential
    kept, cleaned = project(np.stack([free, free + source]))
    scale = np.sqrt((source**2).mean())
    assert np.sqrt(((kept - free) ** 2).mean()) < 0.1 * scale
    assert np.sqrt(((cleaned - free) ** 2).mean()) < 0.3 * scale
