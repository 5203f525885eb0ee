"""Static pressure at walls: k is 0 there, so p itself; on a block of cells written by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wakeflow.foam.case_fields import CaseFields
from wakeflow.foam.read import read_flow

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
    np.testing.assert_allclose(shot.pressure_faces[wall], pressure(beside[wall]))
    np.testing.assert_allclose(shot.pressure_faces[slip], (pressure(beside) - 2 / 3 * energy(beside))[slip])
    top = plane.midpoints[outlet]
    np.testing.assert_allclose(shot.pressure_faces[outlet], pressure(top) - 2 / 3 * energy(top))
    np.testing.assert_allclose(shot.pressure, pressure(plane.centres) - 2 / 3 * energy(plane.centres))


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
