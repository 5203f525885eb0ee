"""The JSON schema: with it an editor takes every shipped scene, refuses what the program does, explains each key."""

import copy
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from support import CASES
from wakeflow.core.errors import SceneError
from wakeflow.scene import Scene
from wakeflow.scene.schema import scene_schema

OF_MANY = ("sweep-*.toml", "search-*.toml")  # tables beside a scene's own
SCENES = sorted(path for path in CASES.rglob("*.toml") if not any(path.match(name) for name in OF_MANY))


@cache
def _validator() -> Draft202012Validator:
    schema = scene_schema()
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def _complaints(data: dict[str, Any]) -> list[str]:
    return [f"{error.json_path}: {error.message}" for error in _validator().iter_errors(data)]


@pytest.mark.parametrize("path", SCENES, ids=lambda path: str(path.relative_to(CASES)))
def test_every_shipped_scene_is_accepted(path: Path) -> None:
    assert _complaints(tomllib.loads(path.read_text(encoding="utf-8"))) == []


def test_a_saved_scene_is_accepted() -> None:
    assert _complaints(Scene.load(CASES / "labyrinth.toml").tables()) == []


BOTH = [  # of rhombus.toml: what program and editor take, and what both refuse
    ({"vibration.frequency": "1800 rpm"}, True),
    ({"fraction.wheat.mass_share": "90 %"}, True),
    ({"air.turbulence": "5 %"}, True),
    ({"fraction.wheat.size": "4 mm"}, True),
    ({"fraction.wheat.size": 0.004}, True),
    ({"fraction.wheat.terminal_velocity": {"distribution": "uniform", "low": 7.0, "high": "8 m/s"}}, True),
    ({"feed.profile": "triangular"}, True),
    ({"numerics.ranks": "auto"}, True),
    ({"bin.slope": {"points": [["-190 mm", 0], [-0.1, "-0.1 m"]]}}, True),
    ({"picture.waves": {"kind": "curves", "drop": "20 mm"}}, True),
    ({"air.speed": "1,5 m/s"}, False),
    ({"air.speed": "5"}, False),
    ({"air.speed": 101.0}, False),
    ({"air.spede": 5.0}, False),
    ({"air.direction": "sideways"}, False),
    ({"body.rhombus.slope_angle": 60}, False),
    ({"fraction.wheat.mass_share": 90}, False),
    ({"fraction.wheat.size": 4}, False),
    ({"feed.count": 8}, False),
    ({"bin.a b": {"from": 0.0, "to": 0.01}}, False),
    ({"picture.waves": {"kind": "curvs"}}, False),
    ({"picture.waves": {"kind": "density", "drop": "20 mm"}}, False),
]


@pytest.mark.parametrize(("changes", "good"), BOTH, ids=lambda value: str(value)[:60])
def test_program_and_schema_agree(changes: dict[str, Any], good: bool) -> None:
    data = tomllib.loads((CASES / "rhombus.toml").read_text(encoding="utf-8"))
    changed = copy.deepcopy(data)
    for key, value in changes.items():
        *tables, last = key.split(".")
        table = changed
        for name in tables:
            table = table.setdefault(name, {})
        table[last] = value
    assert (_complaints(changed) == []) is good
    if good:
        Scene.parse(changed)
    else:
        with pytest.raises(SceneError):
            Scene.parse(changed)


def test_air_needs_a_speed_or_a_case() -> None:
    data = tomllib.loads((CASES / "rhombus.toml").read_text(encoding="utf-8"))
    assert _complaints({**data, "air": {"case": "my-case"}}) == []
    assert _complaints({**data, "air": {"direction": "up"}}) != []


def test_every_key_is_explained_with_unit_range_and_default() -> None:
    schema = scene_schema()
    for name, table in schema["$defs"].items():
        assert table["description"], name
        for key, node in table["properties"].items():
            assert "const" in node or "$ref" in node or node.get("description"), f"{name}.{key}"
    air, vibration = schema["$defs"]["Air"]["properties"], schema["$defs"]["Vibration"]["properties"]
    assert air["speed"]["unit"] == "m/s"
    assert air["speed"]["description"] == (">= 1e-06 m/s and <= 100 m/s; a number in m/s, or a string such as '5 m/s'")
    assert air["turbulence"]["default"] == 0.05
    assert vibration["direction"]["default"] == pytest.approx(1.5707963)
    assert "null" not in str(schema)
    assert "None" not in str(schema)
