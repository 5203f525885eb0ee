"""Restitution laws: what each rests on, their table in the tracker, and that granules under them come to rest."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import wakeflow as wf
from support import FLOOR, G
from wakeflow.core.errors import SceneError
from wakeflow.laws.collision import bounce
from wakeflow.laws.restitution import restitution_laws, restitution_table
from wakeflow.tracking import Body, Fate, Granules, Motion, track

LAWS = [
    wf.Restitution("constant", value=0.5),
    wf.Restitution("power", value=0.5, at=1.0),
    wf.Restitution("power", value=0.3, at=2.0, exponent=1.0, most=0.8),
    wf.Restitution("elastic-plastic", value=0.6, at=1.4),
    wf.Restitution("viscoelastic", value=0.9, at=1.0),
    wf.Restitution("viscoelastic", value=0.2, at=3.0),
    wf.Restitution("table", speeds=[0.3, 1.0, 4.0], values=[0.62, 0.5, 0.31]),
]
every_law = pytest.mark.parametrize("law", LAWS, ids=repr)


def test_every_registered_law_is_tried() -> None:
    assert {law.law for law in LAWS} == set(restitution_laws)


@every_law
def test_a_law_is_a_restitution_that_falls_with_the_speed_through_the_value_given(law: wf.Restitution) -> None:
    speeds = np.concatenate([[0.0, 1e-300], np.logspace(-12, 12, 2000)])
    e = law(speeds)
    assert np.all((e >= 0.0) & (e <= 1.0))
    assert np.all(np.diff(e) <= 1e-15)
    given = law.parameters
    if "at" in given:
        assert law(given["at"]) == pytest.approx(given["value"], abs=1e-12)


@every_law
def test_the_table_is_the_law_also_at_its_kinks(law: wf.Restitution) -> None:
    cells = restitution_table(law)
    kinks = np.array(law.kinks)
    speeds = np.concatenate([np.logspace(-7.99, 2.99, 5001), kinks, kinks * (1 - 1e-6), kinks * (1 + 1e-6)])
    y = np.log10(speeds)
    cell = np.searchsorted(cells[:, 0], y, side="right") - 1
    w = (y - cells[cell, 0]) * cells[cell, 1]
    table = sum(cells[cell, 2 + i] * w**i for i in range(4))
    np.testing.assert_allclose(table, law(speeds), atol=1e-7)


def test_the_viscoelastic_law_is_the_contact_integrated() -> None:
    """Hertz with dissipation, d'' = -d^1.5 - b sqrt(d) d', until the force is gone; b grows as v^1/5 with the speed."""

    def bounced(b: float) -> float:
        def force_gone(t: float, y: Any) -> float:
            return y[0] + b * y[1]

        force_gone.terminal, force_gone.direction = True, -1  # type: ignore[attr-defined]
        root = lambda d: np.sqrt(max(d, 0.0))  # noqa: E731
        run = solve_ivp(
            lambda t, y: [y[1], -root(y[0]) * (y[0] + b * y[1])],
            (0.0, 100.0), [1e-14, 1.0], events=force_gone, rtol=1e-11, atol=1e-14,
        )  # fmt: skip
        return float(-run.y_events[0][0][1])

    law = wf.Restitution("viscoelastic", value=bounced(0.1), at=1.0)  # 0.893
    for b, accuracy in ((0.01, 2e-5), (0.2, 3e-4), (0.6, 3e-3), (3.0, 9e-3)):
        assert law((b / 0.1) ** 5) == pytest.approx(bounced(b), abs=accuracy)


def test_the_elastic_plastic_law_is_its_energy_balance() -> None:
    """Hertz up to the yield, then the force grows linearly; the unloading is Hertz' on the flattened contact.

    In units of the yield point, at the indentation 1 + s: F = 1 + 1.5 s, work 0.4 + s + 0.75 s^2, given back
    0.4 F^2 / sqrt(1 + s); the speed is sqrt(work / 0.4) yield speeds.
    """
    s = np.logspace(-2, 4, 20)
    work = 0.4 + s + 0.75 * s**2
    e = np.sqrt(0.4 * (1 + 1.5 * s) ** 2 / np.sqrt(1 + s) / work)
    speed = np.sqrt(work / 0.4)
    law = wf.Restitution("elastic-plastic", value=float(e[7]), at=float(speed[7]), most=1.0)
    np.testing.assert_allclose(law(speed), e, rtol=1e-12)
    assert law(0.999) == pytest.approx(1.0, abs=1e-15)
    assert law(1e6) * 1e6**0.25 == pytest.approx(1.185, abs=1e-3)  # far above the yield: v^-1/4


@pytest.mark.parametrize(
    ("law", "given", "message"),
    [
        ("power", {"value": 0.5}, "lacks at"),
        ("power", {"value": 0.5, "at": 1.0, "speeds": [1.0]}, "has no speeds"),
        ("powr", {}, "did you mean 'power'"),
        ("power", {"value": 0.5, "at": 0.0}, "at = 0"),
        ("power", {"value": 0.5, "at": 1.0, "most": 0.4}, "value = 0.5, allowed 0.001 to 0.4"),
        ("constant", {"value": 1.1}, "value = 1.1"),
        ("table", {"speeds": [1.0, 1.0], "values": [0.5, 0.5]}, "must be positive and rise"),
        ("table", {"speeds": [1.0], "values": [0.5, 0.5]}, "1 speeds and 2 values"),
    ],
)
def test_a_wrong_law_says_what_is_wrong(law: str, given: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        wf.Restitution(law, **given)


@every_law
def test_walls_throw_back_by_the_law_of_the_speed_into_them(law: wf.Restitution) -> None:
    speeds = np.array([1e-3, 0.05, 0.3, 1.0, 3.0, 20.0])
    up = np.column_stack([np.linspace(-0.5, 0.5, 6), np.full(6, 2e-3)])
    grains = Granules(up, np.column_stack([np.full(6, 0.2), -speeds]), 2e-3, 1000.0, restitution=law, friction=0.0)
    far = {"until": 3.0, "gravity": (0.0, 0.0), "lines": [np.array([[-9.0, 4e-3], [9.0, 4e-3]])]}
    tracks = track(None, grains, bodies=[FLOOR], **far)
    np.testing.assert_allclose(tracks.velocity[:, 1], law(speeds) * speeds, rtol=1e-6)
    np.testing.assert_allclose(tracks.velocity[:, 0], 0.2)
    own = track(None, grains, bodies=[Body(FLOOR, restitution=0.25)], **far)  # the body's own number wins
    np.testing.assert_allclose(own.velocity[:, 1], 0.25 * speeds)


def test_a_slope_that_moves_and_the_impact_law_agree() -> None:
    law, b, lift = wf.Restitution("power", value=0.4, at=1.0), 0.6, 0.3
    wedge = np.array([[0.0, 0.0], [-np.cos(b), np.sin(b)], [-np.cos(b), 0.0]])
    place = wedge[1] / 2 + 2e-3 * np.array([np.sin(b), np.cos(b)])
    grains = Granules([place], [[0.0, -1.2]], 2e-3, 1000.0, restitution=law, friction=0.2, inertia=0.4)
    body = Body(wedge, motion=Motion((0.0, lift / 1e-3), 1e-3 / (2 * np.pi)))  # moves up at a constant 0.3 m/s
    line = np.array([[-2.0, place[1] + 2e-3], [2.0, place[1] + 2e-3]])
    tracks = track(None, grains, until=0.02, bodies=[body], gravity=(0.0, 0.0), lines=[line])
    expected = wf.impact(b, 1.2, lift, law, 0.2, 0.4, 1e-3)
    np.testing.assert_allclose(tracks.velocity[0], expected.velocity, rtol=1e-6)
    assert tracks.spin[0] == pytest.approx(float(expected.spin), rel=1e-6)
    assert expected.restitution == pytest.approx(float(law(1.5 * np.cos(b))))
    point = wf.impact(b, 1.2, lift, law, 0.2).velocity
    np.testing.assert_allclose(bounce([0.0, -1.2], [np.sin(b), np.cos(b)], [0.0, lift], law, 0.2), point)


@every_law
def test_what_bounces_on_a_floor_comes_to_rest(law: wf.Restitution) -> None:
    grains = Granules([[0.0, 0.501]], [[0.0, 0.0]], 2e-3, 1000.0, restitution=law)
    tracks = track(None, grains, until=99.0, bodies=[FLOOR], length=0.05, tolerance=1e-4)
    assert tracks.fate[0] == Fate.RESTING
    assert tracks.impacts[0] < 2000
    np.testing.assert_allclose(tracks.position[0], [0.0, 1e-3], atol=1e-12)


def test_a_wall_that_takes_no_energy_ends_at_the_hard_stop_not_never() -> None:
    law = wf.Restitution("power", value=0.5, at=1.0, most=1.0)  # elastic below 62.5 mm/s
    grains = Granules([[0.0, 0.011]], [[0.0, 0.0]], 2e-3, 1000.0, restitution=law)
    tracks = track(None, grains, until=1e9, bodies=[FLOOR])
    assert tracks.fate[0] == Fate.STOPPED
    assert 0.5 * tracks.velocity[0] @ tracks.velocity[0] + G * (tracks.position[0, 1] - 1e-3) <= 0.5 * 0.0626**2
