"""Every kind of bin: it is read as its own, its line ends tracks or its body keeps them, and its grips move it."""

from __future__ import annotations

import numpy as np
import pytest

from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.scene import Scene
from wakeflow.scene.bins import bin_kinds, kind_of

EXAMPLES = {  # of each kind, in the channel of the vacuum scene; a new one adds its own
    "side": {"on": "left", "from": "-100 mm", "to": "-20 mm"},
    "polyline": {"points": [["150 mm", "-60 mm"], ["200 mm", "-70 mm"], ["250 mm", "-60 mm"]]},
    "body": {"on": "prism"},
}


def with_bin(table: dict[str, object]) -> Scene:
    """The vacuum scene with one more bin, ``own``."""
    tables = shipped("vacuum").tables()
    return Scene.parse({**tables, "bin": {**tables["bin"], "own": table}})


@pytest.mark.parametrize("name", bin_kinds)
def test_a_bin_is_read_as_its_kind_and_written_as_it_was_read(name: str) -> None:
    scene = with_bin(EXAMPLES[name])
    own = scene.bin["own"]
    assert kind_of(EXAMPLES[name]) == kind_of(own) == name
    assert type(own) is bin_kinds[name]
    assert Scene.parse(scene.tables()) == scene
    line = own.line(scene)
    assert line.shape[1] == 2
    assert np.isfinite(own.along(scene, line)).all()
    assert (scene.collecting.get(own.body or "") == 2) is (own.body is not None)
    assert own.passed(scene)


@pytest.mark.parametrize("name", bin_kinds)
def test_what_is_dragged_moves_that_point_alone(name: str) -> None:
    scene = with_bin(EXAMPLES[name])
    for number, grip in enumerate(scene.bin["own"].grips(scene)):
        to = np.add(grip.at, [0.004 if "x" in grip.axis else 0.0, -0.004 if "y" in grip.axis else 0.0])
        moved = scene.replace({f"bin.own.{grip.key}": grip.moved(*map(float, to))})
        before, after = (one.bin["own"].line(one) for one in (scene, moved))
        assert np.allclose(after[number], to)
        others = np.arange(len(before)) != number
        assert np.array_equal(after[others], before[others])


def test_an_unknown_key_of_a_bin_is_told_with_those_of_all_kinds() -> None:
    with pytest.raises(
        SceneError, match=r"bin\.own\.poins: unknown key; did you mean 'points'\? \(known: on, from, to, keeps, points"
    ):
        with_bin({"poins": [], "from": "0 mm", "to": "1 mm"})
