"""What is no value of its place, from Python, the command line or a file: one line, and never another number."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.extras.dividers.dividers import trade_off
from wakeflow.scene import Scene
from wakeflow.scene.overrides import changes_of

MATERIAL = """
[pea]
diameter = "7 mm"
density = "1300 kg/m^3"
confidence = "low"
source = "guessed"
restitution = { value = 0.5, std = 0.1, confidence = "low", source = "guessed" }
friction = { value = 0.4, std = 0.1, confidence = "low", source = "guessed" }
impact = { model = "sphere", confidence = "low", source = "guessed" }
moisture = { share = [0.1, 0.2], terminal_velocity = [7.0, 8.0], source = "guessed" }
"""


def variants(**how: Any) -> Callable[[], object]:
    return lambda: wf.variants(shipped("vacuum"), **{"over": {"feed.height": [0.1, 0.12]}, **how})


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (variants(over=5), "over = 5: give keys"),
        (variants(over={1: [1, 2]}), "over = "),
        (variants(seed="x"), "seed = 'x': give a whole number"),
        (variants(design="sobol", count=2.5), "count = 2.5: give a whole number"),
        (variants(fixed=5), "fixed = 5: name each key"),
        (lambda: wf.compare(5), "give a list of runs"),  # type: ignore[arg-type]
        (lambda: shipped("vacuum", {"feed.height": {(1, 2): 3}}), "feed.height: a value of dict"),
        (lambda: Scene.load("a\0b"), "no path holds a zero byte"),
    ],
)
def test_a_wrong_type_is_one_line(call: Callable[[], object], told: str) -> None:
    with pytest.raises(SceneError) as caught:
        call()
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numbers_of_numpy_are_numbers() -> None:
    found = wf.variants(shipped("vacuum"), {"feed.height": np.linspace(0.1, 0.12, 3)}, seed=np.int64(1))  # type: ignore[arg-type]
    assert [one.scene.feed.height for one in found] == [0.1, 0.11, 0.12]


@pytest.mark.parametrize("purity", [2.0, -1.0, 0.0, float("nan"), True, None])
def test_no_curve_is_drawn_of_what_is_no_purity(purity: Any, small_run: Any) -> None:
    for ask in (lambda: trade_off(small_run, "soft", [purity]), lambda: wf.dividers(small_run, "soft", purity)):
        with pytest.raises(SceneError, match="purity"):
            ask()


def test_a_setting_of_two_lines_is_not_its_first() -> None:
    assert changes_of(["feed.count=5\nfeed.seed=3"]) == {"feed.count": "5\nfeed.seed=3"}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[0.1, 0.2]", "[0.1, 0.1]"), "share = [0.1, 0.1]: give the driest first"),
        (("[7.0, 8.0]", "[0, 0]"), "terminal_velocity = [0, 0]: give two numbers above 0"),
        (("1300 kg/m^3", "10 lb/gal"), "'gal' may be 4.55 l or 3.79 l"),
        (("", ""), "fraction.soft.moisture = 30 %: measured from 10 % to 20 % of water"),
    ],
)
def test_a_wrong_material_is_one_line(change: tuple[str, str], told: str, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(MATERIAL.replace(*change))
    tables = shipped("vacuum").tables()
    tables["fraction"]["soft"] = {"material": "pea", "moisture": 0.3, "share": 0.5}
    with pytest.raises(SceneError) as caught:
        Scene.parse({**tables, "materials": "own.toml"}, base=tmp_path)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fraction", [5, "ab", [{"a": 1, "b": 2}], {"soft": {"material": ["pea"]}}])
def test_fractions_that_are_none_are_told_so(fraction: object, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(MATERIAL)
    with pytest.raises(SceneError, match="fraction"):
        Scene.parse({**shipped("vacuum").tables(), "materials": "own.toml", "fraction": fraction}, base=tmp_path)
