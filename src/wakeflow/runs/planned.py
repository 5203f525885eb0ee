"""The plan of a scene as a run makes it: with what each source of the budget costs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..answer.budget.source import in_order
from ..planning.make import make_plan as decide
from ..planning.plan import Plan
from ..planning.plan_messages import unfelt, unfelt_line
from ..scene import Scene
from ..scene.whole import States


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
