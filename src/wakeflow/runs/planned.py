"""The plan of a scene as a run makes it: with what each source of the budget costs; rung none's answer in memory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ..air.kinds.airflow_kinds import Realisations
from ..answer.budget.source import in_order
from ..answer.separation import separate
from ..answer.shares import Separation, WithShares
from ..core.record import JsonTable, to_json
from ..flight.stages.fraction_flights import Flight
from ..flight.stages.landings import Landings
from ..planning.make import make_plan as decide
from ..planning.plan import Plan
from ..planning.plan_messages import unfelt, unfelt_line
from ..scene import Scene
from ..scene.scene_tables import States


def make_plan(
    scene: Scene | Path | str,
    *,
    rung: str | None = None,
    force: States | None = None,
    target_error: float | str | None = None,
) -> Plan:
    """Decide what ``scene``, or that of a scene file, needs. ``rung`` and ``target_error`` (a share, 0.01 or "1 %")
    override the scene's; ``force`` switches terms on or off in addition to those of the scene's [force]: {"lift": "on"}
    for all fractions, {"chaff.lift": "on"} for one; True and False do as well.

    Raises SceneError when a rung or term is asked for that cannot be had, when a term that cannot be computed could
    move a fraction by more than the accuracy asked for, or when a number is above another that it is never above.
    """
    return decide(scene, rung=rung, force=force, target_error=target_error, sources=in_order())


def deaf_line(changed: Iterable[str], scene: Scene, rung: str | None = None) -> str:
    """Which of the ``changed`` keys change no answer of a scene on a ``rung``, by default its own; "" where none."""
    deaf = unfelt(changed, scene, rung or scene.numerics.rung)
    return unfelt_line(deaf) if deaf else ""


# -- The answer of rung none in memory: for searches that try many scenes before any airflow is worth its time ---------
@dataclass(frozen=True)
class Chained(WithShares):
    """Where a scene's granules land without its air: the ``plan`` that says what that leaves out, ``landings`` by
    fraction and their ``shares``.
    """

    plan: Plan
    landings: dict[str, Landings]
    shares: Separation

    @property
    def separation(self) -> JsonTable:
        """The ``separation`` table of result.json."""
        table: JsonTable = to_json(self.shares)
        return table

    @property
    def _shares(self) -> Separation:
        return self.shares


def chain(scene: Scene | Path | str, *, count: int | None = None) -> Chained:
    """Fly the granules of ``scene``, or that of a scene file, without its air, ``count`` of each fraction instead of
    its own.

    The answer of ``wakeflow run --rung none`` without its files: impacts and parabolas from body to body. Granules,
    vibration and bins are those of every other rung. The first call of a new installation compiles the tracker, which
    takes half a minute. Raises SceneError as :func:`wakeflow.plan` does.
    """
    scene = Scene.of(scene)
    if count is not None:
        scene = scene.replace({"feed.count": count})
    plan = make_plan(scene, rung="none")
    flown = scene.without_air()
    flight = Flight(flown, plan, Realisations(None), scene.numerics.tolerance)
    landings = {name: flight.landings(name) for name in flown.fraction}
    return Chained(plan, landings, separate(flown, landings))
