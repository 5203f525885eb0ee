"""Bin shares beside OpenFOAM's parcels: the bookkeeping, and (slow) the same granules in the same air."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from proofs import shares
from proofs.tracker.curves import BenchmarkCase
from proofs.tracker.reference import TrackingProblem
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan


def _case(replicate: np.ndarray) -> BenchmarkCase:
    count = len(replicate)
    grains = wf.Granules(position=np.zeros((count, 2)), velocity=np.zeros((count, 2)), diameter=1e-3, density=1e3)
    field = wf.FlowField.from_arrays([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)], np.zeros((3, 2)))
    edges = np.array([-0.2, 0.0, 0.2])
    return BenchmarkCase("grain", "steady", TrackingProblem(field, (), 1.0, 0.05), grains, edges, replicate)


def test_granules_that_reach_no_bin_are_elsewhere() -> None:
    x = np.array([-0.3, -0.2, -0.1, 0.0, 0.19, 0.2, np.nan])
    assert shares.bins_of(_case(np.zeros(7, dtype=int)), x).tolist() == [2, 0, 0, 1, 1, 2, 2]


def test_a_paired_difference_knows_what_a_difference_of_shares_does_not() -> None:
    """Replicates that differ by 40 points among each other, but by 1 point between the two ways."""
    replicate = np.repeat(np.arange(4), 100)
    ours = np.concatenate([np.arange(100) < share for share in (20, 40, 50, 60)])
    theirs = np.concatenate([np.arange(100) < share for share in (21, 41, 51, 61)])
    value, low, high = shares._paired(_case(replicate), theirs, ours, np.ones(400, dtype=bool))
    assert (value, low, high) == pytest.approx((1.0, 1.0 - 0.125, 1.0 + 0.125))
    lone = shares._paired(_case(replicate), theirs, ours, np.arange(400) % 100 < 50)
    assert lone[0] == pytest.approx(100 * 2 / 200)  # of half of the granules, those of two replicates differ
    assert lone[1] < 0.0 < lone[2]


@pytest.mark.slow
@pytest.mark.openfoam
def test_openfoams_parcels_land_in_the_same_bins(cases: Path) -> None:
    """Rhombus, rung draft on a coarse mesh. Granules that meet no wall: within 0.5 points, all granules of the heavy
    fraction too; what meets walls differs by the laws of contact.
    """
    changes = {"numerics.mesh_scale": 2.0, "numerics.rung": "draft", "fraction.*.impact": "paper"}
    scene = wf.Scene.load(cases / "rhombus.toml", changes)
    rows, met = shares.compare_shares(scene, Pipeline(scene, make_plan(scene, force={"air-loading": False})), 1024)
    assert {row["fraction"] for row in rows} == set(shares.FRACTIONS)
    assert met["wheat"] < 0.5
    for row in rows:
        if row["free"] is not None:
            assert abs(row["free"][0]) < 0.5 or row["free"][1] <= 0.0 <= row["free"][2], row
        if row["fraction"] == "wheat":
            assert abs(row["difference"][0]) < 0.5, row
    for way in ("own", "same", "peer"):
        for name in shares.FRACTIONS:
            assert sum(row[way][0] for row in rows if row["fraction"] == name) == pytest.approx(100.0, abs=1e-9)
