"""[uncertainty]: which numbers move together, which is never above another, and what of this cannot be."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pages import blocks
from support import CASES, DOCS, shipped
from wakeflow.core.errors import SceneError
from wakeflow.extras.page.form import form_of
from wakeflow.scene import Scene
from wakeflow.scene.overrides import changes_of
from wakeflow.scene.uncertainty import correlation_of, margins_of, orders_of

WHEAT, CHAFF, DUST = (f"fraction.{name}.restitution" for name in ("wheat", "chaff", "dust"))
AIR, WIDTH = "air.speed", "feed.width"
TIES = {
    "uncertainty.together": [{"inputs": [WHEAT, CHAFF], "correlation": 0.8}],
    "uncertainty.never_above": [[DUST, CHAFF, WHEAT]],
    "uncertainty.air.speed": "2 %",
}


def _tied(correlation: float, *inputs: str) -> dict[str, Any]:
    return {"inputs": list(inputs), "correlation": correlation}


def test_ties_survive_saving_and_changes(tmp_path: Path) -> None:
    scene = shipped("rhombus", TIES)
    scene.save(tmp_path / "scene.toml")
    again = Scene.load(tmp_path / "scene.toml")
    assert again == scene
    assert again.tables() == scene.tables() != shipped("rhombus").tables()
    other = again.replace({"uncertainty.feed.width": "1 mm"})
    assert margins_of(other.uncertainty) == {AIR: "2 %", WIDTH: pytest.approx(1e-3)}
    assert orders_of(other.uncertainty) == [(DUST, CHAFF), (CHAFF, WHEAT)]
    np.testing.assert_array_equal(correlation_of(other.uncertainty, [WHEAT, AIR, CHAFF])[0], [1.0, 0.0, 0.8])
    assert orders_of(other.replace({"uncertainty.never_above": []}).uncertainty) == []


def test_the_command_line_gives_ties_as_lists() -> None:
    text = f'uncertainty.never_above=[["{CHAFF}", "{WHEAT}"]]'
    given = f'uncertainty.together=[{{inputs=["{CHAFF}", "{WHEAT}"], correlation=0.5}}]'
    scene = shipped("rhombus", changes_of([text, given]))
    assert orders_of(scene.uncertainty) == [(CHAFF, WHEAT)]
    assert correlation_of(scene.uncertainty, [WHEAT, CHAFF])[0, 1] == 0.5


def test_the_example_of_the_documents_is_a_scene(tmp_path: Path) -> None:
    (example,) = [block.body for block in blocks(DOCS / "uncertainty.md") if "together" in block.heading]
    file = tmp_path / "scene.toml"
    file.write_text((CASES / "rhombus.toml").read_text(encoding="utf-8") + "\n" + example)
    uncertainty = Scene.load(file).uncertainty
    assert orders_of(uncertainty) == [(CHAFF, WHEAT)]
    assert correlation_of(uncertainty, [WHEAT, CHAFF, "fraction.wheat.moisture"])[0, 1:].tolist() == [0.8, -0.4]


def test_the_form_of_the_page_shows_ties() -> None:
    import tomlkit

    data = tomlkit.parse(shipped("rhombus", {key: TIES[key] for key in list(TIES)[1:]}).as_toml())
    fields = next(group for group in form_of(data) if group["table"] == "uncertainty")["fields"]
    assert [field["label"] for field in fields] == ["never_above", AIR]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("together", [{"inputs": [WHEAT, CHAFF], "corelation": 0.5}], "corelation: unknown key; did you mean 'correl"),
        ("together", [{"inputs": [WHEAT, CHAFF]}], "together[1].correlation: missing (allowed: > -1 and < 1)"),
        ("together", [_tied(1.0, WHEAT, CHAFF)], "together[1].correlation = 1.0: too large (allowed: > -1 and < 1)"),
        ("together", [_tied(-1, WHEAT, CHAFF)], "together[1].correlation = -1: too small"),
        ("together", [_tied(0.5, WHEAT)], "inputs = ['fraction.wheat.restitution']: needs at least 2 entries"),
        ("together", [_tied(0.5, WHEAT, WHEAT)], "together[1].inputs: names a number twice"),
        (
            "together",
            [_tied(0.5, WHEAT, "air.sped")],
            "together[1].inputs: no number 'air.sped' that is drawn with oth",
        ),
        ("together", [_tied(0.5, WHEAT, "air.sped")], "; did you mean 'air.speed'?"),
        ("together", [_tied(0.5, WHEAT, "collisions.friction")], "no number 'collisions.friction' that is drawn with"),
        (
            "together",
            [_tied(0.5, AIR, WHEAT), _tied(0.5, CHAFF, WHEAT, AIR)],
            "together[2]: how air.speed and fraction",
        ),
        ("together", {"inputs": [WHEAT, CHAFF], "correlation": 0.5}, "together: needs a list between [ ]"),
        ("together", 3, "together = 3: needs a list between [ ]"),
        ("together", [3], "together[1] = 3: is a table"),
        (
            "together",
            [_tied(-0.9, WHEAT, CHAFF, DUST)],
            "together[1]: no numbers move together like this; lower to -0.4",
        ),
        (
            "together",
            [_tied(0.3, AIR, WIDTH), _tied(0.9, WHEAT, CHAFF), _tied(0.9, CHAFF, DUST)],
            "uncertainty.together[2], together[3]: no numbers move together like this; lower to 0.702, 0.702, or say",
        ),
        ("togehter", [_tied(0.5, WHEAT, CHAFF)], "togehter: no number that takes an uncertainty; did you mean 'togeth"),
        ("never_above", [[WHEAT]], "never_above[1] = ['fraction.wheat.restitution']: needs at least 2 entries"),
        ("never_above", [CHAFF, WHEAT], "never_above[1] = 'fraction.chaff.restitution': needs a list between [ ]"),
        ("never_above", [[CHAFF, WHEAT], [WHEAT, DUST], [DUST, CHAFF]], "goes round: "),
        ("never_above", [[CHAFF, WHEAT, CHAFF]], "never_above[1]: names a number twice"),
        ("never_above", [[CHAFF, "fraction.wheet.restitution"]], "did you mean 'fraction.wheat.restitution'?"),
        ("never_above", [[WHEAT, AIR]], "restitution (no unit) cannot be compared with air.speed (m/s)"),
        ("never_above", [["fraction.wheat.size", "feed.speed"]], "size (m) cannot be compared with feed.speed (m/s)"),
    ],
)
def test_what_cannot_be_is_one_line(key: str, value: object, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        shipped("rhombus", {f"uncertainty.{key}": value})
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ties", [[(0.9, WHEAT, CHAFF), (0.9, CHAFF, DUST)], [(-0.7, WHEAT, CHAFF, DUST)]])
def test_what_a_message_says_of_correlations_can_be(ties: list[tuple[Any, ...]]) -> None:
    with pytest.raises(SceneError) as caught:
        shipped("rhombus", {"uncertainty.together": [_tied(*one) for one in ties]})
    said = str(caught.value).partition("lower to ")[2].split(" or ")[0].rstrip(",").split(", ")
    lowered = [_tied(float(found), *inputs) for found, (_, *inputs) in zip(said, ties, strict=True)]
    scene = shipped("rhombus", {"uncertainty.together": lowered})
    assert np.linalg.eigvalsh(correlation_of(scene.uncertainty, [WHEAT, CHAFF, DUST])).min() < 0.05
