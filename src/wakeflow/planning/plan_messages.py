"""The plan in words: what is used and why, and where the model's assumptions strain, with numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np

from ..core.graded import Notice, information, less_sure, void
from ..core.quantities import metres
from ..laws.drag import drag_factor_for_terminal_velocity, slip_correction
from ..scene import Scene
from ..scene.fraction import COEFFICIENTS
from .airflow_choice import AirflowPlan, AirMotion
from .cost import ranks_for, span_cost, typical_cells
from .coupling import COUPLING, INDEPENDENT, Limit, strained
from .feed_funnel import summary
from .plan import COMPARED, REPLICATES, FractionPlan
from .scene_lines import (
    body_checks,
    cascade_lines,
    floor_notices,
    lifting_line,
    lifting_notices,
    magnitude_lines,
    trade_lines,
)
from .terms import COLLISIONS, LOADING, TermSelection
from .wake import span_lines

# -- Inputs that nothing feels -----------------------------------------------------------------------------------------
OF_THE_AIR = re.compile(
    r"air\..*|channel\.inlet\..*|numerics\.(mesh_scale|averaging|snapshots|span\..*)"
    r"|fraction\.[^.]+\.(terminal_velocity|sphericity|drag)(\..*)?"
)


def unfelt(keys: Iterable[str], scene: Scene, rung: str) -> list[str]:
    """Keys, of a scene with air, that change no answer on a ``rung``: on none, which leaves the air out."""
    return [key for key in keys if scene.air is not None and rung == "none" and OF_THE_AIR.fullmatch(key)]


def unfelt_line(keys: Sequence[str]) -> str:
    """What to say of ``keys`` that nothing feels."""
    verb = "changes" if len(keys) == 1 else "change"
    return f"{', '.join(keys)} {verb} nothing at rung none, which leaves the air out; --rung draft computes it"


# -- The plan in words -------------------------------------------------------------------------------------------------
LARGE_QUANTILE = 0.95  # mass quantile that represents a fraction's large granules
POINT = 0.1  # of the body's width: size up to which a granule passes as a point in the air; chosen
HARDLY = 0.5  # size above which calling it one makes the answer void; chosen
LIFTED = {LOADING: COUPLING, COLLISIONS: INDEPENDENT}  # the assumption that no longer strains where a term is computed
WEIGHED, REBOUNDS = ("size", "density"), ("restitution", "friction", "rebound_scatter")  # keys of a fraction
FASTER = 0.9  # factor on a sphere's drag below which data look wrong; chosen: drag laws scatter by some 5 %


def used_lines(
    scene: Scene,
    airflow: AirflowPlan,
    fractions: Mapping[str, FractionPlan],
    validity: Sequence[Limit],
    motion: AirMotion,
    slab: Iterable[str],
    *,
    chain: bool,
) -> Iterator[str]:
    """A line for each thing that is computed: airflow, streams, fractions, feed, vibration, funnel.

    ``motion``: what the vibration asks of the airflow; ``slab``: what to say of the slab in which granules meet;
    ``chain``: a scene with air is flown without.
    """
    yield from _airflow_lines(scene, airflow)
    if airflow.span:
        yield from span_lines(airflow.span, span_cost(scene, airflow))
    if chain:
        yield "no air: granules fly in parabolas from impact to impact (the chain); neither Gmsh nor OpenFOAM"
    if scene.air is not None and scene.channel.inlet and airflow.kind != "given":  # which brings its own streams
        brought = sum(inlet.velocity * inlet.width for inlet in scene.channel.inlet.values())
        share = brought / (scene.air.speed * scene.channel.width)
        yield f"secondary streams: {', '.join(scene.channel.inlet)} add {share:.2g} of the main stream's air"
    yield from (f"{label}: {text}" for label, text in trade_lines(scene))
    yield from _gravity_lines(scene, fractions)
    for name, fraction in fractions.items():
        yield _fraction_line(scene, name, fraction)
    yield from _kept_lines(scene)
    yield from cascade_lines(scene, blown=scene.air is not None and not scene.air.still)
    numbers = ", ".join(f"{limit.name} {limit.value:.2g}" for limit in validity if limit.limit < math.inf)
    yield f"feed: {3600 * scene.feed.mass_flow:.3g} kg/h, profile {scene.feed.profile.distribution}; {numbers}"
    if scene.vibration is not None:
        peak, often = float(np.linalg.norm(scene.shaking)), 1.0 / scene.vibration.period
        sight = "the mesh vibrates with the body" if airflow.moving else "the air sees a body at rest"
        why = f" ({motion.why})" if motion.why else ""
        yield (
            f"vibration: {often:.4g} Hz, Gamma = {scene.vibration.strength:.3g}, peak speed {peak:.3g} m/s at the "
            f"impacts{'' if scene.vibration.pivot is None else ' farthest from the pivot'}; {sight}{why}"
        )
    yield from slab
    if scene.funnel is not None:
        yield summary(scene.funnel)


def _gravity_lines(scene: Scene, fractions: Mapping[str, FractionPlan]) -> Iterator[str]:
    """Where gravity points in a channel that does not stand upright, and what the air lifts against it."""
    if not scene.plumb.upright:
        side = "right" if scene.channel.tilt > 0.0 else "left"
        angle = f"{math.degrees(abs(scene.channel.tilt)):.3g} deg"
        yield f"gravity: {angle} from the channel's axis, to the {side} (channel.tilt)"
    if lifted := lifting_line(scene, fractions):
        yield f"lifting: {lifted}"


def _fraction_line(scene: Scene, name: str, fraction: FractionPlan) -> str:
    """How a fraction enters the field, arrives, and with which forces it flies."""
    resolved = "released above the body, impacts resolved" if scene.body else f"enters at y = {scene.level:.3g} m"
    impact = "injected by eq. (1)-(2)" if fraction.mode == "injected" else resolved
    stokes = ""
    if not math.isinf(fraction.stokes):
        stokes = f" (approach Stokes number {fraction.stokes:.2g}{_turned(scene, fraction)})"
    drag = "" if scene.air is None else f"; drag {fraction.drag} x {fraction.drag_scale:.3g}"
    rebound = _rebound_words(scene, name) if scene.body else ""
    fall = f", arrives at {fraction.arrival_speed:.3g} m/s"
    drag += _spread(scene, name)
    return f"{name}: {impact}{stokes}{fall}{drag}{rebound}; forces {', '.join(fraction.forces)}"


def _rebound_words(scene: Scene, name: str) -> str:
    """How the granules of a fraction rebound: what each has of its own, 90 % within; what its shape and spin do."""
    fraction = scene.fraction[name]
    parts = []
    for coefficient in COEFFICIENTS:
        ends = fraction.coefficients(coefficient, np.array([0.05, 0.95]))
        middle = getattr(fraction.properties, coefficient)
        if ends is not None:
            parts.append(f"{coefficient} {ends[0]:.2g} to {ends[1]:.2g}")
        elif isinstance(middle, float):
            parts.append(f"{coefficient} {middle:.2g}")
        else:
            parts.append(f"{coefficient} by the law {middle.law}")
    if fraction.properties.rebound_scatter:
        parts.append(f"scatter {fraction.properties.rebound_scatter:.2g} rad")
    if fraction.properties.tangential_restitution:
        parts.append(f"tangential restitution {fraction.properties.tangential_restitution:.2g}")
    turns = "does not turn" if math.isinf(fraction.inertia) else f"turns with I / (m r^2) {fraction.inertia:.2g}"
    if fraction.flake:
        turns = "turns as a flake, by chance"
    return f"; rebounds with {', '.join(parts)}, {turns}"


def _kept_lines(scene: Scene) -> Iterator[str]:
    """What walls keep by the bins on them and by the fractions, and by how much the shares of other bins fall: of what
    meets such walls n times.
    """
    keepers = [
        (f"bin.{name}: its wall keeps", bin_.keeps_part, "")
        for name, bin_ in scene.bin.items()
        if bin_.keeps_part and bin_.body not in scene.all_kept
    ]
    for name, fraction in scene.fraction.items():
        if fraction.capture_speed or fraction.sticks:
            below = f" below {fraction.capture_speed:.2g} m/s" if fraction.capture_speed else ""
            keepers.append((f"{name}: walls keep", 1.0 if fraction.sticks is None else fraction.sticks, below))
    for whose, part, below in keepers:
        once, twice, often = (1.0 - (1.0 - part) ** n for n in (1, 2, 5))
        grows = f": {once:.2g} of what meets them once, {twice:.2g} twice, {often:.2g} five times" if part < 1.0 else ""
        yield f"{whose} {part:.2g} of the impacts{below}{grows}; the other shares fall by at most as much"


def _turned(scene: Scene, fraction: FractionPlan) -> str:
    """What the air does to the fraction before the body."""
    turned = fraction.impaction
    if turned is None:
        return ", the slopes lie in the wake" if scene.plumb.upright else ", across the air"
    return (
        f", impaction efficiency {turned.efficiency:.2g}: {turned.missed:.2g} carried round the body, the landing of "
        f"the rest moved by up to {turned.shift:.2g} body widths"
    )


def _spread(scene: Scene, name: str) -> str:
    """Terminal velocities between which nine in ten granules of a fraction lie, where a distribution was measured."""
    ends = scene.fraction[name].settling(np.array([0.05, 0.95]))
    if ends is None:
        return ""
    return f", of each granule's own terminal velocity, 90 % within {ends[0]:.3g} to {ends[1]:.3g} m/s"


def _airflow_lines(scene: Scene, airflow: AirflowPlan) -> Iterator[str]:
    """The airflow that is computed, why, and what is computed in addition."""
    if not airflow.stepping:
        yield from filter(None, (airflow.summary,))
        return
    part = ", half of the channel mirrored" if airflow.half else ""
    if airflow.mirrored:
        part = "; half of the granules fly in its mirror image"
    yield f"airflow: rung {airflow.rung}, {airflow.stepping}, {airflow.turbulence}{part} ({airflow.why})"
    cells, ranks = typical_cells(scene, airflow), scene.numerics.ranks
    shared = ranks_for(round(cells))[1] if ranks == "auto" else f"{ranks} MPI ranks, as numerics.ranks asks"
    yield f"about {cells:.0f} cells: {shared}"
    if airflow.wake:
        theta, strength = airflow.wake.theta, airflow.wake.strength
        yield (
            f"wake: {theta.value:.2f} of the time-resolved mean and the rest of the steady one (theta {theta.low:.2f} "
            f"to {theta.high:.2f}), {strength.value:.2f} of the fluctuation (strength {strength.low:.2f} to "
            f"{strength.high:.2f}); {airflow.wake.why}"
        )
    if beside := airflow.wakes_beside:
        yield (
            f"beside it, for the error of the airflow's model: 1 in {REPLICATES // COMPARED} granules in "
            f"{len(beside)} other wakes: {', '.join(beside)}"
        )
    if airflow.loaded:
        yield "the air feels the granules: it is solved under their force, gathered along tracks in the steady airflow"
    if len(airflow.scales) > 1:
        sizes = ", ".join(f"{scale:.2g}" for scale in airflow.scales)
        yield f"beside it, for the error of the mesh: grids with cell edges of {sizes} times the usual"


def missing_lines(gates: Mapping[str, TermSelection], unit: str) -> Iterator[Notice]:
    """One notice for each term that could matter and is not computed, with what it could move."""
    terms = dict.fromkeys((term, why) for gate in gates.values() for term, why in gate.missing.items())
    for term, why in terms:
        moved = [f"{name} {gate.bounds[term]:.2g}" for name, gate in gates.items() if term in gate.missing]
        yield less_sure(f"{term}, left out, could move {', '.join(moved)} {unit}: {why}")


def warning_lines(
    scene: Scene,
    airflow: AirflowPlan,
    fractions: Mapping[str, FractionPlan],
    validity: Sequence[Limit],
    target: float,
    whole: Collection[str],
) -> Iterator[Notice]:
    """Where the model's assumptions strain, with numbers; ``target``: the accuracy asked for (a share); ``whole``: the
    terms that are computed for all fractions together, which lift an assumption each.
    """
    yield from airflow.notices(scene)
    yield from _beyond_the_top(scene)
    yield from magnitude_lines(scene)
    for name, fraction in scene.fraction.items():
        size = float(fraction.diameters(np.array([LARGE_QUANTILE]))[0])
        if scene.air is not None and size > POINT * scene.width:
            doubt = void if size > HARDLY * scene.width else less_sure
            yield doubt(
                f"{name}: {size / scene.width:.0%} of the {'body' if scene.body else 'channel'}'s width; granules are "
                f"treated as points in the air; check fraction.{name}.size"
            )
        yield from _guesses(scene, name)
        plan = fractions[name]
        measured = fraction.measured_settling
        if measured and drag_factor_for_terminal_velocity(*measured) * slip_correction(measured[0]) < FASTER:
            yield less_sure(
                f"{name}: falls faster than a sphere of its size and density; check fraction.{name}.terminal_velocity"
            )
        yield from _injected_beyond(name, plan, target)
        yield from _inside_the_parting_air(scene, name, plan)
    for limited, most in scene.limit.by_name.items():
        if most < target:
            yield information(
                f"limit.{limited} = {100 * most:.3g} % is finer than the accuracy asked for, {100 * target:.3g} %: its "
                f"verdict may stay open; numerics.target_error = '{50 * most:.2g} %' computes it finely enough"
            )
    yield from lifting_notices(scene, fractions)
    yield from floor_notices(scene)
    yield from body_checks(scene)
    if scene.feed.rate:  # without one there is a rate only to give throughputs a scale
        yield from strained(validity, {LIFTED[term] for term in whole if term in LIFTED})


def _guesses(scene: Scene, name: str) -> Iterator[Notice]:
    """Notice of the numbers of a fraction that are its material's, of low confidence, and that its granules feel; of
    none whose uncertainty the scene says.
    """
    fraction = scene.fraction[name]
    felt = [*WEIGHED, *(["terminal_velocity"] if scene.air is not None else []), *(REBOUNDS if scene.body else [])]
    low = [key for key in felt if fraction.confidence_in(key) == "low" and getattr(fraction.properties, key, True)]
    left = [key for key in low if f"fraction.{name}.{key}" not in scene.uncertainty]
    if left:
        what = ", ".join(left)
        yield less_sure(f"{name}: {what} of low confidence in its material; measure yours, set them in fraction.{name}")


def _beyond_the_top(scene: Scene) -> Iterator[Notice]:
    """Notice where the feed begins above the channel, whose air is known up to its top."""
    begin, top = scene.level + float(scene.release[0]), scene.channel.top
    if not scene.body or scene.air is None:
        return
    if not scene.plumb.upright:
        middle = np.array([scene.feed.position])
        inside = float(scene.plumb.highest(middle, np.zeros(1), 0.0)[0]) - scene.level
        if scene.release[0] > inside:
            yield information(
                f"the feed begins {metres(scene.release[0], 3)} above the body, outside the channel: granules come in "
                f"{metres(inside, 3)} above it, after a fall through air at rest"
            )
    elif begin > top:
        yield less_sure(
            f"the feed begins at y = {1e3 * begin:.0f} mm, above channel.top = {1e3 * top:.0f} mm: down to there "
            "granules fall through uniform air; channel.top higher, or feed.height lower"
        )


PARTED = 10.0  # Stokes number below which the air's parting, a width above the body, has turned granules; measured once


def _inside_the_parting_air(scene: Scene, name: str, fraction: FractionPlan) -> Iterator[Notice]:
    """Notice where granules that follow the air begin so near to the body that it has turned them already."""
    blows = scene.air is not None and not (scene.air.still or scene.air.rises)
    if scene.feed.speed is None or not blows or fraction.mode != "resolved" or fraction.stokes >= PARTED:
        return
    yield less_sure(
        f"{name}: begins {metres(scene.release[0], 3)} above the body, where the air parts already (Stokes number "
        f"{fraction.stokes:.2g}): more of it meets the body than would; feed.height of 20 body widths in place of "
        "feed.speed begins above that"
    )


def _injected_beyond(name: str, fraction: FractionPlan, target: float) -> Iterator[Notice]:
    """Notice where injection was asked for and does not hold."""
    if fraction.mode != "injected":
        return
    turned = fraction.impaction
    if turned is None and fraction.stokes < math.inf:
        yield less_sure(
            f"{name}: injected, though in upward air the slopes lie in the wake; feed.mode = 'resolved' computes it"
        )
    elif turned is not None and (turned.missed > target or turned.shift > fraction.limit):
        yield less_sure(
            f"{name}: injected, though the air carries {turned.missed:.2g} of it round the body and moves the landing "
            f"of the rest by up to {turned.shift:.2g} body widths; feed.mode = 'resolved' computes both"
        )
