"""How far each computed term moves landings next to the plan's bound on it, in scenes on which no bound was tuned.

A bound is to hold for 95 % of the granules that meet walls as often and land on the same side with and without the
term, and half of it for the mean of these 95 %: of the rest some meet other walls. ``wake`` is the shipped rhombus in
its time-resolved airflow on a coarse mesh. Some minutes a scene; docs/validation.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.field import FlowField
from wakeflow.injection.feed import feedstock
from wakeflow.laws.forces import forces
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.plan import Plan
from wakeflow.planning.terms import bounds

from .common import BARE, COARSE, Pipeline, Row, make_plan, show

SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, COARSE[name]) for name in ("prism", "labyrinth", "aspirator")},
    "wake": ("rhombus", {"numerics.rung": "standard", "numerics.mesh_scale": 2.5}),
}
BASE = ("drag", "gravity", "buoyancy", "pressure-gradient")
TERMS = tuple(name for name in forces if forces[name].computed and name in bounds)
COUNT, TOLERANCE, FINER = 256, 1e-6, 1e-7
TYPICAL = 0.5  # mean shift over the bound, at most
COLUMNS = {
    "scene": "{scene}", "fraction": "{fraction}", "term": "{term}", "bound": "{bound:.2g}",
    "95 % move by": "{most:.2g}", "bound over that": "{ratio:.2g}{holds:| **exceeded**}",
    "mean over bound": "{typical:.2g}", "same bodies": "{same:.2f}",
}  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """A scene, its plan and field; flights of its fractions with forces as asked."""

    scene: wf.Scene
    plan: Plan
    field: FlowField

    def fly(self, name: str, terms: tuple[str, ...], tolerance: float = TOLERANCE) -> wf.Tracks:
        """Tracks of the fraction's first granules."""
        plan = self.plan.with_forces(terms)
        grains = feedstock(self.scene, plan, name, self.field.period).granules
        return Flight(self.scene, plan, Realisations(self.field), tolerance).fly(name, grains)

    def apart(self, one: wf.Tracks, other: wf.Tracks) -> tuple[float, float, float]:
        """How far landings lie apart, body widths, of granules that pass the same bodies: what 95 % are below, the
        mean of these; and the share of such granules.
        """
        same = (one.impacts == other.impacts) & (one.line == other.line)
        if self.scene.body:
            same &= one.position[:, 0] * other.position[:, 0] > 0.0
        shift = np.linalg.norm(one.position - other.position, axis=1)[same] / self.scene.width
        if not len(shift):
            return 0.0, 0.0, 0.0
        most = np.percentile(shift, 95)
        return float(most), float(shift[shift <= most].mean()), float(same.mean())


def trial(which: str, count: int = COUNT, *, spheres: bool = False) -> Trial:
    """One of SCENES with ``count`` granules a fraction, as ``spheres`` that an impact turns where asked."""
    name, changes = SCENES[which]
    scene = shipped(name, {"feed.count": count, **changes})
    if spheres:
        scene = scene.replace({f"fraction.{fraction}.impact": "sphere" for fraction in scene.fraction})
    plan = make_plan(scene, force={"basset-history": False, **BARE}).as_computed()
    return Trial(scene, plan, Pipeline(scene, plan).field[1])


def rows(which: str, count: int = COUNT) -> Iterator[Row]:
    """A row for every fraction and term that can act; Magnus on spheres, since point masses get no spin."""
    for spheres in (False, True):
        tried = trial(which, count, spheres=spheres)
        for name in tried.scene.fraction:
            before = tried.fly(name, BASE)
            noise, _, _ = tried.apart(before, tried.fly(name, BASE, FINER))  # the tracker's own
            for term in TERMS:
                lacking = forces[term].lacks(tried.field) is not None
                if not (lacking or (term == "magnus") != spheres or (term == "magnus" and not tried.scene.body)):
                    yield {"scene": which, "fraction": name, **_moved(tried, name, term, before, noise)}


def _moved(tried: Trial, name: str, term: str, before: wf.Tracks, noise: float) -> Row:
    switched = tuple(t for t in BASE if t != term) if term in BASE else (*BASE, term)
    most, mean, same = tried.apart(before, tried.fly(name, switched))
    bound, real = tried.plan.fractions[name].bounds[term], most > 3.0 * noise
    return {
        "term": term, "bound": bound, "most": most, "mean": mean, "same": same, "real": real,
        "ratio": bound / most if real else None, "typical": mean / bound if real and bound else None,
        "holds": max(most, mean) <= max(bound, 3.0 * noise),
    }  # fmt: skip


def main(*scenes: str, count: int = COUNT) -> list[Row]:
    """Bounds on terms in scenes on which none was tuned: prism, labyrinth, aspirator, wake."""
    return show(COLUMNS, (row for which in scenes or SCENES for row in rows(which, count)))
