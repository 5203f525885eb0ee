"""The forces as objects: their records fit the kernel, and a new force needs nothing but its record.

That the compiled terms are the formulas of the records is shown by the exact problems (tests/proofs/problems).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import wakeflow as wf
from proofs.problems.exact import Setting, box, field_on
from proofs.problems.reference_all_terms import reference_end_states, scalar_drag
from support import CASES
from wakeflow.core.errors import SceneError
from wakeflow.flight.kernel import layout
from wakeflow.flight.pack import check_forces, pack_granules
from wakeflow.laws.drag import (
    drag_factor_for_terminal_velocity,
    drag_laws,
    relaxation_time,
    slip_correction,
    terminal_velocity,
)
from wakeflow.laws.forces import Bound, FlightScales, Force, Instant, forces
from wakeflow.laws.forces.force import AirProperties, Array, Grains, Vector
from wakeflow.planning.terms import bounds, other_terms
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

COMPUTED = [name for name in forces if forces[name].computed]
STILL = field_on(box(4), np.zeros_like, pressure=np.zeros(len(box(4)[0])))


def grains_of(count: int) -> wf.Granules:
    rng = np.random.default_rng(7)
    start, speed = rng.uniform(-0.2, 0.2, (count, 2)), rng.uniform(-0.3, 0.3, (count, 2))
    return wf.Granules(start, speed, rng.uniform(1e-4, 3e-3, count), rng.uniform(20.0, 2000.0, count), inertia=0.4)


@pytest.mark.parametrize("name", COMPUTED)
def test_slots_of_a_force_are_places_of_the_kernels_granule(name: str) -> None:
    force, grains = forces[name], grains_of(5)
    slots = {**force.factors(grains, STILL), **force.constants(grains, STILL)}
    places = [getattr(layout, slot) for slot in slots]
    assert all(0 <= place < layout.CONSTANTS for place in places)
    assert slots or force.acceleration is not Force.acceleration
    taken = [slot for other in COMPUTED if other != name for slot in _slots(forces[other], grains)]
    assert not set(slots) & set(taken)  # no two forces fill the same place


def _slots(force: Force, grains: wf.Granules) -> list[str]:
    return [*force.factors(grains, STILL), *force.constants(grains, STILL)]


@pytest.mark.parametrize("name", COMPUTED)
def test_a_force_that_is_not_random_has_a_formula_for_the_reference_integrator(name: str) -> None:
    force = forces[name]
    assert force.random or force.reference is not Force.reference or force.memory is not Force.memory


def test_a_record_carries_its_own_name_and_the_order_is_that_of_plans() -> None:
    assert all(forces[name].name == name for name in forces)
    assert [name for name in forces if forces[name].always] == ["drag", "gravity"]
    assert list(bounds) == [*list(forces)[2:], *other_terms]
    assert len(bounds) == len(list(bounds))
    assert "drag" not in bounds


def test_what_a_field_lacks_is_named() -> None:
    calm = field_on(box(2), np.zeros_like)
    check_forces(("drag",), calm)
    with pytest.raises(SceneError, match="dispersion needs a field with k and dissipation"):
        check_forces(("dispersion",), calm)
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


def _push(grains: Grains, _air: AirProperties, _gravity: Array) -> Array:
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


CHECKED = [0.1, 1.0, 10.0, 100.0, 500.0, 1000.0, 1e4, 1e5]
COEFFICIENTS = {  # Cd of a sphere at CHECKED, computed independently from the published formulas
    "schiller-naumann": [247.401, 27.6000, 4.1511, 1.0917, 0.5627, 0.4400, 0.4400, 0.4400],
    "putnam": [248.618, 28.0000, 4.2566, 1.1018, 0.5520, 0.4240, 0.4240, 0.4240],
    "clift-gauvin": [247.675, 27.6481, 4.1347, 1.0704, 0.5646, 0.4639, 0.4103, 0.4675],
    "brown-lawler": [247.504, 27.6000, 4.1275, 1.0731, 0.5659, 0.4634, 0.4106, 0.4661],
    "haider-levenspiel": [249.796, 28.3345, 4.3185, 1.0947, 0.5568, 0.4535, 0.4204, 0.4715],
}


@pytest.mark.parametrize("law", sorted(COEFFICIENTS))
def test_published_drag_coefficients(law: str) -> None:
    reynolds = np.array(CHECKED)
    cd = drag_laws[law].factor(reynolds, 1.0) * 24.0 / reynolds
    np.testing.assert_allclose(cd, COEFFICIENTS[law], rtol=5e-5, atol=6e-5)


SHAPED = {  # Cd at Re 1, 100, 1000 by sphericity, computed independently from the published formulas
    ("haider-levenspiel", 0.9): [29.355, 1.1326, 0.7024],
    ("haider-levenspiel", 0.7): [32.909, 1.7187, 1.9239],
    ("haider-levenspiel", 0.5): [42.036, 3.2341, 3.5920],
    ("ganser", 0.9): [29.198, 1.1892, 0.7559],
    ("ganser", 0.7): [34.291, 1.9274, 1.6485],
    ("ganser", 0.5): [42.198, 3.2530, 3.4191],
}


@pytest.mark.parametrize(("law", "sphericity"), sorted(SHAPED))
def test_published_drag_coefficients_of_shapes(law: str, sphericity: float) -> None:
    reynolds = np.array([1.0, 100.0, 1000.0])
    cd = drag_laws[law].factor(reynolds, sphericity) * 24.0 / reynolds
    np.testing.assert_allclose(cd, SHAPED[law, sphericity], rtol=5e-5, atol=6e-5)


def test_gansers_creeping_limit_is_his_shape_factor_and_his_logarithm_has_base_10() -> None:
    phi = np.array([1.0, 0.9, 0.67, 0.3])
    np.testing.assert_allclose(drag_laws["ganser"].factor(np.zeros(4), phi), 1 / 3 + 2 / 3 / np.sqrt(phi), rtol=1e-15)
    v = float(terminal_velocity(160e-6, 2600, 1.2, 1.8e-5, 9.81, "ganser", 0.67))
    reynolds = 1.2 * v * 160e-6 / 1.8e-5
    assert (v, reynolds) == (pytest.approx(0.8129, abs=5e-5), pytest.approx(8.671, abs=5e-4))
    assert float(drag_laws["ganser"].factor(np.array([reynolds]), 0.67)[0]) * 24 / reynolds == pytest.approx(
        6.859, abs=5e-4
    )


@pytest.mark.parametrize("law", list(drag_laws))
def test_every_law_tends_to_stokes_and_never_lies_below_it(law: str) -> None:
    entry = drag_laws[law]
    assert entry.factor(np.array([0.0]), 1.0)[0] == 1.0
    for phi in (1.0, 0.7) if entry.uses_sphericity else (1.0,):
        creeping = entry.factor(np.array([0.0]), phi)
        np.testing.assert_allclose(entry.factor(np.array([1e-12]), phi), creeping, atol=1e-5)
        assert np.all(entry.factor(10.0 ** np.linspace(-12, 7, 200), phi) >= creeping)
        assert creeping[0] >= 1.0
    assert entry.source
    assert entry.reynolds_max > 0


@pytest.mark.parametrize("law", list(drag_laws))
@pytest.mark.parametrize("sphericity", [1.0, 0.6, 0.2])
def test_table_follows_its_law_to_1e_8(law: str, sphericity: float) -> None:
    reynolds = 10.0 ** np.random.default_rng(1).uniform(-8, 7, 20000)
    exact = drag_laws[law].factor(reynolds, sphericity)
    np.testing.assert_allclose(np.vectorize(scalar_drag(law, sphericity))(reynolds), exact, rtol=1e-8)


@pytest.mark.parametrize("law", list(drag_laws))
def test_table_is_constant_below_and_keeps_the_coefficient_above(law: str) -> None:
    factor = np.vectorize(scalar_drag(law, 1.0))
    below, above = factor([0.0, 1e-300]), factor([1e7, 1e9])
    np.testing.assert_allclose(below, drag_laws[law].factor(np.array([1e-8]), 1.0)[0], rtol=1e-8)
    np.testing.assert_allclose(above[1], above[0] * 100.0, rtol=1e-12)


def test_table_keeps_the_jump_of_schiller_and_naumann() -> None:
    beside = np.vectorize(scalar_drag("schiller-naumann", 1.0))([1000 * (1 - 1e-12), 1000 * (1 + 1e-12)])
    np.testing.assert_allclose(beside, [1 + 0.15 * 1000**0.687, 0.44 * 1000 / 24], rtol=1e-8)


def test_terminal_velocity_of_the_papers_glass_beads() -> None:
    np.testing.assert_allclose(
        terminal_velocity([1.1e-3, 1.2e-3, 1.3e-3], 2500, 1.204, 1.825e-5), [7.34, 7.85, 8.35], atol=0.006
    )


@pytest.mark.parametrize("law", list(drag_laws))
@pytest.mark.parametrize("diameter", [1e-7, 1e-5, 1e-3, 0.1])
def test_terminal_velocity_balances_weight(law: str, diameter: float) -> None:
    v = terminal_velocity(diameter, 1300, 1.2, 1.8e-5, 9.81, law, 0.8, 1.7)
    drag = 1.7 * drag_laws[law].factor(1.2 * v * diameter / 1.8e-5, 0.8) * v / relaxation_time(diameter, 1300, 1.8e-5)
    assert drag == pytest.approx(9.81 * (1 - 1.2 / 1300), rel=1e-2 if law == "schiller-naumann" else 1e-12)


def test_light_granules_rise_and_neutral_ones_hang() -> None:
    v = terminal_velocity([1e-3, 1e-3, 1e-3], [500, 1000, 1500], 1000, 1e-3)
    assert v[0] < 0 < v[2]
    assert v[1] == 0.0


@pytest.mark.parametrize("law", list(drag_laws))
def test_calibration_returns_the_measured_terminal_velocity(law: str) -> None:
    measured = np.array([7.8, 1.5, 0.01])
    diameter, density = np.array([3.88e-3, 2e-3, 2e-5]), np.array([1300.0, 200.0, 1400.0])
    scale = drag_factor_for_terminal_velocity(diameter, density, measured, 1.204, 1.825e-5, law=law, sphericity=0.9)
    again = terminal_velocity(diameter, density, 1.204, 1.825e-5, law=law, sphericity=0.9, drag_scale=scale)
    np.testing.assert_allclose(again, measured, rtol=1e-12)


def test_slip_correction_of_air() -> None:
    np.testing.assert_allclose(slip_correction([5e-6, 10e-6]), [1.033, 1.017], atol=5e-4)  # published values
    assert float(slip_correction(1.0)) - 1.0 < 2e-7
    free = 2 * 0.066e-6 / 1e-10 * 1.657  # free molecules: the exponential is 1
    assert float(slip_correction(1e-10)) == pytest.approx(1 + free, rel=1e-3)
    assert np.all(np.diff(slip_correction(10.0 ** np.linspace(-9, -2, 100))) < 0.0)
    assert float(slip_correction(1e-6, 0.132e-6)) == float(slip_correction(0.5e-6))  # of d / L alone


def test_bad_input_is_refused() -> None:
    with pytest.raises(SceneError, match=r"unknown drag law 'brown'.*did you mean"):
        drag_laws["brown"]
    with pytest.raises(SceneError, match="terminal_velocity"):
        drag_factor_for_terminal_velocity(1e-3, 1000, 0.0)
    with pytest.raises(SceneError, match="must exceed the fluid's"):
        drag_factor_for_terminal_velocity(1e-3, 1.0, 1.0)
