"""The comparison of trackers is sound: its reference, its rivals, its arithmetic; the tracker holds what it states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import wakeflow as wf
from proofs import commands
from proofs.tracker.curves import BenchmarkCase, CurvePoint, cost_at, score, times_faster, travelling_wave
from proofs.tracker.foam import FoamInterpolant, fly_parcels, make_foam_interpolant
from proofs.tracker.reference import TrackingProblem, fly_reference
from proofs.tracker.rk4 import Ends, fly_explicit
from support import RHOMBUS
from wakeflow.air.mesh import plan_mesh
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.extras import verify as verify_commands
from wakeflow.laws.drag import drag_laws

Array = NDArray[np.float64]
GRAIN = {"diameter": 2e-3, "density": 600.0}
CHAFF = {"diameter": 1e-3, "density": 150.0}
DUST = {"diameter": 40e-6, "density": 1500.0}


def _air(cells: int = 20) -> wf.FlowField:
    """Air falling at 3 m/s through cells of vortices, on a square mesh of 2 x cells^2 triangles."""
    ticks = np.linspace(-0.1, 0.1, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(ticks, ticks))
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    triangles = np.concatenate([[i, i + 1, i + cells + 2], [i, i + cells + 2, i + cells + 1]], axis=1).T
    velocity = np.stack([np.sin(40 * x) * np.cos(40 * y), -3.0 - np.cos(40 * x) * np.sin(40 * y)], axis=1)
    return wf.FlowField.from_arrays(np.stack([x, y], axis=1), triangles, velocity)


def _grains(count: int, *, spread: float = 0.16, **properties: float) -> wf.Granules:
    x = spread * (np.arange(count) * 0.6180339887498949 % 1.0 - 0.5)
    position = np.stack([x, np.full(count, 0.09)], axis=1)
    return wf.Granules(position=position, velocity=np.tile([0.3, -1.0], (count, 1)), restitution=0.5,
                       **{"drag_scale": 1.0} | properties)  # fmt: skip


def _problem(field: wf.FlowField, *bodies: Array) -> TrackingProblem:
    return TrackingProblem(field, tuple(wf.Body(body) for body in bodies), until=1.0, length=0.05)


def _explicit(problem: TrackingProblem, grains: wf.Granules, step: float) -> Array:
    tracks = fly_explicit(problem.field, grains, step=step, **problem.arguments)
    assert tracks.landed.all()
    return tracks.position


def _error(problem: TrackingProblem, one: Array, other: Array) -> Array:
    return np.asarray(np.linalg.norm(one - other, axis=1) / problem.length)


# -- the reference -----------------------------------------------------------------------------------------------------


def _by_radau(problem: TrackingProblem, grains: wf.Granules, i: int) -> Array:
    """One granule's landing by scipy's Radau, triangle by triangle, each left at an event; not the reference's code."""
    field, law = problem.field, drag_laws[problem.drag]
    state = np.concatenate([grains.position[i], grains.velocity[i]])
    triangle, t = int(field.locate(state[:2])[0]), 0.0
    stokes = 18 * field.viscosity / (grains.density[i] * grains.diameter[i] ** 2)
    pull = np.array(problem.gravity) * (1 - field.density / grains.density[i])
    while True:
        corner, gradient = field.triangles[triangle], field.gradients[triangle]

        def weights(x: Array, corner: Array = corner, gradient: Array = gradient) -> Array:
            return np.array([1.0, 0.0, 0.0]) + gradient @ (x - field.points[corner[0]])

        def rhs(_: float, s: Array, corner: Array = corner) -> Array:
            slip = weights(s[:2]) @ field.velocity[corner] - s[2:]
            reynolds = np.array([field.density * np.hypot(*slip) * grains.diameter[i] / field.viscosity])
            return np.concatenate([s[2:], stokes * law.factor(reynolds, 1.0)[0] * slip + pull])

        events = [lambda _, s, k=k: weights(s[:2])[k] for k in range(3)]
        for event in events:
            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        found = solve_ivp(rhs, (t, t + 1.0), state, "Radau", events=events, rtol=1e-11, atol=1e-13, first_step=1e-7)
        k = next(k for k in range(3) if len(found.t_events[k]))
        t, state = found.t_events[k][0], found.y_events[k][0]
        onward = int(field.neighbours[triangle, k])
        if onward < 0:
            return np.asarray(state[:2])
        triangle = onward


@pytest.mark.parametrize("kind", [GRAIN, DUST], ids=["grain", "dust"])
def test_the_reference_agrees_with_another_method(kind: dict[str, float]) -> None:
    problem, grains = _problem(_air(8)), _grains(3, **kind)
    reference = fly_reference(problem, grains)
    assert reference.landed.all()
    other = np.array([_by_radau(problem, grains, i) for i in range(len(grains))])
    assert _error(problem, reference.position, other).max() < 1e-8


def test_the_reference_converges_to_itself() -> None:
    problem, grains = _problem(_air(), RHOMBUS), _grains(48, **CHAFF)
    fine, coarse = (fly_reference(problem, grains, step=step) for step in (2e-5, 1e-4))
    both = fine.landed & coarse.landed
    assert both.mean() > 0.9
    assert np.array_equal(fine.impacts[both], coarse.impacts[both])
    assert np.median(_error(problem, fine.position, coarse.position)[both]) < 1e-9


def test_a_reference_that_runs_out_of_time_says_so() -> None:
    reference = fly_reference(_problem(_air()), _grains(4, **GRAIN), seconds=0.0)
    assert not reference.landed.any()


# -- the tracker -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [GRAIN, CHAFF, DUST], ids=["grain", "chaff", "dust"])
@pytest.mark.parametrize("air", ["steady", "wave"])
def test_the_stated_tolerance_holds_against_the_reference(kind: dict[str, float], air: str) -> None:
    field = _air() if air == "steady" else travelling_wave(_air(), 3.0, 0.05)
    problem, grains = _problem(field, RHOMBUS), _grains(64, **kind)
    reference = fly_reference(problem, grains)
    for tolerance in (1e-3, 1e-5, 1e-7):
        tracks = wf.track(problem.field, grains, tolerance=tolerance, **problem.arguments)
        same = reference.landed & (tracks.impacts == reference.impacts)
        assert same.sum() > 20
        error = _error(problem, tracks.position, reference.position)[same]
        free = reference.impacts[same] == 0
        assert np.median(error[free]) <= tolerance
        assert np.percentile(error[free], 95) <= 3 * tolerance


# -- the rivals --------------------------------------------------------------------------------------------------------


def test_the_explicit_tracker_converges_to_the_reference() -> None:
    problem, grains = _problem(_air()), _grains(32, **CHAFF)
    reference = fly_reference(problem, grains)
    steps = np.array([1e-3, 1e-4, 1e-5])
    errors = [np.median(_error(problem, _explicit(problem, grains, step), reference.position)) for step in steps]
    orders = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert errors[-1] < 1e-8
    assert np.all((orders > 1.5) & (orders < 4.5))


def test_the_explicit_tracker_bounces_as_the_reference_does() -> None:
    problem, grains = _problem(_air(), RHOMBUS), _grains(24, spread=0.03, **GRAIN)
    reference = fly_reference(problem, grains)
    tracks = fly_explicit(problem.field, grains, step=1e-5, **problem.arguments)
    same = reference.landed & tracks.landed & (reference.impacts == tracks.impacts) & (reference.impacts > 0)
    assert same.sum() > 5
    assert np.median(_error(problem, tracks.position, reference.position)[same]) < 1e-5


def _channel() -> wf.FlowField:
    """Air as in ``_air``, over a channel 0.3 m wide and 0.3 m high."""
    air = _air(60)
    return wf.FlowField.from_arrays(1.5 * air.points, air.triangles, air.velocity)


@pytest.fixture(scope="module")
def foam(tmp_path_factory: pytest.TempPathFactory) -> FoamInterpolant:
    spec = plan_mesh([RHOMBUS], width=0.3, top=0.15, bottom=-0.15, rung="draft", scale=2.0)
    return make_foam_interpolant(_channel(), spec, 0.15, -0.15, tmp_path_factory.mktemp("peer"))


@pytest.mark.openfoam
@pytest.mark.parametrize("scheme", ["Euler", "analytical"])
def test_openfoams_parcels_fly_through_the_same_air(foam: FoamInterpolant, scheme: str, tmp_path: Path) -> None:
    grains = _grains(40, spread=0.2, **CHAFF)
    grains = grains[
        np.abs(grains.position[:, 0]) > 0.045
    ]  # past the body: OpenFOAM's granules touch with their centres
    problem = _problem(foam.field)
    reference = fly_reference(problem, grains)
    errors = []
    for courant in (0.1, 0.01, 0.001):
        run, _ = fly_parcels(foam, grains, scheme=scheme, step=0.2, courant=courant, until=0.2, folder=tmp_path / "run")
        both = reference.landed & np.isfinite(run.time)
        assert both.mean() > 0.8
        assert np.allclose(run.time[both], reference.time[both], atol=1e-3)
        errors.append(np.median(_error(problem, run.position, reference.position)[both]))
    assert errors[2] < 5e-5  # to nothing: there is no difference of interpolation left
    orders = np.log10(errors[:-1]) - np.log10(errors[1:])
    assert np.all((orders > 0.7) & (orders < 1.5))  # first order


# -- the arithmetic ----------------------------------------------------------------------------------------------------


def _row(error: float, seconds: float) -> CurvePoint:
    return CurvePoint("grain", "steady", "m", "s", error, 2 * error, 4, 0.0, 0.0, seconds, 1.5 * seconds, 10.0, 40.0)


def test_cost_at_an_error_is_read_off_the_best_settings() -> None:
    rows = [_row(error, 1e-6 / error) for error in (1e-2, 1e-3, 1e-5)]
    assert cost_at([*rows, _row(1e-3, 5e-3)], 1e-4) == pytest.approx(1.5e-2)
    assert cost_at(rows, 1.0) == pytest.approx(1.5e-4)  # the cheapest is accurate enough
    assert cost_at(rows, 1e-6) is None
    assert rows[0].evaluation_rate == pytest.approx(40.0 / 1.5e-4)


def test_ratios_are_of_processor_time_and_judged_by_what_is_asked() -> None:
    ours = [replace(_row(error, 1e-6 / error), method="wakeflow") for error in (1e-3, 1e-5)]
    peer = [replace(_row(error, 3e-5 / error), method="OpenFOAM Euler") for error in (1e-3, 1e-5)]
    explicit = [replace(_row(error, 1.2e-6 / error), method="explicit RK4") for error in (1e-3, 1e-5)]
    found = {row["than"]: row for row in times_faster([*ours, *peer, *explicit])}
    assert found["OpenFOAM"]["median"] == pytest.approx(30.0)
    assert found["explicit RK4"]["p95"] == pytest.approx(1.2)
    assert [row["met"] for row in found.values()] == [False, True]


def test_score_counts_what_met_the_walls_otherwise() -> None:
    grains = _grains(4, **GRAIN)
    case = BenchmarkCase(
        "grain", "steady", _problem(_air()), grains, np.array([-0.1, 0.0, 0.1]), np.zeros(len(grains), int)
    )
    x = np.array([(-0.05, 0.0), (0.05, 0.0), (0.06, 0.0), (0.07, 0.0)])
    all_true = np.ones(4, dtype=bool)
    reference = Ends(x, np.zeros(4), all_true, np.array([0, 0, 0, 1]))
    moved = np.array([(5e-5, 0.0), (5e-5, 0.0), (-0.1, 0.0), (0.0, 0.0)])
    ends = Ends(x + moved, np.zeros(4), all_true, np.array([0, 0, 1, 1]))
    row = score(case, reference, ends, method="m", setting="s", seconds=1.0, cpu=1.0, evaluations=None)
    assert row.median == pytest.approx(1e-3)
    assert row.others == pytest.approx(0.25)
    assert row.bin_error == pytest.approx(0.25)


def test_what_is_not_there_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match="did you mean 'extremes'"):
        commands.prove("extreme", slow=False, tell=lambda text: None)
    assert main(["verify", "trackers"]) == 2
    assert "did you mean" in capsys.readouterr().err
    monkeypatch.setattr(verify_commands, "TESTS", tmp_path)  # as in a wheel
    assert main(["verify", "airflow"]) == 2
    assert capsys.readouterr().err.count("needs a checkout of wakeflow's repository") == 1


def test_the_curves_are_drawn(tmp_path: Path) -> None:
    from proofs.tracker.picture import draw

    rows = [
        {"kind": kind, "air": "steady", "method": method, "cpu": 1e-6 / error, "median": error, "p95": 3 * error}
        for kind in ("grain", "dust") for method in ("wakeflow", "explicit RK4") for error in (1e-3, 1e-5)
    ]  # fmt: skip
    draw(rows, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 10_000
