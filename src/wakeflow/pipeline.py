"""mesh -> airflow -> field -> tracks: every stage cached, each reading only what stands before it.

A stage's key is made of the scene's fields it reads, the key of the stage before, the sources of the code that computes
it and the versions of outside programs; a change of any other field answers from what is there.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .files import Store, atomic_write, cache_root, content_key, digest_files, write_json
from .planning import Plan, make_plan
from .resources import case_template
from .scene import GRAVITY, Scene
from .separation import Landings

if TYPE_CHECKING:
    from .field import FlowField
    from .meshing import MeshSpec
    from .tracking import Body, Granules, Tracks

__all__ = ["Chain", "Listener", "Tracked", "silent"]

Array = NDArray[np.float64]
Listener = Callable[[str, str], None]  # (stage, text)
DRAWN = 48  # tracks kept for pictures, a fraction
WALL = 0.05  # thickness of the channel's walls in channel widths; only their inner faces are ever met
PATIENCE = 40.0  # channel heights at air speed before a granule counts as airborne
CODE = Path(__file__).parent


def silent(stage: str, text: str) -> None:
    """The listener that hears nothing."""


@dataclass(frozen=True)
class Tracked:
    """What the tracker found: landings and drawn tracks by fraction, how many were injected, counts of fates."""

    landings: dict[str, Landings]
    drawn: dict[str, list[dict[str, Array]]]
    injected: dict[str, int]
    fates: dict[str, dict[str, int]]


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
        code = content_key(_sources("foam"), digest_files([case_template()]), version())
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
        draft = replace(self, plan=make_plan(self.scene, rung="draft"), seconds={})
        return draft.solution[1] / "case"

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
        key = content_key("field", key, _sources("foam/read.py", "foam/polymesh.py", "reconstruction.py", "field.py"))

        def work(part: Path) -> None:
            self.listener("field", "reading the airflow")
            assert self.scene.air is not None
            time = "latest" if self.airflow["period"] is None else "all"
            read = FlowField.from_openfoam(folder / "case", time=time, density=self.scene.air.density)
            (read.mirrored() if self.mesh_spec.half else read).save(part / "field.npz")

        return key, FlowField.load(self._stage("field", key, work) / "field.npz")

    @cached_property
    def tracks_key(self) -> str:
        """Everything the tracks depend on; mass shares, targets and the feed rate do not touch them."""
        tables = self.scene.model_dump(mode="json", by_alias=True)
        for fraction in tables["fraction"].values():
            del fraction["mass_share"], fraction["target"]
        for key in ("rate", "depth"):
            del tables["feed"][key]
        del tables["numerics"]["rung"], tables["numerics"]["keep"]
        upstream = None if self.scene.air is None else self.field[0]
        how = {name: asdict(row) for name, row in self.plan.fractions.items()}
        code = _sources("laws", "tracking", "field.py", "injection.py", "pipeline.py", "geometry.py")
        return content_key("tracks", tables, self.plan.forces, repr(how), upstream, code)

    def tracks(self, tolerance: float | None = None) -> Tracked:
        """Every granule's landing. Another ``tolerance`` than the scene's is a companion run for the budget."""
        asked = self.scene.numerics.tolerance if tolerance is None else tolerance
        stage = "tracks" if tolerance is None else "companion"
        key = content_key(self.tracks_key, asked)
        folder = self._stage(stage, key, lambda part: self._track_all(part, asked, drawn=tolerance is None))
        return _load_tracked(folder, list(self.scene.fraction))

    # -- tracking ------------------------------------------------------------------------------------------------

    def _track_all(self, folder: Path, tolerance: float, *, drawn: bool) -> None:
        from .injection import feedstock
        from .tracking import Fate

        flow = None if self.scene.air is None else self.field[1]
        period = None if flow is None else flow.period
        injected, fates = {}, {}
        for name in self.scene.fraction:
            self.listener("tracks", f"{name}: injecting")
            feed = feedstock(self.scene, self.plan, name, period)
            tracks = self._fly(flow, name, feed.granules, tolerance)
            injected[name] = int(feed.injected.sum())
            fates[name] = {fate.name.lower(): int(np.sum(tracks.fate == fate)) for fate in Fate}
            landing = {
                "position": tracks.position,
                "bin": np.where((tracks.line >= 0) & (tracks.line < len(self.scene.bin)), tracks.line, -1),
                "replicate": feed.replicate,
                "diameter": feed.granules.diameter,
                "fate": tracks.fate,
                "time": tracks.time - feed.granules.time,
                "impacts": tracks.impacts + feed.injected,  # the tracker did not see the first impact of these
            }
            with atomic_write(folder / f"{name}.npz", "wb") as stream:
                np.savez(stream, **landing)
            if drawn:
                chosen = np.linspace(0, len(feed.replicate) - 1, min(DRAWN, len(feed.replicate))).astype(int)
                shown = self._fly(flow, name, feed.granules[chosen], tolerance, record=True)
                _save_drawn(folder / f"{name}.drawn.npz", [shown.path(i) for i in range(len(chosen))])
        write_json(folder / "counts.json", {"injected": injected, "fates": fates})

    def _fly(
        self, flow: FlowField | None, name: str, grains: Granules, tolerance: float, *, record: bool = False
    ) -> Tracks:
        from .tracking import track

        scene = self.scene
        height = scene.channel.top - scene.channel.bottom
        speed = np.sqrt(GRAVITY * height) if scene.air is None else scene.air.speed
        return track(
            flow,
            grains,
            until=float(np.max(grains.time, initial=0.0)) + max(5.0, PATIENCE * height / speed),
            tolerance=tolerance,
            length=scene.width,
            forces=self.plan.forces,
            drag=self.plan.fractions[name].drag,
            bodies=solids(scene),
            lines=ends(scene),
            gravity=(0.0, -GRAVITY),
            record=record,
            workers=self.workers,
            progress=None if record else lambda done, total: self.listener("tracks", f"{name}: {done} of {total}"),
        )

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


def solids(scene: Scene) -> list[Body]:
    """What granules bounce off: the bodies, vibrating or at rest, and the channel's walls where no bin stands."""
    from .tracking import Body, Motion

    amplitude, omega = scene.motion
    motion = Motion(tuple(amplitude), omega / (2 * np.pi)) if omega > 0 else None
    found = [Body(body.outline(), motion=motion) for body in scene.body.values()]
    half, thick = scene.channel.width / 2, WALL * scene.channel.width
    for side, inner, outer in (("left", -half, -half - thick), ("right", half, half + thick)):
        level = scene.channel.bottom - thick
        open_ranges = sorted((b.start, b.to) for b in scene.bin.values() if b.points is None and b.on == side)
        for start, end in [*open_ranges, (scene.channel.top + thick, None)]:
            assert start is not None
            if start > level:
                low, high = sorted((inner, outer))
                found.append(Body(np.array([(low, level), (high, level), (high, start), (low, start)])))
            level = end if end is not None else level
    return found


def ends(scene: Scene) -> list[Array]:
    """Lines that end a track: the bins in the scene's order, then the floor and the top of the channel."""
    channel = scene.channel
    half, slack = 0.5 * channel.width, 1e-6 * channel.width
    across = np.array([-half - WALL * channel.width, half + WALL * channel.width])
    borders = [np.stack([across, np.full(2, y)], axis=1) for y in (channel.bottom - slack, channel.top + slack)]
    return [bin_.line(channel) for bin_ in scene.bin.values()] + borders


def _save_drawn(path: Path, paths: list[tuple[Array, Array, Array]]) -> None:
    """Tracks end to end in one file: row splits, time (s), position (m), velocity (m/s)."""
    split = np.cumsum([0] + [len(t) for t, _, _ in paths])
    joined = [np.concatenate(parts) for parts in zip(*paths, strict=True)]
    with atomic_write(path, "wb") as stream:
        np.savez(stream, split=split, time=joined[0], position=joined[1], velocity=joined[2])


def _load_tracked(folder: Path, names: list[str]) -> Tracked:
    counts = json.loads((folder / "counts.json").read_text())
    landings: dict[str, Landings] = {}
    drawn: dict[str, list[dict[str, Array]]] = {}
    for name in names:
        with np.load(folder / f"{name}.npz") as data:
            landings[name] = Landings(**{key: data[key] for key in data.files})
        file = folder / f"{name}.drawn.npz"
        drawn[name] = []
        if file.exists():
            with np.load(file) as data:
                cut = data["split"]
                parts = {key: np.split(data[key], cut[1:-1]) for key in ("time", "position", "velocity")}
            drawn[name] = [
                {key: parts[key][i] for key in ("time", "position", "velocity")} for i in range(len(cut) - 1)
            ]
    return Tracked(landings, drawn, counts["injected"], counts["fates"])
