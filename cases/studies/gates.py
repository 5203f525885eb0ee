"""Print how far each computed term moves landings beside the plan's bound on it, in scenes on which no bound was tuned:

.venv/bin/python cases/studies/gates.py [SCENE ...]     # prism labyrinth aspirator wake; some minutes each

A bound is to hold for 95 % of the granules that meet walls as often and land on the same side with and without the
term, and half of it for the mean of these 95 %: of the rest some meet other walls. ``wake`` is the shipped
rhombus in its time-resolved airflow on a coarse mesh.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import wakeflow as wf
from wakeflow.field import FlowField
from wakeflow.injection.feed import feedstock
from wakeflow.laws.forces import forces
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.bounds import bounds
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import Plan

CASES = Path(__file__).parents[1]
OFF = {"basset-history": False, "air-loading": False}
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "prism": ("prism", {"numerics.mesh_scale": 2.0}),
    "labyrinth": ("labyrinth", {"numerics.mesh_scale": 2.5}),
    "aspirator": ("aspirator", {}),
    "wake": ("rhombus", {"numerics.rung": "standard", "numerics.mesh_scale": 2.5}),
}
BASE = ("drag", "gravity", "buoyancy", "pressure-gradient")
TERMS = tuple(name for name in forces if forces[name].computed and name in bounds)
COUNT, TOLERANCE, FINER = 256, 1e-6, 1e-7
TYPICAL = 0.5  # mean shift over the bound, at most


class Row(NamedTuple):
    """What a term moves a fraction by, body widths: its ``bound``, what 95 % move less than, their ``mean``, the
    ``noise`` of the tracker in the first; ``same``: share of the granules that are
    compared.
    """

    scene: str
    fraction: str
    term: str
    bound: float
    most: float
    mean: float
    noise: float
    same: float

    @property
    def holds(self) -> bool:
        """Whether the bound does, or what was found is the tracker's own error."""
        return self.most <= max(self.bound, 3.0 * self.noise) and self.mean <= max(self.bound, 3.0 * self.noise)


@dataclass(frozen=True)
class Trial:
    """A scene, its plan and field; flights of its fractions with forces as told."""

    scene: wf.Scene
    plan: Plan
    field: FlowField

    def fly(self, name: str, terms: tuple[str, ...], tolerance: float = TOLERANCE) -> wf.Tracks:
        """Tracks of the fraction's first granules."""
        plan = self.plan.with_forces(terms)
        grains = feedstock(self.scene, plan, name, self.field.period).granules
        return Flight(self.scene, plan, Realisations(self.field), tolerance).fly(name, grains)


def trial(which: str, count: int = COUNT, *, spheres: bool = False) -> Trial:
    """One of SCENES with ``count`` granules a fraction, as ``spheres`` that a blow turns where asked."""
    name, changes = SCENES[which]
    scene = wf.Scene.load(CASES / f"{name}.toml", {"feed.count": count, **changes})
    if spheres:
        scene = scene.replace({f"fraction.{fraction}.impact": "sphere" for fraction in scene.fraction})
    plan = make_plan(scene, force=OFF).as_computed()
    return Trial(scene, plan, Pipeline(scene, plan).field[1])


def rows(which: str, count: int = COUNT) -> Iterator[Row]:
    """A row for every fraction and term that can act; Magnus on spheres, since point masses get no spin."""
    for spheres in (False, True):
        tried = trial(which, count, spheres=spheres)
        for name in tried.scene.fraction:
            before = tried.fly(name, BASE)
            again = tried.fly(name, BASE, FINER)
            for term in TERMS:
                lacking = forces[term].lacks(tried.field) is not None
                if lacking or (term == "magnus") != spheres or (term == "magnus" and not tried.scene.body):
                    continue
                yield _row(which, tried, name, term, before, again)


def _row(which: str, tried: Trial, name: str, term: str, before: wf.Tracks, again: wf.Tracks) -> Row:
    switched = tuple(t for t in BASE if t != term) if term in BASE else (*BASE, term)
    shift, same = _moved(tried, before, tried.fly(name, switched))
    noise, _ = _moved(tried, before, again)
    most = float(np.percentile(shift, 95)) if len(shift) else 0.0
    found = most, float(shift[shift <= most].mean()) if len(shift) else 0.0
    within = float(np.percentile(noise, 95)) if len(noise) else 0.0
    return Row(which, name, term, tried.plan.fractions[name].bounds[term], *found, within, same)


def _moved(tried: Trial, one: wf.Tracks, other: wf.Tracks) -> tuple[np.ndarray, float]:
    """How far landings lie apart (body widths), of granules that pass the same bodies; and their share."""
    same = (one.impacts == other.impacts) & (one.line == other.line)
    if tried.scene.body:
        same &= one.position[:, 0] * other.position[:, 0] > 0.0
    apart = np.linalg.norm(one.position - other.position, axis=1) / tried.scene.width
    return apart[same], float(same.mean())


def main(chosen: list[str], count: int = COUNT) -> list[Row]:
    """Print a table for each of the ``chosen`` scenes; returns all rows."""
    print("| scene | fraction | term | bound | 95 % move by | bound over that | mean over bound | same bodies |")
    print("|---|---|---|---|---|---|---|---|")
    found = []
    for which in chosen:
        for row in rows(which, count):
            found.append(row)
            real = row.most > 3.0 * row.noise
            ratio = f"{row.bound / row.most:.2g}" if real else "–"
            mean = f"{row.mean / row.bound:.2g}" if real and row.bound else "–"
            said = "" if row.holds else " **exceeded**"
            print(
                f"| {row.scene} | {row.fraction} | {row.term} | {row.bound:.2g} | {row.most:.2g} | {ratio}{said} | "
                f"{mean} | {row.same:.2f} |", flush=True,
            )  # fmt: skip
    return found


if __name__ == "__main__":
    main(sys.argv[1:] or list(SCENES))
