"""The same granules flown again: what is the same, what differs, what the budget makes of it."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from wakeflow.budget.comparison import Comparison, compared, differences
from wakeflow.budget.mesh import Grid, difference_noise, mesh_error, shedding_noise
from wakeflow.core.number import student
from wakeflow.core.store import Store
from wakeflow.pipeline.landings import Landings
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.track_stage import Companion
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import COMPARED, REPLICATES
from wakeflow.planning.unknowns import SIGMAS
from wakeflow.planning.wake import Wake
from wakeflow.scene import Scene

Array = NDArray[np.int64]


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
    assert {"tracks", "again"} <= set(pipeline.seconds)
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
    """Shares 0.3 + C h^2 on three grids: the interval holds 0.3, whatever the replicates scatter by, since the same
    granules fly on all of them.

    The answer's own grid is the finest, and last.
    """
    scatter = np.array([-0.1, 0.1, -0.1, 0.1])
    shares = {
        Grid(place, n): {"chaff": (0.3 + 50.0 / n + scatter)[:, None]} for place, n in ((1, 2000), (2, 900), (0, 4500))
    }
    found, (granules, sheddings) = mesh_error(Comparison(shares, 1.0), "chaff", 0)
    assert granules == sheddings == 0.0
    assert found.kind == "richardson"
    assert found.order == pytest.approx(2.0, abs=0.05)
    assert found.low <= 0.3 <= found.high
    others = [grid for grid in shares if grid.place]
    quiet, loud = ({grid: {"chaff": np.array([[3.0], [4.0]]) * half} for grid in others} for half in (2e-5, 2e-3))
    assert mesh_error(Comparison(shares, 1.0, quiet), "chaff", 0)[0] == found
    hidden, noise = mesh_error(Comparison(shares, 1.0, loud), "chaff", 0)
    assert hidden.kind == "range-statistics"
    np.testing.assert_allclose(noise, [6e-3, 8e-3])  # most of it the sheddings'


def landings(places: Array, cycle: NDArray[np.uint16] | None = None) -> Landings:
    """Granules that ended in bins of the numbers ``places`` (COMPARED, n)."""
    zero = np.zeros(places.size)
    return Landings(
        position=np.zeros((places.size, 2)), bin=places.ravel(), replicate=np.indices(places.shape)[0].ravel(),
        diameter=zero, fate=zero.astype(np.int8), time=zero, impacts=zero.astype(int),
        realisation=zero.astype(np.uint8), cycle=zero.astype(np.uint16) if cycle is None else cycle,
    )  # fmt: skip


def test_the_noise_of_a_difference_is_of_granules_that_change_their_bin() -> None:
    """Half of the granules in either bin: where none moves, one in 2000 is what is unknown, not the sampling's 2 %."""
    count = 500
    before = np.tile(np.arange(count) % 2, (COMPARED, 1))
    same, shed = difference_noise(landings(before), landings(before), 2)
    assert not shed.any()
    assert not difference_noise(landings(before), landings(before), 3)[:, 2].any()  # a bin that nobody reaches
    np.testing.assert_allclose(same[:2], SIGMAS * np.sqrt(2.0) / (COMPARED * count + 2), rtol=1e-12)
    chance = np.random.default_rng(1)
    share, halves, moved = 0.05, [], []
    for _ in range(200):  # 5 % of bin 0 move to bin 1: the interval holds that in 95 % of the samples
        after = np.where((before == 0) & (chance.random(before.shape) < 2 * share), 1, before)
        halves.append(difference_noise(landings(before), landings(after), 2)[0, 1])
        moved.append(np.mean(after == 1) - np.mean(before == 1))
    held = np.abs(np.array(moved) - share) <= halves
    assert 0.91 <= held.mean() <= 0.99


def test_grids_are_compared_beside_what_their_finite_sheddings_leave() -> None:
    """Half of the granules of a strong shedding and none of a weak one land in the bin: that is no error of a mesh."""

    def landed(shares: tuple[float, ...]) -> Landings:
        count, cycles = 400, len(shares)
        cycle = np.indices((COMPARED, cycles * count))[1].ravel()
        cycle, within = cycle // count, cycle % count
        inside = within < np.array(shares)[cycle] * count
        return landings(np.where(inside, 0, -1).reshape(COMPARED, -1), cycle.astype(np.uint16))

    np.testing.assert_allclose(shedding_noise(landed((0.3, 0.3, 0.3, 0.3)), 1), 0.0, atol=1e-12)
    wide = shedding_noise(landed((0.5, 0.0, 0.5, 0.0)), 1)
    expected = student(3) * np.std([0.5, 0.0, 0.5, 0.0], ddof=1) / 2
    np.testing.assert_allclose(wide, expected)
    quiet, loud = landed((0.3, 0.3, 0.3, 0.3)), landed((0.5, 0.0, 0.5, 0.0))
    np.testing.assert_allclose(difference_noise(quiet, loud, 1)[1], wide)  # each wake in time is a sample of its own
