"""What a user must know of the airflow and of how the tracks ended."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ..air.kinds.airflow_table import Airflow, GridStudy
from ..core.graded import Notice, information, less_sure, void
from ..core.number import Number
from ..flight.stages.pipeline import Pipeline
from ..flight.stages.slab_stage import SHARE_OF_SHIFT
from ..planning.terms import STICKING
from ..planning.unknowns import half_of
from ..scene import OVER_THE_TOP, Scene
from .shares import CollisionSummary

if TYPE_CHECKING:
    from ..flight.stages.landings import Tracked


# -- What a user must know of the airflow and of how the tracks ended --------------------------------------------------
LOOSE_LOOP = 0.1  # of the rms fluctuation: a stored loop that joins with more kicks the granules once a period
LONGER = 1e-9  # m: rounding of the mesh's ends, no longer channel
JAM = "granules that lie still become more as long as it runs; widen the gap, or lower feed.rate"
MAX_LOST_PART = 0.05  # of a fraction: more granules without a landing void its shares; chosen
ENDINGS = {  # fates that are no landing: what they mean, and what to change
    "airborne": (
        "were still in the air when tracking ended",
        "; another air.speed, which does not hold them up, or a [bin.NAME] with points where they hover",
    ),
    "stopped": (
        "hit the tracker's hard stop",
        "; a larger numerics.tolerance, or a feed.position that does not begin inside a body",
    ),
    "resting": ("came to rest on a body or wall", "; [vibration], or a steeper body.NAME.slope_angle, throws them off"),
}


def air_notices(scene: Scene, pipeline: Pipeline, airflow: Airflow) -> list[Notice]:
    """What a user must know of the airflow."""
    notices = [] if pipeline.air.at_once else [*_airflow_notices(scene, pipeline, airflow)]
    return [*notices, *_unsettled(scene, pipeline, airflow), *_off_the_fan(scene, airflow)]


def flight_notices(
    scene: Scene, pipeline: Pipeline, tracked: Tracked, slab: CollisionSummary | None = None
) -> list[Notice]:
    """What a user must know of how the tracks ended; those in the ``slab``, where granules meet in one."""
    notices: list[Notice] = []
    if slab is not None:
        if slab.jammed:
            notices.append(void(f"the feed jams in {slab.jammed} of {slab.replicates} replicates: {JAM}"))
        notices += _step_not_reached(slab, pipeline.plan.unit)
    stays = [row for row in pipeline.plan.left_out if row.name == STICKING]
    notices += [information(f"{row.fraction}: {row.why}; the interval does not hold that") for row in stays]
    fates = tracked.fates if slab is None else slab.fates
    return [
        *notices,
        *_passing(pipeline, tracked),
        *_out_of_the_top(scene, tracked),
        *_unlanded(fates),
        *_captured(fates),
    ]


def _unsettled(scene: Scene, pipeline: Pipeline, airflow: Airflow) -> Iterator[Notice]:
    """Notice of a force on the air that more passes would change; of one pass the whole effect is in the interval."""
    force, loading, passes = airflow.loading, pipeline.loading, scene.numerics.loading_passes
    if force is not None and loading is not None and passes > 1 and force.unanswered > loading.answered:
        yield less_sure(
            f"the granules' force on the air has not settled, it is {100 * force.unanswered:.2g} % off; "
            f"numerics.loading_passes above {passes} goes on"
        )


def _off_the_fan(scene: Scene, airflow: Airflow) -> Iterator[Notice]:
    """Notice of air whose speed is farther from the one at which its fan has it than its interval."""
    fan, speed = airflow.fan, 0.0 if scene.air is None else scene.air.speed
    if fan is not None and fan.off > max(1e-3 * speed, half_of(scene, "air.speed", "air_speed", speed)):
        meets = "nowhere" if math.isnan(fan.meets) else f"at {fan.meets:.3g} m/s"
        yield less_sure(
            f"the fan's curve meets the drop that was computed {meets}, the air blows at {speed:.3g} m/s; "
            "uncertainty.air.speed that holds both puts it into the intervals"
        )


def _step_not_reached(slab: CollisionSummary, unit: str) -> Iterator[Notice]:
    """Notice of a clock that errs by more than was asked: no step tried is better by what a shorter one costs."""
    error, limit = slab.step_error, slab.step_asked
    if error > limit:
        yield less_sure(
            f"no step of the slab's clock is as exact as asked, after {slab.step_trials} trials: nine of ten landings "
            f"err by up to {error:.2g} {unit} ({limit:.2g} asked), which moves a share by up to "
            f"{100 * SHARE_OF_SHIFT * error:.2g} points; a larger numerics.tolerance asks for less"
        )


def _passing(pipeline: Pipeline, tracked: Tracked) -> Iterator[Notice]:
    """Notices of fractions whose first impact follows eq. (2): the granules that do not meet the body."""
    for name, met in tracked.injected.items():
        count = round(tracked.landings[name].size)
        if pipeline.plan.fractions[name].mode == "injected" and met < count:
            yield information(
                f"{name}: {count - met} of {count} granules fall beside the body or the air carries them round it; "
                "they are released above it, their impacts resolved"
            )


def _out_of_the_top(scene: Scene, tracked: Tracked) -> Iterator[Notice]:
    """Notices of the fractions that leave the channel above the feed: what upward air carries into the bin that stands
    there for it, and what no bin counts, carried or thrown.
    """
    carried = scene.air is not None and scene.air.rises
    how = "leaves through the top with the air" if carried else "is thrown out through the top"
    mend = "a [bin.NAME] with on = 'top' counts it" if carried else "a higher channel.top keeps it in"
    above = list(scene.bin).index(OVER_THE_TOP) if carried and OVER_THE_TOP in scene.bin else None
    for name, landing in tracked.landings.items():
        mass, over = landing.mass_shares, landing.bin == above
        if above is not None and over.any() and OVER_THE_TOP not in scene.fraction[name].targets:
            yield information(
                f"{name}: {mass[over].sum():.2g} of it {how}, counted as {OVER_THE_TOP}; a lower air.speed keeps it in"
            )
        gone = (landing.bin < 0) & landing.escaped & (landing.position[:, 1] > scene.level)
        if (share := float(mass[gone].sum())) > 0.0:
            yield less_sure(f"{name}: {share:.2g} of it {how} and counts as elsewhere; {mend}")


def _unlanded(ended: Mapping[str, Mapping[str, int]]) -> Iterator[Notice]:
    for name, fates in ended.items():
        total = sum(fates.values())
        for fate, (meaning, hint) in ENDINGS.items():
            if fates.get(fate):
                grade = void if fates[fate] > MAX_LOST_PART * total else less_sure
                yield grade(f"{name}: {fates[fate]} of {total} granules {meaning}; they count as elsewhere{hint}")


def _captured(ended: Mapping[str, Mapping[str, int]]) -> Iterator[Notice]:
    for name, fates in ended.items():
        if fates.get("captured"):
            stay = f"{fates['captured']} of {sum(fates.values())} granules stay where they struck a wall"
            yield information(f"{name}: {stay} that has no bin; they count as elsewhere (bin.NAME.keeps counts them)")


def _airflow_notices(scene: Scene, pipeline: Pipeline, airflow: Airflow) -> Iterator[Notice]:
    """Notices of a solved airflow, or the user's own: what it does not settle, how it was solved, where it ends."""
    resolves, notes = pipeline.plan.airflow.resolves, list(airflow.notes or ())
    if resolves and airflow.verdict != "steady":
        why = notes.pop(0) if notes else f"the steady airflow does not settle ({airflow.verdict})"
        yield less_sure(f"{why}; numerics.rung = '{resolves}' resolves it in time")
    if math.isfinite(airflow.period) and airflow.verdict == "broadband" and not airflow.span:
        yield information(
            "the wake sheds irregularly: the few periods of the loop are a small sample, which the intervals hold"
        )
    if safer := airflow.safer_settings:
        yield less_sure(safer)
    yield from map(less_sure, notes)
    if airflow.loop_mismatch > LOOSE_LOOP:
        yield less_sure(
            f"the stored loop joins with a mismatch of {airflow.loop_mismatch:.2g} of the fluctuation; a smaller "
            "numerics.averaging records more of it"
        )
    if (suction := airflow.suction).spans(scene.channel.width):
        length = suction.reversal_length or 0.0
        turned = f"the reversed flow behind the body is {1e3 * length:.3g} mm long" if length else "no air turns back"
        yield information(f"the suction zone (Cp < -0.5) spans the channel, since the body narrows it; {turned}")
    channel, spec = scene.channel, pipeline.air.in_case.mesh_spec
    if spec.top > channel.top + LONGER or spec.bottom < channel.bottom - LONGER:
        yield information(
            f"the air is computed in a longer channel, y from {1e3 * spec.bottom:.0f} to {1e3 * spec.top:.0f} mm, so "
            "that inlet and outlet do not touch the wake"
        )


# -- What is known of an airflow, with what other grids and the near wake's dust say of it -----------------------------
def with_mesh_error(airflow: Airflow) -> Airflow:
    """The airflow with the mesh's part in the intervals of what several grids were compared in. A best estimate keeps
    its own: its grids are those of one end.
    """
    studies = {study.quantity: study for study in airflow.grids if not airflow.ends}
    cd, base = _on_meshes(airflow.cd, studies.get("cd")), _on_meshes(airflow.cp_base, studies.get("cp_base"))
    return replace(airflow, cd=cd, cp_base=base)


def _on_meshes(number: Number, study: GridStudy | None) -> Number:
    """A number with the wider of its own interval and that of a comparison of grids, which holds it."""
    if not number or study is None:
        return number
    interval = number if number.known else study
    return replace(number, low=min(interval.low, study.low), high=max(interval.high, study.high))
