"""Air at rest that a curtain drives: what the granules give is what the air has, and they fall faster in it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.air.kinds.analytic import jet_field, jet_of
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import Boxes, ForceDensity
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.airflow_choice import JET
from wakeflow.planning.unknowns import unknowns
from wakeflow.scene import Scene

LOADING = {"air-loading": True, "collisions": False}


def curtain(**changes: object) -> Scene:
    """1 kg/s of beads of 0.7 mm per metre, which fall 1.5 m."""
    tables = {
        "channel": {"width": 2.0, "top": 0.1, "bottom": -1.5},
        "air": {"speed": 0.0},
        "feed": {"level": 0.0, "speed": 0.3, "width": 0.01, "rate": 1.0, "count": 64},
        "fraction": {"bead": {"size": 0.7e-3, "density": 3300.0, "restitution": 0.6, "friction": 0.3}},
        "bin": {"middle": {"from": -0.1, "to": 0.1}},
    }
    return Scene.parse(tables).replace(changes)


def pipeline_of(scene: Scene, **changes: bool) -> Pipeline:
    return Pipeline(scene, wf.plan(scene, force={**LOADING, **changes}))


@cache
def force(scale: float = 1.0) -> ForceDensity:
    """3 N/m2 on the air of a strip 0.1 m wide."""
    boxes = Boxes.across(2.0, -1.5, 0.1, 0.05)
    density = np.zeros((boxes.rows, boxes.columns, 2))
    strip = (np.abs(boxes.centres[..., 0]) < 0.05) & (boxes.centres[..., 1] < 0.0)
    density[strip, 1] = -30.0 * scale
    return ForceDensity(boxes, density)


def test_the_field_carries_the_force_and_keeps_its_volume() -> None:
    scene = curtain()
    field, air = jet_field(scene, force()), scene.airstream
    x = np.linspace(-1.0, 1.0, 4001)
    low = field.sample(np.stack([x, np.full_like(x, -1.49)], axis=1))[0]
    given = 3.0 * 1.49
    assert np.trapezoid(air.density * low[:, 1] ** 2, x) == pytest.approx(given, rel=0.01)
    assert -np.trapezoid(low[:, 1], x) == pytest.approx(jet_of(scene, force()).flux[-1], rel=0.01)
    drawn = field.sample(np.stack([np.full(999, 1.0), np.linspace(-1.49, 0.09, 999)], axis=1))[0]
    assert 2.0 * -np.trapezoid(drawn[:, 0], dx=1.58 / 998) == pytest.approx(-np.trapezoid(low[:, 1], x), rel=0.02)
    assert field.divergence().rms < 0.01
    mirrored = field.sample(np.stack([-x, np.full_like(x, -1.49)], axis=1))[0]
    np.testing.assert_allclose(mirrored * (-1.0, 1.0), low, atol=2e-3)  # triangles' diagonals all lean one way
    assert not field.sample([[0.3, 0.05]])[0].any()  # above the curtain's beginning


def test_a_jet_that_begins_late_is_as_fine_at_its_axis() -> None:
    """Where the first granules give the air nothing, the columns go by where it is narrowest."""
    late = force().density.copy()
    late[force().boxes.centres[..., 1] > -0.3] = 0.0
    field = jet_field(curtain(), ForceDensity(force().boxes, late))
    assert not field.sample([[0.0, -0.2]])[0].any()
    assert np.diff(np.unique(field.points[:, 0])).min() < 0.002


def test_a_curtain_that_begins_beside_the_middle_drives_its_jet_there() -> None:
    field = jet_field(curtain(**{"feed.position": 0.4}), force())
    x = np.linspace(-1.0, 1.0, 2001)
    down = -field.sample(np.stack([x, np.full_like(x, -1.0)], axis=1))[0][:, 1]
    assert x[down.argmax()] == pytest.approx(0.4, abs=0.002)


def test_granules_and_air_agree_on_the_force_and_granules_fall_faster() -> None:
    pipeline = pipeline_of(curtain())
    loading = pipeline.loading
    assert loading is not None
    found = loading.summary
    assert found.unanswered <= 0.01
    assert found.imbalance < 1e-9
    assert not found.cd
    weight = 9.80665 * 1.0 * 1.5 / 4.0  # of the curtain in flight, at about 4 m/s; it falls nearly freely at first
    assert 0.1 * weight < -found.given < 0.5 * weight
    rest = pipeline_of(curtain(), **{"air-loading": False})
    driven, still = (float(one.tracks().landings["bead"].time.mean()) for one in (pipeline, rest))
    assert driven < 0.97 * still


@pytest.mark.parametrize("rate", [0.01, 5.0])
def test_the_passes_settle_for_thin_and_for_dense_curtains(rate: float) -> None:
    """Five kg/s drive air that is nearly as fast as they are: what was given at first is many times what it takes."""
    loading = pipeline_of(curtain(**{"feed.rate": rate, "feed.width": 0.02})).loading
    assert loading is not None
    assert loading.summary.unanswered <= 0.01
    assert len(loading.passes) <= (3 if rate < 1.0 else 16)


def test_the_answer_tells_of_the_driven_air_and_of_what_is_not_known_of_it(tmp_path: Path) -> None:
    found = wf.run(curtain(), tmp_path / "out", force=LOADING)
    assert found.airflow is not None
    assert found.airflow.loading is not None
    assert found.airflow.verdict == "driven"
    assert found.airflow.turbulence == JET
    assert 1.0 < (found.airflow.loading.speed or 0.0) < 4.0
    assert "dispersion" in found.plan.fractions["bead"].forces
    keys = {one.key for one in unknowns(curtain().fed(), found.plan)}
    assert "entrainment" in keys
    assert not {"air.speed", "air.turbulence"} & keys
    assert "they alone drive the air" in (tmp_path / "out" / "report.html").read_text()


def test_the_plan_computes_the_jet_where_it_matters_and_says_where_it_cannot() -> None:
    assert wf.plan(curtain()).airflow.turbulence == JET
    assert wf.plan(curtain(**{"feed.rate": 1e-7})).airflow.turbulence == "laminar"
    narrow = wf.plan(curtain(**{"channel.width": 0.3}))
    assert any("comes to fill the channel" in line for line in narrow.warnings)
    assert not any("comes to fill the channel" in line for line in wf.plan(curtain()).warnings)
    for changes, message in (
        ({"feed.direction": 0.0}, "do not fall straight"),
        ({"channel.tilt": 0.3}, "do not fall straight"),
    ):
        assert not wf.plan(curtain(**changes)).airflow.loaded
        with pytest.raises(SceneError, match=message):
            wf.plan(curtain(**changes), force={"air-loading": True})
