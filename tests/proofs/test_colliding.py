"""Granules that meet beside their peers: the feed that both fly, the bookkeeping, and small runs of each peer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from proofs import commands
from proofs.colliding import clouds, liggghts, report
from proofs.colliding.cooling import Gas, cooling_coefficients
from proofs.colliding.liggghts import CHUNK, DEPTH, Flown, fed, fly_machine, the_machine
from proofs.report import mean_interval
from wakeflow.laws.constants import GRAVITY
from wakeflow.planning.unknowns import SIGMAS

BRIEF = replace(the_machine(0.1), start_up=0.08)  # 60 ms of depth: some 200 granules


def test_the_feed_overlaps_nowhere_up_to_a_batch_before_its_birth() -> None:
    """A code that makes granules by the batch makes them higher up: all that are there then are apart."""
    grains, steady = fed(BRIEF, 0)
    assert 150 < len(grains) < 300
    assert 40 < steady.sum() < 120
    assert grains.depth is not None
    assert np.all(np.diff(grains.time) >= 0)
    for now in CHUNK * np.arange(1 + int(grains.time[-1] / CHUNK)):
        some = np.flatnonzero((grains.time < now + CHUNK) & (grains.time > now - 0.03))
        since = now - grains.time[some]
        x = grains.position[some] + grains.velocity[some] * since[:, None]
        x[:, 1] -= 0.5 * GRAVITY * since**2
        away = x[:, None] - x[None]
        across = grains.depth[some][:, None] - grains.depth[some][None]
        across -= DEPTH * np.round(across / DEPTH)
        gap = np.sqrt((away**2).sum(axis=2) + across**2) - 0.5 * np.add.outer(*2 * [grains.diameter[some]])
        assert gap[~np.eye(len(some), dtype=bool)].min() > 0.0


def test_a_landing_is_traced_back_to_the_floor(tmp_path: Path) -> None:
    """Seen twice below the floor: the first look counts, and the one that was not seen has no place."""
    floor, since, fall = BRIEF.scene.channel.bottom, 0.012, 2.5
    x, vx = np.array([0.05, -0.15]), np.array([0.4, -0.2])
    y, vy = floor - fall * since - 0.5 * GRAVITY * since**2, -fall - GRAVITY * since
    head = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n{}\nITEM: BOX BOUNDS\n0 1\n0 1\n0 1\nITEM: ATOMS id x y vx vy\n"
    rows = [f"{i + 1} {x[i] + vx[i] * since:.17g} {y:.17g} {vx[i]:g} {vy:.17g}\n" for i in (1, 0)]
    again = f"1 0.3 {y - 0.03:.17g} 0.0 {vy:.17g}\n"
    (tmp_path / "dump").write_text(head.format(7, 2) + "".join(rows) + head.format(8, 1) + again)
    found = liggghts._landings(BRIEF, 3, tmp_path / "dump")
    assert found[:2] == pytest.approx(x, abs=1e-12)
    assert np.isnan(found[2])
    places = list(BRIEF.scene.bin)
    named = [places[k] if k >= 0 else None for k in liggghts._places(BRIEF, np.append(found, [0.2001, -0.1]))]
    assert named == ["middle", "outer-left", None, "outer-right", "inner-left"]


def test_shares_count_steady_operation_and_a_paired_difference_knows_more() -> None:
    steady = [np.array([False, True, True, True, True])] * 3
    flown = [Flown(np.array([0, 0, 1, 1, -1]), 1.0), Flown(np.array([1, 0, 0, 1, 1]), 1.0)]
    shares = report._shares([*flown, flown[0]], steady, 2)
    np.testing.assert_allclose(shares, [[0.25, 0.5, 0.25], [0.5, 0.5, 0.0], [0.25, 0.5, 0.25]])
    value, low, high = mean_interval([0.01, 0.011, 0.009], 0.5 / 10_000)
    assert (value, low, high) == pytest.approx((0.01, 0.01 - 0.00248, 0.01 + 0.00248), abs=1e-5)
    assert mean_interval(np.zeros(3), 0.005)[1:] == pytest.approx((-0.005, 0.005))
    rows = json.loads(json.dumps(report._rows(["a", "b", "c"], shares, shares[::-1], 12)))
    assert [row["bin"] for row in rows] == ["a", "b", "c"]
    assert all(row["agree"] for row in rows)


def test_the_difference_of_two_slabs_is_no_surer_than_granules_that_fared_differently() -> None:
    """Four granules, two from the left: who crosses and who lands in the middle; two pairs that differ alike."""
    ours = [clouds.CloudFlight(np.array([0.2, 0.01, -0.2, -0.01]), 1.0)] * 2
    theirs = [clouds.CloudFlight(np.array([0.2, -0.01, np.nan, -0.2]), 1.0)] * 2
    assert ours[0].shares() == pytest.approx((1.0, 0.5, np.sqrt(0.5 * (0.2**2 + 0.01**2))))
    assert theirs[0].outcomes().tolist() == [[True, False, False, True], [False, True, False, False]]
    value, low, high = report._paired(theirs, ours, 0)
    assert (value, high - value, value - low) == pytest.approx((-0.5, SIGMAS * 2 / 8, SIGMAS * 2 / 8))


@pytest.mark.liggghts
def test_liggghts_lands_the_same_granules_in_the_same_bins(tmp_path: Path) -> None:
    """At 500 kg/h every second granule meets another; paths part slowly, so that nearly all share their bin."""
    grains, _ = fed(BRIEF, 1)
    ours, step = fly_machine(BRIEF, grains, 1, step=2.5e-4)
    assert step == 2.5e-4
    theirs = liggghts.fly_liggghts(BRIEF, grains, liggghts.SoftSpheres(5e6, 20.0), tmp_path)
    assert (theirs.place >= 0).all()
    assert np.mean(ours.place == theirs.place) > 0.9
    smooth = grains.replace(friction=0.0)
    assert np.mean(fly_machine(replace(BRIEF, friction=0.0), smooth, 1, step=2.5e-4)[0].place == theirs.place) < 0.88


@pytest.mark.slow
@pytest.mark.liggghts
def test_the_machine_at_its_feed_has_the_shares_of_liggghts() -> None:
    """The table of docs/validation.md: no bin's paired difference is beyond 1.5 of its interval."""
    found = report.compare_machine(the_machine(1.0), 8, {"LIGGGHTS": liggghts.SoftSpheres()})
    assert found["granules"] > 5000
    for row in found["rows"]:
        value, low, high = row["difference"]
        assert abs(value) < 1.5 * 0.5 * (high - low), row
        assert high - low < 0.02, row
        assert max(row["ours"][1], row["theirs"][1]) <= min(row["ours"][2], row["theirs"][2]), row


@pytest.mark.openfoam
def test_two_granules_meet_in_dpmfoam_as_in_the_slab(tmp_path: Path) -> None:
    """Head on, across the period of the slab; drag and updraft on. The restitution of its damping is the one asked."""
    grains = wf.Granules(
        [[-0.02, 0.02], [0.02, 0.02]], [[clouds.SPEED, 0.0], [-clouds.SPEED, 0.0]], clouds.DIAMETER, clouds.DENSITY,
        depth=np.array([0.5, 1.0]) * 1e-6,
    )  # fmt: skip
    ours, alone = clouds.fly_clouds(grains), clouds.fly_clouds(grains, collide=False)
    theirs = clouds.fly_foam_clouds("DPMFoam", grains, tmp_path / "case", modulus=2e5, until=0.1)
    assert np.abs(ours.x - alone.x).min() > 0.04
    assert theirs.x == pytest.approx(ours.x, abs=1e-3)


@pytest.mark.slow
@pytest.mark.openfoam
def test_clouds_meet_in_dpmfoam_as_in_the_slab(tmp_path: Path) -> None:
    grains = clouds.two_clouds(300, 0)
    ours, theirs = clouds.fly_clouds(grains), clouds.fly_foam_clouds("DPMFoam", grains, tmp_path / "case")
    np.testing.assert_allclose(ours.shares()[:2], theirs.shares()[:2], atol=0.03)
    assert ours.shares()[2] == pytest.approx(theirs.shares()[2], rel=0.03)


def test_a_gas_meets_and_cools_as_kinetic_theory_says() -> None:
    """1000 granules: collision frequency to 4 %, the cooling rate to 8 %, some three standard deviations each."""
    frequency, cooling, _ = cooling_coefficients(Gas(1000, 0.02, 0.8), 0)
    assert frequency == pytest.approx(1.0, abs=0.04)
    assert cooling == pytest.approx(1.0, abs=0.08)


def test_haffs_law_gives_the_time_of_so_many_collisions() -> None:
    gas = Gas(1000, 0.02, 0.8)
    times = np.linspace(0.0, gas.seconds(10.0), 20_001)
    warm = np.sqrt(2.0 / 3.0)
    speed = warm / (1.0 + 0.5 * gas.loss * gas.frequency(warm) * times)
    rate = np.array([gas.frequency(s) for s in speed])
    assert np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times)) == pytest.approx(10.0, rel=1e-6)
    assert Gas(1000, 0.02, 1.0 - 1e-9).loss == pytest.approx(2e-9 / 3.0, rel=1e-6)


def test_walls_hide_as_many_partners_as_random_pairs_show() -> None:
    """Of places in a box with two pairs of walls, those that have a place a diameter away in a random direction."""
    gas, rng = Gas(200, 0.1), np.random.default_rng(0)
    place, n = rng.uniform(0.0, gas.side, (400_000, 2)), rng.normal(size=(400_000, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    there = place + 4e-3 * n[:, :2]
    inside = ((there > 0.0) & (there < gas.side)).all(axis=1).mean()
    assert inside == pytest.approx(gas.beside_walls, abs=3e-3)
    assert gas.beside_walls < 0.97


def test_the_report_has_its_tables_and_the_proof_is_for_who_asks() -> None:
    assert "collisions" in commands.PROOFS
    assert "collisions" in commands.OPTIONAL
    row = {"bin": "middle", "ours": (0.1, 0.05, 0.15), "theirs": (0.2, 0.1, 0.3), "difference": (0.1, -0.1, 0.3)}
    machine = {
        "rows": [row | {"agree": True}], "variants": [{"name": "v", "rows": [row]}], "seconds": {"v": 3.0},
    }  # fmt: skip
    ratio = (1.0, 0.9, 1.1)
    cloud = {"way": "slab", "seconds": 1.0}
    cloud |= {key: ratio for name in report.MEASURES for key in (name, f"{name}_more")}
    gas = {"restitution": 0.9, "granules": 9, "filled": 0.02, "frequency": ratio, "cooling": ratio, "seconds": 1.0}
    tables = report.collision_tables({"vacuum": machine, "clouds": [cloud], "gas": [gas]})
    assert [len(table.cells()) for table in tables] == [1, 1, 1, 1]
    assert tables[0].cells()[0][1] == "10.00 ± 5.00"
