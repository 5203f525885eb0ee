"""The plan: what a scene needs, what is left out and by which bound, and what it will cost. Starts nothing heavy.

A bound is the largest landing shift (in body widths) that a left-out term could cause, taken over the fractions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from .bounds import Flight, neglected
from .errors import SceneError
from .geometry import is_symmetric
from .laws.drag import drag_factor_for_terminal_velocity, drag_laws, relaxation_time, terminal_velocity
from .registry import nearest
from .scene import GRAVITY, STANDARD_AIR, Fraction, Scene

__all__ = ["FractionPlan", "Plan", "make_plan"]

LAMINAR_BELOW = 300.0  # Reynolds number; above it the k-omega SST model runs
SHEDDING_ABOVE = 30.0  # no sharp-edged body of the kind sheds below (flat plate 27.8, triangle 34.3: Jackson 1987)
INJECTED_ABOVE = (
    10.0  # approach Stokes number; a cylinder in potential flow catches 87 % there (Langmuir & Blodgett 1946)
)
RUNGS = ("auto", "none", "draft", "standard", "reference")
SWITCHES = ("buoyancy", "pressure-gradient")  # terms that --force may switch; drag and gravity always act


@dataclass(frozen=True)
class FractionPlan:
    """How one fraction is computed, and the scales that decide it (SI units, of the median size)."""

    mode: str  # injected | resolved
    drag: str  # name of the drag law
    drag_scale: float  # factor on the law that gives the measured terminal velocity; 1 without one
    terminal_velocity: float | None  # m/s in the scene's air; None in a vacuum
    relaxation_time: float  # s, at the speed relative to the air on arrival; inf in a vacuum
    stokes: float  # approach Stokes number: relaxation time x arrival speed / half width


@dataclass(frozen=True)
class LeftOut:
    """A term that is not computed: the bound on what it would move (body widths; None: not a shift) and why."""

    name: str
    bound: float | None
    why: str


@dataclass(frozen=True)
class Plan:
    """What will be computed and what will not."""

    rung: str  # none | draft | standard
    turbulence: str | None  # laminar | kOmegaSST
    symmetric: bool  # the airflow's geometry is its own mirror image about x = 0
    half: bool  # only half of the channel is solved, the other half is its mirror image
    forces: tuple[str, ...]
    fractions: dict[str, FractionPlan]
    used: list[str]
    left_out: list[LeftOut]
    estimate: dict[str, float]  # seconds, memory (bytes), disk (bytes)
    warnings: list[str] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """The ``plan`` table of result.json and of ``wakeflow plan --json``."""
        table = asdict(self)
        for row in table["fractions"].values():
            row.update({key: None for key, value in row.items() if isinstance(value, float) and math.isinf(value)})
        return table


def make_plan(scene: Scene, *, rung: str | None = None, force: Mapping[str, bool] | None = None) -> Plan:
    """Decide what ``scene`` needs. ``rung`` overrides the scene's; ``force`` switches single terms on or off.

    Raises SceneError when a rung or term is asked for that cannot be had.
    """
    chosen = _rung(scene, rung or scene.numerics.rung)
    turbulence = None
    if scene.reynolds is not None:
        turbulence = "laminar" if scene.reynolds < LAMINAR_BELOW else "kOmegaSST"
    fractions = {name: _fraction_plan(scene, name, fraction) for name, fraction in scene.fraction.items()}
    forces = _forces(scene, force or {})
    symmetric = all(is_symmetric(body.outline()) for body in scene.body.values())
    half = chosen == "draft" and symmetric
    flights = {} if scene.air is None else {n: _flight(scene, scene.fraction[n], p) for n, p in fractions.items()}
    plan = Plan(
        rung=chosen,
        turbulence=turbulence,
        symmetric=symmetric,
        half=half,
        forces=forces,
        fractions=fractions,
        used=_used(scene, chosen, turbulence, symmetric, half, forces, fractions),
        left_out=_left_out(scene, forces, flights),
        estimate=_estimate(scene, chosen, half),
    )
    plan.warnings.extend(_warnings(scene, plan, flights))
    return plan


def _rung(scene: Scene, asked: str) -> str:
    if scene.air is None:
        if asked not in ("auto", "none"):
            raise SceneError(f"rung = {asked!r} needs an [air] table; leave the rung out for a vacuum")
        return "none"
    if asked == "none":
        raise SceneError("rung = 'none' is for scenes without air: remove the [air] table, or choose draft or standard")
    if asked == "reference":
        raise SceneError("rung = 'reference' is not in this version; choose draft or standard")
    if asked not in RUNGS:
        raise SceneError(f"rung = {asked!r}: unknown{nearest(asked, list(RUNGS))} (known: {', '.join(RUNGS)})")
    if asked == "auto":
        assert scene.reynolds is not None
        return "draft" if scene.reynolds < SHEDDING_ABOVE else "standard"
    return asked


def _forces(scene: Scene, force: Mapping[str, bool]) -> tuple[str, ...]:
    for term, on in force.items():
        if term in neglected and on:
            raise SceneError(f"--force {term}=on: this version cannot compute it; its bound is in the plan")
        if term not in SWITCHES and term not in neglected:
            raise SceneError(f"--force {term}: unknown term (known: {', '.join([*SWITCHES, *neglected])})")
    if scene.air is None:
        return ("gravity",)
    return ("drag", "gravity", *(term for term in SWITCHES if force.get(term, True)))


def _calibration(name: str, law: str, diameter: float, density: float, speed: float) -> float:
    """The factor on the drag law that gives a measured terminal velocity. Raises SceneError where none can be."""
    if density <= STANDARD_AIR[0]:
        raise SceneError(f"fraction.{name}.density = {density:g} kg/m3: lighter than air, it has no terminal velocity")
    scale = float(drag_factor_for_terminal_velocity(diameter, density, speed, *STANDARD_AIR, GRAVITY, law))
    if not 0.5 <= scale <= 100.0:
        sphere = float(terminal_velocity(diameter, density, *STANDARD_AIR, GRAVITY, law))
        raise SceneError(
            f"fraction.{name}.terminal_velocity = {speed:g} m/s needs {scale:.2g} times a sphere's drag: a sphere of "
            f"{diameter:.3g} m and {density:g} kg/m3 falls at {sphere:.3g} m/s; check size, density and velocity"
        )
    return scale


def _fraction_plan(scene: Scene, name: str, fraction: Fraction) -> FractionPlan:
    granule = fraction.properties
    law = "haider-levenspiel" if fraction.sphericity is not None else "brown-lawler"
    entry, phi = drag_laws[law], fraction.sphericity or 1.0
    scale = 1.0
    if fraction.measured_settling is not None:
        scale = _calibration(name, law, *fraction.measured_settling)
    wanted = scene.feed.mode
    if scene.air is None:
        mode = "injected" if wanted == "auto" else wanted
        return FractionPlan(mode, law, scale, None, math.inf, math.inf)
    air = scene.air
    settling = float(
        terminal_velocity(
            granule.diameter, granule.density, air.density, air.viscosity, GRAVITY, law, phi, drag_scale=scale
        )
    )
    along = air.speed if air.direction == "down" else -air.speed
    fall = scene.feed.fall_speed
    reynolds = air.density * abs(fall - along) * granule.diameter / air.viscosity
    factor = scale * float(entry.factor(np.array([reynolds]), phi)[0])
    tau = float(relaxation_time(granule.diameter, granule.density, air.viscosity)) / factor
    stokes = tau * fall / (0.5 * scene.width)
    falls_into_calm = air.direction == "down"  # in upward air the slopes lie in the wake, not in uniform air
    mode = wanted if wanted != "auto" else ("injected" if stokes > INJECTED_ABOVE and falls_into_calm else "resolved")
    return FractionPlan(mode, law, scale, settling, tau, stokes)


def _flight(scene: Scene, fraction: Fraction, how: FractionPlan) -> Flight:
    """The scales of one fraction in a scene with air."""
    air, granule = scene.air, fraction.properties
    assert air is not None
    assert how.terminal_velocity is not None
    along = air.speed if air.direction == "down" else -air.speed
    fall = scene.feed.fall_speed
    down = how.terminal_velocity + along  # where the velocity tends to, downwards
    distance = abs(scene.channel.bottom) if down > 0 else scene.channel.top
    return Flight(
        diameter=granule.diameter,
        density=granule.density,
        tau=how.relaxation_time,
        settling=how.terminal_velocity,
        arrival=max(fall, abs(down)),
        slip=abs(fall - along),
        time=distance / max(min(fall, abs(down)), 0.1 * air.speed),
        air_density=air.density,
        viscosity=air.viscosity,
        air_speed=air.speed,
        width=scene.width,
        intensity=air.turbulence,
    )


def _used(
    scene: Scene,
    rung: str,
    turbulence: str | None,
    symmetric: bool,
    half: bool,
    forces: tuple[str, ...],
    fractions: dict[str, FractionPlan],
) -> list[str]:
    lines = ["forces: " + ", ".join(forces)]
    if rung == "draft":
        part = ", half of the channel mirrored" if half else ""
        lines.insert(0, f"airflow: steady, {turbulence}{part} (Re {scene.reynolds:.3g})")
    elif rung == "standard":
        part = "; half of the granules in its mirror image" if symmetric else ""
        lines.insert(0, f"airflow: time-resolved, {turbulence} (Re {scene.reynolds:.3g}){part}")
    for name, how in fractions.items():
        resolved = "released above the body, impacts resolved"
        impact = "injected by eq. (1)-(2)" if how.mode == "injected" else resolved
        stokes = "" if math.isinf(how.stokes) else f" (approach Stokes number {how.stokes:.2g})"
        drag = "" if scene.air is None else f"; drag {how.drag} x {how.drag_scale:.3g}"
        lines.append(f"{name}: {impact}{stokes}{drag}")
    if scene.vibration is not None:
        peak = float(np.linalg.norm(scene.motion[0])) * scene.motion[1]
        lines.append(f"vibration: peak speed {peak:.3g} m/s at the impacts; the air sees a body at rest")
    return lines


def _left_out(scene: Scene, forces: tuple[str, ...], flights: dict[str, Flight]) -> list[LeftOut]:
    if scene.air is None:
        return [LeftOut("air", 0.0, "no [air] table: neither mesh nor airflow is computed")]
    rows = []
    for name in neglected:
        bound, why = neglected[name]
        worst = max(flights, key=lambda fraction: bound(flights[fraction]))
        widest = scene.channel.width / scene.width  # nothing lands farther off
        rows.append(
            LeftOut(name, min(bound(flights[worst]), widest), f"{why}; largest for {worst}; not in this version")
        )
    rows += [LeftOut(term, None, "switched off by --force") for term in SWITCHES if term not in forces]
    if scene.vibration is not None:
        peak = float(np.linalg.norm(scene.motion[0])) * scene.motion[1]
        rows.append(LeftOut("vibration-of-the-air", None, f"body speed over air speed is {peak / scene.air.speed:.2g}"))
    rows.append(LeftOut("collisions-between-granules", None, _loading(scene)))
    return rows


def _loading(scene: Scene) -> str:
    """How dense the curtain is: volume fraction and collisions a granule meets over one body width of fall."""
    feed, volume, rate = scene.feed, 0.0, 0.0
    speed = max(feed.fall_speed, 0.1)
    for name, share in scene.mass_shares().items():
        granule = scene.fraction[name].properties
        flux = feed.mass_flow * share / granule.density / (feed.width * feed.depth * speed)  # volume fraction
        volume += flux
        rate += 6.0 * flux / granule.diameter  # number density x pi d^2, per metre of relative path
    return (
        f"volume fraction {volume:.2g} in the curtain, about {rate * scene.width:.2g} meetings a granule per body width"
    )


def _estimate(scene: Scene, rung: str, half: bool) -> dict[str, float]:
    """Seconds, memory and disk, from runs of the shipped scenes on two cores of 2020s hardware; good to a factor 3."""
    count = scene.feed.count * len(scene.fraction)
    airflow = {"none": 0.0, "draft": 15.0 if half else 40.0, "standard": 200.0}[rung]
    return {
        "seconds": 5.0 + airflow + 300e-6 * count,  # tracking and its companion for the budget
        "memory": 4e8 + 600.0 * count,
        "disk": {"none": 1e6, "draft": 5e7, "standard": 3e8}[rung] + 100.0 * count,
    }


def _warnings(scene: Scene, plan: Plan, flights: dict[str, Flight]) -> list[str]:
    """Where the model's assumptions strain, with numbers."""
    lines = []
    for name, fraction in scene.fraction.items():
        size = float(fraction.diameters(np.array([0.95]))[0])
        if size > 0.1 * scene.width:
            lines.append(
                f"{name}: {size / scene.width:.0%} of the body's width; granules are treated as points in the air"
            )
        if fraction.properties.confidence == "low":
            lines.append(f"{name}: material data of low confidence; measure your own terminal velocity")
        how = plan.fractions[name]
        if how.drag_scale < 0.9:
            lines.append(f"{name}: falls faster than a sphere of its size and density; check its terminal velocity")
        if how.mode == "injected" and how.stokes < INJECTED_ABOVE:
            lines.append(f"{name}: injected at an approach Stokes number of {how.stokes:.2g}; the air turns many aside")
    large = [f"{row.name} {row.bound:.2g}" for row in plan.left_out if row.bound is not None and row.bound > 0.1]
    if large:
        lines.append("left out, and could move granules by up to so many body widths: " + ", ".join(large))
    if plan.rung == "draft" and scene.reynolds is not None and scene.reynolds > SHEDDING_ABOVE:
        lines.append(
            "draft airflow: a steady wake is too long and its suction too weak; rung standard resolves the shedding"
        )
    if plan.rung == "standard":
        lines.append(
            "standard airflow: a two-dimensional wake sheds too coherently, its suction is too strong; the truth lies "
            "between it and the draft"
        )
    return lines
