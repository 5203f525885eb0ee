"""The plan: what a scene needs, what is left out and by which bound, and what it will cost. Starts nothing heavy.

A fraction before its forces are chosen falls through the channel's uniform air with its own drag (``uniform_fall``),
with meetings as given: the scales of its flight are what the bounds are made of, and say whether the air feels it.
``terms`` chooses the forces of each fraction: a bound on each term's landing shift against the accuracy asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import SceneError
from ..core.graded import Notice, gravest_first, less_sure, void
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity, slip_correction, terminal_velocity
from ..laws.driven_jet import ENERGY
from ..laws.forces import FlightScales
from ..laws.forces.force import REACH
from ..scene import Fraction, Scene
from ..scene.overrides import share_in
from ..scene.scene_tables import States, switched
from .airflow_choice import JET, AirflowPlan, AirMotion, choose_airflow, vibration_of_scene
from .collision_rates import RECIRCULATION, Encounters, ejection_speed, encounters, shifted
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
from .coupling import Limit, limits, with_driven_air
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
    bounds,
    check_switches,
    limit_of,
    moved_by_air,
)
from .uniform_fall import Deflection, FallTimes, UniformFall, deflection
from .unknowns import orders

# -- The scales of a flight -------------------------------------------------------------------------------------------
SIZES = (0.05, 0.5, 0.95)  # mass quantiles of the granules that the bounds are taken over: 90 % lie between
NEARLY = 1.001  # of the air speed: terminal velocity of a granule that hangs in upward air for long; chosen


def flights(
    scene: Scene,
    name: str,
    law: str,
    scale: float,
    met: Encounters,
    *,
    straight: bool,
    turbulent: bool,
    shedding: bool = False,
) -> list[FlightScales]:
    """The scales of a fraction's flight in the scene's air, for a small, a median and a large granule.

    ``law`` of drag times ``scale``; ``met``: which others it meets; ``straight``: it meets the body nearly as if there
    were no air; ``shedding``: the airflow is resolved in time. One-dimensional falls through uniform air with the
    fraction's drag: from the feed to the body, and from rest at the body (an impact may take all of its speed) to the
    channel's end.
    """
    air, fraction = scene.airstream, scene.fraction[name]
    density = fraction.properties.density
    kept = bool(scene.body) and set(scene.all_kept) == scene.body.keys()
    upward, aside = air.rises, 0.0 if kept else abs(float(scene.entry @ scene.plumb.across))
    aside += 2.0 * math.sin(scene.feed.scatter) * scene.feed.fall_speed
    scales = []
    for diameter, factor in _granules(scene, fraction, law, scale):
        fall = UniformFall.by_factor(scene, fraction, law, factor, diameter)
        times = fall.times()
        arrival = max(times.arrival, scene.feed.fall_speed)
        along, settling = fall.granule.along, abs(fall.granule.settling)
        slip = max(abs(complex(arrival - along, fall.granule.across)), air.speed, abs(times.landing) - abs(along))
        stays = 0.0
        if scene.body and upward and settling < air.speed:  # it falls into the wake, and leaves with the air
            stays = REACH * scene.width / (RECIRCULATION * air.speed) / (1.0 + times.tau * air.speed / scene.width)
        thrown = ejection_speed(scene, fraction, arrival) * arrival if scene.body and not kept else aside
        scales.append(FlightScales(
            diameter=diameter, density=density, tau=times.tau, calm=not scene.body or air.still,
            arrival=arrival, thrown=thrown, slip=slip, settling=settling,
            landing=times.landing, whole=times.whole + stays, time=times.time + stays, near=times.near + stays,
            beside=straight and not upward,
            sideways_bins=_sideways_bins(scene),
            air_density=air.density, viscosity=air.viscosity, air_speed=air.speed, width=scene.width,
            intensity=air.turbulence, turbulent=turbulent, shaking=float(np.linalg.norm(scene.shaking)),
            omega=scene.motion[1], meetings=met.heavier, knock=met.knock, shedding=shedding, kept=kept,
            given=_given_by_drag(scene, times, density, slip),
            temperature=air.temperature, mean_free_path=air.mean_free_path, gravity=scene.gravity,
        ))  # fmt: skip
    return scales


def _sideways_bins(scene: Scene) -> bool:
    """Whether shifts along the air count in full: a bin is on a wall or in the air, or granules come to the walls."""
    return any(place.stands for place in scene.bin.values()) or not (scene.body and scene.plumb.upright)


def _given_by_drag(scene: Scene, times: FallTimes, density: float, slip: float) -> float:
    """Velocity (m/s) that drag gives a granule on its way to the body; without one no more than it would at the largest
    ``slip`` all the way.
    """
    if not scene.body:
        return float(-slip * np.expm1(-times.whole / times.tau))
    weight = scene.gravity * (1.0 - scene.airstream.density / density)
    return float(times.arrival - scene.release[1] - weight * (times.whole - times.time))


def _granules(scene: Scene, fraction: Fraction, law: str, scale: float) -> Iterator[tuple[float, float]]:
    """Diameters (m) and factors on the drag law, slip correction included, of small, median and large granules; where
    measured terminal velocities spread, of slow and fast ones of each size, and of those that hang in the air longest.
    """
    density, speeds = fraction.properties.density, fraction.settling(np.array(SIZES))
    if speeds is not None and not scene.body and scene.air is not None:
        speeds = np.append(speeds, np.clip(NEARLY * scene.air.speed, speeds[0], speeds[-1]))
    for diameter in dict.fromkeys(fraction.diameters(np.array(SIZES)).tolist()):
        slip = float(slip_correction(diameter, scene.airstream.mean_free_path))
        if speeds is None:
            yield diameter, scale / slip
            continue
        conditions = *STANDARD_AIR, GRAVITY, law, fraction.roundness
        for factor in drag_factor_for_terminal_velocity(diameter, density, speeds, *conditions):
            yield diameter, float(factor * slip_correction(diameter)) / slip


# -- A fraction before its forces are chosen ---------------------------------------------------------------------------
JET_RMS = math.sqrt(2.0 / 3.0 * ENERGY)  # rms of the velocity in a jet, over that on its axis
RARE = 1e-3  # share of the mass below and above which a measured terminal velocity may be anything
CALIBRATED = (0.5, 100.0)  # factor on a sphere's drag that is believed: irregular granules have more, none much less


@dataclass(frozen=True)
class Approach:
    """What is known of a fraction before its forces are chosen; without ``scales`` and ``turned`` in a vacuum."""

    law: str
    scale: float
    met: Encounters
    turned: Deflection | None = None
    scales: Sequence[FlightScales] = ()

    @property
    def driven(self) -> Approach:
        """This approach in the jet of air that the granules drive, as fast and as turbulent as it may be."""
        return replace(self, scales=[replace(way, air_speed=way.driven, intensity=JET_RMS) for way in self.scales])


def approaches(scene: Scene, airflow: AirflowPlan) -> dict[str, Approach]:
    """Approach of every fraction: its drag, which others it meets, and the scales of its flight."""
    laws = {name: (scene.fraction[name].drag_law, _drag_scale(scene, name)) for name in scene.fraction}
    met = encounters(scene, laws)
    if scene.air is None:
        return {name: Approach(*laws[name], met[name]) for name in laws}
    undriven = {}
    for name, law in laws.items():
        turned = deflection(scene, name, *law)
        straight = turned is not None and turned.straight and not scene.obstacles
        scales = flights(
            scene,
            name,
            *law,
            met[name],
            straight=straight,
            turbulent=airflow.turbulent,
            shedding=airflow.stepping == "time-resolved",
        )
        undriven[name] = Approach(*law, met[name], turned, scales)
    driven = with_driven_air(scene, {name: approach.scales for name, approach in undriven.items()})
    return {name: replace(approach, scales=driven[name]) for name, approach in undriven.items()}


def _drag_scale(scene: Scene, name: str) -> float:
    """The factor on the fraction's drag law; every terminal velocity that was measured must be one that can be."""
    fraction = scene.fraction[name]
    if fraction.measured_settling is None:
        return 1.0
    granule, law = fraction.properties, (fraction.drag_law, fraction.roundness)
    scale = _calibration(name, law, *fraction.measured_settling)
    ends = fraction.settling(np.array([RARE, 1.0 - RARE]))
    if ends is not None:
        for speed in ends.tolist():
            _calibration(name, law, granule.diameter, granule.density, speed)
    return scale


def _calibration(name: str, law: tuple[str, float], diameter: float, density: float, speed: float) -> float:
    """The factor on a drag law and its sphericity that gives a measured terminal velocity. Raises SceneError where it
    would be too much of a sphere's drag, or too little.
    """
    if density <= STANDARD_AIR[0]:
        raise SceneError(f"fraction.{name}.density = {density:g} kg/m3: lighter than air, it has no terminal velocity")
    measured = diameter, density, speed, *STANDARD_AIR, GRAVITY
    slip = float(slip_correction(diameter))  # the granule that was measured slipped as well
    scale = slip * float(drag_factor_for_terminal_velocity(*measured))
    if not CALIBRATED[0] <= scale <= CALIBRATED[1]:
        sphere = float(terminal_velocity(diameter, density, *STANDARD_AIR, GRAVITY))
        raise SceneError(
            f"fraction.{name}.terminal_velocity = {speed:g} m/s needs {scale:.2g} times a sphere's drag: a sphere of "
            f"{diameter:.3g} m and {density:g} kg/m3 falls at {sphere:.3g} m/s; check size, density and velocity"
        )
    return slip * float(drag_factor_for_terminal_velocity(*measured, *law))


class BodyArrival(NamedTuple):
    """The median granule of a fraction at the top of the body."""

    settling: float  # m/s, terminal velocity; nan in a vacuum
    tau: float  # s, relaxation time at the slip it arrives with
    stokes: float  # tau times the arrival speed over the body's half width; inf without a body
    speed: float  # m/s, downward


def arrival_at_body(scene: Scene, name: str, law: str, scale: float) -> BodyArrival:
    """Arrival of a fraction, with its drag ``law`` and the factor on it; in a vacuum it comes as fast as it was fed."""
    if scene.air is None:
        return BodyArrival(math.nan, math.inf, math.inf, scene.feed.fall_speed)
    fraction = scene.fraction[name]
    fall = UniformFall.of(scene, fraction, law, scale, fraction.properties.diameter)
    speed = fall.arrival().speed
    tau = float(fall.granule.tau(np.array([abs(speed - fall.granule.along)]))[0])
    stokes = tau * max(speed, 0.0) / (0.5 * scene.width) if scene.body else math.inf
    return BodyArrival(fall.granule.settling, tau, stokes, speed)


# -- Whether the air feels the granules --------------------------------------------------------------------------------
# Of airflows that a steady one which OpenFOAM solves is part of
KINDS = ("steady", "time-resolved", "best-estimate", "three-dimensional")


def feels_granules(
    scene: Scene,
    airflow: AirflowPlan,
    approaches: Mapping[str, Approach],
    target: float,
    switches: Mapping[str, bool],
) -> bool:
    """Whether the airflow is computed with the granules' force on it: where that could move one of the fractions that
    come by ``approaches`` farther than the accuracy ``target`` (of a share) allows, or as it is switched by hand.
    Raises SceneError where it is asked for and cannot be had.
    """
    switched = switches.get(LOADING)
    if switched is False:
        return False
    if obstacle := _obstacle(scene, airflow):
        if switched:
            raise SceneError(f"--force {LOADING}=on: {obstacle}")
        return False
    limit, scales = limit_of(scene, target), (flight for approach in approaches.values() for flight in approach.scales)
    return bool(switched) or any(bounds[LOADING].shift(flight) > limit for flight in scales)


def _obstacle(scene: Scene, airflow: AirflowPlan) -> str:
    """Why the granules' force cannot be given to the air; empty where it can."""
    if airflow.kind == "analytic" and scene.airstream.still:
        if scene.body:
            return "air at rest, and what granules drive round a body in it is not computed"
        if not (scene.plumb.upright and scene.feed.falls):
            return "granules that do not fall straight along the channel drive no jet that is known"
    elif airflow.kind not in KINDS:
        return f"rung {airflow.rung} has no steady airflow that OpenFOAM could solve on; use draft or standard"
    if not scene.feed.rate:
        return "the scene has no feed.rate, which says how dense the curtain is"
    return ""


# -- The plan ----------------------------------------------------------------------------------------------------------
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
    check_switches(flown, switches, airflow.turbulence)
    known = approaches(flown, airflow)
    obstacle = FIRST_LOOK if chain else why_no_collisions(flown) or too_many_to_collide(flown, _laws(known))
    collisions = _collisions(flown, known, switches, target, obstacle, paired=airflow.mirrored)
    airflow, known = _under_load(flown, airflow, known, target, switches)
    together = whole_terms(airflow, collisions)
    gate = TermGate(flown, switches, target, airflow.turbulence, together, obstacle, motion.moved)
    fractions, chosen = {}, {}
    for name, approach in known.items():
        fractions[name], chosen[name] = _decide(gate, name, approach)
    validity = _validity(flown, fractions, known, gate.limit)
    without_air, warned = _without_air(given, fractions) if chain else ([], [])
    strained = warning_lines(flown, airflow, fractions, validity, target, together)
    slab = () if collisions is None else tuple(collision_lines(collisions))
    stages = expected_stages(flown, airflow, fractions, collisions, sources)
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
        collisions=collisions,
    )


def _airflow(scene: Scene, rung: str, target: float, switches: Mapping[str, bool]) -> tuple[AirflowPlan, AirMotion]:
    """The airflow of a ``rung`` asked for, and what the vibration asks of it, with the mesh's motion as switched."""
    airflow = choose_airflow(scene, rung, target)
    if airflow.stepping != "time-resolved":
        return airflow, AirMotion()
    motion = vibration_of_scene(scene, airflow.accuracy, switched=switches.get(VIBRATION))
    if airflow.span and motion.used:
        raise SceneError(f"rung = {rung!r} holds the body still in the air, and here {motion.why}; choose standard")
    return replace(airflow, moving=motion.used), motion


def _under_load(
    scene: Scene, airflow: AirflowPlan, known: dict[str, Approach], target: float, switches: Mapping[str, bool]
) -> tuple[AirflowPlan, dict[str, Approach]]:
    """The airflow that the granules' force moves, where that matters, and how they come through it."""
    airflow = airflow.feeling(scene, loaded=feels_granules(scene, airflow, known, target, switches))
    driven = airflow.turbulence == JET
    return airflow, {name: approach.driven if driven else approach for name, approach in known.items()}


def _collisions(
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
    switched = switches.get(COLLISIONS)
    if switched is None:
        limit = limit_of(scene, target)
        switched = not obstacle and any(shifted(scene, way.met, way.scales) > limit for way in approaches.values())
    return plan_collisions(scene, _laws(approaches), target, paired=paired) if switched else None


def _laws(approaches: Mapping[str, Approach]) -> dict[str, tuple[str, float]]:
    """Drag law of each fraction and the factor on it."""
    return {name: (approach.law, approach.scale) for name, approach in approaches.items()}


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
    arrivals = {name: plan.arrival_speed for name, plan in fractions.items()}
    scales = {name: approach.scales for name, approach in approaches.items() if approach.scales}
    met = {name: approach.met for name, approach in approaches.items()}
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
    """Sticking that is left out of each fraction whose granules meet far heavier ones at the scene's feed rate: how
    much of it at most stays on those, the share that meets any, as meetings by chance are (Poisson).
    """
    if not scene.feed.rate:
        return
    mass = {name: float(np.median(granule_masses(scene, name))) for name in approaches}
    for name, approach in approaches.items():
        heavy = [partner for partner in approach.met.by if mass[name] < LIGHT * mass[partner]]
        met = sum(approach.met.by[partner] for partner in heavy)
        if met > 0.0:
            why = f"it meets {met:.2g} granules of {' or '.join(heavy)} in the mean; if it stayed on the first that it "
            why += f"met, {-math.expm1(-met):.0%} of it at most would land with these: no granule stays on another"
            yield LeftOut(STICKING, math.inf, why, name)


def _without_air(scene: Scene, fractions: Mapping[str, FractionPlan]) -> tuple[list[LeftOut], list[Notice]]:
    """What the air could move each fraction by of a scene with air that is flown without, and where that is worth a
    warning.
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
