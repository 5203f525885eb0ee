"""The same granules flown again: what is the same, what differs, what the budget makes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wakeflow.core.store import Store
from wakeflow.foam.statistics import student
from wakeflow.pipeline.landings import Landings
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.stages import StageKey
from wakeflow.pipeline.track_stage import Companion
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import COMPARED, REPLICATES
from wakeflow.planning.wake import Wake
from wakeflow.results.companions import Comparison, Grid, compared, differences, mesh_error, shedding_noise
from wakeflow.scene import Scene


@pytest.fixture
def pipeline(cases: Path, tmp_path: Path) -> Pipeline:
    scene = Scene.load(cases / "vacuum.toml", {"feed.count": 256})
    return Pipeline(scene, make_plan(scene), store=Store(tmp_path))


def test_a_companion_flies_the_first_replicates_granules_again(pipeline: Pipeline) -> None:
    whole, part = pipeline.tracks(), pipeline.tracks(Companion("again"))
    for name in pipeline.scene.fraction:
        first, again = compared(whole.landings[name]), part.landings[name]
        assert len(again.bin) == len(whole.landings[name].bin) * COMPARED // REPLICATES
        for column in ("position", "bin", "replicate", "diameter", "time"):
            np.testing.assert_array_equal(getattr(first, column), getattr(again, column))
    assert {StageKey("", "tracks"), StageKey("", "again")} <= set(pipeline.seconds)
    assert pipeline.spent("again") > 0.0


def test_differences_are_from_the_answers_own_share() -> None:
    shares = {
        Wake.STEADY: {"chaff": np.array([[0.5, 0.5], [0.7, 0.3]])},
        Wake.ANSWER: {"chaff": np.array([[0.2, 0.8], [0.4, 0.6]])},
    }
    found = Comparison(shares, 1.0)
    assert dict(differences(found, "chaff", 0)) == {Wake.STEADY: pytest.approx(0.3)}
    assert dict(differences(found, "chaff", 1)) == {Wake.STEADY: pytest.approx(-0.3)}
    table = found.means(["middle"])
    assert table["chaff"]["middle"] == {"steady": pytest.approx(0.6), "answer": pytest.approx(0.3)}
    assert list(table["chaff"]) == ["middle", "elsewhere"]


def test_a_share_that_converges_at_second_order_has_its_mesh_error() -> None:
    """Shares 0.3 + C h^2 on three grids with little noise between replicates: the interval holds 0.3.

    The answer's own grid is the finest, and last.
    """
    noise = np.array([-1e-5, 1e-5, -1e-5, 1e-5])
    shares = {
        Grid(place, n): {"chaff": (0.3 + 50.0 / n + noise)[:, None]} for place, n in ((1, 2000), (2, 900), (0, 4500))
    }
    found = mesh_error(Comparison(shares, 1.0), "chaff", 0)
    assert found.kind == "richardson"
    assert found.order == pytest.approx(2.0, abs=0.05)
    assert found.low <= 0.3 <= found.high
    shedding = {grid: {"chaff": np.array([0.01])} for grid in shares}  # each wake in time is a sample of its own
    assert mesh_error(Comparison(shares, 1.0, shedding), "chaff", 0).kind == "range-statistics"
    loud = {n: {"chaff": s["chaff"] + 1000 * noise[:, None]} for n, s in shares.items()}
    assert mesh_error(Comparison(loud, 1.0), "chaff", 0).kind == "range-statistics"


def test_grids_are_compared_beside_what_their_finite_sheddings_leave() -> None:
    """Half of the granules of a strong shedding and none of a weak one land in the bin: that is no error of a mesh."""

    def landed(shares: tuple[float, ...]) -> Landings:
        count, cycles = 400, len(shares)
        replicate, cycle = (part.ravel() for part in np.indices((COMPARED, cycles * count))[:2])
        cycle, within = cycle // count, cycle % count
        inside = within < np.array(shares)[cycle] * count
        zero = np.zeros(len(cycle))
        return Landings(
            position=np.zeros((len(cycle), 2)), bin=np.where(inside, 0, -1), replicate=replicate, diameter=zero,
            fate=zero.astype(np.int8), time=zero, impacts=zero.astype(int), realisation=zero.astype(np.uint8),
            cycle=cycle.astype(np.uint16),
        )  # fmt: skip

    np.testing.assert_allclose(shedding_noise(landed((0.3, 0.3, 0.3, 0.3)), 1), 0.0, atol=1e-12)
    wide = shedding_noise(landed((0.5, 0.0, 0.5, 0.0)), 1)
    expected = student(3) * np.std([0.5, 0.0, 0.5, 0.0], ddof=1) / 2
    np.testing.assert_allclose(wide, expected)
