"""The plan: what a scene needs, what is left out and by which bound, and what it will cost. Starts nothing heavy.

``gate`` chooses the forces of each fraction: a bound on each term's landing shift against the accuracy asked for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..core.errors import SceneError
from ..funnel import estimated_seconds, summary
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import (
    drag_factor_for_terminal_velocity,
    drag_laws,
    relaxation_time,
    slip_correction,
    terminal_velocity,
)
from ..scene import Scene
from .airflow import choose_airflow, typical_cells, typical_seconds
from .bounds import Flight, moved_by_air
from .coupling import limits
from .flight_scales import arrival_speed, flights
from .flights_again import times_again
from .impaction import deflection
from .lock_in import vibration_of_scene
from .messages import missing_lines, used_lines, warning_lines
from .plan import AT_ONCE, COMPARED, REPLICATES, FractionPlan, Plan, replicate_size
from .terms import VIBRATION, Gate, LeftOut, check_switches, limit_of, open_gate

__all__ = ["TURNING", "make_plan"]

TURNING = "turning-before-the-impact"  # the term that injection leaves out
MATTERS = 0.1  # body widths that the air moves a fraction by when it is left out: beyond, a warning
RARE = 1e-3  # mass below and above which a measured terminal velocity may be anything


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
    scene = scene.fed()
    target = scene.numerics.target_error if target_error is None else target_error
    if not 0.0 < target <= 0.5:
        raise SceneError(f"target-error = {target:g}: above 0 and at most 0.5 (0.01: one percent of a fraction)")
    airflow, switches = choose_airflow(scene, rung or scene.numerics.rung, target), dict(force or {})
    motion = None
    if airflow.stepping == "time-resolved":
        motion = vibration_of_scene(scene, airflow.accuracy, asked=switches.get(VIBRATION))
        airflow = replace(airflow, moving=motion is not None and motion.used)
    asked, scene = scene, scene.flown(airflow.rung)
    check_switches(scene, switches, airflow.turbulence)
    flown_by = "tracker" if asked is scene else "chain"
    plan = Plan(
        airflow, target, switches, fractions={}, used=[], left_out=[], estimate={}, flown_by=flown_by, unit=scene.unit
    )
    found: dict[str, list[Flight]] = {}
    gates = {name: gate for name in scene.fraction if (gate := _add_fraction(scene, plan, name, found)) is not None}
    arrivals = {name: how.arrival_speed for name, how in plan.fractions.items()}
    plan.validity.extend(limits(scene, arrivals, found, limit_of(scene, target)))
    plan.warnings.extend(missing_lines(gates, scene.unit))
    plan.estimate.update(_estimate(scene, plan))
    if asked is not scene:
        _leave_air_out(asked, plan)
    elif scene.air is None:
        plan.left_out.append(LeftOut("air", 0.0, "no [air] table: neither mesh nor airflow is computed"))
    plan.used.extend(used_lines(scene, plan, motion))
    if scene.funnel is not None:
        plan.estimate["seconds"] += estimated_seconds(scene.funnel)
        plan.used.append(summary(scene.funnel))
    plan.warnings.extend(warning_lines(scene, plan))
    return plan


def _add_fraction(scene: Scene, plan: Plan, name: str, scales: dict[str, list[Flight]]) -> Gate | None:
    """Decide how fraction ``name`` is computed, and with which forces; None in a vacuum, where there is no choice. The
    scales of its flight are added to ``scales``.
    """
    how = _fraction_plan(scene, name, plan.target_error)
    if scene.air is None:
        plan.fractions[name] = replace(how, forces=("gravity",))
        return None
    straight = how.impaction is not None and how.impaction.straight and not scene.obstacles
    found = flights(
        scene, name, how.drag, how.drag_scale, straight=straight,
        turbulent=plan.airflow.turbulence in ("kOmegaSST", "given"),
    )  # fmt: skip
    scales[name] = found
    gate = open_gate(
        scene, name, found, plan.force, plan.target_error, plan.airflow.turbulence, moving=plan.airflow.moving
    )
    plan.fractions[name] = replace(how, forces=gate.forces, bounds=gate.bounds, limit=gate.limit)
    plan.left_out.extend(gate.left_out)
    if how.mode == "injected" and how.impaction is not None:
        why = "injected granules fall straight: how the air before the body moves where 95 % of them land"
        plan.left_out.append(LeftOut(TURNING, how.impaction.shift, why, name))
    return gate


def _leave_air_out(scene: Scene, plan: Plan) -> None:
    """For each fraction of a scene with air that is flown without: what the air could move it by, and a warning."""
    assert scene.air is not None
    air, widest = scene.air, scene.channel.width / scene.width
    for name in scene.fraction:
        how = plan.fractions[name]
        found = flights(scene, name, how.drag, how.drag_scale, straight=False, turbulent=True)
        middle = found[len(found) // 2]
        shift = min(widest, max(moved_by_air(flight) for flight in found))
        carried = air.direction == "up" and middle.settling < air.speed
        stokes = middle.tau * middle.arrival / (0.5 * scene.width)
        fate = "the air would carry it up" if carried else f"Stokes number of its fall {stokes:.2g}"
        why = f"drag on the way at the largest slip, {middle.slip:.2g} m/s; {fate}"
        plan.left_out.append(LeftOut("air", shift, why, name))
        if carried or shift > MATTERS:
            plan.warnings.append(
                f"{name}: rung none leaves the air out, which could move it by {shift:.2g} {scene.unit} (terminal "
                f"velocity {middle.settling:.2g} m/s, air {air.speed:.2g} m/s {air.direction}); {fate}"
            )


def _calibration(name: str, law: str, diameter: float, density: float, speed: float) -> float:
    """The factor on the drag law that gives a measured terminal velocity. Raises SceneError where none can be."""
    if density <= STANDARD_AIR[0]:
        raise SceneError(f"fraction.{name}.density = {density:g} kg/m3: lighter than air, it has no terminal velocity")
    scale = float(drag_factor_for_terminal_velocity(diameter, density, speed, *STANDARD_AIR, GRAVITY, law))
    scale *= float(slip_correction(diameter))  # the granule that was measured slipped as well
    if not 0.5 <= scale <= 100.0:
        sphere = float(terminal_velocity(diameter, density, *STANDARD_AIR, GRAVITY, law))
        raise SceneError(
            f"fraction.{name}.terminal_velocity = {speed:g} m/s needs {scale:.2g} times a sphere's drag: a sphere of "
            f"{diameter:.3g} m and {density:g} kg/m3 falls at {sphere:.3g} m/s; check size, density and velocity"
        )
    return scale


def _fraction_plan(scene: Scene, name: str, target: float) -> FractionPlan:
    fraction = scene.fraction[name]
    granule, law = fraction.properties, fraction.drag_law
    entry, phi = drag_laws[law], fraction.sphericity or 1.0
    scale = 1.0
    if fraction.measured_settling is not None:
        scale = _calibration(name, law, *fraction.measured_settling)
        for speed in () if (spread := fraction.settling(np.array([RARE, 1.0 - RARE]))) is None else spread.tolist():
            _calibration(name, law, granule.diameter, granule.density, speed)
    wanted = scene.feed.mode if scene.feed.start == "falling" else "resolved"
    if scene.air is None:
        clear = "injected" if scene.body and not scene.obstacles else "resolved"
        mode = clear if wanted == "auto" else wanted
        return FractionPlan(mode, law, scale, None, math.inf, math.inf, scene.feed.fall_speed)
    air, own = scene.air, scale / float(slip_correction(granule.diameter))
    settling = float(
        terminal_velocity(
            granule.diameter, granule.density, air.density, air.viscosity, GRAVITY, law, phi, drag_scale=own
        )
    )
    along = air.speed if air.direction == "down" else -air.speed
    fall = arrival_speed(scene, name, law, scale)
    reynolds = air.density * abs(fall - along) * granule.diameter / air.viscosity
    factor = own * float(entry.factor(np.array([reynolds]), phi)[0])
    tau = float(relaxation_time(granule.diameter, granule.density, air.viscosity)) / factor
    stokes = tau * max(fall, 0.0) / (0.5 * scene.width) if scene.body else math.inf
    turned = deflection(scene, name, law, scale)
    small = turned is not None and turned.missed <= target and turned.shift <= limit_of(scene, target)
    mode = wanted if wanted != "auto" else ("injected" if small and not scene.obstacles else "resolved")
    return FractionPlan(mode, law, scale, settling, tau, stokes, fall, turned)


def _estimate(scene: Scene, plan: Plan) -> dict[str, float]:
    """Seconds, memory and disk, from runs of the shipped scenes on two cores of 2020s hardware; good to a factor 3."""
    count = REPLICATES * replicate_size(scene.feed.count)
    at_once = max(min(count, AT_ONCE), count // REPLICATES)
    noisy = sum("dispersion" in how.forces for how in plan.fractions.values())
    again = 1 + times_again(plan.airflow) * COMPARED / REPLICATES
    tracks = 150e-6 * count * (len(plan.fractions) + 2.0 * noisy) * again
    cells = typical_cells(plan.airflow, len(scene.body))
    snapshots = 150.0 if plan.airflow.stepping == "time-resolved" else 2.0
    return {
        "seconds": 5.0 + typical_seconds(plan.airflow) + tracks,
        "memory": 4e8 + 1500.0 * at_once + 120.0 * count,
        "disk": 1e6 + cells * (1500.0 + 80.0 * snapshots) + 80.0 * count * len(plan.fractions),
    }
