"""Scenes: what is accepted means what it says; what is wrong is named in one line."""

import copy
import json
import math
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from support import CASES, shipped
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.laws.collision import impact_models
from wakeflow.laws.material import materials, near_material
from wakeflow.laws.shape import shapes
from wakeflow.scene import Scene
from wakeflow.scene.messages import unit_of
from wakeflow.scene.schema import scene_schema
from wakeflow.scene.user_files import read_materials
from wakeflow.show.html.rows import material_rows

INLET = {"side": "left", "position": 0.0, "width": "20 mm", "velocity": 2.0}
ABOVE = {"shape": "circle", "width": "20 mm", "at": [0.0, 0.12]}
SHIPPED = ["rhombus", "prism", "vacuum", "aspirator"]


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_survive_saving(name: str, cases: Path, tmp_path: Path) -> None:
    scene = Scene.load(cases / f"{name}.toml")
    scene.save(tmp_path / "copy.toml")
    assert Scene.load(tmp_path / "copy.toml") == scene


def test_units_are_converted_to_si(rhombus: Scene) -> None:
    assert rhombus.width == pytest.approx(0.05)
    assert rhombus.body["rhombus"].slope_angle == pytest.approx(math.pi / 4)
    assert rhombus.feed.mass_flow == pytest.approx(500 / 3600)
    assert rhombus.replace({"air.speed": "18 km/h"}).air.speed == pytest.approx(5.0)  # type: ignore[union-attr]
    assert rhombus.reynolds == pytest.approx(1.204 * 5 * 0.05 / 1.825e-5)


def test_gamma_gives_the_amplitude(rhombus: Scene) -> None:
    amplitude, omega = rhombus.motion
    assert omega == pytest.approx(2 * math.pi * 30)
    np.testing.assert_allclose(amplitude, [0, 2.0 * 9.81 / omega**2], atol=1e-18)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"air.sped": 3}, "air.sped: unknown key; did you mean 'speed'?"),
        ({"air.speed": "5 kg"}, "air.speed = '5 kg': needs a number in m/s or a string such as '5 m/s'"),
        (
            {"air.speed": -1},
            "air.speed = -1: too small (allowed: >= 0 m/s and <= 100 m/s); which way it blows is said",
        ),
        ({"fraction.wheat.friction": "40 %"}, "needs a number (allowed: >= 0 and <= 10)"),
        ({"channel.width": "40 mm"}, " and 5 more"),
        ({"air.speed": math.nan}, "air.speed"),
        ({"body.rhombus.slope_angle": 60}, "unit forgotten: a number alone is in rad? Write '60 deg'"),
        ({"body.rhombus.slope_angle": None}, "body.rhombus"),
        ({"body.rhombus.height": 0.1}, "either slope_angle or height"),
        ({"body.rhombus.apex": "up"}, "shape 'rhombus' has no apex (takes: width, slope_angle, height)"),
        ({"body.rhombus.shape": "rombus"}, "unknown shape 'rombus'; did you mean 'rhombus'?"),
        ({"body.rhombus.at": [0.0]}, "body.rhombus.at"),
        ({"body.rhombus.at": [0.19, 0.0]}, "no room beside it"),
        ({"body.rhombus.at": [0.0, -0.19]}, "out of the channel, -0.2 m to 0.2 m"),
        (
            {"body.two": {"shape": "rhombus", "width": 0.01, "height": 0.01}},
            "rhombus and body.two touch each other",
        ),
        (
            {"body.two": {"shape": "circle", "width": 0.01, "at": [0.0305, 0.0]}},
            "body.rhombus and body.two are only 0.0005 m apart",
        ),
        ({"body.two": ABOVE}, "the curtain begins at y = 125 mm, inside body.two"),
        ({"body.two": ABOVE, "feed.mode": "injected", "feed.height": 0.2}, "body.two may be met before the first body"),
        ({"body.rhombus.slope_angle": "9 deg"}, "= '9 deg': too small (allowed: >= 10 deg and <= 80 deg)"),
        ({"body.rhombus.slope_angle": "95 deg"}, "= '95 deg': too large (allowed: >= 10 deg and <= 80 deg)"),
        ({"body.rhombus.rounding": "18 mm"}, "rounding = 18 mm eats an edge of the outline (allowed: < 17.68 mm)"),
        (
            {"body.two": {"shape": "circle", "width": 0.01, "corners": 30, "at": [0.1, 0]}},
            "corners = 30: a multiple of 4",
        ),
        ({"channel.inlet.a": {"position": 0.0}}, "channel.inlet.a.side: missing"),
        ({"channel.inlet.a": INLET, "channel.inlet.b": {**INLET, "position": 0.01}}, "channel.inlet.b overlap"),
        ({"channel.inlet.a": {**INLET, "velocity": -1.0}}, "channel.inlet.a.velocity = -1.0: too small"),
        ({"channel.inlet.a": {**INLET, "position": "0.2 m"}}, "channel.inlet.a reaches from y = 0.19 m to 0.21 m"),
        ({"channel.inlet.a": {**INLET, "sid": "left"}}, "channel.inlet.a.sid: unknown key; did you mean 'side'?"),
        ({"channel.inlet.a": INLET, "bin.w": {"on": "left", "from": 0.0, "to": 0.1}}, "bin.w overlaps channel.inlet.a"),
        ({"channel.inlet.a": INLET, "air": None}, "secondary air streams need an [air] table"),
        ({"air.profile": "flat"}, "'uniform' or 'parabolic'"),
        ({"numerics.mesh_scale": 9}, "allowed: >= 0.2 and <= 4"),
        ({"numerics.ranks": 0}, "ranks = 0: give auto, or a whole number"),
        ({"numerics.ranks": "two"}, "ranks = 'two': give auto"),
        ({"channel.extend": "no"}, "channel.extend = 'no'"),
        ({"channel": 3}, "channel = 3"),
        ({"channel.top": -0.6}, "channel.bottom"),
        ({"fraction.dust.material": "wheet"}, "unknown material 'wheet'; did you mean 'wheat'?"),
        ({"fraction.dust.size.distribution": "norml"}, "unknown size distribution 'norml'"),
        ({"fraction.dust.size.mean": 1e-3}, "has no mean (takes: median, geometric_std)"),
        ({"fraction.dust.size": "3 kg"}, "fraction.dust.size.diameter = '3 kg'"),
        ({"fraction.dust.mass_share": 0.5}, "add up to 1.48"),
        ({"fraction.wheat.target": "outer"}, "no such bin"),
        ({"fraction.x": {"size": 1e-3, "mass_share": 0.1}}, "give also: density, restitution, friction"),
        ({"fraction.wheat.restitution": 1.2}, "<= 1"),
        ({"bin.middle.to": 0.1}, "overlap"),
        ({"bin.elsewhere": {"from": 0.0, "to": 0.01}}, "reserved"),
        ({"bin.middle.from": 0.1}, "must be below"),
        ({"feed.count": "many"}, "feed.count = 'many'"),
        ({"feed.speed": 1.0}, "either height or speed"),
        ({"feed.width": 0.4}, "touches the channel's walls"),
        ({"feed.position": 0.1}, "falls past the body"),
        ({"fraction.wheat.size": "90 mm"}, "wider than the body"),
        ({"vibration.gamma": 50.0, "vibration.frequency": 1}, "an amplitude of 12.4 m"),
        ({"bin.shelf": {"points": [[-0.1, 0.0], [0.1, 0.0]]}}, "runs through a body"),
        ({"bin.shelf": {"points": [[0.1, 0.1], [0.1, 0.1]]}}, "repeats a point"),
        ({"fraction.wheat.target": ["middle", "middle"]}, "names a bin twice"),
        ({"fraction.wheat.target": []}, "target"),
        ({"fraction": {"../evil": {"material": "wheat"}}}, "a name begins with a letter"),
        ({"feed.mode": "thrown"}, "'auto', 'injected' or 'resolved'"),
        ({"vibration.amplitude": 0.001}, "either amplitude or gamma"),
        ({"feed.height.x": 1}, "feed.height is a value, not a table"),
        ({"fraction.wheet.restitution": 0.3}, "no fraction 'wheet'; did you mean 'wheat'? (known: dust, chaff, wheat)"),
        ({"bin.midle.to": 0.01}, "to add one, give it whole: bin.midle={...}"),
        ({"channel.inlet.a.width": 0.01}, "channel.inlet.a.side: missing"),
        ({"body.width": "60 mm"}, "body.width = '60 mm': which one? body.rhombus.width"),
        ({"air": 3}, "air = 3: is a table: write [air] and its keys below it (its keys: speed, direction"),
        ({"air.speed": [3, 4]}, "air.speed = [3, 4]: needs a number"),
        ({"air.turbulence": "90 %"}, "air.turbulence = '90 %': too large (allowed: >= 0 % and <= 50 %)"),
        ({"fraction.dust.impact": "flake"}, "impact = 'flake' needs dimensions = [length, width, thickness]"),
        ({"fraction.wheat.mass_share": 90}, "too large (allowed: > 0 and <= 1); unit forgotten? Write '90 %'"),
        ({"feed.width": "300 cm"}, "feed.width = 300 cm at feed.position = 0 cm touches the channel's walls"),
        ({"bin.middle.to": "100 mm"}, "bin.middle and bin.inner-right overlap from 80 mm to 100 mm"),
        ({"bin.outer-right.to": 0.3}, "x from 0.135 m to 0.3 m, y from -0.2 m to -0.2 m (allowed: x within 0.2 m of 0"),
        ({"air.speed": "1,5 m/s"}, "air.speed = '1,5 m/s': a decimal point is written '.'"),
        ({"feed.rate": "0,8 t/h/m"}, "thousands without a mark: '0.8 t/h/m'"),
        ({"feed.rate": "0,8 t/h"}, "thousands without a mark: '0.8 t/h'"),
        ({"uncertainty.air.speed": "300 %"}, "air.speed = '300 %': a number that is never negative is off by 100 %"),
        ({"uncertainty.air.speed": "1 kg"}, "air.speed = '1 kg': needs a number in m/s or a string such as '0.1 m/s'"),
        ({"uncertainty.body.rhombus.width": "1 mm"}, "uncertainty.body.rhombus.width: no number that takes an unc"),
        ({"uncertainty.fraction.wheet.friction": 0.1}, "did you mean 'fraction.wheat.friction'? (which do: feed.width"),
        ({"fraction": {}}, "fraction: needs at least 1 entry"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_field(rhombus: Scene, change: dict, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        rhombus.replace(change)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


OFF_SCALE = [
    (
        {"body.rhombus.width": 60},
        "body.rhombus.width = 60 m: unit forgotten? Other lengths of this scene are about 140 mm",
    ),
    ({"feed.height": 100}, "write '100 mm', or '100 m' if that is meant"),
    ({"body.rhombus.at": [0, -90.0]}, "body.rhombus.at[2] = -90 m: unit forgotten?"),
    ({"channel.width": 400, "channel.top": 200}, "or '400 m' if that is meant; and 1 more"),
]


@pytest.mark.parametrize(("changes", "message"), OFF_SCALE)
def test_a_length_far_off_the_scale_is_asked_about(cases: Path, changes: dict, message: str) -> None:
    with pytest.raises(SceneError) as loaded:
        Scene.load(cases / "rhombus.toml", changes)
    with pytest.raises(SceneError, match="unit forgotten"):
        Scene.load(cases / "rhombus.toml").replace(changes)
    assert message in str(loaded.value)


def test_a_whole_scene_without_units_is_asked_about(cases: Path, tmp_path: Path) -> None:
    text = (cases / "prism.toml").read_text()
    (tmp_path / "bare.toml").write_text(re.sub(r'"(-?[0-9.]+) mm"', r"\1", text))
    with pytest.raises(SceneError, match=r"channel.width = 200 m: unit forgotten\?.*; and \d+ more") as caught:
        Scene.load(tmp_path / "bare.toml")
    assert len([one for one in caught.value.mistakes if "unit forgotten" in one]) == len(caught.value.mistakes) > 9


def test_all_mistakes_of_a_scene_are_told_at_once_each_in_a_line(cases: Path, capsys: Any, tmp_path: Path) -> None:
    """What has no unit, what is no number, no key and no material; what does not fit only once all else is right."""
    wrong = {
        "channel.width": 400, "air.speed": "5,5 m/s", "feed.rate": "800 kg", "feed.count": 1,
        "fraction.wheat.material": "wheet", "fraction.dust.mass_share": 3, "numerics.mesh_scale": 9,
    }  # fmt: skip
    with pytest.raises(SceneError) as caught:
        Scene.load(cases / "rhombus.toml", wrong)
    told = caught.value.mistakes
    keys = [key.removesuffix(".material") for key in wrong]
    assert all(sum(f"rhombus.toml: {key}" in one for one in told) == 1 for key in keys)
    assert len(told) == len(wrong)
    assert str(caught.value).startswith("rhombus.toml: channel.width = 400 m: unit forgotten?")
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(" more")
    text = (cases / "rhombus.toml").read_text().replace('rate = "500', 'rate = "5,00').replace("count = ", "cuont = ")
    (tmp_path / "wrong.toml").write_text(f"{text}\n[limit]\nloss.wheat = 4\n[numericss]\n")
    assert main(["plan", str(tmp_path / "wrong.toml")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("wakeflow: wrong.toml: ") for line in lines)
    assert len(lines) > 2
    with pytest.raises(SceneError) as caught:
        Scene.load(cases / "rhombus.toml", {"bin": {f"n{i}": {"too": "0 mm"} for i in range(100)}})
    assert len(caught.value.mistakes) == 41
    assert re.search(r"and \d+ more$", caught.value.mistakes[-1])


def test_a_rate_by_depth_is_that_of_the_whole_depth(rhombus: Scene) -> None:
    for rate, depth, total in (("800 kg/h/m", "300 mm", 240.0), ("0.8 t/h/m", 0.3, 240.0), ("800 kg/h/m", 1.0, 800.0),
                               ("800 kg/h", "300 mm", 800.0), ("2.4 t/(h*m)", "0.1 m", 240.0)):  # fmt: skip
        found = rhombus.replace({"feed.rate": rate, "feed.depth": depth}).feed
        assert 3600 * found.mass_flow == pytest.approx(total)
    with pytest.raises(SceneError, match=r"feed.rate = '800 kg/m': needs a number in kg/s"):
        rhombus.replace({"feed.rate": "800 kg/m"})
    with pytest.raises(SceneError, match=r"feed.depth = '300': needs") as caught:
        rhombus.replace({"feed.rate": "800 kg/h/m", "feed.depth": "300"})
    assert len(caught.value.mistakes) == 1


def test_a_length_with_its_unit_is_believed_and_stays_so(cases: Path, tmp_path: Path) -> None:
    tall = Scene.load(cases / "vacuum.toml", {"feed.height": "100 m"})
    assert tall.feed.height == 100.0
    assert tall.replace({"feed.count": 32}).feed.height == 100.0
    tall.save(tmp_path / "tall.toml")
    assert Scene.load(tmp_path / "tall.toml") == tall
    assert 'height = "100.0 m"' in (tmp_path / "tall.toml").read_text()


def test_a_curtain_is_no_denser_than_its_granules(rhombus: Scene) -> None:
    speed, width, depth = math.sqrt(2 * 9.81 * 0.1), 0.04, 0.3
    most = max(materials[name].density for name in ("wheat", "chaff", "dust")) * speed * width * depth
    assert rhombus.replace({"feed.rate": 0.999 * most}).feed.rate == 0.999 * most
    with pytest.raises(SceneError, match=r"feed.rate = .* kg/s: .* denser than its granules"):
        rhombus.replace({"feed.rate": 1.001 * most})
    with pytest.raises(SceneError, match="'300 kg/hour' meant"):
        rhombus.replace({"feed.rate": 300})
    with pytest.raises(SceneError, match=r"at most [\d.]+ t/h\)$"):  # with a unit it is no rate of another one
        rhombus.replace({"feed.rate": "500 t/h"})


def test_frequencies_and_shares_as_people_write_them(cases: Path) -> None:
    changes = {"vibration.frequency": "1800 rpm", "fraction.wheat.mass_share": "90 %", "air.turbulence": "4 %"}
    scene = Scene.load(cases / "rhombus.toml", {**changes, "numerics.target_error": "2 %"})
    assert scene.vibration.frequency == pytest.approx(30.0, rel=1e-15)
    assert scene.fraction["wheat"].mass_share == 0.9
    assert (scene.air.turbulence, scene.numerics.target_error) == (0.04, 0.02)


def test_a_sieve_table_in_per_cent(rhombus: Scene) -> None:
    sieves = {"distribution": "table", "diameters": ["10 um", "40 um", "125 um"], "passing": ["0 %", "45 %", "100 %"]}
    size = rhombus.replace({"fraction.dust.size": sieves}).fraction["dust"].size
    assert size.passing == [0.0, 0.45, 1.0]


def test_units_of_keys() -> None:
    known = {"air.speed": "m/s", "body.a.slope_angle": "rad", "feed.rate": "kg/s", "body.a.at": "m"}
    assert {key: unit_of(key) for key in known} == known
    assert [unit_of(key) for key in ("fraction.a.mass_share", "air.direction", "air.nothing")] == ["", "", ""]


def test_a_path_is_a_scene(cases: Path) -> None:
    import wakeflow as wf

    path = cases / "vacuum.toml"
    assert wf.plan(str(path)).summary() == wf.plan(wf.Scene.load(path)).summary()
    assert wf.chain(path, count=32).plan.summary() == wf.chain(wf.Scene.load(path), count=32).plan.summary()
    with pytest.raises(SceneError, match="no scene file"):
        wf.run("nowhere.toml")
    with pytest.raises(SceneError, match="not dict"):
        wf.run({"air": {}})  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="scene file = 3: needs a path, not int"):
        Scene.load(3)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="changes = 3: name each key"):
        Scene.load(path).replace(3)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="takes a list of scenes"):
        wf.sweep(Scene.load(path))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rhombus", ("bodies rhombus", "air", " m/s down", "wheat", "bins")),
        ("vacuum", ("bodies prism", "no air", "fractions soft, hard", "2 bins")),
    ],
)
def test_a_scene_is_a_line_and_a_page(name: str, words: tuple[str, ...], cases: Path, tmp_path: Path) -> None:
    scene = Scene.load(cases / f"{name}.toml")
    assert len(repr(scene)) < 200
    assert str(scene) == repr(scene)
    assert [word for word in words if word not in repr(scene)] == []
    scene.save(tmp_path / "scene.toml")
    page = scene._repr_html_()
    assert escape((tmp_path / "scene.toml").read_text()) in page
    assert escape(repr(scene)) in page


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("speed = 7 m/s   # fast", "put quotes round a value with a unit: speed = '7 m/s'"),
        ("speed = 7,5", "write a decimal point: speed = 7.5"),
        ("speed = = 7", "line 2, column 9)"),
    ],
)
def test_a_line_that_is_no_toml_is_mended(line: str, hint: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(f"[air]\n{line}\n")
    with pytest.raises(SceneError) as caught:
        Scene.load(tmp_path / "scene.toml")
    assert str(caught.value).endswith(hint)


@pytest.mark.parametrize(("encoding", "readable"), [("utf-8-sig", True), ("latin-1", False), ("utf-16", False)])
def test_a_scene_is_utf_8_with_or_without_a_mark(encoding: str, readable: bool, cases: Path, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(f"# Körner\n{(cases / 'vacuum.toml').read_text()}", encoding=encoding)
    if readable:
        assert Scene.load(path) == Scene.load(cases / "vacuum.toml")
    else:
        with pytest.raises(SceneError, match=r"scene\.toml: not UTF-8; save it as UTF-8 in your editor"):
            Scene.load(path)


def test_missing_file_and_broken_toml(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"wakeflow new rhombus '.*/my none\.toml'$"):
        Scene.load(tmp_path / "my none.toml")
    (tmp_path / "bad.toml").write_text("[air\nspeed=")
    with pytest.raises(SceneError, match="not valid TOML"):
        Scene.load(tmp_path / "bad.toml")


def test_own_terminal_velocity_and_material_each_bring_their_diameter(rhombus: Scene) -> None:
    wheat = rhombus.fraction["wheat"]
    assert wheat.properties.terminal_velocity == materials["wheat"].terminal_velocity
    source = materials["wheat"]
    assert wheat.measured_settling == (source.diameter, source.density, source.terminal_velocity)
    own = rhombus.replace({"fraction.wheat.terminal_velocity": 8.0, "fraction.wheat.size": "3 mm"}).fraction["wheat"]
    assert own.measured_settling == (pytest.approx(3e-3), source.density, 8.0)
    sphere = rhombus.replace({"fraction.wheat.sphericity": 0.8}).fraction["wheat"]
    assert sphere.properties.terminal_velocity is None


SHAPE_PARAMETERS = {
    "rhombus": {"width": 2.0, "slope_angle": math.radians(60)},
    "prism": {"width": 2.0, "slope_angle": math.radians(60)},
    "circle": {"width": 2.0, "corners": 16},
    "plate": {"length": 2.0, "thickness": 0.1, "slope_angle": math.radians(60)},
    "polygon": {"points": [[0, 0], [0, 1], [1, 0]]},
}


@pytest.mark.parametrize("name", list(shapes))
def test_outlines_run_counter_clockwise(name: str) -> None:
    from wakeflow.core.geometry import area

    assert area(shapes[name](**SHAPE_PARAMETERS[name])) > 0


def test_slope_angle_is_from_the_horizontal() -> None:
    from wakeflow.core.geometry import normals

    for outline in (shapes["rhombus"](**SHAPE_PARAMETERS["rhombus"]), shapes["prism"](**SHAPE_PARAMETERS["prism"])):
        upward = normals(outline)[normals(outline)[:, 1] > 1e-9]
        np.testing.assert_allclose(np.arctan2(np.abs(upward[:, 0]), upward[:, 1]), math.radians(60))
    down = shapes["prism"](**SHAPE_PARAMETERS["prism"], apex="down")
    assert np.ptp(down[:, 0]) == 2.0
    assert down[:, 1].min() == pytest.approx(-2 / 3 * math.tan(math.radians(60)))


def test_a_star_stands_for_every_table(rhombus: Scene) -> None:
    paper = rhombus.replace({"fraction.*.impact": "paper"})
    assert {fraction.impact for fraction in paper.fraction.values()} == {"paper"}
    with pytest.raises(SceneError, match=r"picture.\*.caption: picture.\* is no table"):
        rhombus.replace({"picture.*.caption": "none is there"})


P = (np.arange(4000) + 0.5) / 4000


def test_a_key_of_former_times_is_unknown(rhombus: Scene) -> None:
    with pytest.raises(SceneError, match=r"span\.sheddings: unknown key; did you mean 'shedding_cycles'\?"):
        rhombus.replace({"numerics.span.sheddings": 7.0})
    with pytest.raises(SceneError, match=r"uncertainty.fraction.chaff.turning.*inverse_inertia"):
        rhombus.replace({"uncertainty.fraction.chaff.turning": 0.4})


def test_granules_differ_as_their_material_says_and_the_paper_s_are_alike(rhombus: Scene) -> None:
    wheat, known = rhombus.fraction["wheat"], materials["wheat"]
    for name in ("restitution", "friction"):
        drawn = wheat.coefficients(name, P)
        assert drawn.mean() == pytest.approx(getattr(known, name), abs=1e-4)
        assert drawn.std() == pytest.approx(getattr(known, f"{name}_std"), rel=0.01)
    assert wheat.inertia == impact_models["kernel"].inertia == 0.4
    assert wheat.properties.rebound_scatter == known.rebound_scatter > 0
    assert wheat.settling(P) is None  # it has sizes of its own
    chaff = rhombus.fraction["chaff"].settling(P)
    assert chaff.std() == pytest.approx(materials["chaff"].terminal_velocity_std, rel=0.01)
    for fraction in rhombus.replace({"fraction.*.impact": "paper"}).fraction.values():
        assert np.isinf(fraction.inertia)
        assert not fraction.varies
        assert fraction.properties.rebound_scatter == fraction.properties.tangential_restitution == 0.0


def test_a_fraction_s_own_spread_goes_before_its_material_s(rhombus: Scene) -> None:
    own = {"restitution": {"mean": 0.9, "std": 0.05}, "friction": {"distribution": "uniform", "low": 0.2, "high": 0.4}}
    changes = {f"fraction.wheat.{key}": value for key, value in own.items()}
    wheat = rhombus.replace({**changes, "fraction.wheat.rebound_scatter": "5 deg"}).fraction["wheat"]
    drawn = wheat.coefficients("restitution", P)
    assert drawn.max() <= 1.0
    assert wheat.coefficients("friction", P).mean() == pytest.approx(0.3)
    assert wheat.properties.friction == pytest.approx(0.3)
    assert wheat.properties.rebound_scatter == pytest.approx(math.radians(5))
    for value in (0.5, {"law": "power", "value": 0.5, "at": 1.0}):
        assert (
            rhombus.replace({"fraction.wheat.restitution": value}).fraction["wheat"].coefficients("restitution", P)
            is None
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"restitution": {"mean": 0.9, "std": 0.3}}, "puts 37% outside 0 to 1"),
        ({"restitution": {"mean": 0.9}}, "a normal distribution takes mean and std, not mean"),
        ({"friction": {"distribution": "uniform", "low": 0.4, "high": 0.2}}, "low = 0.4 must be below high = 0.2"),
        ({"restitution": {"distribution": "uniform", "low": 0.4, "high": 1.2}}, "high = 1.2 is more than 1"),
        ({"friction": {"mean": 0.4, "sd": 0.1}}, "unknown key"),
        ({"rebound_scatter": "90 deg"}, "rebound_scatter"),
        ({"tangential_restitution": 0.3, "impact": "paper"}, "of granules that turn"),
        ({"capture_speed": "-1 m/s"}, "capture_speed"),
    ],
)
def test_a_spread_that_cannot_be_is_refused(rhombus: Scene, change: dict, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        rhombus.replace({f"fraction.wheat.{key}": value for key, value in change.items()})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", list(materials))
def test_materials_state_source_and_confidence(name: str) -> None:
    material = materials[name]
    assert material.confidence in ("measured", "typical", "low")
    assert len(material.source) > 20
    assert 0 <= material.restitution <= 1
    assert material.friction >= 0
    assert material.impact in impact_models
    assert {"restitution", "friction", "impact"} <= set(material.evidence)
    assert material.moisture is None or material.moisture.share[0] < material.moisture.share[1]
    for known in material.evidence.values():
        assert known.confidence in ("measured", "typical", "low")
        assert known.source


def test_what_stands_over_the_first_body_is_met_first(rhombus: Scene) -> None:
    from wakeflow.runs.planned import make_plan

    above = rhombus.replace({"body.two": ABOVE, "feed.height": 0.16, "numerics.rung": "draft"})
    assert above.obstacles == ["two"]
    calm = {"air-loading": False}  # slowed air is no longer uniform, and nothing is injected in it
    assert make_plan(rhombus, target_error=0.05, force=calm).fractions["wheat"].mode == "injected"
    assert make_plan(above, target_error=0.05, force=calm).fractions["wheat"].mode == "resolved"
    assert above.replace({"body.two.at": [0.1, 0.12]}).obstacles == []
    assert above.replace({"body.two.at": [0.0, -0.12]}).obstacles == []


def test_symmetry_counts_pairs_of_bodies_and_streams(rhombus: Scene) -> None:
    from wakeflow.runs.planned import make_plan

    left, right = ({"shape": "circle", "width": 0.02, "at": [x, -0.1]} for x in (-0.1, 0.1))
    assert rhombus.symmetric
    assert not rhombus.replace({"body.left": left}).symmetric
    assert rhombus.replace({"body.left": left, "body.right": right}).symmetric
    streamed = rhombus.replace({"channel.inlet.a": INLET})
    assert not streamed.symmetric
    lines = make_plan(streamed).used
    assert "secondary streams: a add 0.02 of the main stream's air" in lines  # 2 m/s x 20 mm beside 5 m/s x 400 mm
    assert streamed.replace({"channel.inlet.b": {**INLET, "side": "right"}}).symmetric
    assert not streamed.replace({"channel.inlet.b": {**INLET, "side": "right", "velocity": 1.0}}).symmetric


OF_MANY = ("sweep-*.toml", "search-*.toml")  # tables beside a scene's own
SCENES = sorted(path for path in CASES.rglob("*.toml") if not any(path.match(name) for name in OF_MANY))


@cache
def _validator() -> Draft202012Validator:
    schema = scene_schema()
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def test_bins_have_images_where_all_of_the_scene_has() -> None:
    """The shipped rhombus: middle, inner-left, inner-right, outer-left, outer-right, and elsewhere."""
    rhombus = shipped("rhombus")
    assert rhombus.images == (0, 2, 1, 4, 3, 5)
    for key, value in {
        "feed.position": 1e-4, "bin.inner-left.from": -0.134, "vibration.direction": 1.5,
        "feed.profile": {"distribution": "table", "positions": [-0.01, 0.0, 0.01], "weights": [1.0, 2.0, 1.1]},
    }.items():  # fmt: skip
        assert not rhombus.replace({key: value}).images, key
    assert rhombus.replace({"feed.profile": "triangular"}).images == rhombus.images
    assert shipped("labyrinth").images == (2, 1, 0, 3)


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
    ({"uncertainty": {"feed": {"width": "2 mm"}, "fraction": {"wheat": {"size": "5 %"}}}}, True),
    ({"uncertainty.never_above": [["fraction.chaff.size", "fraction.wheat.size"]]}, True),
    ({"uncertainty.together": [{"inputs": ["feed.width", "feed.height"], "correlation": -0.5}]}, True),
    ({"uncertainty.together": [{"inputs": ["feed.width", "feed.height"], "correlation": 1.0}]}, False),
    ({"uncertainty.together": [{"inputs": ["feed.width"], "correlation": 0.5}]}, False),
    ({"uncertainty.together": [{"inputs": ["feed.width", "feed.height"]}]}, False),
    ({"uncertainty.never_above": ["fraction.chaff.size", "fraction.wheat.size"]}, False),
    ({"uncertainty.feed": {"width": [1.0]}}, False),
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


def test_the_schema_does_without_docstrings() -> None:
    """python -OO leaves them out."""
    code = "from wakeflow.scene.schema import scene_schema; scene_schema()"
    subprocess.run([sys.executable, "-OO", "-c", code], check=True, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})


def test_every_key_is_explained_with_unit_range_and_default() -> None:
    schema = scene_schema()
    for name, table in schema["$defs"].items():
        assert table["description"], name
        for key, node in table["properties"].items():
            assert "const" in node or "$ref" in node or node.get("description"), f"{name}.{key}"
    air, vibration = schema["$defs"]["Air"]["properties"], schema["$defs"]["Vibration"]["properties"]
    assert air["speed"]["unit"] == "m/s"
    words = "0: air at rest; >= 0 m/s and <= 100 m/s; a number in m/s, or a string such as '5 m/s'"
    assert air["speed"]["description"] == words
    assert air["turbulence"]["default"] == 0.05
    assert vibration["direction"]["default"] == pytest.approx(1.5707963)
    assert "null" not in str(schema)
    assert "None" not in str(schema)


PEAS = """
[peas]
diameter = 4.1e-3
density = 1100.0
confidence = "measured"
source = "our own lot, 2026"
[peas.terminal_velocity]
value = 6.2
std = 0.3
confidence = "measured"
source = "our own lot, 2026"
[peas.restitution]
value = 0.45
std = 0.05
confidence = "low"
source = "as barley"
[peas.friction]
value = 0.4
std = 0.0
confidence = "low"
source = "as barley"
[peas.rebound_scatter]
value = 0.2
confidence = "low"
source = "as barley"
[peas.impact]
model = "disc"
confidence = "low"
source = "as barley"
"""


def _scene(folder: Path, text: str = PEAS, fraction: str = 'material = "peas"') -> Scene:
    (folder / "mine.toml").write_text(text)
    whole = 'materials = "mine.toml"\n' + (CASES / "rhombus.toml").read_text()
    (folder / "scene.toml").write_text(whole.replace('material = "chaff"', fraction))
    return Scene.load(folder / "scene.toml")


def test_a_fraction_has_the_values_of_its_own_material(tmp_path: Path) -> None:
    peas = _scene(tmp_path).fraction["chaff"]
    assert peas.properties.density == 1100.0
    assert peas.properties.terminal_velocity == 6.2
    assert (peas.properties.friction, peas.properties.rebound_scatter, peas.impact_model) == (0.4, 0.2, "disc")
    spread = peas.coefficients("restitution", np.array([0.5, 0.8413]))
    assert spread is not None
    assert spread == pytest.approx([0.45, 0.50], abs=1e-4)
    assert peas.diameters(np.array([0.5]))[0] == 4.1e-3


def test_what_the_fraction_says_itself_comes_first(tmp_path: Path) -> None:
    peas = _scene(tmp_path, fraction='material = "peas"\ndensity = 1050\nterminal_velocity = "6.5 m/s"')
    assert peas.fraction["chaff"].properties.density == 1050.0
    assert peas.fraction["chaff"].properties.terminal_velocity == 6.5


def test_a_result_tells_the_values_and_not_the_file(tmp_path: Path) -> None:
    scene = _scene(tmp_path)
    assert "materials" not in scene.tables()
    assert Scene.parse(scene.tables()) == scene
    scene.save(tmp_path / "again.toml")
    (tmp_path / "mine.toml").unlink()
    assert Scene.load(tmp_path / "again.toml") == scene


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("density = 1100.0", "", "scene.toml: mine.toml: peas: lacks density"),
        ("density = 1100.0", "densty = 1100.0\ndensity = 1.0", "densty: unknown; did you mean 'density'?"),
        ("density = 1100.0", 'density = "1100 kg"', "needs a number in kg/m^3 or a string such as '1.3 g/cm^3'"),
        ("diameter = 4.1e-3", 'dimeter = "2.4 mm"', "dimeter: unknown; did you mean 'diameter'?"),
        ("diameter = 4.1e-3", "diameter = 4.1", "peas.diameter = 4.1: needs a number in SI units from 0 to 0.1"),
        ("std = 0.3\n", "", "peas: lacks terminal_velocity.std"),
        ('confidence = "measured"', 'confidence = "sure"', "write measured, typical, low"),
        ("[peas", "[wheat", "wheat: is a built-in material; give yours another name"),
        ("[peas]", "[peas", "not valid TOML"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(SceneError) as problem:
        _scene(tmp_path, PEAS.replace(old, new))
    assert message in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('materials = "mine.toml"\n' + (CASES / "rhombus.toml").read_text())
    with pytest.raises(SceneError, match=r"mine.toml': No such file"):
        Scene.load(tmp_path / "scene.toml")


def test_all_materials_are_listed_within_the_screen(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["materials"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    starts = [line.split()[0] for line in lines if line.split()]
    assert [name for name in materials if name not in starts] == []


def test_a_material_tells_ranges_sources_and_trust(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials", "wheat"]) == 0
    out = capsys.readouterr().out
    assert "terminal_velocity: 7.8 +- 0.36 m/s (a lot's mean: +- 0.31); measured" in out
    assert "by moisture: 6.81 m/s at 7%, 8.63 m/s at 20%" in out
    (tmp_path / "mine.toml").write_text(PEAS)
    assert main(["materials", "peas", "--file", str(tmp_path / "mine.toml")]) == 0
    assert "our own lot, 2026" in capsys.readouterr().out
    assert main(["materials", "wheet"]) == 2
    assert "did you mean 'wheat'?" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["[/x]", "[red]x", ":smile:", "\x1b[31mx"])
def test_a_name_is_shown_as_it_is_written(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not as markup, a picture or a command to the terminal."""
    written = json.dumps(name)
    (tmp_path / "mine.toml").write_text(PEAS.replace("[peas", f"[{written}").replace("[peas.", f"[{written}."))
    for words in ([], [name]):
        assert main(["materials", *words, "--file", str(tmp_path / "mine.toml")]) == 0
        assert repr(name)[1:-1] in capsys.readouterr().out


def test_all_that_a_material_lacks_is_said_at_once(tmp_path: Path) -> None:
    with pytest.raises(SceneError) as problem:
        _scene(tmp_path, '[peas]\ndimeter = "2.4 mm"\n[peas.restitution]\nvalue = 0.5\n')
    said = str(problem.value)
    wanted = "lacks diameter, density, confidence, source, friction, impact, restitution.std"
    assert wanted in said
    assert "dimeter: unknown; did you mean 'diameter'?" in said
    assert "wakeflow materials --new" in said


def test_a_material_may_have_units_and_a_grade_for_its_density(tmp_path: Path) -> None:
    text = PEAS.replace("diameter = 4.1e-3", 'diameter = "4.1 mm"').replace("value = 0.2", 'value = "10 deg"')
    text = text.replace("density = 1100.0\n", "")
    text += '[peas.density]\nvalue = "1.1 g/cm^3"\nconfidence = "typical"\nsource = "a handbook"\n'
    own = read_materials(_written(tmp_path / "mine.toml", text))["peas"]
    assert (own.diameter, own.density) == pytest.approx((4.1e-3, 1100.0))
    assert own.rebound_scatter == pytest.approx(math.radians(10.0))
    assert own.evidence["density"].confidence == "typical"


def _written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_new_material_file_is_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    assert main(["materials", "--new", str(path)]) == 0
    assert f"{path} written" in capsys.readouterr().out
    assert read_materials(path)["peas"].diameter == pytest.approx(7.1e-3)
    assert main(["materials", "--new", str(path)]) == 2
    assert "exists; choose another name" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "nearest"),
    [("pods", "rapeseed-pods"), ("Husk", "husks"), ("leaf", "leaves"), ("canola", "rapeseed"), ("corn", "maize"),
     ("rye", "triticale"), ("broken-kernel", "broken-wheat"), ("flake", "chaff"), ("galum", "cleavers"),
     ("rapeseed pods", "rapeseed-pods"), ("Rape seed", "rapeseed"), ("weeds", "cleavers")],
)  # fmt: skip
def test_an_unknown_material_names_the_nearest(name: str, nearest: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials", name]) == 2
    said = capsys.readouterr().err
    assert f"'{nearest}'" in said.partition("(known")[0]
    assert all(one not in materials for other in materials for one in materials[other].also)


@pytest.mark.parametrize(("name", "hint"), [("weat", "wheat"), ("barely", "barley"), ("broken-rice", ""), ("tin", "")])
def test_a_hint_is_never_another_substance(name: str, hint: str) -> None:
    said = near_material(name, list(materials))
    assert said == (f"; did you mean {hint!r}?" if hint else "")


def test_a_grade_is_that_of_the_number_beside_it() -> None:
    rows = {row.quantity: row for row in material_rows(shipped("prism", {"fraction.wheat.material": "barley"}))
            if row.fraction == "wheat"}  # fmt: skip
    assert rows["density"].confidence == "typical"
    assert rows["diameter of the equal sphere"].confidence == "measured"


def test_moisture_moves_what_was_measured_by_it(rhombus: Scene) -> None:
    """Wheat of 20 % falls at the 8.63 m/s that were measured there over the 7.72 m/s in the middle."""
    wet = rhombus.replace({"fraction.wheat.moisture": "20 %"}).fraction["wheat"].properties
    dry = materials["wheat"]
    assert wet.terminal_velocity == pytest.approx(dry.terminal_velocity * 8.63 / 7.72)
    assert wet.friction == pytest.approx(dry.friction * 0.335 / 0.292)
    assert wet.restitution == dry.restitution
    swollen = materials["soybean"].at_moisture(0.16)
    assert (swollen.diameter, swollen.density) == (pytest.approx(7.14e-3, rel=2e-3), pytest.approx(906.0, rel=2e-3))
    assert (swollen.terminal_velocity, swollen.restitution) == (None, 0.6)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fraction.wheat.moisture": "32 %"}, "moisture = 32 %: measured from 7 % to 20 % of water"),
        ({"fraction.dust.moisture": "12 %"}, "no data say what water does to this material"),
    ],
)
def test_moisture_without_data_is_refused(rhombus: Scene, changes: dict[str, object], said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said)):
        rhombus.replace(changes)


def test_a_table_changes_its_own_keys_and_keeps_the_others(rhombus: Scene) -> None:
    up = rhombus.replace({"air.direction": "up"})
    assert up.replace({"air": {"speed": "7 m/s"}}).air.direction == "up"
    wider = up.replace({"body": {"rhombus": {"width": "60 mm"}}, "numerics": {"span": {"layers": 8}}})
    assert wider.body["rhombus"].slope_angle == up.body["rhombus"].slope_angle
    assert wider.fraction == up.fraction
    cut = rhombus.replace({"body.rhombus": {"shape": "circle", "width": "50 mm"}})  # another shape comes whole
    assert cut.body["rhombus"].slope_angle is None
    sized = rhombus.replace({"fraction.wheat.size": {"distribution": "normal", "mean": "3 mm", "std": "0.2 mm"}})
    other = sized.replace({"fraction": {"wheat": {"size": {"distribution": "single", "diameter": "3 mm"}}}})
    assert other.fraction["wheat"].size.std is None  # a value is swapped
    assert other.fraction["wheat"].material == "wheat"


@pytest.mark.parametrize("text", ["2 ton/hour", "2 tons/hour", "40 cwt/hour"])
def test_a_unit_of_two_meanings_is_refused_with_both(rhombus: Scene, text: str) -> None:
    with pytest.raises(SceneError, match=r"may be .* or "):
        rhombus.replace({"feed.rate": text})
    metric = rhombus.replace({"feed.rate": "2 t/hour"}).feed.rate
    assert rhombus.replace({"feed.rate": "2 short_ton/hour"}).feed.rate == pytest.approx(0.907 * metric, rel=1e-3)
