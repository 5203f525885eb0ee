"""Error against run time of a scene: a row a budget, the picture, the table; what is published goes before."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import pytest

from proofs import commands, scene_curves
from proofs.airflow.airflow import is_published
from proofs.scene_curves import EMPTY, WITH_AIR, run_curves
from proofs.tracker import peer
from proofs.tracker.peer import PEER, beside, peer_rows, why_no_peer
from support import CASES, shipped
from wakeflow.answer.separation import separate
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene


def test_a_scene_gets_a_row_for_every_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its air, flown from impact to impact; a second is not enough for any answer."""
    monkeypatch.setattr(scene_curves, "BUDGETS", (1.0, 60.0, 120.0))
    tables = shipped("prism", {"numerics.rung": "none", "feed.count": 1024}).tables()
    name = next(iter(tables["fraction"]))
    tables["fraction"] = {name: {**tables["fraction"][name], "mass_share": 1.0}}
    tables["feed"].pop("rate", None)
    path = tmp_path / "own.toml"
    Scene.parse(tables).save(path)
    cache = os.environ["WAKEFLOW_CACHE"]
    report = run_curves(path, tmp_path, slow=False, beside=beside).write(tmp_path)
    assert os.environ["WAKEFLOW_CACHE"] == cache
    assert any(PEER in note for note in report.notes)  # and why its rows are not there
    rows = report.data()["rows"]
    assert [row["knob"] for row in rows] == [EMPTY] * 3 + [WITH_AIR] * 3
    assert [row["setting"] for row in rows] == 2 * ["1 s", "60 s", "2 min"]
    for refused, answered, longer in (rows[:3], rows[3:]):
        assert refused["chosen"].startswith("refused: the quickest answer takes about")
        assert refused["error"] is None
        assert answered["chosen"] == "the scene's own"
        assert answered["error"] <= answered["half"]
        every = 1 + len(tables["bin"])
        assert answered["inside"] == f"{every} of {every}"
        assert longer == {**answered, "setting": "2 min"}
    with (tmp_path / "curves-own.csv").open() as stream:
        assert [row["knob"] for row in csv.DictReader(stream)] == [row["knob"] for row in rows]
    assert json.loads((tmp_path / "curves-own.json").read_text())["rows"] == rows
    for ending in ("png", "svg"):
        assert (tmp_path / f"curves-own.{ending}").stat().st_size > 1000
    commands.show({"curves-own": report})


@pytest.mark.openfoam
def test_the_peer_answers_beside_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Heavy grain without scatter flies as it does there; the rest of the truth is left out."""
    monkeypatch.setattr(peer, "COUNTS", (64,))
    scene = shipped("rhombus", {"numerics.mesh_scale": 3.0, "numerics.rung": "draft"})
    plain = scene.replace({f"fraction.{name}.impact": "paper" for name in scene.fraction})
    alone = make_plan(plain, force={"collisions": False, "air-loading": False})
    wheat = separate(plain, Pipeline(plain, alone).tracks().landings).fractions["wheat"]
    truth = {("wheat", place): share.value for place, share in wheat.items()}
    (row,) = peer_rows(scene, truth)
    assert row["knob"] == PEER
    assert row["error"] < 0.08
    assert row["seconds"] > 1.0  # mesh and airflow are part of it


def test_scenes_that_the_peer_cannot_compute_say_why() -> None:
    assert why_no_peer(shipped("rhombus")) is None
    assert "no airflow about a body" in str(why_no_peer(shipped("vacuum")))
    assert "no airflow about a body" in str(why_no_peer(shipped("aspirator")))


def test_what_is_published_is_told_apart() -> None:
    assert is_published(CASES / "verify" / "square-100.toml")
    assert not is_published(CASES / "rhombus.toml")
