"""A-priori bounds on what each term could move: those of the forces, and of what a plan leaves out beside them.

All are landing shifts in body widths, made of a few scales of one fraction's flight; docs/model.md derives them. They
hold for granules that meet the same walls in the same order with and without the term; the ones that rest on an
estimate of the turbulence or of the curtain's density say so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from ..core.registry import Registry
from ..laws.forces import Bound, FlightScales, forces
from ..laws.forces.scales import SIDEWAYS

__all__ = ["COLLISIONS", "LOADING", "VIBRATION", "bounds", "moved_by_air", "other_terms"]

VIBRATION, COLLISIONS, LOADING = "vibration-of-the-air", "collisions", "air-loading"
SLOWEST_LANDING = 1e-9  # m/s: keeps the slope of a track finite where a granule hangs in the air


def _shift_by_vibration(flight: FlightScales) -> float:
    if flight.shaking == 0.0:
        return 0.0
    lasting = min(flight.near, 2.0 / flight.omega)
    return flight.widths(2.0 * flight.shaking * lasting * flight.reach(flight.time) / flight.tau)


def _shift_by_collisions(flight: FlightScales) -> float:
    return min(1.0, flight.meetings) * flight.knock * flight.reach(flight.time) / flight.width


def _shift_by_loading(flight: FlightScales) -> float:
    change = flight.slowed * flight.air_speed  # as wide as the curtain: the wake stretches no neighbours apart by it
    return flight.steady(change / flight.tau, flight.whole) / flight.width


# Terms that are no force on a single granule in air at rest with its body
other_terms: Registry[Bound] = Registry("bounded term")
other_terms.add(
    VIBRATION,
    Bound(_shift_by_vibration, "an estimate: the air near the body swings with up to twice the body's peak speed"),
)
other_terms.add(
    COLLISIONS,
    Bound(
        _shift_by_collisions,
        "kinetic theory: meetings with granules as heavy or heavier, each a kick at most as strong as a head-on one",
    ),
)
other_terms.add(
    LOADING,
    Bound(_shift_by_loading, "momentum: the air is slower by all that drag takes from the curtain's own stream tube"),
)


class _Bounds(Mapping[str, Bound]):
    """The bounds by term: of every registered force that may be left out, then of the other terms."""

    def __getitem__(self, term: str) -> Bound:
        bound = forces[term].bound if term in forces else other_terms[term]
        if bound is None:
            raise KeyError(term)
        return bound

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
