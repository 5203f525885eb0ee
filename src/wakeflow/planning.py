"""The plan: what a scene needs, what is left out and by which bound, and what it will cost. Starts nothing heavy.

``gate`` chooses the forces of each fraction: a bound on each term's landing shift against the accuracy asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from .bounds import Flight, moved_by_air
from .deflection import Deflection, deflection
from .errors import SceneError
from .funnel import estimated_seconds, summary
from .gate import VIBRATION, Gate, LeftOut, check_switches, limit_of, open_gate
from .laws.drag import (
    drag_factor_for_terminal_velocity,
    drag_laws,
    relaxation_time,
    slip_correction,
    terminal_velocity,
)
from .loading import Limit, limits, strained
from .locking import AirMotion, vibration_of_scene
from .process import cores
from .resting import standing
from .rungs import SHEDDING_ABOVE, AirflowPlan, choose_airflow, ranks_for, typical_cells, typical_seconds
from .scales import arrival_speed, flights
from .scene import GRAVITY, STANDARD_AIR, Scene

__all__ = ["AT_ONCE", "COMPARED", "REPLICATES", "FractionPlan", "LeftOut", "Plan", "make_plan", "replicate_size"]

TURNING = "turning-before-the-impact"  # the term that injection leaves out
MATTERS = 0.1  # body widths that the air moves a fraction by when it is left out: beyond, a warning
REPLICATES = 16  # independent randomised samples a fraction: 15 degrees of freedom for the interval
LAMINAR_CHANNEL = (
    1300.0  # mean speed, plate distance; turbulence lasts above: Patel & Head 1969, J. Fluid Mech. 38, 181
)
AT_ONCE = 2**17  # granules that are fed and flown at a time, or one replicate where it has more
RARE = 1e-3  # mass below and above which a measured terminal velocity may be anything
COMPARED = 4  # of the replicates fly again in each comparison with another airflow, step or mesh


@dataclass(frozen=True)
class FractionPlan:
    """How one fraction is computed, and the scales that decide it (SI units, of the median size)."""

    mode: str  # injected | resolved
    drag: str  # name of the drag law
    drag_scale: float  # factor on the law that gives the measured terminal velocity; 1 without one. A granule's own
    # slip correction divides it
    terminal_velocity: float | None  # m/s in the scene's air, of the median; None in a vacuum
    relaxation_time: float  # s, at the speed relative to the air on arrival; inf in a vacuum
    stokes: float  # approach Stokes number: relaxation time x arrival speed / half width; inf without a body or air
    arrival_speed: float  # m/s at the top of the body, drag included; negative where the air carries it up
    impaction: Deflection | None = None  # what the air does before the body; None in a vacuum and in upward air
    forces: tuple[str, ...] = ()  # the terms it is flown with
    bounds: dict[str, float] = field(default_factory=dict)  # body widths each term could move it by
    limit: float | None = None  # body widths: what a term must be able to move to be used

    @property
    def tracked(self) -> dict[str, Any]:
        """What its tracks depend on: everything but the bounds that chose the forces."""
        table = {key: value for key, value in asdict(self).items() if key not in ("bounds", "limit", "impaction")}
        if self.mode == "injected" and self.impaction is not None:
            table["reach"] = self.impaction.diameters, self.impaction.reach
        return table


@dataclass(frozen=True)
class Plan:
    """What will be computed and what will not."""

    airflow: AirflowPlan
    target_error: float  # of a bin's share: what the bounds were compared with
    force: dict[str, bool]  # terms switched by hand
    fractions: dict[str, FractionPlan]
    used: list[str]
    left_out: list[LeftOut]
    estimate: dict[str, float]  # seconds, memory (bytes), disk (bytes)
    warnings: list[str] = field(default_factory=list)
    flown_by: str = "tracker"  # tracker | chain (rung none of a scene with air: impacts and parabolas in closed form)
    validity: list[Limit] = field(default_factory=list)  # what the feed rate strains, and from which rate on
    unit: str = "body widths"  # of lengths: of the channel where nothing stands

    @property
    def rung(self) -> str:
        """none | analytic | draft | standard | reference | given"""
        return self.airflow.rung

    def with_forces(self, forces: Sequence[str]) -> Plan:
        """The same plan with every fraction flown with ``forces``, whatever their bounds: for comparisons."""
        rows = {name: replace(how, forces=tuple(forces)) for name, how in self.fractions.items()}
        return replace(self, fractions=rows)

    def summary(self) -> dict[str, Any]:
        """The ``plan`` table of result.json and of ``wakeflow plan --json``."""
        table = asdict(self)
        table = {**table.pop("airflow"), **table}
        for row in [*table["fractions"].values(), *table["validity"]]:
            row.update({key: None for key, value in row.items() if isinstance(value, float) and math.isinf(value)})
        return table


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
    plan.warnings.extend(_missing(gates, scene.unit))
    plan.estimate.update(_estimate(scene, plan))
    if asked is not scene:
        _leave_air_out(asked, plan)
    elif scene.air is None:
        plan.left_out.append(LeftOut("air", 0.0, "no [air] table: neither mesh nor airflow is computed"))
    plan.used.extend(_used(scene, plan, motion))
    if scene.funnel is not None:
        plan.estimate["seconds"] += estimated_seconds(scene.funnel)
        plan.used.append(summary(scene.funnel))
    plan.warnings.extend(_warnings(scene, plan))
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


def _missing(gates: Mapping[str, Gate], unit: str) -> Iterator[str]:
    """A line for each term that could matter and is not computed, with what it could move."""
    terms = dict.fromkeys((term, why) for gate in gates.values() for term, why in gate.missing.items())
    for term, why in terms:
        moved = [f"{name} {gate.bounds[term]:.2g}" for name, gate in gates.items() if term in gate.missing]
        yield f"{term}, left out, could move {', '.join(moved)} {unit}: {why}"


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


def _used(scene: Scene, plan: Plan, motion: AirMotion | None) -> list[str]:
    lines = list(_airflow_lines(plan.airflow, len(scene.body)))
    if plan.flown_by == "chain":
        lines.append("no air: granules fly in parabolas from impact to impact (the chain); neither Gmsh nor OpenFOAM")
    if scene.air is not None and scene.channel.inlet and plan.airflow.rung != "given":
        brought = sum(inlet.velocity * inlet.width for inlet in scene.channel.inlet.values())
        share = brought / (scene.air.speed * scene.channel.width)
        lines.append(f"secondary streams: {', '.join(scene.channel.inlet)} add {share:.2g} of the main stream's air")
    for name, how in plan.fractions.items():
        resolved = "released above the body, impacts resolved" if scene.body else f"enters at y = {scene.level:.3g} m"
        impact = "injected by eq. (1)-(2)" if how.mode == "injected" else resolved
        stokes = "" if math.isinf(how.stokes) else f" (approach Stokes number {how.stokes:.2g}{_turned(how)})"
        drag = "" if scene.air is None else f"; drag {how.drag} x {how.drag_scale:.3g}"
        fall = f", arrives at {how.arrival_speed:.3g} m/s"
        lines.append(f"{name}: {impact}{stokes}{fall}{drag}{_spread(scene, name)}; forces {', '.join(how.forces)}")
    rows = ", ".join(f"{row.name} {row.value:.2g}" for row in plan.validity if row.limit is not None)
    lines.append(f"feed: {3600 * scene.feed.mass_flow:.3g} kg/h, profile {scene.feed.profile.distribution}; {rows}")
    if scene.vibration is not None:
        peak, often = float(np.linalg.norm(scene.shaking)), 1.0 / scene.vibration.period
        seen = "the mesh vibrates with the body" if plan.airflow.moving else "the air sees a body at rest"
        why = "" if motion is None else f" ({motion.why})"
        lines.append(
            f"vibration: {often:.4g} Hz, Gamma = {scene.vibration.strength:.3g}, peak speed {peak:.3g} m/s at the "
            f"impacts; {seen}{why}"
        )
    return lines


def _turned(how: FractionPlan) -> str:
    """What the air does to the fraction before the body."""
    turned = how.impaction
    if turned is None:
        return ", the slopes lie in the wake"
    return (
        f", impaction efficiency {turned.efficiency:.2g}: {turned.missed:.2g} carried round the body, the landing of "
        f"the rest moved by up to {turned.shift:.2g} body widths"
    )


def _spread(scene: Scene, name: str) -> str:
    """Between which terminal velocities nine in ten granules of a fraction lie, where a distribution was measured."""
    ends = scene.fraction[name].settling(np.array([0.05, 0.95]))
    return (
        ""
        if ends is None
        else f", of each granule's own terminal velocity, 90 % within {ends[0]:.3g} to {ends[1]:.3g} m/s"
    )


def _airflow_lines(airflow: AirflowPlan, bodies: int) -> Iterator[str]:
    """The airflow that is computed, why, and what is computed beside it."""
    if airflow.rung == "given":
        yield f"airflow: a solved OpenFOAM case of yours; neither mesh nor solver runs ({airflow.why})"
    if airflow.rung == "analytic":
        yield f"airflow: {airflow.why}"
    if airflow.stepping is None:
        return
    part = ", half of the channel mirrored" if airflow.half else ""
    if airflow.mirrored:
        part = "; half of the granules fly in its mirror image"
    yield f"airflow: rung {airflow.rung}, {airflow.stepping}, {airflow.turbulence}{part} ({airflow.why})"
    cells = typical_cells(airflow, bodies)
    yield f"about {cells:.0f} cells: {ranks_for(round(cells), cores())[1]}"
    if airflow.brackets:
        yield (
            f"beside it, for the error of the airflow's model: 1 in {REPLICATES // COMPARED} granules in the steady "
            "wake, the mean wake and with half of its fluctuation"
        )
    if len(airflow.scales) > 1:
        sizes = ", ".join(f"{scale:.2g}" for scale in airflow.scales)
        yield f"beside it, for the error of the mesh: grids with cell edges of {sizes} times the usual"


def replicate_size(count: int) -> int:
    """Granules in each of the REPLICATES when ``count`` are asked for: the next power of two, since Sobol sets are
    balanced for these.
    """
    return int(2 ** max(0, math.ceil(math.log2(count / REPLICATES))))


def _estimate(scene: Scene, plan: Plan) -> dict[str, float]:
    """Seconds, memory and disk, from runs of the shipped scenes on two cores of 2020s hardware; good to a factor 3."""
    count = REPLICATES * replicate_size(scene.feed.count)
    at_once = max(min(count, AT_ONCE), count // REPLICATES)
    noisy = sum("dispersion" in how.forces for how in plan.fractions.values())
    again = 1 + (3 * plan.airflow.brackets + len(plan.airflow.scales) - 1) * COMPARED / REPLICATES
    tracks = 150e-6 * count * (len(plan.fractions) + 2.0 * noisy) * again
    cells = typical_cells(plan.airflow, len(scene.body))
    snapshots = 150.0 if plan.airflow.stepping == "time-resolved" else 2.0
    return {
        "seconds": 5.0 + typical_seconds(plan.airflow) + tracks,
        "memory": 4e8 + 1500.0 * at_once + 120.0 * count,
        "disk": 1e6 + cells * (1500.0 + 80.0 * snapshots) + 80.0 * count * len(plan.fractions),
    }


def _warnings(scene: Scene, plan: Plan) -> list[str]:
    """Where the model's assumptions strain, with numbers."""
    lines = []
    for name, fraction in scene.fraction.items():
        size = float(fraction.diameters(np.array([0.95]))[0])
        if size > 0.1 * scene.width:
            lines.append(
                f"{name}: {size / scene.width:.0%} of the {'body' if scene.body else 'channel'}'s width; granules are "
                "treated as points in the air"
            )
        if fraction.properties.confidence == "low":
            lines.append(f"{name}: material data of low confidence; measure your own terminal velocity")
        how = plan.fractions[name]
        if how.drag_scale < 0.9:
            lines.append(f"{name}: falls faster than a sphere of its size and density; check its terminal velocity")
        lines.extend(_injected_beyond(name, how, plan.target_error))
    return [*lines, *standing(scene), *strained(plan.validity), *_airflow_warnings(scene, plan.airflow)]


def _injected_beyond(name: str, how: FractionPlan, target: float) -> Iterator[str]:
    """A line where injection was asked for and does not hold."""
    if how.mode != "injected":
        return
    turned = how.impaction
    if turned is None and how.stokes < math.inf:
        yield f"{name}: injected, though in upward air the slopes lie in the wake; feed.mode = 'resolved' computes it"
    elif turned is not None and (turned.missed > target or turned.shift > (how.limit or 0.0)):
        yield (
            f"{name}: injected, though the air carries {turned.missed:.2g} of it round the body and moves the landing "
            f"of the rest by up to {turned.shift:.2g} body widths; feed.mode = 'resolved' computes both"
        )


def _airflow_warnings(scene: Scene, airflow: AirflowPlan) -> Iterator[str]:
    reynolds, parabolic = scene.reynolds or 0.0, scene.air is not None and scene.air.profile == "parabolic"
    if airflow.rung == "analytic" and parabolic and reynolds > LAMINAR_CHANNEL:
        yield f"parabolic air at Re {reynolds:.3g} on the channel's width: in reality it would be turbulent"
    if airflow.rung == "draft" and scene.reynolds is not None and scene.reynolds > SHEDDING_ABOVE:
        yield "draft airflow: a steady wake is too long and its suction too weak; rung standard resolves the shedding"
    if airflow.brackets:
        yield (
            f"{airflow.rung} airflow: a two-dimensional wake sheds too coherently, its suction is too strong; the "
            "truth lies between it and the draft"
        )
