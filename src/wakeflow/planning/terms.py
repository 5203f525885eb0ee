"""The plan's gate: which terms each fraction's granules are flown with, and what is left out by which bound.

An accuracy asked for is a share of a fraction; a shift is a length. Before anything is computed, a fraction is taken to
spread over one body width on each side of the body that it is fed to, so a mean shift of s body widths moves about
s / (1 or 2) of it across the edge of a bin; bounds hold for 95 % of the granules, the mean shift is at most half of
them. A term is left out where its bound stays below what the accuracy allows, and the forces left out stay below half
of that together; the budget turns the bounds into shares with the landing density that was found, and adds them up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.registry import did_you_mean
from ..laws.forces import forces
from ..scene import Fraction, Scene
from .bounds import Flight, bounds

__all__ = ["TYPICAL", "VIBRATION", "Gate", "LeftOut", "check_switches", "limit_of", "open_gate"]

Array = NDArray[np.float64]
ALWAYS = ("drag", "gravity")
VIBRATION = "vibration-of-the-air"
NOTHING = 0.05  # of the limit: a term below is left out whatever else is
TYPICAL = 0.5  # mean shift over the bound, at most


@dataclass(frozen=True)
class LeftOut:
    """A term that is not computed for a ``fraction``: the bound on what it would move (body widths; None: not a
    shift) and why it is left out.
    """

    name: str
    bound: float | None
    why: str
    fraction: str | None = None


@dataclass(frozen=True)
class Gate:
    """What was decided for one fraction: its ``forces``, the ``bounds`` of all terms and the ``limit`` they were
    compared with (body widths), what is ``left_out``, and what is ``missing``: terms that exceed the limit, and why
    they cannot be computed.
    """

    forces: tuple[str, ...]
    bounds: dict[str, float]
    limit: float
    left_out: list[LeftOut] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)


# -- switches ----------------------------------------------------------------------------------------------------------


def check_switches(scene: Scene, force: Mapping[str, bool], turbulence: str | None) -> None:
    """Raise SceneError for a switch TERM or FRACTION.TERM that names nothing, or asks for what cannot be computed."""
    for key, on in force.items():
        fraction, _, term = key.rpartition(".")
        if fraction and fraction not in scene.fraction:
            raise SceneError(f"--force {key}: no fraction {fraction!r}{did_you_mean(fraction, list(scene.fraction))}")
        if term in ALWAYS:
            raise SceneError(f"--force {key}: {term} always acts")
        if term not in bounds:
            raise SceneError(
                f"--force {key}: unknown term{did_you_mean(term, list(bounds))} (known: {', '.join(bounds)})"
            )
        if not on:
            continue
        if scene.air is None:
            raise SceneError(f"--force {key}=on: a term of the air; add an [air] table")
        if term == VIBRATION and not fraction:
            continue  # of the airflow, for all fractions
        if term not in forces or not forces[term].computed:
            raise SceneError(f"--force {key}=on: this version cannot compute it; its bound is in the plan")
        if forces[term].needs == "turbulence" and turbulence == "laminar":
            raise SceneError(
                f"--force {key}=on: the airflow is laminar (Re {scene.reynolds:.3g}), it has no turbulence"
            )


def _switch(force: Mapping[str, bool], fraction: str, term: str) -> bool | None:
    """What was asked for a term of one fraction; FRACTION.TERM goes before TERM, None: nothing."""
    return force.get(f"{fraction}.{term}", force.get(term))


# -- decision ----------------------------------------------------------------------------------------------------------


def open_gate(
    scene: Scene,
    name: str,
    found: list[Flight],
    force: Mapping[str, bool],
    target: float,
    turbulence: str | None,
    *,
    moving: bool = False,
) -> Gate:
    """Decide for fraction ``name``; ``found``: its flights at several sizes (``scales.flights``); ``target`` a share;
    ``moving``: the airflow is computed round bodies that vibrate.

    Raises SceneError where a force that this version cannot compute could move more than the accuracy asked for.
    """
    channel = scene.channel
    widest = channel.width / scene.width  # nothing lands farther off
    if not scene.body:
        widest = max(widest, (channel.top - channel.bottom) / scene.width)
    sizes = {term: min(widest, max(bounds[term].shift(f) for f in found)) for term in bounds}
    blocked = {term: _blocked(scene.fraction[name], term, turbulence) for term in bounds}
    gate = Gate(ALWAYS, sizes, limit_of(scene, target))
    small = _small(sizes, blocked, gate.limit)
    used = []
    for term, size in sizes.items():
        if moving and term == VIBRATION:
            continue
        asked = _switch(force, name, term)
        if asked or (asked is None and term not in small and blocked[term] is None):
            used.append(term)
            continue
        reason = "switched off by --force" if asked is False else None if term in small else blocked[term]
        if reason is None:
            reason = f"below the {gate.limit:.2g} that an accuracy of {target:.2g} allows"
        gate.left_out.append(LeftOut(term, size, f"{bounds[term].why}; {reason}", name))
        if asked is None and term not in small:
            if term in forces and not forces[term].computed:
                raise SceneError(_refusal(name, term, size, gate.limit, target, scene.unit))
            gate.missing[term] = blocked[term] or ""
    order = [term for term in forces if term in used]
    return Gate((*ALWAYS, *order), sizes, gate.limit, gate.left_out, gate.missing)


def limit_of(scene: Scene, target: float) -> float:
    """The landing shift (body widths) below which a term is left out for an accuracy of ``target`` (a share)."""
    return target * _sides(scene) / TYPICAL


def _small(sizes: Mapping[str, float], blocked: Mapping[str, str | None], limit: float) -> set[str]:
    """Terms small enough to be left out: those below ``limit``, and of those that can be computed, smallest first,
    only as many as keep the forces left out below half of it together, or what is lost beside it (NOTHING).
    """
    below = sorted((term for term, size in sizes.items() if size <= limit), key=lambda term: sizes[term])
    small = {term for term in below if blocked[term] is not None}
    total = sum(sizes[term] for term in small if term in forces)
    for term in below:
        if term not in small and (total + sizes[term] <= 0.5 * limit or sizes[term] <= NOTHING * limit):
            small.add(term)
            total += sizes[term]
    return small


def _blocked(fraction: Fraction, term: str, turbulence: str | None) -> str | None:
    """Why a term cannot be computed for a fraction; None where it can."""
    if term == VIBRATION:
        return f"the air sees the body at rest; --force {VIBRATION}=on moves the mesh with it (rung standard)"
    if term not in forces or not forces[term].computed:
        return "not computed in this version"
    if forces[term].needs == "turbulence" and turbulence == "laminar":
        return "the airflow is laminar and brings no turbulence"
    if term == "magnus" and fraction.inertia is None:
        return "a point mass gets no spin at the body; impact = 'sphere' gives it one"
    return None


def _refusal(name: str, term: str, size: float, limit: float, target: float, unit: str) -> str:
    enough = math.ceil(1000.0 * target * size / limit) / 1000.0
    return (
        f"{name}: {term} is not computed in this version and could move it by {size:.2g} {unit}, more than the "
        f"{limit:.2g} that an accuracy of {target:.2g} allows; accept it with --force {name}.{term}=off, or ask for "
        f"--target-error {enough:g}"
    )


def _sides(scene: Scene) -> int:
    """On how many sides of the body the curtain is thrown: 2 where it falls on both sides of the body's top."""
    outline = scene.first_outline
    if outline is None:
        return 1
    top = outline[np.isclose(outline[:, 1], outline[:, 1].max(), atol=1e-9 * scene.width), 0]
    return 2 if abs(scene.feed.position - top.mean()) < 0.5 * scene.feed.width else 1
