"""The operator's map: recovery and purity over air speed and feed rate, one figure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import wakeflow as wf
from support import Here, shipped
from wakeflow.core.errors import SceneError
from wakeflow.extras.studies import operating
from wakeflow.extras.studies.operating import counted_lines


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"feed": None}, "needs an air.speed above 0 and a feed.rate"),
        ({"target": None}, "no fraction has a target"),
    ],
)
def test_a_scene_without_what_a_map_is_over_is_refused(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    scene = shipped("aspirator")
    if "feed" in changes:
        scene = scene.model_copy(update={"feed": scene.feed.model_copy(update={"rate": 0.0})})
    else:
        bare = {name: one.model_copy(update={"target": ""}) for name, one in scene.fraction.items()}
        scene = scene.model_copy(update={"fraction": bare})
    with pytest.raises(SceneError, match=said):
        operating.operating_map(scene, tmp_path)


def test_one_value_is_no_map(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="two air speeds and two feed rates at least"):
        operating.operating_map(shipped("aspirator"), tmp_path, air=["5 m/s"])


def test_a_map_is_a_sweep_with_one_figure(tmp_path: Path) -> None:
    scene, here = shipped("aspirator", {"feed.count": 64, "force.collisions": "off"}), Here()
    found, figure = operating.operating_map(
        scene, tmp_path, air=["5 m/s", "6 m/s"], feed=["0.5 kg/hour", "1 kg/hour"], scheduler=here
    )
    assert isinstance(found, wf.Sweep)
    assert len(found.table.done) == 4
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_a_capacity_curve_is_a_sweep_over_the_rate_with_one_figure(tmp_path: Path) -> None:
    scene, here = shipped("vacuum", {"feed.count": 64, "feed.rate": "1 kg/hour"}), Here()
    found, figure = operating.capacity(scene, tmp_path, feed=["0.5 kg/hour", "1 kg/hour"], scheduler=here)
    assert len(found.table.done) == 2
    assert {"loss.hard", "lost.hard", "dirt.near"} <= found.table.names.keys()
    assert [one.by_name["lost.hard"].unit for one in found.table.done] == ["kg/h", "kg/h"]
    assert (figure.name, figure.read_bytes()[:4]) == ("capacity.png", b"\x89PNG")
    high = max(one.by_name["loss.hard"].high for one in found.table.done)
    met = operating.met_up_to(found.table, {"loss.hard": high, "dirt.near": 1e-6})
    assert met == {"loss.hard": pytest.approx(1.0 / 3600.0), "dirt.near": 0.0}
    low = min(one.by_name["loss.hard"].low for one in found.table.done)
    counted = [operating.met_at(found.table, {"loss.hard": most})["loss.hard"] for most in (high, low / 2.0)]
    assert counted == [{"met": 2}, {"not met": 2}]
    void = replace(found.table, entries=[replace(one, reason="void") for one in found.table.entries])
    assert operating.met_at(void, {"loss.hard": high})["loss.hard"] == {"open": 2}
    (line,) = counted_lines(operating.met_at(void, {"loss.hard": high}), {"loss.hard": high})
    assert line.endswith("open at 2 of 2 settings")
    with pytest.raises(SceneError, match=r"needs a feed\.rate"):
        operating.capacity(shipped("vacuum"), tmp_path)
    with pytest.raises(SceneError, match="two feed rates"):
        operating.capacity(scene, tmp_path, feed=["1 kg/hour"])
