"""A slab in which no granules meet lands where the tracker says: in a vacuum, in air, by chance; the step's error."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import wakeflow as wf
from proofs.problems.exact import box
from support import RHOMBUS
from wakeflow.flight import ClockStep
from wakeflow.flight.collisions import slab_driver as collisions
from wakeflow.flight.tracks import CollisionFlight

BELOW = [np.array([[-1.0, -0.15], [1.0, -0.15]])]


def _curtain(count: int, seed: int, **more: Any) -> wf.Granules:
    rng = np.random.default_rng(seed)
    position = np.column_stack([rng.uniform(-0.02, 0.02, count), rng.uniform(0.1, 0.15, count)])
    return wf.Granules(position, np.zeros((count, 2)), 3e-3, 1200.0, **{"inertia": 0.4} | more)


def _lonely(step: float | None = None) -> wf.Collisions:
    """Tracers meet nobody but granules, and there are none."""
    return wf.Collisions(0.06, tracers=(0,), step=step)


@pytest.mark.parametrize("shaken", [False, True])
@pytest.mark.parametrize("inertia", [None, 0.4])
def test_in_a_vacuum_every_granule_lands_where_the_tracker_says(shaken: bool, inertia: float | None) -> None:
    """Falls, strikes on an outline that may vibrate, slides, and a line: to far less than the tolerance."""
    motion = wf.Motion((0.0, 1e-3), 30.0) if shaken else None
    laws: dict[str, Any] = {"until": 3.0, "bodies": [RHOMBUS], "lines": BELOW, "motion": motion, "tolerance": 1e-4}
    grains = _curtain(60, 1, inertia=inertia, friction=0.4)
    alone = wf.track(None, grains, **laws)
    together = wf.track(None, grains, collisions=_lonely(), **laws)
    np.testing.assert_array_equal(together.fate, alone.fate)
    away = np.linalg.norm(together.position - alone.position, axis=1) / np.ptp(RHOMBUS[:, 0])
    assert np.quantile(away, 0.9) < 1e-4
    assert together.collisions.clock.step_error < 1e-4


def test_rebounds_scatter_and_slip_comes_back_as_the_tracker_has_it() -> None:
    """The random angle of an impact is that of the granule and the number of its impact, alone or among others."""
    laws: dict[str, Any] = {"until": 3.0, "bodies": [RHOMBUS], "lines": BELOW, "tolerance": 1e-4, "seed": 4}
    plain = _curtain(60, 1, inertia=0.4, friction=0.4)
    grains = plain.replace(scatter=0.15, tangential_restitution=0.3)
    alone = wf.track(None, grains, **laws)
    together = wf.track(None, grains, collisions=_lonely(), **laws)
    away = np.linalg.norm(together.position - alone.position, axis=1) / np.ptp(RHOMBUS[:, 0])
    assert np.quantile(away, 0.9) < 1e-4
    other = wf.track(None, plain, **laws)
    assert np.median(np.abs(alone.position[:, 0] - other.position[:, 0])) > 1e-3


def _stirred(cells: int = 30, **more: Any) -> wf.FlowField:
    """Cells of a Taylor-Green flow on top of a rising stream: shear and strain everywhere."""
    points, triangles = box(cells, low=-0.2, high=0.2)
    x, y = (points * np.pi / 0.1).T
    u = np.column_stack([np.sin(x) * np.cos(y), 1.0 - np.cos(x) * np.sin(y)])
    return wf.FlowField.from_arrays(points, triangles, u, **more)


@pytest.mark.parametrize("more", [(), ("basset-history",)])
def test_in_air_the_step_is_found_and_its_error_is_honest(more: tuple[str, ...]) -> None:
    """Drag of every Reynolds number: the step's error measured on a sample is that of all, of second order."""
    grains = _curtain(400, 2)
    laws: dict[str, Any] = {"until": 0.6, "lines": BELOW, "length": 0.06, "forces": ("drag", "gravity", *more)}
    field = _stirred()
    alone = wf.track(field, grains, tolerance=1e-6, **laws)
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        together = wf.track(field, grains, tolerance=1e-4, collisions=_lonely(step), **laws)
        np.testing.assert_array_equal(together.fate, alone.fate)
        errors.append(np.quantile(np.linalg.norm(together.position - alone.position, axis=1) / 0.06, 0.9))
    assert errors[0] > 2.5 * errors[1] > 6.0 * errors[2]
    together = wf.track(field, grains, tolerance=1e-4, collisions=_lonely(), **laws)
    away = np.linalg.norm(together.position - alone.position, axis=1) / 0.06
    assert together.collisions.clock.step_error <= 1e-4
    assert np.quantile(away, 0.9) < 2e-4


def test_eddies_scatter_granules_that_meet_as_they_scatter_single_granules() -> None:
    """The same random streams on another clock: landings agree in mean and spread, within sampling."""
    field = _stirred(k=np.full(31**2, 0.2), dissipation=np.full(31**2, 4.0))
    grains = _curtain(1500, 3, drag_scale=4.0)
    laws: dict[str, Any] = {
        "until": 1.0, "lines": BELOW, "length": 0.06, "tolerance": 1e-3, "forces": ("drag", "gravity", "dispersion"),
    }  # fmt: skip
    alone = wf.track(field, grains, seed=1, **laws)
    together = wf.track(field, grains, seed=2, collisions=_lonely(5e-4), **laws)
    one, other = alone.position[:, 0], together.position[:, 0]
    error = np.sqrt(one.var() / len(one) + other.var() / len(other))
    assert abs(one.mean() - other.mean()) < 3.5 * error
    assert abs(np.log(one.std() / other.std())) < 3.5 / np.sqrt(len(one))


@pytest.mark.parametrize("name", ["buoyancy", "pressure-gradient", "added-mass", "lift", "magnus", "basset-history"])
def test_every_force_acts_among_others_as_on_one(name: str) -> None:
    field = _stirred(pressure=np.linspace(0.0, 1.0, 31**2))
    grains = _curtain(40, 4, drag_scale=2.0, spin=300.0)
    laws: dict[str, Any] = {"until": 0.5, "lines": BELOW, "length": 0.06, "tolerance": 1e-4}
    without = wf.track(field, grains, **laws)
    alone = wf.track(field, grains, forces=("drag", "gravity", name), **laws)
    together = wf.track(field, grains, forces=("drag", "gravity", name), collisions=_lonely(2e-4), **laws)
    effect = np.abs(alone.position - without.position).max()
    away = np.quantile(np.linalg.norm(together.position - alone.position, axis=1), 0.9)
    assert away < max(0.03 * effect, 2e-4 * 0.06), (away, effect)


def _loop(times: NDArray[np.float64]) -> NDArray[np.float64]:
    points, _ = box(30, low=-0.2, high=0.2)
    swing = np.sin(2 * np.pi * times / 0.1)[:, None]
    return np.stack([0.8 * swing * np.cos(np.pi * points[:, 1] / 0.2), np.full((len(times), len(points)), 1.0)], axis=2)


def test_a_field_that_changes_in_time_is_read_on_the_common_clock() -> None:
    points, triangles = box(30, low=-0.2, high=0.2)
    times = np.arange(20) * 0.005
    field = wf.FlowField.from_arrays(points, triangles, _loop(times), times=times, period=0.1)
    grains = _curtain(60, 5, time=np.linspace(0.0, 0.1, 60))
    laws: dict[str, Any] = {"until": 1.0, "lines": BELOW, "length": 0.06, "tolerance": 1e-4}
    alone = wf.track(field, grains, **laws)
    together = wf.track(field, grains, collisions=_lonely(5e-4), **laws)
    np.testing.assert_array_equal(together.fate, alone.fate)
    away = np.linalg.norm(together.position - alone.position, axis=1) / 0.06
    assert np.quantile(away, 0.9) < 1e-3


def test_granules_that_meet_hit_tracers_by_the_efficiency_of_impaction_and_does_not_notice() -> None:
    """Heavy granules sweep still dust: none of the finest is caught, all of what is heavy enough in their way is."""
    points, triangles = box(4, low=-0.2, high=0.2)
    field = wf.FlowField.from_arrays(points, triangles, 0 * points)
    rng = np.random.default_rng(6)
    count = 4000
    dust = rng.uniform(-0.05, 0.05, (count, 2))
    balls = np.column_stack([np.linspace(-0.04, 0.04, 9), np.full(9, 0.06)])
    for size, share in ((2e-6, 0.0), (2e-3, 1.0)):
        grains = wf.Granules(
            np.concatenate([dust, balls]), np.concatenate([0 * dust, np.tile([0.0, -3.0], (9, 1))]),
            np.repeat([size, 8e-3], [count, 9]), np.repeat([2000.0, 8000.0], [count, 9]), inertia=0.4,
            fraction=np.repeat([1, 0], [count, 9]),
            depth=np.concatenate([rng.uniform(0, 0.02, count), np.full(9, 0.01)]),
        )  # fmt: skip
        law = wf.Collisions(0.02, tracers=(1,), step=2e-4)
        tracks = wf.track(field, grains, until=0.04, forces=("drag",), collisions=law, length=0.06)
        away = dust[:, None, 0] - balls[None, :, 0]
        off = np.hypot(away, grains.depth[:count, None] - 0.01)
        in_the_way = (off < 0.5 * (8e-3 + size) - 2e-4).any(axis=1) & (dust[:, 1] > -0.04)
        clear = (off > 0.5 * (8e-3 + size) + 2e-4).all(axis=1)
        hit = tracks.meetings[:count] > 0
        assert not hit[clear].any()
        assert abs(hit[in_the_way].mean() - share) < 0.03
        calm = wf.track(
            field, grains[np.arange(count, count + 9)], until=0.04, forces=("drag",), collisions=law, length=0.06
        )
        np.testing.assert_allclose(tracks.velocity[count:], calm.velocity, atol=1e-13)


def _cost(seed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[int, ClockStep]:
    """Steps that colliding granules take in all, those of trials too, and what their clock was chosen by: a third is
    dust, which vortices keep for long, so that its flights alone, at the tolerance, end elsewhere.
    """
    rng = np.random.default_rng(seed)
    count, told = 200, []
    fly_slab = collisions.fly_slab

    def counted(*how: Any) -> CollisionFlight:
        told.append(fly_slab(*how))
        return told[-1]

    monkeypatch.setattr(collisions, "fly_slab", counted)
    grains = _curtain(count, seed).replace(diameter=np.where(rng.random(count) < 0.33, 1e-4, 3e-3))
    laws: dict[str, Any] = {"until": 0.6, "lines": BELOW, "length": 0.06, "tolerance": 1e-2}
    found = wf.track(_stirred(), grains, collisions=_lonely(), **laws)
    monkeypatch.undo()
    return sum(one.flown for one in told), found.collisions.clock


def test_what_a_step_costs_does_not_depend_on_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over 20 feeds: the steps that colliding granules take, with all trials of its clock."""
    found = [_cost(seed, monkeypatch) for seed in range(20)]
    flown = [flown for flown, _ in found]
    assert max(flown) <= 1.5 * np.median(flown)
    assert all(clock.reached and clock.trials <= 2 for _, clock in found)


@pytest.mark.parametrize("factor", [1.0, 2.0, 30.0, 300.0])
def test_a_step_that_is_too_long_is_shortened_alike_for_every_seed(factor: float) -> None:
    """Errors of the scheme's order, each measured to a quarter, from a first step that errs by ``factor`` times what
    was asked, or by half a length where that is less: 20 seeds, the cost of the trials and of a slab of 20 of them.
    """
    costs = []
    for seed in range(20):
        rng, tried = np.random.default_rng(seed), []

        def error_of(step: float, rng: np.random.Generator = rng, tried: list[float] = tried) -> float:
            tried.append(step)
            return min(0.5, 1e-2 * factor * step**2 * float(np.exp(rng.normal(0.0, 0.25))))

        clock = collisions.chosen_step(1.0, error_of, 1e-2)
        assert clock.reached
        assert clock.trials == len(tried) <= 6
        costs.append(sum(1.0 / step for step in tried) + 20.0 / clock.step)
    assert max(costs) <= 1.5 * np.median(costs)


@pytest.mark.parametrize("factor", [1.05, 3.0, 100.0])
def test_a_step_that_no_shorter_one_betters_is_kept_and_said_to_err(factor: float) -> None:
    """An error that is not the step's, as of a reference that is not good enough: three trials, and no shorter step."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        floor = 1e-2 * factor
        clock = collisions.chosen_step(1.0, lambda _, rng=rng, floor=floor: floor * (1.0 + 0.02 * rng.random()), 1e-2)
        assert (clock.step, clock.trials, clock.reached) == (1.0, 3, False)
        assert f"({clock.asked:.2g} asked); trials: 3" in clock.told
