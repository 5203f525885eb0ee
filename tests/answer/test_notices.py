"""What a user must know: graded, few on screen, and said of what leaves through the top."""

import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from support import shipped
from wakeflow.answer.notices import ENDINGS, _out_of_the_top, _unlanded
from wakeflow.cli.screen import MOST_WARNINGS, warn
from wakeflow.core.graded import Grade
from wakeflow.pipeline.landings import Landings
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene
from wakeflow.tracking import Fate

KEY = re.compile(r"\b[a-z]+\.[a-zA-Z_.]+|--force [a-z.-]+=o|\[[a-z.A-Z]+\]")  # air.speed, --force lift=on, [vibration]


def test_granules_that_leave_above_are_told_and_those_that_fall_are_not() -> None:
    scene = shipped("aspirator")
    above, below = scene.level + 0.1, scene.level - 0.1
    row = np.zeros(4, dtype=int)
    landing = Landings(
        position=np.array([[0.0, above], [0.0, above], [0.0, below], [0.0, above]]),
        bin=np.array([-1, -1, -1, 0]),  # the last one came to a bin
        replicate=row, diameter=row, fate=np.full(4, Fate.ESCAPED), time=row, impacts=row, realisation=row, cycle=row,
    )  # fmt: skip
    tracked = cast("Any", SimpleNamespace(landings={"straw": landing}))
    (told,) = _out_of_the_top(scene, tracked)
    assert told.text.startswith("straw: 0.5 of it leaves through the top")
    assert "on = 'top'" in told.text
    (thrown,) = _out_of_the_top(scene.replace({"air.direction": "down"}), tracked)
    assert thrown.text.startswith("straw: 0.5 of it is thrown out through the top")
    assert "channel.top" in thrown.text


def test_the_gravest_stand_on_screen_and_the_rest_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    plan = make_plan(shipped("rhombus"), force={"collisions": False, "air-loading": False})
    warn(plan.warnings, [notice.grade.value for notice in plan.notices])
    out = capsys.readouterr().out
    assert plan.notices[0].grade is Grade.VOID  # 500 kg/h are far beyond independent granules
    assert sum(out.count(f"! {grade.value}: ") for grade in Grade) == MOST_WARNINGS
    assert f"! and {len(plan.notices) - MOST_WARNINGS} more" in out


def test_what_upward_air_carries_out_has_its_own_bin() -> None:
    scene = shipped("aspirator")
    assert scene.with_top() is scene  # it has a bin up there
    tables = scene.tables()
    del tables["bin"]["light"], tables["fraction"]["straw"]["target"], tables["fraction"]["internodes"]["target"]
    lost = Scene.parse(tables)
    caught = lost.with_top()
    assert [list(lost.bin), list(caught.bin)] == [["heavy"], ["heavy", "top"]]
    assert np.array_equal(caught.bin["top"].line(caught.channel)[:, 0], [-0.1, 0.1])
    assert lost.replace({"air.direction": "down"}).with_top().bin == lost.bin
    assert make_plan(lost).airflow.kind == "analytic"

    row = np.zeros(4, dtype=int)
    landing = Landings(
        position=np.full((4, 2), 0.6), bin=np.array([1, 1, 0, 1]), replicate=row, diameter=row,
        fate=np.full(4, Fate.BINNED), time=row, impacts=row, realisation=row, cycle=row,
    )  # fmt: skip
    (told,) = _out_of_the_top(caught, cast("Any", SimpleNamespace(landings={"straw": landing})))
    assert (told.grade, told.text) == (
        Grade.INFORMATION,
        "straw: 0.75 of it leaves through the top with the air, counted as top; a lower air.speed keeps it in",
    )


def test_every_ending_that_is_no_landing_names_a_key_to_change() -> None:
    fates = {"straw": {"binned": 80, **dict.fromkeys(ENDINGS, 4)}}
    told = list(_unlanded(fates))
    assert len(told) == len(ENDINGS)
    assert not [notice.text for notice in told if not KEY.search(notice.text.partition(";")[2])]


def test_every_doubt_of_a_shipped_plan_ends_with_the_key_to_change() -> None:
    for name in ("rhombus", "prism", "aspirator"):
        doubts = [one.text for one in make_plan(shipped(name)).notices if one.grade is not Grade.INFORMATION]
        assert not [text for text in doubts if not KEY.search(text[-110:])], name
