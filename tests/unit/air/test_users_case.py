"""A user's OpenFOAM case is read right, or refused with file and cure: how its files say the same thing differs."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.air.foam.polymesh import read_polymesh
from wakeflow.air.foam.read import CaseFields
from wakeflow.air.foam.reconstruction import triangulate
from wakeflow.air.foam.user_case import case_files
from wakeflow.scene.user_files import air_of

WIDE, HIGH, THICK = 4, 6, 0.01
HEAD = "FoamFile\n{{\n    version 2.0;\n    format ascii;\n    class {kind};\n    object {name};\n}}\n// * * //\n"
SIDES = ("inlet", "outlet", "left", "right")


def velocity(x: np.ndarray) -> np.ndarray:
    return np.stack([0.1 + 0.5 * x[:, 0] + 0.3 * x[:, 1], -1 + 0.2 * x[:, 0] - 0.5 * x[:, 1]], axis=1)


def pressure(x: np.ndarray) -> np.ndarray:
    return 2 * x[:, 0] - 3 * x[:, 1]


def listed(rows: list[str]) -> str:
    return f"{len(rows)}\n(\n" + "\n".join(rows) + "\n)\n"


class Case:
    """One layer of cells of a linear flow, 1 by 1.5; the cell in the middle is cut into four where it is ``hanging``,
    those below and left of (0.5, 0.5) are left out where there is a ``box``; ``fine`` times as many each way.
    """

    def __init__(
        self, folder: Path, *, hanging: bool = False, walls: bool = False, box: bool = False, fine: int = 1
    ) -> None:
        self.folder = folder
        wide, high = fine * WIDE, fine * HIGH
        self.points = [(x / wide, y / wide) for y in range(high + 1) for x in range(wide + 1)]
        at = lambda i, j: j * (wide + 1) + i  # noqa: E731
        self.cells = [
            [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
            for j in range(high) for i in range(wide) if not (box and 2 * i < wide and 2 * j < wide)
        ]  # fmt: skip
        if hanging:
            self._refine(2 * WIDE + 1)
        sides = {}
        for n, cell in enumerate(self.cells):
            for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
                sides.setdefault((min(a, b), max(a, b)), []).append((n, a, b))
        inner = sorted((both[0][0], both[1][0], both[0][1], both[0][2]) for both in sides.values() if len(both) == 2)
        self.edges: dict[str, list[tuple[int, int, int]]] = {name: [] for name in (*SIDES, "box")}
        for one, *others in sides.values():
            if not others:
                x, y = self.middle(one)
                name = (
                    "left" if x == 0 else "right" if x == 1 else "outlet" if y == 0 else "inlet" if y == 1.5 else "box"
                )
                self.edges[name].append(one)
        count = len(self.points)
        faces = [[a, b, b + count, a + count] for _, _, a, b in inner]
        owner = [low for low, _, _, _ in inner]
        patches = []
        for name, those in ((name, those) for name, those in self.edges.items() if those):
            kind = "wall" if walls and name in ("left", "right") else "patch"
            patches.append(f"{name} {{ type {kind}; nFaces {len(those)}; startFace {len(faces)}; }}")
            faces += [[a, b, b + count, a + count] for _, a, b in those]
            owner += [n for n, _, _ in those]
        patches.append(f"layer {{ type empty; nFaces {2 * len(self.cells)}; startFace {len(faces)}; }}")
        faces += [cell[::-1] for cell in self.cells] + [[i + count for i in cell] for cell in self.cells]
        owner += 2 * list(range(len(self.cells)))
        points = [f"({x:.12g} {y:.12g} {z})" for z in (0, THICK) for x, y in self.points]
        self.write("constant/polyMesh/points", "vectorField", listed(points))
        self.write("constant/polyMesh/faces", "faceList", listed([f"{len(f)}({' '.join(map(str, f))})" for f in faces]))
        self.write("constant/polyMesh/owner", "labelList", listed([str(one) for one in owner]))
        self.write("constant/polyMesh/neighbour", "labelList", listed([str(high) for _, high, _, _ in inner]))
        self.write("constant/polyMesh/boundary", "polyBoundaryMesh", listed(patches))
        self.write("constant/transportProperties", "dictionary", "transportModel Newtonian;\nnu 1.5e-05;\n")
        names = [name for name, those in self.edges.items() if those]
        self.field("U", velocity, {name: self.condition("fixedValue", velocity, name) for name in names})
        self.field("p", pressure, {name: self.condition("fixedValue", pressure, name) for name in names})

    def _refine(self, n: int) -> None:
        a, b, c, d = self.cells[n]
        mid = lambda *some: tuple(np.mean([self.points[i] for i in some], axis=0).tolist())  # noqa: E731
        k = len(self.points)
        self.points += [mid(a, b), mid(b, c), mid(c, d), mid(d, a), mid(a, b, c, d)]
        new = {(b, a): k, (c, b): k + 1, (d, c): k + 2, (a, d): k + 3}
        for i, cell in enumerate(self.cells):
            pairs = zip(cell, cell[1:] + cell[:1], strict=True)
            self.cells[i] = [one for p, q in pairs for one in (p, *([new[p, q]] if (p, q) in new else []))]
        self.cells[n] = [a, k, k + 4, k + 3]
        self.cells += [[k, b, k + 1, k + 4], [k + 4, k + 1, c, k + 2], [k + 3, k + 4, k + 2, d]]

    def middle(self, edge: tuple[int, int, int]) -> tuple[float, float]:
        (x, y), (u, v) = self.points[edge[1]], self.points[edge[2]]
        return (x + u) / 2, (y + v) / 2

    def write(self, name: str, kind: str, body: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(HEAD.format(kind=kind, name=path.name) + body)

    def condition(self, kind: str, law: Callable[[np.ndarray], np.ndarray], patch: str) -> str:
        return f"type {kind}; value {self.values(law, np.array([self.middle(one) for one in self.edges[patch]]))};"

    def values(self, law: Callable[[np.ndarray], np.ndarray], where: np.ndarray) -> str:
        found = law(where)
        rows = [f"({u:.12g} {v:.12g} 0)" for u, v in found] if found.ndim == 2 else [f"{one:.12g}" for one in found]
        return f"nonuniform List<{'vector' if found.ndim == 2 else 'scalar'}>\n{listed(rows)}"

    def field(
        self, name: str, law: Callable[[np.ndarray], np.ndarray], conditions: dict[str, str], dimensions: str = ""
    ) -> None:
        centres = np.array([_centroid(np.array([self.points[i] for i in cell])) for cell in self.cells])
        vector = law(centres).ndim == 2
        patches = "".join(f"{patch} {{ {said} }}\n" for patch, said in (conditions | {"layer": "type empty;"}).items())
        body = f"dimensions {dimensions or ('[0 1 -1 0 0 0 0]' if vector else '[0 2 -2 0 0 0 0]')};\n"
        body += f"internalField {self.values(law, centres)};\nboundaryField\n{{\n{patches}}}\n"
        self.write(f"1/{name}", f"vol{'Vector' if vector else 'Scalar'}Field", body)


def _centroid(p: np.ndarray) -> np.ndarray:
    x, y = p.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    return np.array([((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()]) / (3 * cross.sum())


@pytest.fixture
def case(tmp_path: Path) -> Case:
    return Case(tmp_path / "case")


def changed(name: str, before: str, after: str) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        path = case.folder / name
        text = path.read_text()
        assert before in text
        path.write_text(text.replace(before, after))

    return change


def packed(case: Case) -> None:
    for name in ("U", "p"):
        path = case.folder / "1" / name
        path.with_name(f"{name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()


def of_the_foundation(case: Case) -> None:
    (case.folder / "constant" / "transportProperties").unlink()
    case.write("constant/physicalProperties", "dictionary", "viscosityModel constant;\nnu [0 2 -1 0 0 0 0] 1.5e-05;\n")


def by_macros(case: Case) -> None:
    """Every condition of U and p, and the viscosity, from macros and other files."""
    left, right = (case.condition("fixedValue", velocity, name) for name in ("left", "right"))
    walls = f'"(left|right)" {{ type calculated; value uniform (9 9 9); }}\nleft {{ {left} }}\nright {{ {right} }}\n'
    (case.folder / "1" / "walls").write_text(walls + 'right { type $kind; }\n#includeIfPresent "nowhere"\n')
    case.write("settings", "dictionary", 'kind fixedValue; // of U\nair { nu 1.5e-05; }\nhere "walls";\n')
    path = case.folder / "1" / "U"
    text = path.read_text()
    inlet, start = case.condition("fixedValue", velocity, "inlet"), text.index("left {")
    text = text[:start] + 'aside { $inlet; }\n#include "$here"\nlayer { type empty; }\n}\n'
    text = text.replace(f"inlet {{ {inlet} }}", "inlet $stored.inlet;")
    stored = f'#include "../settings"\nstored {{ inlet {{ {inlet} }} }}\n'
    path.write_text(text.replace("dimensions", f"{stored}dimensions"))
    fixed = case.condition("fixedValue", pressure, "left")
    changed("1/p", f"left {{ {fixed} }}", f"base {{ {fixed} }} left {{ $base; value ${{..base.value}}; }}")(case)
    changed(NU, "nu 1.5e-05;", '#include "<case>/settings"\n$air;\nnu $:air.nu;')(case)


def by_numbers_of_a_list(case: Case) -> None:
    """Uniform values: a speed in a list, one by default, and what is inside."""
    text = f"{HEAD.format(kind='volVectorField', name='U')}down -2;\ninternalField uniform (0 $down ${{no:-0}});\n"
    for name, value in (("inlet", "$internalField"), ("outlet", "uniform (0 ${down} 0)"), ("left", "$..outlet.value")):
        text += f"{'boundaryField {' if name == 'inlet' else ''} {name} {{ type fixedValue; value {value}; }}\n"
    (case.folder / "1" / "U").write_text(text + "right { $left; } }\n")


POINTS, FACES, NU = "constant/polyMesh/points", "constant/polyMesh/faces", "constant/transportProperties"
SAME: dict[str, Callable[[Case], None]] = {
    "as it is": lambda case: None,
    "packed": packed,
    "a comment with brackets": changed(POINTS, "// * * //", "/* by a script (2 runs) */ // (x)\n"),
    "a comment in a list": changed(POINTS, "(0 0 0)", "(0 0 0) // the corner (left)"),
    "blanks in faces": lambda case: (case.folder / FACES).write_text(
        re.sub(r"^4\(", "4 ( ", (case.folder / FACES).read_text(), flags=re.MULTILINE)
    ),
    "a point of no cell": lambda case: (case.folder / POINTS).write_text(
        (case.folder / POINTS).read_text().replace("70\n(", "71\n(").rstrip().removesuffix(")") + "(7 7 0)\n)\n"
    ),
    "viscosity by a macro": changed(NU, "nu 1.5e-05;", "air 1.5e-05;\nnu $air;"),
    "macros and other files": by_macros,
    "viscosity with its dimensions": changed(NU, "nu 1.5e-05;", "nu nu [0 2 -1 0 0 0 0] 1.5e-05;"),
    "the Foundation's viscosity": of_the_foundation,
}


@pytest.mark.parametrize("way", SAME)
def test_one_flow_reads_alike_however_it_is_written(way: str, case: Case) -> None:
    SAME[way](case)
    field = wf.FlowField.from_openfoam(case.folder, density=1.2)
    np.testing.assert_allclose(field.velocity, velocity(field.points), atol=1e-12)
    np.testing.assert_allclose(field.pressure, 1.2 * pressure(field.points), atol=1e-11)
    assert field.viscosity == pytest.approx(1.8e-5, rel=1e-12)
    assert air_of(case.folder).get("nu") == pytest.approx(1.5e-5)


def test_macros_in_values_are_what_openfoam_makes_of_them(case: Case) -> None:
    by_numbers_of_a_list(case)
    field = wf.FlowField.from_openfoam(case.folder)
    np.testing.assert_allclose(field.velocity, np.tile([0.0, -2.0], (len(field.points), 1)), atol=1e-12)
    assert {key: air_of(case.folder)[key] for key in ("speed", "direction")} == {"speed": 2.0, "direction": "down"}


def test_a_binary_field_may_hold_any_byte_and_macros_beside_it(case: Case) -> None:
    path = case.folder / "1" / "p"
    rows = np.frombuffer(b"$x;#if{}" * len(case.cells), "<f8")  # 8.6e-67 or so: bytes of macros and brackets
    head = HEAD.format(kind="volScalarField", name="p").replace("ascii", 'binary; arch "LSB;label=32;scalar=64"')
    body = f"rest {{ type zeroGradient; }}\ninternalField nonuniform List<scalar> {len(rows)}(".encode()
    path.write_bytes(head.encode() + body + rows.tobytes() + b');\nboundaryField { ".*" { $rest; } }\n')
    fields = CaseFields(case.folder)
    np.testing.assert_array_equal(fields.field(case.folder / "1", "p")[0], rows)


def test_a_file_that_is_included_belongs_to_the_case(case: Case) -> None:
    by_macros(case)
    assert {"settings", "walls"} <= {path.name for path in case_files(case.folder, "latest")}


def test_cells_with_hanging_nodes_keep_a_linear_flow(tmp_path: Path) -> None:
    case = Case(tmp_path / "case", hanging=True)
    field = wf.FlowField.from_openfoam(case.folder, density=1.0)
    np.testing.assert_allclose(field.velocity, velocity(field.points), atol=1e-12)
    mesh = read_polymesh(case.folder).plane
    corners = mesh.points[triangulate(mesh.points, mesh.cells)]
    out, back = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (out[:, 0] * back[:, 1] - out[:, 1] * back[:, 0])
    assert areas.min() > 1e-3 * areas.max()
    assert areas.sum() == pytest.approx(mesh.areas.sum(), rel=1e-12)


@pytest.mark.parametrize("key", ['"(left|right)"', '".*t"', "wall"])
def test_walls_under_a_pattern_or_a_group_are_walls(key: str, tmp_path: Path) -> None:
    case = Case(tmp_path / "case", walls=True)
    ends = {name: case.condition("fixedValue", velocity, name) for name in ("inlet", "outlet")}
    case.field("U", velocity, {**ends, **({'"l.*"': "type noSlip;"} if key == '".*t"' else {}), key: "type noSlip;"})
    field = wf.FlowField.from_openfoam(case.folder)
    at_wall = np.isin(field.points[:, 0], (0.0, 1.0))
    assert np.abs(field.velocity[at_wall]).max() == 0.0
    assert np.abs(field.velocity[~at_wall]).max() > 0.5


def poiseuille(x: np.ndarray) -> np.ndarray:
    return np.stack([0 * x[:, 0], -6 * x[:, 0] * (1 - x[:, 0])], axis=1)


def round_a_corner(x: np.ndarray) -> np.ndarray:
    """Potential flow r^(2/3) cos(2 angle / 3) along both sides of the box, its corner at (0.5, 0.5)."""
    x, y = (x - 0.5).T
    r, angle = np.maximum(np.hypot(x, y), 1e-9), (np.arctan2(y, x) + np.pi / 2) % (2 * np.pi)
    direction = angle / 3 + np.pi / 2  # of (u, v), as that of the conjugate of the derivative of z^(2/3)
    return 2 / 3 * r[:, None] ** (-1 / 3) * -np.stack([np.cos(direction), np.sin(direction)], axis=1)


def both_read(case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (n, 2), and the velocity (n, 2) there as this program and as VTK's reader have it."""
    import pyvista

    (case.folder / "case.foam").touch()
    reader = pyvista.OpenFOAMReader(str(case.folder / "case.foam"))
    reader.set_active_time_value(1.0)
    found = reader.read()["internalMesh"]
    nodes, theirs = np.asarray(found.points), np.asarray(found.point_data["U"])
    there = {(round(x, 4), round(y, 4)): u[:2] for (x, y, z), u in zip(nodes.tolist(), theirs, strict=True) if z == 0}
    field = wf.FlowField.from_openfoam(case.folder)
    return field.points, field.velocity, np.array([there[round(x, 4), round(y, 4)] for x, y in field.points.tolist()])


def test_inside_vtk_reads_the_same(case: Case) -> None:
    points, ours, theirs = both_read(case)
    inside = (points > 0).all(axis=1) & (points < (1, 1.5)).all(axis=1)
    np.testing.assert_allclose(ours[inside], theirs[inside], atol=1e-6)  # VTK's numbers have single precision


def test_poiseuille_is_second_order_and_a_corner_between_wall_and_inlet_is_at_rest(tmp_path: Path) -> None:
    """VTK has the mean of the faces there: half of what enters beside the wall, which is first order."""
    errors = []
    for fine in (1, 2, 4):
        case = Case(tmp_path / str(fine), walls=True, fine=fine)
        inlet = case.condition("fixedValue", poiseuille, "inlet")
        case.field(
            "U",
            poiseuille,
            {"inlet": inlet, "outlet": "type zeroGradient;", **dict.fromkeys(("left", "right"), "type noSlip;")},
        )
        points, *both = both_read(case)
        errors.append([np.abs(one - poiseuille(points)).max() for one in both])
        corner = np.isin(points[:, 0], [0, 1]) & (points[:, 1] == 1.5)
        assert np.abs(both[0][corner]).max() == 0.0
        entering = -poiseuille(np.array([[0.5 / (fine * WIDE), 0.0]]))[0, 1]
        np.testing.assert_allclose(both[1][corner, 1], -entering / 2, rtol=1e-5)
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (order[:, 0] > 1.9).all(), errors
    assert (order[:, 1] < 1.2).all(), errors


@pytest.mark.parametrize("fine", [2, 4])
def test_next_to_the_corner_of_a_box_no_air_goes_through_its_wall(fine: int, tmp_path: Path) -> None:
    """There the two readers differ most: VTK has the cells' velocity on a slip wall, with the part across it."""
    case = Case(tmp_path / "case", box=True, fine=fine)
    ends = {name: case.condition("fixedValue", round_a_corner, name) for name in SIDES}
    case.field("U", round_a_corner, {**ends, "box": "type slip;"})
    points, ours, theirs = both_read(case)
    step = 1 / (fine * WIDE)
    near = np.flatnonzero(np.isclose(points, (0.5 - step, 0.5)).all(axis=1))[0]
    apart = np.hypot(*(ours - theirs).T)
    apart[np.isclose(points, 0.5).all(axis=1)] = 0.0  # at the corner the speed has no bound
    exact = round_a_corner(points)
    off = [np.hypot(*(one - exact).T) for one in (ours, theirs)]
    assert apart[near] == pytest.approx(apart.max(), rel=1e-5)
    assert ours[near, 1] == pytest.approx(0.0, abs=1e-12)
    assert abs(theirs[near, 1]) > 0.15 * abs(exact[near, 0])
    assert off[0][near] < off[1][near]
    away = ~np.isclose(points, 0.5).all(axis=1)
    assert np.mean(off[0][away] ** 2) < np.mean(off[1][away] ** 2)


def of_another_mesh(case: Case) -> None:
    path = case.folder / "1" / "p"
    text = path.read_text()
    start, end = text.index("internalField"), text.index("boundaryField")
    path.write_text(f"{text[:start]}internalField nonuniform List<scalar> 3(1 2 3);\n{text[end:]}")


def in_pascal(case: Case) -> None:
    case.field("p", pressure, dict.fromkeys(SIDES, "type zeroGradient;"), "[1 -1 -2 0 0 0 0]")


def in_time_zero(case: Case) -> None:
    (case.folder / "1").rename(case.folder / "0")


def cut(name: str) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        text = (case.folder / name).read_text()
        (case.folder / name).write_text(text[: len(text) // 2])

    return change


def later_in_parts(case: Case) -> None:
    (case.folder / "processor1" / "2").mkdir(parents=True)
    (case.folder / "processor1" / "2" / "U").write_text("")


def mesh_of_a_time(case: Case) -> None:
    (case.folder / "1" / "polyMesh").mkdir()
    (case.folder / "1" / "polyMesh" / "points.gz").write_bytes(b"")


REFUSED: dict[str, tuple[Callable[[Case], None], str]] = {
    "another mesh": (of_another_mesh, r"1/p holds 3 values for 24 cells: it is of another mesh"),
    "a pressure in Pa": (in_pascal, r"1/p has dimensions \[1, -1, -2.*divide a pressure in Pa by the density"),
    "a speed in other units": (changed("1/U", "[0 1 -1", "[0 0 0"), r"1/U has dimensions \[0, 0, 0"),
    "a macro of nothing": (
        changed("1/p", "left {", "left { $base; } old {"),
        r"1/p, line \d+: \$base is defined nowhere",
    ),
    "a macro of what comes later": (
        changed("1/U", "inlet {", "inlet { $left; } old {"),
        r"1/U, line \d+: \$left is def",
    ),
    "a number to compute": (changed(NU, "1.5e-05", '#calc "3e-5 / 2"'), r"Properties, line \d+: #calc is computed by"),
    "code": (changed("1/p", "left {", "#codeStream { code #{ } #}; }\nleft {"), r"1/p, line \d+: #codeStream is for"),
    "no other file": (
        changed("1/p", "left {", '#include "gone"\nleft {'),
        r"1/p, line \d+: includes .*1/gone, which is",
    ),
    "itself": (changed(NU, "nu ", '#include "transportProperties"\nnu '), r"does one include itself\?"),
    "a bracket too many": (changed("1/p", "left {", "} left {"), r"1/p, line \d+: it .* has a bracket too many"),
    "no condition": (changed("1/p", "left {", "old {"), r"1/p has no condition for the patch left"),
    "half a field": (cut("1/U"), r"cannot read .*1/U"),
    "half the points": (cut(POINTS), r"polyMesh/points is cut short"),
    "later times in parts": (later_in_parts, r"processor1 goes on to 2: run reconstructPar"),
    "a mesh for a time": (mesh_of_a_time, r"1/polyMesh: the mesh changes in time"),
    "a solution in time 0": (in_time_zero, r"rename 0 to 1 if that is a solution"),
    "viscosity of another fluid": (changed(NU, "Newtonian", "CrossPowerLaw"), r"no nu of a Newtonian fluid"),
    "viscosity in Pa s": (changed(NU, "nu ", "nu [1 -1 -1 0 0 0 0] "), r"nu has dimensions \[1, -1, -1"),
    "no viscosity": (changed(NU, "nu ", "mu "), r"no nu of a Newtonian fluid"),
}


@pytest.mark.parametrize("way", REFUSED)
def test_what_cannot_be_read_is_refused_with_its_file(way: str, case: Case) -> None:
    change, message = REFUSED[way]
    change(case)
    with pytest.raises(wf.WakeflowError, match=message) as caught:
        wf.FlowField.from_openfoam(case.folder)
    assert "\n" not in str(caught.value)


def test_a_mean_without_its_partner_is_refused(case: Case) -> None:
    (case.folder / "1" / "UMean").write_text((case.folder / "1" / "U").read_text())
    with pytest.raises(wf.FoamError, match="has no pMean: add p to its fieldAverage"):
        wf.FlowField.from_openfoam(case.folder, "mean")
