"""The stage of the tracks: every granule's landing from the cache, or flown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...air.kinds.airflow_kinds import FlownAir
from ...core.lazy import cached_property
from ...core.record import JsonTable
from ...core.store import content_key
from ...core.tables import Columns
from ...planning.plan import COMPARED, REPLICATES, Plan
from ...planning.stage_cache import StageCache, code_of, version_of
from ...scene import Scene
from .compilation import Compilation

if TYPE_CHECKING:
    from ...air.kinds.airflow_kinds import Realisations
    from ...scene import Picture
    from .fraction_flights import Flight
    from .landings import Tracked

CODE = "flight.stages.fraction_flights", "flight.stages.landings"  # what computes it


@dataclass(frozen=True)
class PerturbedRerun:
    """Part of the granules flown again, the same ones, with one thing changed: what that changes is an error.

    ``name`` among the stages; ``tolerance`` (body widths), 0: the scene's; ``wake``: theta and strength of the wake, as
    in ``field.blended_wake``, empty: the answer's own; ``noises``: intervals of noise that last as one;
    ``replicates``: the first of them, that fly; ``drawn``: tracks for pictures are kept.
    """

    name: str
    tolerance: float = 0.0
    wake: tuple[float, ...] = ()
    noises: int = 1
    replicates: int = COMPARED
    drawn: bool = False


ANSWER = PerturbedRerun("tracks", replicates=REPLICATES, drawn=True)  # all of them, with nothing changed


def unweighed(scene: Scene) -> dict[str, object]:
    """The tables of a scene without what moves no granule: mass shares, targets, the feed's rate, pictures."""
    tables: JsonTable = scene.model_dump(mode="json", by_alias=True)
    for fraction in tables["fraction"].values():
        del fraction["mass_share"], fraction["target"]
    del tables["feed"]["rate"], tables["feed"]["depth"]
    for name in ("picture", "report", "limit", "price"):
        del tables[name]
    return tables


@dataclass
class TrackStage:
    """The tracks of one scene under one plan through one airflow."""

    scene: Scene
    plan: Plan
    cache: StageCache
    air: FlownAir
    compilation: Compilation
    workers: int

    @cached_property
    def key(self) -> str:
        """Everything the tracks depend on."""
        tables = unweighed(self.scene)
        for name in ("numerics", "funnel", "collisions", "force", "uncertainty"):
            del tables[name]
        how = {name: row.tracked for name, row in self.plan.fractions.items()}
        versions = [version_of(package) for package in ("numpy", "scipy", "numba")]
        order = list(self.scene.bin)  # landings hold the bin's place in it
        mirrored, airs = self.plan.airflow.mirrored, self.air.realisations
        flown = mirrored, len(airs), airs.cycles
        return content_key("tracks", tables, order, *flown, repr(how), self.air.key, code_of(*CODE), versions)

    def fly(self, change: PerturbedRerun = ANSWER) -> Tracked:
        """Every granule's landing; of the first replicates' granules under a ``companion``'s change."""
        from .landings import load_tracked

        flight = replace(
            self.flight(self.scene, self.realised(change.wake)), tell=partial(self.cache.tell, change.name),
            tolerance=change.tolerance or self.scene.numerics.tolerance, replicates=change.replicates,
            noises=change.noises,
        )  # fmt: skip
        changed = flight.tolerance, change.wake, change.noises, change.replicates
        folder = self.make(change.name, partial(flight.fly_all, drawn=change.drawn), *changed)
        return load_tracked(folder, self.scene)

    def shown(self, picture: Picture) -> dict[str, list[Columns]]:
        """The tracks that a picture draws, by fraction: flown for it, from the same feed."""
        from .landings import load_recorded_tracks

        names, flown = picture.chosen(list(self.scene.fraction)), picture.flown
        if not flown[0]:
            return {}
        flight = replace(self.flight(self.scene, self.airs), tell=partial(self.cache.tell, "shown"))
        work = partial(flight.fly_pictured, names=names, count=flown[0], body_speed=flown[1])
        folder = self.make("shown", work, flight.tolerance, names, flown)
        return {name: load_recorded_tracks(folder / f"{name}.drawn.npz") for name in names}

    @property
    def airs(self) -> Realisations:
        """The airflow's realisations."""
        return self.air.realisations

    def realised(self, wake: tuple[float, ...]) -> Realisations:
        """The airflow with the theta and the strength of a ``wake``; empty: as it is."""
        if not wake or self.airs.field is None:
            return self.airs
        return replace(self.airs, field=self.air.between(*wake), others=())

    def flight(self, scene: Scene, airs: Realisations) -> Flight:
        """What flies granules of ``scene``, a variation of the stage's own, through ``airs`` as the answer's fly."""
        from .fraction_flights import Flight

        return Flight(scene, self.plan, airs, self.scene.numerics.tolerance, self.workers)

    def make(self, name: str, work: Callable[[Path], object], *key: object, **how: Any) -> Path:
        """The folder of a stage that flies these granules in these airs, from the cache or by ``work(folder)``; ``key``
        is what it depends on beside, ``how`` as of :meth:`Compilation.make`.
        """
        return self.compilation.make(self.cache, name, content_key(self.key, *key), work, **how)
