"""Shares, intervals, purity and throughput from landings whose answer is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wakeflow.scene import Scene
from wakeflow.separation import Landings, interval, separate


def landings(bins: np.ndarray, replicates: int = 16) -> Landings:
    n = len(bins)
    zero = np.zeros(n)
    return Landings(
        position=np.zeros((n, 2)),
        bin=bins,
        replicate=np.arange(n) % replicates,
        diameter=zero,
        fate=np.zeros(n, dtype=int),
        time=zero,
        impacts=np.zeros(n, dtype=int),
    )


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "vacuum.toml").replace(
        {"fraction.soft.mass_share": 0.25, "fraction.hard.mass_share": 0.75, "feed.rate": "3600 kg/hour"}
    )


def test_shares_purity_recovery_throughput(scene: Scene) -> None:
    soft = np.repeat([0, 1, -1, 0], 160)  # half near, a quarter far, a quarter elsewhere
    hard = np.repeat([1, 1, 1, 0], 160)
    table = separate(scene, {"soft": landings(soft), "hard": landings(hard)})
    assert table["bins"] == ["near", "far", "elsewhere"]
    assert [table["fractions"]["soft"][b]["share"] for b in table["bins"]] == [0.5, 0.25, 0.25]
    for shares in table["fractions"].values():
        assert sum(row["share"] for row in shares.values()) == pytest.approx(1.0)
        assert all(row["low"] <= row["share"] <= row["high"] for row in shares.values())
    assert table["recovery"]["soft"]["value"] == 0.5
    near_soft, near_hard = 0.25 * 0.5, 0.75 * 0.25
    assert table["purity"]["near"]["soft"]["value"] == pytest.approx(near_soft / (near_soft + near_hard))
    assert table["throughput"]["near"] == pytest.approx(3600 * (near_soft + near_hard))
    assert sum(table["throughput"].values()) == pytest.approx(3600)


def test_an_empty_bin_has_no_purity_and_still_an_upper_limit(scene: Scene) -> None:
    table = separate(scene, {"soft": landings(np.zeros(640, int)), "hard": landings(np.zeros(640, int))})
    assert table["purity"]["far"] is None
    assert table["fractions"]["soft"]["far"]["share"] == 0.0
    assert 0.003 < table["fractions"]["soft"]["far"]["high"] < 0.01  # Wilson: z^2 / (n + z^2) = 0.006


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        samples = rng.binomial(64, 0.3, size=16) / 64
        _, low, high = interval(samples, 1024)
        covered += low <= 0.3 <= high
    assert 0.92 <= covered / 400 <= 0.98
