"""The forces as objects: their records fit the kernel, and a new force needs nothing but its record.

That the compiled terms are the formulas of the records is shown by the exact problems (tests/proofs/problems).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import wakeflow as wf
from proofs.problems.exact import Setting, box, field_on
from proofs.problems.reference_all_terms import reference_end_states
from support import CASES
from wakeflow.core.errors import SceneError
from wakeflow.laws.forces import Bound, FlightScales, Force, Instant, forces
from wakeflow.laws.forces.record import AirProperties, Array, Grains, Vector
from wakeflow.planning.make import make_plan
from wakeflow.planning.terms import bounds, other_terms
from wakeflow.scene import Scene
from wakeflow.tracking.kernel import layout
from wakeflow.tracking.pack import pack_granules

COMPUTED = [name for name in forces if forces[name].computed]
STILL = field_on(box(4), np.zeros_like, pressure=np.zeros(len(box(4)[0])))


def grains_of(count: int) -> wf.Granules:
    rng = np.random.default_rng(7)
    start, speed = rng.uniform(-0.2, 0.2, (count, 2)), rng.uniform(-0.3, 0.3, (count, 2))
    return wf.Granules(start, speed, rng.uniform(1e-4, 3e-3, count), rng.uniform(20.0, 2000.0, count), inertia=0.4)


@pytest.mark.parametrize("name", COMPUTED)
def test_slots_of_a_force_are_places_of_the_kernels_granule(name: str) -> None:
    force, grains = forces[name], grains_of(5)
    slots = {**(force.factors(grains, STILL) if force.factors else {})}
    slots |= force.constants(grains, STILL) if force.constants else {}
    places = [getattr(layout, slot) for slot in slots]
    assert all(0 <= place < layout.CONSTANTS for place in places)
    assert slots or force.acceleration is not None
    taken = [slot for other in COMPUTED if other != name for slot in _slots(forces[other], grains)]
    assert not set(slots) & set(taken)  # no two forces fill the same place


def _slots(force: Force, grains: wf.Granules) -> list[str]:
    parts = [make(grains, STILL) for make in (force.factors, force.constants) if make is not None]
    return [slot for part in parts for slot in part]


@pytest.mark.parametrize("name", COMPUTED)
def test_a_force_that_is_not_random_has_a_formula_for_the_reference_integrator(name: str) -> None:
    assert forces[name].random or forces[name].reference is not None or forces[name].memory is not None


def test_a_record_carries_its_own_name_and_the_order_is_that_of_plans() -> None:
    assert all(forces[name].name == name for name in forces)
    assert [name for name in forces if forces[name].always] == ["drag", "gravity"]
    assert list(bounds) == [*list(forces)[2:], *other_terms]
    assert len(bounds) == len(list(bounds))
    assert "drag" not in bounds


def test_what_a_field_lacks_is_named() -> None:
    calm = field_on(box(2), np.zeros_like)
    assert "pressure" in str(forces["pressure-gradient"].lacks(calm))
    assert "dissipation" in str(forces["dispersion"].lacks(calm))
    assert forces["drag"].lacks(calm) is None
    with pytest.raises(SceneError, match="needs a field with pressure"):
        wf.track(calm, grains_of(1), until=0.1, forces=("pressure-gradient",))


def test_added_mass_divides_every_acceleration() -> None:
    grains = grains_of(6)
    alone, heavy = (
        pack_granules(grains, STILL, terms, (0.0, -9.81))
        for terms in (("drag", "gravity", "lift"), ("drag", "gravity", "lift", "added-mass"))
    )
    inertia = 1.0 + 0.5 * STILL.density / grains.density
    for slot in ("GX", "GY", "STOKES", "LIFT"):
        column = getattr(layout, slot)
        np.testing.assert_allclose(heavy[:, column] * inertia, alone[:, column], rtol=1e-14)


PUSH = np.array([3.0, 0.5])  # m/s2: charge times field over mass


def _push(grains: Grains, _air: AirProperties | None, _gravity: Array) -> Array:
    return np.tile(PUSH, (len(grains), 1))


def _shift(flight: FlightScales) -> float:
    return flight.widths(flight.steady(float(np.hypot(*PUSH)), flight.whole))


def _reference(_now: Instant) -> Vector:
    return float(PUSH[0]), float(PUSH[1])


ELECTRIC = Force(
    name="electric",
    means="uniform electric field on equally charged granules",
    source="Coulomb",
    needs="nothing",
    calm=True,
    bound=Bound(_shift, "charge times field over mass, over the whole flight"),
    acceleration=_push,
    reference=_reference,
)


@pytest.fixture
def electric() -> Iterator[str]:
    forces.add(ELECTRIC.name, ELECTRIC)
    try:
        yield ELECTRIC.name
    finally:
        forces.remove(ELECTRIC.name)


@pytest.mark.parametrize("field", [None, STILL], ids=["vacuum", "air"])
def test_granules_under_a_new_constant_force_fly_in_parabolas(electric: str, field: wf.FlowField | None) -> None:
    grains, t, pull = grains_of(8), 0.2, np.add(PUSH, (0.0, -9.81))
    tracks = wf.track(field, grains, until=t, forces=("gravity", electric), tolerance=1e-8)
    np.testing.assert_allclose(tracks.position, grains.position + t * grains.velocity + 0.5 * t * t * pull, atol=1e-12)
    np.testing.assert_allclose(tracks.velocity, grains.velocity + t * pull, atol=1e-12)
    without = wf.track(field, grains, until=t, forces=("gravity",), tolerance=1e-8)
    np.testing.assert_allclose(tracks.position - without.position, np.tile(0.5 * t * t * PUSH, (8, 1)), atol=1e-12)


def test_the_reference_integrator_knows_a_new_force(electric: str) -> None:
    grains, t = grains_of(3), 0.15
    setting = Setting(STILL, grains, t, {"forces": ("drag", "gravity", "added-mass", electric), "drag": "stokes"})
    tracks = wf.track(STILL, grains, until=t, tolerance=1e-9, **setting.arguments)
    np.testing.assert_allclose(tracks.position, reference_end_states(setting)[:, :2], atol=1e-8)


def test_a_new_force_is_bounded_in_the_plan_and_flown_where_it_matters(electric: str) -> None:
    scene = Scene.load(CASES / "rhombus.toml", {"numerics.rung": "draft"})
    for fraction in make_plan(scene).fractions.values():
        assert fraction.bounds[electric] > 0.0
        assert fraction.forces[-1] == electric
    off = make_plan(scene, force={electric: False})
    assert all(electric not in fraction.forces for fraction in off.fractions.values())
    assert {row.fraction for row in off.left_out if row.name == electric} == set(scene.fraction)


def test_a_force_that_is_only_bounded_is_not_flown_and_refuses_a_scene_that_needs_it(electric: str) -> None:
    forces.remove(electric)
    forces.add(electric, replace(ELECTRIC, computed=False))
    with pytest.raises(SceneError, match="only bounded, not computed"):
        wf.track(STILL, grains_of(1), until=0.1, forces=(electric,))
    scene = Scene.load(CASES / "rhombus.toml", {"numerics.rung": "draft"})
    with pytest.raises(SceneError, match=r"dust: electric is not computed .* --force dust.electric=off") as caught:
        make_plan(scene)
    assert "\n" not in str(caught.value)
    with pytest.raises(SceneError, match="cannot compute it"):
        make_plan(scene, force={electric: True})
    rows = [row for row in make_plan(scene, force={electric: False}).left_out if row.name == electric]
    assert {row.fraction for row in rows} == set(scene.fraction)
    assert all("switched off by --force" in row.why for row in rows)
