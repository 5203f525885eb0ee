"""Which airflow a scene gets, and what is computed beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from wakeflow.core.errors import SceneError
from wakeflow.planning.airflow import FLAT_BELOW, LAMINAR_BELOW, SHEDDING_ABOVE, choose_airflow
from wakeflow.planning.cost import airflow_cost
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import COMPARED, REPLICATES
from wakeflow.scene import Scene

OFF = {"basset-history": False}


def at(scene: Scene, reynolds: float) -> Scene:
    assert scene.reynolds is not None and scene.air is not None  # noqa: PT018
    return scene.replace({"air.speed": scene.air.speed * reynolds / scene.reynolds})


@pytest.mark.parametrize(
    ("reynolds", "target", "rung", "stepping", "turbulence", "brackets"),
    [
        (0.9 * SHEDDING_ABOVE, 0.01, "draft", "steady", "laminar", False),
        (0.9 * SHEDDING_ABOVE, 0.002, "reference", "steady", "laminar", False),
        (0.9 * FLAT_BELOW, 0.01, "standard", "time-resolved", "laminar", False),
        (0.9 * FLAT_BELOW, 0.002, "reference", "time-resolved", "laminar", False),
        (1.1 * FLAT_BELOW, 0.01, "standard", "time-resolved", "laminar", True),
        (1.1 * LAMINAR_BELOW, 0.01, "standard", "time-resolved", "kOmegaSST", True),
        (16_500.0, 0.002, "standard", "time-resolved", "kOmegaSST", True),
    ],
)
def test_auto_goes_by_reynolds_number_and_accuracy(
    rhombus: Scene, reynolds: float, target: float, rung: str, stepping: str, turbulence: str, brackets: bool
) -> None:
    found = choose_airflow(at(rhombus, reynolds), "auto", target)
    assert (found.rung, found.stepping, found.turbulence, found.brackets) == (rung, stepping, turbulence, brackets)
    assert found.half == (stepping == "steady")
    assert len(found.scales) == (3 if rung == "reference" else 2)
    assert f"Re {reynolds:.3g}" in found.why


def test_half_of_the_channel_only_where_it_is_its_own_mirror_image(rhombus: Scene) -> None:
    aside = rhombus.replace({"body.rhombus.at": [0.01, 0.0]})
    for scene, symmetric in ((rhombus, True), (aside, False)):
        assert choose_airflow(scene, "draft", 0.01).half == symmetric
        assert not choose_airflow(scene, "standard", 0.01).half


def test_the_plan_says_why_and_what_it_computes_beside(rhombus: Scene) -> None:
    lines = "\n".join(make_plan(rhombus, force=OFF).used)
    assert "rung standard, time-resolved, kOmegaSST" in lines
    assert "between the steady and the time-resolved wake" in lines
    assert f"1 in {REPLICATES // COMPARED} granules" in lines
    lines = "\n".join(make_plan(at(rhombus, 100.0), rung="reference", force=OFF).used)
    assert "cell edges of 0.67, 1, 1.5 times the usual" in lines
    assert "1 in 4 granules" not in lines


def test_a_finer_rung_is_expected_to_cost_more(rhombus: Scene) -> None:
    spent = [
        airflow_cost(rhombus, choose_airflow(rhombus, rung, 0.01)).seconds
        for rung in ("draft", "standard", "reference")
    ]
    assert spent[0] < spent[1] < spent[2]


@pytest.mark.parametrize(
    ("name", "rung", "words"),
    [("vacuum", "draft", "needs an"), ("aspirator", "none", "body"), ("rhombus", "drft", "draft")],
)
def test_a_rung_that_cannot_be_is_refused(cases: Path, name: str, rung: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        choose_airflow(Scene.load(cases / f"{name}.toml"), rung, 0.01)
