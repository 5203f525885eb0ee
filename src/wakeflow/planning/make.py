"""The plan: what a scene needs, what is left out and by which bound, and what it will cost. Starts nothing heavy.

``terms`` chooses the forces of each fraction: a bound on each term's landing shift against the accuracy asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..core.errors import SceneError
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import (
    drag_factor_for_terminal_velocity,
    drag_laws,
    relaxation_time,
    slip_correction,
    terminal_velocity,
)
from ..laws.forces import FlightScales, forces
from ..scene import Scene
from .air_loading import feels_granules
from .airflow import AirflowPlan, choose_airflow
from .bounds import LOADING, VIBRATION, moved_by_air
from .cost import estimate_cost
from .coupling import Limit, limits
from .flight_scales import flights
from .lock_in import AirMotion, vibration_of_scene
from .messages import missing_lines, used_lines, warning_lines
from .plan import FractionPlan, Plan
from .scaled import Scaled, scaled_flights
from .terms import Gate, LeftOut, check_switches, limit_of, open_gate
from .uniform_fall import arrival_speed

__all__ = ["AIR", "TURNING", "Planner", "make_plan"]

AIR = "air"  # left out as a whole: in a vacuum, and at rung none
TURNING = "turning-before-the-impact"  # what injection leaves out: how the air before the body moves granules
MATTERS = 0.1  # body widths: a warning where the air that is left out could move a fraction by more; chosen
RARE = 1e-3  # share of the mass below and above which a measured terminal velocity may be anything
CALIBRATED = (0.5, 100.0)  # factor on a sphere's drag that is believed: irregular granules have more, none much less
LARGEST_ERROR = 0.5  # of a share: an accuracy beyond would say nothing


def make_plan(
    scene: Scene,
    *,
    rung: str | None = None,
    force: Mapping[str, bool] | None = None,
    target_error: float | None = None,
) -> Plan:
    """Decide what ``scene`` needs. ``rung`` and ``target_error`` (a share) override the scene's; ``force`` switches
    terms on or off, {"lift": True} for all fractions, {"chaff.lift": True} for one.

    Raises SceneError when a rung or term is asked for that cannot be had, or when a term that cannot be computed
    could move a fraction by more than the accuracy asked for.
    """
    given = scene.fed()
    target = given.numerics.target_error if target_error is None else target_error
    if not 0.0 < target <= LARGEST_ERROR:
        raise SceneError(f"target-error = {target:g}: above 0 and at most 0.5 (0.01: one percent of a fraction)")
    switches = dict(force or {})
    airflow, motion = _airflow(given, rung or given.numerics.rung, target, switches.get(VIBRATION))
    flown = airflow.flown(given)
    check_switches(flown, switches, airflow.turbulence)
    scaled = scaled_flights(flown, airflow, {name: _drag_scale(flown, name) for name in flown.fraction})
    limit, switched = limit_of(flown, target), switches.get(LOADING)
    airflow = replace(airflow, loaded=feels_granules(flown, airflow, scaled.flights, limit, switched))
    decided = {name: _decide(flown, name, airflow, scaled, switches, target) for name in flown.fraction}
    fractions = {name: one.plan for name, one in decided.items()}
    gates, chain = {name: one.gate for name, one in decided.items() if one.gate is not None}, flown is not given
    validity = _validity(flown, decided, target)
    without_air = _without_air(given, fractions) if chain else _WithoutAir()
    strained = warning_lines(flown, airflow, fractions, validity, target)
    return Plan(
        airflow=airflow,
        target_error=target,
        force=switches,
        fractions=fractions,
        used=tuple(used_lines(flown, airflow, fractions, validity, motion, chain=chain)),
        left_out=tuple(_left_out(flown, decided, without_air, chain=chain)),
        estimate=estimate_cost(flown, airflow, fractions),
        warnings=(*missing_lines(gates, flown.unit), *without_air.warnings, *strained),
        flown_by="chain" if chain else "tracker",
        validity=validity,
        unit=flown.unit,
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
    _made: dict[str | None, Plan] = field(default_factory=dict, init=False, repr=False, compare=False)

    def plan(self, rung: str | None = None) -> Plan:
        """The plan of a ``rung``; None: the scene's own. Raises SceneError as :func:`make_plan` does."""
        if rung not in self._made:
            made = make_plan(self.scene, rung=rung, force=self.force, target_error=self.target_error)
            self._made[rung] = made
        return self._made[rung]

    def at(self, scene: Scene) -> Planner:
        """The same options for another scene, as for one whose feed rate is known by now."""
        return self if scene == self.scene else Planner(scene, self.force, self.target_error)


class _ChosenAirflow(NamedTuple):
    """The airflow, and what the vibration asks of it."""

    airflow: AirflowPlan
    motion: AirMotion | None


def _airflow(scene: Scene, rung: str, target: float, vibrates: bool | None) -> _ChosenAirflow:
    """The airflow of a ``rung`` asked for; ``vibrates``: the mesh's motion is switched by hand."""
    airflow = choose_airflow(scene, rung, target)
    if airflow.stepping != "time-resolved":
        return _ChosenAirflow(airflow, None)
    motion = vibration_of_scene(scene, airflow.accuracy, asked=vibrates)
    if airflow.span is not None and motion is not None and motion.used:
        raise SceneError(f"rung = {rung!r} holds the body still in the air, and here {motion.why}; choose standard")
    return _ChosenAirflow(replace(airflow, moving=motion is not None and motion.used), motion)


class _Decided(NamedTuple):
    """What was decided for a fraction; in a vacuum, where there is no choice of forces, without ``gate`` and
    ``scales``.
    """

    plan: FractionPlan
    gate: Gate | None = None
    scales: Sequence[FlightScales] = ()


def _decide(
    scene: Scene, name: str, airflow: AirflowPlan, scaled: Scaled, switches: Mapping[str, bool], target: float
) -> _Decided:
    """How fraction ``name`` is computed, and with which forces. Raises SceneError as :func:`make_plan` does."""
    law, scale = scene.fraction[name].drag_law, scaled.drag[name]
    if scene.air is None:
        weight = tuple(force for force in forces if forces[force].always and forces[force].needs == "nothing")
        mode = _mode(scene, clear=bool(scene.body))
        return _Decided(
            FractionPlan(mode, law, scale, None, math.inf, math.inf, scene.feed.fall_speed, forces=weight)
        )  # fmt: skip
    turned, scales = scaled.turned[name], scaled.flights[name]
    gate = open_gate(scene, name, scales, switches, target, airflow.turbulence, effects=airflow.effects)
    small = not airflow.loaded and turned is not None and turned.missed <= target and turned.shift <= gate.limit
    arrival = _arrival(scene, name, law, scale)
    plan = FractionPlan(
        mode=_mode(scene, clear=small),
        drag=law,
        drag_scale=scale,
        terminal_velocity=arrival.settling,
        relaxation_time=arrival.tau,
        stokes=arrival.stokes,
        arrival_speed=arrival.speed,
        impaction=turned,
        forces=gate.forces,
        bounds=gate.bounds,
        limit=gate.limit,
    )
    return _Decided(plan, gate, scales)


def _validity(scene: Scene, decided: Mapping[str, _Decided], target: float) -> tuple[Limit, ...]:
    """What the feed rate strains, by the speeds and scales of the fractions."""
    arrivals = {name: one.plan.arrival_speed for name, one in decided.items()}
    scales = {name: one.scales for name, one in decided.items() if one.scales}
    return tuple(limits(scene, arrivals, scales, limit_of(scene, target)))


def _left_out(
    scene: Scene, decided: Mapping[str, _Decided], without_air: _WithoutAir, *, chain: bool
) -> Iterator[LeftOut]:
    """What is left out of each fraction's flight, and of the whole run."""
    for name, (plan, gate, _) in decided.items():
        if gate is None:
            continue
        yield from gate.left_out
        if plan.mode == "injected" and plan.impaction is not None:
            why = "injected granules fall straight: how the air before the body moves where 95 % of them land"
            yield LeftOut(TURNING, plan.impaction.shift, why, name)
    yield from without_air.left_out
    if scene.air is None and not chain:
        yield LeftOut(AIR, 0.0, "no [air] table: neither mesh nor airflow is computed")


@dataclass(frozen=True)
class _WithoutAir:
    """What leaving the air out of a scene that has some does to each fraction, and where that is worth a warning."""

    left_out: tuple[LeftOut, ...] = ()
    warnings: tuple[str, ...] = ()


def _without_air(scene: Scene, fractions: Mapping[str, FractionPlan]) -> _WithoutAir:
    """For each fraction of a scene with air that is flown without: what the air could move it by."""
    assert scene.air is not None
    air, widest = scene.air, scene.channel.width / scene.width
    left_out, warnings = [], []
    for name, fraction in fractions.items():
        scales = flights(scene, name, fraction.drag, fraction.drag_scale, straight=False, turbulent=True)
        middle = scales[len(scales) // 2]
        shift = min(widest, max(moved_by_air(flight) for flight in scales))
        carried = air.direction == "up" and middle.settling < air.speed
        stokes = middle.tau * middle.arrival / (0.5 * scene.width)
        fate = "the air would carry it up" if carried else f"Stokes number of its fall {stokes:.2g}"
        why = f"drag on the way at the largest slip, {middle.slip:.2g} m/s; {fate}"
        left_out.append(LeftOut(AIR, shift, why, name))
        if carried or shift > MATTERS:
            warnings.append(
                f"{name}: rung none leaves the air out, which could move it by {shift:.2g} {scene.unit} (terminal "
                f"velocity {middle.settling:.2g} m/s, air {air.speed:.2g} m/s {air.direction}); {fate}"
            )
    return _WithoutAir(tuple(left_out), tuple(warnings))


# -- one fraction ------------------------------------------------------------------------------------------------------


def _mode(scene: Scene, *, clear: bool) -> str:
    """Whether granules are injected at the first body's face or released above it; ``clear``: no air turns them."""
    wanted = scene.feed.mode if scene.feed.start == "falling" else "resolved"
    if wanted != "auto":
        return wanted
    return "injected" if clear and not scene.obstacles else "resolved"


def _drag_scale(scene: Scene, name: str) -> float:
    """The factor on the fraction's drag law; every terminal velocity that was measured must be one that can be."""
    fraction = scene.fraction[name]
    if fraction.measured_settling is None:
        return 1.0
    granule, law = fraction.properties, fraction.drag_law
    scale = _calibration(name, law, *fraction.measured_settling)
    ends = fraction.settling(np.array([RARE, 1.0 - RARE]))
    if ends is not None:
        for speed in ends.tolist():
            _calibration(name, law, granule.diameter, granule.density, speed)
    return scale


def _calibration(name: str, law: str, diameter: float, density: float, speed: float) -> float:
    """The factor on the drag law that gives a measured terminal velocity. Raises SceneError where none can be."""
    if density <= STANDARD_AIR[0]:
        raise SceneError(f"fraction.{name}.density = {density:g} kg/m3: lighter than air, it has no terminal velocity")
    scale = float(drag_factor_for_terminal_velocity(diameter, density, speed, *STANDARD_AIR, GRAVITY, law))
    scale *= float(slip_correction(diameter))  # the granule that was measured slipped as well
    if not CALIBRATED[0] <= scale <= CALIBRATED[1]:
        sphere = float(terminal_velocity(diameter, density, *STANDARD_AIR, GRAVITY, law))
        raise SceneError(
            f"fraction.{name}.terminal_velocity = {speed:g} m/s needs {scale:.2g} times a sphere's drag: a sphere of "
            f"{diameter:.3g} m and {density:g} kg/m3 falls at {sphere:.3g} m/s; check size, density and velocity"
        )
    return scale


class _Arrival(NamedTuple):
    """The median granule of a fraction at the top of the body, in air."""

    settling: float  # m/s, terminal velocity
    tau: float  # s, relaxation time at the slip it arrives with
    stokes: float  # tau times the arrival speed over the body's half width; inf without a body
    speed: float  # m/s, downward


def _arrival(scene: Scene, name: str, law: str, scale: float) -> _Arrival:
    assert scene.air is not None
    fraction, air = scene.fraction[name], scene.air
    granule, phi = fraction.properties, fraction.sphericity or 1.0
    slips = scale / float(slip_correction(granule.diameter))
    settling = terminal_velocity(
        granule.diameter, granule.density, air.density, air.viscosity, GRAVITY, law, phi, drag_scale=slips
    )
    along = air.speed if air.direction == "down" else -air.speed
    speed = arrival_speed(scene, name, law, scale)
    reynolds = air.density * abs(speed - along) * granule.diameter / air.viscosity
    factor = slips * float(drag_laws[law].factor(np.array([reynolds]), phi)[0])
    tau = float(relaxation_time(granule.diameter, granule.density, air.viscosity)) / factor
    stokes = tau * max(speed, 0.0) / (0.5 * scene.width) if scene.body else math.inf
    return _Arrival(float(settling), tau, stokes, speed)
