"""What a user must know: graded, few on screen, and said of what leaves through the top."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from support import shipped
from wakeflow.core.graded import Grade
from wakeflow.pipeline.landings import Landings
from wakeflow.planning.make import make_plan
from wakeflow.results.notices import _out_of_the_top
from wakeflow.terminal import MOST_WARNINGS, show_plan
from wakeflow.tracking import Fate


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
    show_plan(plan)
    out = capsys.readouterr().out
    assert plan.notices[0].grade is Grade.VOID  # 500 kg/h are far beyond independent granules
    assert sum(out.count(f"! {grade.value}: ") for grade in Grade) == MOST_WARNINGS
    assert f"! and {len(plan.notices) - MOST_WARNINGS} more" in out
