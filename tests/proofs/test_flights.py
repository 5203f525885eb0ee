"""What is printed of flights with all forces is sound, and OpenFOAM's cloud runs inside its own solver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from proofs.report import Table
from proofs.tracker import cloud, flights
from proofs.tracker.curves import travelling_wave
from support import rhombus_spec, shipped
from wakeflow.air.field import EMPTY
from wakeflow.air.foam.solver import run_segment
from wakeflow.air.foam.start import first_step, prepare_case
from wakeflow.air.foam.watch import Watch
from wakeflow.air.mesh import build_mesh
from wakeflow.flight import Fate, Tracks


def _air(cells: int = 60, half: float = 0.25) -> wf.FlowField:
    """Turbulent air falling at 5 m/s through vortices, over the whole channel of the shipped rhombus."""
    ticks = np.linspace(-half, half, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(ticks, ticks))
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    triangles = np.concatenate([[i, i + 1, i + cells + 2], [i, i + cells + 2, i + cells + 1]], axis=1).T
    swirl = np.stack([np.sin(60 * x) * np.cos(60 * y), -np.cos(60 * x) * np.sin(60 * y)], axis=1)
    k, dissipation = np.full(len(x), 0.1), np.full(len(x), 3.0)
    pressure = 0.3 * (np.cos(120 * x) + np.cos(120 * y))
    points = np.stack([x, y], axis=1)
    return wf.FlowField.from_arrays(points, triangles, 2.0 * swirl - (0.0, 5.0), pressure, k=k, dissipation=dissipation)


def test_errors_fall_with_the_tolerance_with_all_forces_and_eddies() -> None:
    air = _air()
    airs = {"steady": air, "wave": travelling_wave(air, 5.0, 0.05)}
    for one in list(flights.flown_kinds(shipped("rhombus"), airs, 96))[:2]:
        assert one.kind == "wheat"
        assert "dispersion" in one.flight.plan.fractions["wheat"].forces
        rows = list(flights.flight_rows(one, lambda _: None))
        assert all(row["median"] <= row["tolerance"] for row in rows)
        assert rows[-1]["median"] < rows[0]["median"]
        asked = next(row for row in rows if row["tolerance"] == flights.WANTED)
        assert asked["p95"] <= flights.WANTED
        assert asked["aside"] < 1e-3
        assert abs(asked["change"]) <= asked["moved"]
        assert rows[-1]["steps"] > rows[0]["steps"]
        assert all(row["cpu"] > 0.0 and 0.1 < row["flight"] < 1.0 for row in rows)
        assert len(Table("flights", flights.COLUMNS, rows).cells()) == len(flights.TOLERANCES)


def test_a_wave_keeps_the_turbulence_of_the_air_under_it() -> None:
    air = _air(8)
    wave = travelling_wave(air, 5.0, 0.05)
    assert np.array_equal(wave.k, np.full((len(wave.velocity), len(air.points)), 0.1))
    assert not travelling_wave(replace(air, k=EMPTY), 5.0, 0.05).has("k")


def test_exchanged_granules_are_counted_in_pairs() -> None:
    """Of ten granules two change places, which no share feels, and one leaves."""
    there = replace(Tracks.empty(10), line=np.array([0, 1, 0, 0, 0, 1, 1, 1, 1, 1]), fate=np.full(10, Fate.BINNED))
    here = replace(there, line=np.array([1, 0, 2, 0, 0, 1, 1, 1, 1, 1]))
    found = flights.exchanged(here, there, 2)
    assert found["moved"] == pytest.approx(0.3)
    assert abs(found["change"]) == pytest.approx(0.1)
    assert found["sampling"] == pytest.approx(0.3 / np.sqrt(10))  # of elsewhere: one of ten came


@pytest.mark.openfoam
def test_openfoams_cloud_flies_inside_its_solver(tmp_path: Path) -> None:
    """On a coarse mesh: parcels fly as long as the run, eddies scatter them, steps of a hundredth of a cell do not."""
    spec = rhombus_spec(rung="standard", scale=4.0)
    build_mesh(spec.mesh, tmp_path)
    folder, run = tmp_path / "case", tmp_path / "run"
    prepare_case(spec, tmp_path / "mesh.msh", folder)
    watch = Watch(folder, "start-up", lambda _: None, expected=0.02)
    run_segment(folder, cloud.SOLVER, 0.02, {"deltaT": first_step(spec)}, watch)
    air = _air()
    one = next(flights.flown_kinds(shipped("rhombus"), {"steady": air}, 64))
    case = cloud.SolvedCase.of(folder, air)
    ours = {"flight": 0.02, "cpu": 1e-4}
    rows = list(cloud.cloud_rows(case, [(one, ours)], run, lambda _: None))
    assert [row["courant"] for row in rows] == list(cloud.SETTINGS)
    assert rows[1]["cpu"] > rows[0]["cpu"]
    assert 0.0 < rows[0]["own_median"] < flights.WANTED
    assert rows[1]["median"] <= rows[0]["median"] < 1e-2
    log = cloud.SolverLog.of(run)
    assert log.flown == pytest.approx(0.02 * cloud.SETTINGS[rows[1]["courant"]], rel=0.1)
    assert len(Table("cloud", cloud.COLUMNS, rows).cells()) == 2
    assert [row["kind"] for row in cloud.at_equal_error(rows)] == ["wheat"]


def test_costs_at_equal_error_lie_between_those_of_the_settings() -> None:
    """Ten times the error for a tenth of the cost, in between by powers; beyond the settings a bound, which is said."""
    settings = [{"kind": "ball", "ours": 1.0, "median": 1e-2, "cpu": 10.0}, {"median": 1e-3, "cpu": 100.0}]
    for own, times, how in ((10**-2.5, 10**1.5, "between"), (1e-1, 10.0, "at most"), (1e-4, 100.0, "at least")):
        (row,) = cloud.at_equal_error([{**settings[0], **one, "own_median": own} for one in settings])
        assert row["times"] == pytest.approx(times)
        assert row["how"].startswith(how)
