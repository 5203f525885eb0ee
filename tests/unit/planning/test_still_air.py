"""Air at rest: nothing is solved, granules fall by drag and weight alone, and what they would drive is judged."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import wakeflow as wf
from support import G, shipped
from wakeflow.core.errors import SceneError
from wakeflow.laws.constants import STANDARD_AIR
from wakeflow.laws.drag import drag_laws
from wakeflow.planning.coupling import COUPLING, LOADED, Limit
from wakeflow.scene import Scene

BEAD, HEAVY = 697e-6, 2500.0  # m, kg/m3


def column(**changes: object) -> Scene:
    """Glass beads that fall 3.5 m through a channel without a body."""
    tables = {
        "channel": {"width": 1.0, "bottom": -3.0, "top": 0.5},
        "air": {"speed": 0.0},
        "feed": {"width": 0.05, "depth": 0.5, "count": 32, "rate": 1e-7, "speed": 0.5},
        "fraction": {"bead": {"size": BEAD, "density": HEAVY, "restitution": 0.8, "friction": 0.2}},
        "bin": {"middle": {"on": "floor", "from": -0.1, "to": 0.1}},
    }
    return Scene.parse(tables).replace(changes)


def _coupling(plan: wf.Plan) -> dict[str, Limit]:
    return {row.name: row for row in plan.validity if row.about == COUPLING}


def test_a_bead_falls_through_air_at_rest_as_drag_and_weight_have_it(tmp_path: Path) -> None:
    """Against scipy's Radau with the plan's own law, over the 3.5 m from the channel's top to its floor."""
    plan = wf.plan(column())
    how = plan.fractions["bead"]
    assert (plan.rung, plan.airflow.kind, plan.airflow.stepping) == ("analytic", "analytic", "")
    wf.run(column(), tmp_path / "out", report=False)
    with np.load(tmp_path / "out" / "granules.npz") as kept:
        time = kept["time"]
    density, viscosity = STANDARD_AIR
    tau = HEAVY * BEAD**2 / (18.0 * viscosity)

    def fall(_: float, state: np.ndarray) -> list[float]:
        factor = float(drag_laws[how.drag].factor(np.array([density * state[1] * BEAD / viscosity]), 1.0)[0])
        return [state[1], G - state[1] * factor / tau]

    down = lambda _, state: state[0] - 3.5  # noqa: E731
    down.terminal = True  # type: ignore[attr-defined]
    right = solve_ivp(fall, (0.0, 5.0), [0.0, 0.5], method="Radau", events=down, rtol=1e-9, atol=1e-9)
    assert time == pytest.approx(right.t[-1], rel=1e-3)
    assert 4.5 < right.y[1, -1] < 5.0


def test_bodies_stand_in_air_at_rest_without_a_mesh() -> None:
    plan = wf.plan(shipped("rhombus", {"air.speed": 0}))
    assert plan.airflow.kind == "analytic"
    assert not {"mesh", "airflow"} & {stage.name for stage in plan.stages}
    assert all("dispersion" not in how.forces for how in plan.fractions.values())
    assert all(how.impaction is not None and how.impaction.shift < 1e-9 for how in plan.fractions.values())


def test_a_curtain_drives_the_air_at_rest_with_the_root_of_the_feed_rate() -> None:
    """By hand: all the momentum of drag in the curtain's own section; up to the speed of the granules."""
    thin = _coupling(wf.plan(column()))["air-driven"]
    assert _coupling(wf.plan(column(**{"feed.rate": 4e-7})))["air-driven"].value == pytest.approx(2.0 * thin.value)
    assert thin.holds
    assert thin.feed_rate is not None
    assert thin.feed_rate / 3600.0 == pytest.approx(1e-7 * (LOADED / thin.value) ** 2)
    dense = wf.plan(column(**{"feed.rate": 1.0}), force={"air-loading": False})
    row = _coupling(dense)["air-driven"]
    assert not row.holds
    assert any("too dense for one-way coupling: air-driven" in line for line in dense.warnings)
    assert _coupling(wf.plan(column(**{"feed.rate": 2.0})))["air-driven"].value == row.value


def test_what_moves_air_does_not_go_with_air_at_rest() -> None:
    for changes, message in (
        ({"air.speed": 1e-9}, "at least 1e-06 m/s, or 0 for air at rest"),
        ({"air.profile": "parabolic"}, "air at rest has none"),
        ({"numerics.rung": "draft"}, "the air is at rest, so there is nothing to solve"),
    ):
        with pytest.raises(SceneError, match=message):
            wf.plan(column(**changes))
    inlet = {"side": "left", "position": "0 mm", "width": "20 mm", "velocity": "1 m/s"}
    with pytest.raises(SceneError, match="a speed above 0"):
        shipped("rhombus", {"air.speed": 0, "channel.inlet.side": inlet})


def test_a_scene_in_air_at_rest_says_so() -> None:
    scene = shipped("rhombus", {"air.speed": 0})
    assert "air at rest" in repr(scene)
    assert math.isclose(scene.reynolds or 0.0, 0.0)
    assert not any("lower air.speed" in line or "higher air.speed" in line for line in wf.plan(scene).warnings)
