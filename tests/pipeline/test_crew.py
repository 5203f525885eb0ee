"""Several processes fly one scene side by side: each piece once, and the answer of one process alone."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import shipped
from wakeflow.pipeline import tracks
from wakeflow.pipeline.draws import DrawStage
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.make import make_plan
from wakeflow.results.result import Request
from wakeflow.runs import help_along, run

SCENE = {"numerics.rung": "none", "feed.count": 512}
SMALL = 128  # granules at a time, instead of some hundred thousand


def test_each_of_a_crew_flies_what_no_other_is_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracks, "AT_ONCE", SMALL)
    scene = shipped("rhombus", SCENE)
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "alone"))
    alone = run(scene, tmp_path / "one", report=False)
    flown: Counter[str] = Counter()
    keep, some = Flight.keep_piece, DrawStage._fly_some

    def keep_piece(self: Flight, piece: Any, folder: Path, *, drawn: bool) -> None:
        flown[f"{self.replicates} {self.tolerance} {piece}"] += 1
        keep(self, piece, folder, drawn=drawn)

    def fly_some(self: DrawStage, numbers: range, *more: Any) -> None:
        flown[f"draws {numbers}"] += 1
        some(self, numbers, *more)

    monkeypatch.setattr(Flight, "keep_piece", keep_piece)
    monkeypatch.setattr(DrawStage, "_fly_some", fly_some)
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "shared"))
    with ThreadPoolExecutor(2) as pool:
        helper = pool.submit(help_along, scene, Request(None, None, {}, None), make_plan(scene), workers=1, crew=2)
        both = pool.submit(run, scene, tmp_path / "two", report=False, workers=1, crew=2)
        helper.result()
        found = both.result()
    assert set(flown.values()) == {1}
    assert sum(name.startswith("draws") for name in flown) == 8
    assert len(flown) == 8 + 3 * 4 + 3  # pieces of the answer, and of a companion that flies a quarter at once
    assert not list((tmp_path / "shared").glob("*-pieces/*/manifest.json"))
    assert found.table["separation"] == alone.table["separation"]
    with np.load(tmp_path / "one" / "granules.npz") as one, np.load(tmp_path / "two" / "granules.npz") as two:
        assert set(one.files) == set(two.files)
        for key in one.files:
            np.testing.assert_array_equal(one[key], two[key])
