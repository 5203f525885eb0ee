"""mesh -> airflow -> field -> tracks: every stage cached, each reading only what stands before it.

A stage's key is made of the scene's fields it reads, the key of the stage before, the sources of the code that computes
it and the versions of outside programs; a change of any other field answers from what is there.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .files import Store, atomic_write, cache_root, content_key, digest_files, write_json
from .planning import Plan, make_plan
from .resources import case_template
from .scene import Scene

if TYPE_CHECKING:
    from .field import FlowField
    from .flight import Flight, Tracked
    from .meshing import MeshSpec

__all__ = ["Chain", "Listener", "silent"]

Listener = Callable[[str, str], None]  # (stage, text)
CODE = Path(__file__).parent


def silent(stage: str, text: str) -> None:
    """The listener that hears nothing."""


@dataclass
class Chain:
    """The stages of one scene under one plan; each is made at most once and comes from the cache where it can."""

    scene: Scene
    plan: Plan
    listener: Listener = silent
    workers: int | None = None
    store: Store = field(default_factory=lambda: Store(cache_root()))
    seconds: dict[str, dict[str, Any]] = field(default_factory=dict)

    @cached_property
    def mesh_spec(self) -> MeshSpec:
        """What the plan wants meshed."""
        from .meshing import plan_mesh

        channel, air = self.scene.channel, self.scene.air
        assert air is not None
        return plan_mesh(
            [body.outline() for body in self.scene.body.values()],
            width=channel.width,
            top=channel.top,
            bottom=channel.bottom,
            names=list(self.scene.body),
            walls=channel.walls,
            direction=air.direction,
            rung=self.plan.rung,
        )

    @cached_property
    def mesh(self) -> tuple[str, Path]:
        """Key and folder (mesh.msh, mesh.vtu, mesh.json); a folder ``meshes`` here gets the .msh as <key>.msh too."""
        from .meshing import build_mesh

        key = content_key("mesh", asdict(self.mesh_spec), _sources("meshing.py", "geometry.py"), _version("gmsh"))
        folder = self._stage("mesh", key, lambda part: build_mesh(self.mesh_spec, part))
        _publish(folder / "mesh.msh", Path("meshes"), key)
        return key, folder

    @property
    def mesh_quality(self) -> dict[str, Any]:
        """Counts and quality of the mesh: the ``mesh`` table of result.json (angles in degrees)."""
        table: dict[str, Any] = json.loads((self.mesh[1] / "mesh.json").read_text())
        return table

    @cached_property
    def solution(self) -> tuple[str, Path]:
        """Key and folder of the airflow, an OpenFOAM case; a time-resolved one starts from the draft's steady wake."""
        from .foam import FlowSpec, solve_airflow
        from .foam.version import version

        air, stage = self.scene.air, "airflow"
        assert air is not None
        assert self.plan.turbulence is not None
        mesh_key, mesh_folder = self.mesh
        spec = FlowSpec(
            mesh=self.mesh_spec,
            speed=air.speed,
            density=air.density,
            viscosity=air.viscosity,
            turbulence=self.plan.turbulence,
            stepping="steady" if self.plan.rung == "draft" else "time-resolved",
            intensity=air.turbulence,
        )
        code = content_key(_sources("foam", "reconstruction.py"), digest_files([case_template()]), version())
        key = content_key(stage, mesh_key, {k: v for k, v in asdict(spec).items() if k != "mesh"}, code)

        def work(part: Path) -> None:
            start = self._draft() if self.plan.rung == "standard" else None
            solve_airflow(
                spec,
                mesh_folder / "mesh.msh",
                part / "case",
                start=start,
                listener=lambda now: self.listener(stage, str(now)),
            )

        return key, self._stage(stage, key, work)

    def _draft(self) -> Path:
        """The case folder of the same scene's draft airflow."""
        plan = make_plan(self.scene, rung="draft", force=self.plan.force, target_error=self.plan.target_error)
        draft = replace(self, plan=plan, seconds={}, listener=lambda stage, text: self.listener(f"draft {stage}", text))
        folder = draft.solution[1] / "case"
        self.seconds.update({f"draft {stage}": spent for stage, spent in draft.seconds.items()})
        return folder

    @property
    def airflow(self) -> dict[str, Any]:
        """What was measured on the airflow: the ``airflow`` table of result.json."""
        table: dict[str, Any] = json.loads((self.solution[1] / "case" / "airflow.json").read_text())
        return {"rung": self.plan.rung, **table}

    @cached_property
    def field(self) -> tuple[str, FlowField]:
        """Key and field on triangles that the tracker reads, of the whole channel."""
        from .field import FlowField

        key, folder = self.solution
        code = _sources("foam/read.py", "foam/polymesh.py", "reconstruction.py", "field")
        key = content_key("field", key, code, _version("foamlib"))

        def work(part: Path) -> None:
            self.listener("field", "reading the airflow")
            assert self.scene.air is not None
            time = "latest" if self.airflow["period"] is None else "all"
            read = FlowField.from_openfoam(folder / "case", time=time, density=self.scene.air.density)
            (read.mirrored() if self.mesh_spec.half else read).compressed().save(part / "field.npz")

        return key, FlowField.load(self._stage("field", key, work) / "field.npz")

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
        del tables["numerics"]
        upstream = None if self.scene.air is None else self.field[0]
        how = {name: row.tracked for name, row in self.plan.fractions.items()}
        code = _sources(
            "laws", "tracking", "field", "scales.py", "injection.py", "flight.py", "geometry.py", "tables.py"
        )
        versions = [_version(package) for package in ("numpy", "scipy", "numba")]
        order = list(self.scene.bin)  # landings hold the bin's place in it
        return content_key("tracks", tables, order, self.plan.symmetric, repr(how), upstream, code, versions)

    def tracks(self, tolerance: float | None = None) -> Tracked:
        """Every granule's landing. Another ``tolerance`` than the scene's is a companion run for the budget."""
        from . import flight

        asked = self.scene.numerics.tolerance if tolerance is None else tolerance
        stage = "tracks" if tolerance is None else "companion"

        key = content_key(self.tracks_key, asked)
        flow = None if self.scene.air is None else self.field[1]
        flights = flight.Flight(self.scene, self.plan, flow, asked, self.workers, partial(self.listener, stage))
        if "compile" not in self.seconds and not self.store.holds(stage, key):
            self._warm_up(flights)
        folder = self._stage(stage, key, lambda part: flights.fly_all(part, drawn=tolerance is None))
        return flight.load(folder, self.scene)

    def _warm_up(self, flights: Flight) -> None:
        started = time.monotonic()
        self.listener("compile", "the tracker is compiled, once for each version of it")
        flights.warm_up()
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
            stage, key, timed, on_wait=lambda: self.listener(stage, "another run is computing this; waiting for it")
        )
        seconds = json.loads((folder / "seconds.json").read_text())
        self.seconds[stage] = {"seconds": seconds, "cached": cached}
        self.listener(stage, f"done ({'from the cache' if cached else f'{seconds:.1f} s'})")
        return folder


def _sources(*names: str) -> str:
    return digest_files(CODE / name for name in names)


def _version(package: str) -> str:
    from importlib.metadata import version

    return version(package)


def _publish(file: Path, folder: Path, key: str) -> None:
    """Show a cached mesh under its key in the project's own ``meshes`` folder, where there is one."""
    target = folder / f"{key}.msh"
    if folder.is_dir() and not target.exists():
        with atomic_write(target, "wb") as stream:
            stream.write(file.read_bytes())
