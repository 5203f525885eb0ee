"""Cell values to node values: linear fields to round-off everywhere, second order on curved fields, walls exact."""

from __future__ import annotations

import numpy as np
import pytest

from wakeflow.foam.reconstruction import PlaneMesh, Reconstruction, triangulate


def plane(count: int, kind: str, seed: int = 0) -> PlaneMesh:
    """The unit square with ``count`` cells a side, inner points moved at random, as quads, triangles or both."""
    line = np.linspace(0, 1, count + 1)
    points = np.array([(x, y) for y in line for x in line])
    inner = ((points > 1e-9) & (points < 1 - 1e-9)).all(axis=1)
    points[inner] += np.random.default_rng(seed).uniform(-0.2, 0.2, (inner.sum(), 2)) / count
    cells, below = [], {}
    for row in range(count):
        for column in range(count):
            a = row * (count + 1) + column
            quad = np.array([a, a + 1, a + count + 2, a + count + 1])
            if kind == "quad" or (kind == "mixed" and (row + column) % 2):
                cells.append(quad)
            else:
                cells += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    for number, cell in enumerate(cells):
        for a, b in zip(cell, np.roll(cell, -1), strict=True):
            below.setdefault(frozenset((int(a), int(b))), []).append((int(a), int(b), number))
    boundary = [found[0] for found in below.values() if len(found) == 1]
    ends = np.array([(a, b) for a, b, _ in boundary])
    middle = points[ends].mean(axis=1)
    patch = np.select([middle[:, 1] < 1e-9, middle[:, 0] > 1 - 1e-9, middle[:, 1] > 1 - 1e-9], [0, 1, 2], 3)
    return PlaneMesh(
        points, cells, np.array([centroid(points[cell]) for cell in cells]), ends,
        np.array([number for _, _, number in boundary]), patch, ("bottom", "right", "top", "left"),
    )  # fmt: skip


def centroid(corner: np.ndarray) -> np.ndarray:
    x, y = corner.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    return ((corner + np.roll(corner, -1, axis=0)) * cross[:, None]).sum(axis=0) / (3 * cross.sum())


def linear(where: np.ndarray) -> np.ndarray:
    return 3.0 - 2.0 * where[..., 0] + 5.0 * where[..., 1]


def curved(where: np.ndarray) -> np.ndarray:
    return np.sin(2 * where[..., 0]) * np.exp(where[..., 1])


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("known", ["none", "one side", "all sides"])
def test_linear_field_is_exact_at_every_node(kind: str, known: str) -> None:
    mesh = plane(7, kind)
    used = {"none": mesh.patch < 0, "one side": mesh.patch == 1, "all sides": mesh.patch >= 0}[known]
    nodes = Reconstruction(mesh, mesh.patch < 0, mesh.patch < 0).scalar(
        linear(mesh.centres), linear(mesh.midpoints), used
    )
    np.testing.assert_allclose(nodes, linear(mesh.points), rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("known", [False, True])
def test_curved_field_converges_at_second_order_up_to_the_boundary(kind: str, known: bool) -> None:
    errors = []
    for count in (8, 16, 32, 64):
        mesh = plane(count, kind)
        used = np.full(len(mesh.faces), known)
        none = np.zeros(len(mesh.faces), dtype=bool)
        nodes = Reconstruction(mesh, none, none).scalar(curved(mesh.centres), curved(mesh.midpoints), used)
        errors.append(np.abs(nodes - curved(mesh.points)).max())
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert order.mean() > 1.85, f"orders {order}, errors {errors}"


def test_wall_nodes_take_the_velocity_of_the_wall_and_slip_nodes_lose_their_normal_component() -> None:
    mesh = plane(8, "triangle")
    wall, slip = mesh.on("bottom"), mesh.on("left", "right")

    def flow(where: np.ndarray) -> np.ndarray:
        return np.stack([1 + where[..., 0], 2 - where[..., 1]], axis=-1)

    faces = flow(mesh.midpoints)
    faces[wall] = (0.3, -0.1)
    nodes = Reconstruction(mesh, wall, slip).vector(flow(mesh.centres), faces, wall | mesh.on("top"))
    x, y = mesh.points.T
    np.testing.assert_array_equal(nodes[y == 0], np.tile([0.3, -0.1], (9, 1)))
    sides = ((x == 0) | (x == 1)) & (y > 0)
    np.testing.assert_allclose(nodes[sides, 0], 0, atol=1e-14)
    np.testing.assert_allclose(nodes[sides, 1], 2 - y[sides], atol=1e-12)
    inner = (y > 0.2) & ~sides
    np.testing.assert_allclose(nodes[inner], flow(mesh.points[inner]), atol=1e-12)


def test_bounded_values_stay_within_their_cells_and_all_times_use_one_operator() -> None:
    mesh = plane(6, "mixed")
    none = np.zeros(len(mesh.faces), dtype=bool)
    jump = np.where(mesh.centres[:, 0] > 0.5, 1.0, 0.0)
    both = np.stack([jump, 2 * jump])
    reconstruction = Reconstruction(mesh, none, none)
    free = reconstruction.scalar(both, np.zeros((2, len(mesh.faces))), none)
    bounded = reconstruction.scalar(both, np.zeros((2, len(mesh.faces))), none, bounded=True)
    assert free.min() < -0.01
    assert bounded.min() == 0.0
    assert bounded.max() == 2.0
    np.testing.assert_allclose(free[1], 2 * free[0], atol=1e-14)


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_triangles_cover_the_cells_without_overlap(kind: str) -> None:
    mesh = plane(9, kind)
    triangles = triangulate(mesh.points, mesh.cells)
    a, b, c = mesh.points[triangles].transpose(1, 0, 2)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0).all()
    assert area.sum() == pytest.approx(1.0, abs=1e-12)


def test_a_fan_of_two_cells_on_a_wall_still_gets_a_full_fit() -> None:
    """Wall nodes of a quad mesh touch two cells, whose centres lie along the wall: the stencil must grow."""
    mesh = plane(3, "quad")
    operator = Reconstruction(mesh, mesh.patch < 0, mesh.patch < 0).operator(mesh.patch < 0)
    assert np.diff(operator.indptr).min() >= 4
    np.testing.assert_allclose(operator.sum(axis=1), 1.0, atol=1e-12)
