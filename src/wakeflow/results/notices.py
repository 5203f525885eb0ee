"""What a user must know of the airflow and of how the tracks ended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..funnel import notices
from ..pipeline.pipeline import Pipeline
from ..scene import Scene

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked


def _notices(scene: Scene, pipeline: Pipeline, table: dict[str, Any], tracked: Tracked | None) -> list[str]:
    """What a user must know of the airflow and of how the tracks ended."""
    solved = table["airflow"] is not None and not pipeline.kind.at_once
    lines = _airflow_notices(scene, pipeline, table["airflow"]) if solved else []
    lines += [] if table["funnel"] is None else notices(table["funnel"])
    for name, met in ({} if tracked is None else tracked.injected).items():
        count = len(tracked.landings[name].bin) if tracked else 0
        if pipeline.plan.fractions[name].mode == "injected" and met < count:
            lines.append(
                f"{name}: {count - met} of {count} granules fall beside the body or the air carries them round it; "
                "they are released above it, their impacts resolved"
            )
    for name, fates in ({} if tracked is None else tracked.fates).items():
        total = sum(fates.values())
        for fate, meaning in (
            ("airborne", "were still in the air when tracking ended"),
            ("stopped", "hit the tracker's hard stop"),
            ("resting", "came to rest on a body or wall"),
        ):
            if fates.get(fate):
                lines.append(f"{name}: {fates[fate]} of {total} granules {meaning}; they count as elsewhere")
    return lines


def _airflow_notices(scene: Scene, pipeline: Pipeline, airflow: dict[str, Any]) -> list[str]:
    from ..foam.failure import Attempt
    from ..foam.ladder import warning

    lines = []
    resolves = pipeline.plan.airflow.resolves
    if resolves is not None and airflow["verdict"] != "steady":
        lines.append(f"the steady airflow does not settle ({airflow['verdict']}): use rung {resolves}")
    if airflow.get("period") is not None and airflow["verdict"] == "broadband":
        lines.append(
            "the wake sheds irregularly: a loop of a few periods is a small sample of it; compare left and right"
        )
    tried = [Attempt(**attempt) for attempt in airflow.get("attempts") or []]
    if (safer := warning(airflow.get("settings", "normal"), tried)) is not None:
        lines.append(safer)
    lines += airflow.get("notes") or []
    if (airflow["loop_mismatch"] or 0.0) > 0.1:
        lines.append(f"the stored loop joins with a mismatch of {airflow['loop_mismatch']:.2g} of the fluctuation")
    suction = airflow["suction"]
    if suction["width"] > 0.99 * scene.channel.width:
        lines.append(
            "the suction zone (Cp < -0.5) spans the channel, since the body narrows it; the reversed flow behind the "
            f"body is {1e3 * suction['reversal_length']:.3g} mm long"
        )
    channel, spec = scene.channel, pipeline.mesh_spec
    if spec.top > channel.top + 1e-9 or spec.bottom < channel.bottom - 1e-9:
        lines.append(
            f"the air is computed in a longer channel, y from {spec.bottom:.3g} to {spec.top:.3g} m, so that inlet "
            "and outlet do not touch the wake"
        )
    return lines
