"""Real airflows in a sweep: each solved once, by workers, and what the table says of it."""

import json
from pathlib import Path

import pytest

import wakeflow as wf
from support import shipped


@pytest.mark.openfoam
def test_a_change_of_restitution_solves_no_airflow(tmp_path: Path) -> None:
    """Two scenes fly at once in one airflow, which neither of them solves."""
    few = {"feed.count": 64, "feed.rate": "0.5 kg/hour"}  # that neither meet nor load the air
    scene = shipped("rhombus", {"numerics.mesh_scale": 3.0, **few})
    found = wf.variants(scene, {"fraction.chaff.restitution": [0.21, 0.34]})
    sweep = wf.sweep(found, tmp_path, rung="draft", workers=2)
    assert sweep.failed == {}
    assert len(list((tmp_path / "airflows").iterdir())) == 1
    stages = [json.loads((tmp_path / one.name / "result.json").read_text())["seconds"] for one in found]
    assert all(seconds["airflow"]["cached"] and seconds["mesh"]["cached"] for seconds in stages)
    assert len({seconds["airflow"]["seconds"] for seconds in stages}) == 1
    drag = [entry.by_name["airflow.cd"] for entry in sweep.table.entries]
    assert drag[0] == drag[1]
    assert drag[0].value > 1.0
