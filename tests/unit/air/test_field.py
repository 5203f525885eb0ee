"""FlowField: linear is exact, gradients are second order, mirrors are mirrors; vorticity and stream function."""

from pathlib import Path

import numpy as np
import pytest

from support import field_of, shaken_mesh
from wakeflow.air.field import FlowField
from wakeflow.air.field.flow import stream_function, vorticity
from wakeflow.core.errors import SceneError


def linear(points: np.ndarray) -> np.ndarray:
    return np.stack([1 + 2 * points[:, 0] - points[:, 1], -3 + points[:, 0] + 0.5 * points[:, 1]], axis=1)


def test_linear_fields_are_sampled_to_round_off_and_nan_outside() -> None:
    points, cells = shaken_mesh(12)
    field = FlowField.from_arrays(points, cells, linear(points), pressure=2 * points[:, 0] - 7 * points[:, 1])
    x = np.random.default_rng(2).uniform(-0.2, 1.2, (3000, 2))
    velocity, pressure, gradient = field.sample(x)
    inside = np.all((x >= 0) & (x <= 1), axis=1)
    np.testing.assert_array_equal(np.isfinite(pressure), inside)
    np.testing.assert_allclose(velocity[inside], linear(x[inside]), atol=1e-13)
    np.testing.assert_allclose(pressure[inside], 2 * x[inside, 0] - 7 * x[inside, 1], atol=1e-13)
    np.testing.assert_allclose(gradient[inside], [[2, -7]] * int(inside.sum()), atol=1e-11)


def test_points_behind_a_hole_are_found() -> None:
    points, cells = shaken_mesh(20, shift=0.2)
    keep = np.abs(points[cells].mean(axis=1) - 0.5).max(axis=1) > 0.2
    field = FlowField.from_arrays(points, cells[keep], linear(points))
    x = np.random.default_rng(3).uniform(0, 1, (2000, 2))
    found = field.locate(x)
    corner = field.barycentric(found[found >= 0], x[found >= 0])
    assert corner.min() >= -1e-9
    full = FlowField.from_arrays(points, cells, linear(points))
    expected = keep[full.locate(x)]
    np.testing.assert_array_equal(found >= 0, expected)


def test_nodes_and_boundary_points_are_inside() -> None:
    points, cells = shaken_mesh(7)
    field = FlowField.from_arrays(points, cells, linear(points))
    assert np.all(field.locate(points) >= 0)


def test_pressure_gradient_is_exact_for_quadratics() -> None:
    points, cells = shaken_mesh(9)
    x, y = points.T
    field = FlowField.from_arrays(points, cells, linear(points), pressure=1 + x - 2 * y + 3 * x * x - x * y + y * y)
    exact = np.stack([1 + 6 * x - y, -2 - x + 2 * y], axis=1)
    np.testing.assert_allclose(field.pressure_gradient, exact, atol=1e-11)


def test_pressure_gradient_converges_at_second_order_also_on_the_boundary() -> None:
    worst = []
    for n in (16, 32, 64):
        points, cells = shaken_mesh(n)
        x, y = points.T
        field = FlowField.from_arrays(points, cells, linear(points), pressure=np.sin(3 * x) * np.cos(2 * y + 0.3))
        exact = np.stack([3 * np.cos(3 * x) * np.cos(2 * y + 0.3), -2 * np.sin(3 * x) * np.sin(2 * y + 0.3)], axis=1)
        worst.append(np.linalg.norm(field.pressure_gradient - exact, axis=1).max())
    orders = np.log2(np.array(worst[:-1]) / worst[1:])
    assert np.log2(worst[0] / worst[-1]) / 2 > 1.8, orders
    assert worst[-1] < 6e-3


def test_stretched_cells_do_not_spoil_the_gradient() -> None:
    points, cells = shaken_mesh(16)
    points = points * [1.0, 1e-3]
    x, y = points.T
    field = FlowField.from_arrays(points, cells, linear(points), pressure=x * x + 1e6 * y * y)
    exact = np.stack([2 * x, 2e6 * y], axis=1)
    np.testing.assert_allclose(field.pressure_gradient, exact, atol=1e-8)


def test_a_mesh_too_small_for_quadratics_gets_a_linear_fit() -> None:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    field = FlowField.from_arrays(corners, [[0, 1, 2], [0, 2, 3]], np.zeros((4, 2)), pressure=corners @ [3.0, -2.0])
    np.testing.assert_allclose(field.pressure_gradient, [[3, -2]] * 4, atol=1e-12)


def half_field(n: int = 10) -> FlowField:
    points, cells = shaken_mesh(n)
    x, y = points.T
    velocity = np.stack([x * (1 + y), -2 - x**2], axis=1)
    return FlowField.from_arrays(points, cells, velocity, pressure=np.cos(x) + y, k=x**2)


def test_a_mirrored_field_is_its_own_mirror_image() -> None:
    half = half_field()
    whole = half.mirrored()
    axis = int(np.sum(half.points[:, 0] == 0))
    assert len(whole.points) == 2 * len(half.points) - axis
    assert whole.area.sum() == pytest.approx(2.0)
    assert np.sum(whole.neighbours < 0) == 6 * 10  # the axis is inside now
    x = np.random.default_rng(4).uniform(0, 1, (500, 2))
    right, left = whole.sample(x), whole.sample(x * [-1, 1])
    np.testing.assert_allclose(left[0], right[0] * [-1, 1], atol=1e-13)
    np.testing.assert_allclose(left[1], right[1], atol=1e-13)
    np.testing.assert_allclose(left[2], right[2] * [-1, 1], atol=1e-10)
    np.testing.assert_allclose(right[0], half.sample(x)[0], atol=1e-13)
    on_axis = whole.points[:, 0] == 0
    np.testing.assert_array_equal(whole.velocity[on_axis, 0], 0.0)


def test_mirroring_keeps_snapshots_and_refuses_both_sides() -> None:
    half = half_field(4)
    timed = FlowField.from_arrays(
        half.points, half.triangles, np.stack([half.velocity, 2 * half.velocity]), times=[0, 1], period=2.0
    )
    whole = timed.mirrored()
    assert whole.velocity.shape == (2, len(whole.points), 2)
    np.testing.assert_allclose(whole.velocity[1], 2 * whole.velocity[0])
    with pytest.raises(SceneError, match="both sides"):
        whole.mirrored()
    with pytest.raises(SceneError, match="no points on the axis"):
        half.mirrored(-0.5)


def test_divergence_of_a_linear_field_is_its_trace_and_of_a_shear_zero() -> None:
    points, cells = shaken_mesh(8)
    field = FlowField.from_arrays(points, cells, linear(points))
    np.testing.assert_allclose(field.divergence().values, 2.5, atol=1e-11)
    assert field.divergence().rms > 0
    shear = FlowField.from_arrays(points, cells, np.stack([points[:, 1], 0 * points[:, 0]], axis=1))
    assert shear.divergence().max < 1e-12


def timed_field(period: float | None) -> FlowField:
    points, cells = shaken_mesh(3)
    base = linear(points)
    return FlowField.from_arrays(
        points, cells, np.stack([0 * base, base, 3 * base]), pressure=np.zeros((3, len(points))),
        times=[1.0, 2.0, 4.0], period=period,
    )  # fmt: skip


@pytest.mark.parametrize(("t", "factor"), [(0.0, 0.0), (1.0, 0.0), (1.5, 0.5), (3.0, 2.0), (4.0, 3.0), (9.0, 3.0)])
def test_between_snapshots_it_is_linear_and_outside_it_stands_still(t: float, factor: float) -> None:
    x = np.array([[0.3, 0.6]])
    np.testing.assert_allclose(timed_field(None).sample(x, t)[0], factor * linear(x), atol=1e-13)


@pytest.mark.parametrize(("t", "factor"), [(1.5, 0.5), (4.5, 1.5), (5.0, 0.0), (6.5, 1.5), (-2.5, 0.5), (0.5, 1.5)])
def test_a_period_joins_the_last_snapshot_to_the_first(t: float, factor: float) -> None:
    x = np.array([[0.3, 0.6]])
    np.testing.assert_allclose(timed_field(4.0).sample(x, t)[0], factor * linear(x), atol=1e-12)


def test_the_mean_weighs_snapshots_by_the_time_they_stand_for() -> None:
    x = np.array([[0.3, 0.6]])
    np.testing.assert_allclose(timed_field(None).mean().sample(x)[0], (0.5 + 4.0) / 3 * linear(x), atol=1e-13)
    np.testing.assert_allclose(timed_field(4.0).mean().sample(x)[0], (0.5 + 4.0 + 1.5) / 4 * linear(x), atol=1e-13)


def test_saved_and_loaded_is_the_same(tmp_path: Path) -> None:
    for field in (half_field(4), timed_field(4.0)):
        field.save(tmp_path / "field.npz")
        again = FlowField.load(tmp_path / "field.npz")
        assert (again.period, again.density, again.viscosity) == (field.period, field.density, field.viscosity)
        for name in ("points", "triangles", "velocity", "pressure", "k", "times"):
            np.testing.assert_array_equal(getattr(again, name), getattr(field, name))
    (tmp_path / "other.npz").write_bytes(b"no field")
    with pytest.raises(SceneError, match="cannot be read"):
        FlowField.load(tmp_path / "other.npz")
    with pytest.raises(SceneError, match="cannot be read"):
        FlowField.load(tmp_path / "missing.npz")


def test_clockwise_triangles_are_turned_round() -> None:
    points, cells = shaken_mesh(4)
    field = FlowField.from_arrays(points, cells[:, ::-1], linear(points))
    assert np.all(field.area > 0)
    np.testing.assert_allclose(field.sample([[0.4, 0.4]])[0], linear(np.array([[0.4, 0.4]])), atol=1e-14)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": np.zeros((5, 3))}, r"points: shape \(5, 3\)"),
        ({"velocity": np.zeros((3, 2))}, r"velocity: shape \(3, 2\), expected \(4, 2\)"),
        ({"velocity": np.full((4, 2), np.nan)}, r"velocity: 8 of 8 values are not finite, the first at \(0, 0\)"),
        ({"triangles": [[0, 1, 9]]}, "triangles: node 9"),
        ({"triangles": [[0, 1, 1], [0, 1, 2]]}, "triangles: 1 of 2 have no area, the first is 0"),
        ({"triangles": [[0.5, 1, 2]]}, "of integers"),
        ({"pressure": np.zeros(3)}, "pressure: shape"),
        ({"period": 1.0}, "needs the times"),
        ({"times": [0.0, 0.0], "velocity": np.zeros((2, 4, 2))}, "times: must increase"),
        ({"times": [0.0, 2.0], "velocity": np.zeros((2, 4, 2)), "period": 1.0}, "period = 1 s is shorter"),
        ({"density": 0.0}, "density = 0 must be positive"),
        ({"viscosity": -1.0}, "viscosity = -1 must be positive"),
    ],
)
def test_bad_input_is_one_line_that_names_it(changes: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "points": [[0, 0], [1, 0], [1, 1], [0, 1]],
        "triangles": [[0, 1, 2], [0, 2, 3]],
        "velocity": np.zeros((4, 2)),
    }
    with pytest.raises(SceneError, match=message) as caught:
        FlowField.from_arrays(**(good | changes))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_an_edge_of_three_triangles_is_refused() -> None:
    points = np.array([[0, 0], [1, 0], [0.5, 1], [0.5, 2], [0.5, -1.0]])
    field = FlowField.from_arrays(points, [[0, 1, 2], [0, 1, 3], [0, 4, 1]], np.zeros((5, 2)))
    with pytest.raises(SceneError, match="more than two triangles"):
        field.neighbours  # noqa: B018


def test_a_reflected_field_is_the_mirror_image_everywhere() -> None:
    rng = np.random.default_rng(5)
    points = np.array([(-1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (-1.0, 1.0), (0.3, 0.4)])
    triangles = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    field = FlowField.from_arrays(
        points, triangles, rng.normal(size=(3, 5, 2)), rng.normal(size=(3, 5)), times=[0.0, 1.0, 2.0], period=3.0
    )
    x = rng.uniform((-0.9, 0.1), (1.9, 0.9), size=(50, 2))
    velocity, pressure, gradient = field.sample(x, 0.7)
    image = field.reflected()
    mirrored = image.sample(x * (-1.0, 1.0), 0.7)
    np.testing.assert_allclose(mirrored[0], velocity * (-1.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(mirrored[1], pressure, atol=1e-12)
    np.testing.assert_allclose(mirrored[2], gradient * (-1.0, 1.0), atol=1e-9)


def _strain_and_turn(points: np.ndarray) -> np.ndarray:
    """psi = x y + x^2 + y^2: u = x + 2 y, v = -y - 2 x; it turns with -4 1/s everywhere."""
    x, y = points.T
    return np.stack([x + 2.0 * y, -y - 2.0 * x], axis=1)


def test_the_vorticity_of_a_linear_flow_is_exact() -> None:
    assert vorticity(field_of(_strain_and_turn)) == pytest.approx(-4.0)


def test_stream_function_gives_the_flow_between_two_points() -> None:
    errors = []
    for n in (10, 20):
        field = field_of(_strain_and_turn, n)
        x, y = field.points.T
        exact = x * y + x**2 + y**2
        psi = stream_function(field)
        errors.append(np.abs(psi - psi.mean() - (exact - exact.mean())).max())
    assert errors[0] < 0.05
    assert errors[1] < errors[0] / 3.0  # second order


def test_the_stream_function_is_of_one_instant() -> None:
    field = field_of(_strain_and_turn)
    moving = type(field).from_arrays(
        field.points, field.triangles, np.stack([field.velocity] * 2), times=[0.0, 1.0]
    )  # fmt: skip
    with pytest.raises(ValueError, match="steady"):
        stream_function(moving)
    assert vorticity(moving).shape == (2, len(field.points))
