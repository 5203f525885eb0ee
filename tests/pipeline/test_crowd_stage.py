"""The slab's stage: what it keeps, that it goes on where it stopped, and that a trickle flies as granules alone do."""

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.pipeline.landings import Landings
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.slab import SlabFlight, SlabFound, _grouped, load_crowd, step_of
from wakeflow.planning.make import make_plan
from wakeflow.planning.terms import COLLISIONS
from wakeflow.scene import Scene
from wakeflow.statistics.separation import Tally, separate

DENSE, TRICKLE = 0.2, 1e-3  # kg/s and metre of depth


def fed(rate: float, **more: Any) -> Scene:
    """Two granules of equal size that collide in a vacuum."""
    return shipped("vacuum", {"feed.rate": rate, "feed.count": 512, **more})


@cache
def pipeline(rate: float) -> Pipeline:
    scene = fed(rate)
    return Pipeline(scene, make_plan(scene, force={COLLISIONS: True}))


def crowd(rate: float) -> SlabFound:
    found = pipeline(rate).crowd()
    assert found is not None
    return found


def test_every_granule_of_steady_operation_lands_once_and_weighs_by_its_mass() -> None:
    scene, found = pipeline(DENSE).scene, crowd(DENSE)
    for name, landing in found.landings.items():
        assert landing.weight is not None
        assert landing.meetings is not None
        shares = landing.counts(len(scene.bin))
        np.testing.assert_allclose(shares.sum(axis=1), 1.0)
        assert landing.size == pytest.approx(len(landing.bin))  # all of one size
        assert set(landing.replicate) == set(range(found.replicates))
        assert landing.mass_shares.sum() == pytest.approx(1.0), name


def test_a_trickle_lands_as_granules_alone_do_and_a_dense_feed_does_not() -> None:
    scene = pipeline(DENSE).scene
    alone = separate(scene, pipeline(DENSE).tracks().landings).share("hard", "far")
    few = separate(scene, crowd(TRICKLE).landings).share("hard", "far")
    many = separate(scene, crowd(DENSE).landings).share("hard", "far")
    assert few[1] <= alone[2]
    assert alone[1] <= few[2]
    assert many[2] < alone[1]  # crowding costs
    meetings = {rate: crowd(rate).landings["hard"].meetings.mean() for rate in (TRICKLE, DENSE)}  # type: ignore[union-attr]
    assert meetings[TRICKLE] < 0.1 * meetings[DENSE]


def test_it_goes_on_where_it_stopped_and_all_fly_with_the_step_that_the_first_has_found(tmp_path: Path) -> None:
    scene = fed(TRICKLE)
    flight = SlabFlight(scene, make_plan(scene, force={COLLISIONS: True}), Realisations(None), 0.03, 0.2, 0.3, 1e-3)
    flight.fly_all(tmp_path, 2)
    stopped, given = tmp_path / "stopped", tmp_path / "given"
    stopped.mkdir()
    given.mkdir()
    shutil.copy(tmp_path / "replicate-0.npz", stopped)
    told: list[str] = []
    replace(flight, tell=told.append).fly_all(stopped, 2)
    assert told == ["replicate 2", "2 of 2 replicates"]
    replace(flight, step=step_of(tmp_path)).fly_all(given, 2)
    one = load_crowd(tmp_path, scene, 2)
    assert one.step_error < 1e-3
    for other in (load_crowd(folder, scene, 2) for folder in (stopped, given)):
        assert one.step == other.step
        for name in scene.fraction:
            np.testing.assert_array_equal(one.landings[name].position, other.landings[name].position)


def test_a_first_replicate_that_fails_before_its_step_is_known_says_why(tmp_path: Path) -> None:
    scene = fed(DENSE)
    flight = SlabFlight(scene, make_plan(scene, force={COLLISIONS: True}), Realisations(None), 1.5e-3, 0.2, 0.3, 1e-3)
    with pytest.raises(wf.SceneError, match="less than the largest granule"):
        flight.fly_all(tmp_path, 2)
    assert not list(tmp_path.iterdir())


def test_a_weight_counts_as_so_many_granules() -> None:
    none = np.zeros(4, dtype=int)
    replicate = np.array([0, 0, 1, 1])
    plain = (np.zeros((4, 2)), np.array([0, 0, 1, 0]), replicate, none, none, none, none, none, none)
    landing = Landings(*plain, weight=np.array([3.0, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(landing.counts(2), [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0]])
    tally = Tally.every(landing, 2, 1)[0]
    np.testing.assert_allclose(tally.samples, [1.0, 0.5])
    assert landing.size == 6.0
    np.testing.assert_allclose(landing.mass_shares, [0.5, 1 / 6, 1 / 6, 1 / 6])


def test_a_run_shows_shares_with_collisions_and_without(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from wakeflow.cli.show_result import show_result

    scene = pipeline(DENSE).scene
    result = wf.run(scene, tmp_path)
    assert result.landings.slab is not None
    assert result.landings.without_collisions is not None
    met = separate(scene, crowd(DENSE).landings)
    alone = separate(scene, pipeline(DENSE).tracks().landings)
    for found, counted in ((result.landings.separation, met), (result.landings.without_collisions, alone)):
        (value, low, high), (share, least, most) = found.share("hard", "far"), counted.share("hard", "far")
        assert value == share
        assert low < least < most < high  # the total holds what the samples leave
    assert wf.Result.load(tmp_path).to_json() == result.table
    assert json.loads((tmp_path / "result.json").read_text())["slab"]["replicates"] == crowd(DENSE).replicates
    sources = {part.source for row in result.budget for part in row.parts}
    assert {"sampling", "slab-time-step", "slab-depth"} <= sources
    assert COLLISIONS not in sources
    assert "share without collisions (%)" in (tmp_path / "separation.csv").read_text().splitlines()[0]
    assert "What crowding costs" in (tmp_path / "report.html").read_text()
    show_result(result)
    out = capsys.readouterr().out
    assert "granules colliding" in out
    assert "without collisions" in out
    off = wf.run(scene, tmp_path / "off", force={COLLISIONS: False})
    assert off.landings.slab is None
    assert "slab" not in off.table
    (value, low, high), (share, least, most) = off.share("hard", "far"), alone.share("hard", "far")
    assert value == share
    assert low <= least < most <= high  # not known for meetings left out of so dense a feed: it may be all
    assert COLLISIONS in {part.source for row in off.budget for part in row.parts}


def test_replicates_without_a_fraction_are_taken_together() -> None:
    fraction, replicate = np.array([0, 0, 0, 0, 1, 1]), np.array([0, 1, 2, 3, 0, 3])
    one = np.zeros(6, dtype=int)
    assert _grouped(fraction, replicate, one, 2).tolist() == [0, 1, 0, 1, 0, 1]
    assert _grouped(fraction, replicate, np.array([0, 1, 2, 3, 0, 3]), 2).tolist() == replicate.tolist()
    every = np.array([0, 0, 0, 0, 1, 1, 1, 1]), np.array([0, 1, 2, 3, 0, 1, 2, 3])
    assert _grouped(*every, np.zeros(8, dtype=int), 2).tolist() == every[1].tolist()
