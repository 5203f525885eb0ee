"""Partition curves: of landings whose curve is known, and terminal velocities from the table."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from wakeflow.laws.constants import STANDARD_AIR
from wakeflow.laws.drag import drag_laws, terminal_velocity
from wakeflow.pipeline.landings import Landings
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene
from wakeflow.statistics.partition import partition_curves, settling_velocities

SIZES, SHARPNESS = (1e-3, 4e-3), 12.0  # m; of the logistic curve in ln(x / x50)
CUT = 2.2e-3  # m
EP = CUT * np.sinh(np.log(3.0) / SHARPNESS)  # exact: x75 and x25 are CUT times 3^(+-1/SHARPNESS)


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "vacuum.toml").replace({
        "fraction.soft.mass_share": 0.3, "fraction.hard.mass_share": 0.7,
        "fraction.soft.target": "near", "fraction.hard.target": "far",
    })  # fmt: skip


def _landings(scene: Scene, seed: int, count: int = 16384, drag: float | None = 1.0) -> dict[str, Landings]:
    """Sizes even in their logarithm; what is larger than about CUT goes into the second bin."""
    found, rng = {}, np.random.default_rng(seed)
    for name in scene.fraction:
        size = np.exp(rng.uniform(*np.log(SIZES), count))
        bins = (rng.random(count) < expit(SHARPNESS * np.log(size / CUT))).astype(np.int16)
        none = np.zeros(count, dtype=int)
        own = None if drag is None else np.full(count, drag)
        found[name] = Landings(
            np.zeros((count, 2)), bins, np.arange(count) % 16, size, none, none, none, none, none, drag=own
        )
    return found


def test_a_known_curve_is_found_with_its_cut_and_sharpness(scene: Scene) -> None:
    curves = partition_curves(scene, make_plan(scene), _landings(scene, 1))
    assert [(curve.product, curve.by) for curve in curves] == [
        (("near",), "size"), (("near",), "terminal velocity"), (("far",), "size"), (("far",), "terminal velocity"),
    ]  # fmt: skip
    far = curves[2]
    assert far.cut.value == pytest.approx(CUT, rel=0.02)
    assert far.ep == pytest.approx(EP, rel=0.1)
    assert far.imperfection == pytest.approx(far.ep / far.cut.value)
    exact = expit(SHARPNESS * np.log(np.array(far.at) / CUT))
    assert np.abs(np.array(far.share) - exact).max() < 0.05
    assert sum(far.mass) == pytest.approx(1.0)
    near = curves[0]
    assert np.array(near.share) + np.array(far.share) == pytest.approx(1.0)
    assert near.cut.value == pytest.approx(far.cut.value)


def test_bands_hold_the_truth_as_often_as_they_say(scene: Scene) -> None:
    plan, inside, cuts = make_plan(scene), [], []
    for seed in range(40):
        far = partition_curves(scene, plan, _landings(scene, seed, 2048, None))[1]
        exact = expit(SHARPNESS * np.log(np.array(far.at) / CUT))
        inside.append(np.mean((exact >= far.low) & (exact <= far.high)))
        assert far.cut.low is not None
        assert far.cut.high is not None
        cuts.append(far.cut.low <= CUT <= far.cut.high)
    assert 0.9 < np.mean(inside) <= 1.0
    assert np.mean(cuts) > 0.85


def test_a_product_that_takes_little_of_every_class_has_no_cut(scene: Scene) -> None:
    landings = _landings(scene, 3, drag=None)
    for landing in landings.values():
        landing.bin[:] = np.where(np.arange(len(landing.bin)) % 5 == 0, 0, 1)
    near = partition_curves(scene, make_plan(scene), landings)[0]
    assert near.cut is None
    assert near.ep is None
    assert near.why == "less than a half of every class"


def test_a_gap_between_the_fractions_is_told_in_millimetres(scene: Scene) -> None:
    landings = _landings(scene, 3, drag=None)
    for place, (landing, size) in enumerate(zip(landings.values(), (58e-6, 1.3e-3), strict=True)):
        landing.diameter[:] = size
        landing.bin[:] = place
    near = partition_curves(scene, make_plan(scene), landings)[0]
    assert near.cut is not None
    assert near.why == "no granules between 0.058 and 1.3 mm"


def test_granules_that_are_all_alike_have_no_curve(scene: Scene) -> None:
    landings = _landings(scene, 3)
    for landing in landings.values():
        landing.diameter[:] = 2e-3
    by = {curve.by for curve in partition_curves(scene, make_plan(scene), landings)}
    assert by == {"terminal velocity"}  # the fractions' densities differ


@pytest.mark.parametrize("law", ["brown-lawler", "haider-levenspiel"])
def test_terminal_velocities_from_the_table_are_the_roots(law: str) -> None:
    diameter = np.geomspace(1e-6, 2e-2, 50)
    drag = np.linspace(0.6, 1.7, 50)
    shape = 0.8 if drag_laws[law].uses_sphericity else 1.0
    found = settling_velocities(diameter, 1300.0, drag, law, shape, STANDARD_AIR)
    exact = terminal_velocity(diameter, 1300.0, *STANDARD_AIR, law=law, sphericity=shape, drag_scale=drag)
    assert found == pytest.approx(exact, rel=1e-5)
    assert np.isnan(settling_velocities(diameter, 1.0, drag, law, shape, STANDARD_AIR)).all()
