"""Sources that are what nobody knows exactly of a scene, and the terms left out: what each could change a share by.

The plan bounds how far each term could move a landing. What lands no farther than that from a bin's end could land on
its other side: all of what is inside, or all of what is outside, whichever is more, is the most by which the bin's
share could change. It is a true bound, however the landings heap up at the end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...flight.stages.landings import Landings
from ...flight.stages.pipeline import InputRerun, Pipeline
from ...planning.airflow_choice import vibration_of_scene
from ...planning.plan import Plan
from ...planning.terms import COLLISIONS, VIBRATION
from ...planning.unknowns import Unknown, unknowns
from ...scene import RESERVED_BIN, Scene
from ..shares import CALIBRATED, LEFT_OUT, NOT_COMPUTED, PERTURBED_RERUN, BudgetPart, InputPart, weightiest
from ..spread import upper_limit
from .flown_again import free_ends, points_of
from .source import INPUTS, FractionResults, Parts, Source, add

if TYPE_CHECKING:
    from ...flight.stages.input_samples import InputSamples
    from ...flight.stages.landings import Tracked


class UnknownInputs(Source["InputSamples"]):
    """The numbers of the scene that are not known exactly: the range of the share over draws of them all."""

    name, how, place = INPUTS, PERTURBED_RERUN, 15

    reruns = (InputRerun(),)

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[InputSamples]:
        return super().fly(pipeline, tracked) if unknowns(pipeline.scene, pipeline.plan) else ()

    def shares(self, fraction: FractionResults) -> Parts:
        if not fraction.flights.of(self):
            return {}
        parts, seconds = {}, self.seconds(fraction)
        for bin_ in fraction.shares:
            of = fraction.answer.of_share(fraction.name, [bin_])
            over, effects = fraction.answer.number(of), fraction.answer.effects(of, fraction.name)
            causes = ", ".join(f"{key} {effect.points}" for key, effect in weightiest(effects))
            note = f"depends most on (points each) {causes}" if causes else ""
            if note and fraction.flights.slab:
                note += f"; {fraction.flights.factors[fraction.name]:.2g} times what they move of granules alone"
            low, high = over.low - over.value, over.high - over.value
            parts[bin_] = [replace(self.part(max(-low, high), seconds, note), low=low, high=high)]
        return parts


UNKNOWN = add(UnknownInputs())


# -- The terms left out: what each could change a share by -------------------------------------------------------------
Array = NDArray[np.float64]
AIR_SPEED = "air.speed"  # the unknown that represents what the air beside a body that vibrates does
NO_EFFECT = InputPart(half=0.0, variance=0.0, error=0.0, rise=0.0)  # on a share that was the same in all draws


class LeftOutTerms(Source[None]):
    """Every term that is not computed, each a part of its own name."""

    name, how, place = "terms-left-out", CALIBRATED, 30

    def shares(self, fraction: FractionResults) -> Parts:
        pipeline, flights = fraction.pipeline, fraction.flights
        by_bin = truncation_terms(pipeline.scene, pipeline.plan, fraction.name, fraction.landings)
        if VIBRATION in pipeline.plan.force:
            return by_bin
        answer = fraction.answer
        speed = tuple(unknown for unknown in flights.draws.unknowns if unknown.key == AIR_SPEED)
        for place, parts in by_bin.items():
            if any(part.source == VIBRATION for part in parts):
                of = answer.of_share(fraction.name, [place])
                effects = answer.effects(of, fraction.name) if speed else {}
                effect = effects.get(AIR_SPEED, NO_EFFECT)
                by_bin[place] = [swung(pipeline.scene, pipeline.plan, part, effect, speed) for part in parts]
        return by_bin


def truncation_terms(scene: Scene, plan: Plan, name: str, landing: Landings) -> dict[str, list[BudgetPart]]:
    """Parts of the budget for every bin of fraction ``name``: what each left-out term could change its share by.

    Without a body the whole floor and top are bins and no end is near; there a term that could matter counts by its
    bound, as for granules spread over one channel width.
    """
    has_rate = scene.feed.rate > 0.0  # without one the question is that of single granules
    rows = [row for row in plan.left_out if row.fraction == name and (has_rate or row.name != COLLISIONS)]
    ends = free_ends(scene)
    parts: dict[str, list[BudgetPart]] = {place: [] for place in [*scene.bin, RESERVED_BIN]}
    bounds = [(row, row.bound) for row in rows if np.isfinite(row.bound)]
    if not bounds or not len(landing.bin):
        return parts
    limit = plan.fractions[name].limit
    distance = {point: np.linalg.norm(landing.position - point, axis=1) / scene.width for point in points_of(ends)}
    number = {place: index for index, place in enumerate(scene.bin)} | {RESERVED_BIN: -1}
    places, indices = list(parts), range(len(parts))
    for i, of_bin in enumerate(parts.values()):
        pair = [places[i], places[(scene.images or indices)[i]]]  # the bin and its image: once each, or itself twice
        away = np.concatenate([_nearest([distance[point] for point in ends[bin_]], landing) for bin_ in pair])
        inside = np.concatenate([landing.bin == number[bin_] for bin_ in pair])
        weight = 0.5 * np.tile(np.ones(len(landing.bin)) if landing.weight is None else landing.weight, 2)
        for row, bound in bounds:
            error, kind = most_crossing(away, inside, bound, weight), LEFT_OUT if bound <= limit else NOT_COMPUTED
            if kind == NOT_COMPUTED and not scene.body:  # it may turn back a granule on its way to either end
                error = max(error, min(1.0, bound))
            note = f"all that lands within {bound:.2g} {scene.unit} of the bin's ends on one side of them"
            of_bin.append(BudgetPart(row.name, error, 0.0, CALIBRATED, kind, note=note))
    return parts


def _nearest(distances: Sequence[Array], landing: Landings) -> Array:
    """The distance (n,) to the nearest of some ends; infinite where there are none."""
    return np.asarray(np.min([np.full(len(landing.bin), np.inf), *distances], axis=0))


def swung(scene: Scene, plan: Plan, part: BudgetPart, effect: InputPart, speed: Sequence[Unknown]) -> BudgetPart:
    """The part of air that does not see the body vibrate, where a bound on single flights says little: in a wake that
    sheds any small shift grows, and the shares, which are means over all phases, do not change with it.

    By how much they do was measured of bodies like the shipped rhombus (``planning.airflow_choice``). Elsewhere they
    change as the mean wake does, whose drag and base pressure differ by no more than was measured: as if the air were
    faster by that part, ``effect`` being what its ``speed`` does to the share. Any other ``part`` comes back as it is,
    and so does this one where nothing was drawn.
    """
    if part.source != VIBRATION or plan.airflow.stepping != "time-resolved":
        return part
    motion = vibration_of_scene(scene, plan.airflow.accuracy)
    if motion.used or not motion.why:
        return part
    ways: list[tuple[float, str]] = []
    if motion.moved < np.inf:
        measured = "measured: no share moved by more in air that sees the body vibrate"
        ways.append((motion.moved, f"{measured}; {motion.why}"))
    for unknown in speed if part.kind == NOT_COMPUTED else ():
        faster = f"as an air faster by {100.0 * motion.bound:.2g} %: so much may drag and base pressure differ"
        ways.append((effect.half * motion.bound * unknown.value / unknown.high, f"{faster}; {motion.why}"))
    if not ways:
        return part
    error, note = min([*ways, (part.size, part.note)])
    return replace(part, error=error, kind=LEFT_OUT, note=note)


def most_crossing(distance: Array, inside: NDArray[np.bool_], shift: float, weight: Array | float = 1.0) -> float:
    """The most by which a landing ``shift`` (body widths) could change the share of a bin, from whose ends granules
    land at a ``distance`` (n,), those that are ``inside`` (n,) among them.

    Upper 95 % limit of the share that lands within the shift inside the ends, or of that outside them where it is
    larger; where none lands so near, of the share as near as the first that does, over how many times farther off that
    is. ``weight`` (n,) of each granule, by default 1.
    """
    each = np.broadcast_to(weight, distance.shape)
    near, total = distance <= shift, round(float(each.sum()))
    if not near.any():
        return upper_limit(0, total) * max(0.0, shift) / float(distance.min(initial=np.inf))
    sides = (round(float(each[near & side].sum())) for side in (inside, ~inside))
    return upper_limit(max(sides), total)


add(LeftOutTerms())
