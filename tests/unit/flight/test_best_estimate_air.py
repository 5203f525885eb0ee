"""The air between two ends: what it is made of, its numbers beside those of the ends, and the wakes that companions
fly in. The ends are fields that need no solver.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from wakeflow.air.field import FlowField, blended_wake
from wakeflow.air.foam.airflow_result import SuctionZone
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.air.kinds.blended_air import BlendedAir, blended_airflow
from wakeflow.air.kinds.solved_air import TimeResolvedAir
from wakeflow.core.number import Number
from wakeflow.core.store import Store
from wakeflow.laws.best_estimate import WakeEstimate
from wakeflow.planning.stage_cache import StageCache, StageTimes, null_listener
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

OFF = {"basset-history": False}
ESTIMATE = WakeEstimate(Number(0.4, 0.3, 0.6), Number(0.6, 0.5, 0.9), "as the test says", Number(0.3, 0.1, 0.5))
P_INLET = {"steady": 3.0, "resolved": 7.0}
PERIOD = 0.1


def number(value: float, half: float = 0.0) -> Number:
    return Number(value, value - half, value + half)


def zone(reversal: float) -> SuctionZone:
    return SuctionZone(-0.5, -1.0, 0.0, 0.0, 0.0, reversal)


STEADY = Airflow(
    cd=number(1.5), cl_rms=number(0.0), cp_base=number(-1.0), cp_front=0.8, p_inlet=P_INLET["steady"],
    pressure_drop=3.0, flow_rate=2.0, cd_of={}, suction=zone(0.2),
)  # fmt: skip
RESOLVED = Airflow(
    cd=number(2.5, 0.05), cl_rms=number(1.0, 0.1), cp_base=number(-3.0, 0.2), cp_front=0.9,
    p_inlet=P_INLET["resolved"], pressure_drop=7.0, flow_rate=2.0, cd_of={}, suction=zone(0.03), period=PERIOD,
    verdict="periodic",
)  # fmt: skip


def channel(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of the shipped channel round its rhombus."""
    line_x, line_y = np.arange(-0.2, 0.2001, step), np.arange(-0.2, 0.2001, step)
    points = np.stack(np.meshgrid(line_x, line_y), axis=-1).reshape(-1, 2)
    around = np.abs(points).sum(axis=1)
    edge = np.linspace(0, 1, max(3, round(0.035 / step)), endpoint=False)[:, None]
    corners = 0.025 * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    outline = np.concatenate([a + edge * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    points = np.concatenate([points[around > 0.025 + 0.4 * step], outline])
    cells = Delaunay(points).simplices
    middle = np.abs(points[cells].mean(axis=1)).sum(axis=1)
    return points, cells[middle > 0.025]


def wake(points: np.ndarray, length: float) -> np.ndarray:
    """Air at 5 m/s downward that runs backwards on the axis for ``length`` (m) behind the body, at rest on it."""
    behind = -points[:, 1] - 0.025
    fall = 5.0 * np.clip(behind / length - 1.0, -0.5, 1.0)
    slow = np.where((behind > -0.025) & (np.abs(points[:, 0]) < 0.025), fall, 5.0)
    speed = np.where(np.abs(points).sum(axis=1) < 0.025 + 1e-9, 0.0, slow)
    return np.stack([np.zeros(len(points)), -speed], axis=1)


def pressure(points: np.ndarray, base: float, inlet: float) -> np.ndarray:
    """Cp ``base`` behind the body within 0.1 m, counted from the ``inlet`` (Pa)."""
    deep = base * np.exp(-np.sum((points / (0.05, 0.1)) ** 2, axis=1)) * (points[:, 1] < 0.0)
    return inlet + 15.0 * deep


def steady_field() -> FlowField:
    points, cells = channel(0.0125)
    even = np.full(len(points), 0.3)
    return FlowField.from_arrays(
        points, cells, wake(points, 0.2), pressure(points, -1.0, P_INLET["steady"]), k=even, dissipation=even
    )


def resolved_field() -> FlowField:
    points, cells = channel(0.02)
    times = PERIOD * np.arange(16) / 16
    swing = np.sin(2 * np.pi * times / PERIOD)[:, None]
    away = (np.abs(points).sum(axis=1) > 0.026) & (np.abs(points).max(axis=1) < 0.19)
    velocity = np.repeat(wake(points, 0.03)[None], 16, axis=0)
    velocity[..., 0] += swing * away
    even = np.full((16, len(points)), 0.5) + 0.2 * swing
    flat = np.repeat(pressure(points, -3.0, P_INLET["resolved"])[None], 16, axis=0)
    return FlowField.from_arrays(points, cells, velocity, flat, times, PERIOD, even, even).compressed(1e-4)


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "rhombus.toml", {"feed.count": 64})


Make = Callable[..., BlendedAir]


@pytest.fixture
def make(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """The air between the two fields, of an estimate."""
    plan = make_plan(scene, force=OFF)
    end = SimpleNamespace(key="steady-key", field=steady_field(), measured=STEADY)

    def made(estimate: WakeEstimate = ESTIMATE, resolved: FlowField | None = None) -> BlendedAir:
        wanted = replace(plan, airflow=replace(plan.airflow, wake=estimate))
        cache = StageCache(Store(tmp_path), null_listener, StageTimes())
        in_time = TimeResolvedAir(scene, wanted, cache)
        monkeypatch.setattr(TimeResolvedAir, "key", "resolved-key")
        monkeypatch.setattr(TimeResolvedAir, "measured", RESOLVED)
        vars(in_time).update(field=resolved or resolved_field())
        return BlendedAir(end, in_time)  # type: ignore[arg-type]

    return made


def test_the_answer_flies_between_the_ends_and_every_number_is_in_the_key(make: Make) -> None:
    air = make()
    key, field = air.key, air.field
    expected = blended_wake(air.bare.field, steady_field(), 0.4, 0.6)
    np.testing.assert_array_equal(field.velocity, expected.velocity)
    np.testing.assert_array_equal(np.asarray(field.k), np.asarray(expected.k))
    other = make(replace(ESTIMATE, theta=Number(0.41, 0.3, 0.6)))
    stronger = make(replace(ESTIMATE, strength=Number(0.61, 0.5, 0.9)))
    assert len({key, other.key, stronger.key, air.bare.key}) == 4
    wider = make(replace(ESTIMATE, theta=Number(0.4, 0.1, 0.9)))
    assert wider.key == key  # the range changes no track


def test_companions_fly_in_the_ends_and_between(make: Make) -> None:
    air = make()
    assert air.between(1.0, 1.0) is air.bare.field
    calm = air.between(0.0, 0.0)
    assert not calm.in_time
    np.testing.assert_allclose(calm.mean().velocity[:, 1].min(), -5.0)
    numbers = (0.3, 0.6), (0.6, 0.6), (0.4, 0.5), (0.4, 0.9)
    assert len({air.between(*pair).velocity.tobytes() for pair in numbers}) == 4


def test_a_wake_that_came_to_rest_is_its_own_answer(make: Make) -> None:
    rest = make(resolved=steady_field())
    assert (rest.key, rest.make_field()) == (rest.bare.key, rest.bare.field)
    assert rest.make_numbers() == RESOLVED


def test_the_numbers_are_those_of_the_air_flown_in_with_the_ends_beside(make: Make) -> None:
    air = make()
    found = air.make_numbers()
    assert found.cd.value == pytest.approx(1.9)
    own = 0.4 * 0.05
    assert found.cd.low == pytest.approx(1.9 - math.hypot(own, 0.1))
    assert found.cd.high == pytest.approx(1.9 + math.hypot(own, 0.2))  # theta may be 0.2 more, and 0.1 less
    assert found.cp_base.value == pytest.approx(-1.8)
    assert found.cp_base.high == pytest.approx(-1.8 + math.hypot(0.08, 0.2))
    assert found.cl_rms.value == pytest.approx(0.3)
    assert found.cl_rms.high == pytest.approx(0.3 + math.hypot(0.03, 0.2))
    own = WakeEstimate(ESTIMATE.theta, ESTIMATE.strength, "", Number(0.0, 0.0, 0.5))
    still = blended_airflow(air.flow_spec, own, air.between(0.4, 0.0), STEADY, RESOLVED)
    assert still.cl_rms.low == 0.0
    assert still.cl_rms.high == pytest.approx(0.5)
    assert (found.p_inlet, found.pressure_drop, found.cp_front) == pytest.approx((4.6, 4.6, 0.84))
    assert (found.wake.theta.low, found.wake.strength.high, found.wake.why) == (0.3, 0.9, "as the test says")
    assert (found.ends.steady.cd.value, found.ends.time_resolved.cl_rms.value) == (1.5, 1.0)


def test_the_suction_zone_is_that_of_the_blended_mean(make: Make) -> None:
    air = make()
    suction = air.make_numbers().suction
    mean = air.between(0.4, 0.0)
    cp = (np.asarray(mean.pressure) - 4.6) / 15.05  # air of 1.204 kg/m3 at 5 m/s
    assert suction.cp_min == pytest.approx(cp.min(), abs=0.01)
    lengths = []
    for theta in (0.05, 0.5, 0.95):
        at = replace(ESTIMATE, theta=Number(theta, theta, theta))
        table = blended_airflow(air.flow_spec, at, air.between(theta, 0.0), STEADY, RESOLVED)
        lengths.append(table.suction.reversal_length)
    assert lengths[0] > lengths[1] > lengths[2] > 0.0


def test_where_the_mesh_moves_the_suction_zone_is_that_of_the_mean(make: Make) -> None:
    still = make().make_numbers().suction
    moving = (
        make(resolved=resolved_field().moving((0.0, 1e-5), 2.0 * math.pi * 3.0 / PERIOD, 0.0)).make_numbers().suction
    )
    assert moving.cp_min == pytest.approx(still.cp_min, rel=0.01)
