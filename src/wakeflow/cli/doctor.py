"""Tries in small what a run does: which versions did it, and the command that mends what did not.

Whatever can crash or hang an interpreter (Gmsh's shared libraries, VTK without OpenGL, OpenFOAM) is tried in a
process of its own.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING

from .. import DISTRIBUTION
from ..core.errors import MeshError, ProgramError
from ..core.process import call_in_child, capture, cores, run_program
from ..core.sources import kernel_root
from ..core.store import cache_root
from ..funnel import engine
from ..meshing import MeshSpec
from .screen import screen_table

if TYPE_CHECKING:
    from packaging.requirements import Requirement
    from rich.table import Table


PIP = f"{sys.executable} -m pip install"
OLDEST_PYTHON = (3, 11)
MIN_MEMORY = 1e9  # bytes: OpenFOAM and the tracker on the shipped scenes stay below
MIN_DISK = 0.5e9  # bytes: a time-resolved airflow with its snapshots
PROBE = 60.0  # s: the first import on a slow disk takes long
LIBRARIES = {  # shared library: Debian package; in the order in which Gmsh's wheel asks for them
    "libGLU": "libglu1-mesa",
    "libGL": "libgl1",
    "libXrender": "libxrender1",
    "libXcursor": "libxcursor1",
    "libXft": "libxft2",
    "libXinerama": "libxinerama1",
    "libgomp": "libgomp1",
    "libEGL": "libegl1",
}
TRIANGLE = MeshSpec(  # in a channel of some hundred cells
    bodies=(((-0.01, 0.0), (0.01, 0.0), (0.0, 0.02)),), names=("triangle",), width=0.1, top=0.08, bottom=-0.1,
    walls="slip", direction="down", half=False, h_body=0.005, h_corner=0.005, h_wake=0.008, h_far=0.01, growth=0.2,
    wake_length=0.04,
)  # fmt: skip
_PICTURE = """
import matplotlib; matplotlib.use("agg")
from matplotlib import pyplot
pyplot.plot([0, 1])
pyplot.savefig("picture.png")
print("Matplotlib", matplotlib.__version__)
"""
_RENDER = """
import warnings; warnings.simplefilter("ignore")
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere())
picture = plotter.screenshot(return_img=True)
assert picture.std() > 1.0, "the picture is empty"
print("VTK", *pyvista.vtk_version_info)
"""


@dataclass(frozen=True)
class Finding:
    """One thing that was examined: ``version`` (or amount) as found, whether it is sufficient, what needs it, and the
    command that mends it.

    ``mend`` is a command, empty when nothing is to be mended. What is ``optional`` may be missing.
    """

    name: str
    version: str | None
    ok: bool
    needed_for: str
    mend: str = ""
    optional: bool = False


def examine() -> list[Finding]:
    """Try everything a run needs, in seconds; the tracker, where it is not compiled yet, in a minute or two, and it
    stays compiled. Nothing else is left behind.
    """
    looks: list[Callable[[], Finding]] = [_python]
    looks += [partial(_package, asked, extra) for asked, extra in _required()]
    looks += [_mesh, _airflow, _flight, _picture, _picture_in_3d]
    looks += [_funnel, _setpriv, _cores, _memory, _disk, _cache]
    with ThreadPoolExecutor(4) as pool:  # most of the time goes into waiting for probes
        return [pending.result() for pending in [pool.submit(look) for look in looks]]


def exit_code(findings: list[Finding]) -> int:
    """0 when all that is needed is there, else 3 (as for a program that failed)."""
    return 0 if all(f.ok or f.optional for f in findings) else ProgramError.exit_code


def table(findings: list[Finding]) -> Table:
    """The findings for a terminal; the command that mends is in the last column."""
    from rich.text import Text

    rows = []
    for found in findings:
        if found.ok:
            mark = Text("✓", style="green")
        else:
            mark = Text("–", style="yellow") if found.optional else Text("✗", style="bold red")
        use = f"{found.needed_for} (optional)" if found.optional else found.needed_for
        cells = (found.name, found.version or "missing", use, found.mend)
        rows.append([mark, *map(Text, cells)])
    return screen_table(("", "what", "found", "needed for", "mend with"), rows, left=5)


# -- Python ------------------------------------------------------------------------------------------------------------


def _python() -> Finding:
    enough = sys.version_info[:2] >= OLDEST_PYTHON
    wanted = ".".join(map(str, OLDEST_PYTHON))
    mend = "" if enough else f"apt-get install python3    # {wanted} or newer, and install wakeflow with that"
    return Finding("Python", platform.python_version(), enough, "everything", mend)


def _required() -> Iterator[tuple[Requirement, str]]:
    """The direct dependencies, from this package's own metadata, each with the extra that asks for it ("" for none);
    those of the tests left out.
    """
    from packaging.requirements import Requirement

    try:
        lines = requires(DISTRIBUTION) or []
    except PackageNotFoundError:  # run from a source tree that was never installed
        return
    for asked in map(Requirement, lines):
        extra = re.search(r'extra == "(\w+)"', str(asked.marker))
        if extra is None or extra[1] != "test":
            yield asked, extra[1] if extra else ""


def _package(asked: Requirement, extra: str = "") -> Finding:
    use = f"the extra {extra}" if extra else "every run"
    mend = f"{PIP} '{asked.name}{asked.specifier}'"
    try:
        found = version(asked.name)
    except PackageNotFoundError:
        return Finding(asked.name, None, False, use, mend, optional=bool(extra))
    if asked.specifier.contains(found, prereleases=True):
        return Finding(asked.name, found, True, use, optional=bool(extra))
    return Finding(asked.name, f"{found} (needs {asked.specifier})", False, use, mend, optional=bool(extra))


# -- What a run does, in small -----------------------------------------------------------------------------------------


def _tried(
    name: str, use: str, work: Callable[[Path], str], mend: Callable[[ProgramError], str], *, optional: bool = False
) -> Finding:
    """What came of ``work`` in a folder of its own: the version that did it, or the last that was said."""
    with tempfile.TemporaryDirectory(prefix="wakeflow-") as folder:
        try:
            return Finding(name, work(Path(folder)), True, use, optional=optional)
        except ProgramError as problem:
            said = problem.ended == "failed" and _last_line(problem.tail)
            return Finding(name, said or str(problem).partition("; ")[0], False, use, mend(problem), optional)


def _mesh() -> Finding:
    return _tried("a mesh", "airflow", _mesh_triangle, _mend_mesh)


def _mesh_triangle(folder: Path) -> str:
    from ..meshing import build_mesh

    build_mesh(TRIANGLE, folder, timeout=PROBE)
    return f"Gmsh {version('gmsh')}"


def _mend_mesh(problem: ProgramError) -> str:
    """The command for ``OSError: libGLU.so.1: cannot open shared object file`` and for a package that is not there."""
    missing = re.search(r"(lib\w+)\.so[\d.]*: cannot open shared object", problem.tail)
    if missing and missing[1] in LIBRARIES:
        one = LIBRARIES[missing[1]]
        return f"apt-get install {one}    # and then: {' '.join(name for name in LIBRARIES.values() if name != one)}"
    return f"{PIP} --force-reinstall gmsh"


def _airflow() -> Finding:
    return _tried("an airflow", "rungs with air", _solve, _mend_airflow)


def _solve(folder: Path) -> str:
    """Two iterations and two time steps on the triangle's mesh, with all that a run measures on its way."""
    from ..foam.case import FlowSpec
    from ..foam.prepare import prepare_case
    from ..foam.programs import openfoam_version
    from ..foam.solver import run_segment
    from ..foam.watch import Watch

    _mesh_triangle(folder)
    steady = FlowSpec(TRIANGLE, 1.0, 1.2, 1.8e-5, "kOmegaSST")
    for program, spec, step in (
        ("simpleFoam", steady, 1.0),
        ("pimpleFoam", replace(steady, stepping="time-resolved"), 1e-4),
    ):
        case = folder / program
        prepare_case(spec, folder / "mesh.msh", case)
        run_segment(case, program, 2 * step, {"deltaT": step}, Watch(case, program, lambda _: None, expected=2 * step))
    return f"OpenFOAM {openfoam_version()}"


def _mend_airflow(problem: ProgramError) -> str:
    from ..foam.failure import AirflowFailure, Cause

    cause = problem.cause if isinstance(problem, AirflowFailure) else None
    if cause is Cause.NO_DIGEST:
        return "apt-get install tcc"
    if isinstance(problem, MeshError):
        return _mend_mesh(problem)
    return f"apt-get install --no-install-recommends {'' if cause is Cause.MISSING else '--reinstall '}openfoam"


def _flight() -> Finding:
    """The tracker, compiled where it is not yet."""

    def fly(folder: Path) -> str:
        call_in_child("wakeflow.pipeline.compilation:compile_tracker", None, log=folder / "log")
        return f"numba {version('numba')}, in {kernel_root()}"

    return _tried("a flight", "landings", fly, lambda _: f"{PIP} --force-reinstall numba")


def _picture() -> Finding:
    draw, mend = partial(_python_says, _PICTURE), f"{PIP} --force-reinstall matplotlib"
    return _tried("a picture", "reports", draw, lambda _: mend)


def _picture_in_3d() -> Finding:
    """VTK without OpenGL ends the interpreter instead of raising."""
    use, mend = "3D pictures only", "apt-get install libegl1 libgl1 libgl1-mesa-dri libxrender1"
    return _tried("a picture in 3D", use, partial(_python_says, _RENDER), lambda _: mend, optional=True)


def _python_says(code: str, folder: Path) -> str:
    """What ``code`` prints last, in an interpreter of its own."""
    screen = {} if os.environ.get("DISPLAY") else {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    log = folder / "log"  # without a screen VTK would look for an X server first
    run_program([sys.executable, "-c", code], cwd=folder, log=log, env=screen | os.environ, timeout=PROBE)
    return _last_line(log.read_text())


def _last_line(text: str) -> str:
    return text.strip().rpartition("\n")[2].strip()[:160]


# -- other programs and the machine ------------------------------------------------------------------------------------


def _funnel() -> Finding:
    use = "a scene's [funnel]"
    try:
        return Finding("liggghts", engine.liggghts_version(), True, use, optional=True)
    except ProgramError:
        return Finding("liggghts", None, False, use, engine.INSTALL, optional=True)


def _setpriv() -> Finding:
    where = shutil.which("setpriv")
    use = "ending solvers with a killed parent"
    if where is None:
        return Finding("setpriv", None, False, use, "apt-get install util-linux", optional=True)
    code, text = capture([where, "--version"])
    return Finding("setpriv", text.split()[-1] if code == 0 and text.split() else None, code == 0, use, optional=True)


def _cores() -> Finding:
    return Finding("cores", str(cores()), True, "tracking, sweeps")


def _memory() -> Finding:
    """Memory available to this process: the machine's, or the container's limit where that is lower."""
    size = min(_memory_limits())
    mend = "" if size >= MIN_MEMORY else "close other programs or run in a container with more memory"
    return Finding("memory", f"{size / 1e9:.1f} GB", size >= MIN_MEMORY, "airflow, tracking", mend)


def _memory_limits() -> Iterator[float]:
    yield float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    for limit in (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes")):
        if limit.is_file() and (text := limit.read_text().strip()).isdigit():
            yield float(text)


def _disk() -> Finding:
    free = shutil.disk_usage(_existing(cache_root())).free
    mend = "" if free >= MIN_DISK else "wakeflow clean --everything    # or: export WAKEFLOW_CACHE=/a/larger/disk"
    return Finding("disk", f"{free / 1e9:.1f} GB free", free >= MIN_DISK, f"the cache in {cache_root()}", mend)


def _cache() -> Finding:
    """Writing is tried, since permission bits say nothing about read-only mounts."""
    folder = _existing(cache_root())
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        mend = "export WAKEFLOW_CACHE=/a/folder/you/may/write"
        return Finding("cache", f"{folder}: {problem.strerror}", False, "finished stages", mend)
    return Finding("cache", f"{cache_root()} is writable", True, "finished stages")


def _existing(path: Path) -> Path:
    """The nearest folder at or above ``path`` that is there."""
    return next(p for p in (path, *path.parents) if p.is_dir())
