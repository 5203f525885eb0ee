"""The plan in words: what is used and why, and where the model's assumptions strain, with numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ..core.process import cores
from ..scene import Scene
from .airflow import AirflowPlan, ranks_for, typical_cells
from .coupling import strained
from .lock_in import AirMotion
from .plan import COMPARED, REPLICATES, FractionPlan, Plan
from .standing import standing
from .terms import Gate

__all__ = ["missing_lines", "used_lines", "warning_lines"]


def used_lines(scene: Scene, plan: Plan, motion: AirMotion | None) -> list[str]:
    lines = list(_airflow_lines(plan.airflow, len(scene.body)))
    if plan.flown_by == "chain":
        lines.append("no air: granules fly in parabolas from impact to impact (the chain); neither Gmsh nor OpenFOAM")
    if scene.air is not None and scene.channel.inlet and plan.airflow.computes_streams:
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
    if airflow.stepping is None:
        yield from () if airflow.summary is None else (airflow.summary,)
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


def missing_lines(gates: Mapping[str, Gate], unit: str) -> Iterator[str]:
    """A line for each term that could matter and is not computed, with what it could move."""
    terms = dict.fromkeys((term, why) for gate in gates.values() for term, why in gate.missing.items())
    for term, why in terms:
        moved = [f"{name} {gate.bounds[term]:.2g}" for name, gate in gates.items() if term in gate.missing]
        yield f"{term}, left out, could move {', '.join(moved)} {unit}: {why}"


def warning_lines(scene: Scene, plan: Plan) -> list[str]:
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
    return [*lines, *standing(scene), *strained(plan.validity), *plan.airflow.warnings(scene)]


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
