"""What is installed, at which version, and the command that mends what is not.

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
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from .. import DISTRIBUTION
from ..core.errors import ProgramError
from ..core.process import capture, cores
from ..core.quantities import duration
from ..core.store import cache_root
from ..core.user_folder import kernel_root
from ..funnel import engine
from ..planning.machine_rates import to_compile
from .screen import screen_table

if TYPE_CHECKING:
    from packaging.specifiers import SpecifierSet
    from rich.table import Table


SETUP = "sh cases/setup.sh"
OPTIONAL = {  # distribution: what it is for, and the extra that brings it
    "ezdxf": ("a body's outline out of a DXF drawing", "dxf"),
    "optuna": ("wakeflow search", "search"),
    "pandas": ("tables as DataFrames", "notebook"),
}
FOAM_HOME = "/usr/share/openfoam"  # Debian's; its programs find their etc folder by WM_PROJECT_DIR only
OLDEST_PYTHON = (3, 11)
MIN_MEMORY = 1e9  # bytes: OpenFOAM and the tracker on the shipped scenes stay below
MIN_DISK = 0.5e9  # bytes: a time-resolved airflow with its snapshots
PROBE = 60.0  # s: the first import on a slow disk takes long

PACKAGES = {  # distribution: what it is for
    "numpy": "arrays",
    "scipy": "sparse matrices, statistics",
    "meshio": "reading meshes",
    "gmsh": "meshing",
    "pyvista": "files for ParaView",
    "numba": "the compiled tracker",
    "foamlib": "reading OpenFOAM's fields",
    "pydantic": "validating scenes",
    "tomlkit": "writing scenes",
    "cyclopts": "the command line",
    "rich": "tables and progress",
    "jinja2": "report.html",
    "filelock": "the cache",
    "matplotlib": "pictures",
    "pillow": "moving pictures of the report",
    "pint": "units in scenes",
    "packaging": "comparing versions",
    "threadpoolctl": "one thread of BLAS for each of the run's own",
}
PROGRAMS = {
    "gmshToFoam": "mesh conversion",
    "checkMesh": "mesh quality",
    "simpleFoam": "steady airflow",
    "pimpleFoam": "airflow in time",
}
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

_GMSH = "import gmsh; print('version', gmsh.__version__)"
_RENDER = """
import warnings; warnings.simplefilter("ignore")
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere())
picture = plotter.screenshot(return_img=True)
assert picture.std() > 1.0, "the picture is empty"
print("version", pyvista.vtk_version_info)
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
    """Look at everything a run needs; takes a few seconds and leaves nothing behind."""
    looks: list[Callable[[], Finding]] = [_python]
    looks += [partial(_package, name, use) for name, use in PACKAGES.items()]
    looks += [partial(_extra, name, *what) for name, what in OPTIONAL.items()]
    looks += [_gmsh_starts]
    looks += [partial(_program, name, use) for name, use in PROGRAMS.items()]
    looks += [_funnel, _setpriv, _graphics, _cores, _memory, _disk, _cache, _kernels]
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
    mend = "" if enough else f"PYTHON=/path/to/python{wanted} {SETUP}"
    return Finding("Python", platform.python_version(), enough, "everything", mend)


def _package(name: str, use: str) -> Finding:
    from importlib.metadata import PackageNotFoundError, version

    try:
        found = version(name)
    except PackageNotFoundError:
        return Finding(name, None, False, use, SETUP)
    wanted = _bounds().get(name)
    if wanted is None or wanted.contains(found, prereleases=True):
        return Finding(name, found, True, use)
    return Finding(name, f"{found} (needs {wanted})", False, use, f"{sys.executable} -m pip install '{name}{wanted}'")


def _extra(name: str, use: str, extra: str) -> Finding:
    """A package of an extra, which one command needs."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return Finding(name, version(name), True, use, optional=True)
    except PackageNotFoundError:
        return Finding(name, None, False, use, f"{SETUP}    # or the extra {extra}", optional=True)


def _bounds() -> dict[str, SpecifierSet]:
    """Version bounds of the direct dependencies, from this package's own metadata."""
    from importlib.metadata import PackageNotFoundError, requires

    from packaging.requirements import Requirement

    try:
        found = [Requirement(line) for line in requires(DISTRIBUTION) or []]
    except PackageNotFoundError:  # run from a source tree that was never installed
        return {}
    return {one.name.lower(): one.specifier for one in found if one.marker is None}


# -- outside programs and libraries ------------------------------------------------------------------------------------


def _gmsh_starts() -> Finding:
    code, text = capture([sys.executable, "-c", _GMSH], timeout=PROBE)
    name, use = "Gmsh's libraries", "meshing"
    if code == 0:
        return Finding(name, _version_in(text), True, use)
    return Finding(name, _last_line(text), False, use, _library_mend(text))


def _program(name: str, use: str) -> Finding:
    """A program prints its help text only when its libraries and its etc folder are found."""
    where = shutil.which(name)
    if where is None:
        return Finding(name, None, False, use, f"{SETUP}    # or: apt-get install openfoam")
    code, text = capture([where, "-help"], env={**os.environ, "WM_PROJECT_DIR": FOAM_HOME})
    match = re.search(r"OpenFOAM-\s*\(?v?(\w+)\)?", text)
    patch = re.search(r"patch=(\w+)", text)
    version = (match[1] + (f".{patch[1]}" if patch else "")) if match else None
    if code == 0 and version is not None:
        return Finding(name, version, True, use)
    return Finding(name, _last_line(text) or f"exit code {code}", False, use, "apt-get install --reinstall openfoam")


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


def _graphics() -> Finding:
    """VTK without OpenGL ends the interpreter instead of raising: a sphere is drawn in a process of its own."""
    environment = dict(os.environ)
    if not environment.get("DISPLAY"):
        environment.setdefault(
            "VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow"
        )  # else VTK looks for an X server first
    code, text = capture([sys.executable, "-c", _RENDER], env=environment, timeout=PROBE)
    name, use = "VTK's OpenGL", "3D pictures only; maps, curves and files work without"
    if code == 0:
        return Finding(name, _version_in(text), True, use, optional=True)
    reason = f"ended by signal {-code}" if code < -1 else _last_line(text)
    packages = "libegl1 libgl1 libgl1-mesa-dri libxrender1"
    return Finding(name, reason, False, use, f"apt-get install {packages}    # or: {SETUP}", optional=True)


def _library_mend(text: str) -> str:
    """The command for ``OSError: libGLU.so.1: cannot open shared object file`` and for a package that is not there."""
    missing = re.search(r"(lib\w+)\.so[\d.]*: cannot open shared object", text)
    if missing and missing[1] in LIBRARIES:
        return f"apt-get install {LIBRARIES[missing[1]]}    # all of them: {SETUP}"
    return SETUP


def _version_in(text: str) -> str | None:
    match = re.search(r"version \(?([\d., ]+\d)", text)
    return None if match is None else match[1].replace(", ", ".")


def _last_line(text: str) -> str | None:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:160] if lines else None


# -- the machine -------------------------------------------------------------------------------------------------------


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


def _kernels() -> Finding:
    """The tracker's kernels: set-up compiles them, else the first run does."""
    seconds = to_compile()
    use = "flights at once"
    if not seconds:
        return Finding("compiled tracker", f"in {kernel_root()}", True, use, optional=True)
    use += f"; the first run compiles for about {duration(sum(seconds.values()))} of a core"
    return Finding("compiled tracker", None, False, use, SETUP, optional=True)


def _existing(path: Path) -> Path:
    """The nearest folder at or above ``path`` that is there."""
    return next(p for p in (path, *path.parents) if p.is_dir())
