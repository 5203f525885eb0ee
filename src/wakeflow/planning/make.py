"""The plan: what a scene needs, what is left out and by which bound, and what it will cost. Starts nothing heavy.

``terms`` chooses the forces of each fraction: a bound on each term's landing shift against the accuracy asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..core.errors import SceneError
from ..core.graded import Notice, gravest_first, less_sure, void
from ..scene import Scene
from ..scene.overrides import share_in
from ..scene.whole import States, switched
from .airflow_choice import JET, AirflowPlan, choose_airflow
from .approach import Approach, approaches, arrival_at_body, feels_granules, flights
from .collision_rates import Encounters, shifted
from .collisions import (
    LIGHT,
    CollisionPlan,
    collision_lines,
    granule_masses,
    plan_collisions,
    too_many_to_collide,
    why_no_collisions,
)
from .cost import estimate_cost, expected_stages
from .coupling import Limit, limits
from .dependence import orders
from .lock_in import AirMotion, vibration_of_scene
from .plan import FractionPlan, Plan, whole_terms
from .plan_messages import missing_lines, used_lines, warning_lines
from .stages import FliesAgain
from .terms import (
    AIR,
    COLLISIONS,
    LOADING,
    STICKING,
    VIBRATION,
    LeftOut,
    TermGate,
    TermSelection,
    check_switches,
    limit_of,
    moved_by_air,
)

TURNING = "deflection-before-the-impact"  # what injection leaves out: how the air before the body moves granules
MATTERS = 0.1  # body widths: a warning where the air that is left out could move a fraction by more; chosen
WORTHLESS = 1.0  # body widths: air that could move a fraction so far decides where it lands; chosen
FIRST_LOOK = "rung none is a first look at each granule alone; --force collisions=on"
NONE_MET = Encounters({}, 0.0, 0.0)  # for scales of which no one asks what a granule meets
LARGEST_ERROR = 0.5  # of a share: an accuracy beyond would say nothing


def make_plan(
    scene: Scene | Path | str,
    *,
    rung: str | None = None,
    force: States | None = None,
    target_error: float | str | None = None,
    sources: Sequence[FliesAgain] = (),
) -> Plan:
    """Decide what ``scene``, or that of a scene file, needs. ``rung`` and ``target_error`` (a share, 0.01 or "1 %")
    override the scene's; ``force`` switches terms on or off in addition to those of the scene's [force]: {"lift": "on"}
    for all fractions, {"chaff.lift": "on"} for one; True and False do as well. ``sources``: of error, which fly
    granules again and cost what they say.

    Raises SceneError when a rung or term is asked for that cannot be had, when a term that cannot be computed could
    move a fraction by more than the accuracy asked for, or when a number is above another that it is never above.
    """
    given = Scene.of(scene).fed()
    target = given.numerics.target_error if target_error is None else share_in(target_error, "target_error")
    if not 0.0 < target <= LARGEST_ERROR:
        raise SceneError(f"target-error = {target:g}: above 0 and at most 0.5 (0.01: one percent of a fraction)")
    switches = {**given.force, **switched(force)}
    made = _planned(given, given.numerics.rung if rung is None else rung, switches, target, sources)
    orders(given, made)
    return made


def _planned(
    given: Scene, rung: str, switches: Mapping[str, bool], target: float, sources: Sequence[FliesAgain]
) -> Plan:
    """The plan of a scene by a ``rung``, with its terms as switched, for the error ``target`` of a share."""
    airflow, motion = _airflow(given, rung, target, switches)
    flown, chain = airflow.flown(given), given.air is not None and airflow.kind == "none"
    check_switches(flown, switches, airflow.turbulence or "")
    known = approaches(flown, airflow)
    obstacle = FIRST_LOOK if chain else why_no_collisions(flown) or too_many_to_collide(flown, _laws(known))
    crowd = _crowd(flown, known, switches, target, obstacle, paired=airflow.mirrored)
    airflow, known = _under_load(flown, airflow, known, target, switches)
    together = whole_terms(airflow, crowd)
    gate = TermGate(flown, switches, target, airflow.turbulence or "", together, obstacle, motion.moved)
    fractions, chosen = {}, {}
    for name, one in known.items():
        fractions[name], chosen[name] = _decide(gate, name, one)
    validity = _validity(flown, fractions, known, gate.limit)
    without_air, warned = _without_air(given, fractions) if chain else ([], [])
    strained = warning_lines(flown, airflow, fractions, validity, target, together)
    slab = () if crowd is None else tuple(collision_lines(crowd))
    stages = expected_stages(flown, airflow, fractions, crowd, sources)
    return Plan(
        airflow=airflow,
        target_error=target,
        force=switches,
        fractions=fractions,
        used=tuple(used_lines(flown, airflow, fractions, validity, motion, slab, chain=chain)),
        left_out=(*_left_out(flown, fractions, chosen, without_air, chain=chain), *_sticking(flown, known)),
        estimate=estimate_cost(flown, airflow, fractions, stages),
        stages=stages,
        notices=gravest_first((*strained, *warned, *missing_lines(chosen, flown.unit))),
        validity=validity,
        unit=flown.unit,
        crowd=crowd,
    )


@dataclass(frozen=True)
class Planner:
    """Makes the plans of one scene with the same options: each rung's once, however often it is asked for.

    A run needs the plan of the rung asked for and, where its airflow is time-resolved, that of rung draft, from which
    this one starts; with a funnel the same for the rate that the funnel turned out to have (:meth:`at`).
    """

    scene: Scene
    force: Mapping[str, bool] = field(default_factory=dict)
    target_error: float | None = None
    sources: Sequence[FliesAgain] = ()
    _made: dict[str, Plan] = field(default_factory=dict, init=False, repr=False, compare=False)

    def keep(self, rung: str, plan: Plan) -> None:
        """Take the ``plan`` that was made for a ``rung`` elsewhere."""
        self._made[rung] = plan

    def plan(self, rung: str = "") -> Plan:
        """The plan of a ``rung``; empty: the scene's own. Raises SceneError as :func:`make_plan` does."""
        if rung not in self._made:
            self._made[rung] = make_plan(
                self.scene, rung=rung or None, force=self.force, target_error=self.target_error, sources=self.sources
            )
        return self._made[rung]

    def at(self, scene: Scene) -> Planner:
        """The same options for another scene, as for one whose feed rate is known by now."""
        return self if scene == self.scene else replace(self, scene=scene)


def _airflow(scene: Scene, rung: str, target: float, switches: Mapping[str, bool]) -> tuple[AirflowPlan, AirMotion]:
    """The airflow of a ``rung`` asked for, and what the vibration asks of it, with the mesh's motion as switched."""
    airflow = choose_airflow(scene, rung, target)
    if airflow.stepping != "time-resolved":
        return airflow, AirMotion()
    motion = vibration_of_scene(scene, airflow.accuracy, asked=switches.get(VIBRATION))
    if airflow.span is not None and motion.used:
        raise SceneError(f"rung = {rung!r} holds the body still in the air, and here {motion.why}; choose standard")
    return replace(airflow, moving=motion.used), motion


def _under_load(
    scene: Scene, airflow: AirflowPlan, known: dict[str, Approach], target: float, switches: Mapping[str, bool]
) -> tuple[AirflowPlan, dict[str, Approach]]:
    """The airflow that the granules' force moves, where that matters, and how they come through it."""
    airflow = airflow.feeling(scene, loaded=feels_granules(scene, airflow, known, target, switches))
    driven = airflow.turbulence == JET
    return airflow, {name: one.driven if driven else one for name, one in known.items()}


def _crowd(
    scene: Scene,
    approaches: Mapping[str, Approach],
    switches: Mapping[str, bool],
    target: float,
    obstacle: str,
    *,
    paired: bool,
) -> CollisionPlan | None:
    """The slab in which granules meet; None where that could not move a fraction by more than the accuracy allows, and
    where an ``obstacle`` is in the way, unless it was asked for. ``paired``: as :func:`plan_collisions` says.
    """
    asked = switches.get(COLLISIONS)
    if asked is None:
        limit = limit_of(scene, target)
        asked = not obstacle and any(shifted(scene, one.met, one.scales) > limit for one in approaches.values())
    return plan_collisions(scene, _laws(approaches), target, paired=paired) if asked else None


def _laws(approaches: Mapping[str, Approach]) -> dict[str, tuple[str, float]]:
    """Of each fraction: its drag law and the factor on it."""
    return {name: (one.law, one.scale) for name, one in approaches.items()}


def _decide(gate: TermGate, name: str, known: Approach) -> tuple[FractionPlan, TermSelection]:
    """How fraction ``name`` is computed, and with which forces. Raises SceneError as :func:`make_plan` does."""
    scene, turned = gate.scene, known.turned
    if scene.air is None:
        chosen, clear = gate.in_vacuum(name, shifted(scene, known.met, ())), bool(scene.body)
    else:
        chosen = gate.select(name, known.scales)
        small = turned is not None and turned.missed <= gate.target and turned.shift <= gate.limit
        clear = small and LOADING not in gate.together
    arrival = arrival_at_body(scene, name, known.law, known.scale)
    plan = FractionPlan(
        mode=_mode(scene, name, clear=clear),
        drag=known.law,
        drag_scale=known.scale,
        terminal_velocity=None if scene.air is None else arrival.settling,
        relaxation_time=arrival.tau,
        stokes=arrival.stokes,
        arrival_speed=arrival.speed,
        impaction=turned,
        forces=chosen.forces,
        bounds=chosen.bounds,
        limit=chosen.limit,
    )
    return plan, chosen


def _validity(
    scene: Scene, fractions: Mapping[str, FractionPlan], approaches: Mapping[str, Approach], shift: float
) -> tuple[Limit, ...]:
    """What the feed rate strains, by the speeds and scales of the fractions; ``shift`` as of :func:`limits`."""
    arrivals = {name: one.arrival_speed for name, one in fractions.items()}
    scales = {name: one.scales for name, one in approaches.items() if one.scales}
    met = {name: one.met for name, one in approaches.items()}
    return tuple(limits(scene, arrivals, scales, met, shift))


def _left_out(
    scene: Scene,
    fractions: Mapping[str, FractionPlan],
    chosen: Mapping[str, TermSelection],
    without_air: Iterable[LeftOut],
    *,
    chain: bool,
) -> Iterator[LeftOut]:
    """What is left out of each fraction's flight, and of the whole run."""
    for name, plan in fractions.items():
        yield from chosen[name].left_out
        if plan.mode == "injected" and plan.impaction is not None:
            why = "injected granules fall straight: how the air before the body moves where 95 % of them land"
            yield LeftOut(TURNING, plan.impaction.shift, why, name)
    yield from without_air
    if scene.air is None and not chain:
        yield LeftOut(AIR, 0.0, "no [air] table: neither mesh nor airflow is computed")


def _sticking(scene: Scene, approaches: Mapping[str, Approach]) -> Iterator[LeftOut]:
    """Of each fraction whose granules meet far heavier ones at the scene's feed rate: how much of it at most stays on
    those, the share that meets any, as meetings by chance are (Poisson).
    """
    if scene.feed.rate is None:
        return
    mass = {name: float(np.median(granule_masses(scene, name))) for name in approaches}
    for name, own in approaches.items():
        heavy = [other for other in own.met.by if mass[name] < LIGHT * mass[other]]
        met = sum(own.met.by[other] for other in heavy)
        if met > 0.0:
            why = f"it meets {met:.2g} granules of {' or '.join(heavy)} in the mean; if it stayed on the first that it "
            why += f"met, {-math.expm1(-met):.0%} of it at most would land with these: no granule stays on another"
            yield LeftOut(STICKING, math.inf, why, name)


def _without_air(scene: Scene, fractions: Mapping[str, FractionPlan]) -> tuple[list[LeftOut], list[Notice]]:
    """For each fraction of a scene with air that is flown without: what the air could move it by, and where that is
    worth a warning.
    """
    air, widest = scene.airstream, scene.channel.width / scene.width
    left_out: list[LeftOut] = []
    warned: list[Notice] = []
    for name, fraction in fractions.items():
        law = fraction.drag, fraction.drag_scale
        scales = flights(scene, name, *law, NONE_MET, straight=False, turbulent=True)
        middle = scales[len(scales) // 2]
        shift = min(widest, max(moved_by_air(flight) for flight in scales))
        carried = air.rises and middle.settling * math.cos(scene.channel.tilt) < air.speed
        stokes = middle.tau * middle.arrival / (0.5 * scene.width)
        fate = "the air would carry it up" if carried else f"Stokes number of its fall {stokes:.2g}"
        why = f"drag on the way at the largest slip, {middle.slip:.2g} m/s; {fate}"
        left_out.append(LeftOut(AIR, shift, why, name))
        if carried or shift > MATTERS:
            grade = void if carried or shift >= WORTHLESS else less_sure
            warned.append(grade(
                f"{name}: rung none leaves the air out, which could move it by {shift:.2g} {scene.unit} (terminal "
                f"velocity {middle.settling:.2g} m/s, air {air.blows}); {fate}; numerics.rung "
                "= 'draft' computes it"
            ))  # fmt: skip
    return left_out, warned


# -- one fraction ------------------------------------------------------------------------------------------------------


def _mode(scene: Scene, name: str, *, clear: bool) -> str:
    """Whether granules of a fraction are injected at the first body's face or released above it; ``clear``: no air
    turns them. The first impact of those that may stay there, or on a body that rocks, is the tracker's.
    """
    wanted = scene.feed.mode if scene.feed.start == "falling" and scene.plumb.upright else "resolved"
    if wanted != "auto":
        return wanted
    fraction, rocks = scene.fraction[name], scene.vibration is not None and scene.vibration.pivot is not None
    stay = fraction.capture_speed or fraction.sticks or next(iter(scene.body), None) in scene.collecting
    return "injected" if clear and not (scene.obstacles or stay or rocks) else "resolved"
