"""Shares, intervals, purity and throughput from landings whose answer is known."""

from pathlib import Path

import numpy as np
import pytest

from wakeflow.pipeline.landings import Landings
from wakeflow.scene import Scene
from wakeflow.statistics.separation import separate, share_interval


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
        realisation=np.zeros(n, dtype=int),
        cycle=np.zeros(n, dtype=int),
    )


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "vacuum.toml").replace(
        {"fraction.soft.mass_share": 0.25, "fraction.hard.mass_share": 0.75, "feed.rate": "3600 kg/hour"}
    )


def test_shares_purity_recovery_throughput(scene: Scene) -> None:
    soft = np.repeat([0, 1, -1, 0], 160)  # half near, a quarter far, a quarter elsewhere
    hard = np.repeat([1, 1, 1, 0], 160)
    found = separate(scene, {"soft": landings(soft), "hard": landings(hard)})
    assert found.bins == ("near", "far", "elsewhere")
    assert [found.fractions["soft"][place].value for place in found.bins] == [0.5, 0.25, 0.25]
    for shares in found.fractions.values():
        assert sum(share.value for share in shares.values()) == pytest.approx(1.0)
        assert all(share.low <= share.value <= share.high for share in shares.values())
    recovery, purity = found.recovery["soft"], found.purity["near"]
    assert recovery.value == 0.5
    near_soft, near_hard = 0.25 * 0.5, 0.75 * 0.25
    assert purity["soft"].value == pytest.approx(near_soft / (near_soft + near_hard))
    assert found.throughput["near"] == pytest.approx(3600 * (near_soft + near_hard))
    assert sum(found.throughput.values()) == pytest.approx(3600)


def test_an_empty_bin_has_no_purity_and_still_an_upper_limit(scene: Scene) -> None:
    found = separate(scene, {"soft": landings(np.zeros(640, int)), "hard": landings(np.zeros(640, int))})
    assert found.purity["far"] is None
    assert found.fractions["soft"]["far"].value == 0.0
    assert 0.003 < found.fractions["soft"]["far"].high < 0.01  # Wilson: z^2 / (n + z^2) = 0.006


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        samples = rng.binomial(64, 0.3, size=16) / 64
        _, low, high = share_interval(samples, 1024)
        covered += low <= 0.3 <= high
    assert 0.92 <= covered / 400 <= 0.98


def test_balanced_samples_do_not_pretend_to_be_exact() -> None:
    """With the real sampler: the interval of a share covers it at least as often as it says, for cuts anywhere."""
    from wakeflow.injection.birth import samples

    covered = total = 0
    for seed in range(40):
        points, replicate = samples("a", 1024, seed)
        for cut in (0.2503, 0.5, 0.61, 0.013):
            shares = np.array([np.mean(points[replicate == r, 0] < cut) for r in range(16)])
            _, low, high = share_interval(shares, len(points))
            covered += low <= cut <= high
            total += 1
    assert covered / total >= 0.95


def test_purity_of_a_nearly_pure_bin_admits_what_was_not_seen(scene: Scene) -> None:
    """Truth 0.957: few granules of the rarer fraction reach the bin, often none; the interval must still hold it."""
    rng = np.random.default_rng(3)
    n, p_soft, p_hard = 4096, 0.01, 5e-5
    truth = 0.25 * p_soft / (0.25 * p_soft + 0.75 * p_hard)
    covered = 0
    for _ in range(60):
        soft, hard = (np.where(rng.random(n) < p, 1, 0) for p in (p_soft, p_hard))
        purity = separate(scene, {"soft": landings(soft), "hard": landings(hard)}).purity["far"]
        low, high = purity["soft"].low, purity["soft"].high
        assert low is not None
        assert high is not None
        covered += low <= truth <= high
    assert covered >= 54
