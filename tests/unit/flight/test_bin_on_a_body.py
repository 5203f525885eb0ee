"""A bin on a body: what touches the body stays, and counts as landed there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.core.errors import SceneError
from wakeflow.runs.planned import make_plan

WIDTH, SIZE, FED = 0.010, 0.002, 0.030  # m: of the cylinder, of a granule, of the curtain


def machine(**changes: Any) -> wf.Scene:
    """Granules fall past a cylinder that keeps them."""
    tables = {
        "body": {"cylinder": {"shape": "circle", "width": WIDTH, "corners": 720}},
        "channel": {"width": 0.2, "top": 0.1, "bottom": -0.1},
        "feed": {"height": 0.05, "width": FED, "count": 4096},
        "fraction": {"drops": {"size": SIZE, "density": 1000.0, "restitution": 0.5, "friction": 0.3, "target": "dish"}},
        "bin": {"dish": {"on": "cylinder"}, "floor": {"from": -0.1, "to": 0.1}},
    }
    return wf.Scene.parse(tables).replace(changes) if changes else wf.Scene.parse(tables)


@pytest.mark.parametrize("moving", [{}, {"vibration.frequency": 20.0, "vibration.amplitude": "3 mm"}])
def test_what_falls_onto_the_body_is_in_its_bin(moving: dict[str, Any], tmp_path: Path) -> None:
    """Everything whose centre falls within the two radii, wherever the body is at the time; nothing bounces."""
    result = wf.run(machine(**moving), tmp_path)
    found = result.landings.separation.fractions["drops"]
    assert found["dish"].value == pytest.approx((WIDTH + SIZE) / FED, abs=2e-3)
    assert found["dish"].value + found["floor"].value == pytest.approx(1.0, abs=1e-12)
    assert result.landings.separation.recovery["drops"].value == found["dish"].value
    kept = np.load(tmp_path / "granules.npz")
    here = kept["position"][kept["bin"] == 0]
    reach = 0.5 * (WIDTH + SIZE) + (0.003 if moving else 0.0)
    assert np.all(np.linalg.norm(here, axis=1) < reach * (1.0 + 1e-3))
    assert (tmp_path / "report.html").is_file()


def test_granules_that_meet_stay_there_too(tmp_path: Path) -> None:
    scene = machine(**{"feed.rate": "20 kg/hour", "feed.count": 256, "force.collisions": "on"})
    result = wf.run(scene, tmp_path, report=False)
    found = result.landings.separation.fractions["drops"]
    assert found["dish"].value == pytest.approx((WIDTH + SIZE) / FED, abs=0.05)  # a few meet on the way
    assert found["floor"].value > 0.5


def test_the_first_impact_is_the_trackers_and_mirrored_bodies_have_mirrored_bins() -> None:
    assert make_plan(machine()).fractions["drops"].mode == "resolved"
    drums = {
        f"body.{name}": {"shape": "circle", "width": WIDTH, "at": [at, -0.04]}
        for name, at in (("l", -0.05), ("r", 0.05))
    }
    scene = machine(**drums, **{"bin.left": {"on": "l"}, "bin.right": {"on": "r"}})
    assert scene.images == (0, 1, 3, 2, 4)
    stacked = machine(**{"body.low": {"shape": "circle", "width": WIDTH, "at": [0.0, -0.04]}, "bin.low": {"on": "low"}})
    assert stacked.images == (0, 1, 2, 3)  # each is its own image, none the other's
    assert scene.collecting == {"cylinder": 0, "l": 2, "r": 3}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"bin.dish.on": "cylindre"}, r"bin.dish.on = 'cylindre': no side and no body; did you mean 'cylinder'\?"),
        ({"bin.dish.from": 0.0, "bin.dish.to": 0.01}, "leave out from, to and points"),
        ({"bin.plate.on": "cylinder"}, r"bin.dish and bin.plate are both on body.cylinder"),
        ({"feed.mode": "injected"}, "lets all rebound; choose auto or resolved"),
    ],
)
def test_a_bin_that_cannot_be_on_a_body_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        machine(**changes)
