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
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ... import DISTRIBUTION
from ...air.mesh import MeshSpec
from ...core.errors import MeshError, ProgramError
from ...core.files import kernel_root
from ...core.process import call_in_child, cores, run_program
from ...core.store import cache_root
from ...planning.feed_funnel import ENGINE, bead_engines
from ...show.screen import screen_table

if TYPE_CHECKING:
    from packaging.requirements import Requirement
    from rich.table import Table


PYTHON, PIP = (sys.executable, "-c"), f"{sys.executable} -m pip install"
MIN_MEMORY = 1e9  # bytes: OpenFOAM and the tracker on the shipped scenes stay below
MIN_DISK = 0.5e9  # bytes: a time-resolved airflow with its snapshots
PROBE = 60.0  # s: the first import on a slow disk takes long
LIBRARIES = "libglu1-mesa libgl1 libxrender1 libxcursor1 libxft2 libxinerama1 libgomp1"  # what Gmsh's wheel links to
GMSH = f"apt-get install {LIBRARIES}    # or, where these are there: {PIP} --force-reinstall gmsh"
TRIANGLE = MeshSpec(  # in a channel of some hundred cells
    bodies=(((-0.01, 0.0), (0.01, 0.0), (0.0, 0.02)),), names=("triangle",), width=0.1, top=0.08, bottom=-0.1,
    walls="slip", direction="down", half=False, h_body=0.005, h_corner=0.005, h_wake=0.008, h_far=0.01, growth=0.2,
    wake_length=0.04,
)  # fmt: skip
PICTURE = """from matplotlib import __version__, figure; drawn = figure.Figure(); drawn.subplots().plot([0, 1])
drawn.savefig("picture.png"); print("Matplotlib", __version__)"""
PICTURE_IN_3D = """
import warnings; warnings.simplefilter("ignore")
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere())
picture = plotter.screenshot(return_img=True)
assert picture.std() > 1.0, "the picture is empty"
print("VTK", ".".join(map(str, pyvista.vtk_version_info)))
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
    looks: list[Callable[[], Finding]] = [partial(_package, requirement, extra) for requirement, extra in _required()]
    looks += [partial(_tried, name) for name in TRIALS]
    looks += [_memory, _disk, _cache]
    with ThreadPoolExecutor(4) as pool:  # most of the time goes into waiting for probes
        findings = [pending.result() for pending in [pool.submit(look) for look in looks]]
    python = Finding("Python", platform.python_version(), True, "everything")
    return [python, *findings, Finding("cores", str(cores()), True, "tracking, sweeps")]


def exit_code(findings: list[Finding]) -> int:
    """0 when all that is needed is there, else 3 (as for a program that failed)."""
    return 0 if all(f.ok or f.optional for f in findings) else ProgramError.exit_code


def table(findings: list[Finding]) -> Table:
    """The findings for a terminal; the command that mends is in the last column."""
    from rich.text import Text

    rows = []
    for finding in findings:
        if finding.ok:
            mark = Text("✓", style="green")
        else:
            mark = Text("–", style="yellow") if finding.optional else Text("✗", style="bold red")
        use = f"{finding.needed_for} (optional)" if finding.optional else finding.needed_for
        cells = (finding.name, finding.version or "missing", use, finding.mend)
        rows.append([mark, *map(Text, cells)])
    return screen_table(("", "what", "found", "needed for", "mend with"), rows, left=5)


# -- Python's packages -------------------------------------------------------------------------------------------------


def _required() -> Iterator[tuple[Requirement, str]]:
    """The direct dependencies, from this package's own metadata, each with the extra that asks for it ("" for none);
    those of the tests left out.
    """
    from packaging.requirements import Requirement

    installed = next(iter(distributions(name=DISTRIBUTION)), None)  # None: a source tree that never was
    for requirement in map(Requirement, (installed and installed.requires) or []):
        extra = re.search(r'extra == "(\w+)"', str(requirement.marker))
        if extra is None or extra[1] != "test":
            yield requirement, extra[1] if extra else ""


def _package(requirement: Requirement, extra: str = "") -> Finding:
    use, optional = (f"the extra {extra}", True) if extra else ("every run", False)
    try:
        installed = version(requirement.name)
        if requirement.specifier.contains(installed, prereleases=True):
            return Finding(requirement.name, installed, True, use, optional=optional)
        stated = f"{installed} (needs {requirement.specifier})"
    except PackageNotFoundError:
        stated = None
    return Finding(requirement.name, stated, False, use, f"{PIP} '{requirement.name}{requirement.specifier}'", optional)


# -- What a run does, in small -----------------------------------------------------------------------------------------


def _tried(name: str) -> Finding:
    """What came of a trial in a folder of its own. What says itself how to install what it needs is believed."""
    trial = TRIALS[name]
    with tempfile.TemporaryDirectory(prefix="wakeflow-") as folder:
        try:
            return Finding(name, trial.work(Path(folder)), True, trial.use, optional=trial.optional)
        except ProgramError as problem:
            said = _last_line(problem.tail) if problem.ended == "failed" else str(problem).partition("; ")[0]
            cure = re.search(r"apt-get install .*", str(problem))
            mend = GMSH if isinstance(problem, MeshError) else cure[0] if cure else trial.mend
            return Finding(name, said or str(problem), False, trial.use, mend, trial.optional)


def _mesh(folder: Path) -> str:
    from ...air.mesh import build_mesh

    build_mesh(TRIANGLE, folder, timeout=PROBE)
    return f"Gmsh {version('gmsh')}"


def _solve(folder: Path) -> str:
    """Solve two iterations and two time steps on the triangle's mesh, with all that a run measures on its way."""
    from ...air.foam.case import FlowSpec
    from ...air.foam.programs import openfoam_version
    from ...air.foam.solver import run_segment
    from ...air.foam.start import prepare_case
    from ...air.foam.watch import Watch

    _mesh(folder)
    steady = FlowSpec(TRIANGLE, 1.0, 1.2, 1.8e-5, "kOmegaSST")
    for program, spec, step in (
        ("simpleFoam", steady, 1.0),
        ("pimpleFoam", replace(steady, stepping="time-resolved"), 1e-4),
    ):
        case = folder / program
        prepare_case(spec, folder / "mesh.msh", case)
        run_segment(case, program, 2 * step, {"deltaT": step}, Watch(case, program, lambda _: None, expected=2 * step))
    return f"OpenFOAM {openfoam_version()}"


def _fly(folder: Path) -> str:
    call_in_child("wakeflow.flight.stages.compilation:compile_tracker", None, log=folder / "log")
    return f"numba {version('numba')}, compiled in {kernel_root()}"


def _says(command: Sequence[str], folder: Path) -> str:
    """The last line that a ``command`` prints."""
    screen = {} if os.environ.get("DISPLAY") else {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    log = folder / "log"  # without a screen VTK would look for an X server first
    run_program(command, cwd=folder, log=log, env=screen | os.environ, timeout=PROBE)
    return _last_line(log.read_text())


def _last_line(text: str) -> str:
    return text.strip().rpartition("\n")[2].strip()[:160]


class Trial(NamedTuple):
    """What needs it, the call that does it in a folder and returns which version did, the command that mends it."""

    use: str
    work: Callable[[Path], str]
    mend: str
    optional: bool = False


TRIALS = {
    "a mesh": Trial("airflow", _mesh, GMSH),
    "an airflow": Trial("rungs with air", _solve, "apt-get install --reinstall openfoam"),
    "a flight": Trial("landings", _fly, f"{PIP} --force-reinstall numba"),
    "a picture": Trial("reports", partial(_says, [*PYTHON, PICTURE]), f"{PIP} --force-reinstall matplotlib"),
    "a picture in 3D": Trial(
        "3D pictures only", partial(_says, [*PYTHON, PICTURE_IN_3D]),
        "apt-get install libegl1 libgl1 libgl1-mesa-dri libxrender1", optional=True,
    ),
    "liggghts": Trial(
        "a scene's [funnel]", lambda _: bead_engines[ENGINE].version(), bead_engines[ENGINE].install, optional=True
    ),
    "setpriv": Trial(
        "ending solvers with a killed parent", partial(_says, ["setpriv", "--version"]), "apt-get install util-linux",
        optional=True,
    ),
}  # fmt: skip


# -- The machine -------------------------------------------------------------------------------------------------------


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
