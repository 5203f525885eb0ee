"""mesh -> airflow -> field -> tracks: every stage cached, each reading only what stands before it.

A stage's key is made of the scene's fields it reads, the key of the stage before, the sources of the code that computes
it and the versions of outside programs; a change of any other field answers from what is there.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from ..core.errors import ProgramError
from ..core.files import atomic_write, write_json
from ..core.process import call_in_child, cores
from ..core.resources import case_template
from ..core.sources import code_key
from ..core.store import Store, cache_root, content_key, digest_files
from ..funnel import compute as compute_funnel
from ..planning.airflow import ranks_for
from ..planning.make import make_plan
from ..planning.plan import COMPARED, REPLICATES, Plan
from ..scene import Scene
from .specs import flow_spec, mesh_spec
from .warm_start import nearest, remember

if TYPE_CHECKING:
    from ..field import FlowField
    from ..foam import FlowSpec
    from ..meshing import MeshSpec
    from ..scene import Picture
    from .landings import Tracked

__all__ = ["Companion", "Listener", "Pipeline", "silent"]

Listener = Callable[[str, str], None]  # (stage, text)
# What computes each stage: its key covers these modules and everything that they import.
CODE = {
    "mesh": ("wakeflow.meshing.build",),
    "airflow": ("wakeflow.foam.airflow",),
    "given": ("wakeflow.foam.user_case",),
    "field": ("wakeflow.field",),
    "duct": ("wakeflow.pipeline.analytic",),
    "tracks": ("wakeflow.pipeline.tracks", "wakeflow.pipeline.landings"),
}


def silent(stage: str, text: str) -> None:
    """The listener that hears nothing."""


@dataclass(frozen=True)
class Companion:
    """Part of the granules flown again, the same ones, with one thing changed: what that changes is an error.

    ``name`` among the stages; ``tolerance`` (body widths) instead of the scene's; ``blend`` of a time-resolved
    airflow, u = mean + blend u' (0: the mean wake, 1: as computed).
    """

    name: str
    tolerance: float | None = None
    blend: float = 1.0


@dataclass
class Pipeline:
    """The stages of one scene under one plan; each is made at most once and comes from the cache where it can.

    ``grid`` is the place among the plan's grids, 0 the answer's; ``label`` tells the stages of another airflow of the
    same scene apart in ``seconds`` and to the listener.
    """

    scene: Scene
    plan: Plan
    listener: Listener = silent
    workers: int | None = None
    store: Store = field(default_factory=lambda: Store(cache_root()))
    seconds: dict[str, dict[str, Any]] = field(default_factory=dict)
    grid: int = 0
    label: str = ""
    _compiling: list[Thread] = field(default_factory=list, repr=False)

    @cached_property
    def funnel(self) -> dict[str, Any] | None:
        """What the scene's feed funnel delivers: the ``funnel`` table of result.json; None without one."""
        if self.scene.funnel is None:
            return None
        return compute_funnel(self.scene.funnel, self._stage, partial(self._tell, "funnel"))

    @cached_property
    def mesh_spec(self) -> MeshSpec:
        """What the plan wants meshed."""
        return mesh_spec(self.scene, self.plan, self.grid)

    @cached_property
    def mesh(self) -> tuple[str, Path]:
        """Key and folder (mesh.msh, mesh.vtu, mesh.json); a folder ``meshes`` here gets the .msh as <key>.msh too."""
        from ..meshing import build_mesh

        key = content_key("mesh", repr(self.mesh_spec), _code("mesh"), _version("gmsh"))
        folder = self._stage("mesh", key, lambda part: build_mesh(self.mesh_spec, part))
        _publish(folder / "mesh.msh", Path("meshes"), key)
        return key, folder

    @property
    def mesh_quality(self) -> dict[str, Any]:
        """Counts and quality of the mesh: the ``mesh`` table of result.json (angles in degrees); empty without one."""
        if self.plan.rung == "analytic":
            return {}
        if self.given is not None:
            return {"cells": self.airflow["cells"]}
        table: dict[str, Any] = json.loads((self.mesh[1] / "mesh.json").read_text())
        return table

    @property
    def given(self) -> Path | None:
        """The user's own case, where the scene names one."""
        air = self.scene.air
        return None if air is None or air.case is None else Path(air.case)

    @cached_property
    def solution(self) -> tuple[str, Path]:
        """Key and folder of the airflow, an OpenFOAM case; a time-resolved one starts from a solved one."""
        from ..foam import solve_airflow
        from ..foam.version import openfoam_version

        if self.given is not None:
            return self._measured(self.given)
        mesh_key, mesh_folder = self.mesh
        spec = flow_spec(self.scene, self.plan, self.mesh_spec)
        code = content_key(_code("airflow"), digest_files([case_template()]), openfoam_version())
        asked = {name: value for name, value in asdict(spec).items() if name not in ("mesh", "ranks")}
        key = content_key("airflow", mesh_key, asked, code)

        def work(part: Path) -> None:
            cells = json.loads((mesh_folder / "mesh.json").read_text())["cells"]
            solve_airflow(
                replace(spec, ranks=1 if spec.vibration else ranks_for(cells, cores())[0]),
                mesh_folder / "mesh.msh",
                part / "case",
                start=self._start(mesh_key, spec) if spec.stepping == "time-resolved" else None,
                listener=lambda now: self._tell("airflow", str(now)),
            )
            remember(part, mesh_key, spec)

        return key, self._stage("airflow", key, work)

    def _start(self, mesh_key: str, spec: FlowSpec) -> Path:
        """The case that a time-resolved airflow starts from: a solved one near to it, else the steady wake."""
        found = nearest(self.store, mesh_key, spec)
        return found if found is not None else self.draft.solution[1] / "case"

    def _measured(self, case: Path) -> tuple[str, Path]:
        """Key and folder of what was measured on the user's case; its files are the key: a new solution counts."""
        from ..foam.user_case import case_files, measure_given

        air, spec = self.scene.air, flow_spec(self.scene, self.plan, self.mesh_spec)
        assert air is not None
        time = air.time or "latest"
        key = content_key("given", repr(spec), time, digest_files(case_files(case, time)), _code("given"))

        def work(part: Path) -> None:
            self._tell("airflow", f"measuring {case}")
            (part / "case").mkdir(exist_ok=True)
            write_json(part / "case" / "airflow.json", measure_given(spec, case, time))

        return key, self._stage("airflow", key, work)

    @cached_property
    def draft(self) -> Pipeline:
        """The same scene in its steady airflow: where a time-resolved one starts, and the other end of the bracket."""
        plan = make_plan(self.scene, rung="draft", force=self.plan.force, target_error=self.plan.target_error)
        return replace(self, plan=plan, grid=0, label=f"{self.label}draft ")

    def on_grid(self, grid: int) -> Pipeline:
        """The same scene on another of the plan's grids."""
        scale = self.plan.airflow.scales[grid]
        return self if grid == self.grid else replace(self, grid=grid, label=f"{self.label}grid x {scale:.2g} ")

    def _tell(self, stage: str, text: str) -> None:
        self.listener(f"{self.label}{stage}", text)

    @property
    def airflow(self) -> dict[str, Any]:
        """What was measured on the airflow, or is known of it: the ``airflow`` table of result.json."""
        if self.plan.rung == "analytic":
            from .analytic import duct_airflow

            return {"rung": self.plan.rung, "turbulence": self.plan.airflow.turbulence, **duct_airflow(self.scene)}
        table: dict[str, Any] = json.loads((self.solution[1] / "case" / "airflow.json").read_text())
        return {"rung": self.plan.rung, **table}

    @cached_property
    def field(self) -> tuple[str, FlowField]:
        """Key and field on triangles that the tracker reads, of the whole channel."""
        from ..field import FlowField

        if self.plan.rung == "analytic":
            return self._duct()
        key, folder = self.solution
        key = content_key("field", key, _code("field"), _version("foamlib"))

        def work(part: Path) -> None:
            self._tell("field", "reading the airflow")
            assert self.scene.air is not None
            half = self.airflow["half"] if self.given else self.mesh_spec.half
            case = self.given or folder / "case"
            read = FlowField.from_openfoam(case, time=self.airflow["field_time"], density=self.scene.air.density)
            read = read.mirrored() if half else read
            (read.compressed() if read.period is not None else read).save(part / "field.npz")

        return key, FlowField.load(self._stage("field", key, work) / "field.npz")

    def _duct(self) -> tuple[str, FlowField]:
        """Key and field of air in which nothing stands; made in no time, so not kept."""
        from .analytic import duct_field

        air, channel = self.scene.air, self.scene.channel
        asked = (repr(air), channel.width, channel.top, channel.bottom, self.plan.airflow.turbulence)
        key = content_key("duct", asked, _code("duct"))
        return key, duct_field(self.scene, turbulent=self.plan.airflow.turbulence == "decaying")

    @property
    def truncation(self) -> dict[str, Any] | None:
        """What the time-resolved field lost when it was stored as a mean and modes; None for a steady one."""
        lost = self.field[1].truncation
        return None if lost is None else lost._asdict()

    @property
    def divergence(self) -> dict[str, float]:
        """Rms and largest |div u| h / U over the triangles that the tracker reads: how well they conserve volume."""
        found = self.field[1].divergence()
        return {"rms": found.rms, "max": found.max}

    @cached_property
    def tracks_key(self) -> str:
        """Everything the tracks depend on; mass shares, targets and the feed rate do not touch them."""
        tables = self.scene.model_dump(mode="json", by_alias=True)
        for fraction in tables["fraction"].values():
            del fraction["mass_share"], fraction["target"]
        for key in ("rate", "depth"):
            del tables["feed"][key]
        del tables["numerics"], tables["picture"], tables["funnel"]
        upstream = None if self.scene.air is None else self.field[0]
        how = {name: row.tracked for name, row in self.plan.fractions.items()}
        versions = [_version(package) for package in ("numpy", "scipy", "numba")]
        order = list(self.scene.bin)  # landings hold the bin's place in it
        mirrored = self.plan.airflow.mirrored
        return content_key(
            "tracks", tables, order, self.plan.flown_by, mirrored, repr(how), upstream, _code("tracks"), versions
        )

    def tracks(self, companion: Companion | None = None) -> Tracked:
        """Every granule's landing; of the first replicates' granules under a ``companion``'s change."""
        from .landings import load
        from .tracks import Flight

        change = companion or Companion("tracks")
        tolerance = change.tolerance or self.scene.numerics.tolerance
        replicates = REPLICATES if companion is None else COMPARED
        key = content_key(self.tracks_key, tolerance, change.blend, replicates)
        flow = None if self.scene.air is None else self.field[1]
        if flow is not None and flow.times is not None and change.blend != 1.0:
            flow = flow.blended(change.blend)
        tell = partial(self._tell, change.name)
        flights = Flight(self.scene, self.plan, flow, tolerance, self.workers, tell, replicates)
        if self.plan.flown_by == "tracker" and "compile" not in self.seconds and not self.store.holds(change.name, key):
            self._warm_up()
        folder = self._stage(change.name, key, lambda part: flights.fly_all(part, drawn=companion is None))
        return load(folder, self.scene)

    def shown(self, picture: Picture) -> dict[str, list[dict[str, Any]]]:
        """The tracks that a picture draws, by fraction: flown for it, from the same feed."""
        from .landings import load_drawn
        from .tracks import Flight

        names, flown = picture.chosen(list(self.scene.fraction)), picture.flown
        if flown is None:
            return {}
        key = content_key(self.tracks_key, self.scene.numerics.tolerance, names, flown)
        flow = None if self.scene.air is None else self.field[1]
        tell = partial(self._tell, "shown")
        flights = Flight(self.scene, self.plan, flow, self.scene.numerics.tolerance, self.workers, tell)
        folder = self._stage("shown", key, lambda part: flights.fly_shown(part, names, *flown))
        return {name: load_drawn(folder / f"{name}.drawn.npz") for name in names}

    def compile_beside(self) -> None:
        """Have the tracker compiled into its cache by another process, while this one waits for OpenFOAM."""
        if not self._compiling and cores() > 1:
            self._compiling.append(Thread(target=_compile, args=(self.store.root / "log.compile",), daemon=True))
            self._compiling[0].start()

    def _warm_up(self) -> None:
        from .tracks import compile_tracker

        started = time.monotonic()
        self._tell("compile", "the tracker is compiled, once for each version of it")
        for child in self._compiling:
            child.join()
        compile_tracker()
        self.seconds["compile"] = {"seconds": time.monotonic() - started, "cached": False}

    # -- cache ---------------------------------------------------------------------------------------------------

    def _stage(self, stage: str, key: str, work: Callable[[Path], Any]) -> Path:
        """Make a stage or take it from the cache, and note the seconds it took when it was computed."""

        def timed(part: Path) -> None:
            started = time.monotonic()
            before = json.loads(spent.read_text()) if (spent := part / "seconds.json").exists() else 0.0
            try:
                work(part)
            finally:  # an interrupted stage goes on later; its time counts
                write_json(spent, before + time.monotonic() - started)

        folder, cached = self.store.make(
            stage, key, timed, on_wait=lambda: self._tell(stage, "another run is computing this; waiting for it")
        )
        seconds = json.loads((folder / "seconds.json").read_text())
        self.seconds[self.label + stage] = {"seconds": seconds, "cached": cached}
        self._tell(stage, f"done ({'from the cache' if cached else f'{seconds:.1f} s'})")
        return folder


def _compile(log: Path) -> None:
    log.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(ProgramError):  # only time is lost: the tracker compiles where it is first used
        call_in_child("wakeflow.pipeline.tracks:compile_tracker", None, log=log)


def _code(stage: str) -> str:
    return code_key(*CODE[stage])


def _version(package: str) -> str:
    from importlib.metadata import version

    return version(package)


def _publish(file: Path, folder: Path, key: str) -> None:
    """Show a cached mesh under its key in the project's own ``meshes`` folder, where there is one."""
    target = folder / f"{key}.msh"
    if folder.is_dir() and not target.exists():
        with atomic_write(target, "wb") as stream:
            stream.write(file.read_bytes())
