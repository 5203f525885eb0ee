"""Studies of the bounds and the plan's laws: what a term, an impact and an approach to a body move.

All of them are in docs/validation.md.

gates: How far each computed term moves landings next to the plan's bound on it, in scenes on which no bound was tuned:
a bound is to hold for 95 % of the granules that meet the same bodies with and without the term, half of it for their
mean. ``wake`` is the shipped rhombus in its time-resolved airflow on a coarse mesh.

injection_or_resolved: Every fraction flown with the same granules in the steady airflow (rung draft): *straight*, as if
there were no air before the body; *weighed*, with those that the air carries round the body released above it;
*resolved*, the tracker doing all impacts. *Calm*: without the random forces of the turbulence.

impaction: How many granules meet the front of a body: the plan's ideal flow, exact values, and solved airflows, with
the same drag, weight and drop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from support import CASES, as_computed, shipped
from wakeflow.air.field import FlowField
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.flight import Fate, track
from wakeflow.flight.feed.feedstock import feedstock, granules_of
from wakeflow.flight.pack import lacking_for
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.laws.forces import forces
from wakeflow.laws.impaction import Cylinder, approach
from wakeflow.planning.plan import Plan
from wakeflow.planning.terms import bounds
from wakeflow.planning.uniform_fall import deflection, front_of
from wakeflow.show.words import percent

from .common import BARE, COARSE, Pipeline, Row, make_plan, piped, separation, show

# -- gates -------------------------------------------------------------------------------------------------------------
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
    plan = as_computed(make_plan(scene, force={"basset-history": False, **BARE}))
    return Trial(scene, plan, Pipeline(scene, plan).field[1])


def gates_rows(which: str, count: int = COUNT) -> Iterator[Row]:
    """A row for every fraction and term that can act; Magnus on spheres, since point masses get no spin."""
    for spheres in (False, True):
        tried = trial(which, count, spheres=spheres)
        for name in tried.scene.fraction:
            before = tried.fly(name, BASE)
            noise, _, _ = tried.apart(before, tried.fly(name, BASE, FINER))  # the tracker's own
            for term in TERMS:
                lacking = bool(lacking_for(forces[term], tried.field))
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


def gates(*scenes: str, count: int = COUNT) -> list[Row]:
    """Bounds on terms in scenes on which none was tuned: prism, labyrinth, aspirator, wake."""
    return show(COLUMNS, (row for which in scenes or SCENES for row in gates_rows(which, count)))


# -- injection_or_resolved ---------------------------------------------------------------------------------------------
WAYS = ("straight", "weighed", "weighed, calm", "resolved, calm", "resolved")


def straight(plan: Plan) -> Plan:
    """The plan with every granule injected that would fall on the body without air."""
    return replace(plan, fractions={name: replace(how, impaction=None) for name, how in plan.fractions.items()})


def calm(plan: Plan) -> Plan:
    """The plan without dispersion and Brownian motion."""
    forces = {
        name: tuple(force for force in how.forces if force not in ("dispersion", "brownian"))
        for name, how in plan.fractions.items()
    }
    return replace(plan, fractions={n: replace(how, forces=forces[n]) for n, how in plan.fractions.items()})


def injection_rows(path: Path, count: int) -> Iterator[Row]:
    """The rows of one scene, flown with ``count`` granules of each fraction."""
    scene = wf.Scene.load(path)
    scene = scene.replace({"feed.count": count} | ({"numerics.rung": "draft"} if scene.air else {}))
    injected, resolved = (scene.replace({"feed.mode": mode}) for mode in ("injected", "resolved"))
    chosen, plan, exact = (make_plan(one, force=BARE) for one in (scene, injected, resolved))
    forces = {name: how.forces for name, how in exact.fractions.items()}
    plan = replace(plan, fractions={n: replace(how, forces=forces[n]) for n, how in plan.fractions.items()})
    flights = (
        (injected, straight(plan)),
        (injected, plan),
        (injected, calm(plan)),
        (resolved, calm(exact)),
        (resolved, exact),
    )
    found = [separation(Pipeline(*flight)).fractions for flight in flights]
    for name, how in chosen.fractions.items():
        turned = how.impaction
        air = "–" if turned is None else f"{turned.efficiency:.2f}, {turned.missed:.2f}, {turned.shift:.2g}"
        for place, last in found[-1][name].items():
            cells = {way: f"{100 * one[name][place].value:.1f}" for way, one in zip(WAYS, found, strict=True)}
            if max(map(float, cells.values())) >= 0.05:
                yield {
                    "scene": path.stem, "fraction": name, "efficiency, missed, shift": air, "plan": how.mode,
                    "bin": place, **cells, "resolved": percent(last),
                }  # fmt: skip


def injection_or_resolved(count: int = 4096, *scenes: Path) -> list[Row]:
    """Shares of injected and of resolved granules."""
    paths = scenes or sorted(CASES.glob("*.toml"))
    heads = ("scene", "fraction", "efficiency, missed, shift", "plan", "bin", *WAYS)
    return show(heads, (row for path in paths for row in injection_rows(path, count)))


# -- impaction ---------------------------------------------------------------------------------------------------------
K = np.array([0.196, 0.256, 0.4, 0.625, 0.9, 1.6, 3.6, 6.4, 10.0, 19.6])
LANGMUIR_BLODGETT = (0.018, 0.045, 0.129, 0.253, 0.358, 0.506, 0.696, 0.803, 0.864, 0.926)  # 1946, table II
EXACT = (0.01215, 0.04269, 0.12999, 0.24656, 0.35172, 0.51655, 0.71295, 0.81429, 0.87147, 0.92896)  # LSODA, 1e-10
BODIES = {
    "rhombus 25 deg": {"slope_angle": np.radians(25.0)},
    "rhombus 45 deg": {},
    "rhombus 65 deg": {"slope_angle": np.radians(65.0)},
    "prism 60 deg, apex up": {"shape": "prism", "slope_angle": np.radians(60.0)},
    "circle": {"shape": "circle", "slope_angle": None},
}
KINDS = {  # fraction.X changed
    "dust 20 um": {"material": "dust", "size": 20e-6},
    "dust 50 um": {"material": "dust", "size": 50e-6},
    "dust 100 um": {"material": "dust", "size": 100e-6},
    "chaff": {"material": "chaff"},
    "rapeseed": {"material": "rapeseed"},
    "wheat": {"material": "wheat"},
}
PLACES = 400  # granules across the body
CYLINDER = {
    "K = tau U / R": "{k:g}", "plan's ideal flow": "{plan:.4f}", "exact": "{exact:.4f}",
    "Langmuir & Blodgett 1946": "{published:.3f}",
}  # fmt: skip


def cylinder() -> list[Row]:
    """Efficiencies of the cylinder in unbounded ideal flow."""
    points = approach(
        Cylinder(1.0, 1.0), above=50.0, speed=1.0, radius=np.full(len(K), 1e-9), pull=0.0,
        relax=lambda slip: K[:, None] + 0 * slip,
    )  # fmt: skip
    found = zip(K, points.efficiency, EXACT, LANGMUIR_BLODGETT, strict=True)
    return show(CYLINDER, (dict(zip(("k", "plan", "exact", "published"), row, strict=True)) for row in found))


def scene_with(body: dict[str, object], scale: float) -> wf.Scene:
    """The rhombus scene at rest with another body and the six kinds of granules."""
    tables = shipped("rhombus").tables()
    del tables["vibration"]
    shape = {**tables["body"]["rhombus"], **body}
    tables["body"] = {"it": {key: value for key, value in shape.items() if value is not None}}
    tables["fraction"] = {f"kind{i}": row for i, row in enumerate(KINDS.values())}
    tables["numerics"] = {"rung": "draft", "mesh_scale": scale}
    return wf.Scene.parse(tables)


def in_the_airflow(scene: wf.Scene) -> Iterator[tuple[float, float, float]]:
    """Of each kind: K = tau v / h; efficiency by the ideal flow; by the tracker in the solved airflow."""
    pipeline = piped(scene, force=BARE)
    body = wf.Body(next(iter(scene.body.values())).outline(), capture=True)
    top, shoulder = body.outline[:, 1].max(), body.outline[:, 1].max() - front_of(scene).depth
    for name, how in pipeline.plan.fractions.items():
        turned, size = deflection(scene, name, how.drag, how.drag_scale), scene.fraction[name].properties.diameter
        full = 0.5 * (scene.width + size)
        place = np.stack([full * (np.arange(PLACES) + 0.5) / PLACES, np.full(PLACES, top + scene.release[0])], axis=1)
        grains = granules_of(scene, name, how, np.full(PLACES, size)).replace(position=place)
        past = np.array([(-1.0, shoulder - full), (1.0, shoulder - full)])
        tracks = track(
            pipeline.field[1], grains, until=5.0, tolerance=1e-4, length=scene.width, drag=how.drag, bodies=(body,),
            forces=("drag", "gravity", "buoyancy"), lines=(past,),
        )  # fmt: skip
        hits = (tracks.fate == Fate.CAPTURED) & (tracks.position[:, 1] > shoulder - 0.5 * size)
        yield how.stokes, turned.efficiency, float(hits.mean())


def impaction_rows(scale: float, bodies: list[str]) -> Iterator[Row]:
    """A row a body; the last one has the granules' K."""
    for body in bodies:
        found = dict(zip(KINDS, in_the_airflow(scene_with(BODIES[body], scale)), strict=True))
        cells = {kind: f"{100 * ideal:.1f} / {100 * solved:.1f}" for kind, (_, ideal, solved) in found.items()}
        yield {"body": body, **cells}
    yield {"body": "K = tau v / h", **{kind: f"{stokes:.2g}" for kind, (stokes, _, _) in found.items()}}


def impaction(scale: float = 1.0, *, quick: bool = False) -> list[Row]:
    """Impaction efficiency, airflows on meshes ``scale`` times as coarse; ``quick``: of one body."""
    cylinder()
    print()
    return show(("body", *KINDS), impaction_rows(scale, list(BODIES)[: 1 if quick else None]))
