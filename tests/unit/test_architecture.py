"""The package's rules: rooms in the order of a run, heavy libraries have one importer, one name is one thing.

That a stage's key covers all the code that computes it is held by tests/unit/core/test_store.py.
"""

import ast
import pydoc
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import wakeflow
from support import ROOT
from wakeflow import LAYERS

SOURCE = ROOT / "src" / "wakeflow"
LONGEST = 40  # lines of a function, its docstring not counted
MAX_LINES, MAX_MODULES = 5000, 25  # of a room, and of a folder
INNER = {"air": ("mesh", "foam", "field", "kinds")}  # rooms in a room, in their order
ROOMS = ("air", "flight")  # whose folders are rooms
ONLY_IN = {  # folders that may import a library
    "gmsh": ("air.mesh",),
    "numba": ("flight.kernel",),
    "pyvista": ("show", "extras.motion"),
    "matplotlib": ("show", "extras.pictures", "extras.motion"),
    "jinja2": ("show",),
    "tornado": ("extras.page",),
    "ezdxf": ("extras.drawing",),
    "subprocess": ("core",),
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
    "ezdxf",
]
QUICK = [["--help"], ["plan", "cases/rhombus.toml", "--json"], ["new", "--help"], ["schema"]]

# What breaks a rule today. Each list is meant to empty: what no longer breaks it must be struck off.
CIRCLES: set[str] = set()
# The table [body.NAME] of a scene and the tracker's public wf.Body: both names are a contract. Gate: of the command
# line and of the plan. Table: of a scene and of a proof
TWICE = {"Body"}
LONG: set[str] = set()


@dataclass(frozen=True)
class Module:
    """A source file, parsed once: its name after ``wakeflow.``, such as ``core.process`` or ``core`` for its folder."""

    name: str
    text: str
    is_package: bool

    @cached_property
    def tree(self) -> ast.Module:
        """The tree of its text."""
        return ast.parse(self.text)

    @cached_property
    def strings(self) -> frozenset[str]:
        """Every string in it that is one word, docstrings left out."""
        found = (node.value for node in ast.walk(self.tree) if isinstance(node, ast.Constant))
        return frozenset(text for text in found if isinstance(text, str) and re.fullmatch(r"[\w.:-]+", text))

    @cached_property
    def bound(self) -> frozenset[str]:
        """Every name that is bound in it: by definitions, imports, assignments."""
        nodes = list(ast.walk(self.tree))
        made = {n.name for n in nodes if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)}
        brought = {a.asname or a.name for n in nodes if isinstance(n, ast.Import | ast.ImportFrom) for a in n.names}
        return frozenset(
            made | brought | {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        )

    @cached_property
    def code_lines(self) -> int:
        """Its lines without blank ones, comments and docstrings."""
        told = (node for node in ast.walk(self.tree) if isinstance(node, ast.Expr))
        text = {number for node in told if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
                for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)}  # fmt: skip
        lines = enumerate(self.text.splitlines(), 1)
        return sum(bool(line.strip()) and not line.lstrip().startswith("#") and i not in text for i, line in lines)

    @property
    def room(self) -> str:
        """The first part of the name: its place in the listing."""
        return self.name.split(".")[0]

    @cached_property
    def imports(self) -> frozenset[str]:
        """Full names of what it imports, at the top, inside functions and for type checking."""
        parts = ["wakeflow", *self.name.split(".")]
        package = parts if self.is_package else parts[:-1]
        found = set()
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                found.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                base = package[: len(package) - node.level + 1] if node.level else []
                name = ".".join([*base, *([node.module] if node.module else [])])
                found.update(f"{name}.{alias.name}" for alias in node.names)
        return frozenset(found)

    @property
    def public(self) -> list[str]:
        """The classes that are made here and whose names do not begin with an underscore."""
        return [n.name for n in self.tree.body if isinstance(n, ast.ClassDef) and not n.name.startswith("_")]

    def functions(self) -> Iterator[tuple[str, int]]:
        """Each function and its lines from ``def`` on, without its docstring."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert node.end_lineno is not None
                text, first = 0, node.body[0]
                if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                    assert first.end_lineno is not None
                    text = first.end_lineno - first.lineno + 1
                yield f"{self.name}:{node.name}", node.end_lineno - node.lineno + 1 - text


def _modules() -> dict[str, Module]:
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        if path != SOURCE / "__init__.py":
            parts = path.relative_to(SOURCE).with_suffix("").parts
            package = parts[-1] == "__init__"
            name = ".".join(parts[:-1] if package else parts)
            found[name] = Module(name, path.read_text(encoding="utf-8"), package)
    return found


MODULES = _modules()


def _own(name: str) -> str | None:
    """The module of this program that a full name stands in, after ``wakeflow.``; None for another's."""
    parts = name.split(".")[1:] if name.startswith("wakeflow.") else []
    for end in range(len(parts), 0, -1):
        if ".".join(parts[:end]) in MODULES:
            return ".".join(parts[:end])
    return None


def _listed(found: set[str], known: set[str]) -> None:
    """What breaks a rule is exactly what is known to."""
    assert not found - known, f"new: {sorted(found - known)}"
    assert not known - found, f"no longer so, strike it off the list: {sorted(known - found)}"


def _onward(module: Module) -> Iterator[str]:
    """The modules of this program that a module imports, or names in a string as a whole."""
    yield from (other for name in module.imports if (other := _own(name)))
    yield from (other for text in module.strings if (other := _own(text.partition(":")[0])))


def _below(one: str, other: str) -> bool:
    """Whether the module ``other`` may be imported by ``one``: in its room, or in one before it."""
    (room, *inside), (there, *deeper) = one.split("."), other.split(".")
    if room != there:
        return LAYERS.index(there) < LAYERS.index(room)
    if not inside or not deeper or not {inside[0], deeper[0]} <= set(order := INNER.get(room, ())):
        return True
    return order.index(deeper[0]) <= order.index(inside[0])


def test_imports_point_upward() -> None:
    """By a string too, such as a module that a child process runs. The code of a stage is read, not run."""
    assert {module.room for module in MODULES.values()} == set(LAYERS)
    wrong = [f"{module.name} imports {other}" for module in MODULES.values() for other in _onward(module)
             if not _below(module.name, other)]  # fmt: skip
    assert not wrong


def test_no_room_names_an_extra() -> None:
    """But ``core.registry``, which looks for all of them and names none."""
    words = re.compile("|".join(rf"extras\.{name.split('.')[1]}\b" for name in MODULES if name.startswith("extras.")))
    found = {module.name for module in MODULES.values() if module.room != "extras"
             for text in module.strings if words.search(text)}  # fmt: skip
    assert not found


def test_each_room_says_what_comes_in_what_goes_out_and_who_may_call_it() -> None:
    rooms = [*LAYERS, *(f"{room}.{part}" for room, parts in INNER.items() for part in parts)]
    rooms += [name for name in MODULES if name.count(".") == 1 and name.startswith("extras.")]
    for name in rooms:
        said = ast.get_docstring(MODULES[name].tree) or ""
        assert all(word in said for word in ("Comes in:", "Goes out:", "May call it:")), name


def test_rooms_and_folders_are_small() -> None:
    """Each folder by its lines; a room by its lines of code, but air and flight, whose folders are rooms."""
    lines: Counter[str] = Counter()
    code: Counter[str] = Counter()
    modules: Counter[str] = Counter()
    for module in MODULES.values():
        folder = module.name if module.is_package else module.name.rpartition(".")[0]
        lines[folder] += len(module.text.splitlines())
        code[module.room] += module.code_lines
        modules[folder] += not module.is_package
    assert not {name: count for name, count in lines.items() if count > MAX_LINES}
    assert not {name: count for name, count in modules.items() if count > MAX_MODULES}
    assert not {name: count for name, count in code.items() if count > MAX_LINES and name not in (*ROOMS, "extras")}


def test_a_module_of_a_name_is_there_once() -> None:
    names = Counter(module.name.rpartition(".")[2] for module in MODULES.values() if not module.is_package)
    assert not {name for name, count in names.items() if count > 1}


def test_references_of_docstrings_lead_somewhere() -> None:
    """``:mod:`` and ``:func:``, ``:class:`` and ``:data:``: to a module, or to a name that is bound there."""
    lost = [f"{module.name}: {kind} {name}" for module in MODULES.values()
            for kind, name in re.findall(r":(mod|func|class|data):`~?([.\w]+)`", module.text)
            if not _is_bound(module, name)]  # fmt: skip
    assert not lost


def _is_bound(module: Module, name: str) -> bool:
    """Whether ``name``, in a docstring of ``module``, is a module or bound in one; the package's public names too."""
    if name.startswith("."):
        dots = len(name) - len(name.lstrip("."))
        package = module.name.split(".") if module.is_package else module.name.split(".")[:-1]
        name = ".".join(["wakeflow", *package[: len(package) - dots + 1], name.lstrip(".")])
    elif not name.startswith("wakeflow."):
        return name.split(".")[0] in module.bound
    own = _own(name)
    rest = name.removeprefix(f"wakeflow.{own or ''}").strip(".").split(".")[0]
    return rest in wakeflow.__all__ if own is None else not rest or rest in MODULES[own].bound


def test_no_package_imports_itself_in_a_circle() -> None:
    """Imports for type checking count: two modules that need each other's types are one."""
    onward = {
        module.name: {other for name in module.imports if (other := _own(name)) and other.split(".")[0] == module.room}
        for module in MODULES.values()
    }

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        ahead = [start]
        while ahead:
            for other in onward[ahead.pop()] - seen:
                seen.add(other)
                ahead.append(other)
        return seen

    ahead_of = {name: reached(name) for name in onward}
    circles = {frozenset(b for b in ahead if a in ahead_of[b]) for a, ahead in ahead_of.items() if a in ahead}
    _listed({", ".join(sorted(circle)) for circle in circles}, CIRCLES)


def test_heavy_libraries_have_one_importer() -> None:
    wrong = [
        f"{module.name} imports {name}"
        for module in MODULES.values()
        for name in module.imports
        if (homes := ONLY_IN.get(name.split(".")[0])) and not any(f"{module.name}.".startswith(f"{h}.") for h in homes)
    ]
    assert not wrong


def test_a_class_of_a_name_is_made_in_one_module() -> None:
    """Functions may share a name: registered ones are called by the name of what they compute."""
    homes = Counter(name for module in MODULES.values() for name in module.public)
    _listed({name for name, count in homes.items() if count > 1}, TWICE)


def test_functions_are_short() -> None:
    found = {name for module in MODULES.values() for name, lines in module.functions() if lines > LONGEST}
    _listed(found, LONG)


def test_no_module_is_called_like_a_public_function() -> None:
    """Importing a module ``wakeflow.plan`` would put it where the function ``wakeflow.plan`` stood."""
    functions = {name for name in wakeflow.__all__ if not isinstance(getattr(wakeflow, name), type)}
    assert not functions & set(MODULES)


def test_quick_commands_load_nothing_heavy() -> None:
    code = (
        "import sys; from wakeflow.cli import main\n"
        f"for command in {QUICK!r}:\n"
        "    code = main(command)\n"
        f"    print(command[0], sorted(set({HEAVY!r}) & set(sys.modules)), code, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stderr.splitlines()[-len(QUICK) :] == [f"{command[0]} [] 0" for command in QUICK]


def test_public_names_are_there_and_loaded_on_first_use() -> None:
    code = "import sys, wakeflow; before = set(sys.modules); assert not {'numpy', 'pydantic'} & before; " + (
        "assert all(getattr(wakeflow, name) is not None for name in wakeflow.__all__)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_help_tells_ten_things_in_order_with_an_example_first() -> None:
    told = pydoc.plain(pydoc.render_doc(wakeflow))
    opening = told[: told.index("PACKAGE CONTENTS")]
    assert len(opening.splitlines()) < 40  # a screen
    assert opening.index("wf.run(") < opening.index(" 1. ")
    listed = re.findall(r"^\s*(\d+)\. (\w+)", opening, re.MULTILINE)
    assert [int(number) for number, _ in listed] == list(range(1, 11))
    assert {name for _, name in listed} <= set(wakeflow.__all__)
    assert set(re.findall(r"wf\.(\w+)", opening)) <= set(wakeflow.__all__)


def test_nothing_mentions_where_it_was_made() -> None:
    files = [p for d in ("src", "cases", "docs", "tests") for p in (ROOT / d).rglob("*") if p.is_file()]
    words = ["/work" + "/", "../" + "shared", "farm-" + "bench"]
    for path in [*files, ROOT / "README.md", ROOT / "CHANGELOG.md"]:
        if path.suffix in {".py", ".md", ".toml", ".sh", ".j2"} and path.exists():
            text = path.read_text()
            assert not [word for word in words if word in text], path
