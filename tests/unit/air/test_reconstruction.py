"""Cell values to node values: linear fields exact, curved ones second order, walls have p itself, divergence goes."""

from pathlib import Path

import numpy as np
import pytest

from wakeflow.air.foam.read import CaseFields, read_flow
from wakeflow.air.foam.reconstruction import PlaneMesh, Reconstruction, solenoidal, triangulate


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


SIDE = 4  # cells along each side of the unit square
STORED = 9.0  # k that a wall function leaves on the wall: nothing of the pressure there


def pressure(where: np.ndarray) -> np.ndarray:
    """OpenFOAM's p: static plus 2k/3."""
    return 1.0 + 2.0 * where[..., 0] + 3.0 * where[..., 1]


def energy(where: np.ndarray) -> np.ndarray:
    return 0.6 + 0.3 * where[..., 1]


def write(path: Path, kind: str, body: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f"FoamFile {{ version 2.0; format ascii; class {kind}; object {path.name}; }}\n{body}\n", encoding="utf-8"
    )


def listed(rows: list[str]) -> str:
    return f"{len(rows)}\n(\n" + "\n".join(rows) + "\n)"


def block(case: Path) -> None:
    """polyMesh of the square: bottom a no-slip wall, right a wall that the air slides along, left inlet, top outlet."""
    line = np.linspace(0, 1, SIDE + 1)
    flat = [(x, y) for y in line for x in line]
    layer = len(flat)

    def sides(a: int, b: int) -> str:
        return f"4({a} {b} {b + layer} {a + layer})"

    at = np.arange(layer).reshape(SIDE + 1, SIDE + 1)  # [row, column]
    cell = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    inner: list[tuple[int, int, str]] = []
    for row in range(SIDE):
        for column in range(SIDE):
            if column < SIDE - 1:
                ends = at[row, column + 1], at[row + 1, column + 1]
                inner.append((cell[row, column], cell[row, column + 1], sides(*ends)))
            if row < SIDE - 1:
                ends = at[row + 1, column + 1], at[row + 1, column]
                inner.append((cell[row, column], cell[row + 1, column], sides(*ends)))
    inner.sort()
    corners = [(at[r, c], at[r, c + 1], at[r + 1, c + 1], at[r + 1, c]) for r in range(SIDE) for c in range(SIDE)]
    edges = range(SIDE)
    patches = {
        "bottom": ("wall", [(cell[0, i], sides(at[0, i], at[0, i + 1])) for i in edges]),
        "right": ("wall", [(cell[i, -1], sides(at[i, -1], at[i + 1, -1])) for i in edges]),
        "outlet": ("patch", [(cell[-1, i], sides(at[-1, i + 1], at[-1, i])) for i in edges]),
        "inlet": ("patch", [(cell[i, 0], sides(at[i + 1, 0], at[i, 0])) for i in edges]),
        "back": ("empty", [(n, f"4({a} {d} {c} {b})") for n, (a, b, c, d) in enumerate(corners)]),
        "front": ("empty", [(n, "4({} {} {} {})".format(*(v + layer for v in q))) for n, q in enumerate(corners)]),
    }
    mesh, start, entries = case / "constant" / "polyMesh", len(inner), []
    outer = [face for _, faces in patches.values() for face in faces]
    for name, (kind, faces) in patches.items():
        entries.append(f"{name} {{ type {kind}; nFaces {len(faces)}; startFace {start}; }}")
        start += len(faces)
    write(mesh / "points", "vectorField", listed([f"({x} {y} {z})" for z in (0, 1) for x, y in flat]))
    write(mesh / "faces", "faceList", listed([face for *_, face in inner] + [face for _, face in outer]))
    write(mesh / "owner", "labelList", listed([str(a) for a, *_ in inner] + [str(a) for a, _ in outer]))
    write(mesh / "neighbour", "labelList", listed([str(b) for _, b, _ in inner]))
    write(mesh / "boundary", "polyBoundaryMesh", listed(entries))


@pytest.fixture
def case(tmp_path: Path) -> Path:
    block(tmp_path)
    middle = (np.arange(SIDE) + 0.5) / SIDE
    centres = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
    outlet = np.column_stack([middle, np.ones(SIDE)])

    def scalar(name: str, law: object, edges: str) -> None:
        cells = listed([repr(float(v)) for v in law(centres)])  # type: ignore[operator]
        free = "front { type empty; } back { type empty; } right { type zeroGradient; } inlet { type zeroGradient; }"
        write(
            tmp_path / "1" / name,
            "volScalarField",
            f"internalField nonuniform List<scalar> {cells};\nboundaryField {{ {free} {edges} }}",
        )

    fixed = listed([repr(float(v)) for v in pressure(outlet)])
    ends = f"outlet {{ type fixedValue; value nonuniform List<scalar> {fixed}; }}"
    scalar("p", pressure, f"bottom {{ type zeroGradient; }} {ends}")
    wall = f"bottom {{ type kLowReWallFunction; value uniform {STORED}; }}"
    scalar("k", energy, f"{wall} outlet {{ type fixedValue; value uniform {energy(np.ones(2))}; }}")
    write(
        tmp_path / "1" / "U",
        "volVectorField",
        "internalField uniform (1 0 0);\nboundaryField { front { type empty; } back { type empty; }"
        " right { type slip; } bottom { type noSlip; }"
        " inlet { type fixedValue; value uniform (1 0 0); } outlet { type zeroGradient; } }",
    )
    write(tmp_path / "constant" / "transportProperties", "dictionary", "nu 1e-5;")
    return tmp_path


def test_edges_of_a_no_slip_wall_have_p_itself_and_all_others_p_less_2k_over_3(case: Path) -> None:
    fields = CaseFields(case)
    shot, plane = fields.snapshot(fields.folder("latest")), fields.mesh.plane
    beside = plane.centres[plane.owner]  # zero gradient: the value of the cell
    wall, slip, outlet = (plane.on(name) for name in ("bottom", "right", "outlet"))
    np.testing.assert_allclose(shot.faces["pressure"][wall], pressure(beside[wall]))
    np.testing.assert_allclose(shot.faces["pressure"][slip], (pressure(beside) - 2 / 3 * energy(beside))[slip])
    top = plane.midpoints[outlet]
    np.testing.assert_allclose(shot.faces["pressure"][outlet], pressure(top) - 2 / 3 * energy(top))
    np.testing.assert_allclose(shot.cells["pressure"], pressure(plane.centres) - 2 / 3 * energy(plane.centres))


def test_nodes_on_the_wall_take_p_and_the_wall_function_leaves_no_gradient_in_the_first_cell(case: Path) -> None:
    """p is linear: every node is exact. With the stored k of 9 the first cell would hold a fall of 6 to the wall, where
    the static pressure rises by the 2k/3 of the air beside it.
    """
    flow = read_flow(case, density=2.0)
    points = flow["points"]
    wall = points[:, 1] < 1e-9
    whole = 2.0 * pressure(points)
    np.testing.assert_allclose(flow["pressure"][wall], whole[wall])
    np.testing.assert_allclose(flow["pressure"][~wall], (whole - 4 / 3 * energy(points))[~wall])
    first = np.isclose(points[:, 1], 1 / SIDE)
    rise = (flow["pressure"] - whole)[wall][:, None] - (flow["pressure"] - whole)[first]
    np.testing.assert_allclose(rise, 4 / 3 * energy(np.array([0.0, 1 / SIDE])))


def test_eddies_vanish_on_a_no_slip_wall_whatever_its_wall_function_stores(case: Path) -> None:
    """Off the wall k is linear, as given: neither the stored 9 nor the 0 of the wall is in the fits beside it."""
    flow = read_flow(case)
    y, k = flow["points"][:, 1], flow["k"]
    assert k is not None
    assert np.all(k[y < 1e-9] == 0.0)
    inner = (y > 1e-9) & (y < 1.0 - 1e-9)
    np.testing.assert_allclose(k[inner], energy(flow["points"])[inner], rtol=1e-9)


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
