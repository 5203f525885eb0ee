"""What a user must know of the airflow and of how the tracks ended."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..core.record import to_json
from ..funnel import notices as funnel_notices
from ..pipeline.pipeline import Pipeline
from ..scene import Scene
from .airflow_summary import Airflow
from .crowd_summary import CrowdSummary
from .funnel_summary import FunnelSummary

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

__all__ = ["notices"]

LOOSE_LOOP = 0.1  # of the rms fluctuation: a stored loop that joins with more kicks the granules once a period
SPANNED = 0.99  # channel widths: a suction zone as wide as this reaches both walls, but for a cell at each
LONGER = 1e-9  # m: rounding of the mesh's ends, no longer channel
JAM = "granules that lie still become more as long as it runs; widen the gap, or feed less"
ENDINGS = {  # fates that are no landing: what they mean
    "airborne": "were still in the air when tracking ended",
    "stopped": "hit the tracker's hard stop",
    "resting": "came to rest on a body or wall",
}


def notices(
    scene: Scene,
    pipeline: Pipeline,
    airflow: Airflow | None,
    funnel: FunnelSummary | None,
    tracked: Tracked | None,
    slab: CrowdSummary | None = None,
) -> list[str]:
    """What a user must know of the airflow, of the feed funnel and of how the tracks ended, a line each; those in the
    ``slab``, where granules meet in one.
    """
    solved = airflow is not None and not pipeline.kind.at_once
    lines = list(_airflow_notices(scene, pipeline, airflow)) if solved and airflow is not None else []
    lines += [] if funnel is None else funnel_notices(to_json(funnel))
    if tracked is not None:
        if slab is not None and slab.jammed:
            lines.append(f"the feed jams in {slab.jammed} of {slab.replicates} replicates: {JAM}")
        lines += [*_passing(pipeline, tracked), *_unlanded(tracked.fates if slab is None else slab.fates)]
    return lines


def _passing(pipeline: Pipeline, tracked: Tracked) -> Iterator[str]:
    """Of fractions whose first impact follows eq. (2): the granules that do not meet the body."""
    for name, met in tracked.injected.items():
        count = len(tracked.landings[name].bin)
        if pipeline.plan.fractions[name].mode == "injected" and met < count:
            yield (
                f"{name}: {count - met} of {count} granules fall beside the body or the air carries them round it; "
                "they are released above it, their impacts resolved"
            )


def _unlanded(ended: Mapping[str, Mapping[str, int]]) -> Iterator[str]:
    for name, fates in ended.items():
        total = sum(fates.values())
        for fate, meaning in ENDINGS.items():
            if fates.get(fate):
                yield f"{name}: {fates[fate]} of {total} granules {meaning}; they count as elsewhere"


def _airflow_notices(scene: Scene, pipeline: Pipeline, airflow: Airflow) -> Iterator[str]:
    """Of a solved airflow, or of the user's own: what it does not settle, how it was solved, where it ends."""
    resolves = pipeline.plan.airflow.resolves
    if resolves is not None and airflow.verdict != "steady":
        yield f"the steady airflow does not settle ({airflow.verdict}): use rung {resolves}"
    if airflow.period is not None and airflow.verdict == "broadband" and airflow.span is None:
        yield "the wake sheds irregularly: the few periods of the loop are a small sample, which the intervals hold"
    yield from _solver_notices(airflow)
    if (airflow.loop_mismatch or 0.0) > LOOSE_LOOP:
        yield f"the stored loop joins with a mismatch of {airflow.loop_mismatch:.2g} of the fluctuation"
    suction = airflow.suction
    assert suction is not None
    assert suction.width is not None
    if suction.width > SPANNED * scene.channel.width:
        yield (
            "the suction zone (Cp < -0.5) spans the channel, since the body narrows it; the reversed flow behind the "
            f"body is {1e3 * (suction.reversal_length or 0.0):.3g} mm long"
        )
    channel, spec = scene.channel, pipeline.mesh_spec
    if spec.top > channel.top + LONGER or spec.bottom < channel.bottom - LONGER:
        yield (
            f"the air is computed in a longer channel, y from {spec.bottom:.3g} to {spec.top:.3g} m, so that inlet "
            "and outlet do not touch the wake"
        )


def _solver_notices(airflow: Airflow) -> Iterator[str]:
    """Which settings served, and what the solver's stage noted."""
    from ..foam.failure import Attempt
    from ..foam.ladder import warning

    tried = [Attempt(attempt.settings, attempt.cause, attempt.message) for attempt in airflow.attempts or ()]
    if (safer := warning(airflow.settings or "normal", tried)) is not None:
        yield safer
    yield from airflow.notes or ()
