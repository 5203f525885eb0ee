"""The listing of modules is the pipeline: imports only point upward in it, and heavy libraries have one importer."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from wakeflow import LAYERS

SOURCE = Path(__file__).parents[1] / "src" / "wakeflow"
ONLY_IN = {
    "gmsh": {"meshing"},
    "numba": {"tracking"},
    "pyvista": {"report"},
    "matplotlib": {"report"},
    "jinja2": {"report"},
    "subprocess": {"core"},
}
# pint, which reads the scenes' units, loads scipy's empty shell (8 ms) but none of its parts
HEAVY = [
    "gmsh",
    "vtk",
    "vtkmodules",
    "pyvista",
    "numba",
    "scipy.special",
    "scipy.spatial",
    "scipy.sparse",
    "matplotlib",
    "foamlib",
    "meshio",
]


def _modules() -> list[Path]:
    return [path for path in sorted(SOURCE.rglob("*.py")) if path != SOURCE / "__init__.py"]


def _home(path: Path) -> str:
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def _imports(path: Path) -> set[str]:
    """Full names of what a module imports, wakeflow's own as ``wakeflow.X``, TYPE_CHECKING blocks included."""
    package = ["wakeflow", *path.relative_to(SOURCE).parts[:-1]]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *([node.module] if node.module else [])])
            found.update(f"{name}.{alias.name}" for alias in node.names)
    return found


@pytest.mark.parametrize("path", _modules(), ids=lambda p: p.relative_to(SOURCE).as_posix())
def test_imports_point_upward(path: Path) -> None:
    home = _home(path)
    assert home in LAYERS, f"{home} has no place in the listing"
    for name in _imports(path):
        parts = name.split(".")
        if parts[0] == "wakeflow" and len(parts) > 1 and parts[1] != home:
            assert LAYERS.index(parts[1]) < LAYERS.index(home), f"{home} imports {name}"


@pytest.mark.parametrize("path", _modules(), ids=lambda p: p.relative_to(SOURCE).as_posix())
def test_heavy_libraries_have_one_importer(path: Path) -> None:
    for name in _imports(path):
        allowed = ONLY_IN.get(name.split(".")[0])
        assert allowed is None or _home(path) in allowed, f"{_home(path)} imports {name}"


@pytest.mark.parametrize("command", [["--help"], ["plan", "cases/rhombus.toml"], ["new", "--help"], ["schema"]])
def test_quick_commands_load_nothing_heavy(command: list[str]) -> None:
    code = (
        "import sys; from wakeflow.cli import main\n"
        f"code = main({command!r})\n"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)), code, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=SOURCE.parents[1], check=True
    )
    heavy, code_text = done.stderr.strip().splitlines()[-1].rsplit(" ", 1)
    assert (heavy, code_text) == ("[]", "0")


def test_public_names_are_there_and_loaded_on_first_use() -> None:
    code = "import sys, wakeflow; before = set(sys.modules); assert not {'numpy', 'pydantic'} & before; " + (
        "assert all(getattr(wakeflow, name) is not None for name in wakeflow.__all__)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_nothing_mentions_where_it_was_made() -> None:
    root = SOURCE.parents[1]
    files = [p for d in ("src", "cases", "docs", "tests") for p in (root / d).rglob("*") if p.is_file()]
    words = ["/work" + "/", "../" + "shared", "farm-" + "bench"]
    for path in [*files, root / "README.md", root / "CHANGELOG.md"]:
        if path.suffix in {".py", ".md", ".toml", ".sh", ".j2"} and path.exists():
            text = path.read_text()
            assert not [word for word in words if word in text], path
