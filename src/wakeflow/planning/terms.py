"""The plan's gate: which terms each fraction's granules are flown with, and what is left out by which bound.

All are landing shifts in body widths, made of a few scales of one fraction's flight; docs/model.md derives them. They
hold for granules that meet the same walls in the same order with and without the term; the ones that rest on an
estimate of the turbulence or of the curtain's density say so.

An accuracy asked for is a share of a fraction; a shift is a length. Before anything is computed, a fraction is taken to
spread over one body width on each side of the body that it is fed to, so a mean shift of s body widths moves about
s / (1 or 2) of it across the edge of a bin; bounds hold for 95 % of the granules, the mean shift is at most half of
them. A term is left out where its bound stays below what the accuracy allows, and the forces left out stay below half
of that together; the budget turns the bounds into shares with the landing density that was found, and adds them up.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.number import Most
from ..core.record import column
from ..core.registry import Registry, did_you_mean
from ..laws.forces import Bound, FlightScales, forces
from ..laws.forces.force import SIDEWAYS
from ..laws.forces.records import eddy_way
from ..laws.turbulence import has_no_turbulence
from ..scene import Fraction, Scene
from .collisions import why_no_collisions

# -- A-priori bounds on what each term could move ----------------------------------------------------------------------
VIBRATION, COLLISIONS, LOADING = "vibration-of-the-air", "collisions", "air-loading"
EDDIES = "eddy-acceleration"
STICKING = "sticking"  # what granules that meet do not do: the fine ones stay on the coarse
SLOWEST_LANDING = 1e-9  # m/s: keeps the slope of a track finite where a granule hangs in the air


def _shift_by_vibration(flight: FlightScales) -> float:
    if flight.shaking == 0.0:
        return 0.0
    lasting = min(flight.near, 2.0 / flight.omega)
    return flight.widths(2.0 * flight.shaking * lasting * flight.reach(flight.time) / flight.tau)


def _shift_by_collisions(flight: FlightScales) -> float:
    return min(1.0, flight.meetings) * flight.knock * flight.reach(flight.time) / flight.width


def _shift_by_loading(flight: FlightScales) -> float:
    # as wide as the curtain: the wake stretches no neighbours apart by it
    return flight.steady(flight.driven / flight.tau, flight.whole) / flight.width


def _shift_by_eddies(flight: FlightScales) -> float:
    # of an acceleration 3/2 rho/rho_p Du'/Dt the way is 3/2 rho/rho_p of the eddies' own
    return 1.5 * flight.ratio * eddy_way(flight) / flight.width


# Terms that are no force on a single granule in air at rest with its body
other_terms: Registry[Bound] = Registry("bounded term")
for _term, _shift, _why in (
    (VIBRATION, _shift_by_vibration,
     "an estimate: the air near the body swings with up to twice the body's peak speed"),
    (COLLISIONS, _shift_by_collisions,
     "kinetic theory: meetings with granules as heavy or heavier, each a kick at most as strong as a head-on one"),
    (LOADING, _shift_by_loading,
     "momentum: the air changes its speed by all that drag gives to the curtain's own stream tube"),
    (EDDIES, _shift_by_eddies,
     "pressure gradient and added mass are those of the mean air: of the eddies' own acceleration, 3/2 rho/rho_p of "
     "the way that eddies carry a tracer, 2 sqrt(2 u'^2 T_L T)"),
):  # fmt: skip
    other_terms.add(_term, Bound(_shift, _why))


class _Bounds(Mapping[str, Bound]):
    """The bounds by term: of every registered force that may be left out, then of the other terms."""

    def __getitem__(self, term: str) -> Bound:
        if term in forces and forces[term].always:
            raise KeyError(term)
        return forces[term].bound if term in forces else other_terms[term]

    def __iter__(self) -> Iterator[str]:
        yield from (term for term in forces if not forces[term].always)
        yield from other_terms

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, term: object) -> bool:
        return any(term == known for known in self)


bounds: Mapping[str, Bound] = _Bounds()


def moved_by_air(flight: FlightScales) -> float:
    """Landing shift (body widths) where drag is left out altogether: an estimate for rung none.

    Air that a granule slips through at w moves it by w (T - tau (1 - exp(-T / tau))) in a time T from the feed to
    the end: sideways at the speed it is thrown at plus what the air turns aside by, along at the largest slip, which
    counts by the slope of the track where all bins lie on the floor.
    """
    left = flight.whole - flight.tau * (1.0 - math.exp(-flight.whole / flight.tau))
    slope = 1.0 if flight.sideways_bins else min(1.0, flight.thrown / max(flight.landing, SLOWEST_LANDING))
    return (flight.thrown + SIDEWAYS * flight.air_speed + flight.slip * slope) * left / flight.width


# -- The plan's gate ---------------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
DEAR = 3.0  # weight of a term's run time against what it moves, when small terms are chosen
NOTHING = 0.05  # of the limit: a term whose bound stays below it is left out, whatever else is; chosen
TYPICAL = 0.5  # mean shift over the bound, which holds for 95 % of the granules: at most this (tests/unit/planning)
MAX_SIDES = 2  # a curtain falls on the left and the right of a body's top
AIR = "air"  # left out as a whole: in a vacuum, and at rung none
SWITCHED_OFF = "switched off by --force"
TOP = 1e-9  # body widths below the highest corner: corners within it make up the top of a body


@dataclass(frozen=True)
class LeftOut:
    """A part of the physics that is not computed. What is no term of the equation of motion is one of these itself: the
    air as a whole, or the turning of granules before they are injected.
    """

    name: str = column("", "name of the term")
    bound: Most = column("as plan.unit", "how far it could move a granule; null where that is no shift")
    why: str = column("", "why it is left out")
    fraction: str | None = column("", "fraction that it is left out for; null for all", default=None)


@dataclass(frozen=True)
class LeftOutTerm(LeftOut):
    """A term of the equation of motion that is left out: its ``name`` is one of ``bounds``, and has a switch."""


@dataclass(frozen=True)
class TermSelection:
    """What was decided for one fraction: its ``forces``, the ``bounds`` of all terms and the ``limit`` they were
    compared with (body widths), what is ``left_out``, and what is ``missing``: terms that exceed the limit, and why
    they cannot be computed.
    """

    forces: tuple[str, ...]
    bounds: Mapping[str, float]
    limit: float
    left_out: tuple[LeftOutTerm, ...]
    missing: Mapping[str, str]


# -- switches ----------------------------------------------------------------------------------------------------------


def check_switches(scene: Scene, force: Mapping[str, bool], turbulence: str) -> None:
    """Raise SceneError for a switch TERM or FRACTION.TERM that names nothing, or asks for what cannot be computed."""
    for key, on in force.items():
        fraction, _, term = key.rpartition(".")
        if fraction and fraction not in scene.fraction:
            raise SceneError(f"--force {key}: no fraction {fraction!r}{did_you_mean(fraction, list(scene.fraction))}")
        if term in _always():
            raise SceneError(f"--force {key}: {term} always acts")
        if term not in bounds:
            raise SceneError(
                f"--force {key}: unknown term{did_you_mean(term, list(bounds))} (known: {', '.join(bounds)})"
            )
        if term == COLLISIONS and fraction:
            raise SceneError(f"--force {key}: collisions are those of all fractions; leave out {fraction!r}")
        if on and (obstacle := _obstacle(scene, fraction, term, turbulence)):
            raise SceneError(f"--force {key}=on: {obstacle}")


def _obstacle(scene: Scene, fraction: str, term: str, turbulence: str) -> str:
    """Why a term cannot be switched on for a ``fraction``, or ("") for all; empty where it can."""
    if term == COLLISIONS:
        return why_no_collisions(scene, switched=True)
    if scene.air is None:
        return "a term of the air; add an [air] table"
    if term in (VIBRATION, LOADING) and not fraction:
        return ""  # a switch of the airflow, for all fractions
    if term not in forces or not forces[term].computed:
        return "this version cannot compute it; its bound is in the plan"
    if forces[term].needs == "turbulence" and has_no_turbulence(turbulence):
        return f"the airflow is laminar (Re {scene.reynolds:.3g}), it has no turbulence"
    return ""


# -- decision ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TermGate:
    """What decides for every fraction of a ``scene`` which terms it is flown with, for an accuracy of ``target`` (a
    share).

    ``switches``: terms switched by hand; ``turbulence`` of the airflow; ``together``: terms that are computed for the
    run as a whole, of all fractions together; ``no_collisions``: why collisions cannot be, empty where they can.
    ``swung``: the most that air which does not see the body vibrate changes a share by, infinite where that was not
    measured; where it was it is no doubt.
    """

    scene: Scene
    switches: Mapping[str, bool]
    target: float
    turbulence: str
    together: Collection[str] = ()
    no_collisions: str = ""
    swung: float = math.inf

    @property
    def limit(self) -> float:
        """The landing shift (body widths) below which a term is left out."""
        return limit_of(self.scene, self.target)

    def select(self, name: str, scales: Sequence[FlightScales]) -> TermSelection:
        """Decide for fraction ``name``; ``scales`` of its flight at several sizes (``approach.flights``).

        What acts on granules that turn is computed wherever a body makes them turn, however little it moves: the spin
        is known there.
        Raises SceneError where a force that this version cannot compute could move more than the accuracy asked for.
        """
        shifts = _shifts(self.scene, scales)
        shifts[VIBRATION] = min(shifts[VIBRATION], limit_of(self.scene, self.swung))
        blocked = {term: self._blocked(self.scene.fraction[name], term) for term in bounds}
        small = _small(shifts, blocked, self.limit, turning=bool(self.scene.body))
        used, left_out, missing = set(), [], {}
        for term, shift in shifts.items():
            if term in self.together:
                continue
            switched, obstacle = self.switches.get(f"{name}.{term}", self.switches.get(term)), blocked[term]
            if switched or (switched is None and term not in small and not obstacle):
                used.add(term)
                continue
            reason = self.too_small
            if switched is False:
                reason = SWITCHED_OFF
            elif term == VIBRATION and self.swung < math.inf:
                reason = f"measured: shares move by at most {self.swung:.2g} (docs/validation.md)"
            elif term not in small and obstacle:
                if term in forces and not forces[term].computed:
                    raise SceneError(self._refusal(name, term, shift))
                missing[term] = reason = obstacle
            left_out.append(LeftOutTerm(term, shift, f"{bounds[term].why}; {reason}", name))
        order = (*_always(), *(term for term in forces if term in used))
        return TermSelection(
            order, MappingProxyType(shifts), self.limit, tuple(left_out), MappingProxyType(missing)
        )  # fmt: skip

    def in_vacuum(self, name: str, collisions: float) -> TermSelection:
        """Decide for fraction ``name`` where no air is, and no choice of forces: ``collisions`` could move it so far
        (body widths).
        """
        left_out: tuple[LeftOutTerm, ...] = ()
        shift = min(self.scene.channel.width / self.scene.width, collisions)
        if COLLISIONS not in self.together:
            reason = SWITCHED_OFF if self.switches.get(COLLISIONS) is False else self.no_collisions or self.too_small
            left_out = (LeftOutTerm(COLLISIONS, shift, f"{bounds[COLLISIONS].why}; {reason}", name),)
        weight = tuple(force for force in _always() if forces[force].in_vacuum)
        return TermSelection(weight, {COLLISIONS: shift}, self.limit, left_out, {})

    @property
    def too_small(self) -> str:
        """Why a term is left out whose bound lies below the limit."""
        return f"below the {self.limit:.2g} that an accuracy of {self.target:.2g} allows"

    def _blocked(self, fraction: Fraction, term: str) -> str:
        """Why a term cannot be computed for a fraction; empty where it can."""
        if term == COLLISIONS:
            return self.no_collisions
        if term == VIBRATION:
            return f"the air sees the body at rest; --force {VIBRATION}=on moves the mesh with it (rung standard)"
        if term == LOADING:
            return "computed only where OpenFOAM solves the air about a body and feed.rate is given; lower feed.rate"
        if term not in forces:
            return "not computed in this version"
        return forces[term].blocked(
            laminar=has_no_turbulence(self.turbulence), point_mass=math.isinf(fraction.inertia)
        )  # fmt: skip

    def _refusal(self, name: str, term: str, shift: float) -> str:
        limit, target, unit = self.limit, self.target, self.scene.unit
        enough = math.ceil(1000.0 * target * shift / limit) / 1000.0
        return (
            f"{name}: {term} is not computed in this version and could move it by {shift:.2g} {unit}, more than the "
            f"{limit:.2g} that an accuracy of {target:.2g} allows; accept it with --force {name}.{term}=off, or ask "
            f"for --target-error {enough:g}"
        )


def _always() -> tuple[str, ...]:
    """The forces that act in every flight."""
    return tuple(name for name in forces if forces[name].always)


def _shifts(scene: Scene, scales: Sequence[FlightScales]) -> dict[str, float]:
    """The largest landing shift (body widths) by each term; nothing lands farther off than the channel is wide."""
    channel = scene.channel
    widest = channel.width if scene.body else max(channel.width, channel.top - channel.bottom)
    return {term: min(widest / scene.width, max(bounds[term].shift(flight) for flight in scales)) for term in bounds}


def limit_of(scene: Scene, target: float) -> float:
    """The landing shift (body widths) below which a term is left out for an accuracy of ``target`` (a share)."""
    return target * _sides(scene) / TYPICAL


def _small(shifts: Mapping[str, float], blocked: Mapping[str, str], limit: float, *, turning: bool) -> set[str]:
    """Terms small enough to be left out: those below ``limit``, and of those that can be computed, smallest for their
    cost first, only as many as keep the forces left out below half of it together, or what is lost beside it (NOTHING).
    What acts on granules that turn is not among them where a body makes them turn (``turning``).
    """

    def worth(term: str) -> float:
        """What a second for it buys: a force that costs as much as a flight counts as a quarter of what it moves."""
        return shifts[term] / (1.0 + DEAR * (forces[term].effort if term in forces else 0.0))

    below = sorted((term for term, shift in shifts.items() if shift <= limit), key=worth)
    small = {term for term in below if blocked[term]}
    total = sum(shifts[term] for term in below if term in small and term in forces)
    for term in below:
        if term not in small and (total + shifts[term] <= 0.5 * limit or shifts[term] <= NOTHING * limit):
            small.add(term)
            total += shifts[term]
    acting = {term for term in small if term in forces and forces[term].turns and not blocked[term]}
    return small - acting if turning else small


def _sides(scene: Scene) -> int:
    """Number of sides of the body on which the curtain is thrown: 2 where it falls on both sides of the body's top."""
    if not scene.body:
        return 1
    outline = scene.outline
    top = outline[np.isclose(outline[:, 1], outline[:, 1].max(), atol=TOP * scene.width), 0]
    return MAX_SIDES if abs(scene.feed.position - top.mean()) < 0.5 * scene.feed.width else 1
