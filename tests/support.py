"""What several test modules need: folders, shipped scenes, shapes, meshes and fields whose answer is known."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import replace
from html.parser import HTMLParser
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from scipy.spatial import Delaunay

from wakeflow.air.field import FlowField
from wakeflow.air.foam.airflow import solve_airflow
from wakeflow.air.foam.airflow_result import AirflowResult
from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.foam.programs import openfoam_version
from wakeflow.air.mesh import build_mesh, plan_mesh
from wakeflow.core.code_key import code_key
from wakeflow.core.files import case_template
from wakeflow.core.record import load
from wakeflow.core.store import Store, cache_root, content_key, digest_files
from wakeflow.flight import Granules
from wakeflow.flight.stages.landings import Landings
from wakeflow.laws.best_estimate import NO_ESTIMATE
from wakeflow.laws.constants import GRAVITY, STANDARD_AIR
from wakeflow.laws.shape import shapes
from wakeflow.planning.plan import REPLICATES, Plan
from wakeflow.scene import Scene

if TYPE_CHECKING:
    import distributed
    import psutil

ROOT = Path(__file__).parents[1]
CASES = ROOT / "cases"
DOCS = ROOT / "docs"

G = GRAVITY
DENSITY, VISCOSITY = 1.2, 1.8e-5  # kg/m3 and Pa s, air of the tracker's tests
AIR = dict(zip(("density", "viscosity"), STANDARD_AIR, strict=True))  # of the airflow's tests
WIDTH = 0.05  # m, of the bodies below
RHOMBUS = shapes["rhombus"](width=WIDTH, slope_angle=np.pi / 4)
FLOOR = np.array([[-1.0, -0.2], [1.0, -0.2], [1.0, 0.0], [-1.0, 0.0]])  # m, a body whose top is y = 0

# Runs of the slab itself and of air that feels granules are in tests/unit/flight/test_dense_feeds.py
ALONE = {"collisions": False, "air-loading": False}

Flow = Callable[[np.ndarray], np.ndarray]


def shipped(name: str, changes: dict[str, Any] | None = None) -> Scene:
    """The scene ``cases/NAME.toml`` with dotted keys changed."""
    return Scene.load(CASES / f"{name}.toml", changes or {})


def as_computed(plan: Plan) -> Plan:
    """The same plan in the airflow as it is computed, where the answer would be a best estimate, and without granules
    that drag on it: for comparisons with what is published of such airflows.
    """
    return replace(plan, airflow=replace(plan.airflow, wake=NO_ESTIMATE, loaded=False))


def loaded_scene() -> Scene:
    """The shipped rhombus on a coarse mesh on which its air settles (in 260 iterations; 3000 with a scale of 2.5), with
    chaff alone, whose drag the air feels most for its mass; to a wide accuracy, so that few passes do.
    """
    changes = {"numerics.rung": "draft", "numerics.mesh_scale": 4.0, "numerics.target_error": 0.02}
    tables = shipped("rhombus", {**changes, "feed.count": 2048, "numerics.tolerance": 1e-3}).tables()
    tables["fraction"] = {"chaff": {**tables["fraction"]["chaff"], "mass_share": 1.0}}
    tables["feed"]["rate"] = 0.02  # kg/s
    return Scene.parse(tables)


def shaken_mesh(
    n: int, low: float = 0.0, high: float = 1.0, *, seed: int = 1, shift: float = 0.3
) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 2) and triangles (t, 3) of the square [low, high]^2: n x n squares, inner nodes shifted at random by
    up to ``shift`` of a square's edge.
    """
    line = np.linspace(0, 1, n + 1)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    inner = np.all((points > 1e-9) & (points < 1 - 1e-9), axis=1)
    points[inner] += np.random.default_rng(seed).uniform(-shift, shift, (int(inner.sum()), 2)) / n
    return low + (high - low) * points, Delaunay(points).simplices


def field_of(flow: Flow, n: int = 10, low: float = -1.0, high: float = 1.0, **more: Any) -> FlowField:
    """The flow (points to velocities) on a shaken mesh of [low, high]^2."""
    points, cells = shaken_mesh(n, low, high)
    return FlowField.from_arrays(points, cells, flow(points), density=DENSITY, viscosity=VISCOSITY, **more)


def without_slip(*arguments: Any, **more: Any) -> Granules:
    """Granules with the plain law of drag, as closed forms have it: however small, they do not slip."""
    return Granules(*arguments, **{"drag_scale": 1.0} | more)


def with_tau(tau: float, position: Any, velocity: Any, **more: Any) -> Granules:
    """Granules whose Stokes relaxation time is ``tau`` (s) in the air of ``field_of``."""
    density = 1000.0
    return without_slip(position, velocity, diameter=np.sqrt(18 * VISCOSITY * tau / density), density=density, **more)


def landings_in(bins: Any, **columns: Any) -> Landings:
    """Granules that ended in bins of these numbers, in replicates in turn; what ``columns`` do not give is 0."""
    places = np.asarray(bins)
    names = ("diameter", "fate", "time", "impacts", "realisation", "cycle")
    plain: dict[str, Any] = dict.fromkeys(names, np.zeros(len(places), dtype=int))
    plain |= {"position": np.zeros((len(places), 2)), "replicate": np.arange(len(places)) % REPLICATES}
    return Landings(**{**plain, **columns, "bin": places})


def distance(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distances (n,) of points (n, 2) from an outline (k, 2); written apart from the program's own."""
    along = np.roll(outline, -1, axis=0) - outline
    s = np.einsum("nkj,kj->nk", points[:, None] - outline, along) / (along**2).sum(axis=1)
    foot = outline + np.clip(s, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)


def rhombus_spec(**how: Any) -> FlowSpec:
    """The airflow of a rhombus that blocks a sixth of a short channel; ``how``: what ``plan_mesh`` takes."""
    mesh = plan_mesh([RHOMBUS], width=0.3, top=0.25, bottom=-0.45, names=["rhombus"], **{"scale": 1.6, **how})
    return FlowSpec(mesh, 5.0, **AIR, turbulence="kOmegaSST", stepping="steady" if mesh.half else "time-resolved")


def kept_airflow(spec: FlowSpec, start: Path | None = None) -> tuple[Path, AirflowResult]:
    """Folder (mesh.msh, case) and result of a solved airflow, which nobody changes: kept between sessions until the
    code that makes it, the template, Gmsh or OpenFOAM is another. ``start``: such a folder that it starts from.
    """

    def work(part: Path) -> None:
        build_mesh(spec.mesh, part)
        solve_airflow(spec, part / "mesh.msh", part / "case", start=None if start is None else start / "case")

    code = code_key("wakeflow.air.mesh", "wakeflow.air.foam.airflow"), digest_files([case_template()])
    key = content_key(repr(spec), *code, version("gmsh"), openfoam_version(), None if start is None else start.name)
    folder, _ = Store(cache_root()).make("tested-airflow", key, work)
    return folder, load(AirflowResult, folder / "case" / "airflow.json")


def begun_part(root: Path, stage: str, key: str) -> Path:
    """The folder in which a stage of the cache ``root`` works, as an interrupted run leaves it."""

    def interrupted(part: Path) -> None:
        raise KeyboardInterrupt

    with suppress(KeyboardInterrupt):
        Store(root).make(stage, key, interrupted)
    return root / stage / f"{key}.part"


def working_in(folder: Path) -> dict[int, str]:
    """Process id and command of running processes whose working folder is ``folder`` or below it."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if Path(os.readlink(process / "cwd")).is_relative_to(folder):
                found[int(process.name)] = (process / "cmdline").read_text()
        except OSError:  # it ended meanwhile, or belongs to someone else
            continue
    return found


class Page(HTMLParser):
    """What a page is made of: tags with their attributes, what is left open, its text, and tables by id as rows of the
    texts of their cells.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.text, self.rows = "", [[""]]
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "br", "input", "link", "hr"):
            self.open.append(tag)
        if tag == "table":
            self.rows = self.tables.setdefault(dict(attrs).get("id") or "", [])
        elif tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        elif tag == "br":
            self.handle_data(" ")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data

    def every(self, *names: str) -> list[dict[str, str | None]]:
        """Attributes of every tag of these names."""
        return [given for tag, given in self.tags if tag in names]


class Here(Executor):
    """An executor of the caller's own that works in this process, and counts."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, str]] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.calls.append((fn.__name__, args[0].folder.name))
        future.set_result(fn(*args, **kwargs))
        return future


class LoopbackCluster:
    """A Dask scheduler at ``address`` with ``workers``, all processes of this machine, as a cluster has them."""

    def __init__(self, folder: Path, workers: int) -> None:
        self.file, self.log, self.workers = folder / "scheduler.json", (folder / "log").open("wb"), workers
        self.running: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        self._start("scheduler", "--host", "127.0.0.1", "--port", "0")
        for _ in range(self.workers):
            self._start("worker", "--nthreads", "1", "--memory-limit", "0")
        with self._client() as client:
            self.address = client.scheduler.address
            client.wait_for_workers(self.workers, timeout=120)
        return self

    def __exit__(self, *problem: object) -> None:
        for one in reversed(self.running):
            self._end(one)
        self.log.close()

    @contextmanager
    def worker(self, *options: str) -> Iterator[int]:
        """One more worker, its process id."""
        with self._client() as client:
            client.wait_for_workers(self.workers, timeout=120)  # one that was killed is started again
            before = client.run(os.getpid)
            started = self._start("worker", "--nthreads", "1", "--memory-limit", "0", *options)
            client.wait_for_workers(len(before) + 1, timeout=120)
            (new,) = set(client.run(os.getpid).values()) - set(before.values())
            try:
                yield new
            finally:
                self._end(started)

    def worker_at_work(self) -> psutil.Process:
        """A worker of this cluster beside which a task runs at this moment."""
        import psutil

        while True:
            for nanny in self.running[1:]:
                for worker in psutil.Process(nanny.pid).children():
                    for child in worker.children():
                        if "wakeflow.core.executor" in child.cmdline():
                            return worker
            time.sleep(0.01)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", *words, "--scheduler-file", str(self.file), "--no-dashboard"]
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}  # tasks of the tests are known by their modules
        child = subprocess.Popen(command, stdout=self.log, stderr=self.log, cwd=self.file.parent, env=env)
        self.running.append(child)
        return child

    def _end(self, child: subprocess.Popen[bytes]) -> None:
        child.terminate()
        child.wait(60)
        if child in self.running:
            self.running.remove(child)

    def _client(self) -> distributed.Client:
        import distributed

        deadline = time.monotonic() + 120.0
        while not self.file.exists():
            assert time.monotonic() < deadline, "the scheduler does not start"
            time.sleep(0.05)
        return distributed.Client(scheduler_file=str(self.file), set_as_default=False)


MIN_CONTRAST = 4.5  # of text on its ground: WCAG 2.1, level AA
_CONTRAST = """() => {
  const light = (text) => { const [r, g, b] = text.match(/[\\d.]+/g).map((x) => Number(x) / 255)
    .map((x) => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const ground = (node) => { for (; node; node = node.parentElement) { const c = getComputedStyle(node).backgroundColor;
    if (!/, 0\\)$/.test(c)) return c; } return "rgb(255, 255, 255)"; };
  const text = "p, td, th, li, h1, h2, h3, a, strong, pre, label, button:enabled, input, textarea, select, summary";
  return Math.min(...[...document.querySelectorAll(text)]
    .filter((node) => node.textContent.trim() && node.offsetParent).map((node) => {
      const [a, b] = [light(getComputedStyle(node).color), light(ground(node))].sort((x, y) => y - x);
      return (a + 0.05) / (b + 0.05); }));
}"""


def lowest_contrast(page: Any) -> float:
    """Of the text a browser's page shows, on its ground: formula of WCAG 2.1."""
    return float(page.evaluate(_CONTRAST))
