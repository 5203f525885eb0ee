"""What is flown for a film: every granule that is there in its time, at the rate of the feed."""

from __future__ import annotations

import numpy as np
import pytest

from support import shipped
from wakeflow.pipeline.film_stage import SINGLY, Film
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.bounds import COLLISIONS
from wakeflow.planning.crowd import number_rates
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene

SPAN = 0.3  # s


def _film(scene: Scene, *, meet: bool) -> Film:
    return Pipeline(scene, make_plan(scene, force={COLLISIONS: meet})).film(SPAN)


def _inside(film: Film, name: str) -> int:
    """Granules that were born in the time of the film."""
    begun = np.array([track["time"][0] for track in film.paths[name]])
    return int(((begun >= film.begin) & (begun < film.begin + SPAN)).sum())


@pytest.mark.parametrize("meet", [True, False])
def test_all_that_are_there_are_there(meet: bool) -> None:
    scene = shipped("vacuum", {"feed.rate": 0.2, "feed.count": 512})
    film = _film(scene, meet=meet)
    assert film.met == meet
    assert film.span == SPAN
    assert film.depth <= scene.feed.depth
    for name in scene.fraction:
        rate = number_rates(scene, name).sum() * film.depth / scene.feed.depth / film.one_in[name]
        assert abs(_inside(film, name) - rate * SPAN) < 5.0 * np.sqrt(rate * SPAN) + 1.0
        there = [int((t["time"][0] <= film.begin + SPAN / 2) & (film.begin + SPAN / 2 <= t["time"][-1]))
                 for t in film.paths[name]]  # fmt: skip
        assert 0 < sum(there) <= 2.0 * SINGLY or meet
        for track in film.paths[name]:
            assert track["time"][-1] > film.begin
            assert track["time"][0] < film.begin + SPAN


def test_a_film_is_flown_once() -> None:
    scene = shipped("vacuum", {"feed.rate": 0.2, "feed.count": 512})
    heard: list[tuple[str, str]] = []
    for _ in range(2):
        heard.clear()
        Pipeline(scene, make_plan(scene), lambda stage, text: heard.append((stage, text))).film(SPAN)
    assert [text for stage, text in heard if stage == "film"] == ["done (from the cache)"]
